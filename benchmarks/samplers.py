"""Every road to the same posteriors: our TMCMC, PyMC's SMC with its own kernels and with the batched one, NUTS.

``python -m benchmarks.samplers [--quick] [--seeds 10] [--limit 1800] [--out reports]``

Cases: (a) linear-Gaussian regressions of N points and d parameters, whose posterior and evidence are known in closed
form; (b) ``models/sdof.py``; (c) ``models/three_storey_el_centro.py``. For (b) and (c) the answer is importance
sampling at the modes. 2,000 draws or particles for (a), 500 for (b) and (c). Each cell (case, sampler, data seed) runs
in a process of its own, under a time limit, and is kept in ``samplers.jsonl``: a run that was cut off goes on where it
stopped. The table goes to ``samplers.md`` as it came out.

Columns: mean and sd over data seeds of the log evidence's error; the worst error of a posterior mean, in posterior sds;
the share of true values inside the central 90 % intervals and the interval score (in posterior sds, smaller is better)
[1]_; effective draws per second, where the effective draws are one over the mean square error of the posterior means in
sds, so that no sampler is believed about itself; likelihood evaluations; wall time.

References
----------
.. [1] T. Gneiting and A. E. Raftery, "Strictly Proper Scoring Rules, Prediction, and Estimation", 2007,
   doi:10.1198/016214506000001437.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from pymc.model.core import ValueGradFunction
from scipy import special

from bwbn_bayes import simulate, to_pymc
from bwbn_bayes.inference.accuracy import LADDER, choose_scheme
from bwbn_bayes.inference.importance import laplace_mixture, sample_importance
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import Mode, distinct, find_modes, polish
from bwbn_bayes.inference.pymc.coordinates import NormalCoordinates
from bwbn_bayes.inference.pymc.forward import forward_problem
from bwbn_bayes.inference.pymc.nuts import sample_nuts
from bwbn_bayes.inference.pymc.roads import values_of
from bwbn_bayes.inference.pymc.smc import KernelName, sample_smc
from bwbn_bayes.inference.summary import processor_name
from bwbn_bayes.inference.tmcmc.sampler import Variant, sample
from bwbn_bayes.inference.tmcmc.target import Target
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.model_file import load_model_file

MODELS = {"sdof": Path("models/sdof.py"), "three_storey": Path("models/three_storey_el_centro.py")}
SAMPLERS = ("tmcmc plain", "tmcmc", "smc imh", "smc mh", "smc batched", "nuts")
_NOISE_SD = 0.2
_REFERENCE_DRAWS = 10_000


@dataclass(frozen=True, kw_only=True)
class Regression:
    """Linear-Gaussian regression of known noise under a standard normal prior, over its sufficient statistics.

    Attributes
    ----------
    gram : (d, d) array
    estimate, truth : (d,) array
        Least-squares estimate and the true coefficients, a draw of the prior.
    constant : float
        Log likelihood at the estimate.
    n_solves : list of int
        Likelihood evaluations so far, call by call.
    """

    gram: Floats
    estimate: Floats
    truth: Floats
    constant: float
    n_solves: list[int]

    @classmethod
    def drawn(cls, n_data: int, n_dim: int, seed: int) -> Regression:
        """A correlated random design and data."""
        rng = np.random.default_rng([seed, n_dim, n_data])
        correlation = 0.5 ** np.abs(np.subtract.outer(np.arange(n_dim), np.arange(n_dim)))
        design = rng.standard_normal((n_data, n_dim)) @ np.linalg.cholesky(correlation).T
        truth = rng.standard_normal(n_dim)
        data = design @ truth + _NOISE_SD * rng.standard_normal(n_data)
        gram = design.T @ design
        estimate = np.linalg.solve(gram, design.T @ data)
        least = float(np.sum((data - design @ estimate) ** 2))
        constant = -0.5 * n_data * np.log(2.0 * np.pi * _NOISE_SD**2) - 0.5 * least / _NOISE_SD**2
        return cls(gram=gram, estimate=estimate, truth=truth, constant=float(constant), n_solves=[])

    @property
    def n_dim(self) -> int:
        """Number of coefficients."""
        return len(self.estimate)

    def log_prior(self, points: Floats) -> Floats:
        """Zero in the unit cube, minus infinity outside."""
        return np.where(np.all((points > 0.0) & (points < 1.0), axis=1), 0.0, -np.inf)

    def log_likelihood(self, points: Floats) -> Floats:
        """Log likelihood ``(n,)``."""
        self.n_solves.append(len(points))
        error = special.ndtri(points) - self.estimate
        quadratic: Floats = np.einsum("ni,ij,nj->n", error, self.gram, error, optimize=True)
        return self.constant - 0.5 * quadratic / _NOISE_SD**2

    def sample_prior(self, rng: np.random.Generator, n: int) -> Floats:
        """Uniform draws ``(n, d)``."""
        return rng.random((n, self.n_dim))

    def answer(self) -> tuple[float, Floats, Floats]:
        """Log evidence, posterior mean ``(d,)`` and covariance ``(d, d)``."""
        precision = self.gram / _NOISE_SD**2 + np.eye(self.n_dim)
        covariance = np.linalg.inv(precision)
        mean = covariance @ (self.gram @ self.estimate) / _NOISE_SD**2
        error = mean - self.estimate
        peak = self.constant - 0.5 * error @ self.gram @ error / _NOISE_SD**2 - 0.5 * mean @ mean
        return float(peak - 0.5 * np.linalg.slogdet(precision)[1]), mean, covariance

    def twin(self) -> pm.Model:
        """The same in PyMC."""
        with pm.Model() as twin:
            theta = pm.Normal("theta", np.zeros(self.n_dim), 1.0, shape=self.n_dim)
            error = theta - self.estimate
            quadratic = pt.sum(error * pt.dot(self.gram / _NOISE_SD**2, error))
            pm.Potential("likelihood", self.constant - 0.5 * quadratic)
        return twin


class Answer(NamedTuple):
    """What a sampler should find."""

    log_evidence: float
    log_evidence_se: float
    mean: Floats
    sd: Floats
    truth: Floats


class Found(NamedTuple):
    """What it found: equal-weight values, log evidence and its own error, likelihood evaluations (0: not counted)."""

    values: Floats
    log_evidence: float
    log_evidence_se: float
    n_solves: int


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One run of the table, in numbers that the summary needs."""

    case: str
    sampler: str
    data_seed: int
    draws: int
    seconds: float
    log_evidence_error: float
    log_evidence_se: float
    answer_se: float
    mean_errors: tuple[float, ...]
    """Of each parameter, in posterior sds."""
    inside: tuple[bool, ...]
    scores: tuple[float, ...]
    n_solves: int
    failed: str = ""
    """Why there is no figure."""


def run_cell(case: str, sampler: str, data_seed: int, draws: int) -> Cell:
    """Run one sampler on one data set.

    Parameters
    ----------
    case : str
        ``regression N d``, ``sdof`` or ``three_storey``.
    sampler : str
        One of :data:`SAMPLERS`.
    data_seed : int
        Of the data and of the sampler.
    draws : int
        Particles (TMCMC, each of two SMC chains) or draws (each of two NUTS chains).
    """
    if case.startswith("regression"):
        n_data, n_dim = map(int, case.split()[1:])
        answer, found, seconds = _regression(Regression.drawn(n_data, n_dim, data_seed), sampler, data_seed, draws)
    else:
        answer, found, seconds = _structure(MODELS[case], sampler, data_seed, draws)
    errors = (found.values.mean(axis=0) - answer.mean) / answer.sd
    low, high = np.quantile(found.values, [0.05, 0.95], axis=0)
    missed = np.maximum(low - answer.truth, 0.0) + np.maximum(answer.truth - high, 0.0)
    scores = (high - low + missed * 2.0 / 0.1) / answer.sd
    return Cell(
        case=case,
        sampler=sampler,
        data_seed=data_seed,
        draws=draws,
        seconds=seconds,
        log_evidence_error=found.log_evidence - answer.log_evidence,
        log_evidence_se=found.log_evidence_se,
        answer_se=answer.log_evidence_se,
        mean_errors=tuple(errors.tolist()),
        inside=tuple((missed == 0.0).tolist()),
        scores=tuple(scores.tolist()),
        n_solves=found.n_solves,
    )


def _regression(case: Regression, sampler: str, seed: int, draws: int) -> tuple[Answer, Found, float]:
    log_evidence, mean, covariance = case.answer()
    answer = Answer(log_evidence, 0.0, mean, np.sqrt(np.diag(covariance)), case.truth)
    if sampler.startswith("tmcmc"):
        began = time.perf_counter()
        found = _tmcmc(case, sampler, seed, draws)
        found = found._replace(values=special.ndtri(found.values), n_solves=sum(case.n_solves))
        return answer, found, time.perf_counter() - began
    twin = case.twin()
    began = time.perf_counter()
    if sampler == "nuts":
        whitened = _Whitened.of(twin, mean, covariance)
        run = sample_nuts(whitened, draws=draws, chains=2, seed=seed)
        values = mean + run.coordinates.reshape(-1, case.n_dim) @ whitened.factor.T
        return answer, Found(values, float("nan"), float("nan"), run.n_solves), time.perf_counter() - began
    tree, found = _smc(twin, sampler, seed, draws)
    found = found._replace(values=np.asarray(tree["posterior"]["theta"]).reshape(-1, case.n_dim))
    return answer, found, time.perf_counter() - began


@dataclass(frozen=True, kw_only=True)
class _Whitened:
    """A PyMC model in the coordinates of the exact posterior."""

    both: ValueGradFunction
    mean: Floats
    factor: Floats

    @classmethod
    def of(cls, twin: pm.Model, mean: Floats, covariance: Floats) -> Self:
        both = twin.logp_dlogp_function(ravel_inputs=True)
        both.set_extra_values({})
        return cls(both=both, mean=mean, factor=np.linalg.cholesky(covariance))

    @property
    def n_dim(self) -> int:
        return len(self.mean)

    def log_density(self, x: Floats) -> tuple[Floats, Floats]:
        values, gradients = zip(*(self.both(self.mean + self.factor @ one) for one in x), strict=True)
        return np.array(values, dtype=np.float64), np.stack(gradients) @ self.factor


def _structure(path: Path, sampler: str, seed: int, draws: int) -> tuple[Answer, Found, float]:
    posterior, mode, answer = _prepared(path, seed)
    space = posterior.space
    posterior.solves.total = 0
    began = time.perf_counter()
    if sampler.startswith("tmcmc"):
        found = _tmcmc(posterior, sampler, seed, draws)
        found = found._replace(values=space.from_unit(found.values), n_solves=posterior.solves.total)
        return answer, found, time.perf_counter() - began
    if sampler == "nuts":
        coordinates = NormalCoordinates.at(posterior, mode.point)
        run = sample_nuts(coordinates, draws=draws, chains=2, seed=seed)
        values = space.from_unit(coordinates.points(run.coordinates.reshape(-1, space.n_dim)))
        found = Found(values, float("nan"), float("nan"), coordinates.problem.solves.total)
        return answer, found, time.perf_counter() - began
    twin = to_pymc(posterior.model, posterior.record, noise=posterior.noise, engine=posterior.engine)
    tree, found = _smc(twin, sampler, seed, draws)
    n_solves = forward_problem(posterior.model, posterior.record, posterior.engine).solves.total
    return answer, found._replace(values=values_of(tree, space), n_solves=n_solves), time.perf_counter() - began


def _prepared(path: Path, seed: int) -> tuple[Posterior, Mode, Answer]:
    """The posterior at its final scheme, its mode and the answer by importance sampling."""
    file = load_model_file(path)
    assert file.excitation is not None
    record = simulate(file.model, file.excitation, file.truth, snr_db=file.snr_db, seed=seed)
    coarse = LADDER[0]
    posterior = Posterior(model=file.model, record=record, engine=coarse, noise=default_noise(record))
    rng = np.random.default_rng([seed, 1])
    found = find_modes(posterior, rng)
    scheme, _ = choose_scheme(posterior, found[0].point, coarse)
    view = replace(posterior, engine=scheme)
    modes = distinct(*polish(view, np.array([mode.point for mode in found]), n_iterations=20))
    weighted = sample_importance(view, laplace_mixture(modes), rng, effective=_REFERENCE_DRAWS)
    values, weights = view.space.from_unit(weighted.points), np.exp(weighted.log_weights)
    mean = weights @ values
    sd = np.sqrt(weights @ np.square(values - mean))
    truth = np.array([file.truth[name] for name in view.space.names])
    return view, modes[0], Answer(weighted.log_evidence, weighted.log_evidence_se, mean, sd, truth)


def _tmcmc(target: Target, sampler: str, seed: int, draws: int) -> Found:
    variant: Variant = "plain" if sampler.endswith("plain") else "default"
    cloud = sample(target, n_particles=draws, rng_seed=seed, variant=variant)
    return Found(cloud.particles, cloud.log_evidence, cloud.log_evidence_se, cloud.n_solves)


def _smc(twin: pm.Model, sampler: str, seed: int, draws: int) -> tuple[xr.DataTree, Found]:
    kernels: Mapping[str, KernelName] = {"smc imh": "imh", "smc mh": "mh", "smc batched": "batched"}
    run = sample_smc(twin, draws=draws, chains=2, seed=seed, kernel=kernels[sampler])
    return run.tree, Found(np.empty((0, 0)), run.log_evidence, run.log_evidence_se, run.n_solves)


def cells(quick: bool, seeds: int) -> Iterator[tuple[str, str, int, int]]:
    """Case, sampler, data seed and draws of every cell, the cheap ones first."""
    sizes = [(200, 5)] if quick else [(n, d) for d in (5, 12, 20) for n in (200, 2000, 9000)]
    cases = [f"regression {n} {d}" for n, d in sizes] + ["sdof"] + ([] if quick else ["three_storey"])
    for case in cases:
        for sampler in SAMPLERS:
            if quick and case == "sdof" and sampler in ("smc imh", "smc mh", "nuts"):
                continue  # minutes each, one solve at a time
            for seed in range(1, seeds + 1):
                yield case, sampler, seed, 300 if quick else 500 if case in MODELS else 2000


def run_in_process(arguments: tuple[str, str, int, int], limit: float) -> Cell:
    """Run a cell in a process of its own, and say what became of it where it failed."""
    case, sampler, seed, draws = arguments
    none = Cell(
        case=case, sampler=sampler, data_seed=seed, draws=draws, seconds=limit, log_evidence_error=float("nan"),
        log_evidence_se=float("nan"), answer_se=float("nan"), mean_errors=(), inside=(), scores=(), n_solves=0,
    )  # fmt: skip
    command = [sys.executable, "-m", "benchmarks.samplers", "--cell", json.dumps(arguments)]
    try:
        run = subprocess.run(command, capture_output=True, text=True, timeout=limit, check=False)
    except subprocess.TimeoutExpired:
        return replace(none, failed=f"not done in {limit:.0f} s")
    if run.returncode != 0:
        return replace(none, failed=run.stderr.strip().splitlines()[-1] if run.stderr else f"exit {run.returncode}")
    return _read(run.stdout.splitlines()[-1])


def _read(line: str) -> Cell:
    raw = json.loads(line)
    return Cell(**{**raw, **{name: tuple(raw[name]) for name in ("mean_errors", "inside", "scores")}})


def summary(done: Sequence[Cell]) -> str:
    """The table in Markdown, one row for each case and sampler."""
    head = (
        "case", "sampler", "runs", "log evidence error [nat]", "worst mean error [sd]", "coverage of 90 %",
        "interval score [sd]", "effective draws per s", "likelihood evaluations", "wall time [s]", "not done",
    )  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for case, sampler in dict.fromkeys((cell.case, cell.sampler) for cell in done):
        rows = [cell for cell in done if (cell.case, cell.sampler) == (case, sampler)]
        lines.append("| " + " | ".join((case, sampler, *_figures(rows))) + " |")
    return "\n".join(lines) + "\n"


def _figures(rows: Sequence[Cell]) -> tuple[str, ...]:
    good = [cell for cell in rows if not cell.failed]
    reasons = "; ".join(sorted({cell.failed for cell in rows if cell.failed}))
    if not good:
        return (f"0 of {len(rows)}", *["-"] * 7, reasons)
    evidence = np.array([cell.log_evidence_error for cell in good])
    errors = np.array([cell.mean_errors for cell in good])
    seconds = float(np.mean([cell.seconds for cell in good]))
    effective = 1.0 / float(np.mean(np.square(errors)))
    spread = f" ± {np.std(evidence, ddof=1):.2f}" if len(good) > 1 else ""
    solves = float(np.mean([cell.n_solves for cell in good]))
    return (
        f"{len(good)} of {len(rows)}",
        f"{np.mean(evidence):+.2f}{spread}" if np.all(np.isfinite(evidence)) else "none",
        f"{np.max(np.abs(errors)):.2f}",
        f"{np.mean([cell.inside for cell in good]):.2f}",
        f"{np.mean([cell.scores for cell in good]):.2f}",
        f"{effective / seconds:.3g}",
        f"{solves:.3g}" if solves else "not counted",
        f"{seconds:.1f}",
        reasons or "-",
    )


def main() -> None:
    """Run what is not yet there, then write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one regression and sdof, 300 particles, two seeds")
    parser.add_argument("--seeds", type=int, help="data sets of each case; 10 by default")
    parser.add_argument("--limit", type=float, default=1800.0, help="seconds for one cell")
    parser.add_argument("--out", type=Path, default=Path("reports"))
    parser.add_argument("--cell", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.cell:
        print(json.dumps(asdict(run_cell(*json.loads(options.cell)))))
        return
    name = "samplers_quick" if options.quick else "samplers"
    log = options.out / f"{name}.jsonl"
    log.parent.mkdir(parents=True, exist_ok=True)
    done = [_read(line) for line in log.read_text().splitlines()] if log.exists() else []
    known = {(cell.case, cell.sampler, cell.data_seed, cell.draws) for cell in done}
    for arguments in cells(options.quick, options.seeds or (2 if options.quick else 10)):
        if arguments in known:
            continue
        cell = run_in_process(arguments, options.limit)
        done.append(cell)
        with log.open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(cell)) + "\n")
        print(
            f"{cell.case}, {cell.sampler}, seed {cell.data_seed}: {cell.failed or f'{cell.seconds:.1f} s'}", flush=True
        )
    table = summary(done)
    note = f"Processor: {processor_name()}. Processes started cold or warm as the compile caches were.\n"
    (options.out / f"{name}.md").write_text(f"# Samplers\n\n{note}\n{table}", encoding="utf-8")
    print(table)


if __name__ == "__main__":
    main()
