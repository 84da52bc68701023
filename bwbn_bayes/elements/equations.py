"""A storey's law as equations to read: Unicode text for the terminal, presentation MathML for pages.

One traversal of the SymPy expressions serves both. Factors and terms stand in the order of the literature
(parameters, then states), which SymPy's own printers do not keep.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import sympy as sp
from sympy.core.function import AppliedUndef

from bwbn_bayes.elements.combine import sensor_law, surroundings, with_path
from bwbn_bayes.elements.law import TIME, Definition, SensorLaw, Slots, StoreyLaw, off_zero, rate_of
from bwbn_bayes.elements.notation import LETTERS, MathmlNotation, Notation, UnicodeNotation
from bwbn_bayes.parameters import Parameter

READING_ORDER = (
    "kappa", "nu", "H", "h", "s", "a", "f", "epsilon", "u_c", "u", "u_b", "d", "z", "chi", "v",
    "m_i", "M_i", "w_i", "x_b", "v_b", "x_s", "v_s", "q_s", "y_t", "v_t", "a_i", "a_rec", "a_g", "F_1",
)  # fmt: skip
"""Steps and states as they follow each other in a product; parameters come before them."""

Raised = Literal["in time", "at a storey"]
"""How an increment sets a parameter apart."""


@dataclass(frozen=True, kw_only=True)
class WrittenEquation:
    """One equation: what it says in a few words, on one line of text, and as a row of presentation MathML."""

    caption: str
    text: str
    mathml: str


class _Writer:
    """Writes SymPy expressions in one notation; ``raised`` parameters change in time or differ at a storey."""

    def __init__(self, notation: Notation, raised: Mapping[sp.Symbol, Raised] | None = None) -> None:
        self.notation = notation
        self.raised = raised or {}

    def write(self, expression: sp.Expr) -> str:
        """The expression in the notation."""
        if isinstance(expression, sp.Symbol):
            return self.symbol(expression)
        if expression.could_extract_minus_sign() and not expression.is_Add:
            return self.notation.minus(self._factor(-expression))
        if expression.is_Add:
            return self._sum(expression)
        if expression.is_Mul or (expression.is_Rational and not expression.is_Integer):
            return self._product(expression)
        if expression.is_Pow:
            return self._power(expression)
        if isinstance(expression, off_zero):
            return self.write(expression.args[0])
        if expression.is_number and not expression.args:
            written = f"{float(expression):.15g}" if expression.is_Float else str(expression)
            return self.notation.number("π" if expression == sp.pi else written)
        return self._call(expression)

    def symbol(self, symbol: sp.Symbol) -> str:
        """A symbol; Greek letters, subscripts, ``Δ`` for a jump, ``t`` for its time and ``T`` for its duration."""
        return self.raised_name(symbol.name, self.raised.get(symbol))

    def raised_name(self, name: str, raised: Raised | None) -> str:
        """A symbol by name, ``k(t)`` where it changes in time, ``α_i`` where it differs at storey i."""
        written = self.name(f"{name}_i" if raised == "at a storey" else name)
        return self.notation.row((written, self.of_time())) if raised == "in time" else written

    def of_time(self) -> str:
        """``(t)``."""
        return self.notation.fence("(", self.notation.identifier("t", ""), ")")

    def name(self, name: str) -> str:
        """A symbol by name."""
        if name.endswith("_jump"):
            return self.notation.row((self.notation.identifier("Δ", ""), self.name(name.removesuffix("_jump"))))
        if name.endswith("_time"):
            return self.notation.identifier("t", "_".join(_letters(name.removesuffix("_time"))))
        if name.endswith("_duration"):
            return self.notation.identifier("T", "_".join(_letters(name.removesuffix("_duration"))))
        letter, *below = _letters(name)
        return self.notation.identifier(letter, " ".join(below))

    def _sum(self, expression: sp.Add) -> str:
        parts: list[str] = []
        for position, term in enumerate(sorted(expression.args, key=_place_of_term)):
            negative = term.could_extract_minus_sign()
            written = self._factor(-term) if negative else self.write(term)
            if position > 0:
                parts += [self.notation.operator("−" if negative else "+"), written]
            else:
                parts.append(self.notation.minus(written) if negative else written)
        return self.notation.row(parts)

    def _product(self, expression: sp.Expr) -> str:
        above, below = _split_fraction(expression)
        if not below:
            return self.notation.product([self._factor(factor) for factor in above])
        top = self._side(above)
        return self.notation.fraction(
            top,
            self._side(below),
            above_is_simple=len(above) != 1 or not above[0].is_Add,
            below_is_simple=len(below) == 1 and not below[0].is_Add,
        )

    def _side(self, factors: list[sp.Expr]) -> str:
        """One side of a fraction: a lone sum needs no brackets of its own."""
        if not factors:
            return self.notation.number("1")
        return (
            self.write(factors[0]) if len(factors) == 1 else self.notation.product([self._factor(f) for f in factors])
        )

    def _factor(self, factor: sp.Expr) -> str:
        written = self.write(factor)
        return self.notation.fence("(", written, ")") if factor.is_Add else written

    def _power(self, expression: sp.Pow) -> str:
        base, exponent = expression.args
        if exponent.is_number and exponent < 0:
            return self._product(expression)
        if exponent == sp.S.Half:
            return self.notation.root(self.write(base), is_simple=not base.args)
        written = self.write(base)
        if base.args and not isinstance(base, sp.Abs):
            written = self.notation.fence("(", written, ")")
        return self.notation.power(written, self.write(exponent), exponent_is_simple=not exponent.args)

    def _call(self, expression: sp.Expr) -> str:
        if isinstance(expression, sp.Abs):
            return self.notation.fence("|", self.write(expression.args[0]), "|")
        if isinstance(expression, AppliedUndef):
            inner = self.notation.row(self._separated([self.write(argument) for argument in expression.args]))
            return self.notation.row((self.name(expression.func.__name__), self.notation.fence("(", inner, ")")))
        name = {"sign": "sgn", "Heaviside": "H", "Max": "max", "Min": "min"}.get(
            expression.func.__name__, expression.func.__name__
        )
        arguments = expression.args[:1] if name == "H" else sorted(expression.args, key=lambda a: a.is_number)
        inner = self.notation.row(self._separated([self.write(argument) for argument in arguments]))
        return self.notation.function(name, inner, bare=name == "sgn" and not arguments[0].args)

    def _separated(self, written: list[str]) -> list[str]:
        return [written[0], *(part for item in written[1:] for part in (self.notation.operator(","), item))]


def _letters(name: str) -> list[str]:
    """Letter and subscripts of a symbol, Greek where the name is Greek."""
    return [LETTERS.get(part, part) for part in name.split("_") if part]


def _split_fraction(expression: sp.Expr) -> tuple[list[sp.Expr], list[sp.Expr]]:
    above: list[sp.Expr] = []
    below: list[sp.Expr] = []
    for factor in sp.Mul.make_args(expression):
        if factor.is_Rational:
            above += [sp.Integer(factor.p)] if factor.p != 1 else []
            below += [sp.Integer(factor.q)] if factor.q != 1 else []
            continue
        base, exponent = factor.as_base_exp()
        if isinstance(factor, sp.Pow) and exponent.is_number and exponent < 0:
            below.append(base**-exponent)
        else:
            above.append(factor)
    return sorted(above, key=_place_of_factor), sorted(below, key=_place_of_factor)


def _rank(expression: sp.Expr) -> int:
    """Where the last step or state of an expression stands in the reading order; -1 for parameters alone."""
    names = {s.name for s in expression.free_symbols}
    return max((i for i, name in enumerate(READING_ORDER) if name in names), default=-1)


def _place_of_factor(factor: sp.Expr) -> tuple[int, int, str]:
    """Numbers, brackets of parameters, parameters, steps and states, powers of them, then brackets and functions."""
    rank = _rank(factor)
    if factor.is_number:
        kind = 0
    elif factor.is_Add:
        kind = 1 if rank < 0 else 5
    elif factor.is_Symbol:
        kind = 2 if rank < 0 else 3
    else:
        kind = 4 if factor.is_Pow else 6
    return kind, rank, str(factor)


def _place_of_term(term: sp.Expr) -> tuple[bool, bool, bool, int, str]:
    """Numbers first, minus terms late, then what carries a sign of a state, then by the reading order."""
    return not term.is_number, term.could_extract_minus_sign(), not term.has(sp.sign), _rank(term), str(term)


def law_equations(law: StoreyLaw) -> tuple[WrittenEquation, ...]:
    """A storey's law in named steps.

    Parameters
    ----------
    law : StoreyLaw
        The law of a structure's storeys, ``model.law``.

    Returns
    -------
    tuple of WrittenEquation
        Parameters that jump, steps, rates, force, in the order in which they are evaluated.
    """
    moments = {event.indicator: event.time for event in law.events}
    raised = {base: _raised(increment, law.parameters) for base, increment in law.increments}
    changes = tuple(_change(base, increment, moments, raised[base]) for base, increment in law.increments)
    return changes + tuple(_written(definition, moments, raised) for definition in law.definitions)


def slot_equations(slots: Slots, parameters: tuple[Parameter, ...]) -> tuple[WrittenEquation, ...]:
    """What an effect fills into neutral slots: its own steps, then each slot it changes.

    Parameters
    ----------
    slots : Slots
        ``effect.fill(Slots())``.
    parameters : tuple of Parameter
        Those of the effect.

    Returns
    -------
    tuple of WrittenEquation
        At least one for an effect that does anything.
    """
    neutral = Slots()
    moments = {event.indicator: event.time for event in slots.events}
    result = [
        _change(base, increment, moments, _raised(increment, parameters))
        for base, increment in slots.increments.items()
    ]
    result += [_written(definition, moments) for definition in slots.steps]
    for name, caption, subject in _SLOTS:
        value = getattr(slots, name)
        if value != getattr(neutral, name):
            result.append(_equation(caption, lambda writer, s=subject: writer.name(s), value))  # type: ignore[misc]
    added = tuple(_rate(added.state, added.rate) for added in with_path(slots).added_states)
    around = (*surroundings(slots), *sensor_law(slots, parameters).definitions)
    return (*result, *(_written(definition, moments) for definition in (*added, *around)))


def sensor_equations(law: SensorLaw) -> tuple[WrittenEquation, ...]:
    """What the accelerometers show, where it is not the acceleration itself."""
    return tuple(_written(definition, {}) for definition in law.definitions)


_SLOTS = (
    ("stiffness_factor", "multiplies the stiffness", "kappa"),
    ("nu", "multiplies the shape bracket: strength degradation", "nu"),
    ("eta", "divides the rate: stiffness degradation", "eta"),
    ("shape_bracket", "added to the shape bracket", "b"),
    ("rate_multiplier", "multiplies the rate of the hysteretic displacement", "h"),
    ("slip_compliance", "slip per unit of hysteretic displacement", "du_2/dz"),
    ("drift_taken_up", "drift taken up before the springs", "u_p"),
    ("drift_rate_share", "share of the drift rate that reaches the springs", "chi"),
    ("hysteretic_factor", "multiplies the force of the hysteretic spring", "H"),
    ("added_force", "added to the storey force", "F_added"),
)


def _rate(state: sp.Symbol, rate: sp.Expr) -> Definition:
    return Definition(caption=f"rate of {state}", subject=rate_of(state), expression=rate)


def _raised(increment: sp.Expr, parameters: tuple[Parameter, ...]) -> Raised:
    """Whether an increment holds more than parameters, and so changes in time."""
    known = {parameter.symbol for parameter in parameters}
    return "at a storey" if {s.name for s in increment.free_symbols} <= known else "in time"


def _change(
    base: sp.Symbol, increment: sp.Expr, moments: Mapping[sp.Symbol, sp.Symbol], raised: Raised
) -> WrittenEquation:
    """A parameter that changes or differs; H is the unit step."""
    after = increment.xreplace(_unit_steps(moments))
    steps = after.has(sp.Heaviside)
    caption = "differs at this storey" if raised == "at a storey" else "sudden change, H the unit step"
    return _equation(
        caption if steps or raised == "at a storey" else "gradual change",
        lambda writer: writer.raised_name(base.name, raised),
        base + after,
    )


def _unit_steps(moments: Mapping[sp.Symbol, sp.Symbol]) -> dict[sp.Symbol, sp.Expr]:
    return {indicator: sp.Heaviside(TIME - moment) for indicator, moment in moments.items()}


def _written(
    definition: Definition, moments: Mapping[sp.Symbol, sp.Symbol], raised: Mapping[sp.Symbol, Raised] | None = None
) -> WrittenEquation:
    return _equation(
        definition.caption,
        lambda writer: _subject(writer, definition.subject.name),
        definition.expression.xreplace(_unit_steps(moments)),
        raised,
    )


def _subject(writer: _Writer, name: str) -> str:
    """Left side of a definition: a symbol, or a derivative written ``dz/dt``."""
    above, slash, below = name.partition("/")
    if not slash:
        return writer.name(name)
    parts = [
        writer.notation.row((writer.notation.identifier("d", ""), writer.name(side[1:]))) for side in (above, below)
    ]
    return writer.notation.fraction(parts[0], parts[1], above_is_simple=True, below_is_simple=True)


_OFFSET = 1e-4
"""What is added to the base of a power so that it has a slope at zero is less: it is not read as part of the law."""


def _without_offsets(expression: sp.Expr) -> sp.Expr:
    """The same where a decimal number in the base of a power by parameters is all but a whole one, as that one."""

    def is_by_parameters(power: sp.Expr) -> bool:
        return bool(power.is_Pow and power.exp.free_symbols)

    def even(power: sp.Expr) -> sp.Expr:
        numbers = [one for one in sp.Add.make_args(power.base) if one.is_Float]
        base = power.base.xreplace({one: sp.Integer(round(one)) for one in numbers if abs(one - round(one)) < _OFFSET})
        return base**power.exp if base != 0 else base

    return expression.replace(is_by_parameters, even)


def _equation(
    caption: str, subject: Callable[[_Writer], str], value: sp.Expr, raised: Mapping[sp.Symbol, Raised] | None = None
) -> WrittenEquation:
    sides = []
    read = _without_offsets(value)
    for notation in (UnicodeNotation(), MathmlNotation()):
        writer = _Writer(notation, raised)
        sides.append(notation.row((subject(writer), notation.operator("="), writer.write(read))))
    return WrittenEquation(caption=caption, text=sides[0], mathml=sides[1])
