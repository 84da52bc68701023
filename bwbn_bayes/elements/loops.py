"""What an engineer reads off a loop: its pinch, what its cycles lose, how its two directions differ.

Pure functions of the histories of a storey's drift and force, identified or measured. The order of the samples counts,
not their time. A half cycle is large where it passes half of the largest drift; a measure is not a number where the
loop has nothing to take it from.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.cycles import HalfCycle, half_cycles

LARGE_SHARE = 0.5
"""Of the largest drift: what a half cycle must pass to count, as in the index of the columns in PROVENANCE.md."""

FULL_BULGE = 0.2
"""Of a reloading branch above its chord: half way between pinched columns and fat ones."""


READABLE_INDEX = 0.013
"""Of the pinching index: by so much, in the median, do two readings of one of 24 measured columns differ."""
READABLE_LOSS = 0.005
"""Of strength or stiffness lost per cycle: half a per cent a cycle is what repeated tests differ by."""
READABLE_ASYMMETRY = 0.01
"""Of the asymmetry of the peaks: strengths that differ by a fiftieth, as of specimens built alike on both sides."""


def pinching_index(drift: Floats, force: Floats) -> float:
    """Force at zero drift over the half cycle's peak, median over the large half cycles: 0 pinched, 1 plastic.

    A half cycle is taken here from one zero of the drift to the next, and its force where it ends, on unloading,
    linearly in drift between the samples on both sides: of the ways to read "the force at zero displacement" the one
    that reproduces the 24 measured columns best (median difference 0.013, largest 0.065). It says little where the
    drift hardly passes yield: an elastic loop has the index 0 without any pinch (:func:`reloading_bulge`).

    Parameters
    ----------
    drift : (n_times,) array
        [m]
    force : (n_times,) array
        [N]

    Returns
    -------
    float
        Not a number where the drift never comes back through zero.
    """
    least = LARGE_SHARE * float(np.max(np.abs(drift)))
    moved = np.flatnonzero(drift)
    crossed = np.flatnonzero(drift[moved[:-1]] * drift[moved[1:]] < 0.0)
    ratios, first = [], 0
    for before, after in zip(moved[crossed], moved[crossed + 1], strict=True):
        excursion = slice(first, before + 1)
        if float(np.max(np.abs(drift[excursion]))) >= least:
            share = drift[before] / (drift[before] - drift[after])
            at_zero = force[before] + share * (force[after] - force[before])
            ratios.append(_ratio(abs(at_zero), float(np.max(np.abs(force[excursion])))))
        first = after
    return _median(ratios)


def reloading_bulge(drift: Floats, force: Floats) -> float:
    """How far the reloading branch bulges above its chord, median over the large half cycles: -1 to 1.

    The chord runs from zero force to the half cycle's end; the bulge is the area between branch and chord over that
    below the chord: 1 for a rigid-plastic loop, 0 for an elastic one, negative where the branch sags, as a pinched one
    does. Unlike :func:`pinching_index` it tells a pinch from an elastic loop.

    Parameters
    ----------
    drift : (n_times,) array
        [m]
    force : (n_times,) array
        [N]

    Returns
    -------
    float
        Above 1 where the force falls before the drift ends; not a number where no branch begins at zero force.
    """
    bulges = []
    for cycle in large_half_cycles(drift):
        u, f = cycle.direction * drift[cycle.samples], cycle.direction * force[cycle.samples]
        opposed = np.flatnonzero(f <= 0.0)
        if len(opposed) == 0 or opposed[-1] == len(f) - 1:
            continue
        last = opposed[-1]
        start = u[last] - f[last] * (u[last + 1] - u[last]) / (f[last + 1] - f[last])
        u, f = np.append(start, u[last + 1 :]), np.append(0.0, f[last + 1 :])
        bulges.append(_ratio(float(np.trapezoid(f, u)), 0.5 * f[-1] * (u[-1] - start)) - 1.0)
    return _median(bulges)


def is_full(drift: Floats, force: Floats, *, index: float) -> bool:
    """Whether nobody would call a loop ``(n_times,)`` [m], [N] pinched: by its index, and by its reloading branch.

    The pinching index of such a loop is above ``index`` and its reloading branch bulges by more than a fifth above the
    chord. Of the 24 measured columns all 12 fat ones do (index from 0.50, bulge from 0.23) and no pinched one does (to
    0.20; bulge to 0.07, but for one of few points). A loop that cannot be judged is not full.
    """
    return pinching_index(drift, force) > index and reloading_bulge(drift, force) > FULL_BULGE


def strength_lost_per_cycle(drift: Floats, force: Floats) -> float:
    """Share of the force that a cycle loses, median over pairs of successive large half cycles of one direction.

    The two forces are those on the way out at the drift that both reach. Where an amplitude is repeated this compares
    the peaks; where amplitudes grow, as in an earthquake, it compares the peak on the envelope with the force that the
    next cycle has there.

    Parameters
    ----------
    drift : (n_times,) array
        [m]
    force : (n_times,) array
        [N]

    Returns
    -------
    float
        Negative where the force grows; not a number with fewer than two such half cycles.
    """
    lost = []
    for first, second in _successive(drift):
        reached = min(first.amplitude, second.amplitude)
        one, other = (_force_at(reached, cycle, drift, force) for cycle in (first, second))
        lost.append(1.0 - _ratio(other, one))
    return _median(lost)


def stiffness_lost_per_cycle(drift: Floats, force: Floats) -> float:
    """Share of the unloading stiffness that a cycle loses, median over pairs as in :func:`strength_lost_per_cycle`.

    The stiffness is that of the line from the half cycle's end to where the force has gone to zero. The stiffness
    from peak to peak would at equal amplitudes lose what the strength loses, and at growing ones whatever yields.

    Parameters
    ----------
    drift : (n_times,) array
        [m]
    force : (n_times,) array
        [N]

    Returns
    -------
    float
        Negative where the stiffness grows; not a number with fewer than two such half cycles.
    """
    pairs = [[_unloading_stiffness(cycle, drift, force) for cycle in pair] for pair in _successive(drift)]
    return _median([1.0 - _ratio(second, first) for first, second in pairs])


def peak_asymmetry(drift: Floats, force: Floats) -> float:
    """``(F+ - F-) / (F+ + F-)`` of the forces at the drift that two successive half cycles both reach, median.

    Parameters
    ----------
    drift : (n_times,) array
        [m]
    force : (n_times,) array
        [N]

    Returns
    -------
    float
        Of the pairs that reach half of what the largest of them reaches. Positive where the positive direction is the
        stronger one; not a number where the drift stays on one side.
    """
    cycles = half_cycles(drift)
    pairs = list(pairwise(cycles))
    reached = [min(first.amplitude, second.amplitude) for first, second in pairs]
    found = []
    for (first, second), at in zip(pairs, reached, strict=True):
        if at > 0.0 and at >= LARGE_SHARE * max(reached):
            one, other = (abs(_force_at(at, cycle, drift, force)) for cycle in (first, second))
            found.append(first.direction * _ratio(one - other, one + other))
    return _median(found)


def large_half_cycles(drift: Floats) -> tuple[HalfCycle, ...]:
    """The half cycles of a drift history ``(n_times,)`` [m] that pass half of its largest."""
    least = LARGE_SHARE * float(np.max(np.abs(drift)))
    return tuple(cycle for cycle in half_cycles(drift) if cycle.amplitude > 0.0 and cycle.amplitude >= least)


def _successive(drift: Floats) -> list[tuple[HalfCycle, HalfCycle]]:
    """Pairs of large half cycles of one direction, one after the other."""
    large = large_half_cycles(drift)
    sides = [[cycle for cycle in large if cycle.direction == direction] for direction in (1, -1)]
    return [pair for side in sides for pair in pairwise(side)]


def _force_at(reached: float, cycle: HalfCycle, drift: Floats, force: Floats) -> float:
    """Force in the half cycle's direction where it last passes a drift on its way out; NaN where it starts beyond."""
    u, f = cycle.direction * drift[cycle.samples], cycle.direction * force[cycle.samples]
    short = np.flatnonzero(u <= reached)
    if len(short) == 0:
        return np.nan
    last = short[-1]
    if last == len(u) - 1:
        return float(f[last])
    return float(f[last] + (reached - u[last]) * (f[last + 1] - f[last]) / (u[last + 1] - u[last]))


def _unloading_stiffness(cycle: HalfCycle, drift: Floats, force: Floats) -> float:
    """Secant stiffness [N/m] from the end of a half cycle to zero force; NaN where the force never gets there."""
    u, f = drift[cycle.last :], cycle.direction * force[cycle.last :]
    gone = np.flatnonzero(f <= 0.0)
    if len(gone) == 0 or gone[0] == 0:
        return np.nan
    i = gone[0]
    at_zero = u[i - 1] + f[i - 1] * (u[i] - u[i - 1]) / (f[i - 1] - f[i])
    return _ratio(f[0], cycle.direction * (u[0] - at_zero))


def _ratio(part: float, whole: float) -> float:
    """A quotient, NaN where the whole is not positive."""
    return float(part / whole) if whole > 0.0 else np.nan


def _median(values: list[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.median(known)) if known else np.nan
