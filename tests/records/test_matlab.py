"""MATLAB files of every version: numbers alone, and one sentence for every bad one."""

from __future__ import annotations

import pickle
import struct
import tempfile
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from matlab_files import save_v73
from scipy.io import savemat

from bwbn_bayes.errors import UserError
from bwbn_bayes.records import read_record

N = 40
MAP = "t = time [s], ag = ground_acceleration [g], run.roof = acceleration_2 [m/s^2], data(:,2) = drift_1 [mm]"
VARIABLES: dict[str, Any] = {
    "t": np.round(np.arange(N) / 256.0, 3),
    "ag": np.arange(N, dtype=np.int16)[:, None],
    "run": {"roof": np.arange(N) ** 2.0, "operator": "somebody"},
    "data": np.column_stack([np.ones(N), np.arange(N), np.zeros(N)]),
    "cells": np.array(["a", 1], dtype=object),
    "fs": 256.0,
}


def save(path: Path, version: str, variables: dict[str, Any]) -> Path:
    if version == "7.3":
        return save_v73(path, variables)
    savemat(path, variables, do_compression=version == "7")
    return path


@pytest.mark.parametrize("version", ["5", "7", "7.3"])
def test_every_version_reads_alike(tmp_path: Path, version: str) -> None:
    record = read_record(save(tmp_path / "run.mat", version, VARIABLES), MAP)
    assert record.name == "run"
    assert record.time_step == 1 / 256
    assert list(record.channels) == ["acceleration_2", "drift_1"]
    np.testing.assert_allclose(record.excitation, 9.80665 * np.arange(N), rtol=1e-15)
    np.testing.assert_array_equal(record.channels["acceleration_2"], np.arange(N) ** 2.0)
    np.testing.assert_allclose(record.channels["drift_1"], 1e-3 * np.arange(N), rtol=1e-15)


def test_the_other_byte_order(tmp_path: Path) -> None:
    """A file by hand, as a big-endian machine wrote it: a small element, padding, and a name of one letter."""

    def element(kind: int, data: bytes) -> bytes:
        return struct.pack(">II", kind, len(data)) + data + b"\x00" * (-len(data) % 8)

    def matrix(name: bytes, values: np.ndarray) -> bytes:
        small = struct.pack(">HH", len(name), 1) + name.ljust(4, b"\x00")
        flags, shape = element(6, struct.pack(">II", 6, 0)), element(5, struct.pack(">ii", len(values), 1))
        return element(14, flags + shape + small + element(3, values.astype(">i2").tobytes()))

    body = matrix(b"a", np.arange(N)) + matrix(b"f", np.array([200]))
    (tmp_path / "run.mat").write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x01\x00MI" + body)
    record = read_record(tmp_path / "run.mat", "f = sampling_rate [Hz], a = ground_acceleration [m/s^2]")
    assert record.time_step == 0.005
    np.testing.assert_array_equal(record.excitation, np.arange(N))


@settings(max_examples=60, deadline=None)
@given(
    values=st.sampled_from(["f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4"]).flatmap(
        lambda kind: arrays(kind, st.tuples(st.integers(8, 20), st.integers(1, 3)), elements=st.integers(0, 127))
    ),
    compress=st.booleans(),
)
def test_any_numbers_that_scipy_writes(values: np.ndarray, compress: bool) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mat"
        savemat(path, {"some": {"thing": {"x": values}}}, do_compression=compress)
        label = "some.thing.x" if values.shape[1] == 1 else f"some.thing.x(:,{values.shape[1]})"
        record = read_record(path, f"1 = time_step [s], {label} = ground_acceleration [m/s^2]")
    np.testing.assert_array_equal(record.excitation, values[:, -1].astype(np.float64))


@pytest.mark.parametrize("version", ["5", "7.3"])
@pytest.mark.parametrize(
    ("columns", "sentence"),
    [
        (None, "{path}, column "),
        (
            "t = time, ag = ground_acceleration [g]",
            "{path}, column time: the unit is missing, say it in the column map",
        ),
        ("cells = time [s]", "{path}: no column is called 'cells', the file has"),
        (
            "t = time [s], ag = ground_acceleration [g], fs = acceleration_1 [g]",
            "{path}, column fs: 1 points where ground_acceleration has 40, they must be equal",
        ),
        (
            "t = time [s], bad = ground_acceleration [g]",
            "{path}, point 4, column bad: the value is nan, every value must be a finite number",
        ),
    ],
)
def test_every_mistake_gets_one_sentence(tmp_path: Path, version: str, columns: str | None, sentence: str) -> None:
    bad = np.arange(float(N))
    bad[3] = np.nan
    path = save(tmp_path / "run.mat", version, {**VARIABLES, "bad": bad})
    with pytest.raises(UserError) as caught:
        read_record(path, columns)
    assert str(caught.value).startswith(sentence.format(path=path))


def test_damaged_files(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    for version in ("5", "7", "7.3"):
        save(path, version, VARIABLES)
        path.write_bytes(path.read_bytes()[:700])
        with pytest.raises(UserError, match=r"run\.mat: the file is damaged, save it anew from MATLAB"):
            read_record(path, MAP)
    for data in (b"time [s]\n", pickle.dumps(Path.home)):
        path.write_bytes(data)
        with pytest.raises(
            UserError, match=r"run\.mat: the file is no MATLAB file of version 5 to 7.3, save it anew with -v7"
        ):
            read_record(path, MAP)
    for version in ("5", "7", "7.3"):  # letters of 7.3 are stored as whole numbers
        save(path, version, {"note": "nothing else"})
        with pytest.raises(UserError, match=r"run\.mat: the file holds no numbers"):
            read_record(path, MAP)


def test_what_points_to_another_file_is_not_followed(tmp_path: Path) -> None:
    """A record from somebody else could otherwise show files of ours."""
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["numbers"] = np.arange(float(N))
    (tmp_path / "secret.bin").write_bytes(np.arange(float(N)).tobytes())
    path = save_v73(tmp_path / "run.mat", VARIABLES)
    with h5py.File(path, "a") as file:
        file["link"] = h5py.ExternalLink(str(tmp_path / "secret.h5"), "numbers")
        file.create_dataset("raw", (N,), float, external=[(str(tmp_path / "secret.bin"), 0, h5py.h5f.UNLIMITED)])
    for name in ("link", "raw"):
        with pytest.raises(UserError, match=f"no column is called '{name}'"):
            read_record(path, f"t = time [s], {name} = ground_acceleration [g]")
