"""Draw measured, as given and improved: against time for a building, cycle by cycle for a specimen."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from bwbn_bayes.parameters import Floats
from bwbn_bayes.report.canvas import IDENTIFIED, INK, SERIES, Drawing, canvas, finished, legend, mark_parts
from bwbn_bayes.report.comparison import CycleErrors, CycleLoop, Part, errors_by_cycle, loops_by_cycle
from bwbn_bayes.report.numbers import Scale, display_scale
from bwbn_bayes.report.pieces import strongest_window, thinned

MEASURED, AS_GIVEN = "#b5b2ab", SERIES[1]
"""Grey below, orange, and the improved model's blue on top."""
_COLOURS = (AS_GIVEN, IDENTIFIED)
COMPARISON = ("history_", "loops_by_cycle", "error_by_cycle")
"""How the names of these figures begin."""
MAX_CHANNELS = 3
"""Channels drawn enlarged."""
_N_COLUMNS = 3
_MARGIN = 1.25
"""Axes end at so many times the measured peak: a prediction that runs away leaves the picture."""
_MOST_ERROR = 1.5
"""Errors by cycle are drawn up to there, over the signal."""


def draw_comparison(parts: Sequence[Part]) -> tuple[Drawing, ...]:
    """Time histories of each part of a building; a specimen's loops and errors by cycle.

    Parameters
    ----------
    parts : sequence of Part
        Fitted first.
    """
    if parts[0].record.excitation_kind == "displacement":
        return _loops(loops_by_cycle(parts)), _errors(errors_by_cycle(parts))
    return tuple(_histories(part) for part in parts)


def _histories(part: Part) -> Drawing:
    """The channel that the model as given misses most, whole; below, where it errs most, up to three channels."""
    rows = part.worst_first()[:MAX_CHANNELS]
    worst = rows[0]
    error = np.nan_to_num(np.abs(part.given[worst] - part.measured[worst]), nan=0.0, posinf=0.0)
    start, end = strongest_window(part.time, [np.minimum(error, 10.0 * np.nanmax(np.abs(part.measured[worst])))])
    figure, axes = canvas(1 + len(rows), 0.6 + 1.25 * (1 + len(rows)), share_x=False)
    _history(axes[0], part, worst, (float(part.time[0]), float(part.time[-1])))
    axes[0].axvspan(start, end, color="#f1eee7", zorder=0)
    for axis, row in zip(axes[1:], sorted(rows, reverse=True), strict=True):
        _history(axis, part, row, (start, end))
    axes[-1].set_xlabel("time [s]")
    legend(figure, axes[0])
    names = ", ".join(_title(part.channels[row]) for row in rows)
    apart = " Dotted: where each record begins." if len(part.begins) > 1 else ""
    return finished(
        figure,
        f"history_{part.name}.png",
        f"{part.label.capitalize()}: measured and predicted. Top, {_title(part.channels[worst])}, which the model as "
        f"given misses most; below, enlarged, the shaded {end - start:.0f} s in which it errs most.{apart}",
        f"Time histories of {names}, measured, {' and '.join(name for name, _ in part.models)}.",
    )


def _history(axis: Axes, part: Part, row: int, window: tuple[float, float]) -> None:
    inside = (part.time >= window[0]) & (part.time <= window[1])
    time, measured = part.time[inside], part.measured[row, inside]
    drawn = thinned(measured)
    axis.plot(time[drawn], measured[drawn], color=MEASURED, linewidth=2.0, label="measured")
    for (name, values), colour in zip(part.models, _COLOURS, strict=False):
        axis.plot(time[drawn], values[row, inside][drawn], color=colour, linewidth=0.9, label=name)
    _bounded(axis, measured)
    axis.set_xlim(window)
    mark_parts(axis, part.begins)
    axis.yaxis.set_major_locator(MaxNLocator(3))
    axis.set_title(f"{_title(part.channels[row])} [{unit_of(part.channels[row])}]".capitalize())


def _loops(loops: tuple[CycleLoop, ...]) -> Drawing:
    n_rows = -(-len(loops) // _N_COLUMNS)
    figure, axes = canvas(n_rows, 0.65 + 1.3 * n_rows, _N_COLUMNS, share_x=False)
    length = Scale("mm", 1e3)  # metres of a test in a machine have too many zeros for so small panels
    strength = display_scale("N", max(float(np.abs(loop.measured).max()) for loop in loops))
    for axis, loop in zip(axes, loops, strict=False):
        _loop(axis, loop, length, strength)
    for axis in axes[len(loops) :]:
        axis.set_axis_off()
    for axis in axes[: len(loops)][::_N_COLUMNS]:
        axis.set_ylabel(f"force [{strength.unit}]")
    figure.supxlabel(f"displacement [{length.unit}]", fontsize=9.5)
    legend(figure, next((axis for axis, loop in zip(axes, loops, strict=False) if loop.band), axes[0]))
    return finished(
        figure,
        "loops_by_cycle.png",
        "Force against displacement, cycle by cycle, each in its own scale; fitted where nothing else is said."
        + (" Shaded: 90 % predictive intervals, over all explanations." if any(loop.band for loop in loops) else ""),
        "Loops of single cycles, measured and modelled: " + ", ".join(_cycle_title(loop) for loop in loops) + ".",
    )


def _loop(axis: Axes, loop: CycleLoop, length: Scale, strength: Scale) -> None:
    x = length.factor * loop.displacement
    if loop.band is not None:
        _band(axis, x, *(strength.factor * end for end in loop.band))
    axis.plot(x, strength.factor * loop.measured, color=MEASURED, linewidth=2.4, label="measured")
    names = [name for name, _ in loop.part.models]
    for name, values, colour in zip(names, loop.models, _COLOURS, strict=False):
        axis.plot(x, strength.factor * values, color=colour, linewidth=1.0, label=name)
    _bounded(axis, strength.factor * loop.measured)
    axis.xaxis.set_major_locator(MaxNLocator(3))
    axis.yaxis.set_major_locator(MaxNLocator(4))
    axis.set_title(_cycle_title(loop), color=INK if loop.part.name == "fitted" else SERIES[3], fontsize=8.5)


def _band(axis: Axes, x: Floats, low: Floats, high: Floats) -> None:
    """The intervals of each branch by itself: where branches overlap one outline around both would be hollow."""
    steps = np.sign(np.diff(x))
    turns = np.flatnonzero(steps[1:] * steps[:-1] < 0.0) + 1
    for first, last in pairwise([0, *turns.tolist(), len(x) - 1]):
        run = slice(first, last + 1)
        label = "90 % interval" if first == 0 else None
        axis.fill_between(x[run], low[run], high[run], color=IDENTIFIED, alpha=0.2, linewidth=0.0, label=label)


def _cycle_title(loop: CycleLoop) -> str:
    return loop.name + (", held out" if loop.part.name != "fitted" else "")


def _errors(found: tuple[CycleErrors, ...]) -> Drawing:
    figure, (axis,) = canvas(1, 2.6)
    top = 0.0
    for one in found:
        if one.part.name != "fitted":
            for number in one.numbers.tolist():
                axis.axvspan(number - 0.5, number + 0.5, color="#f1eee7", linewidth=0.0, zorder=0)
        for (name, _), errors, colour in zip(one.part.models, one.errors, _COLOURS, strict=False):
            drawn = np.minimum(np.nan_to_num(errors, nan=np.inf), _MOST_ERROR)
            label = name if one.part.name == "fitted" else None
            record_of = np.searchsorted([place for place, _ in one.begins], one.numbers)
            apart = (np.diff(one.numbers) > 1) | (np.diff(record_of) > 0)
            for run in np.split(np.arange(len(drawn)), np.flatnonzero(apart) + 1):
                axis.plot(one.numbers[run], 100.0 * drawn[run], "o-", color=colour, markersize=3.0, linewidth=1.0,
                          label=label if run[0] == 0 else None)  # fmt: skip
            top = max(top, float(np.max(drawn)))
    axis.set_ylim(0.0, 110.0 * top)
    axis.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    axis.set_xlabel("cycle")
    axis.set_ylabel("error [% of the rms force]")
    legend(figure, axis)
    mark_parts(axis, found[0].begins)
    held_out = " Shaded: held out." if len(found) > 1 else ""
    lost = f" Errors above {100.0 * _MOST_ERROR:.0f} % are drawn there." if top >= _MOST_ERROR else ""
    return finished(
        figure,
        "error_by_cycle.png",
        f"Error of the predicted force by cycle, rms over that of the whole record's force.{held_out}{lost}",
        "Error by cycle of the model as given and as improved.",
    )


def _bounded(axis: Axes, measured: Floats) -> None:
    """Limits of the force that the measured values set, whatever a model does."""
    known = measured[np.isfinite(measured)]
    low, high = (float(np.min(known)), float(np.max(known))) if known.size else (0.0, 0.0)
    middle, reach = 0.5 * (low + high), 0.5 * _MARGIN * max(high - low, 1e-300)
    axis.set_ylim(middle - reach, middle + reach)


def _title(channel: str) -> str:
    kind, _, number = channel.rpartition("_")
    place = "storey" if kind in ("drift", "force") else "floor"
    return f"{kind.replace('_', ' ')}, {place} {number}" if kind else channel


def unit_of(channel: str) -> str:
    """What a channel is drawn in."""
    if "acceleration" in channel:
        return "m/s²"
    if channel.startswith("velocity"):
        return "m/s"
    return "N" if channel.startswith("force") else "m"
