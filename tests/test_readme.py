"""What the front page says is true: its commands run, its code executes, its links lead somewhere."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest

from bwbn_bayes import Result, read_record
from bwbn_bayes.cli import main
from bwbn_bayes.elements.catalogue import catalogue
from bwbn_bayes.structures.model_file import load_model_file

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "reports" / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
README = PAGES[0].read_text(encoding="utf-8")
INSTALL = "python3 -m venv .uv && .uv/bin/pip install uv && .uv/bin/"


def blocks(language: str, text: str = README) -> list[str]:
    """The fenced blocks of one language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def quick_start() -> list[str]:
    """The commands of the section for a fresh machine."""
    section = README.split("## Two commands")[1].split("\n## ")[0]
    return [line for block in blocks("sh", section) for line in block.splitlines()]


def test_a_fresh_machine_needs_exactly_two_commands() -> None:
    assert quick_start() == [
        f"{INSTALL}uv run bwbn discover models/hidden_effect.py",
        f"{INSTALL}uv run pytest -q -n auto --dist worksteal",
    ]


def test_the_continuous_integration_runs_the_same_tests() -> None:
    assert quick_start()[1].removeprefix(INSTALL) in (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()


@pytest.mark.slow
def test_the_main_job_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = shlex.split(quick_start()[0].removeprefix(f"{INSTALL}uv run bwbn "))
    monkeypatch.chdir(ROOT)
    with pytest.raises(SystemExit) as leaving:
        main([*arguments, "--out", str(tmp_path)])
    assert leaving.value.code == 0
    found = json.loads((tmp_path / "discovery.json").read_text(encoding="utf-8"))
    assert found["verdict"] == "effects_found"
    assert [(effect["name"], effect["storeys"]) for effect in found["effects"]] == [("slip_lock", [2])]
    gap = found["gap"]["held_out"]
    assert gap["after"] < 1.1 * gap["noise_floor"] < gap["before"]
    assert all(check.passed for check in Result.load(tmp_path / "identify" / "result.nc").facts.checks)


def test_the_page_counts_the_catalogue() -> None:
    """It still said 25 when there were 26."""
    assert f"a catalogue of {len(catalogue())}," in README


def test_every_command_of_the_page_exists(capsys: pytest.CaptureFixture[str]) -> None:
    commands = set(re.findall(r"bwbn ([a-z]+)", README))
    assert commands == {
        "discover",
        "identify",
        "model",
        "simulate",
        "batch",
        "export",
        "reproduce",
        "effects",
        "engines",
    }
    for command in sorted(commands):
        with pytest.raises(SystemExit) as leaving:
            main([command, "--help"])
        assert leaving.value.code == 0
    options = set(re.findall(r"`(--[a-z]+)`", README))
    shown = capsys.readouterr().out
    assert options
    assert all(option in shown for option in options)


def test_the_sample_record_reads(tmp_path: Path) -> None:
    (sample,) = blocks("csv")
    path = tmp_path / "my_record.csv"
    path.write_text(sample, encoding="utf-8")
    record = read_record(path)
    assert list(record.channels) == ["acceleration_1", "acceleration_2"]
    assert record.channels["acceleration_1"][1] == pytest.approx(0.0021 * 9.80665, rel=1e-12)


def test_the_sample_model_is_what_the_page_says(tmp_path: Path) -> None:
    path = tmp_path / "my_model.py"
    path.write_text(blocks("python")[0], encoding="utf-8")
    model = load_model_file(str(path)).model
    names = {"k[1]", "k[2]", "c[1]", "c[2]", "alpha", "beta", "gamma", "delta_nu", "delta_s[1]"}
    assert set(model.space.names) == names


def test_the_sample_program_runs_and_finds_k(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(blocks("python")[1], "README.md", "exec"), names)
    result = names["result"]
    assert isinstance(result, Result)
    (k,) = (p for p in result.facts.parameters if p.name == "k")
    assert abs(k.mean - 40.0) < 4.0 * k.sd
    assert result.facts.verdict[0] in capsys.readouterr().out
    assert (tmp_path / "result.nc").is_file()
    assert (tmp_path / "my_report" / "report.html").is_file()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_and_pictures_of_a_page_exist(page: Path) -> None:
    targets = re.findall(r"\]\(([^)]+)\)", page.read_text(encoding="utf-8"))
    local = [target for target in targets if not target.startswith("http")]
    assert [target for target in local if not (page.parent / target).exists()] == []
