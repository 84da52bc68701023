"""Draw the report's figures as PNG, headless, in one palette: measured grey, identified blue with band, true dashed."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from bwbn_bayes.report.canvas import (
    DASHES,
    IDENTIFIED,
    INK,
    MEASURED,
    SERIES,
    STYLE,
    Drawing,
    canvas,
    finished,
    legend,
)
from bwbn_bayes.report.marginals import (
    draw_chains,
    draw_learned,
    draw_pairs,
    draw_posterior,
)
from bwbn_bayes.report.numbers import Scale, display_scale, math_unit
from bwbn_bayes.report.pieces import (
    N_FIGURES,
    POSTERIOR,
    ZOOM_POINTS,
    ZOOM_S,
    Band,
    ChannelTrace,
    Content,
    Floats,
    StoreyHistory,
    StoreyLoop,
    strongest_window,
    thinned,
)

if TYPE_CHECKING:
    from bwbn_bayes.results import StageFacts


def draw_all(content: Content) -> tuple[Drawing, ...]:
    """Draw every figure the content allows, in the page's order.

    Parameters
    ----------
    content : Content
        What :func:`~bwbn_bayes.report.content.gather` found; figures without data are left out.

    Returns
    -------
    tuple of Drawing
    """
    drawings = (draw(content, number) for number in range(N_FIGURES))
    return tuple(drawing for drawing in drawings if drawing is not None)


def draw(content: Content, number: int) -> Drawing | None:
    """Draw one figure by its number on the page; None where there is nothing to draw."""
    with mpl.rc_context(STYLE):
        return _FIGURES[number](content)


def _draw_band(axis: Axes, x: Floats, band: Band, colour: str, *, mean: str, label: str = "") -> None:
    if np.any(band.lower < band.upper):
        axis.fill_between(x, band.lower, band.upper, color=colour, alpha=0.25, linewidth=0, label=label)
    axis.plot(x, band.middle, color=colour, linewidth=1.1, label=mean)


def _acceleration(content: Content) -> Drawing | None:
    if not content.traces:
        return None
    predicted = "the posterior mean with its 90 % predictive band" if content.has_bands else "the identified response"
    return finished(
        _panels(content, _whole_record),
        "acceleration.png",
        f"The whole record: measured, and {predicted}.",
        f"Measured and predicted response against {content.order}, whole record: {_places(content)}.",
    )


def _acceleration_zoom(content: Content) -> Drawing | None:
    traces = content.traces
    if not traces:
        return None
    length = ZOOM_S if content.has_time else ZOOM_POINTS
    start, end = strongest_window(traces[0].time, [trace.measured for trace in traces], length)
    stretch = content.stretch_in_words(start, end)
    return finished(
        _panels(content, lambda axis, trace: _zoomed(axis, trace, start, end)),
        "acceleration_zoom.png",
        f"The strongest part, {stretch}. Dots are samples.",
        f"Measured samples and predicted response, {stretch}: {_places(content)}.",
    )


def _residuals(content: Content) -> Drawing | None:
    if not content.traces:
        return None
    estimate = "posterior mean" if content.has_bands else "identified"
    return finished(
        _panels(content, _residual),
        "residual.png",
        f"Measured minus {estimate}. The band is 1.64 identified noise sd: nine points in ten belong inside.",
        f"Residuals against {content.order} with the band of the noise: {_places(content)}.",
    )


def _places(content: Content) -> str:
    return ", ".join(trace.title.lower() for trace in content.traces)


def _panels(content: Content, draw: Callable[[Axes, ChannelTrace], None]) -> Figure:
    traces = content.traces
    figure, axes = canvas(len(traces), 0.6 + 1.2 * len(traces))
    for axis, trace in zip(axes, reversed(traces), strict=True):
        draw(axis, trace)
        axis.set_title(f"{trace.title}, {trace.quantity}{math_unit(trace.unit)}")
        axis.yaxis.set_major_locator(MaxNLocator(5))
        axis.margins(x=0.0)
    axes[-1].set_xlabel(content.order_label)
    legend(figure, axes[0])
    return figure


def _whole_record(axis: Axes, trace: ChannelTrace) -> None:
    index = thinned(trace.measured)
    time = trace.time[index]
    axis.plot(time, trace.measured[index], color=MEASURED, linewidth=1.9, label="measured")
    _draw_band(axis, time, trace.predicted.at(index), IDENTIFIED, mean="identified", label="90 % band")


def _zoomed(axis: Axes, trace: ChannelTrace, start: float, end: float) -> None:
    inside = np.flatnonzero((trace.time >= start) & (trace.time <= end))
    time, measured = trace.time[inside], trace.measured[inside]
    _draw_band(axis, time, trace.predicted.at(inside), IDENTIFIED, mean="identified", label="90 % band")
    size = float(np.clip(500.0 / max(len(inside), 1), 2.5, 5.0))
    axis.plot(time, measured, ".", color="#777777", markersize=size, label="measured", zorder=1.5)


def _residual(axis: Axes, trace: ChannelTrace) -> None:
    residual = trace.residual
    index = thinned(residual)
    if np.isfinite(trace.noise_sd):
        half = 1.645 * trace.noise_sd
        axis.axhspan(-half, half, color=IDENTIFIED, alpha=0.14, linewidth=0, label="90 % of the noise")
    axis.plot(trace.time[index], residual[index], color="#4a4a4a", linewidth=0.7, label="residual")


def _hysteresis(content: Content) -> Drawing | None:
    loops = content.loops
    if not loops:
        return None
    n_columns = 1 if len(loops) == 1 else 2
    n_rows = -(-len(loops) // n_columns)
    figure, axes = canvas(n_rows, 0.5 + (3.2 if n_columns == 1 else 2.3) * n_rows, n_columns, share_x=False)
    strength = display_scale("N", max(float(np.abs(loop.force).max()) for loop in loops))
    for axis, loop in zip(axes, loops, strict=False):
        # Each in a unit of its own: below an isolated building drifts are a hundred times those above.
        _loop(axis, loop, display_scale("m", float(np.abs(loop.drift).max())), strength)
    for axis in axes[len(loops) :]:
        axis.set_axis_off()
    legend(figure, axes[0], axes[-1] if len(axes) > len(loops) else None)
    by = "" if content.specimen else " by the floors above (masses times accelerations)"
    measured = f"Grey: the force measured{by}. "
    part = loops[0].part
    shown = "" if part is None else f" Only the strongest part is drawn, {content.stretch_in_words(*part, digits=4)}."
    return finished(
        figure,
        "hysteresis.png",
        (measured if loops[0].measured_force is not None else "")
        + ("Blue: the posterior mean, over the loops of single draws. " if content.has_bands else "Blue: identified. ")
        + "Measured forces stand against the identified drift."
        + shown,
        ("Force" if content.specimen else "Storey force")
        + f" against drift: {', '.join(loop.place for loop in loops)}.",
    )


def _loop(axis: Axes, loop: StoreyLoop, length: Scale, strength: Scale) -> None:
    x, y = length.factor, strength.factor
    if loop.measured_force is not None:
        axis.plot(x * loop.drift, y * loop.measured_force, color="#bdbdbd", linewidth=1.8, label="measured")
    axis.plot(x * loop.drift_draws.T, y * loop.force_draws.T, color=IDENTIFIED, alpha=0.08, linewidth=1.0)
    axis.plot(x * loop.drift, y * loop.force, color=IDENTIFIED, linewidth=1.3, label="identified")
    if loop.true_drift is not None and loop.true_force is not None:
        axis.plot(x * loop.true_drift, y * loop.true_force, color=INK, linewidth=0.8, dashes=DASHES, label="true")
    axis.set_title(loop.place.capitalize())
    axis.set_xlabel(f"drift [{length.unit}]")
    axis.set_ylabel(f"force [{strength.unit}]")
    axis.xaxis.set_major_locator(MaxNLocator(4))


def _drift(content: Content) -> Drawing | None:
    histories = content.histories
    if not histories:
        return None
    figure, axes = canvas(len(histories), 0.6 + 1.2 * len(histories))
    for axis, history in zip(axes, reversed(histories), strict=True):
        length = display_scale("m", float(np.abs(history.drift.middle).max()))
        index = thinned(history.drift.middle)
        band = history.drift.at(index).times(length.factor)
        _draw_band(axis, history.time[index], band, IDENTIFIED, mean="identified", label="90 % band")
        if history.true_drift is not None:
            true = length.factor * history.true_drift[index]
            axis.plot(history.time[index], true, color=INK, linewidth=0.8, dashes=DASHES, label="true")
        axis.set_title(f"{history.place.capitalize()}, drift [{length.unit}]")
        axis.margins(x=0.0)
    axes[-1].set_xlabel(content.order_label)
    legend(figure, axes[0])
    return finished(
        figure,
        "drift.png",
        f"Drifts as the model sees them{': posterior mean and 90 % band' if content.has_bands else ''}, without noise.",
        f"Identified drift against {content.order}.",
    )


_DAMAGE = {
    "period": "the first period of the building vibrating gently about rest",
    "energy": "the work done on each hysteretic spring (stored and dissipated)",
}


def _quantities(content: Content) -> Drawing | None:
    panels = [name for name, there in (("period", content.period), ("energy", content.histories)) if there]
    if not panels:
        return None
    figure, axes = canvas(len(panels), 0.4 + 1.9 * len(panels))
    for axis, panel in zip(axes, panels, strict=True):
        if panel == "period":
            _period(axis, content)
        else:
            _energy(axis, content.histories)
        axis.margins(x=0.0)
    axes[-1].set_xlabel(content.order_label)
    return finished(
        figure,
        "quantities.png",
        f"Damage as it grows: {' and '.join(_DAMAGE[panel] for panel in panels)}."
        + (" Means with 90 % bands." if content.has_bands else ""),
        f"{' and '.join(panels).capitalize()} against {content.order}.",
    )


def _period(axis: Axes, content: Content) -> None:
    if content.period is not None:
        _draw_band(axis, content.period.time, content.period.band, IDENTIFIED, mean="period")
        axis.set_title("First period [s]")


def _energy(axis: Axes, histories: tuple[StoreyHistory, ...]) -> None:
    energy = display_scale("J", max(float(np.abs(history.energy.middle).max()) for history in histories))
    for history, colour in zip(histories, SERIES, strict=False):
        index = thinned(history.energy.middle)
        band = history.energy.at(index).times(energy.factor)
        _draw_band(axis, history.time[index], band, colour, mean=history.place)
    axis.set_title(f"Work on the hysteretic springs [{energy.unit}]")
    bottom, top = axis.get_ylim()
    axis.set_ylim(bottom, top + (0.25 if len(histories) <= 3 else 0.45) * (top - bottom))
    axis.legend(loc="upper left", ncols=3)


def _stages(stages: tuple[StageFacts, ...]) -> Drawing | None:
    candidates = (
        ("Tempering parameter", [stage.tempering_parameter for stage in stages]),
        ("Log evidence so far [nat]", [stage.log_evidence for stage in stages]),
        ("Solves so far", list(np.cumsum([stage.n_solves for stage in stages]).astype(float))),
    )
    panels = [(title, np.asarray(y)) for title, y in candidates if np.isfinite(y).sum() > 1 and np.nanstd(y) > 0.0][:2]
    if not panels:
        return None
    figure, axes = canvas(len(panels), 0.4 + 1.4 * len(panels))
    numbers = np.array([stage.stage for stage in stages])
    # A road that begins anew is another run.
    begins = np.flatnonzero(np.diff([stage.tempering_parameter for stage in stages]) < 0.0) + 1
    for axis, (title, values) in zip(axes, panels, strict=True):
        for own, run in zip(np.split(numbers, begins), np.split(values, begins), strict=True):
            axis.plot(own, run, "o-", color=IDENTIFIED, markersize=4, linewidth=1.1)
        axis.set_title(title)
        if title.startswith("Tempering") and np.nanmin(values) > 0.0:
            axis.set_yscale("log")
        axis.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    axes[-1].set_xlabel("stage")
    titles = " and ".join(title.lower() for title, _ in panels)
    return finished(
        figure, "stages.png", f"Stage by stage: {titles}; a line for each run.", f"{titles} against stage.".capitalize()
    )


def _posterior(content: Content) -> Drawing | None:
    return draw_posterior(content.marginals)


_FIGURES: tuple[Callable[[Content], Drawing | None], ...] = (
    _acceleration,
    _acceleration_zoom,
    _residuals,
    _hysteresis,
    _drift,
    _quantities,
    _posterior,
    lambda content: draw_learned(content.marginals),
    lambda content: draw_pairs(content.pairs),
    draw_chains,
    lambda content: _stages(content.facts.stages),
)
"""In the page's order."""
assert len(_FIGURES) == N_FIGURES
assert _FIGURES[POSTERIOR] is _posterior
