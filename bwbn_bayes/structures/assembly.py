"""The table of a structure's parameters: which are known, which are identified, and the conditions that join them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from bwbn_bayes.elements.law import SensorLaw, StoreyLaw
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import (
    Booleans,
    Constraint,
    Floats,
    FreeParameter,
    Parameter,
    PerStorey,
    Prior,
    Value,
    is_number,
    require_number,
)
from bwbn_bayes.structures.parts import Links, PlacedEffect


@dataclass(frozen=True, kw_only=True)
class ParameterTable:
    """Where each parameter of each link's law, and of the floor that it carries, comes from.

    Attributes
    ----------
    fixed : (n_links, n_columns) array
        Known values; neutral where an effect does not act. Columns are the parameters of the law, then those of the
        sensors; a parameter of the whole building stands in every row.
    index : (n_links, n_columns) integer array
        Position among the identified parameters, -1 where the value is known.
    """

    fixed: Floats
    index: NDArray[np.int64]

    def local(self, draws: Floats) -> Floats:
        """Parameters ``(n_draws, n_links, n_columns)`` of draws ``(n_draws, n_parameters)``."""
        if draws.shape[1] == 0:
            return np.broadcast_to(self.fixed, (len(draws), *self.fixed.shape)).copy()
        return np.where(self.index >= 0, draws[:, np.maximum(self.index, 0)], self.fixed)


def assemble(
    links: Sequence[Links], effects: Sequence[PlacedEffect], parameters: Sequence[Parameter]
) -> tuple[ParameterTable, tuple[FreeParameter, ...]]:
    """The table of a structure's parameters, and those that are to be identified, in the order of its columns.

    Parameters
    ----------
    links : sequence of Links
    effects : sequence of PlacedEffect
    parameters : sequence of Parameter
        The table's columns: of the law, then of the sensors.

    Raises
    ------
    UserError
        If a value is none, or lies outside its parameter's admissible range.
    """
    n_links = sum(len(group.joins) for group in links)
    symbols = [p.symbol for p in parameters]
    fixed = np.tile([p.neutral for p in parameters], (n_links, 1))
    index = np.full(fixed.shape, -1, dtype=np.int64)
    free: list[FreeParameter] = []
    everywhere = tuple(range(1, n_links + 1))
    entries, first = [], 1
    for group in links:
        element, where, values = group.element, tuple(range(first, first + len(group.joins))), group.element.values
        first += len(group.joins)
        entries += [(p, values[p.symbol], where) for p in element.parameters]
        for constant in element.derived:
            if constant.subject.name in symbols:
                fixed[np.array(where) - 1, symbols.index(constant.subject.name)] = float(constant.expression)
    for placed in effects:
        values = placed.effect.values
        entries += [(p, values[p.symbol], placed.storeys) for p in placed.effect.parameters]
    for parameter, value, storeys in entries:
        column = symbols.index(parameter.symbol)
        for name, one, where in spread(parameter, value, storeys, n_links):
            rows = [s - 1 for s in where or everywhere]
            if isinstance(one, Prior):
                prior = one.truncated(parameter.lower, parameter.upper)
                index[rows, column] = len(free)
                free.append(
                    FreeParameter(name=name, symbol=parameter.symbol, unit=parameter.unit, prior=prior, storeys=where)
                )
            else:
                fixed[rows, column] = checked(parameter, name, one)
    return ParameterTable(fixed=fixed, index=index), tuple(free)


def spread(
    parameter: Parameter, value: Value, storeys: tuple[int, ...], n_links: int
) -> list[tuple[str, float | Prior, tuple[int, ...]]]:
    """Label, value and storeys of each separate parameter behind one field of a model."""
    symbol = parameter.symbol
    if isinstance(value, PerStorey) and not storeys:
        raise UserError(f"{symbol} belongs to the whole building: give one number or prior, not PerStorey")
    if isinstance(value, PerStorey):
        return [(f"{symbol}[{s}]", value.at(i, len(storeys)), (s,)) for i, s in enumerate(storeys)]
    if not (is_number(value) or isinstance(value, Prior)):
        raise UserError(f"{symbol} is {value!r}: give a number, a prior, or PerStorey of either")
    label = symbol if len(storeys) in (0, n_links) else f"{symbol}[{','.join(map(str, storeys))}]"
    return [(label, value, storeys)]


def checked(parameter: Parameter, name: str, value: float) -> float:
    """A known value as a number; an error where it is none, or lies outside the admissible range."""
    require_number(name, value)
    if not (np.isfinite(value) and parameter.lower <= value <= parameter.upper):
        raise UserError(
            f"{name} = {value:g} lies outside its admissible range [{parameter.lower:g}, {parameter.upper:g}]"
        )
    return float(value)


def _never_cuts(
    function: Callable[..., object], fixed: Floats, index: NDArray[np.int64], free: tuple[FreeParameter, ...]
) -> bool:
    """Whether a condition, monotone in each parameter, holds at every corner of the priors' supports."""
    ends = [free[i].prior.support if i >= 0 else (known,) for i, known in zip(index, fixed, strict=True)]
    with np.errstate(all="ignore"):  # at an infinite end
        return all(bool(function(*map(np.float64, corner))) for corner in product(*ends))


@lru_cache(maxsize=512)
def _condition(relation: sp.Basic, symbols: tuple[sp.Symbol, ...]) -> tuple[str, list[int], Callable[..., object]]:
    """A condition as text, which of the symbols it concerns, and as a function of those.

    Discovery builds hundreds of models with few conditions.
    """
    concerns = relation.free_symbols
    columns = [i for i, symbol in enumerate(symbols) if symbol in concerns]
    return f"{relation}", columns, sp.lambdify([symbols[i] for i in columns], relation, "numpy")


def constraints(
    conditions: Sequence[sp.Basic],
    symbols: tuple[sp.Symbol, ...],
    table: ParameterTable,
    free: tuple[FreeParameter, ...],
) -> tuple[Constraint, ...]:
    """Joint conditions on a law's parameters that cut the prior at a storey.

    Raises
    ------
    UserError
        If known values already break one.
    """
    result: dict[tuple[int, ...], Constraint] = {}
    for number, relation in enumerate(conditions):
        text, columns, function = _condition(relation, symbols)
        for row, (fixed, index) in enumerate(zip(table.fixed[:, columns], table.index[:, columns], strict=True)):
            if np.all(index < 0):
                if not bool(function(*fixed)):
                    raise UserError(f"storey {row + 1}: {text} does not hold for the values given")
                continue
            if _never_cuts(function, fixed, index, free):
                continue

            def holds(
                draws: Floats, function: object = function, fixed: Floats = fixed, index: NDArray[np.int64] = index
            ) -> Booleans:
                values = np.where(index >= 0, draws[:, np.maximum(index, 0)], fixed)
                return np.asarray(function(*values.T), dtype=np.bool_)  # type: ignore[operator]

            concerned = tuple(dict.fromkeys(int(i) for i in index if i >= 0))
            result.setdefault((number, *index), Constraint(text=text, holds=holds, columns=concerned))
    return tuple(result.values())


def check_symbols(law: StoreyLaw, sensors: SensorLaw) -> None:
    """Every parameter has one owner, and every symbol of the law stands for something."""
    names = [p.symbol for p in (*law.parameters, *sensors.parameters)]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise UserError(f"two parts of the storey law bring a parameter {', '.join(twice)}: rename one of them")
    for missing in (law.unknown, sensors.unknown):
        if missing:
            raise UserError(
                f"an effect refers to {', '.join(missing)}, which nothing in the model brings: "
                "add the effect that does first"
            )
