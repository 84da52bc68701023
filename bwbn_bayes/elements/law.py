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
from typing import ClassVar, Protocol, Self

import sympy as sp

from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Parameter, Value

DRIFT, DRIFT_RATE, HYSTERETIC_DISPLACEMENT, ENERGY = sp.symbols("u v z epsilon", real=True)


def symbol(name: str) -> sp.Symbol:
    """The real SymPy symbol that stands for a parameter in every law."""
    return sp.Symbol(name, real=True)


FORCE = sp.Symbol("F", finite=True)
"""Subject of the storey force in a law's definitions."""


def rate_of(state: sp.Symbol) -> sp.Symbol:
    """Subject of a state's rate in a law's definitions."""
    return sp.Symbol(f"d{state.name}/dt", finite=True)


def step(name: str) -> sp.Symbol:
    """The symbol of a named step of a law, distinct from a parameter of the same name."""
    return sp.Symbol(name, finite=True)


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
class Definition:
    """One named step of a law: ``subject = expression``, where the expression may use earlier subjects."""

    caption: str
    subject: sp.Symbol
    expression: sp.Expr


@dataclass(frozen=True, kw_only=True)
class Slots:
    """What effects may fill in. Each slot holds its neutral value until an effect fills it."""

    stiffness_factor: sp.Expr = sp.S.One
    nu: sp.Expr = sp.S.One
    eta: sp.Expr = sp.S.One
    shape_bracket: sp.Expr = sp.S.Zero
    """Added to ``beta sgn(z v) + gamma``."""
    rate_multiplier: sp.Expr = sp.S.One
    """Multiplies the Bouc-Wen rate before the slip."""
    slip_compliance: sp.Expr = sp.S.Zero
    """Slip per unit of hysteretic displacement, ``s a(z)``."""
    added_force: sp.Expr = sp.S.Zero
    added_states: tuple[AddedState, ...] = ()
    increments: Mapping[sp.Symbol, sp.Expr] = field(default_factory=dict)
    """Added to a parameter wherever it stands in the law."""
    events: tuple[Event, ...] = ()
    sharp_features: tuple[SharpFeature, ...] = ()
    constraints: tuple[sp.Basic, ...] = ()
    """Joint admissibility conditions on parameters, each monotone in every parameter."""
    steps: tuple[Definition, ...] = ()
    """Named steps that the other slots refer to by symbol (:func:`step`)."""


class Effect(Protocol):
    """One physical effect: a frozen dataclass with one field, named by its symbol, for each of its parameters.

    Contract, tested over every registered effect: at the neutral values of its parameters it changes nothing
    (relative difference below 1e-12); it works in every engine, at one storey or all, together with every other
    effect; its derivatives agree with finite differences; an independent implementation in tests/ agrees.
    """

    level: ClassVar[str] = "link"
    """What it acts on: link (a storey), node (a floor), structure, excitation or observation."""

    name: ClassVar[str]
    """Canonical name, as in the catalogue."""
    summary: ClassVar[str]
    """One line for people."""
    source: ClassVar[str]
    """Where the effect was defined."""
    residual: ClassVar[str]
    """What it leaves in the residual of a model without it."""
    confusable: ClassVar[str]
    """What it is hard to tell from."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters the effect brings."""
        ...

    @property
    def values(self) -> Mapping[str, Value]:
        """The value (number, prior or PerStorey) of each parameter, by symbol."""
        return {parameter.symbol: getattr(self, parameter.symbol) for parameter in self.parameters}

    @classmethod
    def neutral_forms(cls) -> tuple[Self, ...]:
        """The effect at its neutral values, once for each form it has."""
        declared: object = cls.parameters
        if not isinstance(declared, tuple):
            raise NotImplementedError(f"{cls.__name__} computes its parameters: it must list its neutral forms itself")
        return (cls(**{parameter.symbol: parameter.neutral for parameter in declared}),)

    def fill(self, slots: Slots) -> Slots:
        """The slots with this effect added to them."""
        ...


@dataclass(frozen=True, kw_only=True)
class StoreyLaw:
    """A storey's law as expressions of states and parameters.

    ``rates`` belong to ``states`` in order: hysteretic displacement, energy, then added states. ``force`` holds the
    damping force too. ``definitions`` are the same law in named steps, for printing; the subjects :data:`FORCE` and
    :func:`rate_of` a state stand for the outputs. ``increments`` says which parameters change, and by how much.
    """

    parameters: tuple[Parameter, ...]
    states: tuple[sp.Symbol, ...]
    force: sp.Expr
    rates: tuple[sp.Expr, ...]
    events: tuple[Event, ...]
    sharp_features: tuple[SharpFeature, ...]
    constraints: tuple[sp.Basic, ...]
    definitions: tuple[Definition, ...]
    increments: tuple[tuple[sp.Symbol, sp.Expr], ...]

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
    definitions = _definitions(slots)
    outputs = expanded(definitions)
    f, eta, slip = outputs[step("f")], slots.eta.xreplace(outputs), slots.slip_compliance.xreplace(outputs)
    # The same rate as f v / (1 + slip f), with one division.
    outputs[rate_of(HYSTERETIC_DISPLACEMENT)] = f * eta * DRIFT_RATE / (eta + slip * f * eta)
    raised = {old: old + increment for old, increment in slots.increments.items()}
    states = (HYSTERETIC_DISPLACEMENT, ENERGY, *(added.state for added in slots.added_states))
    return StoreyLaw(
        parameters=parameters,
        states=states,
        force=outputs[FORCE].subs(raised),
        rates=tuple(outputs[rate_of(state)].subs(raised) for state in states),
        events=slots.events,
        sharp_features=slots.sharp_features,
        constraints=constraints + slots.constraints,
        definitions=definitions,
        increments=tuple(slots.increments.items()),
    )


def expanded(definitions: tuple[Definition, ...]) -> dict[sp.Symbol, sp.Expr]:
    """Each subject as an expression of states and parameters alone: every earlier step is written out."""
    result: dict[sp.Symbol, sp.Expr] = {}
    for definition in definitions:
        if definition.subject in result:
            raise UserError(f"two effects of the model name a step {definition.subject}: rename one of them")
        result[definition.subject] = definition.expression.xreplace(result)
    return result


def _definitions(slots: Slots) -> tuple[Definition, ...]:
    """The law in named steps; a slot that no effect fills leaves no step."""
    u, v, z = DRIFT, DRIFT_RATE, HYSTERETIC_DISPLACEMENT
    k, c, alpha, A, beta, gamma, n = (symbol(s) for s in ("k", "c", "alpha", "A", "beta", "gamma", "n"))
    steps = list(slots.steps)

    def named(name: str, caption: str, value: sp.Expr) -> sp.Expr:
        if value.is_number:
            return value
        steps.append(Definition(caption=caption, subject=step(name), expression=value))
        return step(name)

    stiffness = k * named("kappa", "stiffness factor", slots.stiffness_factor)
    nu = named("nu", "strength degradation", slots.nu)
    eta = named("eta", "stiffness degradation", slots.eta)
    multiplier = named("h", "pinching", slots.rate_multiplier)
    bracket = beta * sp.sign(z * v) + gamma + slots.shape_bracket
    f = named("f", "slope of the hysteretic displacement", multiplier * (A - nu * sp.Abs(z) ** n * bracket) / eta)
    outputs = [
        ("rate of the hysteretic displacement", rate_of(z), f * v / (1 + slots.slip_compliance * f)),
        ("rate of the work on the hysteretic spring", rate_of(ENERGY), (1 - alpha) * stiffness * z * v),
        *((f"rate of {added.state}", rate_of(added.state), added.rate) for added in slots.added_states),
        ("storey force", FORCE, alpha * stiffness * u + (1 - alpha) * stiffness * z + c * v + slots.added_force),
    ]
    return (*steps, *(Definition(caption=caption, subject=s, expression=e) for caption, s, e in outputs))
