"""PyTensor where its usual folder cannot be written."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from bwbn_bayes import UserError
from bwbn_bayes.inference.pymc import compile_folder

WHERE = """
import bwbn_bayes.inference.pymc.operators
import pytensor
print(pytensor.config.base_compiledir)
"""


def test_without_a_home_pytensor_compiles_beside_our_kernels(tmp_path: Path) -> None:
    """Methods smc and nuts ended in a traceback of its import."""
    environment = {**os.environ, "HOME": "/proc/nowhere", "BWBN_CACHE_DIR": str(tmp_path)}
    for name in ("PYTENSOR_FLAGS", "PYTENSORRC"):
        environment.pop(name, None)
    done = subprocess.run([sys.executable, "-c", WHERE], env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, f"{tmp_path / 'pytensor'}\n"), done.stderr


@pytest.fixture
def _no_pytensor_yet(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("PYTENSOR_FLAGS", "PYTENSORRC"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.delitem(sys.modules, "pytensor", raising=False)


@pytest.mark.usefixtures("_no_pytensor_yet")
def test_a_folder_of_the_users_own_choice_stays(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", "/proc/nowhere")
    monkeypatch.setenv("PYTENSOR_FLAGS", "base_compiledir=/mine")
    compile_folder.provide_compile_folder()
    assert os.environ["PYTENSOR_FLAGS"] == "base_compiledir=/mine"
    monkeypatch.setenv("PYTENSOR_FLAGS", "floatX=float64")
    monkeypatch.setattr(compile_folder, "cache_directory", lambda: tmp_path)
    compile_folder.provide_compile_folder()
    assert os.environ["PYTENSOR_FLAGS"] == f"floatX=float64,base_compiledir={tmp_path / 'pytensor'}"
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("PYTENSOR_FLAGS", "")
    compile_folder.provide_compile_folder()
    assert os.environ["PYTENSOR_FLAGS"] == ""


@pytest.mark.usefixtures("_no_pytensor_yet")
def test_where_nothing_can_be_written_one_sentence_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/proc/nowhere")
    monkeypatch.setattr(compile_folder, "cache_directory", lambda: None)
    with pytest.raises(UserError, match="PyTensor has no folder to compile in: set HOME or TMPDIR"):
        compile_folder.provide_compile_folder()
