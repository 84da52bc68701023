"""Coordinates in which a stage's cloud looks Gaussian: a chart without bounds, then a map fitted to each marginal.

In probit coordinates ``z = Phi^-1(x)`` the cube has no bounds to cross and a uniform prior is a standard Gaussian. A
broad cloud that leans on a bound is still skewed there; a monotone piecewise linear map ``y = g(z)`` for each
parameter, through five quantiles of the cloud, straightens it. Both maps are exact: their Jacobian is counted.

``|z|`` is held below 8, which cuts off 1e-15 of the prior mass per parameter: the resolution of a double near one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.special import ndtr, ndtri

from bwbn_bayes.inference.tmcmc.target import Floats

_LIMIT = 8.0
_SCORES = np.array([-1.75, -0.85, 0.0, 0.85, 1.75])
_SMALLEST_GAP = 1e-3


def to_probit(points: Floats) -> Floats:
    """Probit coordinates ``(n, d)`` of points of the unit cube."""
    return np.clip(ndtri(points), -_LIMIT, _LIMIT)


class Chart(Protocol):
    """How a target's points are seen as positions without bounds."""

    def positions(self, points: Floats) -> Floats:
        """Positions ``(n, d)`` of points ``(n, d)``."""
        ...

    def points(self, positions: Floats) -> tuple[Floats, Floats]:
        """Points ``(n, d)`` of positions ``(n, d)``, and the log Jacobian ``log |dx/dz| (n,)``."""
        ...


class Probit:
    """Of points of the unit cube."""

    def positions(self, points: Floats) -> Floats:
        """:func:`to_probit`."""
        return to_probit(points)

    def points(self, positions: Floats) -> tuple[Floats, Floats]:
        """Points of the cube; a log Jacobian of minus infinity beyond."""
        inside = (np.abs(positions) <= _LIMIT).all(axis=1)
        log_volume = -0.5 * (positions**2).sum(axis=1) - 0.5 * positions.shape[1] * np.log(2.0 * np.pi)
        return np.asarray(ndtr(positions)), np.where(inside, log_volume, -np.inf)


class Unbounded:
    """Of points that have no bounds: they are their own positions."""

    def positions(self, points: Floats) -> Floats:
        """The points."""
        return points

    def points(self, positions: Floats) -> tuple[Floats, Floats]:
        """The positions; a log Jacobian of zero."""
        return positions, np.zeros(len(positions))


PROBIT, UNBOUNDED = Probit(), Unbounded()


@dataclass(frozen=True)
class Coordinates:
    """The map ``z -> y``: ``knots (d, 5)`` in ``z`` go to ``scores (d, 5)``; outermost slopes continue."""

    knots: Floats
    scores: Floats

    @classmethod
    def probit(cls, n_dim: int) -> Coordinates:
        """No second map: ``y = z``."""
        scores = np.tile(_SCORES, (n_dim, 1))
        return cls(scores, scores)

    @classmethod
    def straightening(cls, positions: Floats) -> Coordinates:
        """The map that takes the quantiles of each marginal of ``positions (n, d)`` to those of a Gaussian."""
        knots = np.quantile(positions, ndtr(_SCORES), axis=0).T
        gaps = np.diff(knots, axis=1)
        # A marginal may be one value: its knots must be numbers that differ all the same.
        apart = 4.0 * np.spacing(np.max(np.abs(knots), axis=1, keepdims=True))
        gaps = np.maximum(gaps, _SMALLEST_GAP * gaps.sum(axis=1, keepdims=True) + apart)
        knots = np.concatenate([knots[:, :1], knots[:, :1] + np.cumsum(gaps, axis=1)], axis=1)
        return cls(knots, np.tile(_SCORES, (len(knots), 1)))

    def forward(self, positions: Floats) -> tuple[Floats, Floats]:
        """Coordinates ``(n, d)`` of probit positions, and the log Jacobian ``log |dy/dz| (n,)``."""
        return self._forward(positions)

    def inverse(self, coordinates: Floats, chart: Chart = PROBIT) -> tuple[Floats, Floats]:
        """Points ``(n, d)`` of a chart and the log Jacobian ``log |dx/dy| (n,)``, minus infinity beyond its bounds."""
        positions, log_slope = self._backward(coordinates)
        points, log_volume = chart.points(positions)
        return points, log_slope + log_volume

    @cached_property
    def _forward(self) -> _PiecewiseLinear:
        return _PiecewiseLinear.through(self.knots, self.scores)

    @cached_property
    def _backward(self) -> _PiecewiseLinear:
        return _PiecewiseLinear.through(self.scores, self.knots)


@dataclass(frozen=True)
class _PiecewiseLinear:
    """Straight pieces from ``starts (d, 4)`` on, where they have ``values (d, 4)``; every step of a chain needs it."""

    starts: Floats
    values: Floats
    slopes: Floats
    log_slopes: Floats

    @classmethod
    def through(cls, knots: Floats, values: Floats) -> _PiecewiseLinear:
        slopes: Floats = np.diff(values, axis=1) / np.diff(knots, axis=1)
        return cls(knots[:, :-1], values[:, :-1], slopes, np.log(slopes))

    def __call__(self, arguments: Floats) -> tuple[Floats, Floats]:
        segment = (arguments[:, :, None] > self.starts[:, 1:]).sum(axis=2)
        at = np.arange(arguments.shape[1]), segment
        mapped: Floats = self.values[at] + self.slopes[at] * (arguments - self.starts[at])
        return mapped, self.log_slopes[at].sum(axis=1)
