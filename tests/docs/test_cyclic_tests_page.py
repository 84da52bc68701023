"""The walk-through's blocks and short commands run on a test in mm and kN without time."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from pages import DOCS, run_page

from bwbn_bayes import simulate
from bwbn_bayes.cli import main
from bwbn_bayes.structures.model_file import load_model_file


def commands() -> list[list[str]]:
    blocks = re.findall(r"^```sh\n(.*?)^```$", (DOCS / "cyclic_tests.md").read_text("utf-8"), re.MULTILINE | re.DOTALL)
    return [shlex.split(line, comments=True)[1:] for block in blocks for line in block.splitlines()]


def test_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    file = load_model_file(DOCS.parent / "models" / "cyclic_test.py")
    assert file.excitation is not None
    made = simulate(file.model, file.excitation, file.truth, snr_db=file.snr_db, seed=1)
    rows = np.column_stack([1e3 * made.excitation, 1e-3 * made.channels["force"]])
    np.savetxt("my_test.csv", rows, "%.4f", ",", header="displacement [mm],force [kN]", comments="")

    names = run_page("cyclic_tests.md")
    displacement, force = names["loop"]  # type: ignore[misc]
    np.testing.assert_allclose(displacement, made.excitation, rtol=0.0, atol=1e-7)  # the file's last digit is 1e-4 mm
    np.testing.assert_allclose(force, made.channels["force"], rtol=0.0, atol=0.1)  # and 1e-4 kN
    assert "pinching index 0." in capsys.readouterr().out
    for command in commands():
        with pytest.raises(SystemExit) as leaving:
            main(command)
        assert leaving.value.code == 0, capsys.readouterr().err
    written = load_model_file("my_test.py")
    assert written.record is not None
    assert not written.record.has_time
    assert "BoucWen" in Path("cyclic_test_opensees.py").read_text("utf-8")
