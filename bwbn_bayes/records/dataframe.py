"""Records as pandas data frames."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bwbn_bayes.errors import UserError
from bwbn_bayes.records.column_map import Meaning, find_column, header_meaning
from bwbn_bayes.records.columns import Column, Table, record_of
from bwbn_bayes.records.labels import labels_as_json, labels_of_json
from bwbn_bayes.records.record import Record, si_unit
from bwbn_bayes.records.series import column_of
from bwbn_bayes.records.text import number
from bwbn_bayes.records.time_base import Source


def as_dataframe(record: Record) -> pd.DataFrame:
    """The record as a data frame in SI units: ``ground_acceleration [m/s^2]`` and so on over the index ``time [s]``.

    What is known beside the numbers stands in ``attrs["record"]``, so that :func:`record_from_dataframe` gives an equal
    record.
    """
    arrays = record.columns
    frame = pd.DataFrame(
        {f"{name} [{si_unit(name)}]": values for name, values in arrays.items()},
        index=pd.Index(record.times, name="time [s]"),
    )
    frame.attrs["record"] = labels_as_json(record)
    return frame


def record_from_dataframe(frame: pd.DataFrame, columns: str | None = None, *, name: str = "data frame") -> Record:
    """A record from a data frame.

    Parameters
    ----------
    frame : pandas.DataFrame
        Columns named as in a CSV file, ``acceleration_1 [g]``; time as a column, or as an index that has its name or
        holds dates or time differences.
    columns : str, optional
        A column map (:mod:`~bwbn_bayes.records.column_map`) for columns that have other names, or no units.
    name : str
        What the record is called where the frame does not say, and the frame in error messages.

    Raises
    ------
    UserError
        One sentence naming row and column.
    """
    labels, order = labels_of_json(frame.attrs.get("record"), name, name)
    source = Source(file=name, header=name, place=lambda row: f"row {row + 1}")
    found = [_column(str(label), frame.iloc[:, i], source) for i, label in enumerate(frame.columns)]
    index = frame.index
    is_date = isinstance(index, (pd.DatetimeIndex, pd.TimedeltaIndex))
    has_time = find_column("time", [column.labels for column in found]) is not None
    if not has_time and (is_date or index.name is not None):
        label = "time" if index.name is None else str(index.name)
        found.insert(0, _column(label, index.to_series(), source))
    if not found:
        raise UserError(f"{name}: it has no columns, give it time, ground_acceleration and channels")
    found.sort(key=lambda column: order.index(column.label) if column.label in order else -1)
    return record_of(Table(columns=tuple(found), labels=labels, source=source), columns)


def _column(cell: str, series: pd.Series, source: Source) -> Column:
    meaning = header_meaning(cell) or Meaning(cell)
    try:
        array = _array(series.infer_objects(), meaning.name, source)
        column = column_of(array, meaning.name, meaning.unit, source)
    except UserError as error:  # the user's to hear only where the column is used
        column = Column(label=meaning.name, values=np.empty(0), unit=meaning.unit, fault=str(error))
    return replace(column, cell=cell, minus=meaning.minus, minus_unit=meaning.minus_unit)


def _array(series: pd.Series, label: str, source: Source) -> NDArray[Any]:
    """What a column holds; cells of any kind that say a number, as text does, become numbers.

    Raises
    ------
    UserError
        Naming the first cell that is none.
    """
    if _is_extension(series):
        return np.asarray(series.to_numpy(dtype=np.float64, na_value=np.nan))
    array = np.asarray(series.to_numpy())
    if series.dtype.kind != "O":
        return array
    places = (f"{source.file}, {source.place(row)}, column {label}" for row in range(len(array)))
    return np.array([number(str(cell), place) for cell, place in zip(array, places, strict=True)])


def _is_extension(series: pd.Series) -> bool:
    """Whether pandas keeps numbers in a type of its own, with its own mark for what is missing."""
    kind = series.dtype
    return bool(pd.api.types.is_extension_array_dtype(kind) and pd.api.types.is_numeric_dtype(kind))
