"""PEER AT2 ground motions: both header styles, and one sentence for every bad file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bwbn_bayes.errors import UserError
from bwbn_bayes.records import read_at2, read_record

HEAD = "PEER NGA STRONG MOTION DATABASE RECORD\r\nSomewhere, 1/1/2000, Hall, 90\r\n"
UNIT = "ACCELERATION TIME SERIES IN UNITS OF G\r\n"
COUNT = "NPTS=   12, DT=   .0100 SEC,      \r\n"
NUMBERS = "  .1000000E+00  -.2000000E-01   .3000000E-03\r\n" * 4


def at2(folder: Path, text: str, name: str = "motion.AT2") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8", newline="")
    return path


@pytest.mark.parametrize("count", [COUNT, "   12    0.0100    NPTS, DT\r\n", "NPTS=12, DT=.01 SEC\r\n"])
def test_reads_both_header_styles(tmp_path: Path, count: str) -> None:
    record = read_record(at2(tmp_path, HEAD + UNIT + count + NUMBERS, "motion.at2"))
    assert record.name == "motion"
    assert record.time_step == 0.01
    assert record.excitation_kind == "ground_acceleration"
    assert dict(record.channels) == {}
    assert record.provenance["event"] == "Somewhere, 1/1/2000, Hall, 90"
    np.testing.assert_allclose(record.excitation, 9.80665 * np.tile([0.1, -0.02, 0.0003], 4), rtol=1e-15)


def test_other_units(tmp_path: Path) -> None:
    unit = UNIT.replace(" G", " CM/S/S").replace("CM/S/S", "cm/s/s")
    assert read_at2(at2(tmp_path, HEAD + unit + COUNT + NUMBERS)).excitation[0] == pytest.approx(1e-3)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "{path}: the file is empty, get it anew"),
        (
            HEAD,
            "{path}, line 3: no 'ACCELERATION ... IN UNITS OF', the file is not a PEER acceleration record",
        ),
        (
            HEAD + UNIT.replace("ACCELERATION", "VELOCITY") + COUNT + NUMBERS,
            "{path}, line 3: no 'ACCELERATION ... IN UNITS OF', the file is not a PEER acceleration record",
        ),
        (
            HEAD + UNIT.replace(" G", " furlong") + COUNT + NUMBERS,
            (
                "{path}, line 3, column ground_acceleration: the unit [furlong] has the wrong dimension: write a "
                "unit of ground acceleration such as m/s^2"
            ),
        ),
        (
            HEAD + UNIT + NUMBERS,
            "{path}, line 4: no 'NPTS= ..., DT= ...', the file is not a PEER acceleration record",
        ),
        (
            HEAD + UNIT + COUNT + NUMBERS[:-17],
            "{path}, line 4: NPTS is 12 but 11 numbers follow, the file is truncated",
        ),
        (HEAD + UNIT + COUNT, "{path}, line 4: NPTS is 12 but 0 numbers follow, the file is truncated"),
        (HEAD + UNIT + COUNT + NUMBERS * 2, "{path}, line 4: NPTS is 12 but 24 numbers follow, the file is too long"),
        (
            HEAD + UNIT + COUNT + NUMBERS + "  .1 *****",
            "{path}, line 9, column 2: '*****' is not a number",
        ),
        (
            HEAD + UNIT + COUNT + " nan" + NUMBERS,
            "{path}, line 5, column 1: the value is nan, every value must be a finite number",
        ),
        (
            HEAD + UNIT + COUNT.replace(".0100", ".0000") + NUMBERS,
            "{path}: time_step is 0 s: it must be a positive number",
        ),
        (
            HEAD + UNIT + COUNT.replace("12", "3") + NUMBERS[:46],
            "{path}: the record has 3 points: at least 8 are needed, 32 to identify from",
        ),
    ],
)
def test_every_bad_file_gets_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    path = at2(tmp_path, text)
    with pytest.raises(UserError) as caught:
        read_record(path)
    assert str(caught.value) == sentence.format(path=path)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"motion.AT2: no such file, give the path of one$"):
        read_record(tmp_path / "motion.AT2")


def test_a_station_name_in_another_encoding_is_no_obstacle(tmp_path: Path) -> None:
    path = tmp_path / "motion.AT2"
    path.write_bytes((HEAD.replace("Hall", "D\xfczce") + UNIT + COUNT + NUMBERS).encode("latin-1"))
    assert read_at2(path).n_times == 12


def test_a_count_of_5000_digits_is_no_count(tmp_path: Path) -> None:
    """Python refuses to read such a number, which ended in a traceback."""
    path = tmp_path / "long.AT2"
    path.write_text(f"a\nb\nACCELERATION TIME SERIES IN UNITS OF G\nNPTS= {'9' * 5000}, DT= .01 SEC\n0.1 0.2\n")
    with pytest.raises(UserError, match="line 4: no 'NPTS="):
        read_at2(path)
