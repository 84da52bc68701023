"""From posterior draws to a :class:`~bwbn_bayes.results.Result`: arrays, facts, the verdict."""

from __future__ import annotations

import math
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np

from bwbn_bayes.engines.base import Engine, channel_map
from bwbn_bayes.engines.exact import exact_response, observable
from bwbn_bayes.inference.accuracy import Discretisation
from bwbn_bayes.inference.arrays import posterior_tree
from bwbn_bayes.inference.identifiability import describe, flag
from bwbn_bayes.inference.importance import WeightedDraws
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.registry import title_of
from bwbn_bayes.inference.responses import N_DRAWS, Singles, evenly, summarised
from bwbn_bayes.inference.tmcmc.sampler import TmcmcResult
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.blocks import labels, mean_squares
from bwbn_bayes.records.cycles import path_of
from bwbn_bayes.records.record import Record
from bwbn_bayes.results import (
    DOUBTS,
    Check,
    Equation,
    Facts,
    ParameterFacts,
    Result,
    StageFacts,
)
from bwbn_bayes.structures.equations import structure_equations
from bwbn_bayes.structures.structure import Structure
from bwbn_bayes.versions import version_of

_NEAR_A_BOUND = 0.01
"""Share of an interval's width within which its outermost draw lies at a bound."""

_WITH_FORCE = "a force of no known law beside it takes that up: the intervals know of it."
_WITHOUT_FORCE = (
    "the posterior holds only if the model does. For intervals that know of model error, identify it with an unnamed "
    "force beside it (--unnamed-force)."
)

_LIBRARIES = ("bwbn-bayes", "numpy", "scipy", "llvmlite", "sympy", "arviz", "xarray")


@dataclass(frozen=True, kw_only=True)
class Draws:
    """Equal-weight posterior draws with the moments of the draws behind them.

    Attributes
    ----------
    points : (n_draws, n_dim) array
        Points of the unit cube.
    log_likelihood : (n_draws,) array
    weighted_points : (n, n_dim) array
        The draws that the moments are taken from.
    weights : (n,) array
        Their weights, summing to one.
    effective_sample_size : float
        Independent draws they are worth.
    """

    points: Floats
    log_likelihood: Floats
    weighted_points: Floats
    weights: Floats
    effective_sample_size: float

    @classmethod
    def of_weighted(cls, weighted: WeightedDraws, rng: np.random.Generator, n: int) -> Self:
        """Resample weighted draws to ``n`` of equal weight; moments keep the weights."""
        points, log_likelihood = weighted.resampled(rng, n)
        return cls(
            points=points,
            log_likelihood=log_likelihood,
            weighted_points=weighted.points,
            weights=np.exp(weighted.log_weights),
            effective_sample_size=weighted.effective_sample_size,
        )

    @classmethod
    def of_cloud(cls, cloud: TmcmcResult) -> Self:
        """The particles of a TMCMC run, which have equal weight already."""
        n = len(cloud.particles)
        return cls(
            points=cloud.particles,
            log_likelihood=cloud.log_likelihood,
            weighted_points=cloud.particles,
            weights=np.full(n, 1.0 / n),
            effective_sample_size=min(cloud.stages[-1].effective_sample_size, float(n)),
        )

    def with_points(self, moved: Callable[[Floats], Floats]) -> Self:
        """The same draws at points of another cube."""
        return replace(self, points=moved(self.points), weighted_points=moved(self.weighted_points))


def build_result(
    posterior: Posterior,
    modes: Sequence[Mode],
    draws: Draws,
    noise_sd: Floats,
    *,
    method: str,
    asked: str,
    seed: int,
    name: str,
    assumptions: Sequence[str],
    checks: tuple[Check, ...],
    discretisation: Discretisation | None,
    stages: tuple[StageFacts, ...],
    evidences: Mapping[str, tuple[float, float]],
    elapsed: Callable[[], float],
    rng: np.random.Generator,
) -> Result:
    """Assemble arrays and facts of a finished run; ``noise_sd``, ``(n_draws, n_blocks)``, of the draws."""
    record, model = posterior.record, posterior.model
    parameters = _parameter_facts(posterior, draws)
    chosen = evenly(len(draws.points), N_DRAWS)
    values = posterior.split(draws.points[chosen])[0]
    truth = true_histories(model, record)
    responses = summarised(posterior.engine, model, record, chosen, values, noise_sd[chosen], rng)
    tree = posterior_tree(posterior, draws.points, draws.log_likelihood, noise_sd, responses, truth, rng)
    none = (math.nan, math.nan)
    log_evidence, log_evidence_se = evidences.get("tmcmc (bridge)" if method == "tmcmc" else method, none)
    facts = Facts(
        method=method,
        model=name,
        record=record.name,
        engine=posterior.engine.name,
        seed=seed,
        parameters=parameters,
        log_evidence=log_evidence,
        log_evidence_se=log_evidence_se,
        nrmse=fit_error(record, responses.signals),
        noise_sd=dict(zip(labels(record), np.mean(noise_sd, axis=0).tolist(), strict=True)),
        n_solves=posterior.solves.total,
        n_stages=len(stages),
        elapsed_s=elapsed(),
        effective_sample_size=draws.effective_sample_size,
        storeys=model.n_links,
        verdict=_verdict(parameters, checks, method, asked, posterior),
        identifiability=describe(
            modes[0].information, posterior.space.names, [p.name for p in parameters if p.flag == "prior-bound"]
        ),
        checks=checks,
        stages=stages,
        equations=tuple(Equation(caption=e.caption, mathml=e.mathml) for e in structure_equations(model, record)),
        assumptions=(*assumptions, *model.warnings, posterior.noise.describe(), *conventions(model)),
        discretisation=discretisation.as_mapping() if discretisation else {"scheme": posterior.engine.scheme},
        restoring_force=force_agreement(responses.bands["restoring_force"][0], truth),
        evidences=evidences,
        provenance=provenance_of(record, seed, posterior.engine),
    )
    return Result(tree=tree, facts=facts)


def observe(engine: Engine, model: Structure, values: Floats, record: Record) -> dict[str, Floats]:
    """Every observable history ``(n_draws, n_storeys, n_times)`` by kind; of a base that can move, one row."""
    return _by_kind(model, engine.simulate(model, values, record, _histories(model)).values)


def _histories(model: Structure) -> list[str]:
    return [name for names in observable(model).values() for name in names]


def _by_kind(model: Structure, values: Floats) -> dict[str, Floats]:
    """Histories ``(n_draws, n_histories, n_times)`` parted into their kinds."""
    kinds = observable(model)
    ends = np.cumsum([len(names) for names in kinds.values()])
    return dict(zip(kinds, np.split(values, ends[:-1], axis=1), strict=True))


def predicted_channels(model: Structure, record: Record, rows: Mapping[str, Floats]) -> Floats:
    """Measured channels ``(n_draws, n_channels, n_times)`` from histories already solved."""
    own = {**rows}
    # Links that carry no floor have a row all the same, which no channel reads.
    none = np.zeros((*rows["drift"].shape[:-2], model.n_links - rows["acceleration"].shape[-2], record.n_times))
    own["acceleration"] = np.concatenate([rows["acceleration"], none], axis=-2)
    return channel_map(model, tuple(record.channels)).apply(
        np.concatenate(list(own.values()), axis=1), record.excitation
    )


def true_histories(model: Structure, record: Record) -> dict[str, Floats] | None:
    """The noise-free response at the true parameters, solved by the reference engine.

    None where the record states no truth, or that of another model: with fewer parameters, or with an effect more.
    """
    if not record.truth or set(record.truth) != set(model.space.names):
        return None
    draws = model.draws({name: record.truth[name] for name in model.space.names})
    return _by_kind(model, exact_response(model, draws, record, _histories(model)).values)


def _parameter_facts(posterior: Posterior, draws: Draws) -> tuple[ParameterFacts, ...]:
    # A draw that fell outside the prior has no weight, and no value either.
    within = draws.weights > 0.0
    values, weights = posterior.space.from_unit(draws.weighted_points[within]), draws.weights[within]
    equal = posterior.space.from_unit(draws.points)
    facts = []
    for i, parameter in enumerate(posterior.space.parameters):
        mean = float(weights @ values[:, i])
        variance = float(weights @ np.square(values[:, i] - mean))
        facts.append(
            ParameterFacts(
                name=parameter.name,
                symbol=parameter.symbol,
                unit=parameter.unit,
                prior=str(parameter.prior),
                mean=mean,
                sd=float(np.sqrt(variance)),
                hdi90=densest_interval(equal[:, i], parameter.prior.support),
                true=posterior.record.truth.get(parameter.name),
                flag=flag(draws.points[:, i]),
            )
        )
    return tuple(facts)


def densest_interval(draws: Floats, support: tuple[float, float]) -> tuple[float, float]:
    """Shortest interval that holds 90 % of the draws ``(n,)``; where it reaches a bound of their support, up to it.

    Where the density is highest at a bound the interval belongs there, but every draw lies a little inside.
    """
    from arviz_stats.base import array_stats  # it inspects the whole stack when imported: dear inside other imports

    low, high = map(float, array_stats.hdi(draws, prob=0.9))
    near = _NEAR_A_BOUND * (high - low)
    if low <= np.min(draws) < support[0] + near:
        low = support[0]
    if high >= np.max(draws) > support[1] - near:
        high = support[1]
    return low, high


def fit_error(record: Record, signals: Floats) -> dict[str, float]:
    """Rms of measured minus mean predicted channels ``(n_channels, n_times)`` over the measured rms, by block."""
    shares = mean_squares(record, record.measured - signals) / mean_squares(record, record.measured)
    return dict(zip(labels(record), np.sqrt(shares).tolist(), strict=True))


def force_agreement(found: Floats | Singles, truth: Mapping[str, Floats] | None) -> dict[str, dict[str, float]]:
    """Mean restoring force ``(n_storeys, n_times)`` against the noise-free truth, in time and along the drift path."""
    if truth is None:
        return {}
    result = {}
    for i in range(len(found)):
        true, drift = truth["restoring_force"][0, i], truth["drift"][0, i]
        result[str(i + 1)] = {
            "nrmse": float(np.sqrt(np.mean(np.square(found[i] - true)) / np.mean(np.square(true)))),
            "correlation_time": float(np.corrcoef(found[i], true)[0, 1]),
            "correlation_drift": path_correlation(found[i], true, drift),
        }
    return result


def path_correlation(found: Floats, true: Floats, drift: Floats) -> float:
    """R-x: correlation of two force histories ``(n_times,)`` at equal steps of the travelled drift path.

    Both are resampled on a common grid of as many points along the accumulated absolute drift of the truth, so that
    every stretch of the loop counts by its length, not by the time spent on it.
    """
    path = path_of(drift)
    grid = np.linspace(0.0, path[-1], len(path))
    return float(np.corrcoef(np.interp(grid, path, found), np.interp(grid, path, true))[0, 1])


def _verdict(
    parameters: Sequence[ParameterFacts], checks: Sequence[Check], method: str, asked: str, posterior: Posterior
) -> tuple[str, str]:
    record, has_force = posterior.record, posterior.noise.correlation is not None
    seen = [p for p in parameters if p.flag != "unidentified"]
    failed = [check for check in checks if not check.passed]
    model_fits = not any(check.name.startswith("residual") for check in failed)
    doubted = [check.sentence for check in failed if check.name in DOUBTS] if model_fits else []
    if model_fits:
        failed = [check for check in failed if check.name not in DOUBTS]
    scope = f"{len(record.channels)} channel{'s' if len(record.channels) != 1 else ''} of {record.name}"
    first = f"{len(seen)} of {len(parameters)} parameters are identified from {scope}"
    bound = sum(p.flag == "prior-bound" for p in seen)
    first += f" ({bound} of them cut by a bound of the prior)" if bound else ""
    first += (
        ", and the model explains the record down to its noise, yet doubtfully: another mechanism may do so equally, "
        f"and the parameters hold only without it. {' '.join(doubted)}"
        if doubted
        else ", and the model explains the record down to its noise, though another mechanism may do so equally."
        if model_fits
        else ", but the model does not explain the record: what is left is not white noise, and "
        f"{_WITH_FORCE if has_force else _WITHOUT_FORCE}"
    )
    road = title_of(method)
    if method != asked:
        beyond = [check.sentence for check in failed if check.name == DOUBTS[1]]
        second = " ".join([_taken_over(checks, road), *beyond])
    elif failed:
        second = f"Read it with care: {' '.join(check.sentence for check in failed)}"
    elif doubted:
        second = f"The posterior comes from {road} and passed all checks of the sampling."
    else:
        second = f"The posterior comes from {road} and passed all {len(checks)} of its checks."
    return first, second


def _taken_over(checks: Sequence[Check], road: str) -> str:
    """Why another method took over, and how good it is: its checks follow those of importance sampling."""
    names = [check.name for check in checks]
    why, own = checks[names.index("Pareto k")], checks[names.index("effective draws") + 1 :]
    said = " ".join(check.sentence for check in own)
    held = "passed its own checks" if all(check.passed for check in own) else "fails its own checks, read it with care"
    return (
        f"Importance sampling failed its own check (Pareto shape {why.value:.2f}, {why.limit:g} at most), so {road} "
        f"took over; it {held}: {said}"
    )


def conventions(model: Structure) -> tuple[str, ...]:
    """What every identification of a model takes for granted, in sentences."""
    lines = ["Energy is the work on the hysteretic spring in joules; delta_nu, delta_eta and delta_s are per joule."]
    if not model.is_driven:
        start = "in the state that its parameters say" if model.law.initial else "at rest"
        lines.append(f"The structure starts {start}; the ground acceleration is linear between samples.")
        lines.append(
            "R-t is the correlation of the storey force histories; R-x is taken at equal steps of the travelled drift."
        )
    conditions = sorted({constraint.text for constraint in model.space.constraints})
    if conditions:
        lines.append(
            f"The prior is normalised over the admissible region ({'; '.join(conditions)}) by a Sobol quadrature: "
            f"log mass {model.space.log_admissible_mass:.4f}."
        )
    return tuple(lines)


def provenance_of(record: Record, seed: int, engine: Engine) -> dict[str, str]:
    """Seed, data hash, versions and processor of a run: label to text."""
    versions = ", ".join(f"{name} {version_of(name)}" for name in _LIBRARIES)
    return {
        "seed": str(seed),
        "data hash (SHA-256)": record.content_hash,
        "engine": f"{engine.name}: {engine.scheme}",
        "python": platform.python_version(),
        "versions": versions,
        "processor": processor_name(),
        **{f"record: {key}": value for key, value in record.provenance.items()},
    }


def processor_name() -> str:
    """The processor as the operating system names it."""
    try:
        with Path("/proc/cpuinfo").open(encoding="utf-8") as lines:
            for line in lines:
                if line.startswith("model name"):
                    return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
