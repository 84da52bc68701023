"""Draw a discovery: grey as given and measured, blue improved, one scale of blue for residual over noise."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from bwbn_bayes.discovery.held_out import Prediction
from bwbn_bayes.discovery.outcome import UnnamedForce, UnnamedReading
from bwbn_bayes.records.cycles import cycle_numbers
from bwbn_bayes.records.record import Record
from bwbn_bayes.report.canvas import (
    DASHES,
    IDENTIFIED,
    INK,
    STYLE,
    Drawing,
    canvas,
    finished,
    legend,
    mark_parts,
)
from bwbn_bayes.report.comparison_figures import draw_comparison, unit_of
from bwbn_bayes.report.discovery_content import (
    DiscoveryContent,
    ExplanationBar,
    GapBar,
    HeatMap,
    LoopPair,
    PlaneMap,
)
from bwbn_bayes.report.marginals import draw_posterior
from bwbn_bayes.report.numbers import MINUS, Scale, display_scale

GIVEN = "#a8a49b"
"""The model as given."""
NEVER = "#e9e7e2"
"""States in which the storey never was."""
RESIDUAL_MAP, ORDER_MAP = "YlOrBr", "viridis"
_LEAST_TOP = 3.0
"""The darkest colour is at least this many times the noise, so that noise looks pale."""
_LEAST_PROBABILITY = 0.001
"""Less probable explanations are told by how far they are behind."""
_LABEL_WIDTH = 72
"""Characters of a line above a bar."""
_LINEAR_TO = 10.0
"""Nats are drawn linearly up to this, logarithmically beyond."""


def draw_discovery(content: DiscoveryContent) -> tuple[Drawing, ...]:
    """Draw every figure the content allows.

    Parameters
    ----------
    content : DiscoveryContent
        What :func:`~bwbn_bayes.report.discovery_content.gather_discovery` found; figures without data are left out.

    Returns
    -------
    tuple of Drawing
    """
    with mpl.rc_context(STYLE):
        drawings = [
            *draw_comparison(content.parts),
            _gap(content.gaps),
            _by_time(content.by_time),
            _by_state(content.by_state),
            _loops(content.loops, "hysteresis.png"),
            _loops(content.named_loops, "hysteresis_named.png", row=3.2),
            _explanations(content.explanations, content.n_weighed),
            draw_posterior(content.new_marginals),
            _unnamed(content.discovery.unnamed, content.discovery.record),
        ]
    return tuple(drawing for drawing in drawings if drawing is not None)


def _gap(gaps: tuple[GapBar, ...]) -> Drawing:
    changed, most = any(gap.after is not None for gap in gaps), max(len(gap.bars) for gap in gaps)
    figure, axes = canvas(len(gaps), 0.55 + (0.55 + 0.3 * most) * len(gaps))
    near = [seen.nrmse + seen.nrmse_se for gap in gaps for _, seen in gap.bars if not seen.runs_away_after]
    reach = 118.0 * max(*near, *(gap.floor for gap in gaps))
    for axis, gap in zip(axes, gaps, strict=True):
        for row, ((_, seen), colour) in enumerate(zip(gap.bars, _colours(gap), strict=True)):
            _gap_bar(axis, row, seen, gap.floor, colour, reach)
        axis.axvline(100.0 * gap.floor, color=INK, linewidth=1.0, dashes=DASHES)
        axis.set_yticks(range(len(gap.bars)), [name for name, _ in gap.bars])
        axis.set_ylim(most - 0.5, -0.5)
        axis.set_xlim(0.0, reach)
        axis.set_title(f"{gap.label.capitalize()}; noise alone (dashed) {100.0 * gap.floor:.3g} %")
        axis.grid(visible=False, axis="y")
    axes[-1].set_xlabel("error, rms over rms of the signal [%]")
    words = "the model as given and as improved" if changed else "the model as given"
    held_out = "" if len(gaps) > 1 else " No held-out record was given."
    return finished(
        figure,
        "gap.png",
        f"The gap between {words} and the record; dashed, the error that noise alone leaves. Error bars: one standard "
        f"error over time.{held_out}",
        "; ".join(_gap_in_words(gap) for gap in gaps) + ".",
    )


def _colours(gap: GapBar) -> tuple[str, ...]:
    return (GIVEN, *(IDENTIFIED,) * (len(gap.bars) - 1))


def _gap_bar(axis: Axes, row: int, seen: Prediction, floor: float, colour: str, reach: float) -> None:
    """A bar with its error; in words, and to the end, where the prediction runs away."""
    if seen.runs_away_after:
        axis.barh(row, reach, height=0.62, color=colour, hatch="//", edgecolor="white", linewidth=0.0)
        box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.5}
        axis.text(0.5 * reach, row, f"runs away after {seen.runs_away_after}", va="center", ha="center", bbox=box)
        return
    value, error = 100.0 * seen.nrmse, 100.0 * seen.nrmse_se
    axis.barh(row, value, height=0.62, color=colour)
    axis.errorbar(value, row, xerr=error, color=INK, linewidth=0.9, capsize=2.5)
    axis.text(max(value + error, 100.0 * floor) + 0.015 * reach, row, f"{value:.3g} %", va="center")


def _gap_in_words(gap: GapBar) -> str:
    told = ", ".join(f"{name} {seen.error_in_words}" for name, seen in gap.bars)
    return f"{gap.label}: {told}, noise {100.0 * gap.floor:.1f} %"


def _norm(values: Sequence[np.ndarray]) -> LogNorm:
    """Palest at the noise level; darkest at the largest ratio."""
    largest = max((float(np.nanmax(v)) for v in values if np.any(np.isfinite(v))), default=1.0)
    return LogNorm(vmin=1.0, vmax=max(_LEAST_TOP, largest), clip=True)


def _colour_bar(figure: Figure, axes: Sequence[Axes], norm: Normalize, map_name: str, label: str) -> None:
    bar = figure.colorbar(ScalarMappable(norm=norm, cmap=map_name), ax=list(axes), shrink=0.85, pad=0.02, aspect=28)
    bar.set_label(label)
    if isinstance(norm, LogNorm):
        top = float(norm.vmax or 1.0)
        steps = [t for t in (1, 1.5, 2, 3, 5, 7, 10, 20, 30, 50, 100, 200, 500, 1000) if t <= top]
        bar.set_ticks(steps if len(steps) < 6 else steps[:: -(-len(steps) // 5)])
        bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        bar.ax.minorticks_off()


def _by_time(maps: tuple[HeatMap, ...]) -> Drawing:
    n_places = len(maps[0].places)
    figure, axes = canvas(len(maps), 0.55 + (0.35 + 0.34 * n_places) * len(maps))
    norm = _norm([seen.values for seen in maps])
    for axis, seen in zip(axes, maps, strict=True):
        rows = np.arange(len(seen.places) + 1)
        axis.pcolormesh(seen.edges, rows, seen.values, norm=norm, cmap=RESIDUAL_MAP, edgecolors="white", linewidth=0.6)
        axis.set_yticks(rows[:-1] + 0.5, seen.places)
        axis.set_title(seen.title)
        mark_parts(axis, seen.begins, named=False)
        axis.grid(visible=False)
        axis.tick_params(length=0, axis="y")
    axes[-1].set_xlabel(maps[0].axis)
    _colour_bar(figure, axes, norm, RESIDUAL_MAP, "residual / noise")
    return finished(
        figure,
        "where_time.png",
        f"Where they disagreed: residual of the {maps[0].what} over the noise level, by window; at 1 only noise is "
        f"left.{' Dotted: where each record begins.' if len(maps[0].begins) > 1 else ''}",
        f"Heat map of residual over noise by place and window; largest {float(np.nanmax(maps[0].values)):.1f} times.",
    )


def _by_state(maps: tuple[PlaneMap, ...]) -> Drawing | None:
    if not maps:
        return None
    n_columns = len({seen.title.split(",")[0] for seen in maps})
    n_rows = len(maps) // n_columns
    height = 0.6 + 1.75 * n_rows if n_columns > 1 else 0.6 + 2.6 * n_rows
    figure, axes = canvas(n_rows, height, n_columns)
    norm = _norm([seen.values for seen in maps])
    edges = np.linspace(-1.0, 1.0, maps[0].values.shape[0] + 1)
    for number, (axis, seen) in enumerate(zip(axes, maps, strict=True)):
        axis.pcolormesh(edges, edges, seen.values.T, norm=norm, cmap=RESIDUAL_MAP)
        axis.set_facecolor(NEVER)
        axis.set_title(seen.title.replace(", ", ",\n") if n_columns > 1 else seen.title)
        axis.set_xticks([-1, 0, 1], [f"{MINUS}1", "0", "1"])
        axis.set_yticks([-1, 0, 1], [f"{MINUS}1", "0", "1"] if number % n_columns == 0 else [])
        axis.grid(visible=False)
    axes[(n_rows - 1) * n_columns].set_ylabel("drift rate / peak")
    axes[-1 - (n_columns - 1) // 2].set_xlabel("drift / peak")
    _colour_bar(figure, axes, norm, RESIDUAL_MAP, "residual / noise")
    return finished(
        figure,
        "where_state.png",
        "In which state they disagreed: residual storey force over the noise level, by drift and drift rate of the "
        "model. Grey: never there.",
        "Heat maps of residual over noise by drift and drift rate, storey by storey.",
    )


def _loops(loops: tuple[LoopPair, ...], name: str, *, row: float = 2.0) -> Drawing | None:
    """Storey by storey, each row so high [in]."""
    if not loops:
        return None
    n_columns = len(loops[0].drifts)
    figure, axes = canvas(len(loops), 0.5 + (row if n_columns > 1 else 1.7) * len(loops), n_columns, share_x=False)
    length = display_scale("m", max(float(np.abs(d).max()) for loop in loops for d in loop.drifts))
    strength = display_scale("N", max(float(np.abs(f).max()) for loop in loops for f in loop.forces))
    words = ("as given", "improved")
    for number, loop in enumerate(reversed(loops)):
        pair = axes[number * n_columns : (number + 1) * n_columns]
        for axis, word, drift, force in zip(pair, words, loop.drifts, loop.forces, strict=False):
            _loop(axis, loop, drift, force, length, strength)
            axis.set_title(f"{loop.title}, {word}")
        for axis in pair[1:]:
            axis.sharey(pair[0])
            axis.sharex(pair[0])
        pair[0].set_ylabel(f"force [{strength.unit}]")
    for axis in axes[-n_columns:]:
        axis.set_xlabel(f"drift [{length.unit}]")
    legend(figure, axes[-1])
    measured = any(loop.measured is not None for loop in loops)
    return finished(
        figure,
        name,
        (f"Grey: {loops[0].source}. " if measured else "")
        + "Blue: the model at its best fit. Measured forces stand against the model's drift.",
        "Storey force against drift, measured and modelled, " + ("before and after." if n_columns > 1 else "as given."),
    )


def _loop(axis: Axes, loop: LoopPair, drift: np.ndarray, force: np.ndarray, length: Scale, strength: Scale) -> None:
    x, y = length.factor, strength.factor
    for values, colour, width, label in (
        (loop.measured, "#bdbdbd", 1.6, "measured"),
        (force, IDENTIFIED, 1.0, "model"),
    ):
        if values is None:
            continue
        for number, run in enumerate(loop.runs):
            told = None if number else label
            axis.plot(x * drift[run], y * values[run], color=colour, linewidth=width, label=told)
    axis.xaxis.set_major_locator(MaxNLocator(4))
    axis.yaxis.set_major_locator(MaxNLocator(5))


def _explanations(bars: tuple[ExplanationBar, ...], n_weighed: int) -> Drawing | None:
    """How far each is behind the best, with what it consists of above its bar."""
    if not bars:
        return None
    labels = [textwrap.wrap(bar.label, _LABEL_WIDTH) for bar in bars]
    # One row for a bar with its label's last line above it, and a third for every other line.
    rows = np.cumsum([1.0 + (len(lines) - 1) / 3.0 for lines in labels]) - 1.0
    figure, (axis,) = canvas(1, 0.7 + 0.44 * (rows[-1] + 1.0))
    behind = [-bar.log_odds for bar in bars]
    axis.set_xscale("symlog", linthresh=_LINEAR_TO, linscale=1.0)
    end = max(behind[-1], _LINEAR_TO)
    for row, lines, bar, nats in zip(rows, labels, bars, behind, strict=True):
        axis.barh(row + 0.16, nats, height=0.3, color=IDENTIFIED if bar.chosen else GIVEN)
        told = f"{bar.probability:.3f}" if bar.probability >= _LEAST_PROBABILITY else f"{nats:.0f} nats behind"
        axis.annotate(told, (nats, row + 0.16), xytext=(3, 0), textcoords="offset points", va="center", fontsize=8.5)
        weight = "bold" if bar.chosen else "normal"
        text = axis.text(0.0, row - 0.08, "\n".join(lines), va="bottom", fontsize=8.5, fontweight=weight)
        text.set_in_layout(False)  # a label may reach beyond the axis, which keeps its width
    axis.set_ylim(rows[-1] + 0.5, -0.6)
    axis.set_yticks([])
    axis.set_xlim(0.0, 4.0 * end)
    ticks = [t for t in (0, 5, 10, 100, 1000, 10000, 100000) if t <= 1.2 * end]
    axis.set_xticks(ticks, [f"{t}" for t in ticks])
    axis.minorticks_off()
    axis.set_xlabel("nats behind the best")
    axis.grid(visible=False, axis="y")
    more = f"The best {len(bars)} of {n_weighed}" if n_weighed > len(bars) else "All that were weighed"
    return finished(
        figure,
        "explanations.png",
        f"{more}, with probability or nats behind. Blue: with the effects of the improved model. Linear up to "
        f"{_LINEAR_TO:.0f} nats, logarithmic beyond.",
        "Explanations and their probabilities: " + "; ".join(f"{bar.label}, {bar.probability:.3f}" for bar in bars),
    )


def _unnamed(found: UnnamedForce | UnnamedReading | None, record: Record) -> Drawing | None:
    """What has no name, against what it may be a function of."""
    if found is None:
        return None
    return _unnamed_force(found, record) if isinstance(found, UnnamedForce) else _unnamed_reading(found, record)


def _unnamed_reading(found: UnnamedReading, record: Record) -> Drawing:
    """A sensor's error against what it should show, and over time."""
    figure, (against, over) = canvas(2, 4.6)
    unit = unit_of(found.channel)
    times = record.times[record.kept]
    norm = Normalize(vmin=float(times[0]), vmax=float(times[-1]))
    against.scatter(found.shown, found.error, c=times, cmap=ORDER_MAP, norm=norm, s=3.0, linewidths=0.0)
    against.set_xlabel(f"what the model has the sensor show [{unit}]")
    over.plot(times, found.error, color=INK, linewidth=0.6)
    over.set_xlabel("time [s]")
    for axis in (against, over):
        axis.set_ylabel(f"error [{unit}]")
    _colour_bar(figure, [against], norm, ORDER_MAP, "time [s]")
    return finished(
        figure,
        "unnamed_reading.png",
        f"What {found.channel} shows beyond the motion: an error {found.function}. One line above is a sensor that "
        "bends or saturates, a fan one whose gain changes; below, what comes and goes slowly is drift.",
        f"Error of no known kind in {found.channel}; its share {100.0 * found.share:.0f} %.",
    )


def _unnamed_force(found: UnnamedForce, record: Record) -> Drawing:
    """Its force against the state that it is a function of, or the drift, coloured by time or by a specimen's cycle."""
    figure, (axis,) = canvas(1, 2.9)
    of_specimen = record.excitation_kind == "displacement"
    over = "displacement" if of_specimen else (found.over or "drift").replace("_", " ")
    length = display_scale("m/s" if found.over == "drift_rate" else "m", float(np.abs(found.state).max()))
    strength = display_scale("N", float(np.abs(found.force).max()))
    order = (cycle_numbers(record.excitation).astype(float) if of_specimen else record.times)[record.kept]
    norm = Normalize(vmin=float(order[0]), vmax=float(order[-1]))
    state, force = length.factor * found.state, strength.factor * found.force
    axis.plot(state, force, color=NEVER, linewidth=0.6, zorder=1)
    axis.scatter(state, force, c=order, cmap=ORDER_MAP, norm=norm, s=3.0, linewidths=0.0, zorder=2)
    axis.set_xlabel(f"{over} [{length.unit}]")
    axis.set_ylabel(f"force [{strength.unit}]")
    _colour_bar(figure, [axis], norm, ORDER_MAP, "cycle" if of_specimen else "time [s]")
    reading = (
        f"It is a function of the {over} alone: this is its shape."
        if found.over
        else "One line would be a spring, a loop friction; a drift of colours is a change with the damage."
    )
    return finished(
        figure,
        "unnamed_force.png",
        f"The force of no known law against the {over}. {reading}",
        f"Force of no known law at {found.place} against {over}; its share {100.0 * found.share:.0f} %.",
    )
