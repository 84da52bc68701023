"""Kernels as functions of Python: compiled when first asked for, or read from the cache.

They run beside each other: Python's own lock is not held meanwhile.
"""

from __future__ import annotations

import ctypes
import hashlib
import struct
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numpy as np

from bwbn_bayes.engines import kernel_compiler, kernel_expressions, kernel_values
from bwbn_bayes.engines.cache_files import read_checked, write_checked
from bwbn_bayes.engines.kept_code import code_path, keep_source
from bwbn_bayes.engines.kernel_compiler import IN_A_ROW, Signature, object_code, signatures, target_machine

_ENGINES: list[llvm.ExecutionEngine] = []
"""They own the code, which is called as long as the process lives."""
_COMPILING = threading.RLock()


@dataclass(frozen=True)
class Kernel:
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
    def run(self) -> Compiled:
        """The march without derivatives."""
        return self.functions("run").run

    @cached_property
    def run_with_tangents(self) -> Compiled:
        """The march with derivatives."""
        return self.functions("run_with_tangents").run_with_tangents

    def functions(self, *entries: str) -> Functions:
        """Functions of the text, compiled together."""
        with _COMPILING:
            engine = _loaded(self._code(entries))
        known = signatures(heads_of(self.source), entries)
        return Functions({entry: Compiled.of(engine, entry, signature) for entry, signature in known.items()})

    def _code(self, entries: tuple[str, ...]) -> bytes:
        path = kernel_path(self.kind, self.source)
        if path is None:
            return object_code(self.source, *entries)
        keep_source(path, self.source.encode())
        place = path.with_name(f"{'.'.join((path.stem, *entries))}.object")
        kept = read_checked(place)
        if kept is None:
            kept = object_code(self.source, *entries)
            write_checked(place, kept)
        return kept


def heads_of(source: str) -> str:
    """A kernel's text with nothing in its functions: reading all of a large law's takes a tenth of a second."""
    kept: list[str] = []
    in_head = in_body = False
    for line in source.splitlines():
        if line and not line[0].isspace():
            in_head, in_body = line.startswith("def "), False
        if not in_body:
            kept.append(line)
        if in_head and line.endswith(":"):
            kept.append("    pass")
            in_head, in_body = False, True
    return "\n".join(kept)


def kernel_path(kind: str, source: str) -> Path | None:
    """Where a kernel's text is kept, beside its machine code; None where nothing is."""
    return code_path(kind, source, _compiler_hash())


@cache
def _compiler_hash() -> str:
    modules = (kernel_compiler, kernel_expressions, kernel_values)
    return hashlib.sha256(b"".join(Path(str(module.__file__)).read_bytes() for module in modules)).hexdigest()


def _loaded(code: bytes) -> llvm.ExecutionEngine:
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), target_machine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _ENGINES.append(engine)
    return engine


@dataclass(frozen=True, kw_only=True)
class Compiled:
    """A function that takes numbers and arrays, which must lie row after row.

    Attributes
    ----------
    signature : Signature
        What it takes and returns.
    words : struct.Struct
        Its arguments as bytes: an array is where it begins and its sizes.
    address : int
        Where the function begins that takes these one by one, for other compiled code.
    in_a_row : int
        Where the one begins that takes where they stand in a row.
    """

    signature: Signature
    words: struct.Struct
    address: int
    in_a_row: int

    @classmethod
    def of(cls, engine: llvm.ExecutionEngine, entry: str, signature: Signature) -> Compiled:
        """A function whose machine code is loaded."""
        return cls(
            signature=signature,
            words=words_of(signature),
            address=engine.get_function_address(entry),
            in_a_row=engine.get_function_address(entry + IN_A_ROW),
        )

    def __call__(self, *arguments: Any) -> Any:
        """Call it; other threads run meanwhile.

        Raises
        ------
        TypeError
            If an array is of another kind or does not lie row after row.
        """
        return self._function(self.words.pack(*self._row(arguments)))

    def given(self, *arguments: Any) -> Callable[..., Any]:
        """The function of the last argument, a number, or of none: for many short calls, at a microsecond each.

        Arrays are looked at once, and other threads wait.
        """
        open_ = [kind for _, kind in self.signature.parameters[len(arguments) :]]
        row = ctypes.create_string_buffer(self.words.pack(*self._row(arguments), *[0] * len(open_)), self.words.size)
        function = ctypes.PYFUNCTYPE(self._returns, ctypes.c_void_p)(self.in_a_row)
        start = ctypes.addressof(row)
        # What is given must live as long as what is returned.
        held = arguments, row
        if not open_:
            return partial(lambda _: function(start), held)
        (kind,) = open_
        last = SCALARS[str(kind)].from_buffer(row, self.words.size - 8)

        def of_last(_: object, argument: float) -> Any:
            last.value = argument
            return function(start)

        return partial(of_last, held)

    @cached_property
    def _function(self) -> Callable[..., Any]:
        return ctypes.CFUNCTYPE(self._returns, ctypes.c_char_p)(self.in_a_row)

    @property
    def _returns(self) -> Any:
        return None if self.signature.returns is None else SCALARS[self.signature.returns]

    def _row(self, arguments: tuple[Any, ...]) -> list[Any]:
        words: list[Any] = []
        for (annotation, kind), argument in zip(self.signature.parameters, arguments, strict=False):
            if isinstance(kind, str):
                words.append(argument)
                continue
            element, n_sizes = kind
            if argument.dtype != _ELEMENTS[element] or argument.ndim != n_sizes or not argument.flags.c_contiguous:
                raise TypeError(f"a kernel takes {annotation} that lie row after row, not {argument.dtype}")
            words.append(argument.__array_interface__["data"][0])
            words += argument.shape
        return words


class Functions:
    """Functions of one kernel, by their names in its text."""

    def __init__(self, functions: Mapping[str, Compiled]) -> None:
        vars(self).update(functions)

    def __getattr__(self, name: str) -> Compiled:
        raise AttributeError(f"{name} is not among the functions that were asked for")


def words_of(signature: Signature, first: int = 0) -> struct.Struct:
    """A function's arguments from the ``first`` on as bytes, eight for each word."""
    kinds = [kind for _, kind in signature.parameters[first:]]
    forms = ["q" * (1 + kind[1]) if isinstance(kind, tuple) else _FORMS[kind] for kind in kinds]
    return struct.Struct("=" + "".join(forms))


SCALARS: dict[str, Any] = {
    "double": ctypes.c_double,
    "float": ctypes.c_float,
    "i64": ctypes.c_int64,
    "i32": ctypes.c_int32,
}
_FORMS = {"double": "d", "float": "f4x", "i64": "q", "i32": "i4x", "i1": "q"}
_ELEMENTS = {"double": np.dtype(np.float64), "float": np.dtype(np.float32), "i64": np.dtype(np.int64)}
