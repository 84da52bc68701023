"""Half cycles of a displacement history: where it turns, how far it goes, and which amplitudes it repeats.

Nothing but the displacement enters: a cyclic test without a time column has half cycles too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Booleans, Floats

TURNING_SHARE = 0.005
"""Of the largest displacement: a smaller return is no turn. Loading protocols start at 2 % of it and more; the
digitisers and transducers of the measured tests in PROVENANCE.md are an order of magnitude finer."""
SAME_AMPLITUDE = 0.1
"""Relative difference up to which two amplitudes are the same step of a loading protocol; its steps grow by 25 % and
more (ATC-24, ISO 16670, CUREE)."""


def path_of(displacement: Floats) -> Floats:
    """How far [m] a displacement ``(n_times,)`` [m] has gone by each of its samples, there and back alike."""
    return np.concatenate([[0.0], np.cumsum(np.abs(np.diff(displacement)))])


@dataclass(frozen=True, kw_only=True)
class HalfCycle:
    """The way from one turning point of a displacement history to the next.

    Parameters
    ----------
    first, last : int
        Samples at its two ends; the last of one is the first of the next.
    direction : int
        1 where the displacement grows, -1 where it falls.
    start, target : float
        Displacement at its two ends. [m]
    """

    first: int
    last: int
    direction: int
    start: float
    target: float

    @property
    def amplitude(self) -> float:
        """How far from zero it comes in its direction, in m; zero where it turns before the origin."""
        return max(self.direction * self.target, 0.0)

    @property
    def travel(self) -> float:
        """Distance between its ends, in m."""
        return abs(self.target - self.start)

    @property
    def samples(self) -> slice:
        """Its samples, both ends included."""
        return slice(self.first, self.last + 1)


def half_cycles(displacement: Floats, threshold: float | None = None) -> tuple[HalfCycle, ...]:
    """Cut a displacement history into half cycles.

    An extreme is a turning point once the displacement has come back from it by more than the threshold, so that noise
    below it makes none. Where an extreme is held, its first sample counts. What the displacement does within the
    threshold before the first half cycle or after the last belongs to none.

    Parameters
    ----------
    displacement : (n_times,) array
        In the order of the test; its sampling may be uneven. [m]
    threshold : float, optional
        Least return. [m] 0.5 % of the largest displacement where left out; more than the noise from peak to peak.

    Returns
    -------
    tuple of HalfCycle
        In order; none where the displacement stays within the threshold.

    Raises
    ------
    UserError
        If the threshold is not positive.

    References
    ----------
    .. [1] ASTM E1049, "Standard Practices for Cycle Counting in Fatigue Analysis" (reversals; small ones omitted).
    """
    if threshold is not None and not threshold > 0.0:
        raise UserError(f"threshold is {threshold}: it must be a positive displacement, larger than its noise")
    turns = turning_points(displacement, threshold)
    ends = [float(displacement[turn]) for turn in turns]
    return tuple(
        HalfCycle(
            first=turns[i],
            last=turns[i + 1],
            direction=1 if ends[i + 1] > ends[i] else -1,
            start=ends[i],
            target=ends[i + 1],
        )
        for i in range(len(turns) - 1)
    )


def cycle_numbers(displacement: Floats) -> NDArray[np.int64]:
    """Number of the cycle, from 1, to which each sample ``(n_times,)`` of a history [m] belongs.

    A cycle is two half cycles. What comes before the first belongs to it, what comes after the last to the last.
    """
    numbers = np.ones(len(displacement), dtype=np.int64)
    for i, half in enumerate(half_cycles(displacement)):
        numbers[half.first :] = i // 2 + 1
    return numbers


def turning_points(displacement: Floats, threshold: float | None = None) -> list[int]:
    """Samples at which a history ``(n_times,)`` turns by more than ``threshold``, its first and last extremes too.

    By more than 0.5 % of the largest displacement where that is left out.
    """
    if threshold is None:
        threshold = TURNING_SHARE * float(np.max(np.abs(displacement)))
    values = np.asarray(displacement, dtype=np.float64).tolist()
    turns = []
    low = high = direction = 0
    for i, value in enumerate(values):
        high = i if value > values[high] else high
        low = i if value < values[low] else low
        if direction >= 0 and values[high] - value > threshold:
            turns.append(high)
            direction, low, high = -1, i, i
        elif direction <= 0 and value - values[low] > threshold:
            turns.append(low)
            direction, low, high = 1, i, i
    if direction != 0:
        turns.append(high if direction > 0 else low)
    return turns


def repeats(cycles: Sequence[HalfCycle], tolerance: float = SAME_AMPLITUDE) -> tuple[int, ...]:
    """How often each half cycle's amplitude has been reached just before: 0 the first time, 1 the second and so on.

    A row of repeats are half cycles of one direction, one after the other, whose amplitudes agree with that of the
    first of them. A half cycle that turns before the origin repeats nothing and ends no row.

    Parameters
    ----------
    cycles : sequence of HalfCycle
        All of a history, in order.
    tolerance : float
        Largest relative difference between equal amplitudes.

    Returns
    -------
    tuple of int
        One for each half cycle.
    """
    counts = []
    row = {1: (0.0, 0), -1: (0.0, 0)}
    for cycle in cycles:
        amplitude, count = row[cycle.direction]
        if cycle.amplitude == 0.0:
            counts.append(0)
            continue
        again = abs(cycle.amplitude - amplitude) <= tolerance * amplitude
        row[cycle.direction] = (amplitude, count + 1) if again else (cycle.amplitude, 0)
        counts.append(row[cycle.direction][1])
    return tuple(counts)


def repeated_samples(displacement: Floats) -> Booleans:
    """Which samples ``(n_times,)`` of a history [m] lie in half cycles that repeat an amplitude, see :func:`repeats`.

    A half cycle's turning point at its end is its own, that at its start belongs to the one before.
    """
    cycles = half_cycles(displacement)
    found = np.zeros(len(displacement), dtype=np.bool_)
    for cycle, count in zip(cycles, repeats(cycles), strict=True):
        found[cycle.first + 1 : cycle.last + 1] = count > 0
    return found
