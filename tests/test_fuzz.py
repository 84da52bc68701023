"""Whatever a file holds, it is read or refused in one sentence: no other exception, no execution.

The default run takes a few examples of each kind; the slow one ten thousand in all.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from matlab_files import save_v73
from scipy.io import savemat
from strong_motion_files import cosmos, smc

from bwbn_bayes import Result, Settings, UserError, read_record, sine
from bwbn_bayes.engines import cache_files
from bwbn_bayes.engines.journal import Journal
from bwbn_bayes.engines.kernel import Kernel
from bwbn_bayes.engines.kernel_compiler import object_code
from bwbn_bayes.records.readers import write_record
from bwbn_bayes.results import Facts
from bwbn_bayes.structures.model_file import load_model_file

SDOF = (Path(__file__).parents[1] / "models" / "sdof.py").read_text(encoding="utf-8")
SLOW = 10_000
TOKENS = [
    *(b"nan", b"inf", b"-1", b"1e400", b"9" * 5000, "−½".encode(), b"null", b"{}", b"[", b",", b'"', b"\n", b"\x00"),
    *(b"\xff\xfe", b"\x1b[31m", b"# name: ", b"time_step", b"../", b"cos\nsystem\n(S'true'\ntR."),
]


@st.composite
def damaged(draw: st.DrawFn, whole: bytes) -> bytes:
    """A file after some edits: parts removed, doubled, overwritten, something else put in between."""
    data = whole
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(data)))
        end = min(len(data), start + draw(st.sampled_from([0, 1, 2, 8, 64, 100_000])))
        kind = draw(st.sampled_from(["remove", "double", "random", "token"]))
        put = {"remove": b"", "double": data[start:end] * 2}.get(kind)
        if put is None:
            put = draw(st.binary(max_size=16)) if kind == "random" else draw(st.sampled_from(TOKENS))
        data = data[:start] + put + data[end:]
    return data


def _fuzz(share: float, strategy: st.SearchStrategy[Any], test: Callable[[Any], None], slow: bool) -> None:
    """Run a test on a share of the examples."""
    n = int(share * SLOW) if slow else 25
    checks = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.large_base_example]
    settings(max_examples=n, deadline=None, suppress_health_check=checks)(given(strategy)(test))()


RUNS = pytest.mark.parametrize("slow", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["few", "many"])


MATLAB_MAP = "t = time [s], run.ag = ground_acceleration [g], data(:,1) = acceleration_1 [g]"
MOTION = np.round(np.sin(np.arange(24.0)), 3)
MATLAB = {"t": 0.1 * np.arange(24), "run": {"ag": MOTION}, "data": np.ones((24, 2)), "fs": 5.0}


def _record_file(path: Path, kind: str) -> str | None:
    """A whole file of a kind, and the column map that it is read with."""
    motion = sine(amplitude=1.0, frequency_hz=1.0, duration=0.5, time_step=0.05)
    if kind == ".AT2":
        path.write_text("a\nb\nACCELERATION TIME SERIES IN UNITS OF G\nNPTS= 12, DT= .01 SEC\n" + ".1 .2 .3\n" * 4)
    elif kind == ".v2":
        path.write_text(cosmos({"1": MOTION}))
    elif kind == ".smc":
        path.write_text(smc(MOTION))
    elif kind == ".mat":
        # SciPy's reader ended the process on some of these.
        savemat(path, MATLAB)
    elif kind == "v7.mat":
        savemat(path, MATLAB, do_compression=True)
    elif kind == "v7.3.mat":
        save_v73(path, MATLAB)
    elif kind == ".txt":
        path.write_text("t;ag;dach\ns;g;[m/s²]\n" + "".join(f"0,{i:02d};{i},5;1\n" for i in range(9)), "utf-8")
        return "t = time, ag = ground_acceleration, dach = acceleration_1 minus ag [m/s2]"
    else:
        write_record(motion.with_channels({"acceleration_1": np.array(motion.excitation)}), path)
    return MATLAB_MAP if kind.endswith("mat") else None


@RUNS
@pytest.mark.parametrize(
    ("kind", "share"),
    [
        *((".csv", 0.25), (".AT2", 0.1), (".nc", 0.1), (".txt", 0.1), (".v2", 0.05), (".smc", 0.05)),
        *((".mat", 0.1), ("v7.mat", 0.05), ("v7.3.mat", 0.05)),
    ],
)
def test_records(tmp_path: Path, kind: str, share: float, slow: bool) -> None:
    path = tmp_path / f"record{kind}"
    columns = _record_file(path, kind)
    assert read_record(path, columns).n_times > 8

    def test(data: bytes) -> None:
        path.write_bytes(data)
        with suppress(UserError):
            record = read_record(path, columns)
            assert np.all(np.isfinite(record.excitation))
            assert record.name.isprintable()

    _fuzz(share, damaged(path.read_bytes()), test, slow)


@RUNS
def test_checkpoints(tmp_path: Path, slow: bool) -> None:
    """Whatever the file holds, an answer is what is solved, or the file is refused."""
    path, questions = tmp_path / "run.solves", [bytes([i] * 32) for i in range(20)]

    def answers(journal: Journal) -> list[float]:
        solved = [journal.kept("any", q, 1, lambda _, q=q: (np.array([float(q[0])]),)) for q in questions]
        return [float(array[0]) for (array,) in solved]

    with Journal.opened(tmp_path / "run") as journal:
        answers(journal)

    def test(data: bytes) -> None:
        path.write_bytes(data)
        with suppress(UserError), Journal.opened(tmp_path / "run") as journal:
            assert answers(journal) == [float(i) for i in range(20)]

    _fuzz(0.2, damaged(path.read_bytes()), test, slow)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)


@RUNS
def test_facts_of_results(tmp_path: Path, slow: bool) -> None:
    """Facts in which some fields hold anything that JSON can."""
    path = tmp_path / "result.nc"
    fields = st.sampled_from(sorted(Facts.__dataclass_fields__))

    def test(facts: dict[str, Any]) -> None:
        tree = xr.DataTree(xr.Dataset({"x": ("time", [1.0])}, attrs={"facts": json.dumps(facts)}))
        path.write_bytes(tree.to_netcdf(engine="h5netcdf"))
        with suppress(UserError):
            Result.load(path)

    _fuzz(0.1, st.dictionaries(fields | st.text(max_size=4), JSON, max_size=25), test, slow)


@RUNS
@pytest.mark.parametrize("suffix", [".py", ".object"])
def test_cache_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, slow: bool) -> None:
    """The kernel is always the one that was generated."""
    monkeypatch.setenv("BWBN_CACHE_DIR", str(tmp_path / "cache"))
    cache_files._first_usable.cache_clear()
    kernel = Kernel("fuzz", "def double(x: float) -> float:\n    return 2.0 * x\n")
    assert kernel.functions("double").double(1.0) == 2.0
    (path,) = (tmp_path / "cache").rglob(f"*{suffix}")
    planted = object_code(kernel.source.replace("2.0", "3.0"), "double")

    def test(data: bytes) -> None:
        path.write_bytes(data)
        assert kernel.functions("double").double(1.0) == 2.0

    _fuzz(0.025, damaged(path.read_bytes()) | damaged(planted), test, slow)


NUMBER = st.integers() | st.floats() | st.sampled_from([10**400, -1, 0, 10**12, "many", None, True])


@RUNS
def test_options_of_a_model(tmp_path: Path, slow: bool) -> None:
    path = tmp_path / "model.py"
    names = st.sampled_from(["snr_db", "truth", "assumptions", "excitation", "record", "held_out"])

    def test(names_and_values: dict[str, Any]) -> None:
        lines = [f"{name} = {value!r}" for name, value in names_and_values.items()]
        path.write_text("\n".join([SDOF, "from math import inf, nan", *lines]), encoding="utf-8", errors="replace")
        with suppress(UserError):
            load_model_file(path)

    values = NUMBER | st.text(max_size=6) | st.lists(st.text(max_size=3), max_size=2)
    _fuzz(0.1, st.dictionaries(names, values | st.dictionaries(st.text(max_size=4), NUMBER, max_size=3)), test, slow)


@RUNS
def test_settings(slow: bool) -> None:
    names = st.sampled_from(["method", "engine", "seed", "particles", "variant", "sampler"])

    def test(options: dict[str, Any]) -> None:
        with suppress(UserError):
            assert 1 <= Settings(**options).particles <= 10**7

    _fuzz(0.1, st.dictionaries(names, NUMBER | st.text(max_size=6)), test, slow)
