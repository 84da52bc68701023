"""Importance sampling from Student-t mixtures at the modes, with its own checks.

The proposal is a mixture over the modes, each component normal or Student-t with the Gauss-Newton covariance, truncated
to the unit cube with an exactly known density. Pareto-smoothed weights say whether it covers the posterior: above
k = 0.7 the result is not to be trusted, and the caller falls back to TMCMC.

References
----------
.. [1] A. Vehtari et al., "Pareto Smoothed Importance Sampling", JMLR 25, 2024, arXiv:1507.02646.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.special import logsumexp
from scipy.stats import chi2

from bwbn_bayes.inference.laplace import laplace_mass
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.tmcmc.resampling import systematic
from bwbn_bayes.inference.tmcmc.target import Target
from bwbn_bayes.inference.truncated import TruncatedStudent
from bwbn_bayes.parameters import Floats

PARETO_LIMIT = 0.7
PARETO_CLEAR = 0.6
"""Pareto shape with which drawing ends: below the limit of the check, so that stopping does not decide it."""
_LEAST_DRAWS = 30
_NEGLIGIBLE = 30.0
"""How far below the best a mode takes no part. [nat]"""
_RARE = 0.01
"""Probability of a draw of a normal posterior below which it is taken for none of it."""


def least_likely(mode: Mode) -> float:
    """Log likelihood that all draws of a posterior have but one in a hundred, were it normal about its optimum."""
    return mode.log_likelihood - 0.5 * float(chi2.isf(_RARE, len(mode.point)))


class Proposal(Protocol):
    """A normalised density on the unit cube that can be sampled."""

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draws ``(n, n_dim)``."""
        ...

    def log_density(self, points: Floats) -> Floats:
        """Normalised log density ``(n,)``."""
        ...


@dataclass(frozen=True, kw_only=True)
class Mixture:
    """Weighted mixture of proposals."""

    weights: tuple[float, ...]
    components: tuple[Proposal, ...]

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        counts = rng.multinomial(n, self.weights)
        draws = [c.sample(rng, int(k)) for c, k in zip(self.components, counts, strict=True)]
        return rng.permutation(np.concatenate(draws))

    def log_density(self, points: Floats) -> Floats:
        parts = [np.log(w) + c.log_density(points) for w, c in zip(self.weights, self.components, strict=True)]
        return np.asarray(logsumexp(parts, axis=0))


@dataclass(frozen=True, kw_only=True)
class WeightedDraws:
    """Weighted draws from a posterior.

    Attributes
    ----------
    points : (n_draws, n_dim) array
        In the unit cube.
    log_likelihood : (n_draws,) array
    log_weights : (n_draws,) array
        Pareto-smoothed and normalised.
    log_evidence, log_evidence_se : float
        From the raw weights.
    pareto_k : float
        Shape of the weights' tail.
    """

    points: Floats
    log_likelihood: Floats
    log_weights: Floats
    log_evidence: float
    log_evidence_se: float
    pareto_k: float

    @property
    def effective_sample_size(self) -> float:
        """Kish's effective number of draws; zero where none has any weight."""
        return effective_draws(self.log_weights)

    def resampled(self, rng: np.random.Generator, n: int) -> tuple[Floats, Floats]:
        """Equally weighted points and their log likelihoods by systematic resampling."""
        index = rng.permutation(systematic(np.exp(self.log_weights), n, rng))
        return self.points[index], self.log_likelihood[index]


def laplace_mixture(modes: Sequence[Mode]) -> Mixture:
    """The proposal at the modes: normal with the Gauss-Newton covariance, and a wider Student-t for the tails.

    Modes more than 30 nats below the best by Laplace's approximation of their mass are left out.
    """
    masses = np.array([laplace_mass(mode) for mode in modes])
    kept = np.flatnonzero(masses > np.max(masses) - _NEGLIGIBLE)
    shares = np.exp(masses[kept] - logsumexp(masses[kept]))
    shares = 0.9 * shares + 0.1 / len(kept)
    components: list[Proposal] = []
    weights: list[float] = []
    for share, index in zip(shares / np.sum(shares), kept, strict=True):
        mode = modes[int(index)]
        components.append(TruncatedStudent.at(mode.point, mode.gradient, mode.information, inflation=1.05))
        components.append(TruncatedStudent.at(mode.point, mode.gradient, mode.information, inflation=1.6, degrees=8.0))
        weights += [0.8 * float(share), 0.2 * float(share)]
    return Mixture(weights=tuple(weights), components=tuple(components))


def sample_importance(
    target: Target,
    proposal: Proposal,
    rng: np.random.Generator,
    *,
    effective: float = 5000.0,
    most: int = 60_000,
) -> WeightedDraws:
    """Draw until the effective sample size is reached, or a first batch shows that it never will be.

    Parameters
    ----------
    target : Target
        Posterior on the unit cube.
    proposal : Proposal
        Normalised proposal on the unit cube.
    rng : numpy.random.Generator
        Random stream.
    effective : float
        Effective draws wanted.
    most : int
        Largest number of draws.
    """
    points, log_likelihood, log_ratio = np.empty((0, target.n_dim)), np.empty(0), np.empty(0)
    batch = int(1.1 * effective) // 16 * 16 + 16
    while True:
        new = proposal.sample(rng, batch)
        value, log_target = log_targets(target, new)
        points = np.concatenate([points, new])
        log_likelihood = np.concatenate([log_likelihood, value])
        log_ratio = np.concatenate([log_ratio, log_target - proposal.log_density(new)])
        reached = effective_draws(log_ratio)
        short = effective - reached
        if short <= 0.0 or len(points) >= most or not reached >= 0.01 * len(points):
            return summarised(points, log_likelihood, log_ratio)
        batch = int(min(1.1 * short * len(points) / reached, most - len(points))) // 16 * 16 + 16


def log_targets(target: Target, points: Floats) -> tuple[Floats, Floats]:
    """Log likelihood, and with the log prior, ``(n,)`` each, at points ``(n, n_dim)``; minus infinity outside."""
    log_prior = target.log_prior(points)
    inside = np.isfinite(log_prior)
    value = np.full(len(points), -np.inf)
    value[inside] = target.log_likelihood(points[inside])
    return value, np.where(inside, value + log_prior, -np.inf)


def effective_draws(log_ratio: Floats) -> float:
    """Kish's effective number of draws behind log weights ``(n,)`` that need not be normalised."""
    if not np.any(np.isfinite(log_ratio)):
        return 0.0
    return float(np.exp(2.0 * logsumexp(log_ratio) - logsumexp(2.0 * log_ratio)))


def pareto_smoothed(log_ratio: Floats) -> tuple[Floats, float]:
    """Normalised log weights ``(n,)`` whose tail is smoothed, and the shape of that tail.

    The shape is infinite, and the weights are left as they are, where fewer draws than a tail takes have any weight, or
    all of a tail have the same: rounding makes one point of them.
    """
    finite = np.isfinite(log_ratio)
    if np.count_nonzero(finite) < _LEAST_DRAWS:
        return log_ratio - logsumexp(log_ratio) if np.any(finite) else log_ratio, np.inf
    from arviz_stats.base import array_stats  # it inspects the whole stack when imported: dear inside other imports

    # ArviZ expects the log likelihood of a left-out point, that is minus the log weight.
    try:
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            smoothed, shape = array_stats.psislw(-log_ratio[finite])
    except ValueError:  # by which ArviZ says that the tail's values are the same
        smoothed, shape = log_ratio[finite], np.inf
    if not (np.isfinite(shape) and np.all(np.isfinite(smoothed))):
        # Weights some 700 nats below the heaviest underflow. Without a first quartile of its tail ArviZ gives no shape;
        # with one that is almost zero a shape far below any limit, that of its prior, and weights that are no numbers.
        smoothed, shape = log_ratio[finite], np.inf
    log_weights = np.full(len(log_ratio), -np.inf)
    log_weights[finite] = smoothed - logsumexp(smoothed)
    return log_weights, float(shape)


def summarised(points: Floats, log_likelihood: Floats, log_ratio: Floats) -> WeightedDraws:
    """Weighted draws from points ``(n, n_dim)`` and the log ratios ``(n,)`` of posterior to proposal density."""
    n = len(log_ratio)
    log_evidence = float(logsumexp(log_ratio) - np.log(n))
    relative = np.exp(log_ratio - log_evidence) if np.isfinite(log_evidence) else np.zeros(n)
    log_weights, pareto_k = pareto_smoothed(log_ratio)
    return WeightedDraws(
        points=points,
        log_likelihood=log_likelihood,
        log_weights=log_weights,
        log_evidence=log_evidence,
        log_evidence_se=float(np.std(relative) / np.sqrt(n)),
        pareto_k=pareto_k,
    )
