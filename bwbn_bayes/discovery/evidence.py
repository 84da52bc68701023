"""The evidence of a fitted hypothesis: Laplace for all, sampling for those that matter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.stats import cauchy

from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.discovery.race import Fit
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.bridge import bridge, contributing
from bwbn_bayes.inference.identifiability import covariance_of
from bwbn_bayes.inference.importance import (
    PARETO_LIMIT,
    WeightedDraws,
    laplace_log_evidence,
    laplace_mixture,
    sample_importance,
)
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.residuals import coloured_noise, counted, residual_of
from bwbn_bayes.parameters import Floats

PRIOR_WIDTHS: Mapping[str, float] = {"ten times narrower": 0.1, "ten times wider": 10.0}
"""Under these the name must survive: Cauchy priors about neutral, so many times as wide as the normal ones."""
_LAPLACE_SE = 2.0
"""Error allowed for Laplace's approximation where it was not checked by sampling. [nat]"""


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """How much a hypothesis is worth.

    Attributes
    ----------
    log_likelihood : float
        At its best fit.
    log_evidence, log_evidence_se : float
        For white noise.
    method : {"Laplace", "importance", "TMCMC"}
        Where that came from.
    pareto_k : float or None
        Tail of the importance weights.
    coloured_gain : float
        What autoregressive noise would add at the best fit. [nat]
    means, sds : mapping of str to float
        Posterior moments of the parameters.
    prior_shifts : mapping of str to float
        Change of the log evidence under other widths of the effect's priors. [nat]
    """

    log_likelihood: float
    log_evidence: float
    log_evidence_se: float
    pareto_k: float | None
    coloured_gain: float
    means: Mapping[str, float]
    sds: Mapping[str, float]
    prior_shifts: Mapping[str, float]
    method: Literal["Laplace", "importance", "TMCMC"] = "Laplace"

    @property
    def total(self) -> float:
        """Log evidence under the better account of the noise, white or autoregressive."""
        return self.log_evidence + self.coloured_gain


def laplace_evidence(fit: Fit) -> Evidence:
    """Laplace's approximation at a fit's optima."""
    return _at_modes(fit.posterior, fit.modes, fit.hypothesis)


def present_evidence(present: Posterior, modes: tuple[Mode, ...], rng: np.random.Generator, n: int) -> Evidence:
    """Evidence of the present model, sampled."""
    return _sampled(present, modes, _at_modes(present, modes, None), None, rng, n)


def sampled_evidence(fit: Fit, laplace: Evidence, rng: np.random.Generator, n: int) -> Evidence:
    """Importance-sampled evidence of a fit; Laplace's stays where the weights have no usable tail."""
    return _sampled(fit.posterior, fit.modes, laplace, fit.hypothesis, rng, n)


def bridged_evidence(fit: Fit, laplace: Evidence, rng: np.random.Generator, n: int) -> Evidence:
    """Evidence of a fit by transitional MCMC with ``n`` particles, where importance weights have no usable tail.

    With several modes it would take minutes: Laplace's stays; so it does where hardly a draw of Laplace's own
    approximation can be solved.
    """
    if len(contributing(fit.modes)) > 1:
        return laplace
    try:
        cloud = bridge(fit.posterior, fit.modes, n_particles=n, rng_seed=int(rng.integers(2**31)))
    except UserError:
        return laplace
    return replace(
        _with_draws(fit.posterior, laplace, fit.hypothesis, cloud.particles, np.full(n, 1.0 / n)),
        log_evidence=cloud.log_evidence,
        log_evidence_se=cloud.log_evidence_se,
        method="TMCMC",
    )


def _at_modes(posterior: Posterior, modes: tuple[Mode, ...], hypothesis: Hypothesis | None) -> Evidence:
    best = modes[0]
    values = posterior.space.from_unit(best.point[None])
    sds = np.sqrt(np.diag(covariance_of(best.information))) * posterior.space.unit_scale(values)[0]
    gain = sum(coloured_noise(rest).gain for rest in counted(posterior.record, residual_of(posterior, best.point)))
    return Evidence(
        log_likelihood=best.log_likelihood,
        log_evidence=laplace_log_evidence(modes) - posterior.space.log_admissible_mass,
        log_evidence_se=_LAPLACE_SE,
        pareto_k=None,
        coloured_gain=gain,
        means=dict(zip(posterior.space.names, values[0].tolist(), strict=True)),
        sds=dict(zip(posterior.space.names, sds.tolist(), strict=True)),
        prior_shifts=_prior_shifts(posterior, hypothesis, best.point[None], np.ones(1)),
    )


def _sampled(
    posterior: Posterior,
    modes: tuple[Mode, ...],
    laplace: Evidence,
    hypothesis: Hypothesis | None,
    rng: np.random.Generator,
    n: int,
) -> Evidence:
    weighted: WeightedDraws = sample_importance(posterior, laplace_mixture(modes), rng, effective=n, most=3 * n)
    if not weighted.pareto_k <= PARETO_LIMIT:
        return laplace
    return replace(
        _with_draws(posterior, laplace, hypothesis, weighted.points, np.exp(weighted.log_weights)),
        log_evidence=weighted.log_evidence,
        log_evidence_se=weighted.log_evidence_se,
        pareto_k=weighted.pareto_k,
        method="importance",
    )


def _with_draws(
    posterior: Posterior, laplace: Evidence, hypothesis: Hypothesis | None, points: Floats, weights: Floats
) -> Evidence:
    """The same with moments and prior shifts from weighted points of the unit cube."""
    values = posterior.space.from_unit(points)
    means = weights @ values
    sds = np.sqrt(weights @ np.square(values - means))
    return replace(
        laplace,
        means=dict(zip(posterior.space.names, means.tolist(), strict=True)),
        sds=dict(zip(posterior.space.names, sds.tolist(), strict=True)),
        prior_shifts=_prior_shifts(posterior, hypothesis, points, weights),
    )


def _prior_shifts(
    posterior: Posterior, hypothesis: Hypothesis | None, points: Floats, weights: Floats
) -> dict[str, float]:
    """Log ratio of evidences when the amplitudes' priors become Cauchy and wider or narrower."""
    shifts = dict.fromkeys(PRIOR_WIDTHS, 0.0)
    if hypothesis is None:
        return shifts
    values = posterior.space.from_unit(points)
    for label, factor in PRIOR_WIDTHS.items():
        change = np.zeros(len(points))
        for name in hypothesis.amplitudes:
            column = posterior.space.names.index(name)
            prior = posterior.space.parameters[column].prior
            neutral = hypothesis.neutral(name)
            other = cauchy(loc=neutral, scale=factor * prior.sd)
            low, high = prior.support
            share = other.cdf(high) - other.cdf(low)
            change += other.logpdf(values[:, column]) - np.log(share) - prior.log_density(values[:, column])
        shifts[label] = float(np.log(weights @ np.exp(np.clip(change, -700.0, 700.0))))
    return shifts
