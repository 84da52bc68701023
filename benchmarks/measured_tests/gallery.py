"""Loops as figures: measured, and by each law, fitted part and held-out part apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.measured_tests.specimens import MeasuredTest
from bwbn_bayes.report.canvas import IDENTIFIED, MEASURED, STYLE, finished

TITLES = {
    "pinching4": "Pinching4",
    "bwbn": "BWBN",
    "linear_chain": "linear chain",
    "discover": "discover",
}
"""From left to right."""
_PANEL_IN, _HEIGHT_IN, _DPI = 2.3, 1.9, 110


def draw_gallery(
    tests: Sequence[MeasuredTest], entries: Mapping[tuple[str, str], Mapping[str, Any]], folder: Path
) -> dict[str, Path]:
    """Draw every test of which something is filed.

    Parameters
    ----------
    tests : sequence of MeasuredTest
    entries : mapping
        Filed results by name and kind.
    folder : Path
        Where the PNGs go.

    Returns
    -------
    dict of str to Path
        The PNG of each test that was drawn.
    """
    folder.mkdir(parents=True, exist_ok=True)
    drawn = {}
    for test in tests:
        shown = {what: entries.get((test.name, what), {}) for what in TITLES}
        shown = {what: entry for what, entry in shown.items() if "shown" in entry}
        if shown:
            drawn[test.name] = folder / f"{test.name}.png"
            drawn[test.name].write_bytes(_drawn(test, shown))
    return drawn


def _drawn(test: MeasuredTest, shown: Mapping[str, Mapping[str, Any]]) -> bytes:
    with rc_context(STYLE):
        figure = Figure(figsize=(_PANEL_IN * len(shown), 2 * _HEIGHT_IN + 0.3), dpi=_DPI, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(2, len(shown), squeeze=False, sharex=not test.is_frame, sharey=True)
        for column, (what, entry) in enumerate(shown.items()):
            index = np.array(entry["shown"]["index"])
            # What was not finite is None in JSON and leaves a gap.
            values = np.array(entry["shown"]["values"], dtype=np.float64)[-1]
            for line, part in enumerate((index < test.n_fitted, index >= test.n_fitted)):
                _panel(axes[line, column], test, index[part], values[part])
            axes[0, column].set_title(TITLES[what])
        _label(axes, test)
        return finished(figure, test.name, "", "").png


def _panel(axes: Axes, test: MeasuredTest, index: np.ndarray, values: np.ndarray) -> None:
    if test.is_frame:
        across, scale = test.record.times, 1e3
    else:
        across, scale = 1e3 * test.record.excitation, 1e-3
    measured = scale * list(test.record.channels.values())[-1]
    every = slice(index[0], index[-1] + 1)
    axes.plot(across[every], measured[every], color=MEASURED, linewidth=1.4)
    axes.plot(across[index], scale * values, color=IDENTIFIED, linewidth=0.7)
    largest = 1.25 * float(np.max(np.abs(measured)))
    axes.set_ylim(-largest, largest)  # a prediction that runs away leaves the frame, not the loop


def _label(axes: np.ndarray, test: MeasuredTest) -> None:
    across, up = ("time in s", "top floor in mm") if test.is_frame else ("displacement in mm", "force in kN")
    for line, part in enumerate(("fitted", "held out")):
        axes[line, 0].set_ylabel(f"{part}: {up}")
    for panel in axes[-1]:
        panel.set_xlabel(across)
