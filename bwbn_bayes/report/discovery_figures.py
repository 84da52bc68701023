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

from bwbn_bayes.discovery.unexplained import MissingForce
from bwbn_bayes.report.canvas import (
    DASHES,
    IDENTIFIED,
    INK,
    SERIES,
    STYLE,
    Drawing,
    canvas,
    finished,
    legend,
)
from bwbn_bayes.report.content import shown
from bwbn_bayes.report.discovery_content import (
    MAX_STOREYS,
    DiscoveryContent,
    GapBar,
    HeatMap,
    LoopPair,
    PlaneMap,
    StepContent,
)
from bwbn_bayes.report.marginals import draw_posterior
from bwbn_bayes.report.numbers import MINUS, Scale, display_scale

GIVEN = "#a8a49b"
"""The model as given."""
NEVER = "#e9e7e2"
"""States in which the storey never was."""
RESIDUAL_MAP, FORCE_MAP = "YlOrBr", "RdBu_r"
_LEAST_TOP = 3.0
"""The darkest colour is at least this many times the noise, so that noise looks pale."""
_LINEAR_TO = 10.0
"""Log odds are drawn linearly up to this, logarithmically beyond. [nat]"""


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
    forces = content.unexplained.forces if content.unexplained is not None else ()
    with mpl.rc_context(STYLE):
        drawings = [
            _gap(content.gaps),
            _by_time(content.by_time),
            _by_state(content.by_state),
            _loops(content.loops),
            *(
                figure
                for step in content.steps
                for figure in (_candidates(step, content.threshold), _survival(step, content.threshold))
            ),
            draw_posterior(content.new_marginals),
            _missing_force(forces),
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


def _odds_axis(axis: Axes, values: Sequence[float], threshold: float) -> None:
    """Linear up to 10, logarithmic beyond: log odds run from a few below zero to tens of thousands."""
    axis.set_xscale("symlog", linthresh=_LINEAR_TO, linscale=1.0)
    low, high = min(*values, 0.0), max(*values, 2.0 * threshold)
    axis.set_xlim(2.0 * low - 2.0 if low < 0.0 else -2.0, 4.0 * high if high > _LINEAR_TO else 1.3 * high)
    ticks = [
        t
        for t in (-1e5, -1e4, -1e3, -100, -10, 0, 10, 100, 1e3, 1e4, 1e5)
        if axis.get_xlim()[0] <= t <= axis.get_xlim()[1]
    ]
    axis.set_xticks(ticks, [f"{t:g}".replace("-", MINUS).replace("e+0", "e") for t in ticks])
    axis.minorticks_off()
    axis.axvline(threshold, color=INK, linewidth=0.9, dashes=DASHES)
    axis.set_xlabel("log odds against the present model [nat]")
    axis.grid(visible=False, axis="y")
    axis.tick_params(length=0, axis="y")


def _candidates(step: StepContent, threshold: float) -> Drawing | None:
    if not step.bars:
        return None
    figure, (axis,) = canvas(1, 0.75 + 0.27 * len(step.bars))
    for row, bar in enumerate(reversed(step.bars)):
        colour = IDENTIFIED if bar.chosen else GIVEN
        axis.barh(row, bar.log_odds, height=0.6, color=colour)
        axis.errorbar(bar.log_odds, row, xerr=bar.se, color=INK, linewidth=0.9, capsize=2.0)
    axis.set_yticks(
        range(len(step.bars)), [_short(bar.label) + ("" if bar.sampled else " *") for bar in reversed(step.bars)]
    )
    _odds_axis(axis, [bar.log_odds for bar in step.bars], threshold)
    more = (
        f"The best {len(step.bars)} of {step.n_weighed}."
        if step.n_weighed > len(step.bars)
        else "All that were weighed."
    )
    blue = " Blue: the one that was named." if any(bar.chosen for bar in step.bars) else ""
    star = "" if all(bar.sampled for bar in step.bars) else " *: Laplace's approximation, the others by sampling."
    return finished(
        figure,
        f"candidates_{step.number}.png",
        f"{more} Error bars: one standard error; dashed: the {threshold:g} that a name must exceed.{blue}{star} Linear "
        f"up to {_LINEAR_TO:g}, logarithmic beyond.",
        f"Log odds of the candidates of step {step.number}; best {step.bars[0].label}, {step.bars[0].log_odds:.1f}.",
    )


def _short(label: str) -> str:
    return (
        label.replace("_", " ")
        .replace(", storey ", ", st. ")
        .replace(", storeys ", ", st. ")
        .replace(", floor ", ", fl. ")
    )


def _survival(step: StepContent, threshold: float) -> Drawing | None:
    if not step.survivals:
        return None
    figure, (axis,) = canvas(1, 1.0 + 0.27 * len(step.survivals))
    markers, colours = ("o", "<", ">"), (INK, SERIES[1], SERIES[2])
    rows = np.arange(len(step.survivals))[::-1]
    for column, (width, marker, colour) in enumerate(zip(step.widths, markers, colours, strict=False)):
        odds = [survival.log_odds[column] for survival in step.survivals]
        axis.plot(odds, rows, marker, color=colour, markersize=5, label=width, alpha=0.9)
    axis.set_yticks(rows, [_short(survival.name) for survival in step.survivals])
    axis.set_ylim(-0.6, len(step.survivals) - 0.4)
    _odds_axis(axis, [odds for survival in step.survivals for odds in survival.log_odds], threshold)
    axis.grid(visible=True, axis="y")
    legend(figure, axis)
    return finished(
        figure,
        f"survival_{step.number}.png",
        "Does the name survive other priors? Log odds of each effect, over all its forms and places, with the prior "
        "of its size as expected, and with a Cauchy prior ten times narrower and ten times wider.",
        f"Log odds by effect under three widths of the priors, step {step.number}.",
    )


def _missing_force(forces: tuple[MissingForce, ...]) -> Drawing | None:
    if not forces:
        return None
    chosen = [forces[i] for i in shown(range(len(forces)), MAX_STOREYS)]
    figure, axes = canvas(len(chosen), 0.5 + 2.2 * len(chosen), share_x=False)
    length = display_scale("m", max(float(force.drift[-1]) for force in chosen))
    strength = display_scale("N", max(float(np.nanmax(np.abs(force.force))) for force in chosen))
    peak = strength.factor * max(float(np.nanmax(np.abs(force.force))) for force in chosen)
    norm = Normalize(vmin=-peak, vmax=peak)
    for axis, force in zip(axes, reversed(chosen), strict=True):
        drift, values = length.factor * force.drift, strength.factor * force.force
        axis.pcolormesh(drift, force.drift_rate, values.T, norm=norm, cmap=FORCE_MAP, shading="nearest")
        axis.set_facecolor(NEVER)
        axis.grid(visible=False)
        axis.set_title(f"{force.place.capitalize()}: {100.0 * force.share:.0f} % explained on unseen stretches")
        axis.set_ylabel("drift rate [m/s]")
    axes[-1].set_xlabel(f"drift [{length.unit}]")
    _colour_bar(figure, axes, norm, FORCE_MAP, f"missing force [{strength.unit}]")
    return finished(
        figure,
        "missing_force.png",
        "The force that the storeys' law lacks, measured minus modelled, as a radial basis network learned it from "
        "drift, drift rate and hysteretic displacement; grey where the storey never was.",
        "Learned missing storey force over drift and drift rate.",
    )
