"""Records from and to files, by the suffix of their names. A data file never executes anything."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from bwbn_bayes.errors import UserError, require_kind
from bwbn_bayes.records.at2 import read_at2
from bwbn_bayes.records.cosmos import read_cosmos
from bwbn_bayes.records.delimited import read_csv, write_csv
from bwbn_bayes.records.matlab import read_matlab
from bwbn_bayes.records.miniseed import read_miniseed
from bwbn_bayes.records.netcdf import read_netcdf, write_netcdf
from bwbn_bayes.records.record import Record
from bwbn_bayes.records.smc import read_smc

_READERS: dict[str, Callable[[Path, str | None], Record]] = {
    **dict.fromkeys((".csv", ".tsv", ".txt", ".dat"), read_csv),
    ".nc": read_netcdf,
    ".mat": read_matlab,
    ".at2": read_at2,
    **dict.fromkeys((".v1", ".v2", ".v1c", ".v2c"), read_cosmos),
    ".smc": read_smc,
    **dict.fromkeys((".mseed", ".miniseed"), read_miniseed),
}
_WRITERS: dict[str, Callable[[Record, Path], None]] = {".csv": write_csv, ".nc": write_netcdf}

RECORD_SUFFIXES = tuple(_READERS)
"""Suffixes of the files that hold a record, in lower case."""


def suffix_in_words(path: Path | str) -> str:
    """What is wrong with the suffix of a file that no reader knows."""
    suffix = Path(path).suffix
    return f"the suffix {suffix!r} is not known" if suffix else "its name has no suffix"


def read_record(path: Path | str, columns: str | None = None) -> Record:
    """Read a record from a file.

    Parameters
    ----------
    path : Path or str
        The file; its suffix decides the format (upper or lower case): ``.csv``, ``.tsv``, ``.txt`` or ``.dat``
        (delimited text), ``.nc`` (netCDF), ``.mat`` (MATLAB), ``.AT2`` (PEER), ``.V1``, ``.V2`` (COSMOS), ``.smc``
        (USGS), ``.mseed`` (miniSEED).
    columns : str, optional
        What the columns stand for where the file does not call them as this package does, such as
        ``"ag = ground_acceleration [g], roof = acceleration_3 [g]"``
        (:mod:`~bwbn_bayes.records.column_map`).

    Raises
    ------
    UserError
        If the file is missing or wrong: one sentence that names the file, the line and the column.
    """
    require_kind("path", path, (str, Path), "give the name of a file")
    suffix = Path(path).suffix.lower()
    if suffix not in _READERS:
        raise UserError(f"{path}: {suffix_in_words(path)}, use {', '.join(RECORD_SUFFIXES)}")
    return _READERS[suffix](Path(path), columns)


def write_record(record: Record, path: Path | str) -> None:
    """Write a record to a ``.csv`` or ``.nc`` file; reading it gives an equal record.

    Raises
    ------
    UserError
        If the suffix is another one or the file cannot be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in _WRITERS:
        raise UserError(f"{path}: the suffix {suffix!r} cannot be written, use .csv or .nc")
    _WRITERS[suffix](record, Path(path))
