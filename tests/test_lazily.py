"""Public names come from their homes on first use, and none is forgotten."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest


@pytest.mark.parametrize("package", ["bwbn_bayes", "bwbn_bayes.records"])
def test_every_public_name_has_a_home(package: str) -> None:
    module = importlib.import_module(package)
    assert all(getattr(module, name) is not None for name in module.__all__)
    with pytest.raises(AttributeError, match="no public name 'misspelt'"):
        _ = module.misspelt


def test_import_star_needs_no_extra() -> None:
    """It would have loaded PyMC, or failed where that is not installed."""
    code = "import sys; sys.modules['pymc'] = None; from bwbn_bayes import *; print(el_centro().n_times, len(dir()))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout.startswith("5372 ")


def test_importing_the_package_loads_no_library() -> None:
    code = "import sys, bwbn_bayes; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert not {"numpy", "sympy", "numba", "scipy", "xarray"} & set(done.stdout.split())
