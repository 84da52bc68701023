"""Measured, as given and improved, beside each other, on what was fitted and on what was held out.

A part is any choice of samples of a record, so that an end, repeat cycles or another record are drawn alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.discovery.held_out import Prediction
from bwbn_bayes.discovery.outcome import Discovery
from bwbn_bayes.discovery.predictive import PredictiveInterval
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.blocks import measured_or_nan
from bwbn_bayes.records.cycles import cycle_numbers
from bwbn_bayes.records.record import Record

Indices = NDArray[np.intp]

MAX_CYCLES = 6
"""Loops drawn of each part."""
LEAST_AMPLITUDE = 0.15
"""Of the largest displacement: smaller cycles are specks in the scale of the largest, and are left out."""
LEAST_LENGTH = 0.2
"""Share of a cycle's samples from which a part of it is a branch, not a point."""


@dataclass(frozen=True, kw_only=True)
class Part:
    """Some samples of a record, with what the model as given and as improved (None where it is the same) predict there.

    Attributes
    ----------
    name : str
        For files: ``fitted`` or ``held_out``.
    label : str
    record : Record
    counted : (n_counted,) array of int
        Indices of the samples, in order.
    channels : tuple of str
    measured, given : (n_channels, n_counted) array
        [unit of the channel] Not a number where one of several records lacks a channel.
    improved : (n_channels, n_counted) array or None
    interval : PredictiveInterval or None
        Of held-out samples among the fitted ones.
    whole : Record or None
        The measurement that it is a part of, where that is another record than its own.
    """

    name: str
    label: str
    record: Record
    counted: Indices
    channels: tuple[str, ...]
    measured: Floats
    given: Floats
    improved: Floats | None
    interval: PredictiveInterval | None = None
    whole: Record | None = None

    @property
    def models(self) -> tuple[tuple[str, Floats], ...]:
        """``as given`` and, where something was added, ``improved``."""
        given = (("as given", self.given),)
        return given if self.improved is None else (*given, ("improved", self.improved))

    @property
    def begins(self) -> tuple[tuple[float, str], ...]:
        """Time [s] at which each of several joined records begins, and its name."""
        return begins_of(self.record, self.record.times)

    @property
    def time(self) -> Floats:
        """``(n_counted,)`` [s]."""
        return self.record.times[self.counted]

    def worst_first(self) -> list[int]:
        """Rows of the channels, the largest relative error of the model as given first."""
        signal = np.sqrt(np.nanmean(np.square(self.measured), axis=1))
        error = np.nanmedian(np.abs(self.given - self.measured), axis=1) / np.maximum(signal, 1e-300)
        return [int(i) for i in np.argsort(-error, kind="stable")]


@dataclass(frozen=True, kw_only=True)
class CycleLoop:
    """One cycle of a specimen: displacement [m] and forces [N], ``(n_samples,)`` each; in which part it lies.

    ``name`` is what it is called, ``band`` holds the ends of the predictive intervals, where there are some.
    """

    name: str
    part: Part
    displacement: Floats
    measured: Floats
    models: tuple[Floats, ...]
    band: tuple[Floats, Floats] | None = None


@dataclass(frozen=True, kw_only=True)
class CycleErrors:
    """Error of each model by cycle of a part, over the rms of the whole record's force.

    ``numbers (n_cycles,)``, which go on from one of several records to the next, and for each model in turn
    ``errors (n_cycles,)``; ``begins`` says where these records begin.
    """

    part: Part
    numbers: NDArray[np.int64]
    errors: tuple[Floats, ...]
    begins: tuple[tuple[float, str], ...]


def begins_of(record: Record, axis: Floats) -> tuple[tuple[float, str], ...]:
    """Where each of several joined records begins on an axis ``(n_times,)``, and its name."""
    starts = enumerate(float(axis[stretch.start]) for stretch in record.stretches)
    return tuple((start, record.part_name(number)) for number, start in starts)


def parts_of(discovery: Discovery) -> tuple[Part, ...]:
    """The fitted record and, where there is one, what was held out."""
    gap, apart, changed = discovery.gap, discovery.held_out, bool(discovery.added)
    record = discovery.record
    fitted = np.arange(record.n_times)[record.kept]
    parts = [_part("fitted", "fitted record", record, fitted, (gap.before, gap.after if changed else None))]
    if apart is not None and gap.held_out is not None:
        both = gap.held_out.before, gap.held_out.after if changed else None
        held_out = _part("held_out", apart.label, apart.record, apart.counted, both)
        if apart.is_of_fitted:
            parts = [replace(parts[0], whole=apart.record)]
        parts.append(replace(held_out, interval=gap.held_out.interval))
    return tuple(parts)


def _part(
    name: str, label: str, record: Record, counted: Indices, predictions: tuple[Prediction, Prediction | None]
) -> Part:
    given, improved = predictions
    return Part(
        name=name,
        label=label,
        record=record,
        counted=counted,
        channels=given.channels,
        measured=measured_or_nan(record)[:, counted],
        given=given.values,
        improved=None if improved is None else improved.values,
    )


def loops_by_cycle(parts: Sequence[Part]) -> tuple[CycleLoop, ...]:
    """Evenly chosen cycles of each part of a specimen, with those that reach far enough to be seen."""
    found = []
    for part in parts:
        displacement = part.record.excitation
        numbers, cycles = _cycles_of(part)
        moved = displacement[part.counted]
        least = LEAST_AMPLITUDE * float(np.max(np.abs(displacement)))
        large = [c for c in cycles.tolist() if np.max(np.abs(moved[numbers == c])) >= least]
        for number in _evenly(large, MAX_CYCLES):
            own = numbers == number
            found.append(
                CycleLoop(
                    name=_cycle_name(part.record, int(part.counted[np.flatnonzero(own)[0]]), number),
                    part=part,
                    displacement=moved[own],
                    measured=part.measured[0, own],
                    models=tuple(values[0, own] for _, values in part.models),
                    band=None if part.interval is None else (part.interval.low[0, own], part.interval.high[0, own]),
                )
            )
    return tuple(found)


def errors_by_cycle(parts: Sequence[Part]) -> tuple[CycleErrors, ...]:
    """Of every cycle of a specimen's parts; over one and the same force, so that small cycles count little."""
    found = []
    for part in parts:
        numbers, cycles = _cycles_of(part)
        whole = part.record if part.whole is None else part.whole
        signal = float(np.sqrt(np.mean(np.square(whole.channels[part.channels[0]][whole.kept]))))
        errors = []
        for _, values in part.models:
            with np.errstate(over="ignore", invalid="ignore"):
                square = np.square(values[0] - part.measured[0])
                errors.append(np.array([np.sqrt(np.mean(square[numbers == c])) for c in cycles]) / signal)
        begins = begins_of(part.record, np.asarray(_running_cycles(part.record) - 0.5, dtype=np.float64))
        found.append(CycleErrors(part=part, numbers=cycles, errors=tuple(errors), begins=begins))
    return tuple(found)


def _cycles_of(part: Part) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The cycle of each sample ``(n_counted,)`` of a part, and the cycles of which the part holds some length.

    A turning point counts with the half cycle that it ends, but has the number of the cycle that it begins.
    """
    every = _running_cycles(part.record)
    numbers = every[part.counted]
    cycles, n_own = np.unique(numbers, return_counts=True)
    return numbers, cycles[n_own >= LEAST_LENGTH * np.bincount(every)[cycles]]


def _running_cycles(record: Record) -> NDArray[np.int64]:
    """The cycle of every sample ``(n_times,)``; they go on from one of several records to the next."""
    numbers: list[NDArray[np.int64]] = []
    for part in record.parts:
        numbers.append(cycle_numbers(part.excitation) + (numbers[-1][-1] if numbers else 0))
    return np.concatenate(numbers)


def _cycle_name(record: Record, sample: int, number: int) -> str:
    """``cycle 3``, or ``cycle 3 of first``."""
    part = record.part_at(sample)
    start = record.stretches[part].start
    before = int(_running_cycles(record)[start - 1]) if start else 0
    return f"cycle {number - before}{record.of_part(part)}"


def _evenly(numbers: Sequence[int], most: int) -> list[int]:
    """At most so many of them, evenly chosen, both ends among them."""
    if len(numbers) <= most:
        return list(numbers)
    return [numbers[i] for i in np.unique(np.linspace(0, len(numbers) - 1, most).round().astype(int)).tolist()]
