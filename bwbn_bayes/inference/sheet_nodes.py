"""Nodes of a sheet: points over the widest coordinates at which the rest is refitted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.stats import qmc

from bwbn_bayes.inference.identifiability import covariance_of
from bwbn_bayes.inference.likelihood import Linearisation, Posterior
from bwbn_bayes.inference.modes import Mode, polish
from bwbn_bayes.inference.tmcmc.target import Integers
from bwbn_bayes.parameters import Booleans, Floats, Uniform

MOST_WIDE = 4
EDGE = 1e-6
"""Points keep this distance from the faces of the unit cube."""
REACH = 30.0
"""Nodes this far below the best carry no mass. [nat]"""
_WIDE = 0.02
"""A coordinate is wide whose standard deviation, given the wide ones before it, exceeds this share of the prior."""
_N_NODES = (32, 32, 64, 128)
"""For one, two, three or four wide coordinates."""
_SPREAD = 8.0
"""The nodes reach this many standard deviations to each side of the modes."""
_STRETCH = 1.15
_STEEPEST = 1e20
"""Derivatives run away with the solution; information beyond this knows a coordinate of the cube to below 1e-10."""


@dataclass(frozen=True, kw_only=True)
class Box:
    """A box over the coordinates that stay wide.

    Attributes
    ----------
    wide : (n_wide,) integer array
        Which coordinates.
    low, high : (n_wide,) array
        Its faces, within the unit cube.
    """

    wide: Integers
    low: Floats
    high: Floats

    def shares(self, points: Floats) -> Floats:
        """Where in the box points ``(n, n_dim)`` lie, ``(n, n_wide)``: zero at the low faces, one at the high ones."""
        return np.asarray((points[:, self.wide] - self.low) / (self.high - self.low))

    def values(self, shares: Floats) -> Floats:
        """The wide coordinates ``(n, n_wide)`` at these shares."""
        return np.asarray(self.low + shares * (self.high - self.low))

    @property
    def volume(self) -> float:
        """In the unit cube."""
        return float(np.prod(self.high - self.low))


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """Coordinates in which a sheet is interpolated: logarithms of what is uniform over positive values.

    Parameters that share one scale follow powers of each other, which are planes there.

    Attributes
    ----------
    ratio : (n_dim,) array
        Upper over lower bound of each prior, less one; zero where a coordinate of the unit cube stays as it is.
    """

    ratio: Floats

    @classmethod
    def of(cls, posterior: Posterior) -> Self:
        """By the priors of a posterior."""
        space = posterior.space
        uniform = [isinstance(p.prior, Uniform) and p.prior.lower > 0.0 for p in space.parameters]
        ends = np.array([p.prior.support for p in space.parameters])
        ratio = np.zeros(posterior.n_dim)
        ratio[: len(ends)][uniform] = ends[uniform, 1] / ends[uniform, 0] - 1.0
        return cls(ratio=ratio)

    def forward(self, points: Floats, columns: Integers) -> Floats:
        """Of coordinates ``(n, m)`` of the unit cube, or beyond it; straight on below its lower face."""
        ratio = self.ratio[columns]
        logarithm = np.log1p(ratio * np.maximum(points, 0.0)) + ratio * np.minimum(points, 0.0)
        return np.asarray(np.where(ratio > 0.0, logarithm, points))

    def back(self, stretched: Floats, columns: Integers) -> Floats:
        """The inverse."""
        ratio = np.where(self.ratio[columns] > 0.0, self.ratio[columns], 1.0)
        value = (np.expm1(np.maximum(stretched, 0.0)) + np.minimum(stretched, 0.0)) / ratio
        return np.asarray(np.where(self.ratio[columns] > 0.0, value, stretched))


@dataclass(frozen=True, kw_only=True)
class Nodes:
    """Points whose rest is at its conditional optimum, and the expansion there.

    Attributes
    ----------
    points : (n, n_dim) array
        In the unit cube.
    local : Linearisation
        There, in the directions of the rest.
    box : Box
        Over the coordinates that were held.
    stretch : Stretch
        In which they are interpolated.
    """

    points: Floats
    local: Linearisation
    box: Box
    stretch: Stretch

    def interpolated(self, columns: Floats, chosen: Booleans, smoothing: float) -> Callable[[Floats], Floats]:
        """Splines through columns ``(n, m)`` at the chosen nodes, as functions of shares of the box ``(n, n_wide)``."""
        spline = surface_through(self._places(self.points[chosen][:, self.box.wide]), columns[chosen], smoothing)
        return lambda shares: np.asarray(spline(self._places(self.box.values(shares))))

    def _places(self, values: Floats) -> Floats:
        """Where in the box the wide coordinates ``(n, n_wide)`` lie once stretched."""
        low, high, own = (
            self.stretch.forward(one, self.box.wide) for one in (self.box.low[None], self.box.high[None], values)
        )
        return np.asarray((own - low) / (high - low))

    def joined(self, points: Floats, local: Linearisation) -> Nodes:
        """With further ones."""
        return replace(
            self,
            points=np.concatenate([self.points, points]),
            local=Linearisation(
                log_likelihood=np.concatenate([self.local.log_likelihood, local.log_likelihood]),
                gradient=np.concatenate([self.local.gradient, local.gradient]),
                information=np.concatenate([self.local.information, local.information]),
            ),
        )

    @property
    def alive(self) -> Booleans:
        """Which of them lie within reach of the best, or are the few best, ``(n,)``."""
        value = self.local.log_likelihood
        few = min(2 * len(self.box.wide) + 2, len(value))
        return value >= min(float(np.max(value)) - REACH, float(np.sort(value)[-few]))


def wide_coordinates(information: Floats) -> Integers:
    """Coordinates to take out: the widest, the widest given that one, and so on while one stays wide; at least one."""
    rest = list(range(len(information)))
    wide: list[int] = []
    while len(rest) > 1 and len(wide) < MOST_WIDE:
        sd = np.sqrt(np.diag(covariance_of(information[np.ix_(rest, rest)])))
        if wide and np.max(sd) < _WIDE:
            break
        wide.append(rest.pop(int(np.argmax(sd))))
    return np.array(wide)


def has_wide(information: Floats) -> bool:
    """Whether any coordinate is wide by itself: where none is, a sheet takes out next to nothing of what bends."""
    return bool(np.sqrt(np.max(np.diag(covariance_of(information)))) > _WIDE)


def first_nodes(posterior: Posterior, modes: Sequence[Mode]) -> Nodes:
    """Refit the rest at nodes over the box of the wide coordinates that the modes suggest."""
    wide = wide_coordinates(modes[0].information)
    sds = np.sqrt([np.diag(covariance_of(mode.information))[wide] for mode in modes])
    centres = np.array([mode.point[wide] for mode in modes])
    box = Box(
        wide=wide,
        low=np.clip(np.min(centres - _SPREAD * sds, axis=0), 0.0, 1.0),
        high=np.clip(np.max(centres + _SPREAD * sds, axis=0), 0.0, 1.0),
    )
    shares = qmc.Sobol(len(wide), rng=0).random(_N_NODES[len(wide) - 1])
    held = np.clip(box.values(to_the_faces(shares)), EDGE, 1.0 - EDGE)
    starts = _continued(posterior, modes, wide, held)
    points, local = refitted(posterior, np.concatenate([[mode.point for mode in modes], starts]), wide, 15)
    nodes = Nodes(points=points, local=local, box=box, stretch=Stretch.of(posterior))
    for _ in range(3):
        before, nodes = nodes, _from_neighbours(posterior, nodes)
        if nodes is before:
            break
    return nodes


def refitted(posterior: Posterior, points: Floats, wide: Integers, n_iterations: int) -> tuple[Floats, Linearisation]:
    """Climb from points ``(n, n_dim)`` with the wide coordinates held.

    Those that cannot be solved are left out, and those whose derivatives have run away.
    """
    held = np.isin(np.arange(points.shape[1]), wide)
    found, local = polish(posterior, points, n_iterations=n_iterations, held=held, reach=2.0 * REACH)
    derivatives = np.hstack([local.gradient, np.einsum("nii->ni", local.information)])
    tame = np.max(np.abs(derivatives), axis=1) < _STEEPEST
    solved = np.flatnonzero(np.isfinite(local.log_likelihood) & tame)
    return found[solved], local[solved]


def surface_through(points: Floats, values: Floats, smoothing: float) -> RBFInterpolator:
    """Thin-plate splines through values at points ``(n, n_wide)``.

    Where the points lie in a plane, say all on one face of the box, they do not fix a slope across it: then none.
    """
    planes = np.column_stack([np.ones(len(points)), points])
    if np.linalg.matrix_rank(planes) < planes.shape[1]:
        return RBFInterpolator(points, values, kernel="linear", degree=0, smoothing=smoothing)
    return RBFInterpolator(points, values, degree=1, smoothing=smoothing)


def to_the_faces(shares: Floats) -> Floats:
    """Shares of the box stretched about its centre, what lies beyond put on its faces.

    Beyond the outermost node the surface is a guess, and a narrow conditional density then misses the posterior
    without a sign: with the outer 2 % of A uncovered its mean was off by five standard errors.
    """
    return np.clip(0.5 + _STRETCH * (shares - 0.5), 0.0, 1.0)


def _from_neighbours(posterior: Posterior, nodes: Nodes) -> Nodes:
    """Climb again from the surface through the nodes alive, where that is better at once."""
    wide, every = nodes.box.wide, np.arange(nodes.points.shape[1])
    surface = nodes.interpolated(nodes.stretch.forward(nodes.points, every), nodes.alive, 1e-6)
    starts = np.clip(nodes.stretch.back(surface(nodes.box.shares(nodes.points)), every), EDGE, 1.0 - EDGE)
    starts[:, wide] = nodes.points[:, wide]
    better = posterior.log_likelihood(starts) > nodes.local.log_likelihood + 0.1
    if not np.any(better):
        return nodes
    others = np.flatnonzero(~better)
    kept = replace(nodes, points=nodes.points[others], local=nodes.local[others])
    return kept.joined(*refitted(posterior, starts[better], wide, 8))


def _continued(posterior: Posterior, modes: Sequence[Mode], wide: Integers, held: Floats) -> Floats:
    """Starts at held values ``(n, n_wide)``: the tangent at the nearest mode, straight or by powers of the held ones.

    Parameters that share one scale follow powers of each other exactly.
    """
    known = np.array([mode.point for mode in modes])
    sds = np.sqrt(np.diag(covariance_of(modes[0].information)))[wide]
    nearest = np.argmin(np.sum(np.square((held[:, None] - known[None][:, :, wide]) / sds), axis=2), axis=1)
    straight, powers = np.empty((len(held), known.shape[1])), np.empty((len(held), known.shape[1]))
    for index in np.unique(nearest):
        mine = nearest == index
        point, covariance = known[index], covariance_of(modes[index].information)
        slope = np.linalg.solve(covariance[np.ix_(wide, wide)], covariance[wide]).T
        straight[mine] = point + (held[mine] - point[wide]) @ slope.T
        value = posterior.space.from_unit(point[None])
        scale = posterior.space.unit_scale(value)[0]
        value = np.maximum(np.abs(value[0]), 1e-12) * np.where(value[0] < 0.0, -1.0, 1.0)
        exponent = np.clip(slope * scale[:, None] / scale[wide] * value[wide] / value[:, None], -4.0, 4.0)
        moved = np.tile(point, (int(np.count_nonzero(mine)), 1))
        moved[:, wide] = held[mine]
        ratio = np.abs(posterior.space.from_unit(moved)[:, wide] / value[wide])
        powers[mine] = posterior.space.to_unit(value * np.exp(np.log(np.maximum(ratio, 1e-12)) @ exponent.T))
    for starts in (straight, powers):
        starts[:] = np.clip(starts, EDGE, 1.0 - EDGE)
        starts[:, wide] = held
    better = posterior.log_likelihood(powers) > posterior.log_likelihood(straight)
    return np.where(better[:, None], powers, straight)
