"""Lane kernels as functions of Python: compiled when first asked for, or read from the cache.

They run beside each other: Python's own lock is not held meanwhile.
"""

from __future__ import annotations

import ctypes
import hashlib
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numpy as np

from bwbn_bayes.engines import lane_compiler, lane_expressions, lane_values
from bwbn_bayes.engines.cache_files import read_checked, write_checked
from bwbn_bayes.engines.kept_code import code_path, keep_source
from bwbn_bayes.engines.lane_compiler import Kind, entry_parameters, object_code, target_machine

_ENGINES: list[llvm.ExecutionEngine] = []
"""They own the code, which is called as long as the process lives."""
_COMPILING = threading.RLock()


@dataclass(frozen=True)
class LaneKernel:
    """The functions of one kernel's text that are called from outside.

    Parameters
    ----------
    kind : str
        First part of its files' names.
    source : str
        The text.
    """

    kind: str
    source: str

    @cached_property
    def run(self) -> Callable[..., None]:
        """The march without derivatives."""
        return self.function("run")

    @cached_property
    def run_with_tangents(self) -> Callable[..., None]:
        """The march with derivatives."""
        return self.function("run_with_tangents")

    def function(self, entry: str) -> Callable[..., None]:
        """A function of the text; its arrays must lie row after row."""
        with _COMPILING:
            address = _address(entry, self._code(entry))
        return _called(address, entry_parameters(self.source, entry))

    def _code(self, entry: str) -> bytes:
        path = kernel_path(self.kind, self.source)
        if path is None:
            return object_code(self.source, entry)
        keep_source(path, self.source.encode())
        place = path.with_name(f"{path.stem}.{entry}.object")
        kept = read_checked(place)
        if kept is None:
            kept = object_code(self.source, entry)
            write_checked(place, kept)
        return kept


def kernel_path(kind: str, source: str) -> Path | None:
    """Where a kernel's text is kept, beside its machine code; None where nothing is."""
    return code_path(kind, source, _compiler_hash())


@cache
def _compiler_hash() -> str:
    modules = (lane_compiler, lane_expressions, lane_values)
    return hashlib.sha256(b"".join(Path(str(module.__file__)).read_bytes() for module in modules)).hexdigest()


def _address(entry: str, code: bytes) -> int:
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), target_machine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _ENGINES.append(engine)
    return int(engine.get_function_address(entry))


def _called(address: int, parameters: tuple[tuple[str, Kind], ...]) -> Callable[..., None]:
    """A function that takes numbers and arrays, each array as where it begins and its sizes."""
    words: list[Any] = []
    for _, kind in parameters:
        if isinstance(kind, tuple):
            words += [ctypes.c_void_p, *[ctypes.c_int64] * kind[1]]
        else:
            words.append(_SCALARS.get(kind, ctypes.c_int64))
    function = ctypes.CFUNCTYPE(None, *words)(address)
    elements = [_ELEMENTS[kind[0]] if isinstance(kind, tuple) else None for _, kind in parameters]

    def call(*arguments: Any) -> None:
        given: list[Any] = []
        for (word, _), element, argument in zip(parameters, elements, arguments, strict=True):
            if element is None:
                given.append(argument)
                continue
            if argument.dtype != element or not argument.flags.c_contiguous:
                raise TypeError(f"a kernel takes {word} that lie row after row, not {argument.dtype}")
            given.append(argument.__array_interface__["data"][0])
            given += argument.shape
        function(*given)

    return call


_SCALARS = {"double": ctypes.c_double, "float": ctypes.c_float}
_ELEMENTS = {"double": np.dtype(np.float64), "float": np.dtype(np.float32), "i64": np.dtype(np.int64)}
