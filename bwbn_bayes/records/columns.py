"""From the columns of a file to a :class:`Record`: what each stands for, its unit, and the time base."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.column_map import Item, Meaning, find_column, parse_columns
from bwbn_bayes.records.labels import Labels
from bwbn_bayes.records.record import (
    COLUMN_NAMES,
    LEAST_POINTS,
    ExcitationKind,
    Record,
    is_input,
    one_line,
    quantity_of,
    si_unit,
)
from bwbn_bayes.records.time_base import CLOCK_JITTER, Source, uniform_step
from bwbn_bayes.records.units import frequency_factor, si_factor

STATED = ("time_step", "sampling_rate")
"""Names that a column map may give to a single number."""

MOST_SECONDS = 1e12
"""Times beyond are no times, and their differences overflow. [s]"""


@dataclass(frozen=True, kw_only=True)
class Column:
    """A column as a file has it.

    Parameters
    ----------
    label : str
        What the file calls it.
    values : (n_times,) array
        In the file's unit; a single number, too, where a map makes it a time step or a sampling rate.
    unit : str, optional
        As the file has it.
    minus, minus_unit : str, optional
        Label and unit of another column that is to be subtracted.
    cell : str
        The whole cell of the header; a map may name the column by it.
    resolution : callable
        Smallest step that the numbers resolve: it matters for times alone. [file's unit]
    fault : str
        Why there are no numbers; it is the user's to hear only where the column is used.
    """

    label: str
    values: Floats
    unit: str | None = None
    minus: str | None = None
    minus_unit: str | None = None
    cell: str = ""
    resolution: Callable[[], float] = lambda: 0.0
    fault: str = ""

    @property
    def labels(self) -> tuple[str, ...]:
        """All that it answers to."""
        return (self.label, self.cell) if self.cell else (self.label,)


@dataclass(frozen=True, kw_only=True)
class Table:
    """What a file holds: its columns, what it says beside them, where it is, and what to do where a unit is missing."""

    columns: tuple[Column, ...]
    labels: Labels
    source: Source
    unit_advice: str = "write {name} [{unit}]"


class _Used(NamedTuple):
    """A column and what it stands for."""

    column: Column
    meaning: Meaning


def record_of(table: Table, columns: str | None = None) -> Record:
    """The record that a table holds, in SI units.

    Parameters
    ----------
    table : Table
        Columns of a file.
    columns : str, optional
        A column map (:mod:`~bwbn_bayes.records.column_map`): only what it names is read, and ``time``. Without one,
        every column's label must be a name of ours.

    Raises
    ------
    UserError
        If names, units or times are wrong; the message names the file and the place.
    """
    try:
        return _record_of(table, () if columns is None else parse_columns(columns), columns)
    except UserError as error:
        told = str(error)
        raise UserError(told if told.startswith(table.source.file) else f"{table.source.file}: {told}") from None


def _record_of(table: Table, items: Sequence[Item], columns: str | None) -> Record:
    labels = table.labels
    if columns is not None:
        labels = replace(labels, provenance={**labels.provenance, "columns": one_line(columns)})
    used = {each.meaning.name: each for each in (_mapped(table, items) if items else _named(table))}
    stated = _stated_step(used, table)
    if stated is not None:
        labels = replace(labels, time_step=stated, has_time=True)
    kind = excitation_kind_of(tuple(used), table.source.header, has_step=labels.time_step is not None)
    values = _in_si(used, kind if kind in used else next(filter(is_input, used)), table)
    has_time = "time" in used or labels.time_step is not None
    step = 1.0 if labels.time_step is None else labels.time_step
    if "time" in used:
        times, meaning = values.pop("time"), used["time"].meaning
        quantum = used["time"].column.resolution() * abs(_factor(meaning, table))
        step = uniform_step(times, quantum, labels.time_step, table.source)
        if abs(times[0]) > CLOCK_JITTER * step:
            labels = replace(labels, provenance={"start_time": f"{times[0]:.12g} s", **labels.provenance})
    forces = {name: values.pop(name) for name in [*values] if is_input(name)}
    return Record(
        name=labels.name,
        time_step=step,
        excitation=values.pop(kind) if kind in values else np.zeros(len(next(iter(forces.values())))),
        excitation_kind=kind,
        forces=forces,
        channels=values,
        provenance=labels.provenance,
        truth=labels.truth,
        noise_sd=labels.noise_sd,
        has_time=labels.has_time and has_time,
    )


def _in_si(used: Mapping[str, _Used], kind: str, table: Table) -> dict[str, Floats]:
    """Numbers ``(n_times,)`` of each column in SI units, less what is to be subtracted."""
    file, values = table.source.file, {}
    n_times = len(_numbers(used[kind].column))
    if n_times < 2:
        raise UserError(f"{file}: the record has {n_times} points: {LEAST_POINTS}")
    for name, (column, meaning) in used.items():
        parts = [(column, meaning)]
        if meaning.minus is not None:
            parts.append(_reference(meaning, table))
        for part, _ in parts:
            if len(_numbers(part)) != n_times:
                raise UserError(
                    f"{file}, column {part.label}: {len(part.values)} points where {kind} has {n_times}, they must be "
                    "equal"
                )
        values[name] = _difference([(_factor(each, table), part.values) for part, each in parts])
        if not np.all(np.isfinite(values[name])) or (name == "time" and np.max(np.abs(values[name])) > MOST_SECONDS):
            raise UserError(
                f"{file}, column {column.label}: its numbers are too large for {meaning.unit}, correct them"
            )
    return values


def _difference(parts: Sequence[tuple[float, Floats]]) -> Floats:
    """The first part in SI units, less the second if there is one; not finite where that is too large."""
    with np.errstate(over="ignore", invalid="ignore"):
        first, *others = (factor * values for factor, values in parts)
        return first - others[0] if others else first


def excitation_kind_of(names: Sequence[str], header: str, *, has_step: bool = False) -> ExcitationKind:
    """Check the names of columns and tell which kind of record they make.

    Raises
    ------
    UserError
        If a name is unknown or the excitation or the time is missing; ``header`` says where.
    """
    for name in names:
        if quantity_of(name) is None:
            raise UserError(
                f"{header}, column {name}: the name is not known, use {COLUMN_NAMES}, or say by a column map which "
                "columns to read"
            )
    forced = any(is_input(name) for name in names)
    if "ground_acceleration" in names and "displacement" in names:
        raise UserError(f"{header}: both ground_acceleration and displacement drive a record, keep one")
    if "displacement" in names:
        kind: ExcitationKind = "displacement"
    elif "ground_acceleration" in names or forced:
        kind = "ground_acceleration"
    else:
        raise UserError(
            f"{header}: column ground_acceleration is missing (applied_force_1 for a force on floor 1, displacement "
            "for a cyclic test), add it"
        )
    if forced and kind == "displacement":
        raise UserError(f"{header}: both a force and displacement drive a record, keep one")
    if kind == "ground_acceleration" and "time" not in names and not has_step:
        raise UserError(f"{header}: column time is missing, add it or state the time_step")
    for name in names:
        if name not in ("time", kind) and (name == "force") != (kind == "displacement"):
            belongs = "a cyclic test" if name == "force" else "a base-excited building"
            raise UserError(f"{header}, column {name}: it belongs to {belongs}, not beside {kind}, remove it")
    return kind


def _named(table: Table) -> list[_Used]:
    """Columns whose labels are names of ours, without those that are there to be subtracted."""
    known = [column.labels for column in table.columns]
    subtracted = {find_column(column.minus, known) for column in table.columns if column.minus is not None}
    found: list[_Used] = []
    for position, column in enumerate(table.columns):
        name = column.label.lower() if quantity_of(column.label.lower()) else column.label
        if position in subtracted and quantity_of(name) is None:
            continue
        if name in [each.meaning.name for each in found]:
            raise UserError(f"{table.source.header}, column {name}: the column appears twice, keep one")
        found.append(_Used(column, Meaning(name, column.unit, column.minus, column.minus_unit)))
    return found


def _mapped(table: Table, items: Sequence[Item]) -> list[_Used]:
    """Columns that a map names, and ``time`` where it names no other."""
    found = []
    for item in items:
        column = _column(item.label, table, item.meaning.name)
        if item.meaning.name not in STATED and quantity_of(item.meaning.name) is None:
            raise UserError(
                f"the column map reads {item.label!r} as {item.meaning.name}, which is not known: use "
                f"{COLUMN_NAMES}, or time_step or sampling_rate"
            )
        own = Meaning(column.label, column.unit, column.minus, column.minus_unit)
        told = item.meaning
        minus = (told.minus, told.minus_unit) if told.minus is not None else (own.minus, own.minus_unit)
        found.append(_Used(column, Meaning(told.name, own.unit if told.unit is None else told.unit, *minus)))
    position = find_column("time", [column.labels for column in table.columns])
    if position is not None and "time" not in [each.meaning.name for each in found]:
        column = table.columns[position]
        found.insert(0, _Used(column, Meaning("time", column.unit)))
    return found


def _column(label: str, table: Table, name: str) -> Column:
    position = find_column(label, [column.labels for column in table.columns])
    if position is not None:
        return table.columns[position]
    if name in STATED:
        try:
            return Column(label=label, values=np.array([float(label)]))
        except ValueError:
            pass
    there = ", ".join(column.label for column in table.columns[:12])
    more = ", ..." if len(table.columns) > 12 else ""
    raise UserError(f"{table.source.header}: no column is called {label!r}, the file has {there}{more}")


def _numbers(column: Column) -> Floats:
    if column.fault:
        raise UserError(column.fault)
    return column.values


def _factor(meaning: Meaning, table: Table) -> float:
    if meaning.unit is None:
        advice = table.unit_advice.format(name=meaning.name, unit=si_unit(meaning.name))
        raise UserError(f"{table.source.header}, column {meaning.name}: the unit is missing, {advice}")
    try:
        return si_factor(meaning.name, meaning.unit)
    except UserError as error:
        raise UserError(f"{table.source.header}, column {meaning.name}: {error}") from None


def _reference(meaning: Meaning, table: Table) -> _Used:
    """The column to subtract: in its own unit, else in that of the column that it is subtracted from."""
    column = _column(str(meaning.minus), table, meaning.name)
    unit = next((unit for unit in (meaning.minus_unit, column.unit, meaning.unit) if unit is not None), None)
    return _Used(column, Meaning(meaning.name, unit))


def _stated_step(used: dict[str, _Used], table: Table) -> float | None:
    """Take the time step [s] or the sampling rate out of the columns; None where neither is there."""
    given = [name for name in STATED if name in used]
    if len(given) > 1:
        raise UserError(f"{table.source.file}: both time_step and sampling_rate are given, keep one")
    if not given:
        return None
    column, meaning = used.pop(given[0])
    values = np.unique(_numbers(column))
    is_rate = given[0] == "sampling_rate"
    if len(values) != 1 or not (values[0] > 0.0 and np.isfinite(values[0])):
        raise UserError(f"{table.source.file}, column {column.label}: {given[0]} must be one positive number")
    if meaning.unit is None:
        raise UserError(f"{given[0]} has no unit, write {given[0]} [{'Hz' if is_rate else 's'}]")
    factor = frequency_factor(meaning.unit) if is_rate else si_factor("time", meaning.unit)
    value = factor * float(values[0])
    return 1.0 / value if is_rate else value
