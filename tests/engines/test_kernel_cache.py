"""Compiled kernels are kept on disk and found again."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from bwbn_bayes.engines.kernel_cache import load_kernel

_USE = """
import numpy as np
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.engines.scalar import scalar_kernel
from bwbn_bayes.structures.shear_building import ShearBuilding

model = ShearBuilding(masses=[1.0], storey=BoucWen(k=10.0, beta=1.0, gamma=1.0))
kernel = scalar_kernel(model.law, False)
kernel.prepare(np.zeros(100))
print(sum(kernel.prepare.stats.cache_hits.values()))
"""


def _hits(directory: Path, hash_seed: str) -> int:
    """Cache hits of a fresh process that uses a kernel."""
    environment = {**os.environ, "BWBN_CACHE_DIR": str(directory), "PYTHONHASHSEED": hash_seed}
    done = subprocess.run([sys.executable, "-c", _USE], env=environment, capture_output=True, text=True, check=True)
    return int(done.stdout)


def test_a_second_process_reuses_the_first_ones_kernel(tmp_path: Path) -> None:
    assert _hits(tmp_path, "1") == 0
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    # Another hash seed: source that depended on the order of a set would be another file.
    assert any(path.suffix == ".nbc" for path in before)
    assert _hits(tmp_path, "2") == 1
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()} == before


def test_changed_source_is_another_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BWBN_CACHE_DIR", str(tmp_path))
    one, two = (load_kernel("probe", f"def answer():\n    return {value}\n") for value in (1, 2))
    assert (one.answer(), two.answer()) == (1, 2)
    assert len(list(tmp_path.glob("probe_*.py"))) == 2
