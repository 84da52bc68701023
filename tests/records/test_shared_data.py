"""The measured specimens of ../shared/data read without change."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bwbn_bayes.errors import UserError
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


SHAKE_TABLE = (
    "table_acceleration = ground_acceleration, floor_1 = displacement_1 minus base_displacement, "
    "floor_2 = displacement_2 minus base_displacement, floor_3 = displacement_3 minus base_displacement"
)


@pytest.mark.parametrize("name", ["fbgm152s1", "fbgm152s3", "fpgm111s1", "fpgm111s2"])
def test_the_shake_table_frame_by_a_column_map(name: str) -> None:
    """Its displacements are absolute, in inches, beside that of the base."""
    path = DATA / "shake_table_frame" / f"{name}.csv"
    if not path.exists():
        pytest.skip(f"measured file {path} is not here")
    record = read_record(path, SHAKE_TABLE)
    table = np.loadtxt(path, delimiter=",", skiprows=3)
    assert record.time_step == 1 / 64
    np.testing.assert_allclose(record.excitation, 9.80665 * table[:, 0], rtol=1e-12)
    for i in (1, 2, 3):
        np.testing.assert_allclose(
            record.channels[f"displacement_{i}"], 0.0254 * (table[:, 1 + i] - table[:, 1]), rtol=1e-9, atol=1e-12
        )
    with pytest.raises(UserError, match="column table_acceleration: the name is not known"):
        read_record(path)
