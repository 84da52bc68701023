"""Every format on the page is written and read, and gives the numbers that went in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pages import run_page

from bwbn_bayes import Record, read_record
from bwbn_bayes.records.readers import RECORD_SUFFIXES


@pytest.mark.filterwarnings("ignore")  # ObsPy's, where it is installed
def test_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    names = run_page("records.md")
    printed = capsys.readouterr().out
    assert "False" not in printed
    assert printed.startswith("256.0\n['acceleration_3'] True\n")
    ground, roof = np.asarray(names["ground"]), np.asarray(names["roof"])
    maps = {
        "theirs.csv": "Zeit = time, Tisch = ground_acceleration, Dach = acceleration_3 [0.25 g]",
        "bare.dat": "column 1 = time [s], column 2 = ground_acceleration [m/s^2]",
        "run.mat": "fs = sampling_rate [Hz], data(:,1) = ground_acceleration [m/s^2], run.third = acceleration_3 [g]",
        "theirs.nc": "table = ground_acceleration [m/s^2], roof = acceleration_3 [g]",
    }
    factors = {"theirs.csv": 0.25 * 9.80665, "run.mat": 9.80665, "theirs.nc": 9.80665}
    for name, columns in maps.items():
        record = read_record(name, columns)
        assert record.time_step == 1 / 256
        np.testing.assert_allclose(record.excitation, ground, atol=1e-5)
        if name in factors:
            np.testing.assert_allclose(record.channels["acceleration_3"], factors[name] * roof, atol=1e-4)
    for name, factor in {"motion.AT2": 9.80665, "motion.v2": 1.0, "motion.smc": 1.0}.items():
        record = read_record(name)
        assert record.time_step == 1 / 256
        np.testing.assert_allclose(record.excitation, factor * ground, atol=1e-5)
    assert isinstance(names["record"], Record)


def test_the_page_names_every_suffix() -> None:
    page = (Path(__file__).parents[2] / "docs" / "records.md").read_text("utf-8").lower()
    assert [suffix for suffix in RECORD_SUFFIXES if f"`{suffix}`" not in page] == []
