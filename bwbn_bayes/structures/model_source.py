"""A structure as the Python source of a model file, as a person could have written it."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from numbers import Integral, Real
from pathlib import Path
from types import MappingProxyType

from bwbn_bayes.elements.element import Element
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import PerStorey, Prior, Truncated
from bwbn_bayes.structures.parts import PlacedEffect
from bwbn_bayes.structures.structure import Structure

WIDTH = 118
"""Columns of a line of code."""
_DIGITS = 4
"""Significant digits of rounded priors: they stand for sizes to expect, not for measurements."""
_PACKAGE = "bwbn_bayes"


class ModelWriter:
    """Writes structures, effects and values, and remembers which classes they need."""

    def __init__(self) -> None:
        self.from_package: set[str] = set()
        self.from_origin: set[str] = set()
        self.uses_path = False

    def function(self, name: str) -> str:
        """A function of the package that works with a path."""
        self.from_package.add(name)
        self.uses_path = True
        return name

    def header(self, origin: Path | None = None) -> list[str]:
        """The imports; a user's own classes come from the model file that defines them."""
        standard = ["import runpy"] if self.from_origin else []
        if self.from_origin and origin is None:
            raise UserError(
                f"{', '.join(sorted(self.from_origin))} is not part of the package: say which model file defines it"
            )
        if self.uses_path:
            standard.append("from pathlib import Path")
        names = sorted(self.from_package)
        line = f"from {_PACKAGE} import {', '.join(names)}"
        if len(line) > WIDTH:
            line = "\n".join([f"from {_PACKAGE} import (", *(f"    {each}," for each in names), ")"])
        given = [f"given = runpy.run_path({quoted(str(origin))})", *(_taken(n) for n in sorted(self.from_origin))]
        return [*standard, *([""] if standard else []), line, *(["", *given] if self.from_origin else [])]

    def structure(
        self, model: Structure, *, remarks: Mapping[str, str] | None = None, written: Mapping[str, str] | None = None
    ) -> str:
        """The structure without its effects, one field a line, units beside.

        Parameters
        ----------
        model : Structure
        remarks : mapping of str to str, optional
            By field, a sentence above it.
        written : mapping of str to str, optional
            By field, source in the place of its value.
        """
        remarks, written = remarks or {}, written or {}
        chain = tuple((i, i + 1) for i in range(max(model.n_floors, 1)))
        is_isolated = tuple(group.joins for group in model.links[:2]) == (chain[:1], chain[1:])
        isolator, (storeys, *others) = model.links[:is_isolated], model.links[is_isolated:]
        if not (is_isolated or storeys.joins == chain) or any(len(group.joins) > 1 for group in others):
            return self._of_links(model)
        lines = [f"model = {self._named('Specimen' if model.is_driven else 'ShearBuilding')}("]
        lines += self._floors(model, written)
        lines += [line for group in isolator for line in self._element("isolator=", group.element)]
        lines += [*self._element("storey=", storeys.element, remarks, written), ")"]
        for group in others:
            lines += [
                "model = model.with_link(",
                *self._element("", group.element),
                f"    joins={group.joins[0]},",
                ")",
            ]
        return "\n".join(lines)

    def _of_links(self, model: Structure) -> str:
        """A structure that no constructor makes, link by link."""
        lines = [f"model = {self._named('Structure')}(", *self._floors(model, {}), "    links=("]
        for group in model.links:
            own = [f"{self._named('Links')}(", *self._element("element=", group.element), f"    joins={group.joins},"]
            lines += [f"        {line}" for line in (*own, "),")]
        return "\n".join([*lines, "    ),", ")"])

    def _floors(self, model: Structure, written: Mapping[str, str]) -> list[str]:
        """Masses and heights, as keywords."""
        lines = [] if model.is_driven else [f"    masses={written.get('masses', _listed(model.masses))},  # kg"]
        return lines + ([f"    heights={_listed(model.heights)},  # m"] if model.heights is not None else [])

    def _element(
        self,
        keyword: str,
        element: Element,
        remarks: Mapping[str, str] = MappingProxyType({}),
        written: Mapping[str, str] = MappingProxyType({}),
    ) -> list[str]:
        """An element as an argument: its values, each with its unit, below remarks."""
        lines = [f"    {keyword}{self._class(type(element))}("]
        units = {parameter.symbol: parameter.unit for parameter in element.parameters}
        for symbol, value in element.values.items():
            unit = f"  # {units[symbol]}" if units[symbol] else ""
            lines += comment(remarks.get(symbol, ""), indent=8)
            own = self._value(value, _number)
            lines.append(f"        {symbol}={written.get(symbol, own)},{unit}")
        return lines + (["        hardens=True,"] if getattr(element, "hardens", False) else []) + ["    ),"]

    def placed(self, one: PlacedEffect, *, remarks: Sequence[str] = (), rounded: bool = False) -> str:
        """One effect joining the model, below remarks; its numbers exact, or rounded to what priors are worth."""
        arguments = self._arguments(one.effect, _rounded if rounded else _number)
        effect = self._class(type(one.effect))
        tail = f", storeys={list(one.storeys)}" if one.storeys else ""
        line = f"model = model.with_effect({effect}({', '.join(arguments)}){tail})"
        if len(line) > WIDTH:
            inner = [f"        {argument}," for argument in arguments]
            places = [f"    storeys={list(one.storeys)},"] if one.storeys else []
            line = "\n".join(["model = model.with_effect(", f"    {effect}(", *inner, "    ),", *places, ")"])
        return "\n".join(["", *(line for remark in remarks for line in comment(remark)), line])

    def _arguments(self, effect: Effect, number: Callable[[float], str]) -> list[str]:
        """The fields that are not at their defaults, as keywords."""
        if not is_dataclass(effect):
            raise TypeError(f"{type(effect).__name__} is not a dataclass")
        given = [(field, getattr(effect, field.name)) for field in fields(effect)]
        return [
            f"{field.name}={self._value(value, number)}"
            for field, value in given
            if field.default is MISSING or value != field.default
        ]

    def _value(self, value: object, number: Callable[[float], str]) -> str:
        if isinstance(value, PerStorey):
            inner = value.value
            if isinstance(inner, tuple):
                return f"{self._class(PerStorey)}([{', '.join(self._value(each, number) for each in inner)}])"
            return f"{self._class(PerStorey)}({self._value(inner, number)})"
        if isinstance(value, Truncated):
            low, high = _number_or_inf(value.lower, number), _number_or_inf(value.upper, number)
            return f"{self._value(value.parent, number)}.truncated({low}, {high})"
        if isinstance(value, Prior) and is_dataclass(value):
            inner_values = (self._value(getattr(value, field.name), number) for field in fields(value))
            return f"{self._class(type(value))}({', '.join(inner_values)})"
        if isinstance(value, bool) or value is None:
            return repr(value)
        if isinstance(value, Real):  # NumPy's numbers, too
            return _number_or_inf(int(value) if isinstance(value, Integral) else float(value), number)
        return quoted(value) if isinstance(value, str) else repr(value)

    def _named(self, constructor: str) -> str:
        self.from_package.add(constructor)
        return constructor

    def _class(self, needed: type) -> str:
        inside = needed.__module__.split(".")[0] == _PACKAGE
        (self.from_package if inside else self.from_origin).add(needed.__name__)
        return needed.__name__


def docstring(first: str, *more: str) -> str:
    """A module docstring: what the file is, then further lines as they are."""
    safe = _printable(first).replace("\\", "\\\\").replace('"', '\\"')
    lines = textwrap.wrap(safe, WIDTH, break_long_words=False)
    return "\n".join(('"""' + lines[0], *lines[1:], *(("", *more) if more else ()), '"""'))


def comment(sentence: str, indent: int = 0) -> list[str]:
    """A sentence as comment lines; none where it is empty."""
    # A number stays on one line with its error.
    kept = _printable(sentence).replace(" +- ", "\N{NO-BREAK SPACE}+-\N{NO-BREAK SPACE}")
    lines = textwrap.wrap(kept, WIDTH - 2 - indent, break_long_words=False)
    return [f"{' ' * indent}# {line.replace('\N{NO-BREAK SPACE}', ' ')}" for line in lines]


def assignment(name: str, sentences: Sequence[str]) -> str:
    """A list of sentences, one a line."""
    return "\n".join([f"{name} = [", *(f"    {quoted(one)}," for one in sentences), "]"])


def quoted(value: str) -> str:
    """A string literal; what would end a line, or steer a terminal, is written as an escape."""
    escaped = value.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(each if each.isprintable() else repr(each)[1:-1] for each in escaped) + '"'


def _printable(sentence: str) -> str:
    """A sentence for a comment or a docstring, which a line's end would leave."""
    return "".join(each if each.isprintable() else " " for each in sentence)


def _taken(name: str) -> str:
    return f'{name} = given["{name}"]'


def _number(value: float) -> str:
    """The shortest text that reads back as the same number."""
    return repr(value) if isinstance(value, int) else repr(float(value))


def _listed(values: Sequence[float]) -> str:
    return f"[{', '.join(_number(value) for value in values)}]"


def _rounded(value: float) -> str:
    return _number(float(f"{value:.{_DIGITS}g}"))


def _number_or_inf(value: float, number: Callable[[float], str]) -> str:
    return f'float("{value}")' if value in (float("inf"), float("-inf")) else number(value)
