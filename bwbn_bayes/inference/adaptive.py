"""A proposal that learns the posterior's shape: mixtures fitted to weighted draws, round by round.

In probit coordinates the prior is a standard normal, so that a direction the data do not see looks Gaussian, bounds
and all. Each round draws from the proposal, tempers the weights until enough draws count, and fits a mixture to them.

References
----------
.. [1] O. Cappé et al., "Adaptive importance sampling in general mixture classes", Statistics and Computing 18, 2008,
   doi:10.1007/s11222-008-9059-x.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import logsumexp, ndtr, ndtri

from bwbn_bayes.inference.importance import Mixture, Proposal, effective_draws, log_ratios, pareto_smoothed
from bwbn_bayes.inference.tmcmc.mixture import GaussianMixture, fit_mixture
from bwbn_bayes.inference.tmcmc.target import Target
from bwbn_bayes.parameters import Floats

N_ROUNDS = 8
N_PER_ROUND = 1600
_ENOUGH = 0.35
"""Share of effective draws at which adapting stops, if the weights' tail is light too."""
_LIGHT = 0.4
"""Pareto shape of a light tail. Rare large weights do not show in the effective size of one round: without this bound
adapting stopped early, and the evidence of a bent posterior was up to seven standard errors low."""
_COUNTED = 8.0
"""Tempered weights count at least this many draws per dimension."""
_INFLATIONS = (1.2, 1.8, 3.0)
"""Of the fitted mixture's standard deviations."""
_EDGE = 1e-12
_SIZES = (1, 2, 4, 8, 16)


@dataclass(frozen=True, kw_only=True)
class ProbitMixture:
    """A Gaussian mixture in probit coordinates, seen on the unit cube."""

    mixture: GaussianMixture

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draws ``(n, n_dim)``."""
        return np.asarray(np.clip(ndtr(self.mixture.sample(rng, n)), _EDGE, 1.0 - _EDGE))

    def log_density(self, points: Floats) -> Floats:
        """Normalised log density ``(n,)``."""
        z = ndtri(np.clip(points, _EDGE, 1.0 - _EDGE))
        jacobian = 0.5 * np.sum(np.square(z), axis=1) + 0.5 * points.shape[1] * np.log(2.0 * np.pi)
        return np.asarray(self.mixture.log_density(z) + jacobian)


def adapt(target: Target, start: Proposal, rng: np.random.Generator) -> Proposal:
    """Learn a proposal for a target on the unit cube, beginning with one that need not cover it well.

    Parameters
    ----------
    target : Target
        Posterior on the unit cube.
    start : Proposal
        Where the first draws come from; it keeps a small share of every later proposal.
    rng : numpy.random.Generator
        Random stream.
    """
    proposals: list[Proposal] = [start]
    points = np.empty((0, target.n_dim))
    log_target = np.empty(0)
    for _ in range(N_ROUNDS):
        new = proposals[-1].sample(rng, N_PER_ROUND)
        _, log_ratio = log_ratios(target, proposals[-1], new)
        if effective_draws(log_ratio) > _ENOUGH * len(new) and pareto_smoothed(log_ratio)[1] < _LIGHT:
            break
        points = np.concatenate([points, new])
        log_target = np.concatenate([log_target, log_ratio + proposals[-1].log_density(new)])
        inside = np.isfinite(log_target)
        if np.count_nonzero(inside) < 4 * target.n_dim:
            break
        log_mixture = logsumexp([proposal.log_density(points[inside]) for proposal in proposals], axis=0)
        weights = _tempered(log_target[inside] - log_mixture, _COUNTED * target.n_dim)
        size = 1.0 / float(np.sum(np.square(weights)))
        fit = fit_mixture(ndtri(np.clip(points[inside], _EDGE, 1.0 - _EDGE)), weights, size, sizes=_SIZES)
        proposals.append(
            Mixture(
                weights=(0.6, 0.2, 0.15, 0.05),
                components=(*(ProbitMixture(mixture=fit.inflated(factor)) for factor in _INFLATIONS), start),
            )
        )
    return proposals[-1]


def _tempered(log_ratio: Floats, enough: float) -> Floats:
    """Normalised weights to the largest power, at most one, at which enough draws count."""

    def short(power: float) -> float:
        return effective_draws(power * log_ratio) - enough

    power = 1.0 if short(1.0) >= 0.0 else float(brentq(short, 1e-12, 1.0))
    return np.asarray(np.exp(power * log_ratio - logsumexp(power * log_ratio)))
