"""PTX for graphics cards of NVIDIA's from the text of a kernel, each thread of which calls one of its functions."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.engines.kernel_compiler import HINTS, Module, Signature, assembled, optimised
from bwbn_bayes.engines.kernel_values import DOUBLE, INT, PRECISIONS, TRUTH, Instructions

ON_THREADS = "on_threads"
OLDEST_CARD = (7, 5)
"""Compute capability that the PTX asks for; a card's own driver makes machine code of it, on any younger one too."""
_QUOTIENT_OF = re.compile(r"= fdiv [a-z ]*double (\S+), (%\S+)")
_QUOTIENT = """
declare double @llvm.nvvm.rcp.approx.ftz.d(double)
declare double @llvm.fma.f64(double, double, double)
define internal double @quotient(double %a, double %b) alwaysinline {
  %minus = fneg double %b
  %one = call double @llvm.nvvm.rcp.approx.ftz.d(double %b)
  %off = call double @llvm.fma.f64(double %minus, double %one, double 1.0)
  %two = call double @llvm.fma.f64(double %one, double %off, double %one)
  %still = call double @llvm.fma.f64(double %minus, double %two, double 1.0)
  %inverse = call double @llvm.fma.f64(double %two, double %still, double %two)
  %about = fmul double %a, %inverse
  %rest = call double @llvm.fma.f64(double %minus, double %about, double %a)
  %found = call double @llvm.fma.f64(double %rest, double %inverse, double %about)
  ret double %found
}"""
"""A quotient by Newton's method from the card's first guess, to the last place. The card's own division asks first
whether its numbers are extreme, and code that branches cannot be worked on beside other code: a solve took 1.7 times as
long. By zero, infinity or what has fewer digits (below 2e-308) it is not a number."""
_FEW = 4
"""Loops of so many turns are written out: what one turn waits for, the next need not. A solve of three storeys then
takes two thirds of the time; the code, and the time that it takes to compile, grow with their number."""


def thread_code(source: str, entry: str, fixed: Mapping[str, int | NDArray[Any]], seldom: Sequence[str] = ()) -> str:
    """PTX for NVIDIA's cards, each thread of which calls a function of a kernel's text with its own number.

    Parameters
    ----------
    source : str
        The text.
    entry : str
        A function that takes the thread's number first, then numbers and arrays as its text annotates them. From
        outside :data:`ON_THREADS` is called, which takes the rest as words of eight bytes, an array as where it begins
        and its sizes; no two arrays may overlap.
    fixed : mapping of str to int or array
        Arguments, and sizes of arrays by ``name.size0`` and so on, that are known beforehand and put into the code;
        they are passed all the same.
    seldom : sequence of str
        Functions that are seldom called. All others are put where they are called, so that what they share may stand in
        registers.
    """
    few = [name for name, known in fixed.items() if isinstance(known, int) and known <= _FEW]
    module = Module.of(source, [entry], few)
    module.from_outside(entry)
    wrapper = [*_on_threads(entry, module.signature(entry), fixed), HINTS]
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple("nvptx64-nvidia-cuda").create_target_machine(
        cpu="sm_{}{}".format(*OLDEST_CARD), opt=3
    )
    code = assembled([*module.texts, *wrapper], machine)
    for function in code.functions:
        if not function.is_declaration and function.name != ON_THREADS:
            function.linkage = "internal"
            function.add_function_attribute("noinline" if function.name in seldom else "alwaysinline")
    # Divisions last: what they take would keep functions from being put where they are called.
    divided = _QUOTIENT_OF.sub(r"= call double @quotient(double \1, double \2)", str(optimised(code, machine)))
    return str(machine.emit_assembly(optimised(assembled([divided, _QUOTIENT], machine), machine)))


def _on_threads(entry: str, signature: Signature, fixed: Mapping[str, int | NDArray[Any]]) -> list[str]:
    """The function that a card calls, and the tables that are known beforehand."""
    parameters, words, tables = list[str](), [f"{INT} %thread"], list[str]()
    for name, (_, kind) in zip(signature.names[1:], signature.parameters[1:], strict=True):
        known = fixed.get(name)
        if isinstance(kind, str):
            type_ = INT if kind == TRUTH else kind
            parameters.append(f"{type_} %{name}")
            words.append(f"{type_} {f'%{name}' if known is None else known}")
            continue
        element, n_sizes = kind
        sizes = [f"{name}.size{axis}" for axis in range(n_sizes)]
        parameters += [f"ptr noalias %{name}", *(f"{INT} %{size}" for size in sizes)]
        if isinstance(known, np.ndarray):
            tables.append(_table(name, element, known))
            words += [f"ptr @{name}", *(f"{INT} {size}" for size in known.shape)]
        else:
            words += [f"ptr %{name}", *(f"{INT} {fixed.get(size, f'%{size}')}" for size in sizes)]
    sreg = "llvm.nvvm.read.ptx.sreg"
    return [
        *(f"declare i32 @{sreg}.{one}.x()" for one in ("ctaid", "ntid", "tid")),
        *tables,
        f"define ptx_kernel void @{ON_THREADS}({', '.join(parameters)}) {{",
        *(f"  %{one} = call i32 @{sreg}.{one}.x()" for one in ("ctaid", "ntid", "tid")),
        "  %first = mul i32 %ctaid, %ntid",
        "  %number = add i32 %first, %tid",
        f"  %thread = zext i32 %number to {INT}",
        f"  call void @{entry}({', '.join(words)})",
        "  ret void",
        "}",
    ]


def _table(name: str, element: str, values: NDArray[Any]) -> str:
    write = Instructions(PRECISIONS[64 if element == DOUBLE else 32]).constant
    numbers = [write(value) for value in values.ravel().tolist()]
    listed = ", ".join(f"{element} {number.text}" for number in numbers)
    return f"@{name} = internal constant [{len(numbers)} x {element}] [{listed}]"
