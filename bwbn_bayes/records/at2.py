"""PEER's ``.AT2`` ground motions."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from bwbn_bayes.errors import UserError
from bwbn_bayes.records.columns import Column, Table, record_of
from bwbn_bayes.records.labels import Labels
from bwbn_bayes.records.record import Record
from bwbn_bayes.records.text import ascii_lines, number
from bwbn_bayes.records.time_base import Source

_COUNT = re.compile(r"NPTS\s*=\s*(\d{1,12})\s*,\s*DT\s*=\s*([0-9.Ee+-]+)", re.IGNORECASE)
_COUNT_OLD = re.compile(r"\s*(\d{1,12})\s+([0-9.Ee+-]+)\s+NPTS\s*,\s*DT", re.IGNORECASE)
_UNIT = re.compile(r"ACCELERATION.*UNITS\s+OF\s+(.+)", re.IGNORECASE)


def read_at2(path: Path | str, columns: str | None = None) -> Record:
    """Read a ground motion in PEER's ``.AT2`` format, old or new header.

    Parameters
    ----------
    path : Path or str
        Four header lines (the third names the unit, the fourth ``NPTS`` and ``DT``), then numbers.
    columns : str, optional
        A column map; the one column is called ``ground_acceleration``.

    Returns
    -------
    Record
        Without channels; ``excitation`` in m/s^2, one g being 9.80665 m/s^2.

    Raises
    ------
    UserError
        If the header is not understood, a number is wrong, or there are more or fewer than ``NPTS`` numbers.
    """
    lines = ascii_lines(Path(path))
    unit = _UNIT.search(lines[2]) if len(lines) > 3 else None
    if unit is None:
        raise UserError(
            f"{path}, line 3: no 'ACCELERATION ... IN UNITS OF', the file is not a PEER acceleration record"
        )
    count = _COUNT.search(lines[3]) or _COUNT_OLD.match(lines[3])
    if count is None:
        raise UserError(f"{path}, line 4: no 'NPTS= ..., DT= ...', the file is not a PEER acceleration record")
    time_step = number(count.group(2), f"{path}, line 4, DT")
    numbers = [
        number(cell, f"{path}, line {i}, column {position}")
        for i, line in enumerate(lines[4:], start=5)
        for position, cell in enumerate(line.split(), start=1)
    ]
    if len(numbers) != int(count.group(1)):
        fault = "truncated" if len(numbers) < int(count.group(1)) else "too long"
        raise UserError(
            f"{path}, line 4: NPTS is {count.group(1)} but {len(numbers)} numbers follow, the file is {fault}"
        )
    column = Column(label="ground_acceleration", values=np.array(numbers), unit=unit.group(1).strip())
    labels = Labels(name=Path(path).stem, time_step=time_step, provenance={"database": lines[0], "event": lines[1]})
    source = Source(file=str(path), header=f"{path}, line 3", place=lambda row: f"number {row + 1}")
    return record_of(Table(columns=(column,), labels=labels, source=source), columns)
