"""The model files that come with the package: listed, copied whole, never over a file of the user's."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from bwbn_bayes import UserError
from bwbn_bayes.cli import main
from bwbn_bayes.structures import examples as module
from bwbn_bayes.structures.examples import example_files, examples
from bwbn_bayes.structures.model_file import load_model_file

MODELS = Path(__file__).parents[2] / "models"


def bwbn(*arguments: object) -> int:
    with pytest.raises(SystemExit) as leaving:
        main([str(argument) for argument in arguments])
    return int(leaving.value.code or 0)


def test_every_model_file_is_listed_with_what_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert bwbn("model", "--examples") == 0
    printed = capsys.readouterr().out
    for path in MODELS.glob("*.py"):
        assert path.stem in printed and path.read_text(encoding="utf-8").split('"""')[1].split("\n")[0] in printed


def test_no_record_is_left_behind() -> None:
    """An example whose record stayed where it was would not load."""
    copied = {path.name for name in examples() for path in example_files(name)}
    assert copied == {path.name for path in MODELS.iterdir() if path.suffix in (".py", ".csv")}


def test_a_copied_example_loads_with_its_records(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "mine.py"
    assert bwbn("model", "--example", "hidden_effect", "--out", out) == 0
    assert capsys.readouterr().out == f"{out}\n"
    file, original = load_model_file(out), load_model_file(MODELS / "hidden_effect.py")
    assert file.name == "mine"
    assert file.record is not None and original.record is not None and file.held_out is not None
    assert file.record.n_times == original.record.n_times


def test_nothing_is_copied_over_a_file_of_the_user_s(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "hidden_effect_held_out.csv"
    mine.write_text("mine")
    assert bwbn("model", "--example", "hidden_effect", "--out", tmp_path / "new.py") == 2
    assert "hidden_effect_held_out.csv exists already: give another name with --out" in capsys.readouterr().err
    assert mine.read_text() == "mine" and not (tmp_path / "new.py").exists()


def test_a_place_that_cannot_be_written_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert bwbn("model", "--example", "sdof", "--out", tmp_path / "nowhere" / "sdof.py") == 2
    assert "cannot be written (No such file or directory): choose another place" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments", [[], ["--examples", "--example", "sdof"], ["--example", "sdof", "record.csv"], ["x.csv", "--examples"]]
)
def test_one_thing_is_asked_for_at_a_time(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert bwbn("model", *arguments) == 2
    assert "give either a RECORD, --example NAME or --examples" in capsys.readouterr().err


def test_an_unknown_example_names_those_there_are() -> None:
    with pytest.raises(UserError, match=r"'\.\./secret' does not come with the package: .*hidden_effect, .*sdof"):
        example_files("../secret")


def test_an_installed_package_has_them_inside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A wheel has no folder beside the package: there they stood nowhere, and no command of the page could be run."""
    package = tmp_path / "site-packages" / "bwbn_bayes"
    shutil.copytree(MODELS, package / "models")
    monkeypatch.setattr(module, "_PACKAGE", package)
    assert example_files("sdof") == (package / "models" / "sdof.py",)
