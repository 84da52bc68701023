"""The COSMOS strong-motion format, version 1.20: corrected or uncorrected acceleration, one or more channels."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.columns import Column, Table, record_of
from bwbn_bayes.records.labels import Labels
from bwbn_bayes.records.record import Record
from bwbn_bayes.records.text import ascii_lines, number
from bwbn_bayes.records.time_base import Source

_FORMAT = re.compile(r"\bformat\s+v?\d", re.IGNORECASE)
_REALS = re.compile(r"\s*(\d{1,5})\s+Real-header values follow on\s+\d+\s+lines", re.IGNORECASE)
_DATA = re.compile(
    r"\s*(\d{1,9})\s+(?:un)?(?:cor\w*\.?\s+)?(acc|vel|dis)\w*\.?\s+(?:pts|points).*?approx\s+(\d+)\s+secs?.*?"
    r"units\s*=\s*([^\s,()]+)",
    re.IGNORECASE,
)
_WIDTH = re.compile(r"Format\s*=?\s*\(\s*\d*\s*[A-Z]\s*(\d{1,2})\.", re.IGNORECASE)
_CHANNEL = re.compile(r"\bSta(?:tion)?\s+Chan\s+(\w+)\s*:\s*([^(]*?)\s*(?:\(.*)?(?:Location:\s*(.*))?$", re.IGNORECASE)


class _Series(NamedTuple):
    """One channel's acceleration: where it starts, its station channel, unit, time step [s] and numbers."""

    line: int
    channel: str
    unit: str
    time_step: float
    values: Floats


def read_cosmos(path: Path | str, columns: str | None = None) -> Record:
    """Read accelerations from a COSMOS file, ``.V1`` or ``.V2``.

    Parameters
    ----------
    path : Path or str
        Channels are called ``channel 1`` and so on, by the number of the station's channel; velocities and
        displacements are passed over.
    columns : str, optional
        A column map; a single channel is a ground acceleration where it is left out.

    Raises
    ------
    UserError
        If the file is another format, is truncated, or its channels have different time steps.

    References
    ----------
    .. [1] COSMOS Strong Motion Programs Board, "Strong Motion Data Format", version 1.20, 2001.
    """
    lines = ascii_lines(Path(path))
    if _FORMAT.search(lines[0]) is None:
        raise UserError(
            f"{path}, line 1: no 'Format v01.20', the file is not in COSMOS format (older .V2 files are not), get it "
            "in that format or as CSV"
        )
    series = _all_series(lines, path)
    first = series[0]
    for each in series:
        if each.time_step != first.time_step:
            raise UserError(
                f"{path}, line {each.line}: the time step is {each.time_step:g} s, in the first channel "
                f"{first.time_step:g} s, keep channels of one time step in the file"
            )
    if columns is None and len(series) == 1:
        columns = f"channel {first.channel} = ground_acceleration"
    source = Source(file=str(path), header=str(path), place=lambda row: f"number {row + 1}")
    found = tuple(Column(label=f"channel {each.channel}", values=each.values, unit=each.unit) for each in series)
    told = {"event": lines[1], "station": lines[4]} if len(lines) > 4 else {}
    labels = Labels(name=Path(path).stem, time_step=first.time_step, provenance=told)
    return record_of(Table(columns=found, labels=labels, source=source), columns)


def _all_series(lines: Sequence[str], path: Path | str) -> list[_Series]:
    """Acceleration blocks in their order; each stands behind the headers of its own channel."""
    series: list[_Series] = []
    channel, reals, i = "", np.empty(0), 0
    while i < len(lines):
        named, header, data = _CHANNEL.search(lines[i]), _REALS.match(lines[i]), _DATA.match(lines[i])
        if named is not None:
            channel = named.group(1)
        elif header is not None:
            reals, i = _fixed(lines, i, int(header.group(1)), path)
            continue
        elif data is not None:
            values, after = _fixed(lines, i, int(data.group(1)), path)
            if data.group(2).lower() == "acc":
                step = _time_step(reals, len(values), float(data.group(3)), f"{path}, line {i + 1}")
                name = channel if channel and all(channel != each.channel for each in series) else str(len(series) + 1)
                series.append(_Series(i + 1, name, data.group(4), step, values))
            i = after
            continue
        i += 1
    if not series:
        raise UserError(f"{path}: no line '... acceleration pts, ... units=...', the file holds no acceleration")
    return series


def _fixed(lines: Sequence[str], head: int, count: int, path: Path | str) -> tuple[Floats, int]:
    """Numbers in cells of the width that the line before them states, and the line after them."""
    stated = _WIDTH.search(lines[head])
    if stated is None or stated.group(1) in ("0", "00"):
        raise UserError(f"{path}, line {head + 1}: no 'Format=(...)', the file is damaged, get it anew")
    width, numbers, i = int(stated.group(1)), list[float](), head + 1
    while len(numbers) < count and i < len(lines) and lines[i].strip():
        line = lines[i].rstrip()
        numbers += [
            number(line[start : start + width], f"{path}, line {i + 1}, column {start // width + 1}")
            for start in range(0, len(line), width)
        ]
        i += 1
    if len(numbers) != count:
        raise UserError(
            f"{path}, line {head + 1}: {count} numbers are announced but {len(numbers)} follow, the file is damaged, "
            "get it anew"
        )
    return np.array(numbers), i


def _time_step(reals: Floats, n_times: int, seconds: float, place: str) -> float:
    """The step of the series [s]: real header 62 in ms, else that of the raw record, header 34 in s."""
    known = (
        [value * unit for value, unit in zip(reals[[61, 33]], (1e-3, 1.0), strict=True) if value > 0.0]
        if (len(reals) > 61)
        else []
    )
    for step in known:
        if abs(n_times * step - seconds) <= 2.0 + 0.01 * seconds:
            return float(f"{step:.12g}")
    raise UserError(
        f"{place}: no time step in the real header agrees with {n_times} points in {seconds:g} s, the file is damaged, "
        "get it anew"
    )
