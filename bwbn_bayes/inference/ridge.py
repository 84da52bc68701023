"""A proposal that follows a curved ridge of the posterior.

Where the data hardly see one direction, the others' conditional optimum bends along it and no Gaussian at the mode
covers the posterior. One coordinate is walked across its range; at each node the rest is refitted; between nodes mean
and Cholesky factor are interpolated: ``q(x) = q(coordinate) N(rest; m(coordinate), V(coordinate))``, truncated to the
cube and exactly normalised.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bwbn_bayes.inference.identifiability import INVOLVED, unseen_directions
from bwbn_bayes.inference.likelihood import Linearisation, Posterior
from bwbn_bayes.inference.modes import Mode, polish
from bwbn_bayes.inference.truncated import Bend, walk
from bwbn_bayes.parameters import Booleans, Floats

N_NODES = 16
N_WIDE = 4
_CELLS = 4096
_PRIOR_PRECISION = 12.0
_DEFENSIVE = 0.05
_REACH = 25.0
_WIDE = 0.05


@dataclass(frozen=True, kw_only=True)
class RidgeProposal:
    """Density along one coordinate, conditional truncated normal for the rest.

    Attributes
    ----------
    coordinate : int
        The coordinate that is walked.
    order : (n_dim - 1,) integer array
        The other coordinates in the order in which they are drawn.
    edges : (n_cells + 1,) array
        Cells along the coordinate, inside the unit interval.
    mass : (n_cells,) array
        Their probabilities.
    nodes : (n_nodes,) array
        Where the coordinate was held.
    means : (n_nodes, n_dim - 1) array
        Conditional locations of the rest.
    factors : (n_nodes, (n_dim - 1) n_dim / 2) array
        Lower Cholesky factors of their scale matrices, packed.
    bend : Bend
        Curvature of the others' conditional optimum over the widest coordinates.
    """

    coordinate: int
    order: NDArray[np.int64]
    edges: Floats
    mass: Floats
    nodes: Floats
    means: Floats
    factors: Floats
    bend: Bend

    @classmethod
    def along(cls, posterior: Posterior, mode: Mode, coordinate: int) -> Self:
        """Walk a coordinate through a mode, over the part of its range where the profile stays within 25 nats."""
        nodes, points, local, ends = _walk_nodes(posterior, mode, coordinate)
        rest = np.array([i for i in range(len(mode.point)) if i != coordinate])
        covariance = np.array([_covariance(info[np.ix_(rest, rest)]) for info in local.information])
        mean = points[:, rest] + np.einsum("nij,nj->ni", covariance, local.gradient[:, rest])
        sd = np.sqrt(np.einsum("nii->ni", covariance))
        order = _drawing_order(mean, sd)
        factor = np.linalg.cholesky(1.1 * covariance[:, order][:, :, order])
        packed = factor[:, *np.tril_indices(len(rest))]
        gain = 0.5 * np.einsum("ni,nij,nj->n", local.gradient[:, rest], covariance, local.gradient[:, rest])
        volume = np.sum(np.log(np.einsum("nii->ni", factor)), axis=1)
        profile = CubicSpline(nodes, local.log_likelihood + gain + volume)
        edges = np.linspace(*ends, _CELLS + 1)
        height = profile(np.clip(0.5 * (edges[1:] + edges[:-1]), nodes[0], nodes[-1]))
        mass = np.exp(height - np.max(height))
        mass = (1.0 - _DEFENSIVE) * mass / np.sum(mass) + _DEFENSIVE / _CELLS
        own = int(np.argmin(np.abs(nodes - mode.point[coordinate])))
        local_mean, local_covariance = mean[own][order], covariance[own][np.ix_(order, order)]
        return cls(
            bend=_bend(posterior, points[own], coordinate, rest[order], local_mean, local_covariance),
            coordinate=coordinate,
            order=rest[order],
            edges=edges,
            mass=mass,
            nodes=nodes,
            means=mean[:, order],
            factors=packed,
        )

    def inflated(self, factor: float) -> Self:
        """The same ridge with every conditional variance times ``factor`` and a correspondingly flatter profile."""
        mass = np.maximum(self.mass, 1e-300) ** (1.0 / factor)
        return replace(self, mass=mass / np.sum(mass), factors=np.sqrt(factor) * self.factors)

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draws ``(n, n_dim)``."""
        return self.transport(rng.random((n, len(self.order) + 1)))[0]

    def transport(self, uniforms: Floats) -> tuple[Floats, Floats]:
        """Map uniform points ``(n, n_dim)`` of the cube to draws, and give the draws' log density ``(n,)``."""
        above = np.cumsum(self.mass)
        cell = np.minimum(np.searchsorted(above, uniforms[:, 0]), len(self.mass) - 1)
        share = np.clip((uniforms[:, 0] - above[cell]) / self.mass[cell] + 1.0, 0.0, 1.0)
        width = np.diff(self.edges)[cell]
        along = self.edges[cell] + share * width
        mean, factor = self._conditional(along)
        ordered, log_density = walk(mean, factor, np.inf, uniforms=uniforms[:, 1:], bend=self.bend)
        points = np.empty_like(uniforms)
        points[:, self.coordinate] = along
        points[:, self.order] = ordered
        return points, log_density + np.log(self.mass[cell] / width)

    def log_density(self, points: Floats) -> Floats:
        """Normalised log density ``(n,)``; minus infinity outside the walked range."""
        along = points[:, self.coordinate]
        inside = np.all((points >= 0.0) & (points <= 1.0), axis=1)
        inside &= (along >= self.edges[0]) & (along <= self.edges[-1])
        cell = np.clip(np.searchsorted(self.edges, along, side="right") - 1, 0, _CELLS - 1)
        mean, factor = self._conditional(np.clip(along, self.edges[0], self.edges[-1]))
        _, log_density = walk(mean, factor, np.inf, points=points[:, self.order], bend=self.bend)
        return np.where(inside, log_density + np.log(self.mass[cell] / np.diff(self.edges)[cell]), -np.inf)

    def _conditional(self, along: Floats) -> tuple[Floats, Floats]:
        d = len(self.order)
        factor = np.zeros((len(along), d, d))
        mean, packed = self._splines
        factor[:, *np.tril_indices(d)] = packed(along)
        diagonal = np.einsum("nii->ni", factor)
        np.einsum("nii->ni", factor)[...] = np.maximum(diagonal, 1e-8)
        return mean(along), factor

    @cached_property
    def _splines(self) -> tuple[CubicSpline, CubicSpline]:
        return CubicSpline(self.nodes, self.means), CubicSpline(self.nodes, self.factors)


def ridge_coordinate(mode: Mode) -> int:
    """The coordinate to walk.

    A direction in which several parameters change together bends; one that leaves a single parameter open does not.
    So the widest open combination is taken, and of its coordinates the one that meets a bound first; without any, the
    coordinate with the largest posterior standard deviation in units of the prior's range.
    """
    for _, direction in unseen_directions(mode.information):
        if np.sum(np.abs(direction) > INVOLVED * np.max(np.abs(direction))) > 1:
            return int(np.argmax(np.abs(direction) / np.minimum(mode.point, 1.0 - mode.point)))
    return int(np.argmax(np.diag(_covariance(mode.information))))


def _covariance(information: Floats) -> Floats:
    return np.linalg.inv(information + _PRIOR_PRECISION * np.eye(len(information)))


class _Walk(NamedTuple):
    """Nodes along the coordinate with the rest refitted at each."""

    nodes: Floats
    points: Floats
    local: Linearisation
    ends: tuple[float, float]
    """Where the posterior certainly has no mass beyond; the outermost nodes lie just inside."""

    def alive(self, centre: float) -> slice:
        """The run of nodes around the centre whose profile stays within reach of the best."""
        ok = self.local.log_likelihood > np.max(self.local.log_likelihood) - _REACH
        start = int(np.argmin(np.where(ok, np.abs(self.nodes - centre), np.inf)))
        low = high = start
        while low > 0 and ok[low - 1]:
            low -= 1
        while high < len(ok) - 1 and ok[high + 1]:
            high += 1
        return slice(low, high + 1)

    def interpolated(self, nodes: Floats, part: slice) -> Floats:
        """Points at new nodes from a spline through some of the present ones."""
        points = np.clip(CubicSpline(self.nodes[part], self.points[part])(nodes), 1e-6, 1.0 - 1e-6)
        return np.asarray(points)


def _walk_nodes(posterior: Posterior, mode: Mode, coordinate: int) -> _Walk:
    """Walk out, find where the posterior ends, and place the nodes evenly between.

    The walk spans six standard deviations to each side, or the whole range where they are wide.
    """
    centre = float(mode.point[coordinate])
    sd = np.sqrt(_covariance(mode.information)[coordinate, coordinate])
    reach = 6.0 * sd if sd < _WIDE else 1.0
    low, high = (float(np.clip(centre + side * reach, 1e-6, 1.0 - 1e-6)) for side in (-1, 1))
    nodes = np.linspace(low, high, N_NODES)
    walk = _refit(posterior, coordinate, nodes, _starts(posterior, mode, coordinate, nodes), centre)
    part = walk.alive(centre)
    if part.start == 0 and part.stop == N_NODES:
        return walk
    if part.stop - part.start < 4:
        spread = 2.0 * (nodes[1] - nodes[0])
        nodes = np.linspace(max(centre - spread, low), min(centre + spread, high), N_NODES)
        walk = _refit(posterior, coordinate, nodes, _starts(posterior, mode, coordinate, nodes), centre)
        part = walk.alive(centre)
    inner, outer = _ends(posterior, coordinate, walk, part)
    nodes = np.linspace(float(inner[0]), float(inner[1]), N_NODES)
    walk = _refit(posterior, coordinate, nodes, walk.interpolated(nodes, part), centre)
    return walk._replace(ends=(float(outer[0]), float(outer[1])))


def _ends(posterior: Posterior, coordinate: int, walk: _Walk, part: slice) -> tuple[Floats, Floats]:
    """Bisect between the last node within reach and the first beyond it, at both ends at once."""
    inner = walk.nodes[[part.start, part.stop - 1]]
    outer = walk.nodes[[max(part.start - 1, 0), min(part.stop, len(walk.nodes) - 1)]]
    best = np.max(walk.local.log_likelihood)
    for _ in range(4):
        trial = 0.5 * (inner + outer)
        starts = walk.interpolated(trial, part)
        starts[:, coordinate] = trial
        _, local = polish(posterior, starts, n_iterations=8, held=_held(len(starts[0]), [coordinate]))
        ok = local.log_likelihood > best - _REACH
        inner, outer = np.where(ok, trial, inner), np.where(ok, outer, trial)
    return inner, outer


def _held(n_dim: int, coordinates: Sequence[int]) -> Booleans:
    held = np.zeros(n_dim, dtype=np.bool_)
    held[list(coordinates)] = True
    return held


def _refit(posterior: Posterior, coordinate: int, nodes: Floats, starts: Floats, centre: float) -> _Walk:
    """Refit the rest at every node: all at once, then outwards from neighbours that did better."""
    starts[:, coordinate] = nodes
    held = _held(starts.shape[1], [coordinate])
    points, local = polish(posterior, starts, n_iterations=12, held=held, reach=4.0 * _REACH)
    middle = int(np.argmin(np.abs(nodes - centre)))
    for step in range(1, len(nodes)):
        moved = [i for i in (middle - step, middle + step) if 0 <= i < len(nodes) and _behind(local, i, middle)]
        if not moved:
            continue
        starts = np.array([_extrapolated(points, nodes, i, 1 if i < middle else -1) for i in moved])
        starts[:, coordinate] = nodes[moved]
        better, found = polish(posterior, starts, n_iterations=12, held=held, reach=4.0 * _REACH)
        for position, i in enumerate(moved):
            if found.log_likelihood[position] > local.log_likelihood[i]:
                points[i] = better[position]
                for name in ("log_likelihood", "gradient", "information"):
                    getattr(local, name)[i] = getattr(found, name)[position]
    return _Walk(nodes, points, local, (float(nodes[0]), float(nodes[-1])))


def _starts(posterior: Posterior, mode: Mode, coordinate: int, nodes: Floats) -> Floats:
    """The better of two continuations of the tangent at the mode: straight, and by powers of the walked parameter.

    Parameters that share one scale follow powers of each other exactly.
    """
    covariance = _covariance(mode.information)
    slope = covariance[:, coordinate] / covariance[coordinate, coordinate]
    straight = np.clip(mode.point + np.outer(nodes - mode.point[coordinate], slope), 1e-6, 1.0 - 1e-6)
    value = posterior.space.from_unit(mode.point[None])
    scale = posterior.space.unit_scale(value)[0]
    value = np.maximum(np.abs(value[0]), 1e-12) * np.where(value[0] < 0.0, -1.0, 1.0)
    exponent = np.clip(slope * scale / scale[coordinate] * value[coordinate] / value, -4.0, 4.0)
    moved = straight.copy()
    moved[:, coordinate] = nodes
    ratio = np.abs(posterior.space.from_unit(moved)[:, coordinate] / value[coordinate])
    powers = np.clip(posterior.space.to_unit(value * ratio[:, None] ** exponent), 1e-6, 1.0 - 1e-6)
    straight[:, coordinate] = powers[:, coordinate] = nodes
    better = posterior.log_likelihood(powers) > posterior.log_likelihood(straight)
    return np.asarray(np.where(better[:, None], powers, straight))


def _extrapolated(points: Floats, nodes: Floats, i: int, inward: int) -> Floats:
    """Straight continuation through the two nodes further in, or the one where there is no second."""
    near, far = i + inward, i + 2 * inward
    point: Floats = points[near].copy()
    if 0 <= far < len(nodes):
        share = (nodes[i] - nodes[near]) / (nodes[near] - nodes[far])
        point = np.clip(point + share * (point - points[far]), 1e-6, 1.0 - 1e-6)
    return point


def _drawing_order(mean: Floats, sd: Floats) -> NDArray[np.int64]:
    """Coordinates cut by a bound first, nearest first, as GHK needs; then the widest first, as the bend needs.

    ``mean`` and ``sd`` are ``(n_nodes, n)``; the nearest approach of any node counts.
    """
    closeness = np.min(np.minimum(mean, 1.0 - mean) / sd, axis=0)
    cut = closeness < 3.0
    rank = np.where(cut, closeness - 1e6, -np.max(sd, axis=0))
    return np.argsort(rank)


def _bend(
    posterior: Posterior, point: Floats, coordinate: int, order: NDArray[np.int64], mean: Floats, covariance: Floats
) -> Bend:
    """Refit the later coordinates at a design over the first ones and read off the curvature of their optimum.

    ``mean`` and ``covariance`` belong to the coordinates ``order`` where the walked one has the value of ``point``. The
    design fills one lane block.
    """
    m = min(N_WIDE, len(order) - 1)
    wide, rest = order[:m], order[m:]
    sd = np.sqrt(np.diag(covariance))[:m]
    single = [side * 1.5 * sd[i] * np.eye(m)[i] for i in range(m) for side in (-1.0, 1.0)]
    double = [1.2 * (sd[i] * np.eye(m)[i] + sd[j] * np.eye(m)[j]) for i in range(m) for j in range(i)]
    starts = np.tile(point, (len(single) + len(double), 1))
    starts[:, wide] = np.clip(point[wide] + np.array(single + double), 1e-6, 1.0 - 1e-6)
    deviations = starts[:, wide] - mean[:m]
    straight = mean[m:] + deviations @ np.linalg.solve(covariance[:m, :m], covariance[:m, m:])
    starts[:, rest] = np.clip(straight, 1e-6, 1.0 - 1e-6)
    points, local = polish(posterior, starts, n_iterations=10, held=_held(len(point), [coordinate, *wide]))
    bend = Bend(n_wide=m, coefficients=np.zeros((m * (m + 3) // 2, len(order))))
    # One further Newton step tells where an optimum beyond a bound would lie, as the means do.
    step = [
        np.linalg.solve(info[np.ix_(rest, rest)] + _PRIOR_PRECISION * np.eye(len(rest)), gradient[rest])
        for info, gradient in zip(local.information, local.gradient, strict=True)
    ]
    optimum = points[:, rest] + np.array(step)
    found, *_ = np.linalg.lstsq(bend.features(deviations), optimum - straight, rcond=1e-8)
    bend.coefficients[:, m:] = found
    return bend


def _behind(local: Linearisation, i: int, middle: int) -> bool:
    """Whether a node lies so far below an inner neighbour within reach that its refit has probably failed."""
    inner = i + (1 if i < middle else -1)
    reach = np.max(local.log_likelihood) - _REACH
    return bool(local.log_likelihood[inner] > reach and local.log_likelihood[i] < local.log_likelihood[inner] - 5.0)
