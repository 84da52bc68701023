"""Generated kernels on disk: one module per hash of everything that shapes its machine code."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import pickle
import platform
import sys
import threading
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType

import llvmlite
import llvmlite.binding
import numba


@cache
def load_kernel(kind: str, source: str) -> ModuleType:
    """Import generated source, which numba compiles once and keeps beside it.

    Parameters
    ----------
    kind : str
        First part of the module's name, e.g. ``scalar``.
    source : str
        Numba source. The file is named by a hash of it, of the processor and of the versions of Python, numba and
        llvmlite: changed source is another file, and a second process reuses the first one's.
    """
    path = kernel_path(kind, source)
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_suffix(f".{os.getpid()}.{threading.get_ident()}.tmp")
        temporary.write_text(source)
        temporary.replace(path)
    name = f"bwbn_bayes_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"cannot load the generated kernel {path}")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def kernel_path(kind: str, source: str) -> Path:
    """Where the module of generated source is kept."""
    features = llvmlite.binding.get_host_cpu_name() + llvmlite.binding.get_host_cpu_features().flatten()
    shaped_by = (source, features, numba.__version__, llvmlite.__version__, platform.python_version())
    key = hashlib.sha256("\n".join(shaped_by).encode()).hexdigest()[:20]
    return cache_directory() / f"{kind}_{key}.py"


def remembered[Made](kind: str, key: str, make: Callable[[], Made]) -> Made:
    """What ``make`` made when it was last asked under this key, in this or another process; made now if never.

    Parameters
    ----------
    kind : str
        First part of the file's name.
    key : str
        Everything that shapes the result; a hash of it names the file.
    make : callable
        Its result must be picklable.
    """
    path = cache_directory() / f"{kind}_{hashlib.sha256(key.encode()).hexdigest()[:20]}.pickle"
    if path.exists():
        made: Made = pickle.loads(path.read_bytes())
        return made
    made = make()
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_suffix(f".{os.getpid()}.{threading.get_ident()}.tmp")
    temporary.write_bytes(pickle.dumps(made))
    temporary.replace(path)
    return made


def cache_directory() -> Path:
    """Where generated kernels are kept: ``$BWBN_CACHE_DIR``, or ``bwbn_bayes`` in the user's cache directory."""
    own = os.environ.get("BWBN_CACHE_DIR")
    if own:
        return Path(own)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "bwbn_bayes"
