"""What every structure shares: a storey law, effects placed on storeys, and the table of its parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise, product
from typing import ClassVar, Self

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.law import Effect, StoreyLaw, combine
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import (
    Booleans,
    Constraint,
    Floats,
    FreeParameter,
    Parameter,
    ParameterSpace,
    PerStorey,
    Prior,
    Value,
)


@dataclass(frozen=True, kw_only=True)
class PlacedEffect:
    """An effect and the storeys (from 1) it acts on."""

    effect: Effect
    storeys: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class ParameterTable:
    """Where each parameter of each storey's law comes from.

    Attributes
    ----------
    fixed : (n_storeys, n_law) array
        Known values; neutral where an effect does not act.
    index : (n_storeys, n_law) integer array
        Position among the identified parameters, -1 where the value is known.
    """

    fixed: Floats
    index: NDArray[np.int64]

    def local(self, draws: Floats) -> Floats:
        """Law parameters ``(n_draws, n_storeys, n_law)`` of draws ``(n_draws, n_parameters)``."""
        if draws.shape[1] == 0:
            return np.broadcast_to(self.fixed, (len(draws), *self.fixed.shape)).copy()
        return np.where(self.index >= 0, draws[:, np.maximum(self.index, 0)], self.fixed)


@dataclass(frozen=True, kw_only=True)
class Structure:
    """Base of all structures: the same Bouc-Wen element at every storey, effects where they were placed."""

    storey: BoucWen
    effects: tuple[PlacedEffect, ...] = ()

    excitation_kind: ClassVar[str]

    def __post_init__(self) -> None:
        """Build the table once, so that every mistake shows where the model is written."""
        _ = self.space

    @property
    def n_storeys(self) -> int:
        """Number of storeys (links)."""
        raise NotImplementedError

    def with_effect(self, effect: Effect, storeys: Sequence[int] | None = None) -> Self:
        """A new structure with an effect at the given storeys (from 1; all of them by default)."""
        placed = tuple(storeys) if storeys is not None else tuple(range(1, self.n_storeys + 1))
        wrong = [s for s in placed if not 1 <= s <= self.n_storeys]
        if wrong or not placed or any(b <= a for a, b in pairwise(placed)):
            raise UserError(
                f"{effect.name}: storeys {list(placed)} must be numbers from 1 to {self.n_storeys} in increasing order"
            )
        symbols = {p.symbol for p in effect.parameters}
        for other in self.effects:
            if symbols & {p.symbol for p in other.effect.parameters} and set(placed) & set(other.storeys):
                shared = sorted(set(placed) & set(other.storeys))
                raise UserError(f"{effect.name} already acts on storey {shared}: place each effect once per storey")
        return replace(self, effects=(*self.effects, PlacedEffect(effect=effect, storeys=placed)))

    @cached_property
    def law(self) -> StoreyLaw:
        """The storey law with every kind of effect that acts anywhere in the structure."""
        kinds: dict[tuple[str, ...], Effect] = {}
        for placed in self.effects:
            kinds.setdefault(tuple(p.symbol for p in placed.effect.parameters), placed.effect)
        law = combine(self.storey.parameters, self.storey.constraints, tuple(kinds[key] for key in sorted(kinds)))
        names = [s.name for s in law.symbols]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise UserError(f"two parts of the storey law bring a parameter {', '.join(twice)}: rename one of them")
        known = {*law.symbols, *law.states, *(event.indicator for event in law.events)}
        for expression in (law.force, *law.rates, *(base for base, _ in law.increments)):
            missing = {s.name for s in expression.free_symbols} - {s.name for s in known} - {"u", "v"}
            if missing:
                raise UserError(
                    f"an effect refers to {', '.join(sorted(missing))}, which nothing in the model brings: "
                    "add the effect that does first"
                )
        return law

    @cached_property
    def _assembly(self) -> tuple[ParameterTable, tuple[FreeParameter, ...]]:
        return _assemble(self)

    @property
    def table(self) -> ParameterTable:
        """Where each storey's parameters come from."""
        return self._assembly[0]

    @cached_property
    def space(self) -> ParameterSpace:
        """The identified parameters with their joint prior."""
        table, free = self._assembly
        return ParameterSpace(parameters=free, constraints=_constraints(self.law, table, free))

    def draws(self, values: Mapping[str, float]) -> Floats:
        """One draw ``(1, n_parameters)`` from named values, e.g. ``{"k[1]": 20.0, "alpha": 0.01}``."""
        missing = [name for name in self.space.names if name not in values]
        unknown = [name for name in values if name not in self.space.names]
        if missing or unknown:
            raise UserError(
                f"values for the identified parameters: missing {missing}, unknown {unknown}; "
                f"the model identifies {list(self.space.names)}"
            )
        return np.array([[float(values[name]) for name in self.space.names]])

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is allowed but worth knowing, in sentences."""
        symbols = [p.symbol for p in self.law.parameters]
        sources = [(symbols.index("beta"), min), (symbols.index("gamma"), max)]
        ends = []
        for column, pick in sources:
            values = [
                self.space.parameters[i].prior.support[0 if pick is min else 1] if i >= 0 else fixed
                for i, fixed in zip(self.table.index[:, column], self.table.fixed[:, column], strict=True)
            ]
            ends.append(pick(values))
        if ends[1] > ends[0]:
            return (
                (
                    "The prior admits |gamma| > beta, where a loop can give back more energy than it took in "
                    "(Erlicher and Bursi, arXiv 0901.1448)."
                ),
            )
        return ()


def _assemble(structure: Structure) -> tuple[ParameterTable, tuple[FreeParameter, ...]]:
    law, n_storeys = structure.law, structure.n_storeys
    symbols = [p.symbol for p in law.parameters]
    fixed = np.tile([p.neutral for p in law.parameters], (n_storeys, 1))
    index = np.full(fixed.shape, -1, dtype=np.int64)
    free: list[FreeParameter] = []
    everywhere = tuple(range(1, n_storeys + 1))
    entries = [(p, structure.storey.values[p.symbol], everywhere) for p in structure.storey.parameters]
    for placed in structure.effects:
        entries += [(p, placed.effect.values[p.symbol], placed.storeys) for p in placed.effect.parameters]
    for parameter, value, storeys in entries:
        column = symbols.index(parameter.symbol)
        for name, one, where in _spread(parameter, value, storeys, n_storeys):
            rows = [s - 1 for s in where]
            if isinstance(one, Prior):
                prior = one.truncated(parameter.lower, parameter.upper)
                index[rows, column] = len(free)
                free.append(
                    FreeParameter(name=name, symbol=parameter.symbol, unit=parameter.unit, prior=prior, storeys=where)
                )
            else:
                fixed[rows, column] = _checked(parameter, name, one)
    return ParameterTable(fixed=fixed, index=index), tuple(free)


def _spread(
    parameter: Parameter, value: Value, storeys: tuple[int, ...], n_storeys: int
) -> list[tuple[str, float | Prior, tuple[int, ...]]]:
    """Label, value and storeys of each separate parameter behind one field of a model."""
    symbol = parameter.symbol
    if isinstance(value, PerStorey):
        return [(f"{symbol}[{s}]", value.at(i, len(storeys)), (s,)) for i, s in enumerate(storeys)]
    if not isinstance(value, (int, float, Prior)):
        raise UserError(f"{symbol} is {value!r}: give a number, a prior, or PerStorey of either")
    label = symbol if len(storeys) == n_storeys else f"{symbol}[{','.join(map(str, storeys))}]"
    return [(label, value, storeys)]


def _checked(parameter: Parameter, name: str, value: float) -> float:
    if not (np.isfinite(value) and parameter.lower <= value <= parameter.upper):
        raise UserError(
            f"{name} = {value:g} lies outside its admissible range [{parameter.lower:g}, {parameter.upper:g}]"
        )
    return float(value)


def _never_cuts(
    function: Callable[..., object], fixed: Floats, index: NDArray[np.int64], free: tuple[FreeParameter, ...]
) -> bool:
    """Whether a condition, monotone in each parameter, holds at every corner of the priors' supports."""
    ends = [free[i].prior.support if i >= 0 else (float(known),) for i, known in zip(index, fixed, strict=True)]
    return all(bool(function(*corner)) for corner in product(*ends))


def _constraints(law: StoreyLaw, table: ParameterTable, free: tuple[FreeParameter, ...]) -> tuple[Constraint, ...]:
    """The law's joint conditions that cut the prior at a storey; an error where known values already break one."""
    result: dict[tuple[int, ...], Constraint] = {}
    for number, relation in enumerate(law.constraints):
        columns = [i for i, s in enumerate(law.symbols) if s in relation.free_symbols]
        function = sp.lambdify([law.symbols[i] for i in columns], relation, "numpy")
        for row, (fixed, index) in enumerate(zip(table.fixed[:, columns], table.index[:, columns], strict=True)):
            if np.all(index < 0):
                if not bool(function(*fixed)):
                    raise UserError(f"storey {row + 1}: {relation} does not hold for the values given")
                continue
            if _never_cuts(function, fixed, index, free):
                continue

            def holds(
                draws: Floats, function: object = function, fixed: Floats = fixed, index: NDArray[np.int64] = index
            ) -> Booleans:
                values = np.where(index >= 0, draws[:, np.maximum(index, 0)], fixed)
                return np.asarray(function(*values.T), dtype=np.bool_)  # type: ignore[operator]

            result.setdefault((number, *index), Constraint(text=f"{relation}", holds=holds))
    return tuple(result.values())
