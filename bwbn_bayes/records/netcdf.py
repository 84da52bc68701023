"""Records as xarray datasets and netCDF files: variables named and in units as in CSV, over one dimension."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from bwbn_bayes.errors import UNREADABLE_ARRAYS, UserError, replace_file
from bwbn_bayes.records.columns import Column, Table, record_of
from bwbn_bayes.records.hdf5 import require_hdf5
from bwbn_bayes.records.labels import labels_as_json, labels_of_json
from bwbn_bayes.records.record import Record, si_unit
from bwbn_bayes.records.series import column_of
from bwbn_bayes.records.text import file_bytes
from bwbn_bayes.records.time_base import Source


def as_dataset(record: Record) -> xr.Dataset:
    """The record as an xarray dataset over ``time`` with units; what :func:`write_netcdf` stores."""
    arrays = record.columns
    return xr.Dataset(
        {name: ("time", values, {"units": si_unit(name)}) for name, values in arrays.items()},
        coords={"time": ("time", record.times, {"units": "s"})},
        attrs={"record": labels_as_json(record)},
    )


def record_from_dataset(dataset: xr.Dataset, columns: str | None = None, *, name: str = "dataset") -> Record:
    """A record from an xarray dataset.

    Parameters
    ----------
    dataset : xarray.Dataset
        One variable for each column, over one dimension, its unit in the attribute ``units``; ``time`` in numbers, or
        as dates or time differences. What :func:`as_dataset` makes gives an equal record.
    columns : str, optional
        A column map (:mod:`~bwbn_bayes.records.column_map`) for variables that have other names, or no units.
    name : str
        What the record is called where the dataset does not say, and the dataset in error messages.

    Raises
    ------
    UserError
        One sentence naming the variable.
    """
    return _record(dataset, columns, name=name, place=name)


def _record(dataset: xr.Dataset, columns: str | None, *, name: str, place: str) -> Record:
    labels, order = labels_of_json(dataset.attrs.get("record"), name, place)
    names = sorted(dataset.variables, key=lambda each: order.index(str(each)) if str(each) in order else -1)
    source = Source(file=place, header=place, place=lambda row: f"point {row + 1}")
    found = tuple(_column(str(each), dataset.variables[each], source) for each in names)
    advice = "set the attribute units to '{unit}'"
    return record_of(Table(columns=found, labels=labels, source=source, unit_advice=advice), columns)


def _column(name: str, variable: xr.Variable, source: Source) -> Column:
    unit = variable.attrs.get("units")
    return column_of(variable.values, name, unit if isinstance(unit, str) else None, source)


def write_netcdf(record: Record, path: Path | str) -> None:
    """Write a record as netCDF, exactly.

    Raises
    ------
    UserError
        If the file cannot be written.
    """
    try:
        # By way of memory: HDF5 on a full disk ends in pages of its own.
        contents = bytes(as_dataset(record).to_netcdf(engine="h5netcdf"))
        replace_file(path, contents)
    except OSError as error:
        raise UserError(f"{path}: the file cannot be written ({error.strerror or error})") from None


def read_netcdf(path: Path | str, columns: str | None = None) -> Record:
    """Read a record from netCDF-4.

    Parameters
    ----------
    path : Path or str
    columns : str, optional
        A column map for variables that have other names, or no units.

    Raises
    ------
    UserError
        One sentence naming file and variable.
    """
    file_bytes(Path(path))
    try:
        require_hdf5(path)
        # decode_times would turn a time in "seconds" into a timedelta.
        dataset = xr.load_dataset(
            path,
            engine="h5netcdf",
            phony_dims="sort",
            mask_and_scale=True,
            decode_times=False,
            decode_timedelta=False,
            decode_coords=False,
            concat_characters=False,
        )
    except UNREADABLE_ARRAYS:
        raise UserError(
            f"{path}: the file is not netCDF-4, or it is damaged: save it anew as netCDF-4, or give CSV"
        ) from None
    return _record(dataset, columns, name=Path(path).stem, place=str(path))
