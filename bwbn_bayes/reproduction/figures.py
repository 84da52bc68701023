"""Draw the reproduction: figures 7 and 8 of the paper, and printed against own correlations, as PNG."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from io import BytesIO

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from bwbn_bayes.reproduction.cases import METHODS, STOREYS, Case, Excitation
from bwbn_bayes.reproduction.comparison import Line
from bwbn_bayes.reproduction.measure import Histories

_COLOURS = {"IPV": "#3f8f5b", "GA": "#d1731c", "TMCMC": "#0b62a4"}
_FIGURES: Mapping[Excitation, tuple[str, str]] = {"Sin": ("figure7", "sine"), "ElCentro": ("figure8", "El Centro")}
_DOTS_PER_INCH = 150


def draw_all(lines: Sequence[Line], histories: Mapping[Case, Histories]) -> tuple[tuple[str, bytes], ...]:
    """Every figure the finished cases allow, as name and PNG.

    Parameters
    ----------
    lines : sequence of Line
        Printed and own numbers.
    histories : mapping of Case to Histories
        Of the noise-free cases of group 1.
    """
    drawings = [_loops(excitation, histories) for excitation in _FIGURES]
    drawings.append(_correlations(lines))
    return tuple(drawing for drawing in drawings if drawing is not None)


def _loops(excitation: Excitation, histories: Mapping[Case, Histories]) -> tuple[str, bytes] | None:
    """Force against drift, noise-free, group 1: true black, identified coloured; storey 1 at the bottom."""
    found = {case.method: h for case, h in histories.items() if case.excitation == excitation}
    if not found:
        return None
    name, words = _FIGURES[excitation]
    methods = [method for method in METHODS if method in found]
    figure = Figure(figsize=(2.9 * len(methods), 6.6), dpi=_DOTS_PER_INCH, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(STOREYS), len(methods), squeeze=False)
    for column, method in enumerate(methods):
        history = found[method]
        for i in range(len(STOREYS)):
            axis = axes[len(STOREYS) - 1 - i, column]
            axis.plot(history.drift[i], history.true[i], color="#222222", linewidth=0.9, label="true")
            axis.plot(history.drift[i], history.identified[i], color=_COLOURS[method], linewidth=0.6, label=method)
            axis.locator_params(axis="x", nbins=5)
            axis.set_title(f"{method}, storey {i + 1}", fontsize=9, loc="left")
            axis.tick_params(labelsize=7)
    figure.supxlabel(f"true drift [m], {words}", fontsize=9)
    figure.supylabel("storey force [N]", fontsize=9)
    return name, _png(figure)


def _correlations(lines: Sequence[Line]) -> tuple[str, bytes] | None:
    """Printed against own ``1 - R_x``, with the noise-free truth and with the noisy record."""
    drawn = [line for line in lines if line.quantity.startswith("corr_R_x") and np.isfinite(line.ours)]
    if not drawn:
        return None
    figure = Figure(figsize=(7.0, 3.6), dpi=_DOTS_PER_INCH, layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, sharey=True, sharex=True)
    for axis, title, noisy in (
        (left, "ours against the noise-free truth", False),
        (right, "ours against the noisy record", True),
    ):
        for method in METHODS:
            chosen = [line for line in drawn if line.method == method]
            x = [max(1.0 - float(line.paper), 1e-5) for line in chosen]
            axis.loglog(
                x,
                [max(1.0 - (line.ours_noisy if noisy else line.ours), 1e-9) for line in chosen],
                ".",
                color=_COLOURS[method],
                label=method,
            )
        axis.plot([1e-5, 0.3], [1e-5, 0.3], color="#999999", linewidth=0.8)
        axis.set_title(title, fontsize=9, loc="left")
        axis.set_xlabel("1 - R-x, printed", fontsize=9)
        axis.tick_params(labelsize=7)
    left.set_ylabel("1 - R-x, ours", fontsize=9)
    left.legend(fontsize=8)
    return "correlations", _png(figure)


def _png(figure: Figure) -> bytes:
    buffer = BytesIO()
    figure.savefig(buffer, format="png", facecolor="white")
    return buffer.getvalue()
