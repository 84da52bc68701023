"""What the report draws and prints, as arrays: apart from what gathers it, so that who only draws loads little."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from bwbn_bayes.results import Facts, ParameterFacts

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

N_FIGURES, POSTERIOR = 11, 6
"""Figures of a page at most; the number of the one that needs ArviZ, which loads slowly."""

MAX_POINTS = 3000
"""Most points of a drawn history; extremes are kept."""
ZOOM_S, ZOOM_POINTS = 5.0, 100.0
"""Length of the enlarged part: the strongest 5 s, or a cycle or two where there is no time."""


@dataclass(frozen=True, kw_only=True)
class Band:
    """A middle value with its 90 % band, each ``(n_points,)``."""

    lower: Floats
    middle: Floats
    upper: Floats

    def at(self, index: Indices) -> Band:
        """The band at chosen points."""
        return Band(lower=self.lower[index], middle=self.middle[index], upper=self.upper[index])

    def times(self, factor: float) -> Band:
        """The band in another unit."""
        return Band(lower=factor * self.lower, middle=factor * self.middle, upper=factor * self.upper)


@dataclass(frozen=True, kw_only=True)
class ChannelTrace:
    """One measured channel against its posterior prediction, ``(n_time,)`` each; units as named.

    ``time`` is in s, or counts points where there is no time.
    """

    channel: str
    title: str
    quantity: str
    unit: str
    time: Floats
    measured: Floats
    predicted: Band
    noise_sd: float
    nrmse: float

    @property
    def residual(self) -> Floats:
        """Measured minus posterior mean."""
        return self.measured - self.predicted.middle


@dataclass(frozen=True, kw_only=True)
class StoreyLoop:
    """Storey force against drift: measured, identified (mean and draws), true where known; in N and m."""

    place: str
    drift: Floats
    force: Floats
    drift_draws: Floats
    force_draws: Floats
    measured_force: Floats | None
    true_drift: Floats | None
    true_force: Floats | None
    part: tuple[float, float] | None = None
    """Beginning and end of what is shown, where it is not the whole record: [s], or numbers of points."""


@dataclass(frozen=True, kw_only=True)
class StoreyHistory:
    """Drift [m] and work on the hysteretic spring [J] of a storey against time [s], or the numbers of points."""

    place: str
    time: Floats
    drift: Band
    energy: Band
    true_drift: Floats | None


@dataclass(frozen=True, kw_only=True)
class Marginal:
    """One parameter's posterior and prior draws."""

    parameter: ParameterFacts
    posterior: Floats
    prior: Floats


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two strongly correlated parameters and their draws."""

    first: Marginal
    second: Marginal
    correlation: float


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """An engineering quantity with its band per storey or mode: ``lower, middle, upper`` of ``(n_places,)``."""

    name: str
    unit: str
    band: Band


@dataclass(frozen=True, kw_only=True)
class Period:
    """First period of the damaged building against time, in s."""

    time: Floats
    band: Band


@dataclass(frozen=True, kw_only=True)
class Content:
    """Everything the report draws and prints."""

    facts: Facts
    traces: tuple[ChannelTrace, ...]
    n_channels: int
    loops: tuple[StoreyLoop, ...]
    histories: tuple[StoreyHistory, ...]
    marginals: tuple[Marginal, ...]
    pairs: tuple[Pair, ...]
    places: tuple[str, ...]
    """Its links in words, from the ground up."""
    storey_quantities: tuple[Quantity, ...]
    modal_quantities: tuple[Quantity, ...]
    period: Period | None
    specimen: bool
    """Whether a machine gave the displacement, and there is no building."""
    n_chains: int
    has_bands: bool
    """Whether there are posterior draws; a point estimate has no bands and no intervals."""
    has_time: bool = True
    """Whether histories stand against seconds, not against the points of a path."""

    @property
    def order(self) -> str:
        """What histories stand against."""
        return "time" if self.has_time else "the points in order"

    @property
    def order_label(self) -> str:
        """The same on an axis."""
        return "time [s]" if self.has_time else "point"

    def stretch_in_words(self, start: float, end: float, digits: int = 3) -> str:
        """``3.2 to 8.2 s``, or ``points 120 to 220``."""
        if self.has_time:
            return f"{start:.{digits}g} to {end:.{digits}g} s"
        return f"points {start:.0f} to {end:.0f}"


def thinned(values: Floats, n_points: int = MAX_POINTS) -> Indices:
    """Indices of at most ``n_points`` points of a history that keep every bin's smallest and largest value."""
    if values.size <= n_points:
        return np.arange(values.size)
    edges = np.linspace(0, values.size, n_points // 2 + 1).astype(np.intp)
    ends = [(a + np.argmin(values[a:b]), a + np.argmax(values[a:b])) for a, b in pairwise(edges)]
    return np.unique(np.asarray(ends, dtype=np.intp))


def strongest_window(time: Floats, signals: Sequence[Floats], length_s: float = ZOOM_S) -> tuple[float, float]:
    """Start and end [s] of the part of a record with the most signal energy, channels weighted alike.

    What was not measured is not a number, and adds nothing.
    """
    signals = [np.nan_to_num(signal) for signal in signals]
    if time[-1] - time[0] <= length_s:
        return float(time[0]), float(time[-1])
    energy = sum((signal / max(float(np.std(signal)), 1e-300)) ** 2 for signal in signals)
    n_window = max(1, round(length_s / float(time[1] - time[0])))
    sums = np.convolve(np.asarray(energy), np.ones(n_window), mode="valid")
    start = int(np.argmax(sums))
    return float(time[start]), float(time[min(start + n_window, time.size - 1)])
