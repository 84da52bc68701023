"""What may run as a model file, and what is said of a mistake in one."""

from __future__ import annotations

from pathlib import Path

import pytest

from bwbn_bayes.errors import UserError
from bwbn_bayes.structures.model_file import load_model_file


@pytest.mark.parametrize("name", ["test.xlsx", "test", "test.bak", "test.json", "test.py.txt~"])
def test_nothing_but_python_runs(tmp_path: Path, name: str) -> None:
    """Whatever was no record ran as Python: a spreadsheet, a note, a copy."""
    path, ran = tmp_path / name, tmp_path / "ran"
    path.write_text(f"open({str(ran)!r}, 'w')\n")
    with pytest.raises(UserError, match=r"suffix.*: a model file ends in \.py, a record in \.csv, .*; rename it, or"):
        load_model_file(path)
    assert not ran.exists()


def test_a_directory_is_called_one(tmp_path: Path) -> None:
    """It was said not to exist."""
    with pytest.raises(UserError, match="is a directory: give the path of a Python file in it"):
        load_model_file(tmp_path)


def test_a_missing_file_is_missing_whatever_its_name(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="does not exist: give the path of a Python file"):
        load_model_file(tmp_path / "nowhere.xlsx")
