"""Records as data frames and datasets: exact round trips, time in every form, and one sentence for every mistake."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hypothesis import given, settings
from record_strategies import records

from bwbn_bayes import as_dataframe, as_dataset, record_from_dataframe, record_from_dataset
from bwbn_bayes.errors import UserError
from bwbn_bayes.records import Record

MAP = "ag = ground_acceleration [g], roof = acceleration_1 [m/s^2]"


@settings(max_examples=60, deadline=None)
@given(records())
def test_round_trips_are_exact(record: Record) -> None:
    for again in (record_from_dataframe(as_dataframe(record)), record_from_dataset(as_dataset(record))):
        assert again.equals(record)


def test_a_frame_shows_units() -> None:
    record = Record(name="x", time_step=0.1, excitation=np.zeros(8), channels={"drift_1": np.arange(8.0)})
    frame = as_dataframe(record)
    assert list(frame.columns) == ["ground_acceleration [m/s^2]", "drift_1 [m]"]
    assert frame.index.name == "time [s]"
    np.testing.assert_array_equal(frame.index, record.times)


def frame_with(index: pd.Index | None = None, **columns: object) -> pd.DataFrame:
    return pd.DataFrame({"ag": np.arange(10), "roof": np.arange(10.0) ** 2, **columns}, index=index)


@pytest.mark.parametrize(
    ("frame", "columns"),
    [
        (frame_with(pd.date_range("2024-05-01", periods=10, freq="20ms")), MAP),
        (frame_with(pd.to_timedelta(0.02 * np.arange(10), unit="s")), MAP),
        (frame_with(pd.Index(0.02 * np.arange(10), name="Time [s]")), MAP),
        (frame_with(pd.Index(20 * np.arange(10), name="t")), f"t = time [ms], {MAP}"),
        (frame_with(**{"Time (s)": 0.02 * np.arange(10)}), MAP),
        (frame_with(t=pd.date_range("2024-05-01", periods=10, freq="20ms")), f"t = time, {MAP}"),
        (frame_with(t=np.arange(10) / 50.0, note=["x"] * 10), f"t = time [s], {MAP}"),
        (frame_with(), f"50 = sampling_rate [Hz], {MAP}"),
        (frame_with(roof=pd.array(np.arange(10) ** 2, dtype="Int32")), f"50 = sampling_rate [Hz], {MAP}"),
        (frame_with(roof=pd.Series(np.arange(10) ** 2, dtype=object)), f"50 = sampling_rate [Hz], {MAP}"),
        (frame_with(roof=[f" {i**2}.0" for i in range(10)]), f"50 = sampling_rate [Hz], {MAP}"),
        (
            frame_with(roof=[Decimal(i**2) if i % 2 else str(i**2) for i in range(10)]),
            f"50 = sampling_rate [Hz], {MAP}",
        ),
        (frame_with(t=pd.Series(pd.date_range("2024", periods=10, freq="20ms"), dtype=object)), f"t = time, {MAP}"),
    ],
    ids=[
        "dates",
        "differences",
        "index",
        "index in ms",
        "column",
        "dates in a column",
        "text beside",
        "rate",
        "Int32",
        "objects",
        "text",
        "mixed",
        "dates as objects",
    ],
)
def test_time_in_every_form(frame: pd.DataFrame, columns: str) -> None:
    record = record_from_dataframe(frame, columns, name="run 3")
    assert (record.name, record.time_step) == ("run 3", 0.02)
    np.testing.assert_allclose(record.excitation, 9.80665 * np.arange(10), rtol=1e-15)
    np.testing.assert_array_equal(record.channels["acceleration_1"], np.arange(10.0) ** 2)


@pytest.mark.parametrize("kind", ["date", "difference"])
def test_a_dataset_s_decoded_times(kind: str) -> None:
    times = np.arange(10) * np.timedelta64(20, "ms")
    if kind == "date":
        times = np.datetime64("2024-05-01", "ns") + times
    dataset = xr.Dataset(
        {"ag": ("time", np.arange(10), {"units": "g"}), "roof": ("time", np.arange(10.0))}, coords={"time": times}
    )
    record = record_from_dataset(dataset, "ag = ground_acceleration, roof = acceleration_1 [g]")
    assert record.time_step == 0.02
    assert record.name == "dataset"


def missing(frame: pd.DataFrame) -> pd.DataFrame:
    frame.loc[3, "roof"] = np.nan
    return frame


@pytest.mark.parametrize(
    ("frame", "columns", "sentence"),
    [
        (frame_with(), None, "run, column ag: the name is not known"),
        (pd.DataFrame(), None, "run: it has no columns"),
        (missing(frame_with()), f"5 = sampling_rate [Hz], {MAP}", "run, row 4, column roof: the value is nan"),
        (
            frame_with(roof=pd.array([1, None] * 5, dtype="Int64")),
            f"5 = sampling_rate [Hz], {MAP}",
            "run, row 2, column roof: the value is nan",
        ),
        (frame_with(roof=["x"] * 10), f"5 = sampling_rate [Hz], {MAP}", "run, row 1, column roof: 'x' is not a number"),
        (
            frame_with(roof=pd.Series([0, 1, "off", *range(7)], dtype=object)),
            f"5 = sampling_rate [Hz], {MAP}",
            "run, row 3, column roof: 'off' is not a number",
        ),
        (
            frame_with(roof=pd.Series([0.0, None, True, *range(7)], dtype=object)),
            f"5 = sampling_rate [Hz], {MAP}",
            "run, row 2, column roof: 'None' is not a number",
        ),
        (
            frame_with(roof=pd.Series([0.0, 1.0, True, *range(7)], dtype=object)),
            f"5 = sampling_rate [Hz], {MAP}",
            "run, row 3, column roof: 'True' is not a number",
        ),
        (frame_with(), "5 = sampling_rate [Hz], ag = ground_acceleration", "run, column ground_acceleration: the unit"),
        (frame_with(t=[pd.NaT] * 10), f"t = time, {MAP}", "run, row 1, column t: the value is nan"),
        (
            frame_with(pd.DatetimeIndex(pd.date_range("2024", periods=11, freq="1s").delete(5))),
            MAP,
            "run, row 6, column time: the step is 2 s where the others are 1 s",
        ),
        (frame_with().iloc[:5], f"5 = sampling_rate [Hz], {MAP}", "run: the record has 5 points"),
        (
            pd.concat([frame_with(), frame_with()[["ag"]]], axis=1).rename(columns={"ag": "drift_1 [m]"}),
            None,
            "run, column drift_1: the column appears twice, keep one",
        ),
    ],
)
def test_every_mistake_gets_one_sentence(frame: pd.DataFrame, columns: str | None, sentence: str) -> None:
    with pytest.raises(UserError) as caught:
        record_from_dataframe(frame, columns, name="run")
    assert str(caught.value).startswith(sentence)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("attribute", ["{", '{"truth": 3}', 5, ["x"]])
@pytest.mark.parametrize(
    ("convert", "read"), [(as_dataframe, record_from_dataframe), (as_dataset, record_from_dataset)]
)
def test_a_damaged_attribute(
    attribute: object, convert: Callable[[Record], pd.DataFrame | xr.Dataset], read: Callable[..., Record]
) -> None:
    made = convert(Record(name="x", time_step=0.1, excitation=np.zeros(8)))
    made.attrs["record"] = attribute
    with pytest.raises(UserError, match="the attribute 'record' is damaged, remove it or write it anew"):
        read(made)
