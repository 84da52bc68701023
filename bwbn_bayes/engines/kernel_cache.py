"""Generated kernels that numba compiles: one module per hash of everything that shapes its machine code.

Source is executed from memory, as it was generated; the file on disk is for people to read. Machine code lies beside
it, one file for each function and its argument types, and is checked before it is read.
"""

from __future__ import annotations

import hashlib
import linecache
import pickle
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import numba
from numba.core.caching import NullCache
from numba.core.ccallback import CFunc
from numba.core.compiler import CompileResult
from numba.core.sigutils import normalize_signature

from bwbn_bayes.engines.cache_files import read_checked, write_checked
from bwbn_bayes.engines.kept_code import code_name, code_path, keep_source


@cache
def load_kernel(kind: str, source: str, beneath: ModuleType | None = None) -> ModuleType:
    """Execute generated source, whose functions numba compiles once and keeps.

    Parameters
    ----------
    kind : str
        First part of the module's name, e.g. ``scalar``.
    source : str
        Numba source that takes :func:`njit` and :func:`cfunc` from this module. Its files are named by a hash of it,
        of the processor and of the versions of Python, numba and llvmlite: changed source has other files, and a second
        process reuses the first one's.
    beneath : module, optional
        Another kernel, whose functions the source calls; what of it is compiled already is not compiled again.
    """
    shaped_by = (numba.__version__, *([] if beneath is None else [beneath.__name__]))
    path = code_path(kind, source, *shaped_by)
    if path is not None:
        keep_source(path, source.encode())
    module = ModuleType(f"bwbn_bayes_{code_name(kind, source, *shaped_by)}")
    if beneath is not None:
        module.__dict__.update({name: it for name, it in vars(beneath).items() if not name.startswith("__")})
    module.__file__ = f"<{module.__name__}>" if path is None else str(path)
    # Tracebacks show what runs, not what a file may have become.
    linecache.cache[module.__file__] = (len(source), None, source.splitlines(keepends=True), module.__file__)
    sys.modules[module.__name__] = module
    exec(compile(source, module.__file__, "exec"), module.__dict__)
    return module


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
