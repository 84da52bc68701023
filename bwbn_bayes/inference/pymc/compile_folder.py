"""Where PyTensor keeps what it compiles: it fails to load where the home directory cannot be written."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

from bwbn_bayes.engines.cache_files import cache_directory
from bwbn_bayes.errors import UserError


def provide_compile_folder() -> None:
    """Before PyTensor is loaded: name a folder beside this package's kernels where its own cannot be written.

    Raises
    ------
    UserError
        If no folder can be written.
    """
    flags = os.environ.get("PYTENSOR_FLAGS", "")
    if "pytensor" in sys.modules or "compiledir" in flags or "PYTENSORRC" in os.environ or _is_writable():
        return
    folder = cache_directory()
    if folder is None:
        raise UserError("PyTensor has no folder to compile in: set HOME or TMPDIR to one that can be written")
    os.environ["PYTENSOR_FLAGS"] = ",".join(filter(None, (flags, f"base_compiledir={folder / 'pytensor'}")))


def _is_writable() -> bool:
    """Whether PyTensor can keep files in its usual place."""
    try:
        usual = Path.home() / ".pytensor"
        usual.mkdir(exist_ok=True)
        with tempfile.TemporaryFile(dir=usual) as probe:
            probe.write(bytes(4096))
    except (OSError, RuntimeError):  # the latter where there is no home
        return False
    return True
