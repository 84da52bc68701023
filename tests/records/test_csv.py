"""CSV records: exact round trips, units, printed times, and one sentence for every bad file."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from record_strategies import records

from bwbn_bayes.errors import UserError
from bwbn_bayes.records import Record, read_csv, read_record, write_csv, write_record

HEADER = "time [s],ground_acceleration [m/s^2],acceleration_1 [m/s^2]"
ROWS = [f"{0.02 * i:.2f},{0.1 * i:.1f},{-0.1 * i:.1f}" for i in range(10)]
Write = Callable[[str], Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def to_file(text: str) -> Path:
        path = tmp_path / "run.csv"
        path.write_text(text, encoding="utf-8", newline="")
        return path

    return to_file


def lines(*, header: str = HEADER, rows: list[str] | None = None, comments: tuple[str, ...] = ()) -> str:
    return "\n".join([*comments, header, *(ROWS if rows is None else rows)]) + "\n"


@settings(max_examples=60, deadline=None)
@given(records())
def test_round_trip_is_exact(record: Record) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.csv"
        write_csv(record, path)
        again = read_csv(path)
    assert again.equals(record)
    assert again.content_hash == record.content_hash


def test_reads_the_documented_format(write: Write) -> None:
    comments = (
        "# name: shake table run 4",
        "# true k[1]: 20.0",
        "# noise_sd acceleration_1: 0.003",
        "# laboratory: somewhere: upstairs",
        "# time_step_native: 0.005 s",
        "# a remark",
        "#another",
    )
    record = read_record(write(lines(comments=comments)))
    assert record.name == "shake table run 4"
    assert record.time_step == 0.02
    assert record.excitation_kind == "ground_acceleration"
    np.testing.assert_allclose(record.excitation, 0.1 * np.arange(10), rtol=1e-15)
    np.testing.assert_allclose(record.channels["acceleration_1"], -0.1 * np.arange(10), rtol=1e-15)
    assert dict(record.truth) == {"k[1]": 20.0}
    assert dict(record.noise_sd) == {"acceleration_1": 0.003}
    assert dict(record.provenance) == {
        "laboratory": "somewhere: upstairs",
        "time_step_native": "0.005 s",
        "remarks": "a remark; another",
    }


@pytest.mark.parametrize("change", [lambda t: "\ufeff" + t, lambda t: t.replace("\n", "\r\n"), lambda t: t + "\n \n"])
def test_byte_order_mark_line_ends_and_trailing_blanks(write: Write, change: Callable[[str], str]) -> None:
    assert read_csv(write(change(lines()))).equals(read_csv(write(lines())))


def test_name_is_the_file_where_not_stated(write: Write) -> None:
    assert read_csv(write(lines())).name == "run"


def test_units_become_si(write: Write) -> None:
    header = "Time [ms], Ground_acceleration [g], drift_2 [in], force_1 [kip], acceleration_1 [cm/s^2]"
    record = read_csv(write(lines(header=header, rows=[f"{20 * i},1,1,1,1" for i in range(10)])))
    assert record.time_step == 0.02
    assert record.excitation[0] == 9.80665
    assert record.channels["drift_2"][0] == 0.0254
    assert record.channels["force_1"][0] == pytest.approx(4448.2216152605)
    assert record.channels["acceleration_1"][0] == 0.01


def test_cyclic_test_without_time_is_a_path(write: Write) -> None:
    record = read_csv(write(lines(header="displacement [mm],force [kN]", rows=[f"{i},{2 * i}" for i in range(10)])))
    assert record.excitation_kind == "displacement"
    assert record.time_step == 1.0
    assert not record.has_time
    assert "no time column" in record.provenance["time_base"]
    np.testing.assert_allclose(record.excitation, 1e-3 * np.arange(10))
    np.testing.assert_allclose(record.channels["force"], 2e3 * np.arange(10))


def test_cyclic_test_with_time(write: Write) -> None:
    rows = [f"{0.5 * i},{i},{2 * i}" for i in range(10)]
    record = read_csv(write(lines(header="time [s],displacement [mm],force [kN]", rows=rows)))
    assert record.time_step == 0.5
    assert record.has_time
    assert "time_base" not in record.provenance


@pytest.mark.parametrize(
    ("step", "pattern"),
    [
        (0.01, "{:.4f}"),
        (0.01, "{:.2f}"),
        (1.0 / 128.0, "{:.4f}"),
        (1.0 / 1024.0, "{:.5f}"),
        (1.0 / 30.0, "{:.2f}"),
        (1.0 / 300.0, "{:.3f}"),
        (0.02, "{:.6e}"),
        (1.0 / 1024.0, "{:.9g}"),
        (0.1, "{!r}"),
    ],
)
@pytest.mark.parametrize("start", [0.0, 12.0])
def test_printed_times_may_be_rounded(write: Write, step: float, pattern: str, start: float) -> None:
    n_times = 2000
    rows = [pattern.format(start + i * step) + f",{i},{i}" for i in range(n_times)]
    record = read_csv(write(lines(rows=rows)))
    # Two rounded ends bound the slope: one last printed digit over the record's length.
    quantum = 1e-4 if "g" not in pattern and "r" not in pattern else 1e-6
    quantum = 10.0 ** -int(pattern[3]) if "f" in pattern else quantum
    assert record.time_step == pytest.approx(step, abs=quantum / (n_times - 1))
    assert ("start_time" in record.provenance) == (start > 0.0)


@pytest.mark.parametrize(
    ("step", "pattern"),
    [(0.01, "{:.4f}"), (0.01, "{:.2f}"), (1.0 / 30.0, "{:.2f}"), (1.0 / 1024.0, "{:.9g}"), (0.1, "{!r}")],
)
@pytest.mark.parametrize("dropped", [1, 7, 500, 998])
def test_a_dropped_sample_is_named(write: Write, step: float, pattern: str, dropped: int) -> None:
    kept = [i for i in range(1000) if i != dropped]
    path = write(lines(rows=[pattern.format(i * step) + f",{i},{i}" for i in kept]))
    with pytest.raises(UserError) as caught:
        read_csv(path)
    message = str(caught.value)
    # Line 1 is the header and sample i stands in line i + 2; the gap shows at the sample after the dropped one.
    assert message.startswith(f"{path}, line {dropped + 2}, column time: the step is ")
    assert message.endswith("resample to a uniform time base")


def test_a_slow_change_of_the_clock_is_named(write: Write) -> None:
    times = np.cumsum(0.01 * (1.0 + 4e-4 * np.linspace(-1.0, 1.0, 3000)))
    path = write(lines(rows=[f"{t!r},0,0" for t in times.tolist()]))
    with pytest.raises(
        UserError, match=r"run.csv, line \d+, column time: the times drift .* from a uniform time base of 0.01 s"
    ):
        read_csv(path)


def changed(row: int, text: str) -> str:
    return lines(rows=[*ROWS[:row], text, *ROWS[row + 1 :]])


CHANNELS = (
    "acceleration_i, relative_acceleration_i, displacement_i, drift_i, force_i (i from 1 to 999), or displacement and "
    "force for a cyclic test"
)
BAD_FILES = [
    ("\n \n", "{path}: the file is empty, get it anew"),
    (
        "# name: x\n",
        "{path}: the file is empty, it needs a header and rows of numbers: at least 8 are needed, 32 to identify from",
    ),
    (HEADER, "{path}: the record has 0 points: at least 8 are needed, 32 to identify from"),
    (lines(rows=ROWS[:7]), "{path}: the record has 7 points: at least 8 are needed, 32 to identify from"),
    (
        changed(3, "0.06,nan,0.1"),
        "{path}, line 5, column ground_acceleration: the value is nan, every value must be a finite number",
    ),
    (
        changed(3, "0.06,0.1,-Inf"),
        "{path}, line 5, column acceleration_1: the value is -Inf, every value must be a finite number",
    ),
    (
        changed(3, "0.06,0.1,1e999"),
        "{path}, line 5, column acceleration_1: the value is 1e999, every value must be a finite number",
    ),
    (
        changed(0, "0.00, ,0.1"),
        "{path}, line 2, column ground_acceleration: the cell is blank, every cell needs a number",
    ),
    (changed(9, "0.18,0.1,"), "{path}, line 11, column acceleration_1: the cell is blank, every cell needs a number"),
    (changed(4, "0.08,abc,0.1"), "{path}, line 6, column ground_acceleration: 'abc' is not a number"),
    (changed(4, "0.08,1_000,0.1"), "{path}, line 6, column ground_acceleration: '1_000' is not a number"),
    (changed(4, "0.08,0.1"), "{path}, line 6: 2 cells where the header has 3 columns, give one number for each"),
    (
        changed(4, "0.08,0.1,0.2,0.3"),
        "{path}, line 6: 4 cells where the header has 3 columns, give one number for each",
    ),
    (changed(4, ""), "{path}, line 6: 0 cells where the header has 3 columns, give one number for each"),
    (
        changed(4, "0.06,0.1,0.2"),
        "{path}, line 6, column time: the step is 0 s where the others are 0.02 s, resample to a uniform time base",
    ),
    (
        changed(4, "0.085,0.1,0.2"),
        "{path}, line 6, column time: the step is 0.025 s where the others are 0.02 s, resample to a uniform time base",
    ),
    (
        lines(rows=["0.5,1,1"] * 10),
        "{path}, line 3, column time: 0.5 s does not come after 0.5 s, give a uniform time base with enough decimals",
    ),
    (
        lines(rows=ROWS[::-1]),
        "{path}, line 3, column time: 0.16 s does not come after 0.18 s, give a uniform time base with enough decimals",
    ),
    (
        lines(header=HEADER.replace("ground_acceleration", "drift_1")),
        (
            "{path}, line 1: column ground_acceleration is missing (applied_force_1 for a force on floor 1, "
            "displacement for a cyclic test), add it"
        ),
    ),
    (
        lines(header=HEADER.replace("time [s]", "drift_1 [m]")),
        "{path}, line 1: column time is missing, add it or state the time_step",
    ),
    (
        lines(header=HEADER.replace("acceleration_1", "velocity_1")),
        "{path}, line 1, column velocity_1: the name is not known, use time, ground_acceleration, applied_force_i, "
        + CHANNELS
        + ", or say by a column map which columns to read",
    ),
    (
        lines(header=HEADER.replace(" [m/s^2],a", ",a")),
        "{path}, line 1, column ground_acceleration: the unit is missing, write ground_acceleration [m/s^2]",
    ),
    (
        lines(header=HEADER.replace("acceleration_1 [m/s^2]", "acceleration_1 [kN]")),
        (
            "{path}, line 1, column acceleration_1: the unit [kN] has the wrong dimension: write a unit of "
            "acceleration such as m/s^2"
        ),
    ),
    (
        lines(header=HEADER.replace("time [s]", "time [foo]")),
        "{path}, line 1, column time: the unit [foo] is not understood: write a unit of time such as s",
    ),
    (
        lines(header=HEADER.replace("acceleration_1", "ground_acceleration")),
        "{path}, line 1, column ground_acceleration: the column appears twice, keep one",
    ),
    (
        lines(header=HEADER.replace("acceleration_1", "acceleration_1 [g]")),
        (
            "{path}, line 1, column 3: 'acceleration_1 [g] [m/s^2]' is not a column name, write a name and its unit, "
            "such as acceleration_1 [m/s^2], and put # before lines above the header"
        ),
    ),
    (
        lines(header="0.1,0.2,0.3"),
        (
            "{path}, line 1: there are numbers where the header should be, write one such as time [s], or give a "
            "column map with column 1, column 2 and so on"
        ),
    ),
    (
        lines(header="time [s],ground_acceleration [g],displacement [m]"),
        "{path}, line 1: both ground_acceleration and displacement drive a record, keep one",
    ),
    (
        lines(header="time [s],ground_acceleration [g],force [N]"),
        "{path}, line 1, column force: it belongs to a cyclic test, not beside ground_acceleration, remove it",
    ),
    (
        lines(header="time [s],displacement [mm],drift_1 [m]"),
        "{path}, line 1, column drift_1: it belongs to a base-excited building, not beside displacement, remove it",
    ),
    (lines(comments=("# true k[1]: many",)), "{path}, line 1, key 'true k[1]': 'many' is not a number"),
    (
        lines(comments=("# a: b", "# time_step: nan")),
        "{path}, line 2, key 'time_step': the value is nan, every value must be a finite number",
    ),
    (lines(comments=("# a: b", "# a: c")), "{path}, line 2: the key 'a' was given in line 1 already, keep one"),
    (
        lines(comments=("# time_step: 0.01",)),
        "{path}, column time: the time_step is stated as 0.01 s but the times step by 0.02 s, correct one of them",
    ),
    (
        lines(comments=("# noise_sd drift_4: 0.1",)),
        "{path}: noise_sd names drift_4, which the record does not have: remove it or add the channel",
    ),
]


@pytest.mark.parametrize(("text", "sentence"), BAD_FILES)
def test_every_bad_file_gets_one_sentence(write: Write, text: str, sentence: str) -> None:
    path = write(text)
    with pytest.raises(UserError) as caught:
        read_record(path)
    assert str(caught.value) == sentence.format(path=path)


def test_line_numbers_count_comments_and_blank_lines(write: Write) -> None:
    path = write("# name: x\n\n" + changed(3, "0.06,nan,0.1"))
    with pytest.raises(UserError, match=r"run.csv, line 7, column ground_acceleration: the value is nan"):
        read_csv(path)


def test_not_utf8_names_the_line(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(b"# name: ok\n# place: D\xfczce\n" + lines().encode())
    with pytest.raises(UserError) as caught:
        read_record(path)
    assert str(caught.value) == f"{path}, line 2: the text is not UTF-8, save the file as UTF-8"


def test_missing_file_folder_and_suffix(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"absent.csv: no such file, give the path of one$"):
        read_record(tmp_path / "absent.csv")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(UserError, match=r"folder.csv: the file cannot be read"):
        read_record(tmp_path / "folder.csv")
    with pytest.raises(UserError, match=r"run.xls: the suffix '.xls' is not known, use .csv, .tsv, .txt"):
        read_record(tmp_path / "run.xls")


def test_writing_where_it_cannot(tmp_path: Path) -> None:
    record = Record(name="x", time_step=0.1, excitation=np.zeros(8))
    with pytest.raises(UserError, match=r"run.csv: the file cannot be written"):
        write_record(record, tmp_path / "absent" / "run.csv")
    with pytest.raises(UserError, match=r"run.at2: the suffix '.at2' cannot be written, use .csv or .nc$"):
        write_record(record, tmp_path / "run.at2")


def test_a_record_without_channels_round_trips(tmp_path: Path) -> None:
    record = Record(name="x", time_step=0.1, excitation=np.arange(8.0), provenance={"k": "v"})
    write_record(record, tmp_path / "run.csv")
    assert read_record(tmp_path / "run.csv").equals(record)
    assert not read_record(tmp_path / "run.csv").equals(replace(record, name="y"))


@settings(max_examples=100, deadline=None)
@given(st.text(alphabet=st.sampled_from("time [s],#:\n0.1-eground_acceleration/m^2nanf;\t\x00é"), max_size=200))
def test_no_text_raises_anything_but_a_user_error(text: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.csv"
        path.write_text(text, encoding="utf-8")
        with pytest.raises(UserError, match=r"run\.csv"):
            read_csv(path)
