"""Importance sampling that learns: every draw of every proposal is kept, weighed by the mixture of all of them.

A proposal fitted to weighted draws is better than the one they came from, and the next better still. Draws of the
earlier ones are not thrown away: all count as draws of the mixture in which each proposal has the share of its draws.
So nothing is chosen among repeated attempts, and the shape of the weights' tail is that of all that was seen.

References
----------
.. [1] J.-M. Cornuet, J.-M. Marin, A. Mira and C. P. Robert, "Adaptive Multiple Importance Sampling", Scandinavian
   Journal of Statistics 39, 2012, doi:10.1111/j.1467-9469.2011.00756.x.
.. [2] E. Koblents and J. Miguez, "A population Monte Carlo scheme with transformed weights and its application to
   stochastic kinetic models", Statistics and Computing 25, 2015, doi:10.1007/s11222-013-9440-2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.special import gammaln, logsumexp

from bwbn_bayes.inference.importance import (
    PARETO_CLEAR,
    Proposal,
    WeightedDraws,
    effective_draws,
    log_targets,
    summarised,
)
from bwbn_bayes.inference.tmcmc.coordinates import Coordinates, to_probit
from bwbn_bayes.inference.tmcmc.mixture import GaussianMixture, fit_mixture
from bwbn_bayes.inference.tmcmc.resampling import systematic
from bwbn_bayes.inference.tmcmc.target import Target
from bwbn_bayes.parameters import Floats

_SIZES = (1, 2, 4, 8, 12)
_DEGREES, _INFLATION = 8.0, 1.1
"""Of the components, as of the Laplace proposal's wider companions; on their standard deviations."""
_LEARNT_FROM = 400.0
"""Effective draws that a fit wants: weights worth fewer are raised to a power until they are worth so many."""
_LEAST_POWER = 0.05
_MOST_FITTED = 20_000
"""The heaviest draws are enough for a fit."""


@dataclass(frozen=True, kw_only=True)
class FittedMixture:
    """A mixture of Student-t in probit coordinates whose marginals are straightened; a proposal on the unit cube."""

    coordinates: Coordinates
    mixture: GaussianMixture

    @classmethod
    def to(cls, draws: WeightedDraws) -> Self | None:
        """Fitted to weighted draws; None where they hold too little to learn from."""
        log_weights = draws.log_weights
        power = 1.0
        while effective_draws(power * log_weights) < _LEARNT_FROM:
            power *= 0.9
            if power < _LEAST_POWER:
                return None
        chosen = np.argsort(-log_weights)[:_MOST_FITTED]
        chosen = chosen[np.isfinite(log_weights[chosen])]
        weights = np.exp(power * log_weights[chosen] - logsumexp(power * log_weights[chosen]))
        positions = to_probit(draws.points[chosen])
        # A quantile needs points of equal weight; half a level for each keeps the fit a function of the draws.
        archive = positions[systematic(weights, _MOST_FITTED, np.random.default_rng(0))]
        coordinates = Coordinates.straightening(archive)
        mapped, _ = coordinates.forward(positions)
        worth = 1.0 / float(np.sum(np.square(weights)))
        mixture = fit_mixture(mapped, weights, worth, _SIZES).inflated(_INFLATION)
        return cls(coordinates=coordinates, mixture=mixture)

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draws ``(n, n_dim)``; the few that no double tells from the faces of the cube are put outside of it."""
        n_dim = self.mixture.means.shape[1]
        labels = self.mixture.labels(rng, n)
        stretch = np.sqrt(_DEGREES / rng.chisquare(_DEGREES, n))
        noise = rng.standard_normal((n, n_dim)) * stretch[:, None]
        mapped = self.mixture.means[labels] + np.einsum("nij,nj->ni", self.mixture.factors[labels], noise)
        points, log_volume = self.coordinates.inverse(mapped)
        return np.where(np.isfinite(log_volume)[:, None], points, 2.0)

    def log_density(self, points: Floats) -> Floats:
        """Normalised log density ``(n,)``, minus infinity outside the cube."""
        inside = np.all((points > 0.0) & (points < 1.0), axis=1)
        mapped, _ = self.coordinates.forward(to_probit(points[inside]))
        _, log_volume = self.coordinates.inverse(mapped)
        mixture, n_dim = self.mixture, points.shape[1]
        end = 0.5 * (_DEGREES + n_dim)
        constant = gammaln(end) - gammaln(0.5 * _DEGREES) - 0.5 * n_dim * np.log(_DEGREES * np.pi)
        parts = np.empty((len(mixture.weights), len(mapped)))
        for part, weight, mean, inverse in zip(parts, mixture.weights, mixture.means, mixture.inverses, strict=True):
            squared = np.sum(np.square((mapped - mean) @ inverse.T), axis=1)
            part[:] = np.log(weight) + np.sum(np.log(np.diag(inverse))) - end * np.log1p(squared / _DEGREES)
        result = np.full(len(points), -np.inf)
        result[inside] = constant + np.asarray(logsumexp(parts, axis=0)) - log_volume
        return result


@dataclass(frozen=True, kw_only=True)
class Pool:
    """Draws of several proposals.

    Attributes
    ----------
    proposals : tuple of Proposal
    counts : tuple of int
        Draws of each.
    points : (n, n_dim) array
        All of them, in the unit cube.
    log_likelihood, log_target : (n,) array
        Without and with the log prior.
    log_densities : (n_proposals, n) array
        Of every proposal at every draw.
    """

    proposals: tuple[Proposal, ...]
    counts: tuple[int, ...]
    points: Floats
    log_likelihood: Floats
    log_target: Floats
    log_densities: Floats

    @classmethod
    def empty(cls, n_dim: int) -> Self:
        """Nothing drawn yet."""
        none = np.empty(0)
        return cls(
            proposals=(),
            counts=(),
            points=np.empty((0, n_dim)),
            log_likelihood=none,
            log_target=none,
            log_densities=np.empty((0, 0)),
        )

    def drawn(self, target: Target, proposal: Proposal, rng: np.random.Generator, n: int) -> Self:
        """With ``n`` more draws, of a new proposal or again of the last one."""
        new = proposal.sample(rng, n)
        log_likelihood, log_target = log_targets(target, new)
        proposals, counts, densities = self.proposals, self.counts, self.log_densities
        if proposals and proposals[-1] is proposal:
            counts = (*counts[:-1], counts[-1] + n)
        else:
            proposals, counts = (*proposals, proposal), (*counts, n)
            own = proposal.log_density(self.points) if len(self.points) else np.empty(0)
            densities = np.concatenate([densities, own[None]])
        added = np.stack([one.log_density(new) for one in proposals])
        return type(self)(
            proposals=proposals,
            counts=counts,
            points=np.concatenate([self.points, new]),
            log_likelihood=np.concatenate([self.log_likelihood, log_likelihood]),
            log_target=np.concatenate([self.log_target, log_target]),
            log_densities=np.concatenate([densities, added], axis=1),
        )

    @property
    def weighted(self) -> WeightedDraws:
        """All draws, weighed by the mixture of all proposals."""
        log_shares = np.log(np.array(self.counts) / len(self.points))
        log_density = np.asarray(logsumexp(self.log_densities + log_shares[:, None], axis=0))
        solved = np.isfinite(self.log_target)
        log_ratio = np.full(len(self.points), -np.inf)
        log_ratio[solved] = self.log_target[solved] - log_density[solved]
        return summarised(self.points, self.log_likelihood, log_ratio)


def sample_learning(
    target: Target, proposal: Proposal, rng: np.random.Generator, *, effective: float, most: int
) -> WeightedDraws:
    """Draw until so many are effective and the weights have no heavy tail, each time from a fit to all draws so far.

    Parameters
    ----------
    target : Target
        Posterior on the unit cube.
    proposal : Proposal
        To begin with.
    rng : numpy.random.Generator
        Random stream.
    effective : float
        Effective draws wanted.
    most : int
        Largest number of draws.

    Returns
    -------
    WeightedDraws
        All draws; worth fewer than wanted where ``most`` ended it.
    """
    pool, first = Pool.empty(target.n_dim), int(1.1 * effective)
    while True:
        n = min(max(first, len(pool.points) // 2), most - len(pool.points))
        pool = pool.drawn(target, proposal, rng, n // 16 * 16 + 16)
        found = pool.weighted
        reached = found.effective_sample_size
        if (reached >= effective and found.pareto_k <= PARETO_CLEAR) or len(pool.points) >= most:
            return found
        if target.n_dim > 1:
            proposal = FittedMixture.to(found) or proposal
