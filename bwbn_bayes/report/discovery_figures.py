"""Draw a discovery: grey as given and measured, blue improved, one scale of blue for residual over noise."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from bwbn_bayes.discovery.outcome import UnnamedForce
from bwbn_bayes.report.canvas import (
    DASHES,
    IDENTIFIED,
    INK,
    STYLE,
    Drawing,
    canvas,
    finished,
    legend,
)
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
_LEAST_PROBABILITY = 1e-12
"""Bars of probability end there."""


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
            _gap(content.gaps),
            _by_time(content.by_time),
            _by_state(content.by_state),
            _loops(content.loops),
            _explanations(content.explanations, content.n_weighed),
            draw_posterior(content.new_marginals),
            _unnamed(content.discovery.unnamed),
        ]
    return tuple(drawing for drawing in drawings if drawing is not None)


def _gap(gaps: tuple[GapBar, ...]) -> Drawing:
    changed = any(gap.after is not None for gap in gaps)
    figure, axes = canvas(len(gaps), 0.55 + (1.15 if changed else 0.85) * len(gaps))
    reach = 118.0 * max(max(gap.before + gap.before_se, gap.after or 0.0, gap.floor) for gap in gaps)
    for axis, gap in zip(axes, gaps, strict=True):
        bars = [("as given", gap.before, gap.before_se, GIVEN)]
        bars += [] if gap.after is None else [("improved", gap.after, gap.after_se, IDENTIFIED)]
        for row, (_, value, error, colour) in enumerate(bars):
            axis.barh(row, 100.0 * value, height=0.62, color=colour)
            axis.errorbar(100.0 * value, row, xerr=100.0 * error, color=INK, linewidth=0.9, capsize=2.5)
            beyond = max(100.0 * (value + error), 100.0 * gap.floor)
            axis.text(beyond + 0.015 * reach, row, f"{100.0 * value:.3g} %", va="center")
        axis.axvline(100.0 * gap.floor, color=INK, linewidth=1.0, dashes=DASHES)
        axis.set_yticks(range(len(bars)), [name for name, *_ in bars])
        axis.set_ylim(len(bars) - 0.5, -0.5)
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


def _gap_in_words(gap: GapBar) -> str:
    after = "" if gap.after is None else f", improved {100.0 * gap.after:.1f} %"
    return f"{gap.label}: as given {100.0 * gap.before:.1f} %{after}, noise {100.0 * gap.floor:.1f} %"


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
        axis.grid(visible=False)
        axis.tick_params(length=0, axis="y")
    axes[-1].set_xlabel("time [s]")
    _colour_bar(figure, axes, norm, RESIDUAL_MAP, "residual / noise")
    return finished(
        figure,
        "where_time.png",
        f"Where they disagreed: residual of the {maps[0].what} over the noise level, by window; at 1 only noise is "
        "left.",
        f"Heat map of residual over noise by place and time; largest {float(np.nanmax(maps[0].values)):.1f} times.",
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


def _loops(loops: tuple[LoopPair, ...]) -> Drawing:
    n_columns = len(loops[0].drifts)
    figure, axes = canvas(len(loops), 0.5 + (2.0 if n_columns > 1 else 1.7) * len(loops), n_columns, share_x=False)
    length = display_scale("m", max(float(np.abs(d).max()) for loop in loops for d in loop.drifts))
    strength = display_scale("N", max(float(np.abs(f).max()) for loop in loops for f in loop.forces))
    words = ("as given", "improved")
    for row, loop in enumerate(reversed(loops)):
        pair = axes[row * n_columns : (row + 1) * n_columns]
        for axis, word, drift, force in zip(pair, words, loop.drifts, loop.forces, strict=False):
            _loop(axis, loop.measured, drift, force, length, strength)
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
        "hysteresis.png",
        (f"Grey: {loops[0].source}. " if measured else "")
        + "Blue: the model at its best fit. Measured forces stand against the model's drift.",
        "Storey force against drift, measured and modelled, " + ("before and after." if n_columns > 1 else "as given."),
    )


def _loop(
    axis: Axes, measured: np.ndarray | None, drift: np.ndarray, force: np.ndarray, length: Scale, strength: Scale
) -> None:
    x, y = length.factor, strength.factor
    if measured is not None:
        axis.plot(x * drift, y * measured, color="#bdbdbd", linewidth=1.6, label="measured")
    axis.plot(x * drift, y * force, color=IDENTIFIED, linewidth=1.0, label="model")
    axis.xaxis.set_major_locator(MaxNLocator(4))
    axis.yaxis.set_major_locator(MaxNLocator(5))


def _explanations(bars: tuple[ExplanationBar, ...], n_weighed: int) -> Drawing | None:
    if not bars:
        return None
    figure, (axis,) = canvas(1, 0.75 + 0.27 * len(bars))
    for row, bar in enumerate(reversed(bars)):
        colour = IDENTIFIED if bar.chosen else GIVEN
        axis.barh(row, max(bar.probability, _LEAST_PROBABILITY), height=0.6, left=0.0, color=colour)
    axis.set_yticks(range(len(bars)), [_short(bar.label) for bar in reversed(bars)])
    axis.set_xscale("log")
    axis.set_xlim(_LEAST_PROBABILITY, 1.0)
    axis.set_xlabel("probability")
    axis.grid(visible=False, axis="y")
    axis.tick_params(length=0, axis="y")
    more = f"The best {len(bars)} of {n_weighed}." if n_weighed > len(bars) else "All that were weighed."
    return finished(
        figure,
        "explanations.png",
        f"{more} Blue: with the effects of the improved model.",
        f"Probability of each explanation; best {bars[0].label}, {bars[0].probability:.3f}.",
    )


def _short(label: str) -> str:
    return (
        label.replace("_", " ")
        .replace(", storey ", ", st. ")
        .replace(", storeys ", ", st. ")
        .replace(", floor ", ", fl. ")
    )


def _unnamed(found: UnnamedForce | None) -> Drawing | None:
    if found is None:
        return None
    figure, (axis,) = canvas(1, 2.8)
    length = display_scale("m", float(np.abs(found.drift).max()))
    strength = display_scale("N", float(np.abs(found.force).max()))
    order = np.linspace(0.0, 1.0, len(found.drift))
    axis.scatter(length.factor * found.drift, strength.factor * found.force, c=order, cmap=ORDER_MAP, s=3.0)
    axis.set_xlabel(f"drift [{length.unit}]")
    axis.set_ylabel(f"force [{strength.unit}]")
    _colour_bar(figure, [axis], Normalize(vmin=0.0, vmax=1.0), ORDER_MAP, "share of the record")
    return finished(
        figure,
        "unnamed_force.png",
        "The force of no known law against the drift, coloured in the order of the record.",
        f"Force of no known law at {found.place} against drift.",
    )
