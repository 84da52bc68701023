"""Run a written script as a user would, in a process of its own, and read the histories that it leaves."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np

from bwbn_bayes.export import Script
from bwbn_bayes.records.readers import read_record

Histories = dict[str, np.ndarray]


def run_script(path: Path, *arguments: object) -> Histories:
    """Channels of the CSV that the script writes beside itself."""
    done = subprocess.run(
        [sys.executable, str(path), *map(str, arguments)], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "WARNING" not in done.stderr, done.stderr
    return {name: np.array(values) for name, values in read_record(path.with_suffix(".csv")).channels.items()}


def in_the_limit(script: Script, directory: Path, substeps: int) -> tuple[Histories, Histories, Histories]:
    """Histories with so many substeps, with twice as many, and extrapolated to a step of zero at first order."""
    path = directory / "written.py"
    path.write_text(script.text, encoding="utf-8")
    coarse, fine = run_script(path, substeps), run_script(path, 2 * substeps)
    return coarse, fine, {name: 2.0 * fine[name] - coarse[name] for name in fine}


def error(found: Histories, truth: Histories) -> float:
    """The largest over the channels: rms of the difference over rms of the truth."""
    return max(float(np.sqrt(np.mean((found[name] - truth[name]) ** 2) / np.mean(truth[name] ** 2))) for name in truth)
