"""From the symbolic storey law to lines of code that numba compiles.

The printer knows the handful of functions a law may use. Powers with a symbolic exponent become
``_exp2(n * _log2(x))``, base two because its scaling by ``1 / log(2)`` joins the constants of the argument; ``sign`` is
differentiated as zero and ``Abs`` as ``sign``, that is almost everywhere. What changes at events alone is hoisted out
of the time loop.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import sympy as sp
from sympy.codegen.cfunctions import exp2, log2
from sympy.printing.pycode import PythonCodePrinter

from bwbn_bayes.elements.law import DRIFT, DRIFT_RATE, Event, SharpFeature, StoreyLaw
from bwbn_bayes.errors import UserError


class _NumbaPrinter(PythonCodePrinter):
    """Prints expressions as numba source free of branches and library calls."""

    def _print_sign(self, expr: sp.Expr) -> str:
        argument = self._print(expr.args[0])
        return f"(1.0 if {argument} > 0.0 else (-1.0 if {argument} < 0.0 else 0.0))"

    def _print_Abs(self, expr: sp.Expr) -> str:
        # The tiny offset keeps |x|^n / |x| finite at x = 0; anywhere else it is absorbed by rounding.
        return f"(abs({self._print(expr.args[0])}) + 1e-300)"

    def _print_exp2(self, expr: sp.Expr) -> str:
        return f"_exp2({self._print(expr.args[0])})"

    def _print_log2(self, expr: sp.Expr) -> str:
        return f"_log2({self._print(expr.args[0])})"

    def _print_log(self, expr: sp.Expr) -> str:
        return repr(float(expr))

    def _print_Max(self, expr: sp.Expr) -> str:
        first, *rest = (f"({self._print(argument)})" for argument in expr.args)
        for other in rest:
            first = f"({first} if {first} > {other} else {other})"
        return first

    def _print_Heaviside(self, expr: sp.Expr) -> str:
        return f"(1.0 if {self._print(expr.args[0])} > 0.0 else 0.0)"

    def _print_Rational(self, expr: sp.Rational) -> str:
        return repr(float(expr))

    _print_Integer = _print_Rational
    _print_Half = _print_Rational
    _print_NumberSymbol = _print_Rational

    def _print_Pow(self, expr: sp.Expr, rational: bool = False) -> str:
        if expr.is_number:
            return repr(float(expr))
        base, exponent = expr.args
        if exponent.is_Integer:
            power = f"({self._print(base)})"
            product = " * ".join([power] * abs(int(exponent)))
            return f"({product})" if exponent > 0 else f"(1.0 / ({product}))"
        return self.emptyPrinter(expr)

    def emptyPrinter(self, expr: object) -> str:
        raise UserError(
            f"a storey law uses {expr!r}, which the code generator cannot print: "
            "use exp, log, tanh, Abs, sign, Max or powers"
        )


def print_expression(expression: sp.Expr) -> str:
    """Numba source of one expression."""
    return str(_NumbaPrinter().doprint(expression))


def _base_two(expression: sp.Expr) -> sp.Expr:
    """The same expression with exponentials, logarithms and powers of symbolic exponent in base two."""
    if not expression.args or expression.is_number:
        return expression
    arguments = [_base_two(argument) for argument in expression.args]
    if isinstance(expression, sp.exp):
        return exp2(arguments[0] / sp.log(2))
    if isinstance(expression, sp.log):
        return log2(arguments[0]) * sp.log(2)
    if isinstance(expression, sp.tanh):
        return 1 - 2 / (exp2(2 * arguments[0] / sp.log(2)) + 1)
    if expression.is_Pow and not expression.exp.is_Integer:
        return exp2(arguments[1] * log2(arguments[0]))
    return expression.func(*arguments)


def derivative(expression: sp.Expr, variable: sp.Symbol) -> sp.Expr:
    """Derivative almost everywhere: ``sign`` and ``Heaviside`` have derivative zero, ``Abs`` has ``sign``.

    ``|x|^n`` is written through a stand-in for ``|x|``, so that SymPy never forms ``DiracDelta`` or ``0/0``.
    """
    magnitudes = {a: sp.Dummy(f"abs{i}", positive=True) for i, a in enumerate(expression.atoms(sp.Abs))}
    steps = {
        s: sp.Dummy(f"step{i}", real=True)
        for i, s in enumerate(expression.atoms(sp.sign) | expression.atoms(sp.Heaviside))
    }
    opaque = expression.subs(magnitudes).subs(steps)
    result = sp.diff(opaque, variable)
    for magnitude, dummy in magnitudes.items():
        inner = magnitude.args[0]
        result += sp.diff(opaque, dummy) * sp.sign(inner) * sp.diff(inner, variable)
    return result.subs({dummy: s for s, dummy in steps.items()}).subs({dummy: a for a, dummy in magnitudes.items()})


@dataclass(frozen=True, kw_only=True)
class Program:
    """A law as straight-line code.

    ``hoisted`` are (name, source) lines that change at events alone; ``lines`` the rest; ``outputs`` the source of each
    output in the order asked for.
    """

    hoisted: tuple[tuple[str, str], ...]
    lines: tuple[tuple[str, str], ...]
    outputs: tuple[str, ...]


def compile_expressions(expressions: Sequence[sp.Expr], constants: frozenset[sp.Symbol]) -> Program:
    """Share common subexpressions and hoist what depends on ``constants`` alone.

    Parameters
    ----------
    expressions : sequence of SymPy expressions
        The outputs.
    constants : frozenset of SymPy symbols
        Symbols that do not change during a solve.
    """
    hoisted: dict[sp.Expr, sp.Symbol] = {}
    lifted = [_lift(_base_two(expression), constants, hoisted) for expression in expressions]
    shared, reduced = sp.cse(lifted, symbols=sp.numbered_symbols("x"), optimizations=[])
    return Program(
        hoisted=tuple((str(s), print_expression(e)) for e, s in hoisted.items()),
        lines=tuple((str(s), print_expression(e)) for s, e in shared),
        outputs=tuple(print_expression(e) for e in reduced),
    )


def _lift(expression: sp.Expr, constants: frozenset[sp.Symbol], hoisted: dict[sp.Expr, sp.Symbol]) -> sp.Expr:
    """Replace every maximal constant subexpression by a symbol recorded in ``hoisted``."""
    free = expression.free_symbols
    if not free or expression.is_Symbol:
        return expression
    if free <= constants:
        return hoisted.setdefault(expression, sp.Symbol(f"h{len(hoisted)}", real=True))
    arguments = list(expression.args)
    if isinstance(expression, (sp.Mul, sp.Add)):
        fixed = [a for a in arguments if a.free_symbols <= constants]
        moving = [a for a in arguments if not a.free_symbols <= constants]
        arguments = [_lift(a, constants, hoisted) for a in moving]
        if fixed:
            arguments.append(_lift(expression.func(*fixed), constants, hoisted))
        return expression.func(*arguments)
    return expression.func(*(_lift(a, constants, hoisted) for a in arguments))


@dataclass(frozen=True, kw_only=True)
class LawPrograms:
    """The programs of one storey law.

    ``rates`` computes the force and the rates of the states; ``tangent`` computes the same and then, row by row, their
    partial derivatives with respect to ``variables`` (drift, drift rate, states, then parameters).
    """

    rates: Program
    tangent: Program
    variables: tuple[sp.Symbol, ...]
    partials: tuple[tuple[int, int], ...]
    """(output, variable) of each nonzero partial, in the order of ``tangent.outputs`` after the outputs themselves."""


def spelled(law: StoreyLaw) -> StoreyLaw:
    """The same law with names that no variable of a kernel has: parameters are written ``p_`` and so on."""
    old = (*law.states, *law.symbols, *(event.indicator for event in law.events))
    new = {s: sp.Symbol(f"{s.name}_", **s.assumptions0) for s in old}
    return replace(
        law,
        parameters=tuple(replace(p, symbol=f"{p.symbol}_") for p in law.parameters),
        states=tuple(new[s] for s in law.states),
        force=law.force.xreplace(new),
        rates=tuple(rate.xreplace(new) for rate in law.rates),
        events=tuple(Event(time=new[e.time], indicator=new[e.indicator]) for e in law.events),
        sharp_features=tuple(
            SharpFeature(state=new.get(f.state, f.state), width=f.width.xreplace(new)) for f in law.sharp_features
        ),
    )


def law_programs(law: StoreyLaw) -> LawPrograms:
    """Generate the programs of a storey law and of its derivatives."""
    outputs = (law.force, *law.rates)
    variables = (DRIFT, DRIFT_RATE, *law.states, *law.symbols)
    constants = frozenset(law.symbols) | {event.indicator for event in law.events}
    partials: list[tuple[int, int]] = []
    expressions: list[sp.Expr] = []
    for row, output in enumerate(outputs):
        for column, variable in enumerate(variables):
            slope = derivative(output, variable)
            if slope != 0:
                partials.append((row, column))
                expressions.append(slope)
    return LawPrograms(
        rates=compile_expressions(outputs, constants),
        tangent=compile_expressions((*outputs, *expressions), constants),
        variables=variables,
        partials=tuple(partials),
    )
