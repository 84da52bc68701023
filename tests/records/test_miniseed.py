"""MiniSEED where ObsPy is installed; one sentence where it is not."""

from __future__ import annotations

import importlib
import io
import pickle
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bwbn_bayes.errors import UserError
from bwbn_bayes.records import read_record
from bwbn_bayes.records.miniseed import _table, _Trace

MAP = "IV.ABC..HNZ = ground_acceleration [2.4e-6 m/s^2], IV.ABC..HNE = acceleration_1 [1e-6 g]"


@pytest.fixture
def obspy() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return pytest.importorskip("obspy")


def save(obspy: Any, path: Path, *traces: tuple[str, int, str, float]) -> Path:
    """Traces of channel, number of samples, start and sampling rate; they count up from zero."""
    stream = obspy.Stream()
    for channel, n_times, start, rate in traces:
        header = {"network": "IV", "station": "ABC", "channel": channel, "sampling_rate": rate}
        header["starttime"] = obspy.UTCDateTime(start)
        stream.append(obspy.Trace(np.arange(n_times, dtype=np.int32), header))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        stream.write(str(path), format="MSEED")
    return path


def test_without_obspy_one_sentence_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", missing)
    (tmp_path / "run.mseed").write_bytes(b"x")
    with pytest.raises(UserError) as caught:
        read_record(tmp_path / "run.mseed")
    assert str(caught.value) == (
        f"{tmp_path / 'run.mseed'}: miniSEED is read by ObsPy, which is not installed, add it with pip install "
        "'bwbn-bayes[obspy]'"
    )


@pytest.mark.parametrize("suffix", [".mseed", ".miniseed"])
def test_traces_become_columns(obspy: Any, tmp_path: Path, suffix: str) -> None:
    start = "2020-01-01T00:00:00"
    path = save(obspy, tmp_path / f"run{suffix}", ("HNZ", 500, start, 200.0), ("HNE", 500, start, 200.0))
    record = read_record(path, MAP)
    assert record.time_step == 0.005
    np.testing.assert_allclose(record.excitation, 2.4e-6 * np.arange(500), rtol=1e-15)
    np.testing.assert_allclose(record.channels["acceleration_1"], 9.80665e-6 * np.arange(500), rtol=1e-14)
    assert record.provenance["start_time"].startswith(start)


@pytest.mark.parametrize(
    ("traces", "columns", "sentence"),
    [
        ([("HNZ", 99, "2020-01-01", 200.0)], None, "column IV.ABC..HNZ: the name is not known"),
        (
            [("HNZ", 99, "2020-01-01", 200.0)],
            "IV.ABC..HNZ = ground_acceleration",
            "column ground_acceleration: the unit is missing, say in the column map what one count is",
        ),
        (
            [("HNZ", 99, "2020-01-01", 200.0), ("HNE", 99, "2020-01-01T00:00:05", 200.0)],
            MAP,
            "trace IV.ABC..HNE: it starts at 2020-01-01T00:00:05",
        ),
        (
            [("HNZ", 99, "2020-01-01", 200.0), ("HNE", 99, "2020-01-01", 100.0)],
            MAP,
            "trace IV.ABC..HNE: it starts at 2020-01-01T00:00:00.000000Z with 100 Hz, the first trace at",
        ),
        (
            [("HNZ", 99, "2020-01-01", 200.0), ("HNZ", 99, "2020-01-01T00:00:05", 200.0)],
            MAP,
            "trace IV.ABC..HNZ: it comes in pieces with a gap",
        ),
        (
            [("HNZ", 99, "2020-01-01", 200.0), ("HNE", 70, "2020-01-01", 200.0)],
            MAP,
            "column IV.ABC..HNE: 70 points where ground_acceleration has 99",
        ),
    ],
)
def test_every_mistake_gets_one_sentence(
    obspy: Any, tmp_path: Path, traces: list[tuple[str, int, str, float]], columns: str | None, sentence: str
) -> None:
    path = save(obspy, tmp_path / "run.mseed", *traces)
    with pytest.raises(UserError) as caught:
        read_record(path, columns)
    assert str(caught.value).startswith(f"{path}, {sentence}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("late", "words"), [(0.004, "0.004 s after"), (-0.001, "0.001 s before"), (5e-6, "")])
def test_traces_that_start_between_samples_are_refused(late: float, words: str) -> None:
    """Up to half a sample apart they were read as one, in silence."""
    traces = [
        _Trace("IV.ABC..HNZ", "first", 0.0, 100.0, np.arange(99)),
        _Trace("IV.ABC..HNE", "x", late, 100.0, np.arange(99)),
    ]
    if not words:
        assert len(_table(traces, Path("run.mseed")).columns) == 2
        return
    with pytest.raises(UserError, match=rf"run\.mseed, trace IV\.ABC\.\.HNE: it starts at x, {words} the first trace"):
        _table(traces, Path("run.mseed"))


def test_damaged_files_get_one_sentence(obspy: Any, tmp_path: Path) -> None:
    """A start beyond the year 9999 once ended in a traceback, where the sentence about it was made."""
    whole = save(obspy, tmp_path / "run.mseed", ("HNZ", 500, "2020-01-01", 200.0)).read_bytes()
    rng = np.random.default_rng(1)
    n_refused = 0
    for _ in range(150):
        data = bytearray(whole)
        for start in rng.integers(0, len(data), 3):
            data[start : start + 4] = rng.bytes(4)
        (tmp_path / "run.mseed").write_bytes(bytes(data[: rng.integers(1, len(data))]) if rng.random() < 0.3 else data)
        try:
            record = read_record(tmp_path / "run.mseed", MAP.split(",")[0])
            assert np.all(np.isfinite(record.excitation))
        except UserError as error:
            n_refused += 1
            assert "\n" not in str(error)  # noqa: PT017
    assert n_refused > 30


@pytest.mark.usefixtures("obspy")
def test_a_pickle_is_not_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """ObsPy's own reader tries pickles among its formats; this one is asked for miniSEED alone."""
    opened: list[object] = []
    monkeypatch.setattr(pickle, "load", opened.append)
    monkeypatch.setattr(pickle, "loads", opened.append)
    buffer = io.BytesIO()
    pickle.Pickler(buffer).dump(Path.home)
    (tmp_path / "run.mseed").write_bytes(buffer.getvalue() * 50)
    with pytest.raises(UserError, match=r"run\.mseed: the file is not miniSEED, or it is damaged"):
        read_record(tmp_path / "run.mseed", MAP)
    assert opened == []
