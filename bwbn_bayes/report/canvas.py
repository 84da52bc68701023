"""The report's canvas: one palette, one width, one legend, PNG without a display."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image
from PIL.PngImagePlugin import PngInfo

WIDTH_IN = 5.0
"""Width of every figure: at this size 9.5 pt text stays readable on a screen 400 px wide."""
DOTS_PER_INCH = 190
N_COLOURS = 96
"""Colours of a PNG's palette: enough for shades of one blue and grey, a third of the bytes."""

_WHITE = 253
"""Levels from here on are drawn white: an octree rounds the paper's colour down."""

INK, MEASURED, IDENTIFIED, PRIOR = "#222222", "#9b9b9b", "#0b62a4", "#d9d6cf"
SERIES = ("#0b62a4", "#d1731c", "#3f8f5b", "#8a4f9e", "#b03a48", "#5f6b76")
"""Colours that tell storeys or chains apart."""
DASHES = (3.0, 3.0)
"""The true value or history, everywhere."""
STYLE: dict[Any, Any] = {
    "font.size": 9.5,
    "axes.titlesize": 9.5,
    "axes.titleweight": "normal",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#8a8a8a",
    "axes.linewidth": 0.7,
    "axes.labelcolor": INK,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#ececec",
    "grid.linewidth": 0.6,
    "xtick.color": "#555555",
    "ytick.color": "#555555",
    "text.color": INK,
    "legend.frameon": False,
    "legend.handlelength": 1.8,
    "mathtext.fontset": "dejavusans",
    "path.simplify_threshold": 0.4,
    "figure.constrained_layout.h_pad": 0.05,
    "figure.facecolor": "white",
}


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """One figure: its file name, PNG bytes, a caption and a text for those who cannot see it; size in pixels."""

    name: str
    png: bytes
    caption: str
    alt: str
    width: int
    height: int


def canvas(n_rows: int, height_in: float, n_columns: int = 1, *, share_x: bool = True) -> tuple[Figure, list[Axes]]:
    """A blank figure of the report's width and its axes, row by row."""
    figure = Figure(figsize=(WIDTH_IN, height_in), dpi=DOTS_PER_INCH, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(n_rows, n_columns, squeeze=False, sharex=share_x)
    return figure, [axis for row in axes for axis in row]


def finished(figure: Figure, name: str, caption: str, alt: str) -> Drawing:
    """The figure rendered to PNG with a small palette."""
    agg = FigureCanvasAgg(figure)
    agg.draw()  # type: ignore[no-untyped-call]
    # Straight from the canvas: a PNG in between took a tenth of a report's time.
    pixels = agg.buffer_rgba()  # type: ignore[no-untyped-call]
    drawn = Image.frombuffer("RGBA", agg.get_width_height(), pixels, "raw", "RGBA", 0, 1)
    # By octree: a median cut takes six times as long, a seventh of a report's time.
    image = drawn.convert("RGB").quantize(N_COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    image.putpalette([255 if value >= _WHITE else value for value in image.getpalette() or ()])
    buffer = BytesIO()
    mark = PngInfo()
    mark.add_text(*_MARK)
    image.save(buffer, format="PNG", compress_level=6, pnginfo=mark)
    return Drawing(name=name, png=buffer.getvalue(), caption=caption, alt=alt, width=image.width, height=image.height)


_MARK = ("Software", "bwbn_bayes")


def is_ours(path: Path) -> bool:
    """Whether a PNG file is a figure of a report."""
    try:
        with Image.open(path) as image:
            return image.info.get(_MARK[0]) == _MARK[1]
    except OSError:
        return False


def mark_parts(axis: Axes, begins: Sequence[tuple[float, str]], *, named: bool = True) -> None:
    """Where each of several joined records begins, with its name; those outside the axis are left out."""
    first, last = axis.get_xlim()
    for place, name in begins if len(begins) > 1 else ():
        if first <= place < last:
            axis.axvline(place, color=INK, linewidth=0.8, linestyle=":")
            axis.annotate(
                name if named else "",
                (place, 1.0),
                xycoords=("data", "axes fraction"),
                xytext=(3, -2),
                textcoords="offset points",
                va="top",
                fontsize=8.0,
                bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.8},
            )


def legend(figure: Figure, labelled: Axes, empty: Axes | None = None) -> None:
    """The legend of one axis for the whole figure: in an empty panel where there is one, else above."""
    handles, labels = labelled.get_legend_handles_labels()
    if empty is not None:
        empty.legend(handles, labels, loc="center left", labelspacing=0.9)
    else:
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), columnspacing=1.4)
