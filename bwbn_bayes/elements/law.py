"""The named slots of a storey's law and the one place that knows how they combine.

The law is symbolic (SymPy). Inputs are drift ``u`` [m], drift rate ``v`` [m/s]; states are the hysteretic
displacement ``z`` [m], the work on the hysteretic spring ``epsilon`` [J] and whatever effects add; outputs are the
storey force [N] and the rates of the states. Every engine and every printed equation is derived from it.

References
----------
.. [1] T. T. Baber and M. N. Noori, "Random Vibration of Degrading, Pinching Systems", J. Eng. Mech. 111(8), 1985,
   doi:10.1061/(ASCE)0733-9399(1985)111:8(1010).
.. [2] Y. Zhao et al., "A Comparison of Three Different Methods for the Identification of Hysterically Degrading
   Structures Using BWBN Model", 2019, doi:10.3389/fbuil.2018.00080 (eqs. 1 to 7; eq. 3's denominator is eta, and
   eq. 5 lost its integral: here ``d epsilon/dt = (1 - alpha) k z v``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, Protocol

import sympy as sp

from bwbn_bayes.parameters import Parameter, Value

DRIFT, DRIFT_RATE, HYSTERETIC_DISPLACEMENT, ENERGY = sp.symbols("u v z epsilon", real=True)


def symbol(name: str) -> sp.Symbol:
    """The real SymPy symbol that stands for a parameter in every law."""
    return sp.Symbol(name, real=True)


@dataclass(frozen=True, kw_only=True)
class Event:
    """A switch from 0 to 1 at a parameter's time: engines split the step there.

    ``time`` is the symbol of the time parameter [s]; ``indicator`` stands for 0 before it and 1 from it on.
    """

    time: sp.Symbol
    indicator: sp.Symbol


@dataclass(frozen=True, kw_only=True)
class AddedState:
    """A state an effect adds to a storey: starts at zero, follows ``rate``."""

    state: sp.Symbol
    rate: sp.Expr


@dataclass(frozen=True, kw_only=True)
class SharpFeature:
    """Where the law changes fast: within ``width`` of a state's zero. Engines may refine their steps there."""

    state: sp.Symbol
    width: sp.Expr


@dataclass(frozen=True, kw_only=True)
class Slots:
    """What effects may fill in. Each slot holds its neutral value until an effect fills it."""

    stiffness_factor: sp.Expr = sp.Integer(1)
    nu: sp.Expr = sp.Integer(1)
    eta: sp.Expr = sp.Integer(1)
    shape_bracket: sp.Expr = sp.Integer(0)
    """Added to ``beta sgn(z v) + gamma``."""
    rate_multiplier: sp.Expr = sp.Integer(1)
    """Multiplies the Bouc-Wen rate before the slip."""
    slip_compliance: sp.Expr = sp.Integer(0)
    """``s a(z)``: slip per unit of hysteretic displacement."""
    added_force: sp.Expr = sp.Integer(0)
    added_states: tuple[AddedState, ...] = ()
    increments: Mapping[sp.Symbol, sp.Expr] = field(default_factory=dict)
    """Added to a parameter wherever it stands in the law."""
    events: tuple[Event, ...] = ()
    sharp_features: tuple[SharpFeature, ...] = ()


class Effect(Protocol):
    """One physical effect: a frozen dataclass with one field, named by its symbol, for each of its parameters.

    Contract, tested over every registered effect: at the neutral values of its parameters it changes nothing
    (relative difference below 1e-12); it works in every engine, at one storey or all, together with every other
    effect; its derivatives agree with finite differences; an independent implementation in tests/ agrees.
    """

    name: ClassVar[str]
    """Canonical name, as in the catalogue."""
    summary: ClassVar[str]
    """One line for people."""
    source: ClassVar[str]
    """Where the effect was defined."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters the effect brings."""
        ...

    @property
    def values(self) -> Mapping[str, Value]:
        """The value (number, prior or PerStorey) of each parameter, by symbol."""
        return {parameter.symbol: getattr(self, parameter.symbol) for parameter in self.parameters}

    def fill(self, slots: Slots) -> Slots:
        """The slots with this effect added to them."""
        ...


@dataclass(frozen=True, kw_only=True)
class StoreyLaw:
    """A storey's law as expressions of states and parameters.

    ``rates`` belong to ``states`` in order: hysteretic displacement, energy, then added states. ``force`` holds the
    damping force too. ``definitions`` are the named intermediate expressions for printing.
    """

    parameters: tuple[Parameter, ...]
    states: tuple[sp.Symbol, ...]
    force: sp.Expr
    rates: tuple[sp.Expr, ...]
    events: tuple[Event, ...]
    sharp_features: tuple[SharpFeature, ...]
    constraints: tuple[sp.Basic, ...]
    definitions: tuple[tuple[str, sp.Expr], ...]

    @cached_property
    def symbols(self) -> tuple[sp.Symbol, ...]:
        """The parameters' SymPy symbols, in order."""
        return tuple(symbol(parameter.symbol) for parameter in self.parameters)

    @cached_property
    def event_parameters(self) -> tuple[int, ...]:
        """For each event, the position of its time among the parameters."""
        return tuple(self.symbols.index(event.time) for event in self.events)


def combine(
    parameters: tuple[Parameter, ...], constraints: tuple[sp.Basic, ...], effects: tuple[Effect, ...]
) -> StoreyLaw:
    """Combine the Bouc-Wen storey with effects, in the one order that holds everywhere.

    The stiffness factor scales both springs; nu and eta degrade strength and stiffness; the rate multiplier acts on
    the Bouc-Wen rate before the series slip, which solves ``u = u1 + u2`` exactly: ``dz/dt = f v / (1 + s a(z) f)``.

    Parameters
    ----------
    parameters : tuple of Parameter
        The element's own parameters (:class:`~bwbn_bayes.elements.bouc_wen.BoucWen`).
    constraints : tuple of SymPy relationals
        Joint admissibility conditions of the element.
    effects : tuple of Effect
        In the order in which they were added.
    """
    slots = Slots()
    for effect in effects:
        slots = effect.fill(slots)
        parameters = parameters + effect.parameters
    u, v, z = DRIFT, DRIFT_RATE, HYSTERETIC_DISPLACEMENT
    k, c, alpha, A, beta, gamma, n = (symbol(s) for s in ("k", "c", "alpha", "A", "beta", "gamma", "n"))
    stiffness = k * slots.stiffness_factor
    bracket = beta * sp.sign(z * v) + gamma + slots.shape_bracket
    numerator = slots.rate_multiplier * (A - slots.nu * sp.Abs(z) ** n * bracket)
    z_rate = numerator * v / (slots.eta + slots.slip_compliance * numerator)
    force = alpha * stiffness * u + (1 - alpha) * stiffness * z + c * v + slots.added_force
    energy_rate = (1 - alpha) * stiffness * z * v
    definitions = (
        ("nu", slots.nu),
        ("eta", slots.eta),
        ("f", numerator / slots.eta),
        ("slip", slots.slip_compliance),
        ("F", force),
        ("z_rate", z_rate),
        ("energy_rate", energy_rate),
    )
    raised = {old: old + increment for old, increment in slots.increments.items()}
    return StoreyLaw(
        parameters=parameters,
        states=(z, ENERGY, *(added.state for added in slots.added_states)),
        force=force.subs(raised),
        rates=tuple(r.subs(raised) for r in (z_rate, energy_rate, *(added.rate for added in slots.added_states))),
        events=slots.events,
        sharp_features=slots.sharp_features,
        constraints=constraints,
        definitions=tuple((name, expression.subs(raised)) for name, expression in definitions),
    )
