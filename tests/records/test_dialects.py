"""Delimited text of other programs: the same table comes out of every dialect that says it."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bwbn_bayes.errors import UserError
from bwbn_bayes.records import read_record

NAMES, UNITS = ("time", "ground_acceleration", "acceleration_1"), ("s", "m/s^2", "g")


def written(
    table: np.ndarray, delimiter: str, *, comma: bool, quoted: bool, unit_row: bool, brackets: str, ending: str
) -> str:
    """A table as another program would write it."""

    def cell(text: str) -> str:
        return f'"{text}"' if quoted else text

    opening, closing = brackets
    if unit_row:
        head = [[cell(name) for name in NAMES], [cell(f"{opening}{unit}{closing}") for unit in UNITS]]
    else:
        head = [[cell(f"{name} {opening}{unit}{closing}") for name, unit in zip(NAMES, UNITS, strict=True)]]
    numbers = [[repr(value).replace(".", ",") if comma else repr(value) for value in row] for row in table.tolist()]
    rows = [[cell(number) for number in row] for row in numbers]
    return "".join(delimiter.join(row) + ending for row in (*head, *rows))


@settings(max_examples=150, deadline=None)
@given(
    values=st.lists(st.tuples(*[st.floats(-1e6, 1e6)] * 2), min_size=8, max_size=12),
    delimiter=st.sampled_from([",", ";", "\t", "|", "; ", " ", "   "]),
    comma=st.booleans(),
    quoted=st.booleans(),
    unit_row=st.booleans(),
    brackets=st.sampled_from(["[]", "()"]),
    ending=st.sampled_from(["\n", "\r\n", "\r"]),
    suffix=st.sampled_from([".csv", ".tsv", ".txt", ".dat"]),
)
def test_every_dialect_reads_alike(
    values: list[tuple[float, float]],
    delimiter: str,
    comma: bool,
    quoted: bool,
    unit_row: bool,
    brackets: str,
    ending: str,
    suffix: str,
) -> None:
    quoted = quoted and delimiter.strip() != ""
    comma = comma and (delimiter != "," or quoted)
    table = np.column_stack([0.25 * np.arange(len(values)), np.array(values)])
    text = written(table, delimiter, comma=comma, quoted=quoted, unit_row=unit_row, brackets=brackets, ending=ending)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"run{suffix}"
        path.write_text(text, encoding="utf-8", newline="")
        record = read_record(path)
    assert record.time_step == 0.25
    np.testing.assert_array_equal(record.excitation, table[:, 1])
    np.testing.assert_array_equal(record.channels["acceleration_1"], 9.80665 * table[:, 2])


def test_a_delimiter_at_the_end_of_every_line(tmp_path: Path) -> None:
    lines = ["time [s];ground_acceleration [g];", *(f"0,{i}0;{i};" for i in range(9))]
    (tmp_path / "run.csv").write_text("\n".join(lines), encoding="utf-8")
    assert read_record(tmp_path / "run.csv").time_step == 0.1


def test_no_header_at_all(tmp_path: Path) -> None:
    (tmp_path / "run.txt").write_text("\n".join(f"{0.1 * i:.1f} {i}" for i in range(9)), encoding="utf-8")
    record = read_record(tmp_path / "run.txt", "column 1 = time [s], column 2 = ground_acceleration [g]")
    assert (record.n_times, record.time_step) == (9, 0.1)


def test_a_stated_time_step_stands_for_a_time_column(tmp_path: Path) -> None:
    rows = "\n".join(str(i) for i in range(9))
    (tmp_path / "run.csv").write_text(f"# time_step: 0.015625\nground_acceleration [g]\n{rows}", encoding="utf-8")
    assert read_record(tmp_path / "run.csv").time_step == 0.015625
    (tmp_path / "run.csv").write_text(f"# time_step: 0.5\ndisplacement [mm]\n{rows}", encoding="utf-8")
    assert read_record(tmp_path / "run.csv").has_time


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            "time [s],ground_acceleration [g]\n" + "\n".join(f"0,{i}0,{i}" for i in range(9)),
            "line 2: 3 cells where the header has 2 columns, put # before lines above the header, and give one number",
        ),
        (
            "time;ground_acceleration\ns;kN\n" + "\n".join(f"0,{i}0;{i}" for i in range(9)),
            "line 1, column ground_acceleration: the unit [kN] has the wrong dimension",
        ),
        (
            "time [s];ground_acceleration [g]\n" + "\n".join(f"0.{i}0;{i},5" for i in range(9)),
            "line 2, column ground_acceleration: '0,5' is not a number",
        ),
        ('time [s],"ground\n' + "1,2\n" * 9, "line 1, column ground: the name is not known"),
        (
            "Logger 5\ntime [s],ground_acceleration [g]\n" + "0.1,2\n" * 9,
            "line 2: 2 cells where the header has 1 columns, put # before lines above the header, and give one number",
        ),
    ],
    ids=["decimal comma unquoted", "unit row", "two decimal marks", "open quote", "lines above the header"],
)
def test_every_bad_file_gets_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "run.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UserError) as caught:
        read_record(path)
    assert str(caught.value).startswith(f"{path}, {sentence}")
    assert "\n" not in str(caught.value)
