"""Column maps: what they say, what they read, and one sentence for every mistake in one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bwbn_bayes.errors import UserError
from bwbn_bayes.records import read_record
from bwbn_bayes.records.column_map import Item, Meaning, parse_columns

INCH = 0.0254
HEADER = "Zeit,Status,table [g],base [inch],Etage 1 [inch],Dach"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A header that is not ours: absolute displacements, a column of text, one without a unit."""
    rows = [f"{0.02 * i:.2f},ok,{0.1 * i:.1f},{i},{3 * i},{5 * i}" for i in range(10)]
    (tmp_path / "run.csv").write_text("\n".join([HEADER, *rows]) + "\n", encoding="utf-8")
    return tmp_path / "run.csv"


def test_what_a_map_says() -> None:
    text = """ag = Ground_Acceleration [0.5 g], "roof, east" = displacement_3 [mm] minus 'the base' [cm],
    data(:,2)=acceleration_1, a=b = drift_1 [m], 256 = sampling_rate [Hz], drift_2"""
    assert parse_columns(text) == (
        Item("ag", Meaning("ground_acceleration", "0.5 g")),
        Item("roof, east", Meaning("displacement_3", "mm", "the base", "cm")),
        Item("data(:,2)", Meaning("acceleration_1")),
        Item("a=b", Meaning("drift_1", "m")),
        Item("256", Meaning("sampling_rate", "Hz")),
        Item("drift_2", Meaning("drift_2")),
    )


def test_only_what_the_map_names_is_read(path: Path) -> None:
    record = read_record(path, "zeit = time [s], TABLE = ground_acceleration, Dach = acceleration_3 [0.5 g]")
    assert record.time_step == 0.02
    np.testing.assert_allclose(record.excitation, 0.1 * 9.80665 * np.arange(10), rtol=1e-15)
    assert list(record.channels) == ["acceleration_3"]
    np.testing.assert_allclose(record.channels["acceleration_3"], 2.5 * 9.80665 * np.arange(10), rtol=1e-15)
    assert record.provenance["columns"].startswith("zeit = time [s]")


def test_absolute_displacements_become_relative_to_a_column(path: Path) -> None:
    record = read_record(
        path,
        "Zeit = time [s], table = ground_acceleration, Etage 1 = displacement_1 minus base, "
        "Dach = displacement_2 [inch] minus base, column 6 = drift_2 [inch] minus Etage 1",
    )
    for name, per_row in {"displacement_1": 2.0, "displacement_2": 4.0, "drift_2": 2.0}.items():
        np.testing.assert_allclose(record.channels[name], per_row * INCH * np.arange(10), rtol=1e-12)


def test_the_header_may_say_the_same(tmp_path: Path) -> None:
    header = "time [s],ground_acceleration [g],displacement_1 [inch] minus base,base [mm]"
    rows = [f"{0.02 * i:.2f},{i},{i},{i}" for i in range(10)]
    (tmp_path / "run.csv").write_text("\n".join([header, *rows]), encoding="utf-8")
    record = read_record(tmp_path / "run.csv")
    assert list(record.channels) == ["displacement_1"]
    np.testing.assert_allclose(record.channels["displacement_1"], (INCH - 1e-3) * np.arange(10), rtol=1e-12)


@pytest.mark.parametrize("step", ["50 = sampling_rate [Hz]", "20 = time_step [ms]"])
def test_a_step_in_the_place_of_a_time_column(path: Path, step: str) -> None:
    record = read_record(path, f"{step}, table = ground_acceleration, Dach = acceleration_1 [g]")
    assert record.time_step == 0.02
    assert record.has_time
    cyclic = read_record(path, f"{step}, base = displacement, Dach = force [kN]")
    assert cyclic.has_time
    assert cyclic.time_step == 0.02
    assert not read_record(path, "base = displacement, Dach = force [kN]").has_time


@pytest.mark.parametrize(
    ("columns", "sentence"),
    [
        ("", "{path}: the column map '' has an empty item"),
        ("a = time [s],,", "{path}: the column map 'a = time [s],,' has an empty item"),
        ("Zeit", "{path}: the column map reads 'Zeit' as zeit, which is not known: use time,"),
        ("Zeit = time [s]", "{path}, line 1: column ground_acceleration is missing"),
        ("Zeit = time of day [s]", "{path}: the item 'Zeit = time of day [s]' of the column map is not understood"),
        ("= time [s]", "{path}: the item '= time [s]' of the column map is not understood"),
        ("a = time [s", "{path}: the item 'a = time [s' of the column map is not understood"),
        ("Zeit = time [s], Dach = time [s]", "{path}: the column map gives time twice: keep one"),
        ("keller = time [s]", "{path}, line 1: no column is called 'keller', the file has Zeit, Status, table,"),
        ("Zeit = speed [m/s]", "{path}: the column map reads 'Zeit' as speed, which is not known: use time,"),
        ("Status = time [s], table = ground_acceleration", "{path}, line 2, column status: 'ok' is not a number"),
        (
            "Zeit = time [s], table = ground_acceleration, Dach = acceleration_1",
            "{path}, line 1, column acceleration_1: the unit is missing, write acceleration_1 [m/s^2]",
        ),
        (
            "Zeit = time [s], table = ground_acceleration, Dach = acceleration_1 [kN]",
            "{path}, line 1, column acceleration_1: the unit [kN] has the wrong dimension",
        ),
        (
            "Zeit = time [s], table = ground_acceleration, Dach = displacement_1 [m] minus keller",
            "{path}, line 1: no column is called 'keller'",
        ),
        (
            "Zeit = time [s], table = ground_acceleration, Dach = displacement_1 [m] minus table",
            "{path}, line 1, column displacement_1: the unit [g] has the wrong dimension",
        ),
        ("table = ground_acceleration", "{path}, line 1: column time is missing, add it or state the time_step"),
        ("table = ground_acceleration, 0 = time_step [s]", "{path}, column 0: time_step must be one positive number"),
        ("table = ground_acceleration, 5 = time_step", "{path}: time_step has no unit, write time_step [s]"),
        (
            "table = ground_acceleration, 5 = sampling_rate [s]",
            "{path}: the unit [s] has the wrong dimension: write a unit of frequency such as Hz",
        ),
        (
            "table = ground_acceleration, Zeit = sampling_rate [Hz]",
            "{path}, column Zeit: sampling_rate must be one positive number",
        ),
        (
            "table = ground_acceleration, 5 = sampling_rate [Hz], 0.2 = time_step [s]",
            "{path}: both time_step and sampling_rate are given, keep one",
        ),
    ],
)
def test_every_mistake_gets_one_sentence(path: Path, columns: str, sentence: str) -> None:
    with pytest.raises(UserError) as caught:
        read_record(path, columns)
    assert str(caught.value).startswith(sentence.format(path=path))
    assert "\n" not in str(caught.value)


@settings(max_examples=150, deadline=None)
@given(st.text(alphabet=st.sampled_from("agt= ,[]()\"'minus1_\n\\x"), max_size=60) | st.text(max_size=30))
def test_no_map_raises_anything_but_a_user_error(text: str) -> None:
    try:
        parse_columns(text)
    except UserError as error:
        assert "column map" in str(error)  # noqa: PT017


@pytest.mark.parametrize(("row", "column"), [("1e308,1,1", "t"), ("0.1,1e308,1", "a"), ("0.1,1,-1.7e308", "y")])
def test_numbers_beyond_doubles_in_si(tmp_path: Path, row: str, column: str) -> None:
    """Their product with a unit ended in a warning of NumPy."""
    rows = [f"{0.1 * i:.1f},1,1" for i in range(9)]
    rows[1] = row
    (tmp_path / "run.csv").write_text("\n".join(["t,a,y", *rows]), encoding="utf-8")
    with pytest.raises(UserError, match=rf"run\.csv, column {column}: its numbers are too large for"):
        read_record(tmp_path / "run.csv", "t = time [s], a = ground_acceleration [g], y = acceleration_1 [g]")
