"""From named columns of a file to a :class:`Record`: which columns, and whether their time is uniform."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from typing import NamedTuple

import numpy as np

from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import CHANNEL_NAMES, ExcitationKind, Record, quantity_of

CLOCK_JITTER = 1e-3
"""Largest departure of a sample from a uniform time base beyond the rounding of printed times, in time steps."""


class Column(NamedTuple):
    """A column as it stands in a file: name, factor to SI, numbers ``(n_times,)`` in the file's unit."""

    name: str
    factor: float
    values: Floats


@dataclass(frozen=True, kw_only=True)
class Labels:
    """What a file says about its record beside the numbers.

    ``time_step`` is in s, None where it is not stated; ``has_time`` is false where a time column counts points alone.
    """

    name: str
    time_step: float | None = None
    provenance: Mapping[str, str] = field(default_factory=dict)
    truth: Mapping[str, float] = field(default_factory=dict)
    noise_sd: Mapping[str, float] = field(default_factory=dict)
    has_time: bool = True


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where columns come from, for error messages: the file, its header, and the place of a row (from 0)."""

    file: str
    header: str
    place: Callable[[int], str]


def excitation_kind_of(names: Sequence[str], header: str) -> ExcitationKind:
    """Check the column names of a file and tell which kind of record it holds.

    Raises
    ------
    UserError
        If a name is unknown or given twice, or the excitation or the time is missing; ``header`` says where.
    """
    for position, name in enumerate(names):
        if quantity_of(name) is None:
            raise UserError(
                f"{header}, column {name}: the name is not known, use time, ground_acceleration, {CHANNEL_NAMES}, "
                "or displacement and force for a cyclic test"
            )
        if name in names[:position]:
            raise UserError(f"{header}, column {name}: the column appears twice, keep one")
    if "ground_acceleration" in names and "displacement" in names:
        raise UserError(f"{header}: both ground_acceleration and displacement drive a record, keep one")
    if "displacement" in names:
        kind: ExcitationKind = "displacement"
    elif "ground_acceleration" in names:
        kind = "ground_acceleration"
    else:
        raise UserError(f"{header}: column ground_acceleration is missing (displacement for a cyclic test), add it")
    if kind == "ground_acceleration" and "time" not in names:
        raise UserError(f"{header}: column time is missing, add it")
    for name in names:
        if name not in ("time", kind) and (name == "force") != (kind == "displacement"):
            belongs = "a cyclic test" if name == "force" else "a base-excited building"
            raise UserError(f"{header}, column {name}: it belongs to {belongs}, not beside {kind}, remove it")
    return kind


def record_from_columns(columns: Sequence[Column], labels: Labels, source: Source, time_quantum: float) -> Record:
    """Join checked columns to a record in SI units.

    Parameters
    ----------
    columns : sequence of Column
        Columns of equal length.
    labels : Labels
        Name, provenance, truth and noise level.
    source : Source
        Names the file in error messages.
    time_quantum : float
        Smallest step of the time column as printed. [unit of the time column]

    Raises
    ------
    UserError
        If the time is not uniform or the record is not valid; the message names the file and the place.
    """
    kind = excitation_kind_of([column.name for column in columns], source.header)
    values = {column.name: column.values * column.factor for column in columns}
    provenance = dict(labels.provenance)
    n_times, has_time = len(columns[0].values), labels.has_time and "time" in values
    if n_times < 2:
        raise UserError(f"{source.file}: the record has {n_times} points, at least 8 are needed")
    if "time" in values:
        times = values.pop("time")
        factor = next(column.factor for column in columns if column.name == "time")
        time_step = _time_step(times, time_quantum * factor, labels.time_step, source)
        if abs(times[0]) > CLOCK_JITTER * time_step:
            provenance.setdefault("start_time", f"{times[0]:.12g} s")
    else:
        time_step = 1.0 if labels.time_step is None else labels.time_step
    try:
        return Record(
            name=labels.name,
            time_step=time_step,
            excitation=values.pop(kind),
            excitation_kind=kind,
            channels=values,
            provenance=provenance,
            truth=labels.truth,
            noise_sd=labels.noise_sd,
            has_time=has_time,
        )
    except UserError as error:
        raise UserError(f"{source.file}: {error}") from None


def printed_quantum(cells: Sequence[str]) -> float:
    """Smallest step a column of printed numbers resolves, from its decimals and significant digits."""
    parts = [Decimal(cell.strip()).as_tuple() for cell in cells]
    decimals = max(-int(part.exponent) for part in parts)
    # Six digits are what %g prints: fewer mean short numbers, not rounding to significant digits.
    significant = max(6, *(len(part.digits) for part in parts))
    leading = max(len(part.digits) + int(part.exponent) for part in parts)
    return 10.0 ** max(-decimals, leading - significant)


def _time_step(times: Floats, quantum: float, stated: float | None, source: Source) -> float:
    """Time step [s] of times [s] that are uniform but for the rounding of their printing; UserError elsewhere."""
    steps = np.diff(times)
    typical = float(np.median(steps))
    if typical <= 0.0:
        row = int(np.argmax(steps <= 0.0)) + 1
        raise UserError(
            f"{source.file}, {source.place(row)}, column time: {times[row]:.10g} s does not come after "
            f"{times[row - 1]:.10g} s, give a uniform time base with enough decimals"
        )
    # Half a step bounds the allowance, so that a dropped or doubled sample shows however coarsely times are printed.
    allowed = min(quantum, 0.5 * typical) + CLOCK_JITTER * typical
    uneven = np.flatnonzero(np.abs(steps - typical) > allowed)
    if uneven.size:
        row = int(uneven[0]) + 1
        raise UserError(
            f"{source.file}, {source.place(row)}, column time: the step is {steps[row - 1]:.6g} s where the others are "
            f"{typical:.6g} s, resample to a uniform time base"
        )
    return _checked_step(times, quantum, stated, source)


def _checked_step(times: Floats, quantum: float, stated: float | None, source: Source) -> float:
    index = np.arange(len(times), dtype=np.float64)

    def spread(step: float) -> float:
        return float(np.ptp(times - step * index))

    slope = float(times[-1] - times[0]) / (len(times) - 1)
    rounding = quantum * (1.0 + 1e-6) + 8.0 * float(np.spacing(np.max(np.abs(times))))
    loose = rounding + 2.0 * CLOCK_JITTER * slope
    if stated is not None:
        if not spread(stated) <= loose:
            raise UserError(
                f"{source.file}, column time: the time_step is stated as {stated:g} s but the times step by "
                f"{slope:.6g} s, correct one of them"
            )
        return stated
    # The shortest decimal that the printed times allow: 0.02, not 0.019999999999997.
    for digits in range(17):
        candidate = float(f"{slope:.{digits}e}")
        if spread(candidate) <= rounding:
            return candidate
    if spread(slope) <= loose:
        return slope
    departure = times - times[0] - slope * index
    row = int(np.argmax(np.abs(departure)))
    raise UserError(
        f"{source.file}, {source.place(row)}, column time: the times drift {abs(departure[row]):.3g} s from a uniform "
        f"time base of {slope:.6g} s, resample to a uniform time base"
    )
