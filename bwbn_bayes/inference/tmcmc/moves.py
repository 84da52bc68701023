"""Moves that leave the road's density at one tempering parameter unchanged.

They act in the coordinates of the stage's :class:`Shape`, which is fixed before the stage's chains start, so that a
proposal never depends on the chains that it moves. In those coordinates the cube has no bounds to cross.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bwbn_bayes.inference.tmcmc.coordinates import Chart, Coordinates
from bwbn_bayes.inference.tmcmc.mixture import GaussianMixture, drawn
from bwbn_bayes.inference.tmcmc.target import Floats, Integers, Reference

MOVES = ("random walk", "differential evolution", "autoregressive", "independence", "guide")
_INFLATION = 1.05
_JUMP_SHARE = 0.1
_JUMP_JITTER = 1e-3
_SMALLEST_SHARE = 0.05
_ACCEPTANCES = np.array([0.25, 0.25, 0.5])
_LARGEST_SCALES = np.array([2.0, 2.0, 1.0])


class Tuning(NamedTuple):
    """What the moves learn from one stage for the next.

    ``shares (5,)`` are the probabilities of the moves in the order of :data:`MOVES`; ``scales (3,)`` are the sizes of
    the first three: two multiply the theoretical step, the third is the share of fresh noise, at most 1.
    """

    shares: Floats
    scales: Floats


FIRST_TUNING = Tuning(np.array([0.25, 0.25, 0.25, 0.25, 0.0]), np.array([1.0, 1.0, 0.7]))
FIRST_GUIDED = Tuning(np.full(5, 0.2), FIRST_TUNING.scales)
"""Where a stage has a guide."""


class Guide(NamedTuple):
    """A density of a chart's points that is known beforehand, in the coordinates of a stage."""

    density: Reference
    chart: Chart
    coordinates: Coordinates

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Coordinates ``(n, d)`` of draws."""
        return self.coordinates.forward(self.chart.positions(self.density.sample(rng, n)))[0]

    def log_density(self, coordinates: Floats) -> Floats:
        """Log density ``(n,)`` in these coordinates."""
        points, log_volume = self.coordinates.inverse(coordinates, self.chart)
        return self.density.log_density(points) + log_volume


class Shape(NamedTuple):
    """What a stage knows of its density: coordinates, a mixture fitted in them, an archive ``(m, d)``, precision.

    And a guide, if there is one.
    """

    coordinates: Coordinates
    mixture: GaussianMixture
    archive: Floats
    precision: Floats
    guide: Guide | None = None

    @classmethod
    def of(cls, coordinates: Coordinates, mixture: GaussianMixture, archive: Floats) -> Shape:
        """The shape of a fit and its archive."""
        covariance = np.atleast_2d(np.cov(archive, rowvar=False))
        return cls(coordinates, mixture.inflated(_INFLATION), archive, np.linalg.pinv(covariance, hermitian=True))

    def squared_jumps(self, start: Floats, end: Floats) -> Floats:
        """Squared lengths ``(n,)`` of jumps between positions ``(n, d)`` in units of the archive's spread."""
        step = end - start
        lengths: Floats = np.einsum("ni,ni->n", step @ self.precision, step)
        return lengths


class Proposal(NamedTuple):
    """Proposed positions ``(n, d)`` with their log density under the fit ``(n,)``.

    For each the log ratio of backward to forward proposal density ``(n,)`` and the move that made it ``(n,)``.
    """

    positions: Floats
    log_fit: Floats
    log_asymmetry: Floats
    moves: Integers


def propose(positions: Floats, log_fit: Floats, shape: Shape, tuning: Tuning, rng: np.random.Generator) -> Proposal:
    """Propose one move for every chain, each chain drawing its kind of move anew.

    Parameters
    ----------
    positions : (n, d) array
        Present positions in the shape's coordinates.
    log_fit : (n,) array
        Log density of the shape's mixture there.
    shape : Shape
        Fixed for the stage.
    tuning : Tuning
        Fixed for the stage.
    rng : numpy.random.Generator
        The stream of this stage and step.

    References
    ----------
    .. [1] C. J. F. ter Braak, "A Markov Chain Monte Carlo version of the genetic algorithm Differential Evolution",
       2006, doi:10.1007/s11222-006-8769-1.
    .. [2] S. L. Cotter, G. O. Roberts, A. M. Stuart and D. White, "MCMC Methods for Functions: Modifying Old Algorithms
       to Make Them Faster", 2013, doi:10.1214/13-STS421 (the autoregressive move, there about the prior).
    """
    moves = drawn(tuning.shares, rng, len(positions))
    proposed, log_asymmetry = np.empty_like(positions), np.zeros(len(positions))
    for move in range(len(MOVES)):
        mine = (moves == move).nonzero()[0]
        if len(mine) == 0:
            continue
        start = positions[mine]
        if move == 0:
            proposed[mine] = _random_walk(start, shape, float(tuning.scales[0]), rng)
        elif move == 1:
            proposed[mine] = _differential_evolution(start, shape, float(tuning.scales[1]), rng)
        elif move == 2:
            proposed[mine] = _autoregressive(start, shape.mixture, float(tuning.scales[2]), rng)
        elif move == 3:
            proposed[mine] = shape.mixture.sample(rng, len(start))
        else:
            assert shape.guide is not None
            proposed[mine] = shape.guide.sample(rng, len(start))
            # From where the guide is zero no draw of it is accepted: the way back is closed.
            log_asymmetry[mine] = shape.guide.log_density(start) - shape.guide.log_density(proposed[mine])
    log_fit_proposed = shape.mixture.log_density(proposed)
    # The first two moves are symmetric, the next two reversible with respect to the fit, the last to the guide.
    by_fit = (moves == 2) | (moves == 3)
    log_asymmetry[by_fit] = (log_fit - log_fit_proposed)[by_fit]
    return Proposal(proposed, log_fit_proposed, log_asymmetry, moves)


def _random_walk(positions: Floats, shape: Shape, scale: float, rng: np.random.Generator) -> Floats:
    """Gaussian step with the covariance of a component drawn without regard to the position."""
    n, n_dim = positions.shape
    factors = shape.mixture.factors[shape.mixture.labels(rng, n)]
    step: Floats = np.einsum("nij,nj->ni", factors, rng.standard_normal((n, n_dim)))
    moved: Floats = positions + scale * 2.38 / np.sqrt(n_dim) * step
    return moved


def _differential_evolution(positions: Floats, shape: Shape, scale: float, rng: np.random.Generator) -> Floats:
    """Step along the difference of two archived positions; now and then the whole of it, from mode to mode."""
    n, n_dim = positions.shape
    first = rng.integers(len(shape.archive), size=n)
    second = (first + rng.integers(1, len(shape.archive), size=n)) % len(shape.archive)
    whole = rng.random((n, 1)) < _JUMP_SHARE
    length = np.where(whole, 1.0, scale * 2.38 / np.sqrt(2.0 * n_dim))
    jitter = _JUMP_JITTER * _random_walk(np.zeros_like(positions), shape, 1.0, rng)
    moved: Floats = positions + length * (shape.archive[first] - shape.archive[second]) + jitter
    return moved


def _autoregressive(positions: Floats, mixture: GaussianMixture, fresh: float, rng: np.random.Generator) -> Floats:
    """Shrink towards a component's mean and add a share of its noise; reversible with respect to the mixture.

    The component is drawn by its responsibility for the position. Unlike a random walk, the step need not shrink with
    the dimension where the fit is good; unlike an independent draw, it forgives a fit that is not.
    """
    parts = mixture.log_parts(positions)
    shares = np.exp(parts - parts.max(axis=0))
    levels = rng.random(len(positions)) * shares.sum(axis=0)
    labels = np.sum(np.cumsum(shares, axis=0) < levels, axis=0).clip(max=len(parts) - 1)
    means = mixture.means[labels]
    noise: Floats = np.einsum("nij,nj->ni", mixture.factors[labels], rng.standard_normal(positions.shape))
    moved: Floats = means + np.sqrt(1.0 - fresh**2) * (positions - means) + fresh * noise
    return moved


class Tally(NamedTuple):
    """Sums over a stage, one entry per move ``(5,)``: proposals, acceptances, squared jumps in whitened units."""

    proposed: Floats
    accepted: Floats
    jumped: Floats

    def add(self, moves: Integers, accepted: Floats, jumps: Floats) -> Tally:
        """Count one step: move, acceptance (0 or 1) and squared whitened jump of every chain ``(n,)``."""
        return Tally(
            self.proposed + np.bincount(moves, minlength=len(MOVES)),
            self.accepted + np.bincount(moves, accepted, minlength=len(MOVES)),
            self.jumped + np.bincount(moves, accepted * jumps, minlength=len(MOVES)),
        )

    @property
    def acceptance(self) -> float:
        """Share of all proposals that were accepted."""
        return float(np.sum(self.accepted) / np.sum(self.proposed))


EMPTY_TALLY = Tally(*np.zeros((3, len(MOVES))))


def retune(tuning: Tuning, tally: Tally) -> Tuning:
    """Learn from a finished stage: moves that travel further get more turns, steps head for their best acceptance.

    The expected squared jump distance decides, no move falling below a twentieth of the turns.

    References
    ----------
    .. [1] C. Pasarica and A. Gelman, "Adaptively scaling the Metropolis algorithm using expected squared jumped
       distance", 2010, https://www.jstor.org/stable/24308995.
    """
    turns = np.maximum(tally.proposed, 1.0)
    travelled = tally.jumped / turns + 1e-12
    there = tuning.shares > 0.0
    spare = 1.0 - np.sum(there) * _SMALLEST_SHARE
    wanted = np.where(there, _SMALLEST_SHARE + spare * travelled / np.sum(travelled[there]), 0.0)
    gain = np.clip((tally.accepted / turns)[:3] / _ACCEPTANCES - 1.0, -0.7, 0.7)
    scales = np.clip(tuning.scales * np.exp(gain), 1e-3, _LARGEST_SCALES)
    return Tuning(0.5 * (tuning.shares + wanted), np.where(tally.proposed[:3] > 0.0, scales, tuning.scales))
