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
    with pytest.raises(UserError, match="is a directory: give the path of a Python file that defines"):
        load_model_file(tmp_path)


def test_a_missing_file_is_missing_whatever_its_name(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="does not exist: give the path of a Python file"):
        load_model_file(tmp_path / "nowhere.xlsx")


@pytest.mark.parametrize(
    ("source", "said"),
    [
        (
            "from bwbn_bayes import BoucWen\n\nstorey = BoucWen(roh=0.5)",
            "BoucWen does not know roh: it knows k, c, alpha",
        ),
        ("import bwbn_bayes as bb\n\nstorey = bb.BoucWen(roh=0.5)", "BoucWen does not know roh: it knows k, c, alpha"),
        ("def own(a): ...\n\nown(b=1)", "own does not know b: it knows a"),
        ("class A:\n    def f(self): ...\nA().f(b=1)", "A.f does not know b"),
        ("\n\n1 + 'a'", "TypeError: unsupported operand"),
    ],
)
def test_a_misspelt_keyword_is_told_with_those_that_are_known(tmp_path: Path, source: str, said: str) -> None:
    """It was told in the words of Python's TypeError alone."""
    path = tmp_path / "model.py"
    path.write_text(source + "\n")
    with pytest.raises(UserError) as refused:
        load_model_file(path)
    assert str(refused.value).startswith(f"{path}, line 3: {said}")
