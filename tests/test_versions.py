"""A clone that is only on Python's path says so, and loses nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

from bwbn_bayes.versions import version_of

ROOT = Path(__file__).parents[1]


def test_versions_are_those_of_what_is_installed() -> None:
    assert version_of("numpy") == version("numpy")
    assert version_of() == version("bwbn-bayes")
    assert version_of("no-such-package") == "not installed"


def test_a_clone_on_the_path_has_no_version_and_runs(tmp_path: Path) -> None:
    """What was identified is not lost over the version that its provenance tells."""
    hidden = (
        "import importlib.metadata as m, sys\n"
        "whole = m.version\n"
        "def version(name):\n"
        "    if name == 'bwbn-bayes': raise m.PackageNotFoundError(name)\n"
        "    return whole(name)\n"
        "m.version = version\n"
        "from bwbn_bayes.cli import main\n"
        "sys.argv = ['bwbn', '--version']\n"
        "main()\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    run = subprocess.run([sys.executable, "-c", hidden], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert run.stdout.strip() == "bwbn_bayes not installed", run.stderr
