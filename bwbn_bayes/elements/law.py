"""What a law is written in: symbols, the named slots that effects fill, and the law that comes of them.

The law is symbolic (SymPy). Inputs are drift ``u`` [m], drift rate ``v`` [m/s]; states are the hysteretic displacement
``z`` [m], the work on the hysteretic spring ``epsilon`` [J] and whatever effects add; outputs are the storey force [N]
and the rates of the states. :mod:`~bwbn_bayes.elements.combine` is the one place that knows how the slots combine;
every engine and every printed equation is derived from what it returns.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Protocol, cast

import sympy as sp

from bwbn_bayes.elements.signature import NO_SIGNATURE, Signature
from bwbn_bayes.parameters import Parameter, Value

DRIFT, DRIFT_RATE, HYSTERETIC_DISPLACEMENT, ENERGY = sp.symbols("u v z epsilon", real=True)
PATH = sp.Symbol("u_c", real=True)
"""Drift that has been gone through, ``du_c/dt = |v|``: a state of laws that depend on it. [m]"""
BENDING_DRIFT = sp.Symbol("u_b", real=True)
"""Drift of a storey less that of the one below, plus the same less that of each one above it. [m]"""

FLOOR_VELOCITY, FLOOR_ACCELERATION = sp.symbols("w_i a_i", real=True)
"""Of the floor above the storey: velocity relative to the ground [m/s], total acceleration [m/s^2]."""
TIME = sp.Symbol("t")
"""Since the record's start. [s]"""
MASS = sp.Symbol("m_i", positive=True)
"""Mass of the floor, its error included. [kg]"""
NET_FORCE, FIRST_FORCE = sp.symbols("F_net F_1", real=True)
"""On a floor from its links and from outside, and of the storeys that stand on the base. [N]"""
GROUND_ACCELERATION, RECORDED_ACCELERATION = sp.symbols("a_g a_rec", real=True)
"""Of the ground, and as the record has it: the same unless an effect says otherwise. [m/s^2]"""


def symbol(name: str) -> sp.Symbol:
    """The real SymPy symbol that stands for a parameter in every law."""
    return sp.Symbol(name, real=True)


FORCE = sp.Symbol("F", finite=True)
"""Subject of the storey force in a law's definitions."""


FLOOR_MASS, FLOOR_FORCE, READING = (sp.Symbol(name, finite=True) for name in ("M_i", "G_i", "y_i"))
"""Subjects of a floor's mass, of the further force on it and of its accelerometer's reading, in definitions."""


def rate_of(state: sp.Symbol) -> sp.Symbol:
    """Subject of a state's rate in a law's definitions."""
    return sp.Symbol(f"d{state.name}/dt", finite=True)


class off_zero(sp.Function):  # type: ignore[misc]  # noqa: N801  # SymPy has no types, and small letters
    """Its argument, which code moves off zero by less than rounding (:mod:`~bwbn_bayes.engines.codegen`).

    For a quotient that a storey does not use: where its divisor is zero it must still be a number.
    """

    nargs = 1

    def fdiff(self, argindex: int = 1) -> sp.Expr:
        """One: moving a value moves no slope."""
        return sp.Integer(1)

    def _numpycode(self, printer: Any) -> str:
        return f"({printer._print(self.args[0])})"


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
    """Where the law changes fast as a state moves by ``width``. Engines may refine their steps there.

    Attributes
    ----------
    state : Symbol
        A state, or :data:`TIME` of what is fast however little it moves.
    width : Expr
        Of parameters; infinite where nothing is fast.
    everywhere : bool
        Wherever the state is, as for those of a base, and for time; otherwise near its zero alone.
    """

    state: sp.Symbol
    width: sp.Expr
    everywhere: bool = False


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
    drift_taken_up: sp.Expr = sp.S.Zero
    """Drift lost in series with the springs, which see ``u`` less this. [m]"""
    drift_rate_share: sp.Expr = sp.S.One
    """Share of the drift rate that reaches the springs: one less the rate of ``drift_taken_up`` over ``v``."""
    hysteretic_factor: sp.Expr = sp.S.One
    """Multiplies the force of the hysteretic spring, and so the work on it."""
    added_force: sp.Expr = sp.S.Zero
    added_states: tuple[AddedState, ...] = ()
    increments: Mapping[sp.Symbol, sp.Expr] = field(default_factory=dict)
    """Added to a parameter wherever it stands in the law, joint admissibility conditions included."""
    events: tuple[Event, ...] = ()
    sharp_features: tuple[SharpFeature, ...] = ()
    constraints: tuple[sp.Basic, ...] = ()
    """Joint admissibility conditions on parameters, each monotone in every parameter."""
    steps: tuple[Definition, ...] = ()
    """Named steps that the other slots refer to by symbol (:func:`step`)."""
    mass_factor: sp.Expr = sp.S.One
    """Multiplies the mass of the floor."""
    floor_force: sp.Expr = sp.S.Zero
    """Added to the forces on the floor, of :data:`MASS`, :data:`FLOOR_VELOCITY`, floor states; linear in the mass."""
    floor_states: tuple[AddedState, ...] = ()
    """States of the floor; their rates may use :data:`FLOOR_ACCELERATION` and :data:`GROUND_ACCELERATION` too."""
    ground_factor: sp.Expr = sp.S.One
    """Multiplies the recorded ground acceleration."""
    base_states: tuple[AddedState, ...] = ()
    """States of what the building stands on, its displacement relative to the ground first; their rates are of these
    states, :data:`FIRST_FORCE` and :data:`GROUND_ACCELERATION`."""
    base_acceleration: sp.Expr = sp.S.Zero
    """Acceleration of the base relative to the ground."""
    initial: tuple[tuple[sp.Symbol, sp.Symbol], ...] = ()
    """States of a link that do not start at zero, each with the parameter that it starts at."""
    sensor_gain: sp.Expr = sp.S.One
    sensor_bias: sp.Expr = sp.S.Zero
    sensor_lag: sp.Expr = sp.S.Zero
    """A floor's accelerometer shows ``gain a(t - lag) + bias``."""

    @property
    def depends_on_pace(self) -> bool:
        """Whether a storey run through the same drifts at another pace shows other forces.

        It does not where every slot is a function of states and the sign of the drift rate, and states follow the
        drift: then slots stay as they are, and rates grow in proportion, as ``v`` is multiplied by a positive number.
        A change of ``c``, which stands beside ``v`` in the law, always does.
        """
        pace = sp.Symbol("pace", positive=True)
        fixed = (
            self.stiffness_factor, self.nu, self.eta, self.shape_bracket, self.rate_multiplier, self.slip_compliance,
            self.drift_taken_up, self.drift_rate_share, self.hysteretic_factor, self.added_force,
            *self.increments.values(),
            *(one.expression for one in self.steps),
            *(added.rate / DRIFT_RATE for added in self.added_states),
        )  # fmt: skip
        faster = [sp.expand(sp.sympify(one).xreplace({DRIFT_RATE: pace * DRIFT_RATE})) for one in fixed]
        in_time = bool(self.events) or symbol("c") in self.increments
        return in_time or any({pace, TIME} & one.free_symbols for one in faster)


class Addition(Protocol):
    """What adds to a law: a frozen dataclass that fills slots; at neutral values of its parameters it adds nothing."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters that it brings."""
        ...

    def fill(self, slots: Slots) -> Slots:
        """The slots with this added to them."""
        ...


class Effect(Addition, Protocol):
    """One physical effect: a frozen dataclass with one field, named by its symbol, for each of its parameters.

    Contract, tested over every registered effect: at the neutral values of its parameters it changes nothing
    (relative difference below 1e-12); it works in every engine, at one storey or all, together with every other
    effect; its derivatives agree with finite differences; an independent implementation in tests/ agrees.
    """

    level: ClassVar[str] = "link"
    """What it acts on: link (a storey), node (a floor), structure, excitation or observation."""

    elements: ClassVar[tuple[str, ...]] = ("bouc_wen", "hardening_bouc_wen", "linear", "friction_pendulum")
    """Names of the elements that it can act on, where it acts on a link."""
    makes: ClassVar[str] = ""
    """Name of the element that a link is once it has the effect, where it becomes another."""

    name: ClassVar[str]
    """Canonical name, as in the catalogue."""
    title: ClassVar[str] = ""
    """What engineers call it; its name with spaces where left out."""
    summary: ClassVar[str]
    """One line for people."""
    source: ClassVar[str]
    """Where the effect was defined."""
    residual: ClassVar[str]
    """What it leaves in the residual of a model without it."""
    confusable: ClassVar[str]
    """What it is hard to tell from."""

    @property
    def values(self) -> Mapping[str, Value]:
        """The value (number, prior or PerStorey) of each parameter, by symbol."""
        return {parameter.symbol: getattr(self, parameter.symbol) for parameter in self.parameters}

    @classmethod
    def neutral_forms(cls) -> tuple[Effect, ...]:
        """The effect at its neutral values, once for each form it has."""
        declared: object = cls.parameters
        if not isinstance(declared, tuple):
            raise NotImplementedError(f"{cls.__name__} computes its parameters: it must list its neutral forms itself")
        return (cls(**{parameter.symbol: parameter.neutral for parameter in declared}),)

    @property
    def form(self) -> str:
        """Which form of the effect this is, in a few words; empty where there is only one."""
        return ""

    @property
    def needs_time(self) -> bool:
        """Whether it depends on rate or time, so that it means nothing in a record without a time column.

        Found from what it fills in. What acts on floors, base, ground or their sensors exists in motion alone.
        """
        return self.level != "link" or self.fill(Slots()).depends_on_pace

    @property
    def is_an_event(self) -> bool:
        """Whether it happens at an instant, which a record counts from its beginning."""
        return bool(self.fill(Slots()).events)

    @property
    def moves_base(self) -> bool:
        """Whether it puts the building on something that moves; a law has one such effect."""
        return self.level == "structure" and bool(self.fill(Slots()).base_states)

    @property
    def bends(self) -> bool:
        """Whether it makes the force of a storey depend on the drifts of its neighbours."""
        return BENDING_DRIFT in self.fill(Slots()).added_force.free_symbols

    @property
    def mechanism(self) -> str:
        """What of a structure it is a law of, the effect itself where left out: no place has two laws of one."""
        return self.name

    @property
    def signature(self) -> Signature:
        """What the effect does in an engineer's measure, and from which size it deserves its name."""
        return NO_SIGNATURE


@dataclass(frozen=True, kw_only=True)
class BaseLaw:
    """What the first storey stands on, as expressions of base states, parameters and :data:`FIRST_FORCE`.

    ``acceleration`` is its total acceleration; it and the ``rates`` of the ``states`` also use
    :data:`RECORDED_ACCELERATION`. The first state is the displacement relative to the ground.
    """

    states: tuple[sp.Symbol, ...]
    rates: tuple[sp.Expr, ...]
    acceleration: sp.Expr


@dataclass(frozen=True, kw_only=True)
class SensorLaw:
    """What a floor's accelerometer shows: ``gain a(t - lag) + bias``, expressions of the parameters."""

    parameters: tuple[Parameter, ...]
    gain: sp.Expr
    bias: sp.Expr
    lag: sp.Expr

    @property
    def definitions(self) -> tuple[Definition, ...]:
        """The reading of the accelerometer, for printing; nothing where it shows the acceleration itself."""
        late = sp.Function(FLOOR_ACCELERATION.name)(TIME - self.lag)
        reading = self.gain * (late if self.lag != 0 else FLOOR_ACCELERATION) + self.bias
        if reading == FLOOR_ACCELERATION:
            return ()
        return (Definition(caption="shown by the accelerometer of a floor", subject=READING, expression=reading),)

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names of symbols that stand for nothing."""
        return _unknown([symbol(p.symbol) for p in self.parameters], (self.gain, self.bias, self.lag))


def _unknown(known: Iterable[sp.Symbol], expressions: Sequence[sp.Expr]) -> tuple[str, ...]:
    """Names, in order, of the symbols in expressions that are not among the known ones."""
    names = {one.name for one in known}
    found = {one.name for expression in expressions for one in expression.free_symbols}
    return tuple(sorted(found - names))


@dataclass(frozen=True, kw_only=True)
class StoreyLaw:
    """A storey's law as expressions of states and parameters.

    ``rates`` belong to ``states`` in order: hysteretic displacement, energy, then added states. ``force`` holds the
    damping force too, and may use :data:`BENDING_DRIFT`. ``definitions`` are the same law in named steps, for printing;
    the subjects :data:`FORCE` and :func:`rate_of` a state stand for the outputs. ``increments`` says which parameters
    change, and by how much.

    Effects may refer to the symbols that are ``derived`` from parameters as if they were parameters, and change them:
    ``force``, ``rates`` and ``constraints`` have them written out.

    The last ``n_floor_states`` states belong to the floor above the storey. Their rates, and the floor's total
    ``acceleration`` where it is not ``F_net / m_i``, may also use :data:`NET_FORCE`, :data:`MASS` and
    :data:`RECORDED_ACCELERATION`. ``base`` is left out where the first storey stands on the recorded ground.
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
    derived: tuple[Definition, ...] = ()
    n_floor_states: int = 0
    acceleration: sp.Expr | None = None
    base: BaseLaw | None = None
    initial: tuple[tuple[sp.Symbol, sp.Symbol], ...] = ()
    """States that do not start at zero, each with the parameter that it starts at."""
    n_of_element: int = 0
    """Parameters of the element itself, the first ones; the others are of what was added to it."""

    @property
    def bends(self) -> bool:
        """Whether the force of a storey depends on the drifts of its neighbours."""
        return BENDING_DRIFT in self.force.free_symbols

    @property
    def n_storey_states(self) -> int:
        """States of the storey itself."""
        return len(self.states) - self.n_floor_states

    @property
    def base_states(self) -> tuple[sp.Symbol, ...]:
        """States of the base, none where it is rigid."""
        return self.base.states if self.base is not None else ()

    @cached_property
    def unknown(self) -> tuple[str, ...]:
        """Names of symbols that stand for nothing where they are: looked for once, for all models of the law."""
        common = {*self.symbols, *(one.subject for one in self.derived), *(event.indicator for event in self.events)}
        n = self.n_storey_states
        own = {*common, DRIFT, DRIFT_RATE, *self.states[:n]}
        floor = {*common, *self.states[n:], NET_FORCE, MASS, RECORDED_ACCELERATION}
        base = {*common, *self.base_states, FIRST_FORCE, RECORDED_ACCELERATION}
        accelerations = () if self.acceleration is None else (self.acceleration,)
        parts = (
            ({*own, BENDING_DRIFT}, (self.force,)),
            (own, (*self.rates[:n], *(changed for changed, _ in self.increments))),
            (floor, (*self.rates[n:], *accelerations)),
            (base, (self.base.acceleration, *self.base.rates) if self.base is not None else ()),
        )
        return next((missing for known, told in parts if (missing := _unknown(known, told))), ())

    @cached_property
    def symbols(self) -> tuple[sp.Symbol, ...]:
        """The parameters' SymPy symbols, in order."""
        return tuple(symbol(parameter.symbol) for parameter in self.parameters)

    def derived_from[T](self, parameters: Mapping[str, T]) -> dict[str, T]:
        """The derived symbols by name from the parameters by symbol, numbers or arrays of one shape."""
        own = [parameters[one.name] for one in self.symbols]
        values: dict[str, Any] = {
            one.subject.name: sp.lambdify(self.symbols, one.expression, "numpy")(*own) for one in self.derived
        }
        nought = 0.0 * cast(Any, own[0])  # a number takes the shape of the parameters
        return {name: value + nought if isinstance(value, int) else value for name, value in values.items()}

    @cached_property
    def bare(self) -> tuple[sp.Expr, ...] | None:
        """Force of a link on which nothing acts but its element, and the rates of its two states.

        None where nothing else ever acts, or a floor asks for a state of what may act there.
        """
        spare = self.states[2 : self.n_storey_states]
        floor = (*self.rates[self.n_storey_states :], *([] if self.acceleration is None else [self.acceleration]))
        if not self.added or any(set(spare) & one.free_symbols for one in floor):
            return None
        absent: dict[sp.Expr, sp.Expr] = dict.fromkeys(spare, sp.S.Zero)
        added = zip(self.symbols[self.n_of_element :], self.parameters[self.n_of_element :], strict=True)
        absent |= {symbol: sp.nsimplify(parameter.neutral) for symbol, parameter in added}
        found = tuple(one.xreplace(absent) for one in (self.force, *self.rates[:2]))
        return None if any(one.has(sp.nan, sp.zoo, sp.oo) for one in found) else found

    @cached_property
    def added(self) -> tuple[int, ...]:
        """Positions of the parameters, not the element's own, of which a link's force or states are functions."""
        used = self.force.free_symbols.union(*(rate.free_symbols for rate in self.rates[: self.n_storey_states]))
        return tuple(i for i, own in enumerate(self.symbols) if i >= self.n_of_element and own in used)

    @cached_property
    def event_parameters(self) -> tuple[int, ...]:
        """For each event, the position of its time among the parameters."""
        return tuple(self.symbols.index(event.time) for event in self.events)

    @cached_property
    def changes(self) -> Mapping[str, sp.Expr]:
        """For each parameter or derived symbol that changes or differs, by how much, in parameters and :data:`TIME`.

        A change that depends on the motion is left out: it has no expression in time.
        """
        known = {*self.symbols, *(event.indicator for event in self.events)}
        elapsed = {event.indicator: sp.Max(TIME - event.time, 0) for event in self.events}
        happened = {event.indicator: sp.Heaviside(TIME - event.time, 1) for event in self.events}
        own = list(zip(self.states, self.rates, strict=True))[: self.n_storey_states]
        grown = {state: rate.xreplace(elapsed) for state, rate in own if rate.free_symbols <= known}
        written = {base.name: one.xreplace(grown).xreplace(happened) for base, one in self.increments}
        return {name: one for name, one in written.items() if one.free_symbols <= {TIME, *self.symbols}}
