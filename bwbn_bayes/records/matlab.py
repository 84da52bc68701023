"""MATLAB's ``.mat`` files: numbers alone are read, whatever else is in them."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.errors import UNREADABLE_ARRAYS, UserError
from bwbn_bayes.records.columns import Column, Table, record_of
from bwbn_bayes.records.hdf5 import require_heaps
from bwbn_bayes.records.labels import Labels
from bwbn_bayes.records.matlab5 import DEEPEST, arrays, is_matlab5
from bwbn_bayes.records.record import Record
from bwbn_bayes.records.series import column_of
from bwbn_bayes.records.text import file_bytes
from bwbn_bayes.records.time_base import Source

MOST_COLUMNS = 1000
"""Of one matrix."""

_UNIT_ADVICE = 'say it in the column map, as in "x = {name} [{unit}]"'


def read_matlab(path: Path | str, columns: str | None = None) -> Record:
    """Read a record from a ``.mat`` file, of MATLAB's version 5 to 7.3.

    Parameters
    ----------
    path : Path or str
        Its variables are the columns; a field of a structure is called ``run.roof``, a column of a matrix
        ``data(:,2)``. Text, cells and objects are passed over; nothing in the file is executed.
    columns : str, optional
        A column map. MATLAB's variables have no units, so that it is needed.

    Raises
    ------
    UserError
        If the file is damaged, or a variable is missing or holds no numbers.
    """
    data = file_bytes(Path(path))
    source = Source(file=str(path), header=str(path), place=lambda row: f"point {row + 1}")
    try:
        if data[:19] == b"MATLAB 7.3 MAT-file":
            require_heaps(path)
            with h5py.File(path, "r") as file:
                found = tuple(_columns(_hdf5_arrays(file), source))
        elif is_matlab5(data):
            found = tuple(_columns(arrays(data), source))
        else:
            raise UserError(f"{path}: the file is no MATLAB file of version 5 to 7.3, save it anew with -v7")
    except UserError:
        raise
    except (*UNREADABLE_ARRAYS, struct.error):
        raise UserError(f"{path}: the file is damaged, save it anew from MATLAB") from None
    if not found:
        raise UserError(f"{path}: the file holds no numbers, save arrays as in save('run.mat', 't', 'ag')")
    labels = Labels(name=Path(path).stem)
    return record_of(Table(columns=found, labels=labels, source=source, unit_advice=_UNIT_ADVICE), columns)


def _columns(named: Iterator[tuple[str, NDArray[Any]]], source: Source) -> Iterator[Column]:
    for label, stored in named:
        array = np.squeeze(stored)
        if array.ndim == 2 and min(array.shape) <= MOST_COLUMNS:
            stand = array.shape[0] >= array.shape[1]
            rows, pattern = (array.T, "{}(:,{})") if stand else (array, "{}({},:)")
            for position, row in enumerate(rows, start=1):
                yield column_of(np.asarray(row), pattern.format(label, position), None, source)
        else:
            yield column_of(array, label, None, source)


def _hdf5_arrays(group: h5py.Group, prefix: str = "", depth: int = 0) -> Iterator[tuple[str, NDArray[Any]]]:
    """The same of a file of version 7.3; what points to another file is not followed."""
    for name in group:
        if name.startswith("#") or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue
        item = group[name]
        if isinstance(item, h5py.Group) and depth < DEEPEST:
            yield from _hdf5_arrays(item, f"{prefix}{name}.", depth + 1)
        elif isinstance(item, h5py.Dataset) and _holds_numbers(item):
            # MATLAB stores the last dimension first.
            yield prefix + name, np.asarray(item[()]).T


def _holds_numbers(item: h5py.Dataset) -> bool:
    is_own = not (item.external or item.is_virtual)
    is_plain = is_own and item.dtype.kind in "fiu" and item.ndim <= 2 and "MATLAB_empty" not in item.attrs
    # MATLAB stores letters as whole numbers.
    return is_plain and item.attrs.get("MATLAB_class", b"double") not in (b"char", b"cell")
