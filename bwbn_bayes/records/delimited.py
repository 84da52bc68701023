"""Records as delimited text: CSV as this package writes it, and the dialects of other programs.

Optional ``# key: value`` lines, a header that names each quantity and its unit, then numbers::

    # name: shake table run 4
    # true k[1]: 20.0
    # noise_sd acceleration_1: 0.003
    time [s],ground_acceleration [m/s^2],acceleration_1 [g]
    0.00,0.000,0.0001

The keys ``name``, ``time_step`` [s], ``true <label>`` and ``noise_sd <channel>`` [both SI] have a meaning; any other
goes to the provenance. A cyclic test has ``displacement [mm],force [kN]``, with or without ``time``. Cells are parted
by commas, semicolons, tabs, bars or white space; decimals have a point or a comma; units may stand in a row below.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bwbn_bayes.errors import UserError, replace_file
from bwbn_bayes.records.column_map import Meaning, header_meaning
from bwbn_bayes.records.columns import Column, Table, record_of
from bwbn_bayes.records.labels import Labels
from bwbn_bayes.records.record import LEAST_POINTS, MIN_TIMES, RESERVED_KEYS, Record, si_unit
from bwbn_bayes.records.text import file_text, number
from bwbn_bayes.records.time_base import Source, printed_quantum

DELIMITERS = ("\t", ";", ",", "|", " ")
"""In the order in which they are tried; the last stands for any white space."""

_LOOKED_AT = 5
_NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf(?:inity)?)", re.IGNORECASE)
_WORD = re.compile(r"[^\s\[(]+(?:\s*(?:\[[^\]]*\]|\([^)]*\)))?|\S+")


class _Body(NamedTuple):
    """Header and rows of a file as cells; ``first_line`` is the line of the first row, from 1."""

    header: list[str]
    rows: list[list[str]]
    first_line: int


def read_csv(path: Path | str, columns: str | None = None) -> Record:
    """Read a record from delimited text (format in the module's docstring).

    Times may be rounded as printed; a sample that is missing is an error. Without a time column a cyclic test is a
    path whose points are taken 1 s apart: ``has_time`` is false, and the provenance says so.

    Parameters
    ----------
    path : Path or str
    columns : str, optional
        A column map (:mod:`~bwbn_bayes.records.column_map`) for a file whose header is not as above.

    Raises
    ------
    UserError
        One sentence naming file, line and column.
    """
    return record_of(_table(Path(path), has_map=columns is not None), columns)


def write_csv(record: Record, path: Path | str) -> None:
    """Write a record as CSV in SI units, every number with all its digits; without ``time`` where it has none.

    Raises
    ------
    UserError
        If the file cannot be written, or some samples of the record do not count.
    """
    stated = {"name": record.name, "time_step": repr(record.time_step), **record.provenance}
    stated |= {f"true {label}": repr(value) for label, value in record.truth.items()}
    stated |= {f"noise_sd {channel}": repr(value) for channel, value in record.noise_sd.items()}
    times = {"time": record.times} if record.has_time else {}
    columns = {**times, **record.columns}
    lines = [f"# {key}: {value}" for key, value in stated.items()]
    lines.append(",".join(f"{name} [{si_unit(name)}]" for name in columns))
    table = np.column_stack(list(columns.values()))
    lines += [",".join(map(repr, row)) for row in table.tolist()]
    try:
        replace_file(path, ("\n".join(lines) + "\n").encode())
    except OSError as error:
        raise UserError(f"{path}: the file cannot be written ({error.strerror})") from None


def _table(path: Path, *, has_map: bool) -> Table:
    lines = file_text(path).split("\n")
    while lines and not lines[-1].strip():
        lines.pop()
    start = next((i for i, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")), None)
    if start is None:
        raise UserError(f"{path}: the file is empty, it needs a header and rows of numbers: {LEAST_POINTS}")
    labels = _comment_labels(lines[:start], path)
    body = _body(lines, start, path)
    header = f"{path}, line {start + 1}"
    if all(map(_is_number, body.header)):
        if not has_map:
            raise UserError(
                f"{header}: there are numbers where the header should be, write one such as time [s], or give a column "
                "map with column 1, column 2 and so on"
            )
        body = _Body([f"column {i + 1}" for i in range(len(body.header))], [body.header, *body.rows], start + 1)
    meanings = [_header_cell(cell, f"{header}, column {i}") for i, cell in enumerate(body.header, start=1)]
    meanings, body = _units_below(meanings, body)
    if len(body.rows) < MIN_TIMES:
        raise UserError(f"{path}: the record has {len(body.rows)} points: {LEAST_POINTS}")
    source = Source(file=str(path), header=header, place=lambda row: f"line {body.first_line + row}")
    if not any(meaning.name.lower() == "time" for meaning in meanings):
        labels = replace(labels, has_time="time_base" not in labels.provenance)
    return Table(columns=_columns(meanings, body, source), labels=labels, source=source)


def _body(lines: Sequence[str], start: int, path: Path) -> _Body:
    delimiter = _delimiter(lines[start : start + 2 + _LOOKED_AT])
    try:
        header, *rows = (_cells(line, delimiter) for line in lines[start:])
    except csv.Error as error:
        raise UserError(f"{path}: the text is not a table ({error}), save it as CSV") from None
    if len(header) > 2 and not any(row[-1].strip() for row in (header, *rows) if len(row) >= len(header)):
        # A delimiter at the end of every line.
        header, rows = header[:-1], [row[: len(header) - 1] for row in rows]
    with_comma = any("," in cell for row in rows for cell in row)
    if with_comma and not any("." in cell for row in rows for cell in row if _is_number(cell)):
        rows = [[cell.replace(",", ".", 1) if _is_number(cell) else cell for cell in row] for row in rows]
    return _Body(header, rows, start + 2)


def _delimiter(lines: Sequence[str]) -> str:
    """The first delimiter that parts the header and a row of numbers alike, else the one that the header has most."""
    for delimiter in DELIMITERS:
        try:
            header, *rows = (_cells(line, delimiter) for line in lines)
        except csv.Error:
            continue
        if len(header) > 1 and any(len(row) == len(header) and _has_numbers(row, delimiter) for row in rows):
            return delimiter
    return max((",", "\t", ";", "|"), key=lines[0].count)


def _has_numbers(row: Sequence[str], delimiter: str) -> bool:
    """Whether a row holds numbers; text, in columns that nobody reads, counts only between marks that no number has."""
    numeric = [_is_number(cell) for cell in row if cell.strip()]
    return any(numeric) and (all(numeric) or delimiter in "\t;|,")


def _is_number(cell: str) -> bool:
    return _NUMBER.fullmatch(cell.strip()) is not None


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return _WORD.findall(line)
    if '"' in line:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    return line.split(delimiter)


def _header_cell(cell: str, place: str) -> Meaning:
    meaning = header_meaning(cell)
    if meaning is None:
        raise UserError(
            f"{place}: {cell.strip()[:40]!r} is not a column name, write a name and its unit, such as acceleration_1 "
            "[m/s^2], and put # before lines above the header"
        )
    return meaning


def _units_below(meanings: list[Meaning], body: _Body) -> tuple[list[Meaning], _Body]:
    """Units from a row below the header: text in every cell that is not blank, where the header lacks some units."""
    row = body.rows[0] if body.rows else []
    told = [cell.strip() for cell in row]
    lacking = any(meaning.unit is None for meaning in meanings)
    if len(row) != len(meanings) or not lacking or not any(told) or any(map(_is_number, told)):
        return meanings, body
    units = [re.sub(r"^[\[(](.*)[\])]$", r"\1", cell).strip(" -") or None for cell in told]
    joined = [
        meaning if unit is None else meaning._replace(unit=unit) for meaning, unit in zip(meanings, units, strict=True)
    ]
    return joined, _Body(body.header, body.rows[1:], body.first_line + 1)


def _columns(meanings: Sequence[Meaning], body: _Body, source: Source) -> tuple[Column, ...]:
    for row, cells in enumerate(body.rows):
        if len(cells) != len(meanings):
            found = len(cells) if any(cell.strip() for cell in cells) else 0
            advice = "give one number for each"
            if row == 0:
                advice = f"put # before lines above the header, and {advice}"
            raise UserError(
                f"{source.file}, {source.place(row)}: {found} cells where the header has {len(meanings)} columns, "
                f"{advice}"
            )
    by_column = zip(*body.rows, strict=True)
    return tuple(
        _column(meaning, cell.strip(), cells, source)
        for meaning, cell, cells in zip(meanings, body.header, by_column, strict=True)
    )


def _column(meaning: Meaning, cell: str, cells: Sequence[str], source: Source) -> Column:
    name, unit, minus, minus_unit = meaning
    fault, values = "", np.empty(0)
    try:
        values = _values(cells, lambda row: f"{source.file}, {source.place(row)}, column {name.lower()}")
    except UserError as error:
        fault = str(error)
    return Column(
        label=name,
        values=values,
        unit=unit,
        minus=minus,
        minus_unit=minus_unit,
        cell=cell,
        resolution=lambda: printed_quantum(cells),
        fault=fault,
    )


def _values(cells: Sequence[str], place: Callable[[int], str]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    try:
        values = np.array([float(cell) for cell in cells])
    except ValueError:
        values = np.array([np.nan])
    if np.all(np.isfinite(values)) and not any("_" in cell for cell in cells):
        return values
    return np.array([number(cell, place(row)) for row, cell in enumerate(cells)])


def _comment_labels(lines: Sequence[str], path: Path) -> Labels:
    """What the ``# key: value`` lines say; a line without a colon is kept as a remark."""
    stated: dict[str, tuple[int, str]] = {}
    remarks: list[str] = []
    for line_number, line in enumerate(lines, start=1):
        text = line.strip().lstrip("#").strip()
        key, colon, value = (part.strip() for part in text.partition(":"))
        if not colon or not key:
            remarks += [text] if text else []
        elif key in stated:
            raise UserError(
                f"{path}, line {line_number}: the key {key!r} was given in line {stated[key][0]} already, keep one"
            )
        else:
            stated[key] = (line_number, value)

    def numbers(prefix: str) -> dict[str, float]:
        chosen = {key: entry for key, entry in stated.items() if key.startswith(prefix)}
        return {
            key.removeprefix(prefix): number(value, f"{path}, line {line_number}, key {key!r}")
            for key, (line_number, value) in chosen.items()
        }

    step = stated.get("time_step")
    provenance = {
        key: value
        for key, (_, value) in stated.items()
        if key not in RESERVED_KEYS and not key.startswith(("true ", "noise_sd "))
    }
    if remarks:
        provenance["remarks"] = "; ".join([*([provenance["remarks"]] if "remarks" in provenance else []), *remarks])
    return Labels(
        name=stated["name"][1] if "name" in stated else path.stem,
        time_step=None if step is None else number(step[1], f"{path}, line {step[0]}, key 'time_step'"),
        provenance=provenance,
        truth=numbers("true "),
        noise_sd=numbers("noise_sd "),
    )
