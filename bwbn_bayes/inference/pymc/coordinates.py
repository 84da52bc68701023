"""Coordinates in which a posterior is nearly standard normal: what the No-U-Turn sampler moves in.

In ``y``, the prior is standard normal. About the mode of the posterior's density there a linear map makes its second
order round. What is left bends stiff directions along wide ones, so that paths must be as fine as the stiffest is
narrow and as long as the widest is wide [2]_. A triangular map [1]_ takes the bends out to third order, one coordinate
of the unit cube after the other::

    y[k] = origin[k] + factor[k, :k] w[:k] + factor[k, k] (x[k] + sum(bend[k, i, j] w[i] w[j])),    i, j < k

The response, and so the middle of y[k], follows the values of those before: ``w`` are their deviations in the unit
cube, not in ``y``, by the same factor. In the cube they end, so that nothing runs away along what the record hardly
sees; and what lies at a bound, where the two differ most, comes first. The map has an inverse everywhere, and its
determinant is that of the factor.

The third derivatives come from the rates of Gauss-Newton's information along all directions, one call of an engine.

References
----------
.. [1] M. Parno and Y. Marzouk, "Transport Map Accelerated Markov Chain Monte Carlo", SIAM/ASA J. Uncertainty
   Quantification 6, 2018, doi:10.1137/17M1134640.
.. [2] M. K. Transtrum, B. B. Machta and J. P. Sethna, "Geometry of Nonlinear Least Squares with Applications to Sloppy
   Models and Optimization", Phys. Rev. E 83, 2011, doi:10.1103/PhysRevE.83.036701.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from scipy.special import ndtr, ndtri

from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.pymc.forward import ForwardProblem, forward_problem
from bwbn_bayes.inference.tmcmc.target import Integers
from bwbn_bayes.parameters import Floats

_EDGE = 1e-4
"""From here the mode in ``y`` is searched where the mode in the unit cube lies at a bound, which is infinitely far."""
_SHARES = 2.0 ** -np.arange(8)
"""Of a Newton step, tried in one call of the engine."""
_N_CLIMBS = 20
_CLIMBED = 1e-3
"""Newton's promise below which the mode is found. [nat]"""
_WITHIN = 0.9
"""Share of the way to a bound that rates of change are taken at, where that is less than the posterior's own width."""
_TINY = 1e-300
_ROOT_TWO_PI = float(np.sqrt(2.0 * np.pi))


class _Local(NamedTuple):
    """Log density in ``y``, its gradient and the likelihood's share of the information, at some points."""

    log_density: Floats
    gradient: Floats
    information: Floats
    diagonal: Floats
    """What curves each coordinate by itself ``(n, n_dim)``: the prior, and the slope of the likelihood."""

    @property
    def whole(self) -> Floats:
        """Information ``(n, n_dim, n_dim)``."""
        return self.information + self.diagonal[:, :, None] * np.eye(self.diagonal.shape[1])


@dataclass(frozen=True, kw_only=True)
class NormalCoordinates:
    """A map from coordinates ``x`` to the unit cube, and the posterior's density in them.

    Attributes
    ----------
    posterior : Posterior
    order : (n_dim,) integer array
        Coordinates of the unit cube in the order in which they are mapped. All else is in it.
    origin : (n_dim,) array
        Mode in ``y``.
    factor : (n_dim, n_dim) array
        Lower triangular, of the covariance about the mode.
    bend : (n_dim, n_dim, n_dim) array
        Of each coordinate along products of those before it.
    """

    posterior: Posterior
    order: Integers
    origin: Floats
    factor: Floats
    bend: Floats

    @classmethod
    def at(cls, posterior: Posterior, point: Floats) -> Self:
        """About the mode of the density in ``y``, searched from a point ``(n_dim,)`` of the unit cube."""
        origin, information = _mode(posterior, ndtri(np.clip(point, _EDGE, 1.0 - _EDGE)))
        covariance = np.linalg.inv(information)
        # How far the cube's coordinate bends against y over the posterior's width.
        order = np.argsort(-np.abs(origin) * np.sqrt(np.diag(covariance)))
        factor = np.linalg.cholesky(covariance[np.ix_(order, order)])
        third = _third_derivatives(posterior, origin, order, factor)
        before = np.tri(len(order), k=-1)
        bend = -0.5 * third * before[:, :, None] * before[:, None, :]
        return cls(posterior=posterior, order=order, origin=origin[order], factor=factor, bend=bend)

    @property
    def n_dim(self) -> int:
        """Number of coordinates."""
        return len(self.origin)

    def points(self, x: Floats) -> Floats:
        """Points ``(n, n_dim)`` of the unit cube at coordinates ``(n, n_dim)``."""
        result = np.empty_like(x)
        result[:, self.order] = ndtr(self._mapped(x)[0])
        return result

    def log_density(self, x: Floats) -> tuple[Floats, Floats]:
        """Logs ``(n,)`` of likelihood times the prior's density of ``x``, and gradients, at ``(n, n_dim)``.

        Minus infinity where the solve fails or the prior has no mass. What is found at one point does not depend on
        the others, to the last bit.
        """
        with np.errstate(over="ignore", invalid="ignore"):  # a path that runs away
            y, w = self._mapped(x)
            value, by_y = self._log_density_in_y(y)
        gradient, found = np.zeros_like(x), value != -np.inf
        gradient[found] = self._pulled_back(y[found], w[found], by_y[found])
        return value + self._log_volume, gradient

    # Products are sums by einsum's own loops: those of a linear algebra library depend on how many points there are.

    def _mapped(self, x: Floats) -> tuple[Floats, Floats]:
        """``y`` and ``w`` of coordinates ``(n, n_dim)``."""
        y, w = np.empty_like(x), np.empty_like(x)
        for k, (row, bend) in enumerate(zip(self.factor, self.bend, strict=True)):
            earlier = w[:, :k]
            along = np.einsum("ni,i->n", earlier, row[:k])
            bent = np.einsum("ni,ni->n", np.einsum("nj,ij->ni", earlier, bend[:k, :k]), earlier)
            y[:, k] = self.origin[k] + along + row[k] * (x[:, k] + bent)
            w[:, k] = ((ndtr(y[:, k]) - self._middle[k]) / self._slope[k] - along) / row[k]
        return y, w

    def _pulled_back(self, y: Floats, w: Floats, by_y: Floats) -> Floats:
        """Gradients by ``x`` from those by ``y``, ``(n, n_dim)``, from the last coordinate to the first."""
        by_x, by_w, ratio = np.empty_like(y), np.zeros_like(y), _density(y) / self._slope
        for k in range(self.n_dim - 1, -1, -1):
            row, earlier = self.factor[k], w[:, :k]
            by_cube = by_w[:, k] / row[k]
            whole = by_y[:, k] + by_cube * ratio[:, k]
            by_x[:, k] = whole * row[k]
            bent = np.einsum("nj,ij->ni", earlier, self.bend[k, :k, :k])
            by_w[:, :k] += (whole - by_cube)[:, None] * row[:k] + 2.0 * by_x[:, k, None] * bent
        return by_x

    @cached_property
    def _middle(self) -> Floats:
        """Mode in the unit cube."""
        return np.asarray(ndtr(self.origin))

    @cached_property
    def _slope(self) -> Floats:
        """Derivative of the unit cube's coordinates by ``y`` at the mode."""
        return _density(self.origin)

    @cached_property
    def problem(self) -> ForwardProblem:
        """What is solved."""
        target = self.posterior
        return forward_problem(target.model, target.record, target.engine, target.noise.correlation)

    @cached_property
    def _log_volume(self) -> float:
        """Of the linear map, and what makes a density of the standard normal."""
        return float(np.sum(np.log(np.diag(self.factor)))) - self.n_dim * float(np.log(_ROOT_TWO_PI))

    def _log_density_in_y(self, y: Floats) -> tuple[Floats, Floats]:
        target, problem, points = self.posterior, self.problem, np.empty_like(y)
        points[:, self.order] = ndtr(y)
        log_prior, value, gradient = target.log_prior(points), np.full(len(y), -np.inf), np.zeros_like(y)
        inside = np.flatnonzero(np.isfinite(log_prior))
        if not len(inside):
            return value, gradient
        whole = problem.squared_residuals_and_slopes(target.split(points[inside])[0], problem.measured)
        solved = np.all(np.isfinite(whole[..., 0]), axis=1)
        some, misfit, slopes = inside[solved], whole[solved, :, 0], whole[solved, :, 1:]
        at, own = points[some], y[some]
        value[some] = target.log_likelihood_of(misfit, at) + log_prior[some] - 0.5 * np.einsum("ni,ni->n", own, own)
        gradient[some] = target.gradient_of(misfit, slopes, at)[:, self.order] * _density(own) - own
        return value, gradient


def _density(y: Floats) -> Floats:
    """Derivative of the unit cube's coordinates by ``y``."""
    return np.asarray(np.exp(-0.5 * np.square(y)) / _ROOT_TWO_PI)


def _local(posterior: Posterior, y: Floats) -> _Local:
    """The expansion at points ``(n, n_dim)``."""
    points, slope = ndtr(y), _density(y)
    found = posterior.linearise(points)
    value = found.log_likelihood + posterior.log_prior(points) - 0.5 * np.sum(np.square(y), axis=1)
    return _Local(
        log_density=value,
        gradient=found.gradient * slope - y,
        information=found.information * slope[:, :, None] * slope[:, None, :],
        diagonal=np.maximum(1.0 + found.gradient * y * slope, 1.0),  # away from the mode it need not be positive
    )


def _mode(posterior: Posterior, y: Floats) -> tuple[Floats, Floats]:
    """Mode ``(n_dim,)`` by Newton steps of shares that climb, and the information there."""
    here = _local(posterior, y[None])
    for _ in range(_N_CLIMBS):
        step = np.linalg.solve(here.whole[0], here.gradient[0])
        if here.gradient[0] @ step < _CLIMBED:
            break
        tried = y + _SHARES[:, None] * step
        found = _local(posterior, tried)
        best = int(np.argmax(found.log_density))
        if not found.log_density[best] > here.log_density[0]:
            break
        y, here = tried[best], _Local(*(part[best : best + 1] for part in found))
    return y, here.whole[0]


def _third_derivatives(posterior: Posterior, origin: Floats, order: Integers, factor: Floats) -> Floats:
    """Third derivatives of minus the log likelihood along the factor's columns, in the unit cube.

    Of half a sum of squares they are ``r_i r_jk + r_j r_ik + r_k r_ij``, summed over samples, where residuals are
    small, and the rate of ``r_i r_j`` along k is ``r_ik r_j + r_i r_jk``: half of all three rates. Where a solve fails
    nothing is known of them.
    """
    middle, n = ndtr(origin), len(origin)
    basis = np.empty_like(factor)
    basis[order] = factor * _density(origin[order])[:, None]
    room = np.min(np.minimum(middle, 1.0 - middle)[:, None] / np.maximum(np.abs(basis), _TINY), axis=0)
    away = np.minimum(1.0, _WITHIN * room)
    found = posterior.linearise(np.concatenate([middle + (away * basis).T, middle - (away * basis).T]))
    along = basis.T @ found.information @ basis
    solved = np.all(np.isfinite(found.log_likelihood.reshape(2, n)), axis=0)
    rates = np.where(solved[:, None, None], along[:n] - along[n:], 0.0) / (2.0 * away[:, None, None])
    return 0.5 * (rates + np.swapaxes(rates, 0, 1) + np.swapaxes(rates, 0, 2))
