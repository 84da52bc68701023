"""The SMC format of the USGS: one time series of acceleration."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.columns import Column, Table, record_of
from bwbn_bayes.records.labels import Labels
from bwbn_bayes.records.record import Record
from bwbn_bayes.records.text import ascii_lines, number
from bwbn_bayes.records.time_base import Source

_KIND = re.compile(r"\s*[12] (?:UN)?CORRECTED ACCELEROGRAM")
_TEXT, _INTEGERS, _REALS = 11, 6, 10
_N_COMMENTS, _N_VALUES, _RATE = 15, 16, 1


def read_smc(path: Path | str, columns: str | None = None) -> Record:
    """Read a ground motion in the SMC format: 11 lines of text, 48 integers, 50 reals, comments, values in cm/s^2.

    Parameters
    ----------
    path : Path or str
    columns : str, optional
        A column map; the one column is called ``ground_acceleration``.

    Raises
    ------
    UserError
        If the file holds no acceleration with a constant sampling rate, a number is wrong, or some are missing.

    References
    ----------
    .. [1] USGS National Strong-Motion Program, "SMC- and BBF-format data files".
    """
    lines = ascii_lines(Path(path))
    if _KIND.match(lines[0]) is None:
        raise UserError(
            f"{path}, line 1: neither '1 UNCORRECTED' nor '2 CORRECTED ACCELEROGRAM', the file is no acceleration in "
            "SMC format"
        )
    after = _TEXT + _INTEGERS + _REALS
    if len(lines) <= after:
        raise UserError(f"{path}: the file ends in its header, it is damaged, get it anew")
    integers = _fixed(lines, _TEXT, _TEXT + _INTEGERS, 10, path)
    reals = _fixed(lines, _TEXT + _INTEGERS, after, 15, path)
    if len(integers) <= _N_VALUES or len(reals) <= _RATE or not 0.0 < reals[_RATE] < 1e6:
        raise UserError(f"{path}: the header states no sampling rate, get a file with one")
    first = after + max(0, int(integers[_N_COMMENTS]))
    values = _fixed(lines, first, len(lines), 10, path)
    if len(values) != int(integers[_N_VALUES]):
        raise UserError(
            f"{path}: {int(integers[_N_VALUES])} values are announced but {len(values)} follow, the file is damaged, "
            "get it anew"
        )
    column = Column(label="ground_acceleration", values=values, unit="cm/s^2")
    told = {"event": lines[3].strip(), "station": lines[5].strip()}
    labels = Labels(name=Path(path).stem, time_step=1.0 / float(reals[_RATE]), provenance=told)
    source = Source(file=str(path), header=str(path), place=lambda row: f"value {row + 1}")
    return record_of(Table(columns=(column,), labels=labels, source=source), columns)


def _fixed(lines: Sequence[str], first: int, last: int, width: int, path: Path | str) -> Floats:
    """Numbers in cells of a width, from one line to another; they may touch."""
    cells = [
        (i + 1, start // width + 1, line[start : start + width])
        for i, line in enumerate((each.rstrip() for each in lines[first:last]), start=first)
        for start in range(0, len(line), width)
    ]
    return np.array([number(cell, f"{path}, line {line}, column {column}") for line, column, cell in cells])
