"""Functions of a kernel that only its other functions call: linked into those, never compiled by themselves.

numba makes machine code of every function, and wrappers to call it from Python; for a part that takes a fifth of the
time. Worse, a caller's own copy of the part, which is tuned to its place, gives way to the one that was compiled by
itself where that came first: derivatives of a kernel compiled in this process differed in their last bits from those of
the same kernel read from the cache, the first run from the second.
"""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import Any

import numba
from numba.core import compiler, types
from numba.core.codegen import JITCodeLibrary
from numba.core.dispatcher import _FunctionCompiler  # type: ignore[attr-defined]


def part(**options: Any) -> Callable[[FunctionType], Any]:
    """``numba.njit`` for a function of generated source that is called from compiled code alone."""

    def decorate(function: FunctionType) -> Any:
        dispatcher = numba.njit(**options)(function)
        dispatcher._compiler = _PartCompiler(
            function, dispatcher.targetdescr, dispatcher.targetoptions, dispatcher.locals, compiler.Compiler
        )
        # Not known to the table from which calls from Python are served: there is nothing to call.
        dispatcher.add_overload = lambda made: dispatcher.overloads.__setitem__(tuple(made.signature.args), made)
        return dispatcher

    return decorate


class _PartLibrary(JITCodeLibrary):
    """Code that others link, optimised as numba optimises it; the execution engine does not get it."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True


class _PartCompiler(_FunctionCompiler):
    def fold_argument_types(self, args: Any, kws: Any) -> Any:
        """Arguments without their values: a part called with 0 and with 1 would be compiled for each."""
        signature, folded = super().fold_argument_types(args, kws)
        return signature, tuple(types.unliteral(argument) for argument in folded)

    def _compile_core(self, args: Any, return_type: Any) -> Any:
        description = self.targetdescr
        flags = compiler.Flags()
        description.options.parse_as_flags(flags, self.targetoptions)
        flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        made = compiler.compile_extra(
            description.typing_context,
            description.target_context,
            self.py_func,
            args=args,
            return_type=return_type,
            flags=flags,
            locals=self.locals,
            library=_PartLibrary(description.target_context.codegen(), self.py_func.__qualname__),
            pipeline_class=self.pipeline_class,
        )
        # Callers find it by its entry point, of which a part has none: any object of its own will do.
        made = made._replace(entry_point=object())
        description.target_context.insert_user_function(made.entry_point, made.fndesc, [made.library])
        return made
