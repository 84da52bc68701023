"""A MATLAB file of version 7.3, as MATLAB lays it out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np


def save_v73(path: Path, variables: dict[str, Any]) -> Path:
    """HDF5 as MATLAB 7.3 lays it out: a text of its own first, dimensions in MATLAB's order, structures as groups."""

    def put(group: h5py.Group, values: dict[str, Any]) -> None:
        for name, value in values.items():
            if isinstance(value, dict):
                put(group.create_group(name), value)
            elif isinstance(value, str):
                group[name] = np.frombuffer(value.encode("utf-16-le"), dtype=np.uint16)[:, None]
                group[name].attrs["MATLAB_class"] = np.bytes_("char")
            elif np.asarray(value).dtype.kind == "O":
                group.create_dataset(name, data=np.array([group.file["t"].ref] * 2, dtype=h5py.ref_dtype)[:, None])
            else:
                # A vector of n numbers is n x 1 in MATLAB and 1 x n here.
                group[name] = np.atleast_2d(np.asarray(value).T if np.ndim(value) != 1 else np.asarray(value))

    with h5py.File(path, "w", userblock_size=512) as file:
        put(file, variables)
    data = bytearray(path.read_bytes())
    text = b"MATLAB 7.3 MAT-file, Platform: GLNXA64"
    data[: len(text)] = text
    path.write_bytes(bytes(data))
    return path
