"""A Gaussian mixture fitted to a weighted cloud: the shape from which the moves take their scales.

It lives in the unbounded coordinates of :mod:`bwbn_bayes.inference.tmcmc.coordinates`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from bwbn_bayes.inference.tmcmc.target import Floats, Integers
from bwbn_bayes.parameters import Booleans

SIZES = (1, 2, 4)
_ITERATIONS = 10
_RIDGE = 1e-9


def drawn(weights: Floats, rng: np.random.Generator, n: int) -> Integers:
    """Draw ``(n,)`` indices with probabilities ``(k,)``.

    They are those of ``rng.choice``, which checks the probabilities at every call: more time than the draw takes.
    """
    levels: Floats = weights.cumsum()
    indices: Integers = (levels / levels[-1]).searchsorted(rng.random(n), side="right")
    return indices


@dataclass(frozen=True)
class GaussianMixture:
    """Weights ``(k,)``, means ``(k, d)``, lower Cholesky factors ``(k, d, d)`` of the covariances, their inverses."""

    weights: Floats
    means: Floats
    factors: Floats
    inverses: Floats

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draw ``(n, d)`` points."""
        labels = self.labels(rng, n)
        noise = rng.standard_normal((n, self.means.shape[1]))
        points: Floats = self.means[labels] + np.einsum("nij,nj->ni", self.factors[labels], noise)
        return points

    def labels(self, rng: np.random.Generator, n: int) -> Integers:
        """Draw ``(n,)`` component indices."""
        return drawn(self.weights, rng, n)

    def log_density(self, points: Floats) -> Floats:
        """Log density ``(n,)`` at points ``(n, d)``."""
        return np.asarray(np.logaddexp.reduce(self.log_parts(points), axis=0), dtype=np.float64)

    def log_parts(self, points: Floats) -> Floats:
        """Log of each component's weighted density, ``(k, n)``."""
        parts = np.empty((len(self.weights), len(points)))
        centred, whitened = np.empty((2, *points.shape))  # once: to be given memory takes longer than to subtract
        for part, log_peak, mean, inverse in zip(parts, self._log_peaks, self.means, self.inverses, strict=True):
            np.matmul(np.subtract(points, mean, out=centred), inverse.T, out=whitened)
            part[:] = log_peak - 0.5 * np.einsum("ni,ni->n", whitened, whitened)
        return parts

    @cached_property
    def _log_peaks(self) -> Floats:
        """Log of each component's weighted density at its mean; every step of every chain asks for it."""
        log_scales = np.log(np.diagonal(self.inverses, axis1=1, axis2=2)).sum(axis=1) + np.log(self.weights)
        log_peaks: Floats = log_scales - 0.5 * self.means.shape[1] * np.log(2.0 * np.pi)
        return log_peaks

    def inflated(self, factor: float) -> GaussianMixture:
        """The same mixture with every standard deviation multiplied by ``factor``."""
        return replace(self, factors=self.factors * factor, inverses=self.inverses / factor)


def fit_mixture(
    points: Floats, weights: Floats, effective_size: float, sizes: Sequence[int] = SIZES
) -> GaussianMixture:
    """Fit mixtures of growing size, as long as each improves the Bayesian information criterion.

    The states of chains are correlated, so the criterion counts effective draws. Judging by held-out states instead
    let related chains on both sides vote for ever more components, and the sampler then fed on its own overfit.

    Parameters
    ----------
    points : (n, d) array
        Points to fit.
    weights : (n,) array
        Their weights, summing to one.
    effective_size : float
        Number of independent draws that they are worth.
    sizes : sequence of int
        Numbers of components, increasing from one.

    Returns
    -------
    GaussianMixture
        The fit.
    """
    n_dim = points.shape[1]
    best, best_score = fit_gaussian(points, weights), -np.inf
    for size in sizes:
        fit = best if size == 1 else _expectation_maximisation(points, weights, size)
        n_coefficients = len(fit.weights) * (1 + n_dim + n_dim * (n_dim + 1) // 2)
        score = float(weights @ fit.log_density(points)) - information_penalty(n_coefficients, effective_size)
        if score <= best_score:
            break
        best, best_score = fit, score
    return best


def information_penalty(n_coefficients: int, effective_size: float) -> float:
    """What a fit of so many coefficients must gain in mean log density to be believed, in nats.

    References
    ----------
    .. [1] G. Schwarz, "Estimating the Dimension of a Model", 1978, doi:10.1214/aos/1176344136.
    """
    return 0.5 * n_coefficients * float(np.log(effective_size)) / effective_size


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
    slices = np.eye(size)[ranks * size // n].T * weights
    # A slice may hold no weight at all.
    fed = slices[_are_fed(slices, n_dim)] if size > 1 else slices
    mixture = _maximise(points, fed if len(fed) else weights[None], covariance)
    for _ in range(_ITERATIONS if size > 1 else 0):
        log_parts = mixture.log_parts(points)
        shares = np.exp(log_parts - np.logaddexp.reduce(log_parts, axis=0)) * weights
        kept = _are_fed(shares, n_dim)
        if not np.any(kept):
            break
        mixture = _maximise(points, shares[kept], covariance)
    return mixture


def _are_fed(shares: Floats, n_dim: int) -> Booleans:
    """Which components ``(k,)`` have enough effective points for a covariance."""
    effective = np.sum(shares, axis=1) ** 2 / np.sum(shares**2, axis=1).clip(min=1e-300)
    return np.asarray(effective > 2.0 * (n_dim + 1))


def _maximise(points: Floats, shares: Floats, covariance: Floats) -> GaussianMixture:
    """Weighted moments of each component; ``shares (k, n)`` are responsibilities times weights."""
    mass = np.sum(shares, axis=1)
    means = shares @ points / mass[:, None]
    ridge = _RIDGE * np.diag(np.diag(covariance)) + np.eye(points.shape[1]) * 1e-300
    factors = np.empty((len(mass), *covariance.shape))
    centred, weighted = np.empty((2, *points.shape))
    for factor, share, total, mean in zip(factors, shares, mass, means, strict=True):
        np.multiply(np.subtract(points, mean, out=centred), share[:, None], out=weighted)
        factor[:] = np.linalg.cholesky(centred.T @ weighted / total + ridge)
    identity = np.eye(points.shape[1])
    inverses = np.stack([solve_triangular(factor, identity, lower=True) for factor in factors])
    return GaussianMixture(mass / np.sum(mass), means, factors, inverses)
