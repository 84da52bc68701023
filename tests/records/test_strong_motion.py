"""COSMOS and SMC ground motions, and one sentence for every bad file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from strong_motion_files import cosmos, smc

from bwbn_bayes.errors import UserError
from bwbn_bayes.records import read_record

MOTION = np.round(50.0 * np.sin(np.arange(1003.0)), 3)


@pytest.fixture
def put(tmp_path: Path) -> Callable[[str, str], Path]:
    def write(name: str, text: str) -> Path:
        (tmp_path / name).write_text(text, encoding="utf-8", newline="")
        return tmp_path / name

    return write


@pytest.mark.parametrize("name", ["run.V2", "run.v2c", "run.V1"])
def test_a_cosmos_channel_is_a_ground_motion(put: Callable[[str, str], Path], name: str) -> None:
    record = read_record(put(name, cosmos({"1": MOTION})))
    assert (record.time_step, record.n_times, record.name) == (0.005, 1003, "run")
    np.testing.assert_allclose(record.excitation, 1e-2 * MOTION, rtol=1e-15)
    assert record.provenance["event"] == "Record of an Earthquake"


def test_cosmos_channels_of_a_building(put: Callable[[str, str], Path]) -> None:
    path = put("run.v2", cosmos({"3": MOTION, "7": 2.0 * MOTION}, unit="g(02)"))
    record = read_record(path, "channel 3 = ground_acceleration, channel 7 = acceleration_1")
    np.testing.assert_allclose(record.channels["acceleration_1"], 2.0 * 9.80665 * MOTION, rtol=1e-15)
    with pytest.raises(UserError, match="column channel 3: the name is not known"):
        read_record(path)


def test_the_raw_step_counts_where_no_other_is_stated(put: Callable[[str, str], Path]) -> None:
    """Real header 62 is the step of the series in ms, 34 that of the raw record in s: they differ where resampled."""
    assert read_record(put("a.v2", cosmos({"1": MOTION}, step_ms=-999.0, raw_step=0.01))).time_step == 0.01
    assert read_record(put("b.v2", cosmos({"1": MOTION}, step_ms=5.0, raw_step=0.02))).time_step == 0.005


@pytest.mark.parametrize("rate", [200.0, 100.0, 50.0])
def test_an_smc_file_is_a_ground_motion(put: Callable[[str, str], Path], rate: float) -> None:
    record = read_record(put("run.smc", smc(np.round(MOTION, 2), rate)))
    assert (record.time_step, record.n_times) == (1.0 / rate, 1003)
    np.testing.assert_allclose(record.excitation, 1e-2 * np.round(MOTION, 2), rtol=1e-3, atol=1e-6)
    assert record.provenance["station"] == "station = Hall"


def lines_of(text: str) -> list[str]:
    return text.split("\n")


@pytest.mark.parametrize(
    ("name", "text", "sentence"),
    [
        ("run.v2", "", "{path}: the file is empty, get it anew"),
        ("run.v2", "CORRECTED ACCELEROGRAM\n", "{path}, line 1: no 'Format v01.20', the file is not in COSMOS format"),
        ("run.v2", "\n".join(lines_of(cosmos({"1": MOTION}))[:45]), "{path}: no line '... acceleration pts,"),
        (
            "run.v2",
            "\n".join(lines_of(cosmos({"1": MOTION}))[:100]),
            "{path}, line 48: 1003 numbers are announced but 416 follow, the file is damaged",
        ),
        (
            "run.v2",
            cosmos({"1": MOTION}).replace("    42.074", "    ******"),
            "{path}, line 49, column 2: '******' is not a number",
        ),
        (
            "run.v2",
            cosmos({"1": MOTION}).replace("approx    5 secs", "approx   50 secs"),
            "{path}, line 48: no time step in the real header agrees with 1003 points in",
        ),
        ("run.v2", cosmos({"1": MOTION}).replace(",Format=(8F10.3)", ""), "{path}, line 48: no 'Format=(...)'"),
        (
            "run.v2",
            cosmos({"1": MOTION}) + cosmos({"2": MOTION}, step_ms=10.0),
            "{path}, line 351: the time step is 0.01 s, in the first channel 0.005 s",
        ),
        ("run.v2", cosmos({"1": MOTION}, unit="counts(50)"), "{path}, column ground_acceleration: the unit [counts]"),
        ("run.smc", smc(MOTION, first="3 VELOCITY"), "{path}, line 1: neither '1 UNCORRECTED' nor"),
        ("run.smc", "\r\n".join(lines_of(smc(MOTION))[:20]), "{path}: the file ends in its header"),
        ("run.smc", smc(MOTION, rate=1.7e38), "{path}: the header states no sampling rate"),
        ("run.smc", "\n".join(lines_of(smc(MOTION))[:60]), "{path}: 1003 values are announced but 248 follow"),
        ("run.smc", smc(MOTION) + "**********", "{path}, line 156, column 1: '**********' is not a number"),
    ],
)
def test_every_bad_file_gets_one_sentence(put: Callable[[str, str], Path], name: str, text: str, sentence: str) -> None:
    path = put(name, text)
    with pytest.raises(UserError) as caught:
        read_record(path)
    assert str(caught.value).startswith(sentence.format(path=path))
    assert "\n" not in str(caught.value)
