"""What the sampler asks of a target, and the density from which its road starts.

All points live in the unit cube, in which the prior is uniform over an admissible region. The road from a reference
density ``r`` to the posterior is geometric::

    density(x; t) = r(x)^(1 - t) * (prior(x) * likelihood(x))^t,        0 <= t <= 1

With the prior as reference this is the tempering of Ching and Chen [1]_; any other normalised reference makes it a
bridge, whose evidence is the same number.

References
----------
.. [1] J. Ching and Y.-C. Chen, "Transitional Markov Chain Monte Carlo Method for Bayesian Model Updating, Model Class
   Selection, and Model Averaging", 2007, doi:10.1061/(ASCE)0733-9399(2007)133:7(816).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.errors import UserError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class Target(Protocol):
    """A posterior over the unit cube: a uniform prior on an admissible region and a batched log likelihood."""

    @property
    def n_dim(self) -> int:
        """Number of identified parameters."""
        ...

    def log_prior(self, points: Floats) -> Floats:
        """Normalised log prior density ``(n,)`` of points ``(n, d)``; minus infinity outside the admissible region."""
        ...

    def log_likelihood(self, points: Floats) -> Floats:
        """Log likelihood ``(n,)`` of admissible points ``(n, d)``; minus infinity where the solve fails."""
        ...

    def sample_prior(self, rng: np.random.Generator, n: int) -> Floats:
        """Draw ``(n, d)`` points from the prior."""
        ...


class Reference(Protocol):
    """A normalised density on the unit cube that can be drawn from and evaluated."""

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draw ``(n, d)`` points."""
        ...

    def log_density(self, points: Floats) -> Floats:
        """Log density ``(n,)`` of points ``(n, d)``."""
        ...


@dataclass(frozen=True)
class PriorReference:
    """The prior of a target as the reference: the road of the original paper."""

    target: Target

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draw ``(n, d)`` points from the prior."""
        return self.target.sample_prior(rng, n)

    def log_density(self, points: Floats) -> Floats:
        """Log prior density ``(n,)`` of points ``(n, d)``."""
        return self.target.log_prior(points)


@dataclass(frozen=True, kw_only=True)
class DefensiveMixture:
    """A component (say an inflated Laplace mixture at the known modes) mixed with the prior.

    The prior's share bounds the ratio of prior to reference by ``1 / prior_share``: no part of the posterior has
    reference density zero. It is no guarantee that a finite cloud gets there. On the geometric road a mode that the
    component misses holds, early on, a share of about the posterior's volume (in prior units, times the inflation), so
    a narrow one in many dimensions is lost: the road from the prior is the check.

    Parameters
    ----------
    prior_share : float
        Mass given to the prior, in (0, 1].
    target : Target
        Whose prior it is.
    component : Reference
        The rest; normalised on the unit cube.

    Raises
    ------
    UserError
        If ``prior_share`` is outside (0, 1].

    References
    ----------
    .. [1] T. Hesterberg, "Weighted Average Importance Sampling and Defensive Mixture Distributions", 1995,
       doi:10.1080/00401706.1995.10484303.
    """

    prior_share: float
    target: Target
    component: Reference

    def __post_init__(self) -> None:
        if not 0.0 < self.prior_share <= 1.0:
            raise UserError(f"DefensiveMixture: prior_share is {self.prior_share}, it must lie above 0 and not above 1")

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draw ``(n, d)`` points, the prior's share of them (rounded at random) from the prior."""
        n_prior = min(n, int(np.floor(n * self.prior_share + rng.random())))
        from_prior = self.target.sample_prior(rng, n_prior)
        return np.concatenate([from_prior, self.component.sample(rng, n - n_prior)])

    def log_density(self, points: Floats) -> Floats:
        """Log density ``(n,)`` of points ``(n, d)``."""
        with np.errstate(divide="ignore"):
            log_share, log_rest = np.log(self.prior_share), np.log1p(-self.prior_share)
        log_density: Floats = np.logaddexp(
            log_share + self.target.log_prior(points),
            log_rest + self.component.log_density(points),
        )
        return log_density


class Cloud(NamedTuple):
    """Evaluated points: all that the road's density needs at any tempering parameter."""

    points: Floats
    """Of the unit cube or of another chart, ``(n, d)``."""
    log_reference: Floats
    """Log reference density, ``(n,)``."""
    log_ratio: Floats
    """Log of prior times likelihood over reference, ``(n,)``; minus infinity where a point cannot be kept."""
    log_likelihood: Floats
    """Log likelihood, ``(n,)``; minus infinity outside the admissible region and for failed solves."""

    def log_density(self, tempering_parameter: float) -> Floats:
        """Unnormalised log density ``(n,)`` on the road, for ``tempering_parameter > 0``."""
        return self.log_reference + tempering_parameter * self.log_ratio

    def take(self, indices: Integers) -> Cloud:
        """The points at the given indices."""
        return Cloud(*(column[indices] for column in self))

    def where(self, condition: NDArray[np.bool_], other: Cloud) -> Cloud:
        """Take this cloud's points where ``condition (n,)`` holds, the other's elsewhere."""
        scalars = (np.where(condition, mine, its) for mine, its in zip(self[1:], other[1:], strict=True))
        return Cloud(np.where(condition[:, None], self.points, other.points), *scalars)


def evaluate(target: Target, reference: Reference, points: Floats) -> tuple[Cloud, int]:
    """Evaluate prior, reference and likelihood; points outside the admissible region cost no solve.

    Parameters
    ----------
    target, reference : Target, Reference
        The two ends of the road.
    points : (n, d) array
        Points, inside the unit cube or not.

    Returns
    -------
    cloud : Cloud
        The evaluated points.
    n_solves : int
        Likelihood evaluations spent.
    """
    log_prior = np.asarray(target.log_prior(points), dtype=np.float64)
    bridged = not isinstance(reference, PriorReference)
    log_reference = np.asarray(reference.log_density(points), dtype=np.float64) if bridged else log_prior
    reachable = np.isfinite(log_prior) & np.isfinite(log_reference)
    log_likelihood = np.full(len(points), -np.inf)
    if np.any(reachable):
        log_likelihood[reachable] = target.log_likelihood(points[reachable])
    # A NaN is a failed solve that nobody marked; it must not pass for a likelihood.
    log_likelihood[np.isnan(log_likelihood)] = -np.inf
    log_ratio = log_likelihood.copy()
    if bridged:
        log_ratio[reachable] += log_prior[reachable] - log_reference[reachable]
    return Cloud(points, np.where(reachable, log_reference, -np.inf), log_ratio, log_likelihood), int(reachable.sum())


def join(clouds: list[Cloud]) -> Cloud:
    """Concatenate clouds in their order."""
    return Cloud(*(np.concatenate(columns) for columns in zip(*clouds, strict=True)))
