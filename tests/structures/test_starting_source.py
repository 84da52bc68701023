"""The starting model's file: it runs as it is and gives the starting model; masses typed in it scale its priors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bwbn_bayes.errors import UserError
from bwbn_bayes.records import Record, el_centro, write_record
from bwbn_bayes.structures.model_file import load_model_file
from bwbn_bayes.structures.starting_model import starting_model
from bwbn_bayes.structures.starting_source import UNIT_MASSES, starting_source

PATH = np.concatenate([a * np.sin(np.linspace(0.0, 4.0 * np.pi, 101)[1:]) for a in (0.002, 0.01, 0.03)])
CYCLIC = Record(
    name='a "steel" brace', time_step=1.0, excitation=PATH, excitation_kind="displacement",
    channels={"force": 2e5 * np.tanh(PATH / 0.01)}, has_time=False,
)  # fmt: skip


def shaken() -> Record:
    motion = el_centro("chopra", duration=10.0)
    return motion.with_channels({f"acceleration_{i}": i * np.roll(motion.excitation, 5 * i) for i in (1, 2)})


def written(record: Record, directory: Path) -> Path:
    write_record(record, directory / "measured.csv")
    path = directory / "start.py"
    path.write_text(starting_source(record, Path("measured.csv")).text, encoding="utf-8")
    return path


@pytest.mark.parametrize("record", [CYCLIC, shaken()], ids=["specimen", "building"])
def test_the_file_gives_the_starting_model_and_its_record(record: Record, tmp_path: Path):
    file = load_model_file(written(record, tmp_path))
    assert file.model == starting_model(record)
    assert file.record is not None
    assert file.record.equals(record)


def test_the_file_says_what_the_columns_say():
    text = starting_source(CYCLIC, Path("measured.csv")).text
    u, force = CYCLIC.excitation, CYCLIC.channels["force"]
    assert f"- displacement: from {min(u):.4g} to {max(u):.4g} m" in text
    assert f"- force: from {min(force):.4g} to {max(force):.4g} N" in text
    assert "300 points without a time column" in text
    assert "13 half cycles" in text
    lines = text.split("\n")
    for symbol in ("k", "c", "alpha", "u_y", "rho", "n"):
        number = next(i for i, line in enumerate(lines) if line.startswith(f"        {symbol}="))
        assert lines[number - 1].strip().startswith("# "), symbol


def test_masses_that_are_typed_scale_stiffness_and_damping(tmp_path: Path):
    source = starting_source(shaken(), Path("measured.csv"))
    assert "mass of each floor" in source.to_do[0]
    assert "TYPE THE MASS OF EACH FLOOR HERE" in source.text
    path = written(shaken(), tmp_path)
    path.write_text(path.read_text(encoding="utf-8").replace("[1.0, 1.0]", "[9e3, 11e3]"), encoding="utf-8")
    typed = load_model_file(path).model
    expected = starting_model(shaken(), masses=[9e3, 11e3])
    assert typed.masses == expected.masses
    for name in ("k", "c"):
        medians = [m.element.values[name].value.median for m in (typed, expected)]
        assert medians[0] == pytest.approx(medians[1], rel=0.01)


def test_a_record_s_name_stays_a_name(tmp_path: Path):
    """Data never execute anything, nor does what is written about them."""
    record = replace(CYCLIC, name='x""" + str(1 / 0) + """ \\ y"')
    assert load_model_file(written(record, tmp_path)).model == starting_model(record)


def test_nothing_is_left_to_do_for_a_specimen():
    assert starting_source(CYCLIC, Path("measured.csv")).to_do == ()


def test_a_record_elsewhere_is_named_by_its_whole_path(tmp_path: Path):
    write_record(CYCLIC, tmp_path / "measured.csv")
    path = tmp_path / "models" / "start.py"
    path.parent.mkdir()
    path.write_text(starting_source(CYCLIC, tmp_path / "measured.csv").text, encoding="utf-8")
    assert load_model_file(path).record is not None


def test_a_record_s_file_stands_for_its_starting_model(tmp_path: Path):
    for record, told in ((CYCLIC, 1), (shaken(), 2)):
        write_record(record, tmp_path / "measured.nc")
        file = load_model_file(tmp_path / "measured.nc")
        assert (file.name, file.model, len(file.assumptions)) == ("measured", starting_model(record), told)
        assert file.record is not None
    assert file.assumptions[1] == UNIT_MASSES


def test_a_record_without_channels_has_no_starting_model(tmp_path: Path):
    write_record(replace(CYCLIC, channels={}), tmp_path / "path.csv")
    with pytest.raises(UserError, match="has no force beside its displacement"):
        load_model_file(tmp_path / "path.csv")
