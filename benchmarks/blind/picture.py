"""The confusion matrix as a picture."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.blind.scoring import FAILED, NOTHING, UNEXPLAINED

_STYLE: dict[Any, Any] = {"font.size": 8.0, "text.color": "#222222", "axes.edgecolor": "#8a8a8a", "axes.linewidth": 0.7}


def draw_confusion(confusion: Mapping[str, Mapping[str, int]], path: Path, title: str) -> None:
    """Write a confusion matrix as PNG: hidden effects down, names given across, counts in the cells.

    Parameters
    ----------
    confusion : mapping of str to mapping of str to int
        Row, column, count.
    path : Path
        The PNG.
    title : str
        One line above it.
    """
    rows = list(confusion)
    given = {column for counts in confusion.values() for column in counts}
    special = [name for name in (NOTHING, UNEXPLAINED, FAILED) if name in given and name not in rows]
    columns = [*(row for row in rows if row in given), *sorted(given - set(rows) - set(special)), *special]
    counts = np.array([[confusion[row].get(column, 0) for column in columns] for row in rows]).reshape(len(rows), -1)
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    with rc_context(_STYLE):
        figure = Figure(figsize=(2.4 + 0.3 * len(columns), 1.9 + 0.27 * len(rows)), dpi=160, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots()
        axes.imshow(share, cmap="Blues", vmin=0.0, vmax=1.6, aspect="auto")
        for i, j in zip(*np.nonzero(counts), strict=True):
            axes.text(j, i, str(counts[i, j]), ha="center", va="center")
        axes.set_xticks(range(len(columns)), columns, rotation=90)
        axes.set_yticks(range(len(rows)), rows)
        axes.tick_params(length=0)
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_xlabel("named first")
        axes.set_ylabel("hidden")
        axes.set_title(title, loc="left", fontsize=8.5)
        figure.savefig(path, facecolor="white")
