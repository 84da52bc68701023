"""Generated kernels on disk: one module per hash of everything that shapes its machine code.

Source is executed from memory, as it was generated; the file on disk is for people to read. Machine code lies beside
it, one file for each function and its argument types, and is checked before it is read.
"""

from __future__ import annotations

import hashlib
import json
import linecache
import pickle
import platform
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import llvmlite
import llvmlite.binding
import numba
from numba.core.caching import NullCache
from numba.core.ccallback import CFunc
from numba.core.compiler import CompileResult
from numba.core.sigutils import normalize_signature

from bwbn_bayes.engines.cache_files import cache_directory, discard, read_checked, read_own, write_checked, write_whole


@cache
def load_kernel(kind: str, source: str) -> ModuleType:
    """Execute generated source, whose functions numba compiles once and keeps.

    Parameters
    ----------
    kind : str
        First part of the module's name, e.g. ``scalar``.
    source : str
        Numba source that takes :func:`njit` and :func:`cfunc` from this module. Its files are named by a hash of it,
        of the processor and of the versions of Python, numba and llvmlite: changed source has other files, and a second
        process reuses the first one's.
    """
    path = kernel_path(kind, source)
    if path is not None:
        _keep_source(path, source.encode())
    module = ModuleType(f"bwbn_bayes_{_stem(kind, source)}")
    module.__file__ = f"<{module.__name__}>" if path is None else str(path)
    # Tracebacks show what runs, not what a file may have become.
    linecache.cache[module.__file__] = (len(source), None, source.splitlines(keepends=True), module.__file__)
    sys.modules[module.__name__] = module
    exec(compile(source, module.__file__, "exec"), module.__dict__)
    return module


def kernel_path(kind: str, source: str) -> Path | None:
    """Where generated source is kept; None where nothing is."""
    directory = cache_directory()
    return None if directory is None else directory / f"{_stem(kind, source)}.py"


def remembered(kind: str, key: str, make: Callable[[], Any]) -> Any:
    """What ``make`` made when it was last asked under this key, in this or another process; made now if never.

    Parameters
    ----------
    kind : str
        First part of the file's name.
    key : str
        Everything that shapes the result; a hash of it names the file.
    make : callable
        Its result must be plain data: numbers, text, and lists and mappings of them.
    """
    path = _kept_path(kind, key)
    if path is None:
        return make()
    kept = read_checked(path)
    if kept is not None:
        return json.loads(kept)
    made = make()
    write_checked(path, json.dumps(made).encode())
    return made


def is_remembered(kind: str, key: str) -> bool:
    """Whether :func:`remembered` would find what was made under a key."""
    path = _kept_path(kind, key)
    return path is not None and path.exists()


def _kept_path(kind: str, key: str) -> Path | None:
    directory = cache_directory()
    return None if directory is None else directory / f"{kind}_{hashlib.sha256(key.encode()).hexdigest()[:20]}.kept"


def njit(**options: Any) -> Callable[[FunctionType], Any]:
    """``numba.njit`` for generated source: what it compiles is kept beside the source."""

    def decorate(function: FunctionType) -> Any:
        dispatcher = numba.njit(**options)(function)
        dispatcher._cache = _cache_of(function)
        return dispatcher

    return decorate


def cfunc(signature: Any, **options: Any) -> Callable[[FunctionType], Any]:
    """``numba.cfunc`` for generated source: what it compiles is kept beside the source."""

    def decorate(function: FunctionType) -> Any:
        callback: Any = CFunc(function, normalize_signature(signature), locals={}, options=options)
        callback._cache = _cache_of(function)
        callback.compile()
        return callback

    return decorate


class _CheckedCache(NullCache):
    """numba's cache of one function's machine code.

    Unlike numba's own it has no index that two processes could write at once, and reads nothing that was damaged.
    """

    def __init__(self, function: FunctionType) -> None:
        code = function.__code__
        source = Path(code.co_filename)
        self._place = source.parent / "__pycache__"
        self._name = f"{source.stem}.{function.__qualname__}-{code.co_firstlineno}"

    @property
    def cache_path(self) -> str:
        return str(self._place)

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        target_context.refresh()
        kept = read_checked(self._path(signature, target_context.codegen()))
        return None if kept is None else CompileResult._rebuild(target_context, *pickle.loads(kept))

    def save_overload(self, signature: Any, compiled: Any) -> None:
        write_checked(self._path(signature, compiled.codegen), numba.core.serialize.dumps(compiled._reduce()))

    def _path(self, signature: Any, codegen: Any) -> Path:
        key = hashlib.sha256(repr((signature, codegen.magic_tuple())).encode()).hexdigest()[:20]
        return self._place / f"{self._name}.{key}.nbc"


def _cache_of(function: FunctionType) -> NullCache:
    kept = not function.__code__.co_filename.startswith("<")
    return _CheckedCache(function) if kept else NullCache()


def _keep_source(path: Path, source: bytes) -> None:
    kept = read_own(path)
    if kept != source:
        if kept is not None:
            discard(path, "it is not what was generated")
        write_whole(path, source)


def _stem(kind: str, source: str) -> str:
    features = llvmlite.binding.get_host_cpu_name() + llvmlite.binding.get_host_cpu_features().flatten()
    shaped_by = (source, features, numba.__version__, llvmlite.__version__, platform.python_version())
    return f"{kind}_{hashlib.sha256('\n'.join(shaped_by).encode()).hexdigest()[:20]}"
