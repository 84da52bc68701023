"""The confusion matrix and the reliability of probabilities as pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.blind.scoring import FAILED, NOTHING, UNEXPLAINED

_STYLE: dict[Any, Any] = {"font.size": 8.0, "text.color": "#222222", "axes.edgecolor": "#8a8a8a", "axes.linewidth": 0.7}
_LEAST_WIDTH = 4.2
"""Of a matrix with its title. [inch]."""


def draw_confusion(cells: Sequence[Mapping[str, Any]], path: Path, title: str) -> None:
    """Write a confusion matrix as PNG: hidden effects down, names given across, counts in the cells.

    Parameters
    ----------
    cells : sequence of mapping
        Of :func:`benchmarks.blind.columns.confusion`.
    path : Path
        The PNG.
    title : str
        One line above it.
    """
    rows = sorted({str(cell["hidden"]) for cell in cells})
    given = {str(cell["named"]) for cell in cells}
    special = [name for name in (NOTHING, UNEXPLAINED, FAILED) if name in given and name not in rows]
    columns = [*(row for row in rows if row in given), *sorted(given - set(rows) - set(special)), *special]
    counts = np.zeros((2, len(rows), len(columns)), dtype=int)  # wrong, right
    for cell in cells:
        counts[int(cell["right"]), rows.index(cell["hidden"]), columns.index(cell["named"])] += cell["count"]
    of_row = np.maximum(counts.sum(axis=(0, 2)), 1)[:, None]
    with rc_context(_STYLE):
        size = (2.4 + 0.3 * len(columns), 2.0 + 0.27 * len(rows))
        figure = Figure(figsize=(max(size[0], _LEAST_WIDTH), size[1]), dpi=160, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots()
        for kind, colours in enumerate(("Oranges", "Blues")):
            shown = np.ma.masked_equal(counts[kind], 0)
            axes.imshow(shown / of_row, cmap=colours, vmin=0.0, vmax=1.6, aspect="auto")
        for i, j in zip(*np.nonzero(counts.sum(axis=0)), strict=True):
            axes.text(j, i, str(counts[:, i, j].sum()), ha="center", va="center")
        axes.set_xticks(range(len(columns)), columns, rotation=90)
        axes.set_yticks(range(len(rows)), rows)
        axes.tick_params(length=0)
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_xlabel("named (blue: rightly, orange: wrongly)")
        axes.set_ylabel("hidden")
        axes.set_title(title, loc="left", fontsize=8.5)
        figure.savefig(path, facecolor="white")


def draw_reliability(summary: Mapping[str, Any], path: Path, title: str) -> None:
    """Write a reliability diagram as PNG: share that came true over the probability stated, with 95 % intervals.

    Parameters
    ----------
    summary : mapping
        Of :func:`benchmarks.blind.reliability.reliability`.
    path : Path
        The PNG.
    title : str
        One line above it.
    """
    bins = [b for b in summary["bins"] if b["statements"]]
    with rc_context(_STYLE):
        figure = Figure(figsize=(4.2, 4.4), dpi=160, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots()
        axes.plot([0.0, 1.0], [0.0, 1.0], color="#b0b0b0", linewidth=0.8)
        for b in bins:
            low, high = b["interval95"]
            axes.plot([b["mean_probability"]] * 2, [low, high], color="#3b6ea5", linewidth=1.0)
            axes.plot(b["mean_probability"], b["share"], "o", color="#3b6ea5", markersize=4.0)
            # Beside the point, towards the middle, where neither the interval nor the frame is in the way.
            inwards = 1.0 if b["mean_probability"] < 0.5 else -1.0
            axes.annotate(
                str(b["statements"]),
                (b["mean_probability"], b["share"]),
                (4.0 * inwards, 0.0),
                textcoords="offset points",
                ha="left" if inwards > 0.0 else "right",
                va="center",
                fontsize=7.0,
            )
        axes.set_xlim(-0.03, 1.03)
        axes.set_ylim(-0.03, 1.03)
        axes.set_aspect("equal")
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_xlabel("probability stated for a name")
        axes.set_ylabel("share that was hidden, of so many statements")
        axes.set_title(title, loc="left", fontsize=8.5)
        figure.savefig(path, facecolor="white")
