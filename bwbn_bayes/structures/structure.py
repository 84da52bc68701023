"""What every structure shares: a storey law, effects placed on storeys, and the table of its parameters."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from itertools import pairwise, product
from numbers import Integral, Real
from typing import ClassVar, Self

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.combine import combine, combine_sensors, kind_of
from bwbn_bayes.elements.law import (
    DRIFT,
    DRIFT_RATE,
    FIRST_FORCE,
    FLOOR_INPUTS,
    MASS,
    RECORDED_ACCELERATION,
    Effect,
    SensorLaw,
    StoreyLaw,
    symbol,
)
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
    """An effect and the storeys (or floors, from 1) it acts on; none where it acts on the whole building."""

    effect: Effect
    storeys: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class ParameterTable:
    """Where each parameter of each storey's law comes from.

    Attributes
    ----------
    fixed : (n_storeys, n_columns) array
        Known values; neutral where an effect does not act. Columns are the parameters of the law, then those of the
        sensors; a parameter of the whole building stands in every row.
    index : (n_storeys, n_columns) integer array
        Position among the identified parameters, -1 where the value is known.
    """

    fixed: Floats
    index: NDArray[np.int64]

    def local(self, draws: Floats) -> Floats:
        """Parameters ``(n_draws, n_storeys, n_columns)`` of draws ``(n_draws, n_parameters)``."""
        if draws.shape[1] == 0:
            return np.broadcast_to(self.fixed, (len(draws), *self.fixed.shape)).copy()
        return np.where(self.index >= 0, draws[:, np.maximum(self.index, 0)], self.fixed)


@dataclass(frozen=True, kw_only=True)
class Structure:
    """Base of all structures: the same Bouc-Wen element at every storey, effects where they were placed.

    ``carried`` are kinds of effects that the law has although none may be placed: they stay neutral and bring no
    identified parameter. Models with the same kinds, placed or carried, share one law and one compiled kernel.
    """

    storey: BoucWen
    effects: tuple[PlacedEffect, ...] = ()
    carried: tuple[Effect, ...] = ()

    excitation_kind: ClassVar[str]

    def __post_init__(self) -> None:
        """Build the table once, so that every mistake shows where the model is written."""
        _ = self.space

    @property
    def n_storeys(self) -> int:
        """Number of storeys (links)."""
        raise NotImplementedError

    def with_effect(self, effect: Effect, storeys: Sequence[int] | None = None) -> Self:
        """A new structure with an effect at the given storeys or floors (from 1; all of them by default).

        Raises
        ------
        UserError
            If a storey does not exist or has the effect already, if storeys are given for an effect of the whole
            building, or if the structure has nothing for the effect to act on.
        """
        if isinstance(effect, type) or not hasattr(effect, "fill"):
            raise UserError(
                f"with_effect takes an effect and its values, such as StrengthDegradation(delta_nu=0.1), not {effect!r}"
            )
        symbols = {p.symbol for p in effect.parameters}
        others = [other for other in self.effects if symbols & {p.symbol for p in other.effect.parameters}]
        if effect.level in WHOLE_BUILDING:
            if storeys is not None:
                raise UserError(f"{effect.name} acts on the whole building: leave storeys out")
            if others:
                raise UserError(f"{effect.name} already acts on the building: place it once")
            return replace(self, effects=(*self.effects, PlacedEffect(effect=effect, storeys=())))
        if isinstance(storeys, (Integral, str)):
            raise UserError(f"{effect.name}: storeys is {storeys!r}, it must be a list such as [{storeys}]")
        placed = tuple(storeys) if storeys is not None else tuple(range(1, self.n_storeys + 1))
        wrong = [s for s in placed if not 1 <= s <= self.n_storeys]
        if wrong or not placed or any(b <= a for a, b in pairwise(placed)):
            raise UserError(
                f"{effect.name}: storeys {list(placed)} must be numbers from 1 to {self.n_storeys} in increasing order"
            )
        for other in others:
            shared = sorted(set(placed) & set(other.storeys))
            if shared:
                raise UserError(f"{effect.name} already acts on storey {shared}: place each effect once per storey")
        return replace(self, effects=(*self.effects, PlacedEffect(effect=effect, storeys=placed)))

    def with_values(self, values: Mapping[str, float | Prior]) -> Self:
        """A new structure with other numbers or priors behind labels of its parameters, e.g. ``{"A": 1.0}``.

        Raises
        ------
        UserError
            If the structure has no parameter of that name.
        """
        labels: set[str] = set()

        def changed(parameter: Parameter, value: Value, storeys: tuple[int, ...]) -> Value:
            pieces = _spread(parameter, value, storeys, self.n_storeys)
            labels.update(name for name, _, _ in pieces)
            own = [values.get(name, one) for name, one, _ in pieces]
            return PerStorey(own) if isinstance(value, PerStorey) else own[0]

        everywhere = tuple(range(1, self.n_storeys + 1))
        own = {p.symbol: changed(p, self.storey.values[p.symbol], everywhere) for p in self.storey.parameters}
        effects = []
        for placed in self.effects:
            effect = placed.effect
            new = {
                _field_of(effect, p.symbol): changed(p, effect.values[p.symbol], placed.storeys)
                for p in effect.parameters
            }
            effects.append(replace(placed, effect=replace(effect, **new)))  # type: ignore[type-var]
        unknown = sorted(set(values) - labels)
        if unknown:
            raise UserError(f"the model has no parameter {', '.join(unknown)}: it has {', '.join(sorted(labels))}")
        return replace(self, storey=replace(self.storey, **own), effects=tuple(effects))

    def _kinds(self, effects: tuple[Effect, ...], *, of_sensors: bool) -> tuple[Effect, ...]:
        """One effect of each kind, in an order that does not depend on how they came."""
        kinds: dict[tuple[str, ...], Effect] = {}
        for effect in effects:
            if self.excitation_kind == "displacement" and effect.level != "link":
                raise UserError(
                    f"{effect.name} acts on floors, their sensors or the ground, which a specimen does not have: "
                    "use a ShearBuilding or leave it out"
                )
            if (effect.level == "observation") == of_sensors:
                symbols = tuple(p.symbol for p in effect.parameters)
                first = kinds.setdefault(symbols, effect)
                if first is not effect and kind_of(first) != kind_of(effect):
                    raise UserError(
                        f"two effects bring {', '.join(symbols)} and are not of one kind: name the parameters of one "
                        "otherwise"
                    )
        return tuple(kinds[key] for key in sorted(kinds))

    @property
    def _all_effects(self) -> tuple[Effect, ...]:
        return (*(placed.effect for placed in self.effects), *self.carried)

    @cached_property
    def law(self) -> StoreyLaw:
        """The storey law with every kind of effect that acts anywhere in the structure, or is carried."""
        law = self._law_with(self._all_effects)
        _check_symbols(law, self.sensors)
        return law

    def _law_with(self, effects: tuple[Effect, ...]) -> StoreyLaw:
        kinds = self._kinds(effects, of_sensors=False)
        return combine(self.storey.parameters, self.storey.constraints, kinds, self.storey.derived)

    @cached_property
    def sensors(self) -> SensorLaw:
        """What the accelerometers show of the floors' accelerations."""
        return combine_sensors(self._kinds(self._all_effects, of_sensors=True))

    @cached_property
    def conditions(self) -> tuple[sp.Basic, ...]:
        """Joint admissibility conditions of the element and the placed effects; what is carried brings none."""
        if not self.carried:
            return self.law.constraints
        return self._law_with(tuple(placed.effect for placed in self.effects)).constraints

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The columns of the table: parameters of the law, then of the sensors."""
        return self.law.parameters + self.sensors.parameters

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
        return ParameterSpace(parameters=free, constraints=_constraints(self, table, free))

    def draws(self, values: Mapping[str, float]) -> Floats:
        """One draw ``(1, n_parameters)`` from named values, e.g. ``{"k[1]": 20.0, "alpha": 0.01}``."""
        missing = [name for name in self.space.names if name not in values]
        unknown = [name for name in values if name not in self.space.names]
        if missing or unknown:
            wrong = [f"{', '.join(missing)} missing"] if missing else []
            wrong += [f"{', '.join(unknown)} not identified (fixed in the model, or unknown)"] if unknown else []
            identified = ", ".join(self.space.names) or "nothing"
            raise UserError(f"values of parameters: {'; '.join(wrong)}; the model identifies {identified}")
        known = {parameter.symbol: parameter for parameter in self.parameters}
        return np.array([[_checked(known[one.symbol], one.name, values[one.name]) for one in self.space.parameters]])

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is allowed but worth knowing, in sentences."""
        if self.storey.derived:
            admits = any(ratio < 0.5 for ratio in self._ends("rho", 0))
        else:
            admits = any(
                gamma > beta for beta, gamma in zip(self._ends("beta", 0), self._ends("gamma", 1), strict=True)
            )
        return (ADMITS_ENERGY,) if admits else ()

    def _ends(self, name: str, end: int) -> list[float]:
        """The least (0) or largest (1) value of a parameter that its prior admits, at each storey."""
        column = [p.symbol for p in self.law.parameters].index(name)
        rows = zip(self.table.index[:, column], self.table.fixed[:, column], strict=True)
        return [self.space.parameters[i].prior.support[end] if i >= 0 else float(fixed) for i, fixed in rows]


ADMITS_ENERGY = (
    "The prior admits |gamma| > beta, where a loop can give back more energy than it took in "
    "(Erlicher and Bursi, arXiv 0901.1448)."
)

WHOLE_BUILDING = ("structure", "excitation")
"""Levels of effects that have no place among storeys and floors."""


def _check_symbols(law: StoreyLaw, sensors: SensorLaw) -> None:
    """Every parameter has one owner, and every symbol of the law stands for something."""
    names = [p.symbol for p in (*law.parameters, *sensors.parameters)]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise UserError(f"two parts of the storey law bring a parameter {', '.join(twice)}: rename one of them")
    common = {*law.symbols, *(one.subject for one in law.derived), *(event.indicator for event in law.events)}
    own = {*common, DRIFT, DRIFT_RATE, *law.states[: law.n_storey_states]}
    floor = {*common, *law.states[law.n_storey_states :], *FLOOR_INPUTS, MASS, RECORDED_ACCELERATION}
    base = {*common, *law.base_states, FIRST_FORCE, RECORDED_ACCELERATION}
    n = law.n_storey_states
    parts = [
        (own, (law.force, *law.rates[:n], *(changed for changed, _ in law.increments))),
        (floor, (*law.rates[n:], *([law.acceleration] if law.acceleration is not None else []))),
        (base, (law.base.acceleration, *law.base.rates) if law.base is not None else ()),
        ({symbol(p.symbol) for p in sensors.parameters}, (sensors.gain, sensors.bias, sensors.lag)),
    ]
    for known, expressions in parts:
        for expression in expressions:
            missing = {s.name for s in expression.free_symbols} - {s.name for s in known}
            if missing:
                raise UserError(
                    f"an effect refers to {', '.join(sorted(missing))}, which nothing in the model brings: "
                    "add the effect that does first"
                )


def _field_of(effect: Effect, name: str) -> str:
    """The field behind a parameter: of its name, or else the one that holds its value."""
    own = [one.name for one in fields(effect)]  # type: ignore[arg-type]
    held = [name] if name in own else [one for one in own if getattr(effect, one) is effect.values[name]]
    if len(held) != 1:
        raise UserError(f"{effect.name}: which field stands for {name} cannot be told; name a field {name}")
    return held[0]


def _assemble(structure: Structure) -> tuple[ParameterTable, tuple[FreeParameter, ...]]:
    n_storeys = structure.n_storeys
    symbols = [p.symbol for p in structure.parameters]
    fixed = np.tile([p.neutral for p in structure.parameters], (n_storeys, 1))
    index = np.full(fixed.shape, -1, dtype=np.int64)
    free: list[FreeParameter] = []
    everywhere = tuple(range(1, n_storeys + 1))
    entries = [(p, structure.storey.values[p.symbol], everywhere) for p in structure.storey.parameters]
    for placed in structure.effects:
        entries += [(p, placed.effect.values[p.symbol], placed.storeys) for p in placed.effect.parameters]
    for parameter, value, storeys in entries:
        column = symbols.index(parameter.symbol)
        for name, one, where in _spread(parameter, value, storeys, n_storeys):
            rows = [s - 1 for s in where or everywhere]
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
    if isinstance(value, PerStorey) and not storeys:
        raise UserError(f"{symbol} belongs to the whole building: give one number or prior, not PerStorey")
    if isinstance(value, PerStorey):
        return [(f"{symbol}[{s}]", value.at(i, len(storeys)), (s,)) for i, s in enumerate(storeys)]
    if not isinstance(value, (Real, Prior)):
        raise UserError(f"{symbol} is {value!r}: give a number, a prior, or PerStorey of either")
    label = symbol if len(storeys) in (0, n_storeys) else f"{symbol}[{','.join(map(str, storeys))}]"
    return [(label, value, storeys)]


def _checked(parameter: Parameter, name: str, value: float) -> float:
    if not isinstance(value, Real):
        raise UserError(f"{name} is {value!r}: give a number")
    if isinstance(value, int) and abs(value) > sys.float_info.max:
        raise UserError(f"{name} is larger than any number of double precision")
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


def _constraints(
    structure: Structure, table: ParameterTable, free: tuple[FreeParameter, ...]
) -> tuple[Constraint, ...]:
    """The law's joint conditions that cut the prior at a storey; an error where known values already break one."""
    symbols = tuple(structure.law.symbols)
    result: dict[tuple[int, ...], Constraint] = {}
    for number, relation in enumerate(structure.conditions):
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
