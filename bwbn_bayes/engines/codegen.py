"""From the symbolic storey law to lines of code that :mod:`~bwbn_bayes.engines.kernel_compiler` compiles.

The printer knows the handful of functions a law may use. Powers with a symbolic exponent become
``_exp2(n * _log2(x))``, base two because its scaling by ``1 / log(2)`` joins the constants of the argument; ``sign`` is
differentiated as zero and ``Abs`` as ``sign``, that is almost everywhere. What changes at events alone is hoisted out
of the time loop.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import sympy as sp
from sympy.codegen.cfunctions import exp2, log2
from sympy.printing.pycode import PythonCodePrinter

from bwbn_bayes.elements.law import (
    BENDING_DRIFT,
    DRIFT,
    DRIFT_RATE,
    FIRST_FORCE,
    MASS,
    NET_FORCE,
    RECORDED_ACCELERATION,
    BaseLaw,
    Event,
    StoreyLaw,
)
from bwbn_bayes.errors import UserError

OFFSET = "1e-300"
"""What is added to magnitudes, and to what must not be zero, as it is printed."""


class _KernelPrinter(PythonCodePrinter):
    """Prints expressions as kernel text free of branches and library calls."""

    def _print_sign(self, expr: sp.Expr) -> str:
        argument = self._print(expr.args[0])
        return f"(1.0 if {argument} > 0.0 else (-1.0 if {argument} < 0.0 else 0.0))"

    def _print_Abs(self, expr: sp.Expr) -> str:
        # The tiny offset keeps |x|^n / |x| finite at x = 0; anywhere else it is absorbed by rounding.
        return f"(abs({self._print(expr.args[0])}) + {OFFSET})"

    def _print_off_zero(self, expr: sp.Expr) -> str:
        return f"({self._print(expr.args[0])} + {OFFSET})"

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
    _print_Pi = _print_Rational
    _print_Exp1 = _print_Rational

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
    """Kernel text of one expression."""
    return str(_KernelPrinter().doprint(expression))


def _base_two(expression: sp.Expr, done: dict[sp.Expr, sp.Expr]) -> sp.Expr:
    """The same expression with exponentials, logarithms and powers of symbolic exponent in base two.

    Derivatives hold the same parts again and again: what is ``done`` is not done twice.
    """
    if not expression.args or expression.is_number:
        return expression
    if expression not in done:
        done[expression] = _in_base_two(expression, [_base_two(argument, done) for argument in expression.args])
    return done[expression]


def _in_base_two(expression: sp.Expr, arguments: list[sp.Expr]) -> sp.Expr:
    if isinstance(expression, sp.exp):
        return exp2(arguments[0] / sp.log(2))
    if isinstance(expression, sp.log):
        return log2(arguments[0]) * sp.log(2)
    if isinstance(expression, sp.tanh):
        return 1 - 2 / (exp2(2 * arguments[0] / sp.log(2)) + 1)
    if expression.is_Pow and not expression.exp.is_Integer:
        return exp2(arguments[1] * log2(arguments[0]))
    return _of(expression, arguments)


def _of(expression: sp.Expr, arguments: list[sp.Expr]) -> sp.Expr:
    """The same operation on other arguments; on the same it is not built again, which asks much of ``Max``."""
    same = all(one is other for one, other in zip(arguments, expression.args, strict=True))
    return expression if same else expression.func(*arguments)


def derivatives(expression: sp.Expr, variables: Sequence[sp.Symbol]) -> list[sp.Expr]:
    """Derivatives almost everywhere: ``sign`` and ``Heaviside`` have derivative zero, ``Abs`` has ``sign``.

    ``|x|^n`` is written through a stand-in for ``|x|``, so that SymPy never forms ``DiracDelta`` or ``0/0``.
    """
    magnitudes = {a: sp.Dummy(f"abs{i}", positive=True) for i, a in enumerate(expression.atoms(sp.Abs))}
    steps = {
        s: sp.Dummy(f"step{i}", real=True)
        for i, s in enumerate(expression.atoms(sp.sign) | expression.atoms(sp.Heaviside))
    }
    # Nodes are put in the place of nodes as they are: `subs`, which looks for more, took half of a law's time.
    opaque = expression.xreplace(magnitudes).xreplace(steps)
    original = {dummy: s for s, dummy in steps.items()} | {dummy: a for a, dummy in magnitudes.items()}
    outer = {a.args[0]: sp.diff(opaque, dummy) * sp.sign(a.args[0]) for a, dummy in magnitudes.items()}
    found = []
    for variable in variables:
        result = sp.diff(opaque, variable)
        for inner, slope in outer.items():
            result += slope * sp.diff(inner, variable)
        found.append(result.xreplace(original))
    return found


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
    lift, done = _Lift(constants), dict[sp.Expr, sp.Expr]()
    lifted = [lift(_base_two(expression, done)) for expression in expressions]
    shared, reduced = sp.cse(lifted, symbols=sp.numbered_symbols("x"), optimizations=[])
    return Program(
        hoisted=tuple((str(s), print_expression(e)) for e, s in lift.hoisted.items()),
        lines=tuple((str(s), print_expression(e)) for s, e in shared),
        outputs=tuple(print_expression(e) for e in reduced),
    )


class _Lift:
    """Replaces every maximal constant subexpression by a symbol, recorded in ``hoisted``."""

    def __init__(self, constants: frozenset[sp.Symbol]) -> None:
        self.hoisted: dict[sp.Expr, sp.Symbol] = {}
        self._constants = constants
        self._done: dict[sp.Expr, sp.Expr] = {}
        self._symbols: dict[sp.Expr, frozenset[sp.Symbol]] = {}

    def __call__(self, expression: sp.Expr) -> sp.Expr:
        if expression not in self._done:
            self._done[expression] = self._lifted(expression)
        return self._done[expression]

    def _lifted(self, expression: sp.Expr) -> sp.Expr:
        if expression.is_Symbol or not self._free(expression):
            return expression
        if self._is_constant(expression):
            return self.hoisted.setdefault(expression, sp.Symbol(f"h{len(self.hoisted)}", real=True))
        if not isinstance(expression, (sp.Mul, sp.Add)):
            return _of(expression, [self(argument) for argument in expression.args])
        fixed = [one for one in expression.args if self._is_constant(one)]
        arguments = [self(one) for one in expression.args if not self._is_constant(one)]
        if fixed:
            arguments.append(self(expression.func(*fixed)))
        return expression.func(*arguments)

    def _is_constant(self, expression: sp.Expr) -> bool:
        return self._free(expression) <= self._constants

    def _free(self, expression: sp.Expr) -> frozenset[sp.Symbol]:
        """Symbols of an expression; SymPy gathers them anew from all its parts whenever it is asked."""
        if expression not in self._symbols:
            own = {expression} if expression.is_Symbol else set()
            self._symbols[expression] = frozenset(own).union(*map(self._free, expression.args))
        return self._symbols[expression]


INVERSE_MASS = sp.Symbol("inverse_mass__", real=True)
"""One over the mass that the model gives a floor, as kernels keep it. [1/kg]"""

INPUT_NAMES = {
    BENDING_DRIFT: "bending__",
    NET_FORCE: "net_force__",
    RECORDED_ACCELERATION: "recorded__",
}
"""What laws take from around them, as kernels call it; the net force on the base is F_1."""

_INPUTS = {s: sp.Symbol(name, real=True) for s, name in INPUT_NAMES.items()}


@dataclass(frozen=True, kw_only=True)
class Part:
    """Some outputs of a law and their derivatives as code.

    ``rates`` computes the outputs; ``tangent`` computes the same and then their nonzero partial derivatives, which are
    listed by (row, column) in ``partials``. ``rows`` are the outputs' rows in the table of partial derivatives; columns
    count the law's variables. Hoisted values of ``rates`` and ``tangent`` stand at ``first_rates`` and
    ``first_tangent`` among those of the whole law.
    """

    rates: Program
    tangent: Program
    rows: tuple[int, ...]
    partials: tuple[tuple[int, int], ...]
    first_rates: int
    first_tangent: int

    @property
    def end(self) -> int:
        """Where the hoisted values of the next part begin."""
        return self.first_tangent + len(self.tangent.hoisted)

    @property
    def slopes(self) -> tuple[str, ...]:
        """Source of each partial derivative."""
        return self.tangent.outputs[len(self.rows) :]


@dataclass(frozen=True, kw_only=True)
class LawPrograms:
    """A law as code: the storey, its floor, the base under the first storey.

    The storey's outputs are the force (row 0) and the rates of its own states. A floor's are its acceleration (last
    row) and the rates of its states; None where the acceleration is ``F_net / m_i``. The base's are its
    acceleration (row 0 of a table of its own) and the rates of its states, which are its first variables; its other
    variables are numbered as the storey's are. ``bare`` is the storey where nothing acts but its element: the force and
    the rates of two states; None where the law has nothing else.
    """

    storey: Part
    floor: Part | None
    base: Part | None
    bare: Part | None
    variables: tuple[sp.Symbol, ...]
    """Columns: drift, drift rate, states, parameters, then what comes from around: what bends a storey, where it
    matters, and last the net force on a floor or on the base."""

    @property
    def parts(self) -> tuple[Part, ...]:
        """Those there are, of which a structure with anything on every link needs all."""
        return tuple(part for part in (self.storey, self.floor, self.base) if part is not None)

    @property
    def bending(self) -> int | None:
        """Column of the drift that bends a storey, None where no force depends on it."""
        bending = _INPUTS[BENDING_DRIFT]
        return self.variables.index(bending) if bending in self.variables else None

    @property
    def n_hoisted(self) -> int:
        """Number of hoisted values."""
        return self.parts[-1].end

    @property
    def n_rows(self) -> int:
        """Rows of the table of partial derivatives."""
        return 1 + max(row for part in self.parts for row in part.rows)


def spelled(law: StoreyLaw) -> StoreyLaw:
    """The same law with names that no variable of a kernel has: parameters are written ``p_`` and so on."""
    old = (*law.states, *law.base_states, *law.symbols, *(event.indicator for event in law.events))
    new = {s: sp.Symbol(f"{s.name}_", **s.assumptions0) for s in old}
    around: dict[sp.Expr, sp.Expr] = {**new, **_INPUTS, FIRST_FORCE: _INPUTS[NET_FORCE], MASS: 1 / INVERSE_MASS}
    return replace(
        law,
        parameters=tuple(replace(p, symbol=f"{p.symbol}_") for p in law.parameters),
        states=tuple(new[s] for s in law.states),
        force=law.force.xreplace(around),
        rates=tuple(rate.xreplace(around) for rate in law.rates),
        events=tuple(Event(time=new[e.time], indicator=new[e.indicator]) for e in law.events),
        sharp_features=tuple(
            replace(f, state=new.get(f.state, f.state), width=_base_two(f.width.xreplace(new), {}))
            for f in law.sharp_features
        ),
        acceleration=None if law.acceleration is None else law.acceleration.xreplace(around),
        base=None
        if law.base is None
        else BaseLaw(
            states=tuple(new[s] for s in law.base.states),
            rates=tuple(rate.xreplace(around) for rate in law.base.rates),
            acceleration=law.base.acceleration.xreplace(around),
        ),
    )


def law_programs(law: StoreyLaw) -> LawPrograms:
    """Generate the programs of a law that :func:`spelled` has named, and of its derivatives."""
    own, variables = (DRIFT, DRIFT_RATE, *law.states), _variables(law)
    constants = frozenset({*law.symbols, INVERSE_MASS, *(event.indicator for event in law.events)})
    n = law.n_storey_states
    storey = _part((law.force, *law.rates[:n]), tuple(range(1 + n)), variables, constants, 0)
    floor = base = None
    if law.acceleration is not None:
        last = 1 + len(law.states)
        outputs = (law.acceleration, *law.rates[n:])
        floor = _part(outputs, (last, *range(1 + n, last)), variables, constants, storey.end)
    if law.base is not None:
        base_outputs = (law.base.acceleration, *law.base.rates)
        columns = (*law.base.states, *own[len(law.base.states) :], *variables[len(own) :])
        first = (floor or storey).end
        base = _part(base_outputs, tuple(range(len(base_outputs))), columns, constants, first)
    last_part = base or floor or storey
    bare = None if law.bare is None else _part(law.bare, (0, 1, 2), variables, constants, last_part.end)
    return LawPrograms(storey=storey, floor=floor, base=base, bare=bare, variables=variables)


def _variables(law: StoreyLaw) -> tuple[sp.Symbol, ...]:
    bending = (_INPUTS[BENDING_DRIFT],) if _INPUTS[BENDING_DRIFT] in law.force.free_symbols else ()
    net = (_INPUTS[NET_FORCE],) if law.acceleration is not None or law.base is not None else ()
    return (DRIFT, DRIFT_RATE, *law.states, *law.symbols, *bending, *net)


def packed(programs: LawPrograms) -> list[dict[str, Any] | None]:
    """Programs as plain data; the variables are the law's own."""
    return [
        None if part is None else asdict(part)
        for part in (programs.storey, programs.floor, programs.base, programs.bare)
    ]


def unpacked(plain: Sequence[Mapping[str, Any] | None], law: StoreyLaw) -> LawPrograms:
    """The programs of a law from what :func:`packed` made of them."""
    storey, floor, base, bare = (None if part is None else _unpacked_part(part) for part in plain)
    assert storey is not None
    return LawPrograms(storey=storey, floor=floor, base=base, bare=bare, variables=_variables(law))


def _unpacked_part(plain: Mapping[str, Any]) -> Part:
    """Lists are tuples again."""
    program = {
        name: Program(
            hoisted=tuple((symbol, source) for symbol, source in plain[name]["hoisted"]),
            lines=tuple((symbol, source) for symbol, source in plain[name]["lines"]),
            outputs=tuple(plain[name]["outputs"]),
        )
        for name in ("rates", "tangent")
    }
    return Part(
        **program,
        rows=tuple(plain["rows"]),
        partials=tuple((row, column) for row, column in plain["partials"]),
        first_rates=plain["first_rates"],
        first_tangent=plain["first_tangent"],
    )


def _part(
    outputs: tuple[sp.Expr, ...],
    rows: tuple[int, ...],
    variables: tuple[sp.Symbol, ...],
    constants: frozenset[sp.Symbol],
    first: int,
) -> Part:
    partials: list[tuple[int, int]] = []
    expressions: list[sp.Expr] = []
    for row, output in zip(rows, outputs, strict=True):
        moving = [(column, variable) for column, variable in enumerate(variables) if variable in output.free_symbols]
        slopes = derivatives(output, [variable for _, variable in moving])
        for (column, _), slope in zip(moving, slopes, strict=True):
            if slope != 0:
                partials.append((row, column))
                expressions.append(slope)
    rates = compile_expressions(outputs, constants)
    return Part(
        rates=rates,
        tangent=compile_expressions((*outputs, *expressions), constants),
        rows=rows,
        partials=tuple(partials),
        first_rates=first,
        first_tangent=first + len(rates.hoisted),
    )
