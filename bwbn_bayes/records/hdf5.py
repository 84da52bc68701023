"""netCDF-4 files are HDF5 files, to be opened as such first."""

from __future__ import annotations

from pathlib import Path

import h5py

from bwbn_bayes.records.text import is_plain


def require_hdf5(path: Path | str) -> None:
    """Raise what h5py raises (OSError, KeyError, RuntimeError) unless a file can be opened as HDF5.

    Where it cannot, h5netcdf leaves an object half made, which tells of it on stderr when it is collected.
    """
    if not is_plain(Path(path)):
        raise OSError(f"{path} is no plain file")
    with h5py.File(path, "r") as file:
        file.attrs.get("_nc3_strict")  # what h5netcdf asks before its object is whole
