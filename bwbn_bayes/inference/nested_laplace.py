"""A proposal that follows a curved sheet of the posterior: Laplace's approximation, nested in the widest coordinates.

Where the data hardly see some directions, the others' conditional optimum bends along them and no Gaussian at the mode
covers the posterior. The coordinates that stay wide, one after the other, are taken out; at nodes over their range the
rest is refitted, and between nodes its mean and Cholesky factor are interpolated::

    q(x) = q(wide) N(rest; m(wide), V(wide))

truncated to the cube and exactly normalised. Draws from it tell where it falls short: more nodes are laid there and
where it puts its mass, until the weights are even.

References
----------
.. [1] H. Rue, S. Martino and N. Chopin, "Approximate Bayesian Inference for Latent Gaussian Models by Using Integrated
   Nested Laplace Approximations", J. R. Stat. Soc. B 71, 2009, doi:10.1111/j.1467-9868.2008.00700.x.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.special import logsumexp

from bwbn_bayes.inference.identifiability import covariance_factor, covariance_of
from bwbn_bayes.inference.importance import Mixture, WeightedDraws, laplace_mixture, sample_importance
from bwbn_bayes.inference.likelihood import Linearisation, Posterior
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.sheet_nodes import (
    EDGE,
    REACH,
    Box,
    Nodes,
    first_nodes,
    refitted,
    to_the_faces,
)
from bwbn_bayes.inference.tmcmc.target import Integers
from bwbn_bayes.inference.truncated import Bend, walk
from bwbn_bayes.parameters import Booleans, Floats

_N_CELLS = (4096, 128, 32, 16)
"""Per wide coordinate, for one, two, three or four of them."""
_DEFENSIVE = 0.02
_WIDEN = 1.1
_N_BENDING = 4
_N_ROUNDS = 6
_N_PILOT = 800
_N_ADDED = 64
"""Nodes added where the weights are large, and as many where the proposal has its mass."""
_ENOUGH, _LIGHT = 0.3, 0.6
"""Share of effective draws, and Pareto shape, with which a proposal is good enough."""
_FURTHEST = 6.0
"""A mean lies no further beyond a bound. [conditional standard deviations]"""
_LOG_TWO_PI = float(np.log(2.0 * np.pi))
_TAILS = (1.5, 6.0)
"""Variance factor and degrees of freedom of its wider companion."""


@dataclass(frozen=True, kw_only=True)
class NestedLaplace:
    """Piecewise constant density over the wide coordinates, conditional truncated normal for the rest.

    Attributes
    ----------
    box : Box
        Over the coordinates that are taken out; the density is zero outside.
    order : (n_dim - n_wide,) integer array
        The rest, in the order in which they are drawn.
    mass : array of n_wide dimensions
        Probability of each cell of the box.
    surface : callable
        Maps shares of the box ``(n, n_wide)`` to means and packed factors of the rest.
    bend : Bend, optional
        Curvature of the last coordinates' optimum over the first ones of the rest.
    variance : float
        Factor on every conditional scale matrix.
    degrees : float
        Degrees of freedom of the conditional Student-t.
    """

    box: Box
    order: Integers
    mass: Floats
    surface: Callable[[Floats], Floats]
    bend: Bend | None = None
    variance: float = 1.0
    degrees: float = np.inf

    @classmethod
    def laid(cls, posterior: Posterior, nodes: Nodes) -> Self:
        """Through the nodes, with the curvature within the rest."""
        return cls.through(nodes).bent(posterior, nodes)

    @classmethod
    def through(cls, nodes: Nodes) -> Self:
        """Interpolate between nodes."""
        wide = nodes.box.wide
        rest = np.setdiff1d(np.arange(nodes.points.shape[1]), wide)
        covariance, step = _newton(nodes.local, rest)
        mean = nodes.points[:, rest] + step
        sd = np.sqrt(np.einsum("nii->ni", covariance))
        order = _drawing_order(mean[nodes.alive], sd[nodes.alive])
        factor = np.sqrt(_WIDEN) * covariance_factor(_held_back(nodes.local, rest[order]))
        diagonal = np.einsum("nii->ni", factor)
        # What Laplace's approximation leaves of the density at a node when the rest is integrated out, bounds aside.
        height = nodes.local.log_likelihood - _log_normal(nodes.points[:, rest[order]] - mean[:, order], factor)
        height = np.maximum(height - np.max(height), -1.5 * REACH)
        packed = factor / diagonal[:, :, None]
        np.einsum("nii->ni", packed)[...] = np.log(diagonal)
        drawn = rest[order]
        stretched = nodes.stretch.forward(mean[:, order], drawn)
        columns = np.hstack([stretched, packed[:, *np.tril_indices(len(rest))]])
        spline = nodes.interpolated(columns, nodes.alive, 1e-6)
        over = nodes.interpolated(height, np.full(len(height), True), 1e-4)

        def surface(shares: Floats) -> Floats:
            found = spline(shares)
            found[:, : len(drawn)] = nodes.stretch.back(found[:, : len(drawn)], drawn)
            return found

        n_cells = _N_CELLS[len(wide) - 1]
        centres = np.stack(np.meshgrid(*[(np.arange(n_cells) + 0.5) / n_cells] * len(wide), indexing="ij"), axis=-1)
        unbounded = cls(
            box=nodes.box,
            order=drawn,
            mass=np.empty([n_cells] * len(wide)),
            surface=surface,
        )
        centres = centres.reshape(-1, len(wide))
        log_mass = over(centres)
        log_mass += unbounded.log_inside(centres, log_mass > np.max(log_mass) - REACH)
        mass = np.exp(log_mass - logsumexp(log_mass))
        mass = (1.0 - _DEFENSIVE) * mass + _DEFENSIVE / mass.size
        return replace(unbounded, mass=mass.reshape(unbounded.mass.shape))

    def log_inside(self, shares: Floats, asked: Booleans) -> Floats:
        """Log probability ``(n,)`` that the rest lies within its bounds, to first order; zero where it is not asked.

        It falls off a cliff where the surface leaves the cube, which no spline between nodes can follow.
        """
        mean, factor = self._conditional(shares[asked])
        points, log_density = walk(mean, factor, np.inf, uniforms=np.full(mean.shape, 0.5))
        found = np.zeros(len(shares))
        found[asked] = _log_normal(points - mean, factor) - log_density
        return found

    def bent(self, posterior: Posterior, nodes: Nodes) -> Self:
        """With the curvature within the rest, read off at the best node.

        Over a design of the first coordinates of the rest, which fills one lane block, the later ones are refitted. It
        stays as it is where too few refits can be solved.
        """
        best = int(np.argmax(nodes.local.log_likelihood))
        point, m = nodes.points[best], min(_N_BENDING, len(self.order) - 1)
        if m < 1:
            return self
        first, later = self.order[:m], self.order[m:]
        (covariance,), (step,) = _newton(nodes.local[np.array([best])], self.order)
        mean = point[self.order] + step
        sd = np.sqrt(np.diag(covariance))[:m]
        single = [side * 1.5 * sd[i] * np.eye(m)[i] for i in range(m) for side in (-1.0, 1.0)]
        double = [1.2 * (sd[i] * np.eye(m)[i] + sd[j] * np.eye(m)[j]) for i in range(m) for j in range(i)]
        starts = np.tile(point, (len(single) + len(double), 1))
        starts[:, first] = np.clip(point[first] + np.array(single + double), EDGE, 1.0 - EDGE)
        along = np.linalg.solve(covariance[:m, :m], covariance[:m, m:])
        starts[:, later] = np.clip(mean[m:] + (starts[:, first] - mean[:m]) @ along, EDGE, 1.0 - EDGE)
        points, local = refitted(posterior, starts, np.concatenate([self.box.wide, first]), 10)
        bend = Bend(n_wide=m, coefficients=np.zeros((m * (m + 3) // 2, len(self.order))))
        if len(points) < len(bend.coefficients):
            return self
        deviations = points[:, first] - mean[:m]
        # One further Newton step tells where an optimum beyond a bound would lie, as the means do.
        _, step = _newton(local, later)
        beside = points[:, later] + step - mean[m:] - deviations @ along
        found, *_ = np.linalg.lstsq(bend.features(deviations), beside, rcond=1e-8)
        bend.coefficients[:, m:] = found
        return replace(self, bend=bend)

    def inflated(self, factor: float, degrees: float = np.inf) -> Self:
        """The same, every conditional variance times ``factor`` and the density of the wide flatter to match."""
        mass = self.mass ** (1.0 / factor)
        return replace(self, mass=mass / np.sum(mass), variance=factor * self.variance, degrees=degrees)

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draws ``(n, n_dim)``."""
        return self.transport(rng.random((n, len(self.order) + len(self.box.wide))))[0]

    def transport(self, uniforms: Floats) -> tuple[Floats, Floats]:
        """Map uniform points ``(n, n_dim)`` of the cube to draws, and give the draws' log density ``(n,)``."""
        n_wide, n_cells = len(self.box.wide), self.mass.shape[0]
        shares = np.empty((len(uniforms), n_wide))
        cells: list[Integers] = []
        for axis in range(n_wide):
            conditional = self.mass.sum(axis=tuple(range(axis + 1, n_wide)))[tuple(cells)]
            conditional = np.broadcast_to(conditional, (len(uniforms), n_cells))
            above = np.cumsum(conditional, axis=1)
            target = uniforms[:, axis] * above[:, -1]
            cell = np.minimum(np.sum(above < target[:, None], axis=1), n_cells - 1)
            row = np.arange(len(cell))
            within = np.clip(1.0 - (above[row, cell] - target) / conditional[row, cell], 0.0, 1.0)
            shares[:, axis] = (cell + within) / n_cells
            cells.append(cell)
        mean, factor = self._conditional(shares)
        ordered, log_density = walk(mean, factor, self.degrees, uniforms=uniforms[:, n_wide:], bend=self.bend)
        points = np.empty_like(uniforms)
        points[:, self.box.wide] = self.box.values(shares)
        points[:, self.order] = ordered
        return points, log_density + self._log_mass(tuple(cells))

    def log_density(self, points: Floats) -> Floats:
        """Normalised log density ``(n,)``; minus infinity outside cube and box."""
        shares = self.box.shares(points)
        inside = np.all((points >= 0.0) & (points <= 1.0), axis=1) & np.all((shares >= 0.0) & (shares <= 1.0), axis=1)
        shares = np.clip(shares, 0.0, 1.0)
        n_cells = self.mass.shape[0]
        cells = np.minimum((shares * n_cells).astype(np.int64), n_cells - 1)
        mean, factor = self._conditional(shares)
        _, log_density = walk(mean, factor, self.degrees, points=points[:, self.order], bend=self.bend)
        return np.where(inside, log_density + self._log_mass(tuple(cells.T)), -np.inf)

    def distance(self, points: Floats) -> Floats:
        """Root mean square of the rest's standardised deviations from the surface, ``(n,)``."""
        mean, factor = self._conditional(np.clip(self.box.shares(points), 0.0, 1.0))
        rest = points[:, self.order]
        if self.bend is not None:
            mean = mean + self.bend(rest[:, : self.bend.n_wide] - mean[:, : self.bend.n_wide])
        standard = np.linalg.solve(factor, (rest - mean)[:, :, None])[:, :, 0]
        return np.asarray(np.sqrt(np.mean(np.square(standard), axis=1)))

    def centred(self, rng: np.random.Generator, n: int) -> Floats:
        """Draws ``(n, n_dim)`` of the wide coordinates with the rest at its conditional mean, inside the cube."""
        points = self.sample(rng, n)
        mean, _ = self._conditional(self.box.shares(points))
        points[:, self.order] = mean
        return np.clip(points, EDGE, 1.0 - EDGE)

    def _log_mass(self, cells: tuple[Integers, ...]) -> Floats:
        return np.asarray(np.log(self.mass[cells] * self.mass.size / self.box.volume))

    def _conditional(self, shares: Floats) -> tuple[Floats, Floats]:
        d = len(self.order)
        columns = self.surface(shares)
        factor = np.zeros((len(shares), d, d))
        factor[:, *np.tril_indices(d)] = columns[:, d:]
        diagonal = np.exp(np.einsum("nii->ni", factor))
        np.einsum("nii->ni", factor)[...] = 1.0
        return columns[:, :d], np.sqrt(self.variance) * diagonal[:, :, None] * factor


class Sheet:
    """A proposal from the modes alone; once laid, a nested approximation that learns from the weights of its own draws.

    Parameters
    ----------
    posterior : Posterior
        Target.
    modes : sequence of Mode
        Its optima, best first.
    rng : numpy.random.Generator
        Random stream.

    Attributes
    ----------
    nested : NestedLaplace, optional
        The sheet, once it is laid.
    """

    def __init__(self, posterior: Posterior, modes: Sequence[Mode], rng: np.random.Generator) -> None:
        self._posterior, self._modes, self._rng = posterior, modes, rng
        self._start = laplace_mixture(modes)
        self._nodes: Nodes | None = None
        self.nested: NestedLaplace | None = None

    @property
    def proposal(self) -> Mixture:
        """What the modes alone suggest; once laid, the sheet, a wider one for its tails, and a little of that."""
        if self.nested is None:
            return self._start
        return Mixture(weights=(0.65, 0.3, 0.05), components=(self.nested, self.nested.inflated(*_TAILS), self._start))

    def lay(self) -> NestedLaplace:
        """Lay it through the modes, and refine it by pilots until their weights are even or six rounds are over."""
        self._nodes = first_nodes(self._posterior, self._modes)
        self.nested = NestedLaplace.laid(self._posterior, self._nodes)
        for _ in range(_N_ROUNDS):
            pilot = sample_importance(self._posterior, self.proposal, self._rng, effective=_N_PILOT, most=_N_PILOT)
            if pilot.effective_sample_size > _ENOUGH * len(pilot.points) and pilot.pareto_k < _LIGHT:
                break
            self.refine(pilot)
        return self.nested

    def refine(self, draws: WeightedDraws) -> None:
        """Lay nodes where draws of the proposal turned out heavy, and as many where it has its mass."""
        if self._nodes is None or self.nested is None:
            raise ValueError("lay the sheet before refining it")
        nodes, typical = self._nodes, self.nested.inflated(2.0).centred(self._rng, _N_ADDED)
        held = nodes.box.values(to_the_faces(nodes.box.shares(typical)))
        typical[:, nodes.box.wide] = np.clip(held, EDGE, 1.0 - EDGE)
        starts = np.concatenate([_heavy(draws, self._rng), typical])
        self._nodes = nodes.joined(*refitted(self._posterior, starts, nodes.box.wide, 10))
        self.nested = NestedLaplace.laid(self._posterior, self._nodes)


def _newton(local: Linearisation, coordinates: Integers) -> tuple[Floats, Floats]:
    """Covariances ``(n, m, m)`` of some coordinates and their steps ``(n, m)`` to the mean."""
    covariance = covariance_of(_held_back(local, coordinates))
    return covariance, np.einsum("nij,nj->ni", covariance, local.gradient[:, coordinates])


def _held_back(local: Linearisation, coordinates: Integers) -> Floats:
    """The information ``(n, m, m)`` on some coordinates.

    What a bound holds back can have its mean many standard deviations beyond it, where a hundredth of either between
    two nodes is worth many nats at the bound. There the information grows, with the slope kept, until it is a few.
    """
    gradient = local.gradient[:, coordinates]
    information = local.information[:, coordinates][:, :, coordinates]
    short = np.square(gradient / _FURTHEST) - np.einsum("nii->ni", information)
    np.einsum("nii->ni", information)[...] += np.maximum(short, 0.0)
    return information


def _log_normal(deviations: Floats, factor: Floats) -> Floats:
    """Log density ``(n,)`` of normals at deviations ``(n, d)`` from their means; ``factor (n, d, d)`` is Cholesky's."""
    standard = np.linalg.solve(factor, deviations[:, :, None])[:, :, 0]
    log_det = np.sum(np.log(np.einsum("nii->ni", factor)), axis=1)
    return np.asarray(-0.5 * np.sum(np.square(standard), axis=1) - log_det - 0.5 * deviations.shape[1] * _LOG_TWO_PI)


def _heavy(pilot: WeightedDraws, rng: np.random.Generator) -> Floats:
    """Draws ``(n, n_dim)`` without replacement by the root of their weights."""
    root = np.exp(0.5 * (pilot.log_weights - np.max(pilot.log_weights)))
    chances = root / np.sum(root)
    n = min(_N_ADDED, int(np.count_nonzero(chances)))
    return pilot.points[rng.choice(len(chances), n, replace=False, p=chances)]


def _drawing_order(mean: Floats, sd: Floats) -> Integers:
    """Coordinates cut by a bound first, nearest first, as GHK needs; then the widest first.

    ``mean`` and ``sd`` are ``(n_nodes, n)``; the nearest approach of any node counts.
    """
    closeness = np.min(np.minimum(mean, 1.0 - mean) / sd, axis=0)
    return np.argsort(np.where(closeness < 3.0, closeness - 1e6, -np.max(sd, axis=0)))
