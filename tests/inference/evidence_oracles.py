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


def log_normal(x: Floats | float, mean: Floats | float, sd: Floats | float) -> Floats:
    """Log density of a normal distribution, written out: ``scipy.stats`` takes longer than a step of the sampler."""
    return np.asarray(-0.5 * ((x - mean) / sd) ** 2 - np.log(sd * np.sqrt(2.0 * np.pi)))


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


def normal_inverse_gamma(n_dim: int = 2, n_data: int = 200, data_seed: int = 3) -> EvidenceOracle:
    """Regression with unknown noise: variance inverse-gamma(3, 0.5), coefficients normal(0, variance)."""
    gram, estimate, least = _regression(n_dim, n_data, 0.3, data_seed)
    shape, rate = 3.0, 0.5

    def values(points: Floats) -> Floats:
        variance = stats.invgamma.ppf(points[:, -1], shape, scale=rate)
        return np.column_stack([special.ndtri(points[:, :-1]) * np.sqrt(variance)[:, None], variance])

    def log_likelihood(theta: Floats) -> Floats:
        error, variance = theta[:, :-1] - estimate, theta[:, -1]
        squares = least + np.einsum("ni,ij,nj->n", error, gram, error, optimize=True)
        return -0.5 * n_data * np.log(2.0 * np.pi * variance) - 0.5 * squares / variance

    precision = gram + np.eye(n_dim)
    mean = np.linalg.solve(precision, gram @ estimate)
    shape_after = shape + 0.5 * n_data
    rate_after = rate + 0.5 * (least + estimate @ gram @ estimate - mean @ precision @ mean)
    log_evidence = (
        -0.5 * n_data * np.log(2.0 * np.pi)
        - 0.5 * np.linalg.slogdet(precision)[1]
        + shape * np.log(rate)
        - shape_after * np.log(rate_after)
        + special.gammaln(shape_after)
        - special.gammaln(shape)
    )
    variance_mean = rate_after / (shape_after - 1.0)
    spread = np.sqrt(np.diag(np.linalg.inv(precision)) * variance_mean)
    return EvidenceOracle(
        name="normal-inverse-gamma",
        n_dim=n_dim + 1,
        values=values,
        log_likelihood_of_values=log_likelihood,
        log_evidence=float(log_evidence),
        posterior_mean=np.append(mean, variance_mean),
        posterior_sd=np.append(spread, variance_mean / np.sqrt(shape_after - 2.0)),
    )


def gaussian_in_box(centre: Floats, sd: Floats) -> EvidenceOracle:
    """Product of Gaussian likelihoods under a uniform prior on [0, 1]; a centre may lie at a bound or past it."""
    centre, sd = np.asarray(centre, dtype=np.float64), np.asarray(sd, dtype=np.float64)
    low, high = -centre / sd, (1.0 - centre) / sd
    mass = stats.norm.cdf(high) - stats.norm.cdf(low)
    marginal = stats.truncnorm(low, high, loc=centre, scale=sd)
    return EvidenceOracle(
        name="Gaussian in a box",
        n_dim=len(centre),
        values=_box(0.0, 1.0),
        log_likelihood_of_values=lambda x: np.sum(log_normal(x, centre, sd), axis=1),
        log_evidence=float(np.sum(np.log(mass))),
        posterior_mean=marginal.mean(),
        posterior_sd=marginal.std(),
    )


def two_gaussians(n_dim: int, share: float = 0.5, sd: float = 0.1) -> EvidenceOracle:
    """Two Gaussians at +1 and -1 in every coordinate of [-2, 2]^d, ``share`` of the mass at +1.

    The boxes end ten sds away, so truncation does not show in double precision.
    """

    def log_likelihood(x: Floats) -> Floats:
        at_plus = np.log(share) + np.sum(log_normal(x, 1.0, sd), axis=1)
        return np.logaddexp(at_plus, np.log1p(-share) + np.sum(log_normal(x, -1.0, sd), axis=1))

    mean = 2.0 * share - 1.0
    return EvidenceOracle(
        name=f"two Gaussians, d = {n_dim}, share {share}",
        n_dim=n_dim,
        values=_box(-2.0, 2.0),
        log_likelihood_of_values=log_likelihood,
        log_evidence=-n_dim * float(np.log(4.0)),
        posterior_mean=np.full(n_dim, mean),
        posterior_sd=np.full(n_dim, np.sqrt(sd**2 + 1.0 - mean**2)),
    )


def beta_binomial(successes: int = 1, trials: int = 400) -> EvidenceOracle:
    """Binomial likelihood under a uniform prior."""
    after = stats.beta(successes + 1, trials - successes + 1)

    def log_likelihood(x: Floats) -> Floats:
        p = x[:, 0]
        return (
            np.log(special.comb(trials, successes))
            + special.xlogy(successes, p)
            + special.xlog1py(trials - successes, -p)
        )

    return EvidenceOracle(
        name="Beta-Binomial",
        n_dim=1,
        values=_box(0.0, 1.0),
        log_likelihood_of_values=log_likelihood,
        log_evidence=-float(np.log(trials + 1.0)),
        posterior_mean=np.array([after.mean()]),
        posterior_sd=np.array([after.std()]),
    )


def exponential(n_dim: int = 3, rate: float = 1500.0) -> EvidenceOracle:
    """Likelihood ``exp(-rate * sum(x))``: one-sided, so that a wrong sign or a reflected step cannot hide."""
    cut = np.exp(-rate)
    mean = 1.0 / rate - cut / (1.0 - cut)
    variance = 1.0 / rate**2 - cut / (1.0 - cut) ** 2
    return EvidenceOracle(
        name="exponential",
        n_dim=n_dim,
        values=_box(0.0, 1.0),
        log_likelihood_of_values=lambda x: -rate * np.sum(x, axis=1),
        log_evidence=n_dim * float(np.log1p(-cut) - np.log(rate)),
        posterior_mean=np.full(n_dim, mean),
        posterior_sd=np.full(n_dim, np.sqrt(variance)),
    )


def gumbel(n_dim: int = 2, scale: float = 0.01) -> EvidenceOracle:
    """Gumbel-shaped likelihood about 0.4, skewed to the right, far from the bounds."""
    shape = stats.gumbel_r(0.4, scale)
    return EvidenceOracle(
        name="Gumbel",
        n_dim=n_dim,
        values=_box(0.0, 1.0),
        log_likelihood_of_values=lambda x: np.sum(shape.logpdf(x), axis=1),
        log_evidence=n_dim * float(np.log(shape.cdf(1.0) - shape.cdf(0.0))),
        posterior_mean=np.full(n_dim, shape.mean()),
        posterior_sd=np.full(n_dim, shape.std()),
    )


def product_ridge(product: float = 0.25, sd: float = 0.002) -> EvidenceOracle:
    """Data that see only ``x1 * x2`` of two uniform parameters: a curved ridge from bound to bound.

    The product has density ``-log(s)`` on (0, 1), so evidence and moments are one-dimensional quadratures.
    """
    ends = (product - 12.0 * sd, product + 12.0 * sd)

    def integral(of: Callable[[float], float]) -> float:
        weighted = integrate.quad(
            lambda s: of(s) * stats.norm.pdf(product, s, sd), *ends, points=[product], epsabs=1e-13
        )
        return float(weighted[0])

    evidence = integral(lambda s: -np.log(s))
    # Given s, x1 has density proportional to 1 / x1 on (s, 1).
    mean = integral(lambda s: 1.0 - s) / evidence
    second = integral(lambda s: 0.5 * (1.0 - s**2)) / evidence
    return EvidenceOracle(
        name="product ridge",
        n_dim=2,
        values=_box(0.0, 1.0),
        log_likelihood_of_values=lambda x: log_normal(product, x[:, 0] * x[:, 1], sd),
        log_evidence=float(np.log(evidence)),
        posterior_mean=np.full(2, mean),
        posterior_sd=np.full(2, np.sqrt(second - mean**2)),
    )
