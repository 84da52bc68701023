"""netCDF records: exact round trips, files from elsewhere, and one sentence for every bad file."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from record_strategies import records

from bwbn_bayes.errors import UserError
from bwbn_bayes.records import Record, as_dataset, read_netcdf, read_record, sine, write_netcdf, write_record
from bwbn_bayes.records.hdf5 import require_heaps


@settings(max_examples=30, deadline=None)
@given(records())
def test_round_trip_is_exact(record: Record) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.nc"
        write_netcdf(record, path)
        again = read_netcdf(path)
    assert again.equals(record)
    assert again.content_hash == record.content_hash


def test_dataset_carries_units() -> None:
    record = Record(
        name="x", time_step=0.1, excitation=np.zeros(8), channels={"drift_1": np.ones(8), "force_1": np.ones(8)}
    )
    dataset = as_dataset(record)
    units = {name: variable.attrs["units"] for name, variable in dataset.variables.items()}
    assert units == {"time": "s", "ground_acceleration": "m/s^2", "drift_1": "m", "force_1": "N"}
    np.testing.assert_array_equal(dataset["time"], record.times)


def foreign() -> xr.Dataset:
    """A file as another program would write it: single precision, its own units, seconds spelt out."""
    times = (0.01 * np.arange(5000)).astype(np.float32)
    return xr.Dataset(
        {
            "ground_acceleration": ("time", np.full(5000, 0.5), {"units": "g"}),
            "drift_1": ("time", np.full(5000, 2, dtype=np.int16), {"units": "mm"}),
        },
        coords={"time": ("time", times, {"units": "seconds"})},
    )


def save(dataset: xr.Dataset, path: Path) -> Path:
    dataset.to_netcdf(path, engine="h5netcdf")
    return path


def test_reads_a_file_from_elsewhere(tmp_path: Path) -> None:
    record = read_record(save(foreign(), tmp_path / "run.nc"))
    assert record.name == "run"
    assert record.time_step == 0.01
    assert record.excitation[0] == 0.5 * 9.80665
    assert record.channels["drift_1"][0] == 0.002


def test_packed_numbers_are_unpacked(tmp_path: Path) -> None:
    """Whole numbers with a scale were read as they are stored, a missing sample as one of them."""
    drift = 0.001 * np.arange(2000.0) + 5.0
    packing = {"scale_factor": 0.001, "add_offset": 5.0, "_FillValue": -32768, "dtype": "int16"}
    times = ("time", 0.01 * np.arange(2000), {"units": "seconds"})
    dataset = xr.Dataset(
        {"ground_acceleration": ("time", np.ones(2000), {"units": "g"}), "drift_1": ("time", drift, {"units": "m"})},
        coords={"time": times},
    )
    packed = {"drift_1": packing, "time": {"scale_factor": 0.01, "dtype": "int32"}}
    path = tmp_path / "run.nc"
    dataset.to_netcdf(path, engine="h5netcdf", encoding=packed)
    record = read_record(path)
    assert record.time_step == 0.01
    np.testing.assert_allclose(record.channels["drift_1"], drift, rtol=1e-12)
    dataset["drift_1"].values[6] = np.nan
    dataset.to_netcdf(path, engine="h5netcdf", encoding=packed)
    with pytest.raises(UserError, match="point 7, column drift_1: the value is nan"):
        read_record(path)


def dropped(dataset: xr.Dataset) -> xr.Dataset:
    return dataset.isel(time=np.delete(np.arange(5000), 40))


def with_nan(dataset: xr.Dataset) -> xr.Dataset:
    dataset["ground_acceleration"].values[6] = np.nan
    return dataset


def unitless(dataset: xr.Dataset) -> xr.Dataset:
    del dataset["drift_1"].attrs["units"]
    return dataset


def in_newton(dataset: xr.Dataset) -> xr.Dataset:
    dataset["drift_1"].attrs["units"] = "N"
    return dataset


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            dropped,
            "{path}, point 41, column time: the step is 0.02 s where the others are 0.0100002 s, resample to a uniform",
        ),
        (
            with_nan,
            "{path}, point 7, column ground_acceleration: the value is nan, every value must be a finite number",
        ),
        (unitless, "{path}, column drift_1: the unit is missing, set the attribute units to 'm'"),
        (in_newton, "{path}, column drift_1: the unit [N] has the wrong dimension: write a unit of drift such as m"),
        (lambda d: d.rename(drift_1="speed"), "{path}, column speed: the name is not known, use time"),
        (lambda d: d.drop_vars("time"), "{path}: column time is missing, add it"),
        (lambda d: d.drop_vars("ground_acceleration"), "{path}: column ground_acceleration is missing"),
        (lambda d: d.isel(time=slice(5)), "{path}: the record has 5 points: at least 8 are needed"),
        (lambda d: d.isel(time=slice(1)), "{path}: the record has 1 points: at least 8 are needed"),
        (lambda d: d.isel(time=slice(0)), "{path}: the record has 0 points: at least 8 are needed"),
        (lambda d: d.assign_attrs(record="{"), "{path}: the attribute 'record' is damaged"),
        (lambda d: d.assign_attrs(record='{"truth": {"k": "many"}}'), "{path}: the attribute 'record' is damaged"),
        (
            lambda d: d.assign_attrs(record='{"time_step": 0.5}'),
            "{path}, column time: the time_step is stated as 0.5 s",
        ),
        (
            lambda d: d.assign(drift_2=("other", np.ones(9), {"units": "m"})),
            "{path}, column drift_2: 9 points where ground_acceleration has 5000, they must be equal",
        ),
        (
            lambda d: d.assign(drift_2=(("time", "side"), np.ones((5000, 2)), {"units": "m"})),
            "{path}, column drift_2: it must hold one number for each time",
        ),
    ],
)
def test_every_bad_file_gets_one_sentence(
    tmp_path: Path, change: Callable[[xr.Dataset], xr.Dataset], sentence: str
) -> None:
    path = save(change(foreign()), tmp_path / "run.nc")
    with pytest.raises(UserError) as caught:
        read_record(path)
    assert str(caught.value).startswith(sentence.format(path=path))
    assert "\n" not in str(caught.value)


def test_damaged_and_missing_files(tmp_path: Path) -> None:
    path = tmp_path / "run.nc"
    with pytest.raises(UserError, match=r"run.nc: no such file, give the path of one$"):
        read_record(path)
    path.write_bytes(b"")
    with pytest.raises(UserError, match=r"run.nc: the file is empty, get it anew$"):
        read_record(path)
    path.write_text("time [s]\n")
    with pytest.raises(
        UserError, match=r"run.nc: the file is not netCDF-4, or it is damaged: save it anew as netCDF-4, or give CSV$"
    ):
        read_record(path)
    save(foreign(), path)
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(
        UserError, match=r"run.nc: the file is not netCDF-4, or it is damaged: save it anew as netCDF-4, or give CSV$"
    ):
        read_record(path)


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        (
            "nothing",
            h5py.Empty("f8"),
            "the file is not netCDF-4, or it is damaged: save it anew as netCDF-4, or give CSV$",
        ),
        ("own", np.dtype("f8"), "the file is not netCDF-4, or it is damaged: save it anew as netCDF-4, or give CSV$"),
        ("plain", np.zeros(8), "column plain: the name is not known"),
    ],
)
def test_an_hdf5_file_of_another_kind_is_refused(tmp_path: Path, name: str, value: object, sentence: str) -> None:
    """Empty arrays and named types ended in tracebacks of h5netcdf, arrays without names in its warning."""
    with h5py.File(tmp_path / "run.nc", "w") as file:
        file[name] = value
    with pytest.raises(UserError, match=rf"run.nc[:,] {sentence}"):
        read_record(tmp_path / "run.nc")


def test_writing_where_it_cannot(tmp_path: Path) -> None:
    record = Record(name="x", time_step=0.1, excitation=np.zeros(8))
    with pytest.raises(UserError, match=r"run.nc: the file cannot be written"):
        write_record(record, tmp_path / "absent" / "run.nc")


@pytest.mark.parametrize(("number", "size"), [(0, 0), (0, 2**40), (1, 2**64 - 16), (1, 2**64 - 64), (1, 2**40)])
def test_a_heap_without_an_end_is_refused(tmp_path: Path, number: int, size: int) -> None:
    """HDF5 walked it for ever, deaf to Ctrl-C: fuzzing found it."""
    path = tmp_path / "record.nc"
    motion = sine(amplitude=1.0, frequency_hz=1.0, duration=0.5, time_step=0.05)
    write_record(motion.with_channels({"acceleration_1": np.array(motion.excitation)}), path)
    whole = path.read_bytes()
    assert read_record(path).n_times == motion.n_times
    first = whole.index(b"GCOL") + 16
    head = number.to_bytes(2, "little") + bytes(6) + size.to_bytes(8, "little")
    path.write_bytes(whole[:first] + head + whole[first + 16 :])
    with pytest.raises(OSError, match="has no end"):
        require_heaps(path)
    with pytest.raises(UserError, match="not netCDF-4, or it is damaged"):
        read_record(path)
