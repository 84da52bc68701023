"""A structure: masses at nodes, links that join them, effects placed on either, and the table of its parameters.

Nodes count from 1, and 0 is the ground, or the base where an effect brings one. The first links carry the nodes: link i
ends at node i and stands on a lower one. Further links may join any two nodes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise
from numbers import Integral, Real
from operator import index
from typing import Any, Self

import numpy as np
import sympy as sp

from bwbn_bayes.elements.bouc_wen import ShortStrides
from bwbn_bayes.elements.combine import combine, combine_sensors, kind_of
from bwbn_bayes.elements.element import Element, common_element
from bwbn_bayes.elements.law import Addition, Effect, SensorLaw, StoreyLaw
from bwbn_bayes.errors import UserError, require_kind
from bwbn_bayes.parameters import (
    Floats,
    FreeParameter,
    Parameter,
    ParameterSpace,
    PerStorey,
    Prior,
    Value,
    is_list,
    is_number,
)
from bwbn_bayes.records.record import ExcitationKind
from bwbn_bayes.structures.assembly import ParameterTable, assemble, check_symbols, checked, constraints, spread
from bwbn_bayes.structures.parts import SPECIMEN, Links, PlacedEffect

GROUND = 0
"""The node that every chain of links begins at."""


@dataclass(frozen=True, kw_only=True)
class Structure:
    """Masses that move sideways, ``m_i (x_i'' + a_g) = f_i + sum of the links' forces``, x relative to the ground.

    It starts at rest; ``a_g`` and the forces ``f_i`` from outside are linear between samples. Floor i measures the
    total acceleration ``x_i'' + a_g``. :func:`~bwbn_bayes.structures.shear_building.ShearBuilding`,
    :func:`~bwbn_bayes.structures.oscillator.Oscillator` and :func:`~bwbn_bayes.structures.specimen.Specimen` make the
    common ones.

    Parameters
    ----------
    masses : sequence of float
        Of nodes 1, 2 and so on; none where the displacement of the only link is given. [kg]
    links : tuple of Links
        All links in order; the first of them carry the nodes.
    excitation_kind : {"ground_acceleration", "displacement"}
        Whether the ground moves and forces act on the nodes, or the displacement of the only link is given.
    heights : sequence of float, optional
        Storey heights from the ground up; with them drifts are told as ratios too. [m]
    effects : tuple of PlacedEffect
        Use :meth:`with_effect` rather than this field.
    carried : tuple of Effect
        Kinds of effects that the law has although none may be placed: they stay neutral and bring no identified
        parameter. Models with the same kinds, placed or carried, share one law and one compiled kernel.

    Raises
    ------
    UserError
        If a mass or a height is not positive, the heights are not one per storey, a link joins no two nodes, the links
        do not carry the nodes in order, or a value lies outside its admissible range.
    """

    masses: Sequence[float]
    links: tuple[Links, ...]
    excitation_kind: ExcitationKind = "ground_acceleration"
    heights: Sequence[float] | None = None
    effects: tuple[PlacedEffect, ...] = ()
    carried: tuple[Effect, ...] = ()

    def __post_init__(self) -> None:
        """Build the table once, so that every mistake shows where the model is written."""
        masses = _positive(self.masses) if self.is_driven else masses_of(self.masses)
        object.__setattr__(self, "masses", masses)
        if self.heights is not None:
            heights = _positive(self.heights)
            if len(heights) != len(masses):
                raise UserError(
                    f"heights = {self.heights!r}: give a list with one positive number of m for each of the "
                    f"{len(masses)} storeys, or leave them out"
                )
            object.__setattr__(self, "heights", heights)
        _check_joints(self)
        _check_places(self)
        _ = self.space

    def __getstate__(self) -> dict[str, object]:
        """Its fields: laws and compiled conditions are made again from them sooner than they are sent."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    @property
    def joints(self) -> tuple[tuple[int, int], ...]:
        """The nodes that each link joins: the one that it stands on, the one where it ends."""
        return tuple(pair for group in self.links for pair in group.joins)

    @property
    def n_links(self) -> int:
        """Number of links: storeys, then those that carry no node."""
        return len(self.joints)

    @property
    def n_floors(self) -> int:
        """Number of nodes with a mass."""
        return len(self.masses)

    @property
    def is_chain(self) -> bool:
        """Whether every link is a storey between a floor and the one below."""
        return self.joints == tuple((i, i + 1) for i in range(self.n_floors))

    def link_in_words(self, link: int) -> str:
        """``storey 2``; of a link that carries no floor the nodes that it joins, of a testing machine its specimen."""
        if self.is_driven:
            return SPECIMEN
        if link <= self.n_floors:
            return f"storey {link}"
        return " to ".join(f"floor {node}" if node else "ground" for node in self.joints[link - 1])

    @property
    def runs_on_from(self) -> tuple[int, ...]:
        """For each link the one (from 1) that carries the node it stands on; 0 on the ground and beside storeys."""
        return tuple(lower if link <= self.n_floors else 0 for link, (lower, _) in enumerate(self.joints, 1))

    @property
    def is_driven(self) -> bool:
        """Whether the displacement of the only link is given: a specimen in a testing machine."""
        return self.excitation_kind == "displacement"

    def with_link(self, element: Element, *, joins: tuple[int, int]) -> Self:
        """A new structure with one more link, a brace past a floor say.

        Parameters
        ----------
        element : Element
            Its law.
        joins : (int, int)
            The node that it stands on (0 is the ground) and the one where it ends.

        Raises
        ------
        UserError
            If it does not join two nodes of the structure, or its law does not go with those of the other links.
        """
        return replace(self, links=(*self.links, Links(element=element, joins=(joins,))))

    def links_below(self, node: int) -> tuple[int, ...]:
        """Links (from 1) on the way from the ground up to a node, whose drifts add up to its displacement."""
        way: list[int] = []
        while node != GROUND:
            way.append(node)
            node = self.joints[node - 1][0]
        return tuple(reversed(way))

    def element_of(self, link: int) -> str:
        """Name of the element that a link (from 1) is, once its effects are counted in."""
        placed = [one.effect.makes for one in self.effects if link in one.storeys and one.effect.makes]
        return placed[-1] if placed else self.elements[link - 1].name

    @cached_property
    def elements(self) -> tuple[Element, ...]:
        """The element of each link."""
        return tuple(group.element for group in self.links for _ in group.joins)

    @cached_property
    def element(self) -> Element:
        """The element in whose parameters the law of all links is written."""
        return common_element([group.element for group in self.links])

    def places_of(self, effect: Effect) -> tuple[int, ...]:
        """Links or floors (from 1) that an effect can act on; none where it acts on the whole structure."""
        if effect.level in WHOLE_BUILDING:
            return ()
        if effect.level != "link":
            return tuple(range(1, self.n_floors + 1))
        return tuple(i for i in range(1, self.n_links + 1) if self.element_of(i) in effect.elements)

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
            if effect.bends and not any(self.runs_on_from):
                raise UserError(f"{effect.name} acts between storeys: the model has none that stands on another")
            if others:
                raise UserError(f"{effect.name} already acts on the building: place it once")
            return replace(self, effects=(*self.effects, PlacedEffect(effect=effect, storeys=())))
        placed = self._placed(effect, storeys)
        for other in others:
            shared = sorted(set(placed) & set(other.storeys))
            if shared:
                raise UserError(f"{effect.name} already acts on storey {shared}: place each effect once per storey")
        return replace(self, effects=(*self.effects, PlacedEffect(effect=effect, storeys=placed)))

    def _placed(self, effect: Effect, storeys: Sequence[int] | None) -> tuple[int, ...]:
        """The links or floors that an effect is to act on, once they are found to be such."""
        if isinstance(storeys, (Integral, str)):
            raise UserError(f"{effect.name}: storeys is {storeys!r}, it must be a list such as [{storeys}]")
        if self.is_driven and effect.level != "link":
            raise UserError(f"{effect.name} {_NOT_OF_SPECIMENS}")
        possible, n_places = self.places_of(effect), self.n_links if effect.level == "link" else self.n_floors
        given = possible if storeys is None else storeys
        told = f"must be numbers from 1 to {n_places} in increasing order"
        try:
            placed = tuple(map(index, given))
        except TypeError:
            raise UserError(f"{effect.name}: storeys {list(given)} {told}") from None
        wrong = [s for s in placed if not 1 <= s <= n_places]
        if wrong or any(b <= a for a, b in pairwise(placed)) or (storeys is not None and not placed):
            raise UserError(f"{effect.name}: storeys {list(placed)} {told}")
        if not placed:
            raise UserError(f"{effect.name} acts on {' or '.join(effect.elements)} links, of which the model has none")
        return placed

    def with_values(self, values: Mapping[str, float | Prior]) -> Self:
        """A new structure with other numbers or priors behind labels of its parameters, e.g. ``{"A": 1.0}``.

        Raises
        ------
        UserError
            If the structure has no parameter of that name.
        """
        labels: set[str] = set()

        def changed(parameter: Parameter, value: Value, storeys: tuple[int, ...]) -> Value:
            pieces = spread(parameter, value, storeys, self.n_links)
            labels.update(name for name, _, _ in pieces)
            own = [values.get(name, one) for name, one, _ in pieces]
            return PerStorey(own) if isinstance(value, PerStorey) else own[0]

        groups, first = [], 1
        for group in self.links:
            where, element = tuple(range(first, first + len(group.joins))), group.element
            own = {p.symbol: changed(p, element.values[p.symbol], where) for p in element.parameters}
            groups.append(replace(group, element=replace(element, **own)))  # type: ignore[type-var]
            first += len(group.joins)
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
        return replace(self, links=tuple(groups), effects=tuple(effects))

    def _kinds(self, effects: tuple[Effect, ...], *, of_sensors: bool) -> tuple[Effect, ...]:
        """One effect of each kind, in an order that does not depend on how they came."""
        kinds: dict[tuple[str, ...], Effect] = {}
        for effect in effects:
            if self.is_driven and effect.level != "link":
                raise UserError(f"{effect.name} {_NOT_OF_SPECIMENS}")
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
        check_symbols(law, self.sensors)
        return law

    def _law_with(self, effects: tuple[Effect, ...]) -> StoreyLaw:
        kinds = self._kinds(effects, of_sensors=False)
        added = tuple(dict.fromkeys(more for group in self.links for more in self._adds(group.element)))
        return combine(self.element.parameters, self.element.constraints, (*added, *kinds), self.element.derived)

    def _adds(self, element: Element) -> tuple[Addition, ...]:
        """What a link adds to the law of the Bouc-Wen link in this structure."""
        return (*element.adds, ShortStrides()) if self.is_driven else element.adds

    @property
    def kinds_of_links(self) -> tuple[tuple[int, ...], ...]:
        """Links (from 1) of one kind of element each, whatever their values."""
        kinds: dict[tuple[object, ...], list[int]] = {}
        for link, one in enumerate(self.elements, 1):
            kinds.setdefault((one.parameters, one.derived, *map(kind_of, one.adds)), []).append(link)
        return tuple(map(tuple, kinds.values()))

    def law_of(self, links: Sequence[int]) -> StoreyLaw:
        """The law of links of one kind, in their element's own parameters, with the effects that act on any of them."""
        element = self.elements[links[0] - 1]
        placed = (one for one in self.effects if one.effect.level != "link" or set(links) & set(one.storeys))
        kinds = self._kinds(tuple(one.effect for one in placed), of_sensors=False)
        return combine(element.parameters, element.constraints, (*self._adds(element), *kinds), element.derived)

    @cached_property
    def bare(self) -> tuple[bool, ...]:
        """Of each link, whether nothing acts on it but its element: what other links have is neutral there."""
        added = list(self.law.added)
        neutral = [self.law.parameters[i].neutral for i in added]
        known = (self.table.index[:, added] < 0) & (self.table.fixed[:, added] == neutral)
        return tuple(np.all(known, axis=1).tolist())

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
        return assemble(self.links, self.effects, self.parameters)

    @property
    def table(self) -> ParameterTable:
        """Where each link's parameters come from."""
        return self._assembly[0]

    @cached_property
    def space(self) -> ParameterSpace:
        """The identified parameters with their joint prior."""
        table, free = self._assembly
        joint = constraints(self.conditions, tuple(self.law.symbols), table, free)
        return ParameterSpace(parameters=free, constraints=joint)

    def draws(self, values: Mapping[str, float]) -> Floats:
        """One draw ``(1, n_parameters)`` from named values, e.g. ``{"k[1]": 20.0, "alpha": 0.01}``."""
        require_kind("values of parameters", values, Mapping, 'give a number for each label, as in {"k[1]": 20.0}')
        missing = [name for name in self.space.names if name not in values]
        unknown = [str(name) for name in values if name not in self.space.names]
        if missing or unknown:
            wrong = [f"{', '.join(missing)} missing"] if missing else []
            wrong += [f"{', '.join(unknown)} not identified (fixed in the model, or unknown)"] if unknown else []
            identified = ", ".join(self.space.names) or "nothing"
            raise UserError(f"values of parameters: {'; '.join(wrong)}; the model identifies {identified}")
        known = {parameter.symbol: parameter for parameter in self.parameters}
        return np.array([[checked(known[one.symbol], one.name, values[one.name]) for one in self.space.parameters]])

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is allowed but worth knowing, in sentences."""
        symbols = {p.symbol for p in self.element.parameters}
        if "rho" in symbols:
            admits = any(ratio < 0.5 for ratio in self._ends("rho", 0))
        else:
            admits = "gamma" in symbols and any(
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

_NOT_OF_SPECIMENS = (
    "acts on floors, their sensors or the ground, which a specimen does not have: use a ShearBuilding or leave it out"
)

WHOLE_BUILDING = ("structure", "excitation")
"""Levels of effects that have no place among storeys and floors."""


_LEAST = 1e-30
"""Of a mass or a height, and one over the most: both are numbers of single precision."""


def masses_of(given: object) -> tuple[float, ...]:
    """Masses [kg] as they were given, as numbers.

    Raises
    ------
    UserError
        If they are no list of positive numbers.
    """
    masses = _positive(given)
    if not masses:
        raise UserError(f"masses = {given!r}: give a list with one positive number of kg for each storey")
    return masses


def _positive(given: Any) -> tuple[float, ...]:
    """The numbers of a list, none where one of them is no positive number."""
    values = tuple(given) if is_list(given) else ()
    return tuple(map(float, values)) if all(is_number(one) and _LEAST < one < 1.0 / _LEAST for one in values) else ()


def require_structure(given: object) -> None:
    """Raise :class:`UserError` unless what is given for a model is a structure."""
    advice = "give a structure, such as ShearBuilding, Oscillator or Specimen make, or the `model` of a model file"
    require_kind("model", given, Structure, advice)


def _check_joints(structure: Structure) -> None:
    """Links join nodes that exist, and the first of them carry the nodes in order."""
    if structure.is_driven:
        if structure.joints != ((GROUND, 1),) or structure.masses:
            raise UserError("a given displacement drives one link from node 0 to node 1, without masses: use Specimen")
        return
    n = structure.n_floors
    for number, pair in enumerate(structure.joints, 1):
        if len(list(pair)) != 2 or not set(pair) <= set(range(n + 1)):
            raise UserError(f"link {number} joins {pair}: give two nodes from 0, the ground, to {n}")
        if pair[0] == pair[1]:
            raise UserError(f"link {number} joins node {pair[0]} with itself: give two different nodes")
        if pair[1] == GROUND:
            raise UserError(f"link {number} ends on the ground: write the ground first, (0, {pair[0]})")
        if number <= n and not (pair[1] == number and pair[0] < number):
            raise UserError(
                f"link {number} joins {pair}: the first {n} links carry nodes 1 to {n} in this order, each from a "
                f"lower node or the ground, such as ({number - 1}, {number}); put other links after them"
            )
    if structure.n_links < n:
        raise UserError(
            f"{structure.n_links} links for {n} masses: every node needs one that carries it, see node "
            f"{structure.n_links + 1}"
        )


def _check_places(structure: Structure) -> None:
    """Effects on links act on elements that they are made for."""
    for placed in structure.effects:
        effect = placed.effect
        for link in placed.storeys if effect.level == "link" else ():
            if not {structure.element_of(link), structure.elements[link - 1].name} & {*effect.elements}:
                raise UserError(
                    f"{effect.name} acts on {' or '.join(effect.elements)} links: storey {link} of the model is "
                    f"{structure.element_of(link)}, leave it out there"
                )


def _field_of(effect: Effect, name: str) -> str:
    """The field behind a parameter: of its name, or else the one that holds its value."""
    own = [one.name for one in fields(effect)]  # type: ignore[arg-type]
    held = [name] if name in own else [one for one in own if _stands_for(effect, one, name)]
    if len(held) != 1:
        raise UserError(f"{effect.name}: which field stands for {name} cannot be told; name a field {name}")
    return held[0]


def _stands_for(effect: Effect, field: str, name: str) -> bool:
    """Whether a parameter moves with a field: two fields may well hold one number."""
    value = getattr(effect, field)
    if isinstance(value, (bool, str)) or not isinstance(value, (Real, Prior, PerStorey)):
        return False
    moved = float(value) * (1.0 + 1e-6) + 1e-9 if isinstance(value, Real) else copy(value)
    try:
        return replace(effect, **{field: moved}).values[name] is moved  # type: ignore[type-var]
    except (UserError, TypeError, ValueError):  # an option, whose other values are others altogether
        return False
