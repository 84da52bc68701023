"""Posteriors on the unit cube whose evidence is known in closed form (or by a one-dimensional quadrature).

Every oracle is a :class:`bwbn_bayes.inference.tmcmc.target.Target` with its ``log_evidence``, and where they are known
the posterior mean and standard deviation of ``values(points)``, the parameters in their own units.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import integrate, special, stats

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class EvidenceOracle:
    """A target with its answer."""

    name: str
    n_dim: int
    values: Callable[[Floats], Floats]
    """Points of the unit cube ``(n, d)`` to parameters ``(n, d)``."""
    log_likelihood_of_values: Callable[[Floats], Floats]
    log_evidence: float
    posterior_mean: Floats | None = None
    posterior_sd: Floats | None = None

    def log_prior(self, points: Floats) -> Floats:
        """Zero inside the unit cube, minus infinity outside."""
        return np.where(np.all((points >= 0.0) & (points <= 1.0), axis=1), 0.0, -np.inf)

    def log_likelihood(self, points: Floats) -> Floats:
        """Log likelihood ``(n,)``."""
        return self.log_likelihood_of_values(self.values(points))

    def sample_prior(self, rng: np.random.Generator, n: int) -> Floats:
        """Uniform draws ``(n, d)``."""
        return rng.random((n, self.n_dim))


def _box(lower: float, upper: float) -> Callable[[Floats], Floats]:
    return lambda points: lower + (upper - lower) * points


def _standard_normal(points: Floats) -> Floats:
    return np.asarray(special.ndtri(points), dtype=np.float64)


def _regression(n_dim: int, n_data: int, noise_sd: float, data_seed: int) -> tuple[Floats, Floats, float]:
    """Gram matrix, least-squares estimate and residual sum of squares of a correlated random regression."""
    rng = np.random.default_rng([data_seed, n_dim, n_data])
    correlation = 0.5 ** np.abs(np.subtract.outer(np.arange(n_dim), np.arange(n_dim)))
    design = rng.standard_normal((n_data, n_dim)) @ np.linalg.cholesky(correlation).T
    truth = rng.uniform(-0.6, 0.6, n_dim)
    data = design @ truth + noise_sd * rng.standard_normal(n_data)
    gram = design.T @ design
    estimate = np.linalg.solve(gram, design.T @ data)
    return gram, estimate, float(np.sum((data - design @ estimate) ** 2))


def linear_gaussian(
    n_dim: int, n_data: int = 9000, noise_sd: float = 0.2, prior: str = "normal", data_seed: int = 1
) -> EvidenceOracle:
    """Regression with known noise; prior standard normal, or uniform in [-1, 1] with the posterior far from its ends.

    The likelihood runs over the sufficient statistics, which is exact.
    """
    gram, estimate, least = _regression(n_dim, n_data, noise_sd, data_seed)
    constant = -0.5 * n_data * np.log(2.0 * np.pi * noise_sd**2) - 0.5 * least / noise_sd**2

    def log_likelihood(theta: Floats) -> Floats:
        error = theta - estimate
        return constant - 0.5 * np.einsum("ni,ij,nj->n", error, gram, error, optimize=True) / noise_sd**2

    precision = gram / noise_sd**2 + (np.eye(n_dim) if prior == "normal" else 0.0)
    covariance = np.linalg.inv(precision)
    log_det = np.linalg.slogdet(precision)[1]
    if prior == "normal":
        mean = covariance @ (gram @ estimate) / noise_sd**2
        peak = float(log_likelihood(mean[None])[0]) - 0.5 * float(mean @ mean)
        log_evidence = peak - 0.5 * log_det
        values = _standard_normal
    else:
        mean = estimate
        assert np.all(1.0 - np.abs(mean) > 8.0 * np.sqrt(np.diag(covariance)))
        log_evidence = constant + n_dim * (0.5 * np.log(2.0 * np.pi) - np.log(2.0)) - 0.5 * log_det
        values = _box(-1.0, 1.0)
    return EvidenceOracle(
        name=f"linear Gaussian, {prior} prior, d = {n_dim}, N = {n_data}",
        n_dim=n_dim,
        values=values,
        log_likelihood_of_values=log_likelihood,
        log_evidence=float(log_evidence),
        posterior_mean=mean,
        posterior_sd=np.sqrt(np.diag(covariance)),
    )
