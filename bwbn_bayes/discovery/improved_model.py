"""The improved model as a Python file that a person could have written and ``bwbn identify`` runs as it is."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path

from bwbn_bayes.discovery.outcome import Added
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import PerStorey, Prior, Truncated
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.structure import PlacedEffect, Structure

_WIDTH = 118
"""Columns of a line of code."""
_DIGITS = 4
"""Significant digits of priors that discovery chose: they stand for sizes to expect, not for measurements."""
_PACKAGE = "bwbn_bayes"


def improved_model_source(
    model: Structure,
    added: Sequence[Added] = (),
    *,
    name: str = "model",
    origin: Path | None = None,
    record_file: str | None = None,
    assumptions: Sequence[str] = (),
) -> str:
    """Write a model as a model file.

    Parameters
    ----------
    model : Structure
        The improved model.
    added : sequence of Added
        Those of its effects that discovery found; each is told with its posterior.
    name : str
        What the given model is called.
    origin : Path, optional
        The given model's file, from which effects and priors of the user's own are taken.
    record_file : str, optional
        Name of the record's file beside the model file; without it ``bwbn identify`` asks for ``--record``.
    assumptions : sequence of str
        What the given model takes for granted.

    Returns
    -------
    str
        Python source.

    Raises
    ------
    UserError
        If the model uses a class from outside the package and ``origin`` is not given.
    """
    writer = _Writer(added=added)
    blocks = [writer.structure(model), *(writer.placed(one) for one in model.effects)]
    if record_file is not None:
        blocks.append(f"\nrecord = {writer.function('read_record')}(Path(__file__).with_name({_text(record_file)}))")
    if assumptions:
        blocks.append("\n".join(["", "assumptions = [", *(f"    {_text(one)}," for one in assumptions), "]"]))
    return "\n".join([_docstring(name, added), "", *writer.header(origin), "", *blocks, ""])


def _docstring(name: str, added: Sequence[Added]) -> str:
    what = ", ".join(one.candidate.hypothesis.label for one in added)
    first = f"{name} with what discovery found missing: {what}." if added else f"{name} as given: nothing was added."
    escaped = _printable(first).replace("\\", "\\\\").replace('"', '\\"')
    lines = textwrap.wrap(escaped, _WIDTH, break_long_words=False)
    rest = ("", "Units: N, m, s, kg, J.", '"""')
    return "\n".join(('"""' + lines[0], *lines[1:], *rest))


class _Writer:
    """Writes expressions and remembers which classes they need."""

    def __init__(self, *, added: Sequence[Added]) -> None:
        self.added = added
        self.from_package: set[str] = set()
        self.from_origin: set[str] = set()
        self.uses_path = False

    def function(self, name: str) -> str:
        """A function of the package that works with a path."""
        self.from_package.add(name)
        self.uses_path = True
        return name

    def header(self, origin: Path | None) -> list[str]:
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
        if len(line) > _WIDTH:
            line = "\n".join([f"from {_PACKAGE} import (", *(f"    {each}," for each in names), ")"])
        given = [f"given = runpy.run_path({_text(str(origin))})", *(_taken(n) for n in sorted(self.from_origin))]
        return [*standard, *([""] if standard else []), line, *(["", *given] if self.from_origin else [])]

    def structure(self, model: Structure) -> str:
        """The structure without its effects, one field a line, units beside."""
        lines = [f"model = {self._class(type(model))}("]
        if isinstance(model, ShearBuilding):
            lines.append(f"    masses=[{', '.join(_number(mass) for mass in model.masses)}],  # kg")
        lines.append(f"    storey={self._class(type(model.storey))}(")
        units = {parameter.symbol: parameter.unit for parameter in model.storey.parameters}
        for symbol, value in model.storey.values.items():
            remark = f"  # {units[symbol]}" if units[symbol] else ""
            lines.append(f"        {symbol}={self._value(value, _number)},{remark}")
        return "\n".join([*lines, "    ),", ")"])

    def placed(self, one: PlacedEffect) -> str:
        """One effect joining the model; one that discovery found with a comment and rounded priors."""
        found = next((a for a in self.added if _is(a, one)), None)
        number = _number if found is None else _rounded
        arguments = self._arguments(one.effect, number)
        effect = self._class(type(one.effect))
        tail = f", storeys={list(one.storeys)}" if one.storeys else ""
        line = f"model = model.with_effect({effect}({', '.join(arguments)}){tail})"
        if len(line) > _WIDTH:
            inner = [f"        {argument}," for argument in arguments]
            places = [f"    storeys={list(one.storeys)},"] if one.storeys else []
            line = "\n".join(["model = model.with_effect(", f"    {effect}(", *inner, "    ),", *places, ")"])
        return "\n".join(["", *_comment(found), line])

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
        if isinstance(value, (int, float)):
            return _number_or_inf(value, number)
        return _text(value) if isinstance(value, str) else repr(value)

    def _class(self, needed: type) -> str:
        inside = needed.__module__.split(".")[0] == _PACKAGE
        (self.from_package if inside else self.from_origin).add(needed.__name__)
        return needed.__name__


def _is(added: Added, placed: PlacedEffect) -> bool:
    hypothesis = added.candidate.hypothesis
    return hypothesis.effect == placed.effect and hypothesis.storeys == placed.storeys


def _comment(added: Added | None) -> list[str]:
    if added is None:
        return []
    hypothesis = added.candidate.hypothesis
    units = {p.name: p.unit for p in hypothesis.model.space.parameters}
    moments = (
        f"{label} = {mean:.4g} +- {sd:.2g}{f' {units[label]}' if units[label] else ''}"
        for label, (mean, sd) in added.moments.items()
    )
    return [
        *_wrapped(f"{hypothesis.label}: {hypothesis.effect.summary}; log Bayes factor {_factor(added)}."),
        *_wrapped(f"Posterior: {', '.join(moments)}."),
    ]


def _factor(added: Added) -> str:
    return f"{added.candidate.log_bayes_factor:.1f} +- {added.candidate.log_bayes_factor_se:.1f}"


def _wrapped(sentence: str) -> Iterable[str]:
    # A number stays on one line with its error.
    kept = _printable(sentence).replace(" +- ", "\N{NO-BREAK SPACE}+-\N{NO-BREAK SPACE}")
    lines = textwrap.wrap(kept, _WIDTH - 2, break_long_words=False)
    return (f"# {line.replace('\N{NO-BREAK SPACE}', ' ')}" for line in lines)


def _taken(name: str) -> str:
    return f'{name} = given["{name}"]'


def _text(value: str) -> str:
    """A string literal; what would end a line, or steer a terminal, is written as an escape."""
    escaped = value.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(each if each.isprintable() else repr(each)[1:-1] for each in escaped) + '"'


def _printable(sentence: str) -> str:
    """A sentence for a comment or a docstring, which a line's end would leave."""
    return "".join(each if each.isprintable() else " " for each in sentence)


def _number(value: float) -> str:
    """The shortest text that reads back as the same number."""
    return repr(value) if isinstance(value, int) else repr(float(value))


def _rounded(value: float) -> str:
    return _number(float(f"{value:.{_DIGITS}g}"))


def _number_or_inf(value: float, number: Callable[[float], str]) -> str:
    return f'float("{value}")' if value in (float("inf"), float("-inf")) else number(value)
