"""How the slots of a law combine: the storey's physics in named steps, and the floor, base and sensors around it.

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
from dataclasses import replace

import sympy as sp

from bwbn_bayes.elements.law import (
    DRIFT,
    DRIFT_RATE,
    ENERGY,
    FLOOR_ACCELERATION,
    FLOOR_FORCE,
    FLOOR_MASS,
    FLOOR_VELOCITY,
    FORCE,
    GROUND_ACCELERATION,
    HYSTERETIC_DISPLACEMENT,
    MASS,
    NET_FORCE,
    PATH,
    RECORDED_ACCELERATION,
    AddedState,
    Addition,
    BaseLaw,
    Definition,
    Effect,
    SensorLaw,
    Slots,
    StoreyLaw,
    rate_of,
    step,
    symbol,
)
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Parameter


def combine(
    parameters: tuple[Parameter, ...],
    constraints: tuple[sp.Basic, ...],
    effects: tuple[Addition, ...],
    derived: tuple[Definition, ...] = (),
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
    effects : tuple of Addition
        What elements add, then effects, in the order in which they were added.
    derived : tuple of Definition
        Symbols of the storey's physics that the element's parameters stand for, such as ``beta`` and ``gamma``.
    """
    # Discovery builds hundreds of models with few laws.
    key = parameters, constraints, derived, tuple(map(kind_of, effects))
    law = _COMBINED.get(key)
    if law is None:
        slots = Slots()
        for effect in effects:
            below = slots.base_states
            slots = effect.fill(slots)
            if below and slots.base_states != below:
                raise UserError("two effects of the model put the building on a base that moves: leave one of them out")
        own = tuple(parameter for effect in effects for parameter in effect.parameters)
        law = _COMBINED[key] = _law_of(parameters + own, len(parameters), constraints, derived, slots)
    return law


def kind_of(effect: Addition) -> tuple[object, ...]:
    """What effects have in common that share their expressions: class, parameters, and fields that are no parameters.

    An effect whose fields are not its symbols has its options in the symbols.
    """
    own = set(getattr(effect, "__dataclass_fields__", ()))
    symbols = {parameter.symbol for parameter in effect.parameters}
    options = sorted(own - symbols) if symbols <= own else []
    return type(effect), effect.parameters, tuple((name, repr(getattr(effect, name))) for name in options)


_COMBINED: dict[tuple[object, ...], StoreyLaw] = {}
"""Laws by element and kinds of effects: an effect's expressions are of its symbols, not of its values."""


def _law_of(
    parameters: tuple[Parameter, ...],
    n_of_element: int,
    constraints: tuple[sp.Basic, ...],
    derived: tuple[Definition, ...],
    slots: Slots,
) -> StoreyLaw:
    slots = with_path(_with_floor_velocity(slots))
    definitions = (*_definitions(slots), *surroundings(slots))
    increments = dict(slots.increments)
    # A derived symbol has no place of its own in the law: what changes it joins its definition.
    changed = tuple(replace(one, expression=one.expression + increments.pop(one.subject, 0)) for one in derived)
    outputs = expanded((*changed, *definitions))
    f, eta, slip = outputs[step("f")], slots.eta.xreplace(outputs), slots.slip_compliance.xreplace(outputs)
    # The same rate as f v / (1 + slip f), with one division.
    rate = DRIFT_RATE * slots.drift_rate_share.xreplace(outputs)
    outputs[rate_of(HYSTERETIC_DISPLACEMENT)] = f * eta * rate / (eta + slip * f * eta)
    raised = {old: old + increment.xreplace(outputs) for old, increment in increments.items()}
    not_yet = (*(event.indicator for event in slots.events), *(added.state for added in slots.added_states))
    before_events = dict.fromkeys(not_yet, sp.S.Zero)
    offsets = {old: grown.xreplace(before_events) for old, grown in raised.items()}
    spelled_out = {one.subject: outputs[one.subject].xreplace(before_events) for one in derived}
    own = (HYSTERETIC_DISPLACEMENT, ENERGY, *(added.state for added in slots.added_states))
    outputs.setdefault(GROUND_ACCELERATION, RECORDED_ACCELERATION)
    acceleration = _floor_acceleration(slots, outputs)
    known = {one.subject: one.expression for one in derived if one.expression.is_number}
    shown = [one for one in derived if one.subject in slots.increments or one.subject not in known]
    known = {subject: value for subject, value in known.items() if subject not in slots.increments}
    written = [replace(one, expression=one.expression.xreplace(known)) for one in definitions]
    # A link without a hysteretic spring is told without its states.
    is_linear = not {HYSTERETIC_DISPLACEMENT, ENERGY} & outputs[FORCE].free_symbols
    idle = {step("f"), rate_of(HYSTERETIC_DISPLACEMENT), rate_of(ENERGY)} if is_linear and known else set()
    shown += [one for one in written if one.subject not in idle]
    shown += [_at_first(state, parameter) for state, parameter in slots.initial]
    return StoreyLaw(
        parameters=parameters,
        states=(*own, *(added.state for added in slots.floor_states)),
        force=outputs[FORCE].xreplace(raised),
        rates=(
            *(outputs[rate_of(state)].xreplace(raised) for state in own),
            *_floor_rates(slots, acceleration, outputs),
        ),
        events=slots.events,
        sharp_features=tuple(replace(one, width=one.width.xreplace(outputs)) for one in slots.sharp_features),
        constraints=tuple(_spelled_out(one, spelled_out).xreplace(offsets) for one in constraints + slots.constraints),
        definitions=tuple(shown),
        increments=tuple(slots.increments.items()),
        derived=derived,
        n_floor_states=len(slots.floor_states),
        acceleration=acceleration,
        base=_base_law(slots, outputs),
        initial=slots.initial,
        n_of_element=n_of_element,
    )


def _at_first(state: sp.Symbol, parameter: sp.Symbol) -> Definition:
    caption = f"{state} at the first sample"
    return Definition(caption=caption, subject=sp.Symbol(f"{state}(0)", finite=True), expression=parameter)


def _spelled_out(constraint: sp.Basic, derived: Mapping[sp.Symbol, sp.Expr]) -> sp.Basic:
    if not derived:
        return constraint
    if isinstance(constraint, sp.Or):
        return sp.Or(*(_spelled_out(one, derived) for one in constraint.args))
    # Multiplied out, so that a sum such as beta + gamma is left without what cancels in it.
    return sp.expand_mul(constraint.xreplace(derived))


def _definitions(slots: Slots) -> tuple[Definition, ...]:
    """The law in named steps; a slot that no effect fills leaves no step."""
    v, z = DRIFT_RATE, HYSTERETIC_DISPLACEMENT
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
    u = DRIFT - named("u_p", "drift taken up before the springs", slots.drift_taken_up)
    rate = v * named("chi", "share of the drift rate that reaches the springs", slots.drift_rate_share)
    bracket = beta * sp.sign(z * v) + gamma + slots.shape_bracket
    hysteretic = (1 - alpha) * stiffness * named("H", "factor on the hysteretic spring", slots.hysteretic_factor)
    f = named("f", "slope of the hysteretic displacement", multiplier * (A - nu * sp.Abs(z) ** n * bracket) / eta)
    outputs = [
        ("rate of the hysteretic displacement", rate_of(z), f * rate / (1 + slots.slip_compliance * f)),
        ("rate of the work on the hysteretic spring", rate_of(ENERGY), hysteretic * z * rate),
        *((f"rate of {added.state}", rate_of(added.state), added.rate) for added in slots.added_states),
        ("storey force", FORCE, alpha * stiffness * u + hysteretic * z + c * v + slots.added_force),
    ]
    return (*steps, *(Definition(caption=caption, subject=s, expression=e) for caption, s, e in outputs))


def combine_sensors(effects: tuple[Effect, ...]) -> SensorLaw:
    """Combine the effects that act on the measured accelerations."""
    slots = Slots()
    for effect in effects:
        slots = effect.fill(slots)
    return sensor_law(slots, tuple(parameter for effect in effects for parameter in effect.parameters))


def sensor_law(slots: Slots, parameters: tuple[Parameter, ...]) -> SensorLaw:
    """What the slots say of the accelerometers."""
    return SensorLaw(parameters=parameters, gain=slots.sensor_gain, bias=slots.sensor_bias, lag=slots.sensor_lag)


def with_path(slots: Slots) -> Slots:
    """The path as a state, where something in the law of a link depends on it: one for all effects that do."""
    every = [*vars(slots).values(), *slots.increments.values(), *(one.expression for one in slots.steps)]
    every += [added.rate for added in slots.added_states]
    if not any(PATH in one.free_symbols for one in every if isinstance(one, sp.Basic)):
        return slots
    return replace(slots, added_states=(*slots.added_states, AddedState(state=PATH, rate=sp.Abs(DRIFT_RATE))))


def _with_floor_velocity(slots: Slots) -> Slots:
    """The floor's velocity as a state of its own, where something depends on it: so storeys stay independent."""
    wanted = [slots.floor_force, *(added.rate for added in slots.floor_states)]
    if not any(FLOOR_VELOCITY in expression.free_symbols for expression in wanted):
        return slots
    velocity = AddedState(state=FLOOR_VELOCITY, rate=FLOOR_ACCELERATION - GROUND_ACCELERATION)
    return replace(slots, floor_states=(velocity, *slots.floor_states))


_Steps = dict[sp.Symbol, sp.Expr]


def _floor_acceleration(slots: Slots, steps: _Steps) -> sp.Expr | None:
    """Total acceleration of a floor, None where it is ``F_net / m_i`` and no floor state needs it."""
    if slots.mass_factor == 1 and slots.floor_force == 0 and not slots.floor_states:
        return None
    forces = (NET_FORCE, *sp.Add.make_args(slots.floor_force))
    # Term by term: the mass cancels where a force is proportional to it.
    per_mass = sp.Add(*(force / MASS for force in forces))
    return per_mass.xreplace({MASS: MASS * slots.mass_factor}).xreplace(steps)


def _floor_rates(slots: Slots, acceleration: sp.Expr | None, steps: _Steps) -> tuple[sp.Expr, ...]:
    resolved = steps if acceleration is None else {**steps, FLOOR_ACCELERATION: acceleration}
    return tuple(added.rate.xreplace(resolved) for added in slots.floor_states)


def _base_law(slots: Slots, steps: _Steps) -> BaseLaw | None:
    if not slots.base_states and slots.ground_factor == 1:
        return None
    return BaseLaw(
        states=tuple(added.state for added in slots.base_states),
        rates=tuple(added.rate.xreplace(steps) for added in slots.base_states),
        acceleration=(slots.base_acceleration + GROUND_ACCELERATION).xreplace(steps),
    )


def surroundings(slots: Slots) -> tuple[Definition, ...]:
    """The laws of floor, base and ground in named steps, for printing; the motion of the floor is written apart."""
    steps = []
    if slots.ground_factor != 1:
        recorded = slots.ground_factor * RECORDED_ACCELERATION
        steps.append(Definition(caption="ground, from the record", subject=GROUND_ACCELERATION, expression=recorded))
    if slots.mass_factor != 1:
        steps.append(Definition(caption="mass of the floor", subject=FLOOR_MASS, expression=MASS * slots.mass_factor))
    if slots.floor_force != 0:
        mass = FLOOR_MASS if slots.mass_factor != 1 else MASS
        force = slots.floor_force.xreplace({MASS: mass})
        steps.append(Definition(caption="further force on the floor", subject=FLOOR_FORCE, expression=force))
    return (
        *steps,
        *(
            Definition(caption=f"rate of {added.state}", subject=rate_of(added.state), expression=added.rate)
            for added in (*slots.floor_states, *slots.base_states)
        ),
    )


def expanded(definitions: tuple[Definition, ...]) -> dict[sp.Symbol, sp.Expr]:
    """Each subject as an expression of states and parameters alone: every earlier step is written out."""
    result: dict[sp.Symbol, sp.Expr] = {}
    for definition in definitions:
        if definition.subject in result:
            raise UserError(f"two effects of the model name a step {definition.subject}: rename one of them")
        result[definition.subject] = definition.expression.xreplace(result)
    return result
