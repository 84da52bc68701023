"""The evidence of a fitted model, under its own account of the errors: white or autoregressive.

Orders of autoregression are chosen by evidence, in turns with an optimum of the very likelihood that they make.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from bwbn_bayes.inference.correlation import Correlation, autoregression, order_cost
from bwbn_bayes.inference.identifiability import PRIOR_PRECISION, covariance_of
from bwbn_bayes.inference.importance import PARETO_LIMIT, laplace_mixture
from bwbn_bayes.inference.laplace import laplace_log_evidence
from bwbn_bayes.inference.likelihood import Linearisation, Noise, Posterior
from bwbn_bayes.inference.modes import Mode, distinct, outlook, polish
from bwbn_bayes.inference.pooled import sample_learning
from bwbn_bayes.inference.residuals import residual_of
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.blocks import by_block, counts, mean_squares
from bwbn_bayes.records.record import Record

LAPLACE_SE = 2.0
"""Error allowed for Laplace's approximation where it was not checked by sampling. [nat]"""
_MOST_DRAWS = 30
"""For each effective one."""
_N_POLISHED, _N_ITERATIONS, _N_TURNS = 6, 30, 2
_REACH = 20.0
"""Starts further below the best do not keep it waiting. [nat]"""


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """How much a model is worth.

    Attributes
    ----------
    log_likelihood : float
        At its best fit.
    log_evidence, log_evidence_se : float
        Under the noise of ``posterior``. [nat]
    method : {"Laplace", "importance"}
        Where that came from.
    pareto_k : float or None
        Tail of the importance weights.
    means, sds : mapping of str to float
        Posterior moments of the parameters.
    posterior : Posterior
        Under the account of the errors that it stands for.
    modes : tuple of Mode
        Optima of that, best first.
    """

    log_likelihood: float
    log_evidence: float
    log_evidence_se: float
    means: Mapping[str, float]
    sds: Mapping[str, float]
    posterior: Posterior
    modes: tuple[Mode, ...]
    method: Literal["Laplace", "importance"] = "Laplace"
    pareto_k: float | None = None

    @property
    def correlation(self) -> Correlation | None:
        """Of the errors, None where they are white."""
        return self.posterior.noise.correlation


def laplace(posterior: Posterior, modes: tuple[Mode, ...]) -> Evidence:
    """Laplace's approximation at the optima."""
    best = modes[0]
    values = posterior.space.from_unit(best.point[None])
    sds = np.sqrt(np.diag(covariance_of(best.information))) * posterior.space.unit_scale(values)[0]
    return Evidence(
        log_likelihood=best.log_likelihood,
        log_evidence=laplace_log_evidence(_apart(modes), posterior.standard) - posterior.space.log_admissible_mass,
        log_evidence_se=LAPLACE_SE,
        means=dict(zip(posterior.space.names, values[0].tolist(), strict=True)),
        sds=dict(zip(posterior.space.names, sds.tolist(), strict=True)),
        posterior=posterior,
        modes=modes,
    )


def _apart(modes: tuple[Mode, ...]) -> tuple[Mode, ...]:
    """Modes whose normal approximations hardly overlap: along a ridge many optima are one mass, not many.

    In d dimensions a normal's mass lies about the root of d away from its centre.
    """
    kept: list[Mode] = []
    for mode in modes:
        d = len(mode.point)
        if all(_length(mode, one) > 4.0 * d for one in kept):
            kept.append(mode)
    return tuple(kept)


def _length(mode: Mode, other: Mode) -> float:
    """Squared distance between two modes in standard deviations of the second."""
    step = mode.point - other.point
    return float(step @ other.information @ step + PRIOR_PRECISION * step @ step)


def sampled(evidence: Evidence, rng: np.random.Generator, n: int) -> Evidence:
    """The same importance-sampled with ``n`` effective draws; as it is where so many are not to be had.

    Fewer, where the posterior is bent, come from one part of it: their evidence was up to 1.8 nats too low, with a tail
    that looked light.
    """
    posterior = evidence.posterior
    most = _MOST_DRAWS * n
    weighted = sample_learning(posterior, laplace_mixture(evidence.modes), rng, effective=n, most=most)
    if weighted.effective_sample_size < n or not weighted.pareto_k <= PARETO_LIMIT:
        return evidence
    values, weights = posterior.space.from_unit(weighted.points), np.exp(weighted.log_weights)
    means = weights @ values
    sds = np.sqrt(weights @ np.square(values - means))
    return replace(
        evidence,
        log_evidence=weighted.log_evidence,
        log_evidence_se=weighted.log_evidence_se,
        pareto_k=weighted.pareto_k,
        method="importance",
        means=dict(zip(posterior.space.names, means.tolist(), strict=True)),
        sds=dict(zip(posterior.space.names, sds.tolist(), strict=True)),
    )


def autoregressive_bound(posterior: Posterior, modes: tuple[Mode, ...]) -> float:
    """What autoregressive errors add to the log likelihood at least, in nat: at the optimum for white ones."""
    record, residual = posterior.record, residual_of(posterior, modes[0].point)
    correlation = _autoregressive(record, residual)
    noise = _under(posterior, correlation).noise
    n_times, none = counts(record), np.empty((1, 0))
    rows = residual, correlation.whitened(residual)
    white, coloured = ((mean_squares(record, own) * n_times)[None] for own in rows)
    gained = noise.log_likelihood(coloured, n_times, none) - posterior.noise.log_likelihood(white, n_times, none)
    return float(gained[0])


def autoregressive_outlook(posterior: Posterior, modes: tuple[Mode, ...]) -> float:
    """What autoregressive errors may add to the evidence at most, in nat: by the expansion at that optimum."""
    best = modes[0]
    view = _under(posterior, _autoregressive(posterior.record, residual_of(posterior, best.point)))
    return float(outlook(view, best.point[None], view.linearise(best.point[None]))[0] - best.log_likelihood)


def autoregressive(posterior: Posterior, modes: tuple[Mode, ...]) -> Evidence:
    """Evidence under autoregressive errors, each block's order by evidence."""
    return _in_turns(posterior, modes, partial(_autoregressive, posterior.record))


def _autoregressive(record: Record, residual: Floats) -> Correlation:
    """That which leaves of a residual ``(n_channels, n_times)`` the least."""
    rests = by_block(record, residual)
    coefficients = tuple(autoregression(own)[0] for own in rests)
    cost = sum(order_cost(len(own), len(rest)) for own, rest in zip(coefficients, rests, strict=True))
    return Correlation(coefficients=coefficients, blocks=record.blocks, log_prior=cost)


def _under(posterior: Posterior, correlation: Correlation) -> Posterior:
    return posterior.with_noise(replace(posterior.noise, correlation=correlation))  # type: ignore[type-var]


def recounted(posterior: Posterior, modes: tuple[Mode, ...], noise: Noise) -> Evidence:
    """Laplace's evidence under white errors whose samples count otherwise."""
    view, points = posterior.with_noise(noise), _points(modes)
    if len(view.record.blocks) == 1:  # least squares whatever they count for
        return laplace(view, distinct(points, view.linearise(points)))
    return laplace(view, distinct(*_refitted(view, points)))


def _points(modes: tuple[Mode, ...]) -> Floats:
    return np.array([mode.point for mode in modes[:_N_POLISHED]])


def _in_turns(posterior: Posterior, modes: tuple[Mode, ...], account: Callable[[Floats], Correlation]) -> Evidence:
    """Laplace's evidence where account and optimum agree."""
    points, view = _points(modes), posterior
    for _ in range(_N_TURNS):
        view = _under(posterior, account(residual_of(posterior, points[0])))
        points, local = _refitted(view, points)
    return laplace(view, distinct(points, local))


def _refitted(view: Posterior, points: Floats) -> tuple[Floats, Linearisation]:
    """The optima that points lead to, best first, and the expansions there."""
    points, local = polish(view, points, n_iterations=_N_ITERATIONS, reach=_REACH)
    order = np.argsort(-local.log_likelihood, kind="stable")[:_N_POLISHED]
    return points[order], local[order]
