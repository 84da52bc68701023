"""The measured specimens of ../shared/data read without change."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bwbn_bayes.records import Record, read_record, write_record

DATA = Path(__file__).parents[3] / "shared" / "data"

# n_times, time step [s], largest displacement [m] and force [N]: read off the files with a spreadsheet's MAX and MIN.
FACTS = {
    "clt_connection_spc1.csv": (33028, 1.0, 84.58e-3, 52.46e3),
    "steel_damper_ganey.csv": (308, 1.0, 2.87755102e-3, 5.31160242e3),
    "friction_damper_sine_0p5hz.csv": (14337, 1 / 1024, None, None),
    "friction_damper_imperial_valley.csv": (28698, 1 / 1024, None, None),
}


def specimen(name: str) -> Record:
    if not (DATA / name).exists():
        pytest.skip(f"measured file {DATA / name} is not here")
    return read_record(DATA / name)


@pytest.mark.parametrize("name", FACTS)
def test_specimens_are_read(name: str, tmp_path: Path) -> None:
    record = specimen(name)
    n_times, time_step, largest_displacement, largest_force = FACTS[name]
    assert record.excitation_kind == "displacement"
    assert list(record.channels) == ["force"]
    assert (record.n_times, record.time_step) == (n_times, time_step)
    assert ("time_base" in record.provenance) == (time_step == 1.0) == (not record.has_time)
    if largest_displacement is not None:
        assert np.max(np.abs(record.excitation)) == pytest.approx(largest_displacement)
        assert np.max(np.abs(record.channels["force"])) == pytest.approx(largest_force)
    write_record(record, tmp_path / "again.csv")
    assert read_record(tmp_path / "again.csv").equals(record)


def test_units_of_the_friction_damper() -> None:
    # PROVENANCE.md: a sine of 1.5 in amplitude.
    record = specimen("friction_damper_sine_0p5hz.csv")
    assert np.max(np.abs(record.excitation)) == pytest.approx(1.5 * 0.0254, rel=0.02)
