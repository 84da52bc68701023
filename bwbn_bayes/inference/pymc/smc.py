"""PyMC's sequential Monte Carlo with a batched kernel.

PyMC's kernels evaluate particles one by one, stop the search for the next tempering parameter at an absolute 1e-6, and
add 1e-6 to the variances of their proposals. A long record needs first steps below 1e-6 and leaves posteriors narrower
than 1e-3. :class:`Batched` solves all particles in one call, searches to a relative tolerance as our TMCMC does, and
moves until the cloud has forgotten where it started. Its moves are TMCMC's too: a proposal fitted to the very particle
that it moves favours that particle, a bias that adds up over the stages, and so does a step size that follows the
acceptance it meets. So each half of the particles is moved by what the other half looks like, unchanged for a stage.

References
----------
.. [1] J. Olsson and R. Douc, "Numerically stable online estimation of variance in particle filters", Bernoulli 25(2),
   2019 (the effective size, from ancestors a few stages back).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from pymc.pytensorf import join_nonshared_inputs, make_shared_replacements
from pymc.smc.kernels import IMH
from pytensor.graph.replace import vectorize_graph

from bwbn_bayes.inference.tmcmc import moves
from bwbn_bayes.inference.tmcmc.coordinates import Coordinates
from bwbn_bayes.inference.tmcmc.mixture import fit_mixture
from bwbn_bayes.inference.tmcmc.moves import EMPTY_TALLY, FIRST_TUNING, Shape, retune
from bwbn_bayes.inference.tmcmc.target import Integers
from bwbn_bayes.inference.tmcmc.tempering import log_mean, next_tempering_parameter, normalised
from bwbn_bayes.parameters import Booleans, Floats

_LEAST_SWEEPS = 4
_LAG = 3
"""Stages back to the ancestors by which particles are related; further back too few are left to tell them apart."""

StageListener = Callable[[Mapping[str, float]], None]
"""Called with the statistics of each finished stage."""


class Batched(IMH):
    """Batched kernel for ``pm.sample_smc``.

    Each stage sweeps with the moves of :mod:`bwbn_bayes.inference.tmcmc.moves`, in PyMC's unconstrained coordinates,
    until the log likelihood and every coordinate have lost their correlation with the start.

    Parameters
    ----------
    threshold : float
        Effective sample size kept from stage to stage, as a share of the particles.
    correlation_threshold : float
        Largest correlation left between a stage's start and end.
    most_sweeps : int
        Sweeps in one stage at most.
    listener : callable, optional
        Called after every stage.
    """

    beta: float
    stats_dtypes_shapes: ClassVar[dict[str, tuple[type, list[int]]]] = {
        "log_marginal_likelihood": (float, []),
        "beta": (float, []),
        "accept_rate": (float, []),
        "n_sweeps": (int, []),
        "n_solves": (int, []),
        "n_failed": (int, []),
        "effective_sample_size": (float, []),
    }

    def __init__(
        self,
        *args: Any,
        correlation_threshold: float = 0.1,
        most_sweeps: int = 100,
        listener: StageListener | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(*args, correlation_threshold=correlation_threshold, **kwargs)
        self.most_sweeps = most_sweeps
        self.listener = listener
        self.n_solves = self.n_failed = 0
        self.density = _batched_density(pm.modelcontext(kwargs.get("model")), kwargs.get("compile_kwargs") or {})

    def _initialize_kernel(self) -> None:
        population = self.start or self.initialize_population()
        columns = [np.asarray(population[v.name]).reshape(self.draws, -1) for v in self.variables]
        self.tempered_posterior = np.concatenate(columns, axis=1)
        self.n_solves = self.n_failed = 0
        self.prior_logp, self.likelihood_logp = self._evaluate(self.tempered_posterior)
        self.tuning = FIRST_TUNING
        self.lineage: list[Integers] = []

    def _evaluate(self, points: Floats) -> tuple[Floats, Floats]:
        prior, likelihood = self.density(points)
        self.n_solves += len(points)
        self.n_failed += int(np.count_nonzero(~np.isfinite(likelihood)))
        # A draw outside the prior's support may fail to solve in any way: it is rejected all the same.
        return np.where(np.isnan(prior), -np.inf, prior), np.where(np.isnan(likelihood), -np.inf, likelihood)

    def update_beta_and_weights(self) -> None:
        """The next tempering parameter to a relative tolerance, weights and evidence in log space."""
        self.iteration += 1
        past = float(self.beta)
        variation = float(np.sqrt(1.0 / self.threshold - 1.0))
        self.beta = next_tempering_parameter(self.likelihood_logp, past, variation)
        log_weights = (self.beta - past) * self.likelihood_logp
        self.weights = normalised(log_weights)
        self.log_marginal_likelihood += log_mean(log_weights)

    def resample(self) -> None:
        """Resample, and remember the ancestors of the last stages."""
        super().resample()
        generations = [np.arange(self.draws), *self.lineage[: _LAG - 1]]
        self.lineage = [labels[self.resampling_indexes] for labels in generations]

    @property
    def families(self) -> Integers:
        """Common ancestors ``(n,)`` some stages back."""
        return self.lineage[-1]

    def tune(self) -> None:
        """Fit to each half of the families what moves the other half."""
        halves = [self.families % 2 == parity for parity in (0, 1)]
        fewest = 2 * (self.tempered_posterior.shape[1] + 1)
        if min(len(np.unique(self.resampling_indexes[half])) for half in halves) < fewest:
            halves = [np.ones(self.draws, dtype=np.bool_)] * 2
        self.groups = self.families % 2
        self.shapes = [self._shape(half) for half in reversed(halves)]

    def _shape(self, chosen: Booleans) -> Shape:
        points = self.tempered_posterior[chosen]
        distinct = len(np.unique(self.resampling_indexes[chosen]))
        mixture = fit_mixture(points, np.full(len(points), 1.0 / len(points)), float(distinct))
        return Shape.of(Coordinates.probit(points.shape[1]), mixture, points)

    def mutate(self) -> None:
        """Sweep until log likelihood and coordinates have lost their correlation with the start."""
        start, tally = self._watched(), EMPTY_TALLY
        for sweep in range(1, self.most_sweeps + 1):
            tally = self._sweep(tally)
            if sweep >= _LEAST_SWEEPS and _largest_correlation(start, self._watched()) < self.correlation_threshold:
                break
        self.n_steps, self.acc_rate = sweep, tally.acceptance
        self.tuning = retune(self.tuning, tally)

    def _watched(self) -> Floats:
        return np.column_stack([self.tempered_posterior, self.likelihood_logp])

    def _sweep(self, tally: moves.Tally) -> moves.Tally:
        """One Metropolis-Hastings step of every particle, in one batch of solves."""
        present = self.tempered_posterior
        proposed = np.empty_like(present)
        kinds = np.empty(self.draws, dtype=np.int64)
        log_asymmetry, jumps = np.empty((2, self.draws))
        for group, shape in enumerate(self.shapes):
            mine = self.groups == group
            fit = shape.mixture.log_density(present[mine])
            proposal = moves.propose(present[mine], fit, shape, self.tuning, self.rng)
            proposed[mine], kinds[mine], log_asymmetry[mine] = (
                proposal.positions,
                proposal.moves,
                proposal.log_asymmetry,
            )
            jumps[mine] = shape.squared_jumps(present[mine], proposal.positions)
        accepted = self._accept(proposed, log_asymmetry)
        return tally.add(kinds, accepted.astype(np.float64), jumps)

    def _accept(self, proposal: Floats, log_correction: Floats) -> Booleans:
        prior, likelihood = self._evaluate(proposal)
        density = prior + self.beta * likelihood
        accepted: Booleans = (
            np.log(self.rng.random(self.draws)) < density - self.tempered_posterior_logp + log_correction
        )
        self.tempered_posterior[accepted] = proposal[accepted]
        self.prior_logp[accepted], self.likelihood_logp[accepted] = prior[accepted], likelihood[accepted]
        self.tempered_posterior_logp[accepted] = density[accepted]
        return accepted

    def sample_stats(self) -> dict[str, float]:
        """Statistics of the stage; counts are running totals."""
        facts = {
            "log_marginal_likelihood": self.log_marginal_likelihood,
            "beta": self.beta,
            "accept_rate": self.acc_rate,
            "n_sweeps": self.n_steps,
            "n_solves": self.n_solves,
            "n_failed": self.n_failed,
            "effective_sample_size": effective_size(self._watched(), self.families),
        }
        if self.listener is not None:
            self.listener(facts)
        return facts


def _batched_density(model: pm.Model, compile_kwargs: Mapping[str, Any]) -> Callable[[Floats], tuple[Floats, Floats]]:
    """Log prior and log likelihood ``(n,)`` of points ``(n, d)`` in PyMC's unconstrained coordinates, compiled."""
    point, variables = model.initial_point(), model.value_vars
    shared = make_shared_replacements(point, variables, model)
    outputs, flat = join_nonshared_inputs(
        point=point, outputs=[model.varlogp, model.datalogp], inputs=variables, shared_inputs=shared
    )
    points = pt.matrix("points")
    batched = vectorize_graph(outputs, {flat: points})
    function = pm.compile([points], batched, **{**compile_kwargs, "on_unused_input": "ignore"})
    function.trust_input = True
    return function  # type: ignore[no-any-return]


def effective_size(points: Floats, families: Integers) -> float:
    """Independent draws that particles ``(n, d)`` are worth, of which those of one family ``(n,)`` may be alike.

    The mean's variance is that of the families' sums; the order of the particles says nothing.
    """
    centred = points - np.mean(points, axis=0)
    sums = np.zeros((int(np.max(families)) + 1, points.shape[1]))
    np.add.at(sums, families, centred)
    error = np.sum(np.square(sums), axis=0) / len(points)
    variance = np.mean(np.square(centred), axis=0)
    varying = variance > 0.0
    if not np.any(varying):
        return 1.0
    return min(float(len(points)), len(points) * float(np.min(variance[varying] / error[varying])))


def _largest_correlation(start: Floats, now: Floats) -> float:
    start, now = start - start.mean(axis=0), now - now.mean(axis=0)
    lengths = np.sqrt(np.sum(start**2, axis=0) * np.sum(now**2, axis=0))
    return float(np.max(np.abs(np.sum(start * now, axis=0)) / np.where(lengths > 0.0, lengths, np.inf)))


KernelName = Literal["batched", "imh", "mh"]
KERNELS: Mapping[KernelName, type] = {"batched": Batched, "imh": pm.smc.IMH, "mh": pm.smc.MH}
"""The batched kernel and PyMC's own."""


@dataclass(frozen=True, kw_only=True)
class SmcRun:
    """Draws of PyMC's SMC, tidied.

    Attributes
    ----------
    tree : DataTree
        As PyMC gives it, ``sample_stats`` over (chain, stage) with NaN where a chain has fewer stages.
    log_evidences : (n_chains,) array
        Of each chain.
    log_evidence, log_evidence_se : float
        Log of the mean of the chains' evidences, and its standard error from their spread (NaN for one chain).
    """

    tree: xr.DataTree
    log_evidences: Floats
    log_evidence: float
    log_evidence_se: float

    @property
    def effective_sample_size(self) -> float:
        """Independent draws that all chains are worth; not a number for PyMC's own kernels, which do not tell."""
        stats_ = self.tree["sample_stats"].dataset
        if "effective_sample_size" not in stats_:
            return float("nan")
        return sum(float(row[np.isfinite(row)][-1]) for row in stats_["effective_sample_size"].values)

    @property
    def n_solves(self) -> int:
        """Solves of all chains; of PyMC's own kernels, which do not count, zero."""
        stats_ = self.tree["sample_stats"].dataset
        return int(stats_["n_solves"].max("stage").sum()) if "n_solves" in stats_ else 0


def sample_smc(
    twin: pm.Model,
    *,
    draws: int = 2000,
    chains: int = 4,
    seed: int,
    kernel: KernelName = "batched",
    listener: StageListener | None = None,
) -> SmcRun:
    """Run ``pm.sample_smc`` chain by chain in this process and tidy what it returns.

    Parameters
    ----------
    twin : pymc.Model
        Any PyMC model whose graph can be vectorised; :func:`~bwbn_bayes.inference.pymc.model.to_pymc` makes one.
    draws : int
        Particles of each chain.
    chains : int
        Independent runs; their spread is the error of the evidence.
    seed : int
        The run is a function of it.
    kernel : {"batched", "imh", "mh"}
        The batched kernel, or one of PyMC's own for comparison.
    listener : callable, optional
        Told of every finished stage (batched kernel only).
    """
    options: dict[str, object] = {"listener": listener} if kernel == "batched" else {}
    with quiet():
        tree = pm.sample_smc(
            draws=draws,
            kernel=KERNELS[kernel],
            model=twin,
            chains=chains,
            cores=1,
            random_seed=seed,
            progressbar=False,
            compute_convergence_checks=False,
            **options,
        )
    return tidy(tree)


@contextmanager
def quiet() -> Iterator[None]:
    """PyMC announces every run on its logger; callers of ours have a listener."""
    logger = logging.getLogger("pymc")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


def tidy(tree: xr.DataTree) -> SmcRun:
    """Bring any of the layouts of ``pm.sample_smc``'s statistics into one that netCDF can hold.

    PyMC gives (chain, stage) as objects where the chains have equal stages, lists where they differ, and calls the
    stages of a single chain its chains.
    """
    raw = tree["sample_stats"].dataset
    n_chains = tree["posterior"].sizes["chain"]
    columns = {str(name): _rows(variable.values, n_chains) for name, variable in raw.data_vars.items()}
    length = max(len(row) for rows in columns.values() for row in rows)
    tidied = xr.Dataset(
        {
            name: (
                ("chain", "stage"),
                np.array([np.pad(row, (0, length - len(row)), constant_values=np.nan) for row in rows]),
            )
            for name, rows in columns.items()
        },
        coords={"chain": tree["posterior"]["chain"].values, "stage": np.arange(length)},
        attrs={key: value for key, value in raw.attrs.items() if isinstance(value, (str, int, float))},
    )
    groups = {path: node.dataset for path, node in tree.children.items()}
    evidences = np.array([row[-1] for row in columns["log_marginal_likelihood"]])
    relative = np.exp(evidences - np.max(evidences))
    error = np.std(relative, ddof=1) / np.mean(relative) / np.sqrt(n_chains) if n_chains > 1 else np.nan
    return SmcRun(
        tree=xr.DataTree.from_dict({**groups, "sample_stats": tidied}),
        log_evidences=evidences,
        log_evidence=log_mean(evidences),
        log_evidence_se=float(error),
    )


def _rows(values: np.ndarray[tuple[int, ...], np.dtype[Any]], n_chains: int) -> list[Floats]:
    if n_chains == 1:
        return [np.asarray(values, dtype=np.float64).ravel()]
    return [np.asarray(row, dtype=np.float64) for row in values]
