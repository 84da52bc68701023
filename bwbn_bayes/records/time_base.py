"""The uniform time step behind times that were printed, and so rounded.

A time printed in steps of ``q`` says that the true one lies within ``q``, however it was rounded. All of them together
leave an interval of time steps; inside it the digits cannot choose, and the roundest step or sampling rate is taken.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction

import numpy as np

from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Floats

CLOCK_JITTER = 1e-3
"""Largest departure of a sample from a uniform time base beyond the rounding of printed times, in time steps."""

LOGGER_RATES = (
    *(1.0, 1.024, 1.2, 1.25, 1.28, 1.5, 1.6, 2.0, 2.048, 2.4, 2.5, 2.56, 3.0, 3.2, 4.0, 4.096, 4.8, 5.0, 5.12),
    *(6.0, 6.25, 6.4, 7.5, 8.0, 8.192, 9.6),
)
"""Sampling rates that loggers offer, over powers of ten: 1, 2, 5 and their halves, multiples of 3, powers of two."""

LEAST_LONG_STEPS = 3
"""Where times are printed no finer than about a step, a few longer steps are samples that are missing; from so many
evenly placed ones on, they are rounding."""


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where columns come from, for error messages: the file, its header, and the place of a row (from 0)."""

    file: str
    header: str
    place: Callable[[int], str]


_MOST_DECADES = 300
"""Of a step: a number of double precision has no more."""


def printed_quantum(cells: Sequence[str]) -> float:
    """Smallest step a column of printed numbers resolves, from its decimals and significant digits."""
    parts = [Decimal(cell.strip()).as_tuple() for cell in cells]
    decimals = max(-int(part.exponent) for part in parts)
    # Six digits are what %g prints: fewer mean short numbers, not rounding to significant digits.
    significant = max(6, *(len(part.digits) for part in parts))
    leading = max((len(part.digits) + int(part.exponent) for part in parts if any(part.digits)), default=-decimals)
    return 10.0 ** min(max(-decimals, leading - significant), _MOST_DECADES)


def stored_quantum(values: Floats) -> float:
    """Smallest step of numbers that a program stores: they may have been rounded before they were stored."""
    return printed_quantum([repr(value) for value in values.tolist()]) if values.size else 0.0


def uniform_step(times: Floats, quantum: float, stated: float | None, source: Source) -> float:
    """Time step of times that are uniform but for their rounding.

    Parameters
    ----------
    times : (n_times,) array
        As printed. [s]
    quantum : float
        Smallest step of the printing. [s]
    stated : float, optional
        What the file states its step to be; taken where the times allow it. [s]
    source : Source
        Names file and row in error messages.

    Raises
    ------
    UserError
        If the times are not uniform, or not with the step that is stated.
    """
    resolution = quantum + 8.0 * float(np.spacing(np.max(np.abs(times))))
    slope = float(times[-1] - times[0]) / (len(times) - 1)
    loose = resolution + 2.0 * CLOCK_JITTER * abs(slope)
    low, high = step_interval(times, resolution)
    if not (0.0 < low <= high and _evenly_rounded(times, quantum)):
        _require_even_steps(times, quantum, source)
        resolution = loose
        low, high = step_interval(times, resolution)
        if not 0.0 < low <= high:
            raise _drifting(times, slope, source)
    if stated is None:
        return roundest_step(times, resolution)
    low, high = step_interval(times, loose)
    if not low <= stated <= high:
        raise UserError(
            f"{source.file}, column time: the time_step is stated as {stated:g} s but the times step by {slope:.6g} s, "
            "correct one of them"
        )
    return stated


def step_interval(times: Floats, resolution: float) -> tuple[float, float]:
    """Smallest and largest step of a uniform time base from which no time departs by more than the resolution.

    They are the extreme values of ``(t_j - t_i -+ resolution) / (j - i)`` over all pairs, found by Dinkelbach's
    iteration; where the first exceeds the second, no uniform time base will do.

    References
    ----------
    .. [1] W. Dinkelbach, "On Nonlinear Fractional Programming", Management Science 13(7), 1967,
       doi:10.1287/mnsc.13.7.492.
    """
    low = _largest_ratio(times, resolution)
    return low, -_largest_ratio(-times, resolution)


def _largest_ratio(times: Floats, resolution: float) -> float:
    index = np.arange(len(times), dtype=np.float64)
    ratio = float(times[-1] - times[0] - resolution) / (len(times) - 1)
    for _ in range(len(times)):
        level = times - ratio * index
        lowest = np.minimum.accumulate(level)
        last = 1 + int(np.argmax(level[1:] - lowest[:-1]))
        first = int(np.argmin(level[:last]))
        better = float(times[last] - times[first] - resolution) / (last - first)
        if not better > ratio:
            break
        ratio = better
    return ratio


def roundest_step(times: Floats, resolution: float) -> float:
    """The roundest step that times allow: of one digit, or of a logger's rate, else the fewest digits of step or rate.

    At the bounds of the interval two samples are rounded by half a digit, one up and one down. That is told of a time
    base that starts at its first printed time; of another it would be a strange chance.
    """
    low, high = step_interval(times, resolution)
    middle = 0.5 * (low + high)

    def stands(step: float) -> bool:
        from_first = times - times[0] - step * np.arange(len(times), dtype=np.float64)
        most, least = float(np.max(from_first)), float(np.min(from_first))
        inside = most - least <= resolution * (1.0 - 1e-6)
        return inside or (most - least <= resolution * (1.0 + 1e-6) and abs(most + least) <= 1e-3 * resolution)

    rates = _logger_rates(1.0 / (high + 1e-9 * high), 1.0 / (low - 1e-9 * high))
    usual = [step for step in (float(f"{middle:.0e}"), *map(_step_of, rates)) if stands(step)]
    if usual:
        return min(usual, key=lambda step: (min(_digits(step), _digits(1.0 / step)), abs(step - middle)))
    for digits in range(17):
        step, rate = float(f"{middle:.{digits}e}"), float(f"{1.0 / middle:.{digits}e}")
        found = [each for each in (step, _step_of(rate)) if stands(each)]
        if found:
            return min(found, key=lambda each: abs(each - middle))
    return middle


def _step_of(rate: float) -> float:
    # By way of fractions: 51.2 and its like are no doubles, and their reciprocals would be a digit off.
    return float(1 / Fraction(repr(rate)))


def _logger_rates(least: float, most: float) -> list[float]:
    decades = range(math.floor(math.log10(least)) - 1, math.floor(math.log10(most)) + 2)
    rates = (float(f"{mantissa!r}e{decade}") for decade in decades for mantissa in LOGGER_RATES)
    return [rate for rate in rates if least <= rate <= most]


def _digits(value: float) -> int:
    # Twelve digits: the reciprocal of a reciprocal may end in a stray one.
    return len(Decimal(f"{value:.11e}").normalize().as_tuple().digits)


def _evenly_rounded(times: Floats, quantum: float) -> bool:
    """Whether longer steps are as evenly placed as rounding places them, and not samples that are missing.

    Where times are printed no finer than half a step, a missing sample can hide in the rounding; there, the longer
    steps must be several.
    """
    steps = np.diff(times)
    typical = float(np.median(steps))
    if quantum <= 0.5 * typical:
        return True
    counts = np.rint(steps / quantum)
    unusual = int(np.count_nonzero(counts != np.median(counts)))
    return unusual == 0 or unusual >= LEAST_LONG_STEPS


def _require_even_steps(times: Floats, quantum: float, source: Source) -> None:
    steps = np.diff(times)
    typical = float(np.median(steps))
    if typical <= 0.0:
        row = int(np.argmax(steps <= 0.0)) + 1
        raise UserError(
            f"{source.file}, {source.place(row)}, column time: {times[row]:.10g} s does not come after "
            f"{times[row - 1]:.10g} s, give a uniform time base with enough decimals"
        )
    # Half a step bounds the allowance, so that a dropped or doubled sample shows however coarsely times are printed.
    allowed = min(quantum, 0.5 * typical) + CLOCK_JITTER * typical
    uneven = np.flatnonzero(np.abs(steps - typical) > allowed)
    if uneven.size:
        row = int(uneven[0]) + 1
        raise UserError(
            f"{source.file}, {source.place(row)}, column time: the step is {steps[row - 1]:.6g} s where the others are "
            f"{typical:.6g} s, resample to a uniform time base"
        )


def _drifting(times: Floats, slope: float, source: Source) -> UserError:
    departure = times - times[0] - slope * np.arange(len(times), dtype=np.float64)
    row = int(np.argmax(np.abs(departure)))
    return UserError(
        f"{source.file}, {source.place(row)}, column time: the times drift {abs(departure[row]):.3g} s from a uniform "
        f"time base of {slope:.6g} s, resample to a uniform time base"
    )
