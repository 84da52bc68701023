"""A posterior seen through a transport of the unit cube.

If ``x = T(w)`` maps uniform points of the cube to draws of a density q, then sampling ``prior(x) likelihood(x) / q(x)``
over a uniform ``w`` is a bridge from q to the posterior with the same evidence, in coordinates in which q is flat.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bwbn_bayes.inference.tmcmc.sampler import TmcmcResult
from bwbn_bayes.inference.tmcmc.target import Target
from bwbn_bayes.parameters import Floats


@dataclass(frozen=True, kw_only=True)
class Transported:
    """A target in the coordinates of a transport.

    Parameters
    ----------
    target : Target
        The posterior.
    transport : callable
        Maps points ``(n, n_dim)`` of the cube to draws ``(n, n_dim)`` and their log density ``(n,)``.
    """

    target: Target
    transport: Callable[[Floats], tuple[Floats, Floats]]

    @property
    def n_dim(self) -> int:
        """Number of coordinates."""
        return self.target.n_dim

    def log_prior(self, points: Floats) -> Floats:
        """Zero inside the cube, minus infinity outside."""
        return np.where(np.all((points >= 0.0) & (points <= 1.0), axis=1), 0.0, -np.inf)

    def sample_prior(self, rng: np.random.Generator, n: int) -> Floats:
        """Uniform points ``(n, n_dim)``."""
        return rng.random((n, self.n_dim))

    def log_likelihood(self, points: Floats) -> Floats:
        """Log of prior times likelihood over the transport's density, ``(n,)``."""
        draws, log_density = self.transport(points)
        log_prior = self.target.log_prior(draws)
        result = np.full(len(points), -np.inf)
        inside = np.isfinite(log_prior)
        result[inside] = self.target.log_likelihood(draws[inside]) + log_prior[inside] - log_density[inside]
        return result

    def back(self, result: TmcmcResult) -> TmcmcResult:
        """A run's particles and log likelihoods in the target's own coordinates."""
        draws, log_density = self.transport(result.particles)
        log_likelihood = result.log_likelihood + log_density - self.target.log_prior(draws)
        return replace(result, particles=draws, log_likelihood=log_likelihood)
