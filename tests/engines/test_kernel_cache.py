"""Compiled kernels are kept on disk and found again."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import SlipLock
from bwbn_bayes.engines import scalar
from bwbn_bayes.engines.children import RUNNING
from bwbn_bayes.engines.kept_code import remembered
from bwbn_bayes.engines.kernel import Kernel
from bwbn_bayes.engines.lane_laws import is_compiled
from bwbn_bayes.engines.precompile import precompile
from bwbn_bayes.structures.shear_building import ShearBuilding

_SOURCES = """
import hashlib
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import SlipLock, StrengthDegradation
from bwbn_bayes.engines.lane_source import lane_source
from bwbn_bayes.engines.scalar import programs_of
from bwbn_bayes.engines.scalar_source import scalar_source
from bwbn_bayes.structures.shear_building import ShearBuilding

building = ShearBuilding(masses=[1.0], storey=BoucWen(k=10.0, beta=1.0, gamma=1.0))
law = building.with_effect(StrengthDegradation(delta_nu=0.1)).with_effect(SlipLock(delta_s=0.02, sigma=0.05)).law
for source, options in ((lane_source, {}), (scalar_source, {"with_tangents": True})):
    print(hashlib.sha256(source(*programs_of(law), driven=False, **options).encode()).hexdigest())
"""


def test_generated_source_does_not_depend_on_the_order_of_a_set(tmp_path: Path) -> None:
    """Another hash seed and an empty cache give the same source, and so the same file."""
    sources = []
    for hash_seed in ("1", "2"):
        environment = {**os.environ, "BWBN_CACHE_DIR": str(tmp_path / hash_seed), "PYTHONHASHSEED": hash_seed}
        run = subprocess.run(
            [sys.executable, "-c", _SOURCES], env=environment, capture_output=True, text=True, check=True
        )
        sources.append(run.stdout.split())
    assert len(set(sources[0])) == 2
    assert sources[0] == sources[1]


def test_changed_source_is_another_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BWBN_CACHE_DIR", str(tmp_path))
    texts = (f"def answer() -> int:\n    return {value}\n" for value in (1, 2))
    one, two = (Kernel("probe", text).functions("answer") for text in texts)
    assert (one.answer(), two.answer()) == (1, 2)
    assert len(list(tmp_path.glob("probe_*.py"))) == 2


def test_what_was_made_is_remembered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Made once under a key, anew under another key or kind; nothing half-written is left behind."""
    monkeypatch.setenv("BWBN_CACHE_DIR", str(tmp_path / "new"))
    made: list[str] = []

    def make(word: str) -> dict[str, int]:
        made.append(word)
        return {word: len(made)}

    assert remembered("probe", "key", lambda: make("first")) == {"first": 1}
    assert remembered("probe", "key", lambda: make("never")) == {"first": 1}
    assert remembered("probe", "another key", lambda: make("second")) == {"second": 2}
    assert remembered("other", "key", lambda: make("third")) == {"third": 3}
    assert made == ["first", "second", "third"]
    assert len(list((tmp_path / "new").iterdir())) == 3
    assert all(path.suffix == ".kept" for path in (tmp_path / "new").iterdir())


def test_what_cannot_be_made_is_not_remembered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BWBN_CACHE_DIR", str(tmp_path))

    def fail() -> int:
        raise ArithmeticError

    with pytest.raises(ArithmeticError):
        remembered("probe", "key", fail)
    assert remembered("probe", "key", lambda: 4) == 4


_SOLVE = """
import hashlib
import sys
import numpy as np
from bwbn_bayes import BoucWen, ShearBuilding, SlipLock, Uniform, el_centro
from bwbn_bayes.engines import kernel, lanes

compile_code = kernel.object_code
compiled = []
kernel.object_code = lambda source, *entries: compiled.extend(entries) or compile_code(source, *entries)
storey = BoucWen(k=Uniform(20, 60), c=Uniform(0, 1), alpha=0.05, beta=Uniform(1, 80), gamma=15.0, n=1.2)
model = ShearBuilding(masses=[1.0], storey=storey).with_effect(SlipLock(delta_s=0.02, sigma=0.05))
ground = el_centro("chopra", duration=6.0)
record = ground.with_channels({"acceleration_1": np.array(ground.excitation)})
engine = lanes.Lanes(substeps=2, resolution=0.5, n_threads=1)
draws = np.array([[40.0, 0.2, 30.0], [35.0, 0.1, 10.0]])
engine.simulate(model, draws, record)
engine.misfit(model, draws, record)
found = engine.normal_equations(model, draws, record)
numbers = (found.misfit, found.gradient, found.information)
print(hashlib.sha256(b"".join(each.tobytes() for each in numbers)).hexdigest(), *sorted(compiled))
assert "numba" not in sys.modules  # a second of every start
"""


def _solve(environment: dict[str, str]) -> list[str]:
    """Hash of the derivatives, then what was compiled for them."""
    command = [sys.executable, "-c", _SOLVE]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.split()


def test_a_law_compiled_ahead_needs_no_compiling(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another process compiles; a third has nothing left to compile."""
    monkeypatch.setenv("BWBN_CACHE_DIR", str(tmp_path))
    building = ShearBuilding(masses=[1.0], storey=BoucWen(k=10.0, beta=1.0, gamma=1.0))
    law = building.with_effect(SlipLock(delta_s=0.02, sigma=0.05)).law
    assert not is_compiled(law, False)
    compiling = precompile({law: True}, driven=False)
    assert compiling is not None
    compiling.join(timeout=300)
    assert not compiling.is_alive()
    # It aborted, after its work, where a thread still waited for the end of its stdin.
    assert RUNNING[-1].returncode == 0
    assert is_compiled(law, False)
    assert not is_compiled(law, True)
    assert precompile({law: True}, driven=False) is None
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    assert len([path for path in before if path.suffix == ".object"]) == 3
    environment = {**os.environ, "BWBN_CACHE_DIR": str(tmp_path), "PYTHONHASHSEED": "2"}
    digest, *compiled = _solve(environment)
    assert compiled == []
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()} == before
    assert not list(tmp_path.glob("*.tmp"))
    # Derivatives of the process that compiles were not, to the last bit, those of the processes that come after it.
    everything = ["run", "run_with_tangents"]
    assert _solve({**environment, "BWBN_CACHE_DIR": str(tmp_path / "empty")}) == [digest, *everything]


def test_what_is_not_generated_yet_is_not_compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Asking generated the law of all effects in the main thread, seconds that its child was to take."""
    monkeypatch.setenv("BWBN_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(scalar, "law_programs", lambda _: pytest.fail("the law was generated"))
    law = ShearBuilding(masses=[1.0], storey=BoucWen(k=10.0, beta=1.0, gamma=1.0)).law
    assert not is_compiled(law, False)
