"""``bwbn export opensees`` from end to end."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from opensees_runs import error, run_script

from bwbn_bayes import el_centro, simulate, write_record
from bwbn_bayes.cli import main
from bwbn_bayes.structures.model_file import load_model_file

MODEL = """
from bwbn_bayes import BoucWen, ShearBuilding, Uniform, el_centro

model = ShearBuilding(masses=[2.0], storey=BoucWen(k=Uniform(50, 400), c=0.4, alpha=0.1, u_y=0.03, rho=0.6, n=1.5))
"""
KNOWN = 'excitation = el_centro("chopra", duration=6.0)\ntruth = {"k": 150.0}\n'


@pytest.fixture
def model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "one.py"
    path.write_text(MODEL + KNOWN, encoding="utf-8")
    return path


def export(*arguments: object) -> int:
    with pytest.raises(SystemExit) as leaving:
        main(["export", *map(str, arguments)])
    return int(leaving.value.code or 0)


def test_a_model_becomes_a_script_that_runs(model: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert export("opensees", model) == 0
    assert capfd.readouterr().out == "one_opensees.py\n"
    file = load_model_file(model)
    truth = simulate(file.model, el_centro("chopra", duration=6.0), {"k": 150.0}).channels
    assert error(run_script(model.with_name("one_opensees.py")), dict(truth)) < 1e-2


def test_another_ground_motion_and_another_name(model: Path) -> None:
    write_record(el_centro("chopra", duration=4.0), Path("other.csv"))
    assert export("opensees", model, "--record", "other.csv", "--out", "x.py") == 0
    assert len(Path("x.py").read_text(encoding="utf-8")) < len(_written(model))


def test_a_record_is_read_by_the_column_map_of_the_model_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mapped.py").write_text(MODEL + KNOWN + '\ncolumns = "t = time [s], ag = ground_acceleration [m/s^2]"\n')
    rows = "\n".join(f"{0.02 * i:.2f},{0.1 * (i % 5)}" for i in range(100))
    Path("q.csv").write_text(f"t,ag\n{rows}\n")
    assert export("opensees", "mapped.py", "--record", "q.csv", "--out", "x.py") == 0


def test_a_record_is_read_by_a_column_map_of_the_command(model: Path) -> None:
    rows = "\n".join(f"{0.02 * i:.2f},{0.1 * (i % 5)}" for i in range(100))
    Path("q.csv").write_text(f"t,ag\n{rows}\n")
    told = ("--columns", "t = time [s], ag = ground_acceleration [m/s^2]")
    assert export("opensees", model, "--record", "q.csv", *told, "--out", "x.py") == 0


def _written(model: Path) -> str:
    assert export("opensees", model, "--out", "longer.py") == 0
    return Path("longer.py").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("source", "arguments", "sentence"),
    [
        (MODEL + KNOWN, ("one.py", "--out", "one.py"), "one.py exists already: give another name with --out"),
        (MODEL + KNOWN.splitlines()[0], ("one.py",), "one.py does not know k: add `truth`"),
        (MODEL, ("one.py",), "one.py defines no `excitation`"),
        (MODEL, ("none.nc",), "none.nc does not exist"),
        (MODEL, (".",), "result.nc does not exist"),
        (MODEL, ("none.nc", "--record", "one.csv"), "belong to a model: a result"),
        (MODEL + KNOWN, ("one.py", "--columns", "t = time [s]"), "no record is given: add --record FILE"),
        (MODEL + KNOWN, ("one.py", "--record", "r.csv", "--record", "r.csv"), "one record at a time"),
        (
            MODEL + KNOWN,
            ("one.py", "--at", "map"),
            "--at is a point of a result's posterior: a model is written at its",
        ),
    ],
)
def test_a_mistake_is_one_sentence(
    model: Path, source: str, arguments: tuple[str, ...], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    model.write_text(source, encoding="utf-8")
    write_record(el_centro("chopra", duration=1.0), Path("r.csv"))
    assert export("opensees", *arguments) == 2
    assert sentence in capsys.readouterr().err
    assert export() == 2


PINCHED = """
import numpy as np

from bwbn_bayes import BoucWen, Record, SlipLock, Specimen

storey = BoucWen(k=8e7, c=0.0, alpha=0.05, u_y=0.008, rho=0.6, n=1.7)
model = Specimen(storey=storey).with_effect(SlipLock(delta_s=3e-8, sigma=0.003))
cycles = np.linspace(0.0, 1.0, 25)
path = 0.02 * np.sin(2.0 * np.pi * cycles) * cycles
excitation = Record(name="path", time_step=1.0, has_time=False, excitation=path, excitation_kind="displacement")
"""


def test_a_place_that_takes_no_file_is_told_before_the_work(
    model: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was told after minutes of fitting."""
    monkeypatch.setattr("bwbn_bayes.export.script_of", lambda *_, **__: pytest.fail("the work was done first"))
    assert export("opensees", model, "--out", "nowhere/x.py") == 2
    assert "--out nowhere/x.py cannot be written (No such file or directory)" in capsys.readouterr().err


def test_a_place_that_was_tried_is_left_empty(model: Path) -> None:
    """Where the work is refused, nothing is written."""
    model.write_text(MODEL.replace("c=0.4", "c=0.4, A=PerStorey([1.0])") + KNOWN, encoding="utf-8")
    assert export("opensees", model, "--out", "x.py") == 2
    assert not Path("x.py").exists()


def test_opensees_says_no_farewell(model: Path) -> None:
    """``Process 0 Terminating`` stood on stderr after every fit."""
    pytest.importorskip("openseespy.opensees")
    model.write_text(PINCHED, encoding="utf-8")
    command = "from bwbn_bayes.cli import main; main(['export', 'opensees', 'one.py'])"
    done = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stdout) == (0, "one_opensees.py\n"), done.stderr
    assert "is fitted and misses" in done.stderr
    assert "Terminating" not in done.stderr
