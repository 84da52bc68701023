"""Coordinates in which a posterior is nearly standard normal: what the No-U-Turn sampler moves in.

In ``y``, the prior is standard normal. About the mode of the posterior's density there, a linear map makes its second
order round. The third order, ``sum(third w w w) / 6`` of minus its logarithm, bends the stiff directions along the wide
ones, so that paths must be as fine as the stiffest is narrow and as long as the widest is wide. A triangular map, the
widest direction first, takes the bends out::

    w[k] = x[k] exp(sum(log_scale[k, i] x[i])) + sum(bend[k, i, j] x[i] x[j]),    i, j < k

It has an inverse everywhere, and the logarithm of its determinant is the sum of the exponents. The third derivatives
come from the rates of Gauss-Newton's information along all directions, which are one call of an engine.

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
from bwbn_bayes.parameters import Floats

_EDGE = 1e-4
"""From here the mode in ``y`` is searched where the mode in the unit cube lies at a bound, which is infinitely far."""
_SHARES = 2.0 ** -np.arange(8)
"""Of a Newton step, tried in one call of the engine."""
_N_CLIMBS = 20
_CLIMBED = 1e-3
"""Newton's promise below which the mode is found. [nat]"""
_AWAY = 1.0
"""Where rates of change are taken: the posterior's own width, over which a kink of the law is no more than a ripple."""
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
    origin : (n_dim,) array
        Mode in ``y``.
    basis : (n_dim, n_dim) array
        Directions of ``w`` in ``y``, the widest first.
    bend : (n_dim, n_dim, n_dim) array
        Of each ``w`` along products of those before it.
    log_scale : (n_dim, n_dim) array
        Of each ``w`` along those before it.
    """

    posterior: Posterior
    origin: Floats
    basis: Floats
    bend: Floats
    log_scale: Floats

    @classmethod
    def at(cls, posterior: Posterior, point: Floats) -> Self:
        """About the mode of the density in ``y``, searched from a point ``(n_dim,)`` of the unit cube."""
        origin, information = _mode(posterior, ndtri(np.clip(point, _EDGE, 1.0 - _EDGE)))
        values, vectors = np.linalg.eigh(information)
        basis = vectors / np.sqrt(values)
        third = _third_derivatives(posterior, origin, basis)
        n = len(origin)
        before = np.tri(n, k=-1)
        bend = -0.5 * third * before[:, :, None] * before[:, None, :]
        log_scale = -0.5 * np.einsum("ikk->ki", third) * before
        return cls(posterior=posterior, origin=origin, basis=basis, bend=bend, log_scale=log_scale)

    @property
    def n_dim(self) -> int:
        """Number of coordinates."""
        return len(self.origin)

    def points(self, x: Floats) -> Floats:
        """Points ``(n, n_dim)`` of the unit cube at coordinates ``(n, n_dim)``."""
        moved = x * np.exp(x @ self.log_scale.T) + np.einsum("kij,ni,nj->nk", self.bend, x, x)
        return np.asarray(ndtr(self.origin + moved @ self.basis.T))

    def log_density(self, x: Floats) -> tuple[float, Floats]:
        """Log of likelihood times the prior's density of ``x``, and its gradient, at one ``(n_dim,)``.

        Minus infinity where the solve fails or the prior has no mass.
        """
        with np.errstate(over="ignore", invalid="ignore"):  # a path that runs away
            log_scales = self.log_scale @ x
            bent = self.bend @ x
            scaled = x * np.exp(log_scales)
            y = self.origin + self.basis @ (scaled + bent @ x)
            value, by_y = self._log_density_in_y(y)
            if value == -np.inf:
                return value, np.zeros_like(x)
            by_w = by_y @ self.basis
            gradient = by_w * np.exp(log_scales) + (by_w * scaled + 1.0) @ self.log_scale + 2.0 * by_w @ bent
        return value + self._log_volume + float(np.sum(log_scales)), gradient

    @cached_property
    def problem(self) -> ForwardProblem:
        """What is solved."""
        target = self.posterior
        return forward_problem(target.model, target.record, target.engine, target.noise.correlation)

    @cached_property
    def _log_volume(self) -> float:
        """Of the linear map, and what makes a density of the standard normal."""
        return float(np.linalg.slogdet(self.basis).logabsdet) - self.n_dim * float(np.log(_ROOT_TWO_PI))

    def _log_density_in_y(self, y: Floats) -> tuple[float, Floats]:
        target, problem, point = self.posterior, self.problem, ndtr(y)[None]
        if not np.isfinite(target.log_prior(point)[0]):
            return -np.inf, np.zeros_like(y)
        whole = problem.squared_residuals_and_slopes(target.split(point)[0], problem.measured)
        misfit, slopes = whole[..., 0], whole[..., 1:]
        if not np.all(np.isfinite(misfit)):
            return -np.inf, np.zeros_like(y)
        value = target.log_likelihood_of(misfit, point)[0] - 0.5 * y @ y
        return float(value), target.gradient_of(misfit, slopes, point)[0] * _density(y) - y


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
        diagonal=np.maximum(1.0 + found.gradient * y * slope, 1.0),
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


def _third_derivatives(posterior: Posterior, origin: Floats, basis: Floats) -> Floats:
    """Third derivatives of minus the log density along a basis.

    Of half a sum of squares they are ``r_i r_jk + r_j r_ik + r_k r_ij``, summed over samples, where residuals are
    small, and the rate of ``r_i r_j`` along k is ``r_ik r_j + r_i r_jk``: half of all three rates. Where a solve fails
    nothing is known of them.
    """
    away, n = _AWAY * basis.T, len(origin)
    found = _local(posterior, np.concatenate([origin + away, origin - away]))
    along = basis.T @ found.information @ basis
    solved = np.all(np.isfinite(found.log_density.reshape(2, n)), axis=0)
    rates = np.where(solved[:, None, None], along[:n] - along[n:], 0.0) / (2.0 * _AWAY)
    return 0.5 * (rates + np.swapaxes(rates, 0, 1) + np.swapaxes(rates, 0, 2))
