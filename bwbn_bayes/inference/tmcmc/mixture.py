"""A Gaussian mixture fitted to a weighted cloud: the shape from which the moves take their scales.

It lives in the unbounded coordinates of :mod:`bwbn_bayes.inference.tmcmc.coordinates`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import logsumexp

from bwbn_bayes.inference.tmcmc.target import Floats, Integers

_LARGER_SIZES = (2, 4)
_WORTHWHILE_GAIN = 0.02
_ITERATIONS = 10
_RIDGE = 1e-9


class GaussianMixture(NamedTuple):
    """Weights ``(k,)``, means ``(k, d)``, lower Cholesky factors ``(k, d, d)`` of the covariances, their inverses."""

    weights: Floats
    means: Floats
    factors: Floats
    inverses: Floats

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draw ``(n, d)`` points."""
        labels = self.labels(rng, n)
        noise = rng.standard_normal((n, self.means.shape[1]))
        return self.means[labels] + np.einsum("nij,nj->ni", self.factors[labels], noise)

    def labels(self, rng: np.random.Generator, n: int) -> Integers:
        """Draw ``(n,)`` component indices."""
        return rng.choice(len(self.weights), size=n, p=self.weights)

    def log_density(self, points: Floats) -> Floats:
        """Log density ``(n,)`` at points ``(n, d)``."""
        return np.asarray(logsumexp(self.log_parts(points), axis=0))

    def log_parts(self, points: Floats) -> Floats:
        """Log of each component's weighted density, ``(k, n)``."""
        log_scales = np.log(np.diagonal(self.inverses, axis1=1, axis2=2)).sum(axis=1) + np.log(self.weights)
        parts = np.empty((len(self.weights), len(points)))
        for part, log_scale, mean, inverse in zip(parts, log_scales, self.means, self.inverses, strict=True):
            whitened = (points - mean) @ inverse.T
            part[:] = log_scale - 0.5 * np.einsum("ni,ni->n", whitened, whitened)
        return parts - 0.5 * points.shape[1] * np.log(2.0 * np.pi)

    def inflated(self, factor: float) -> GaussianMixture:
        """The same mixture with every standard deviation multiplied by ``factor``."""
        return self._replace(factors=self.factors * factor, inverses=self.inverses / factor)


def fit_mixture(points: Floats, weights: Floats, held_out: Floats, held_out_weights: Floats) -> GaussianMixture:
    """Fit mixtures of one, two and four Gaussians, as long as each predicts the held-out points better than the last.

    Parameters
    ----------
    points, held_out : (n, d), (m, d) arrays
        Points to fit and points to judge by.
    weights, held_out_weights : (n,), (m,) arrays
        Their weights, each summing to one.

    Returns
    -------
    GaussianMixture
        The fit.
    """
    best = fit_gaussian(points, weights)
    best_score = float(held_out_weights @ best.log_density(held_out))
    for size in _LARGER_SIZES:
        fit = _expectation_maximisation(points, weights, size)
        score = float(held_out_weights @ fit.log_density(held_out))
        if score < best_score + _WORTHWHILE_GAIN:
            break
        best, best_score = fit, score
    return best


def fit_gaussian(points: Floats, weights: Floats) -> GaussianMixture:
    """The one Gaussian with the moments of points ``(n, d)`` of weights ``(n,)`` that sum to one."""
    return _expectation_maximisation(points, weights, 1)


def _expectation_maximisation(points: Floats, weights: Floats, size: int) -> GaussianMixture:
    """Fit ``size`` components, starting from slices along the principal axis; starved components are dropped."""
    n, n_dim = points.shape
    centred = points - weights @ points
    covariance = centred.T @ (centred * weights[:, None])
    along = centred @ np.linalg.eigh(covariance)[1][:, -1]
    ranks = np.empty(n, dtype=np.int64)
    ranks[np.argsort(along, kind="stable")] = np.arange(n)
    shares = np.eye(size)[ranks * size // n].T * weights
    mixture = _maximise(points, shares, covariance)
    for _ in range(_ITERATIONS if size > 1 else 0):
        log_parts = mixture.log_parts(points)
        shares = np.exp(log_parts - logsumexp(log_parts, axis=0)) * weights
        effective = np.sum(shares, axis=1) ** 2 / np.sum(shares**2, axis=1).clip(min=1e-300)
        kept = effective > 2.0 * (n_dim + 1)
        if not np.any(kept):
            break
        mixture = _maximise(points, shares[kept], covariance)
    return mixture


def _maximise(points: Floats, shares: Floats, covariance: Floats) -> GaussianMixture:
    """Weighted moments of each component; ``shares (k, n)`` are responsibilities times weights."""
    mass = np.sum(shares, axis=1)
    means = shares @ points / mass[:, None]
    ridge = _RIDGE * np.diag(np.diag(covariance)) + np.eye(points.shape[1]) * 1e-300
    factors = np.empty((len(mass), *covariance.shape))
    for factor, share, total, mean in zip(factors, shares, mass, means, strict=True):
        centred = points - mean
        factor[:] = np.linalg.cholesky(centred.T @ (centred * share[:, None]) / total + ridge)
    identity = np.eye(points.shape[1])
    inverses = np.stack([solve_triangular(factor, identity, lower=True) for factor in factors])
    return GaussianMixture(mass / np.sum(mass), means, factors, inverses)
