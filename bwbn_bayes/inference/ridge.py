"""A proposal that follows a curved ridge of the posterior.

Where the data hardly see one direction, the others' conditional optimum bends along it and no Gaussian at the mode
covers the posterior. One coordinate is walked across its range; at each node the rest is refitted; between nodes mean
and Cholesky factor are interpolated: ``q(x) = q(coordinate) N(rest; m(coordinate), V(coordinate))``, truncated to the cube
and exactly normalised.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bwbn_bayes.inference.likelihood import Linearisation, Posterior
from bwbn_bayes.inference.modes import Mode, polish
from bwbn_bayes.inference.truncated import Bend, walk
from bwbn_bayes.parameters import Floats

N_NODES = 16
N_WIDE = 4
_CELLS = 4096
_PRIOR_PRECISION = 12.0
_DEFENSIVE = 0.05


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
        nodes, points, local = _walk_nodes(posterior, mode, coordinate)
        rest = np.array([i for i in range(len(mode.point)) if i != coordinate])
        covariance = np.array([_covariance(info[np.ix_(rest, rest)]) for info in local.information])
        mean = points[:, rest] + np.einsum("nij,nj->ni", covariance, local.gradient[:, rest])
        sd = np.sqrt(np.einsum("nii->ni", covariance))
        order = np.argsort(-np.max(sd, axis=0))
        factor = np.linalg.cholesky(1.1 * covariance[:, order][:, :, order])
        packed = factor[:, *np.tril_indices(len(rest))]
        gain = 0.5 * np.einsum("ni,nij,nj->n", local.gradient[:, rest], covariance, local.gradient[:, rest])
        volume = np.sum(np.log(np.einsum("nii->ni", factor)), axis=1)
        profile = CubicSpline(nodes, local.log_likelihood + gain + volume)
        edges = np.linspace(nodes[0], nodes[-1], _CELLS + 1)
        height = profile(0.5 * (edges[1:] + edges[:-1]))
        mass = np.exp(height - np.max(height))
        mass = (1.0 - _DEFENSIVE) * mass / np.sum(mass) + _DEFENSIVE / _CELLS
        own = covariance[np.argmin(np.abs(nodes - mode.point[coordinate]))][np.ix_(order, order)]
        return cls(
            bend=_bend(posterior, mode, coordinate, rest[order], own),
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


def widest_coordinate(mode: Mode) -> int:
    """The coordinate with the largest posterior standard deviation in units of the prior's range."""
    return int(np.argmax(np.diag(_covariance(mode.information))))


def _covariance(information: Floats) -> Floats:
    return np.linalg.inv(information + _PRIOR_PRECISION * np.eye(len(information)))


def _walk_nodes(posterior: Posterior, mode: Mode, coordinate: int) -> tuple[Floats, Floats, Linearisation]:
    """Nodes along the coordinate with the rest refitted; the range shrinks once to where the posterior has mass."""
    sd = np.sqrt(_covariance(mode.information)[coordinate, coordinate])
    low, high = (float(np.clip(mode.point[coordinate] + side * 6.0 * sd, 1e-6, 1.0 - 1e-6)) for side in (-1, 1))
    for _ in range(2):
        nodes = np.linspace(low, high, N_NODES)
        points, local = _refit(posterior, mode, coordinate, nodes)
        alive = np.flatnonzero(local.log_likelihood > np.max(local.log_likelihood) - 25.0)
        first, last = max(alive[0] - 1, 0), min(alive[-1] + 1, N_NODES - 1)
        if last - first > N_NODES // 2:
            break
        low, high = float(nodes[first]), float(nodes[last])
    return nodes, points, local


def _refit(posterior: Posterior, mode: Mode, coordinate: int, nodes: Floats) -> tuple[Floats, Linearisation]:
    """Refit the rest at every node: all at once from the tangent, then outwards from neighbours that did better."""
    held = np.zeros(len(mode.point), dtype=np.bool_)
    held[coordinate] = True
    covariance = _covariance(mode.information)
    slope = covariance[:, coordinate] / covariance[coordinate, coordinate]
    points = np.clip(mode.point + np.outer(nodes - mode.point[coordinate], slope), 1e-6, 1.0 - 1e-6)
    points[:, coordinate] = nodes
    points, local = polish(posterior, points, n_iterations=12, held=held)
    centre = int(np.argmin(np.abs(nodes - mode.point[coordinate])))
    for step in range(1, N_NODES):
        moved = [i for i in (centre - step, centre + step) if 0 <= i < N_NODES and _behind(local, i, centre)]
        if not moved:
            continue
        starts = points[[i + (1 if i < centre else -1) for i in moved]].copy()
        starts[:, coordinate] = nodes[moved]
        better, found = polish(posterior, starts, n_iterations=12, held=held)
        for position, i in enumerate(moved):
            if found.log_likelihood[position] > local.log_likelihood[i]:
                points[i] = better[position]
                for name in ("log_likelihood", "gradient", "information"):
                    getattr(local, name)[i] = getattr(found, name)[position]
    return points, local


def _bend(
    posterior: Posterior, mode: Mode, coordinate: int, order: NDArray[np.int64], covariance: Floats
) -> Bend:
    """Refit the narrow coordinates at a design over the widest ones and read off the curvature of their optimum.

    ``covariance`` belongs to the coordinates ``order`` given the walked one. Fifteen design points fill one lane block.
    """
    wide, m = order[:N_WIDE], min(N_WIDE, len(order) - 1)
    sd = np.sqrt(np.diag(covariance))[:m]
    single = [side * 1.5 * sd[i] * np.eye(m)[i] for i in range(m) for side in (-1.0, 1.0)]
    double = [1.2 * (sd[i] * np.eye(m)[i] + sd[j] * np.eye(m)[j]) for i in range(m) for j in range(i)]
    slope = covariance[m:, :m] @ np.linalg.inv(covariance[:m, :m])
    starts = np.tile(mode.point, (len(single) + len(double), 1))
    starts[:, wide] = np.clip(mode.point[wide] + np.array(single + double), 1e-6, 1.0 - 1e-6)
    deviations = starts[:, wide] - mode.point[wide]
    straight = mode.point[order[m:]] + deviations @ slope.T
    starts[:, order[m:]] = np.clip(straight, 1e-6, 1.0 - 1e-6)
    held = np.zeros(len(mode.point), dtype=np.bool_)
    held[[coordinate, *wide]] = True
    points, _ = polish(posterior, starts, n_iterations=10, held=held)
    bend = Bend(n_wide=m, coefficients=np.zeros((m * (m + 3) // 2, len(order))))
    found, *_ = np.linalg.lstsq(bend.features(deviations), points[:, order[m:]] - straight, rcond=1e-8)
    bend.coefficients[:, m:] = found
    return bend


def _behind(local: Linearisation, i: int, centre: int) -> bool:
    """Whether a node lies so far below its inner neighbour that its refit has probably failed."""
    inner = i + (1 if i < centre else -1)
    return bool(local.log_likelihood[i] < local.log_likelihood[inner] - 5.0)
