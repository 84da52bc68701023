"""Coordinates in which a stage's cloud looks Gaussian: probit of the unit cube, then a map fitted to each marginal.

In probit coordinates ``z = Phi^-1(x)`` the cube has no bounds to cross and a uniform prior is a standard Gaussian. A
broad cloud that leans on a bound is still skewed there; a monotone piecewise linear map ``y = g(z)`` for each
parameter, through five quantiles of the cloud, straightens it. Both maps are exact: their Jacobian is counted.

``|z|`` is held below 8, which cuts off 1e-15 of the prior mass per parameter: the resolution of a double near one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from bwbn_bayes.inference.tmcmc.target import Floats

_LIMIT = 8.0
_SCORES = np.array([-1.75, -0.85, 0.0, 0.85, 1.75])
_SMALLEST_GAP = 1e-3


def to_probit(points: Floats) -> Floats:
    """Probit coordinates ``(n, d)`` of points of the unit cube."""
    return np.clip(ndtri(points), -_LIMIT, _LIMIT)


class Coordinates(NamedTuple):
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
        gaps = np.maximum(gaps, _SMALLEST_GAP * gaps.sum(axis=1, keepdims=True) + 1e-300)
        knots = np.concatenate([knots[:, :1], knots[:, :1] + np.cumsum(gaps, axis=1)], axis=1)
        return cls(knots, np.tile(_SCORES, (len(knots), 1)))

    def forward(self, positions: Floats) -> tuple[Floats, Floats]:
        """Coordinates ``(n, d)`` of probit positions, and the log Jacobian ``log |dy/dz| (n,)``."""
        return _piecewise_linear(positions, self.knots, self.scores)

    def inverse(self, coordinates: Floats) -> tuple[Floats, Floats]:
        """Points of the unit cube ``(n, d)`` and the log Jacobian ``log |dx/dy| (n,)``, minus infinity beyond."""
        positions, log_slope = _piecewise_linear(coordinates, self.scores, self.knots)
        inside = np.all(np.abs(positions) <= _LIMIT, axis=1)
        n_dim = positions.shape[1]
        log_volume = log_slope - 0.5 * np.sum(positions**2, axis=1) - 0.5 * n_dim * np.log(2.0 * np.pi)
        return np.asarray(ndtr(positions)), np.where(inside, log_volume, -np.inf)


def _piecewise_linear(arguments: Floats, knots: Floats, values: Floats) -> tuple[Floats, Floats]:
    segment = np.sum(arguments[:, :, None] > knots[:, 1:-1], axis=2)
    column = np.arange(arguments.shape[1])
    slope = (np.diff(values, axis=1) / np.diff(knots, axis=1))[column, segment]
    mapped = values[column, segment] + slope * (arguments - knots[column, segment])
    return mapped, np.sum(np.log(slope), axis=1)
