"""Contract 1: at its neutral values an effect changes nothing, alone or beside every other."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
import sympy as sp
from laboratory import FREE, FURTHER_LOSSES, building, nrmse, shaking, solve, storey

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.catalogue import registered
from bwbn_bayes.elements.combine import combine
from bwbn_bayes.elements.effects import SuddenDamage
from bwbn_bayes.elements.friction_pendulum import FrictionPendulum
from bwbn_bayes.elements.law import DRIFT, DRIFT_RATE, Addition, Effect, Slots, StoreyLaw
from bwbn_bayes.elements.linear import Linear
from bwbn_bayes.engines.codegen import derivatives
from bwbn_bayes.structures.shear_building import ShearBuilding

USUAL = [form for kind in registered() if kind.level == "link" for form in kind.neutral_forms()]
FORMS = [*USUAL, *FREE, *FrictionPendulum.adds]
DEGRADING = tuple(form for form in USUAL if form.name in {"stiffness_degradation", "strength_degradation", "slip_lock"})
"""What jumps of their parameters need beside them."""
N_STATES = 500
PLAIN = BoucWen(k=1.0, beta=1.0, gamma=0.0)


def label(form: Addition) -> str:
    return "-".join((type(form).__name__.strip("_"), *(p.symbol for p in form.parameters)))


@cache
def law_of(effects: tuple[Addition, ...], base: BoucWen | Linear = PLAIN) -> StoreyLaw:
    return combine(base.parameters, base.constraints, effects, base.derived)


def base_of(form: Addition) -> BoucWen | Linear:
    """What the effect can act on; what an element adds is part of every link's law."""
    return PLAIN if "bouc_wen" in getattr(form, "elements", ["bouc_wen"]) else Linear(k=1.0)


def evaluate(law: StoreyLaw, neutral: tuple[Addition, ...]) -> np.ndarray:
    """Force and rates at random states and parameters, the same for every law; parameters of ``neutral`` stay so.

    Each symbol has its own random stream, so that a symbol takes the same values in every law it stands in.
    """
    held = {p.symbol: p.neutral for effect in neutral for p in effect.parameters}
    held |= dict.fromkeys(resting(neutral), 0.0)

    def values(s: sp.Symbol) -> np.ndarray:
        return np.full(N_STATES, held[s.name]) if s.name in held else random_values(s.name)

    symbols, function = compiled(law)
    return np.array([np.broadcast_to(one, N_STATES) for one in function(*(values(s) for s in symbols))])


@cache
def compiled(law: StoreyLaw) -> tuple[tuple[sp.Symbol, ...], Callable[..., tuple[np.ndarray, ...]]]:
    """What force and rates are functions of, and the function."""
    symbols = (DRIFT, DRIFT_RATE, *law.states, *law.symbols, *(event.indicator for event in law.events))
    return symbols, sp.lambdify(symbols, (law.force, *law.rates[:2]), "numpy")


def random_values(name: str) -> np.ndarray:
    rng = np.random.default_rng([ord(letter) for letter in name])
    return rng.uniform(0.2, 0.9, N_STATES) * (rng.choice([-1.0, 1.0], N_STATES) if name in "uvz" else 1.0)


def resting(neutral: tuple[Addition, ...]) -> list[str]:
    """The added states that start at zero and, at neutral parameters, stay there."""
    law = law_of(neutral)
    at_neutral = {p.symbol: p.neutral for effect in neutral for p in effect.parameters}
    values = {
        s: at_neutral.get(s.name, 0.7)
        for s in (DRIFT, *law.symbols, *law.states, *(event.indicator for event in law.events))
    }
    values |= dict.fromkeys(law.states[2:], 0.0)
    states = zip(law.states[2:], law.rates[2:], strict=True)
    return [s.name for s, rate in states if all(rate.subs({**values, DRIFT_RATE: v}) == 0 for v in (-0.7, 0.7))]


def companions(form: Addition) -> tuple[Effect, ...]:
    """Every form of every effect but this one and jumps of its parameters, which belong to it."""
    own = {p.symbol for p in form.parameters}
    return tuple(
        other
        for other in (*USUAL, *FREE)
        if not own & {p.symbol for p in other.parameters}
        and "bouc_wen" in other.elements
        and not (isinstance(other, SuddenDamage) and other.parameter in own)
    )


@pytest.mark.parametrize("form", FORMS, ids=label)
def test_neutral_changes_nothing_alone(form):
    plain, extended = (evaluate(law_of(effects, base_of(form)), effects) for effects in ((), (form,)))
    np.testing.assert_allclose(extended, plain, rtol=1e-12)


@pytest.mark.parametrize("form", FORMS, ids=label)
def test_neutral_changes_nothing_beside_the_others(form):
    others = companions(form)
    without, extended = (evaluate(law_of((*others, *own), base_of(form)), own) for own in ((), (form,)))
    # What cancels to a millionth of its parts is rounded like them.
    np.testing.assert_allclose(extended, without, rtol=1e-12, atol=1e-15 * np.max(np.abs(without)))


@pytest.mark.parametrize("form", FORMS, ids=label)
def test_away_from_neutral_it_changes_something(form):
    others = () if not isinstance(form, SuddenDamage) else companions(form)
    law = law_of((*others, form), base_of(form))
    assert not np.allclose(evaluate(law, ()), evaluate(law, (form,)), rtol=1e-3)


@pytest.mark.parametrize("form", FORMS, ids=label)
def test_derivatives_are_those_of_finite_differences(form):
    """Of force and rates with respect to drift, drift rate, states and the effect's parameters, almost everywhere."""
    others = () if not isinstance(form, SuddenDamage) else DEGRADING
    law = law_of((*others, form), base_of(form))
    own = {p.symbol for p in form.parameters}
    symbols = (DRIFT, DRIFT_RATE, *law.states, *law.symbols, *(event.indicator for event in law.events))
    variables = [s for s in symbols if s.name in own or s in (DRIFT, DRIFT_RATE, *law.states)]
    values = {s: random_values(s.name) for s in symbols}
    for output in (law.force, *law.rates):
        compute = sp.lambdify(symbols, output, "numpy")
        # What derivatives share is written once: printing them one by one took most of the test's time.
        slopes = sp.lambdify(symbols, derivatives(output, variables), "numpy", cse=True)(*values.values())
        for variable, slope in zip(variables, slopes, strict=True):
            step = 1e-6
            ends = [compute(*(values[s] + side * step * (s == variable) for s in symbols)) for side in (1.0, -1.0)]
            difference = (ends[0] - ends[1]) / (2.0 * step)
            # A kink within the step of a random point spoils it there.
            assert np.mean(np.abs(difference - slope) > 1e-5 * (1.0 + np.abs(slope))) < 0.005, (output, variable)


def test_neutral_effects_leave_the_response_as_it_is():
    plain = ShearBuilding(masses=[1.0, 1.0], storey=storey())
    extended = building(2, {})
    channels = ["acceleration_1", "acceleration_2", "hysteretic_energy_1"]
    before, after = solve(plain, shaking(), channels, 2), solve(extended, shaking(), channels, 2)
    for channel in channels:
        assert nrmse(after[channel], before[channel]) < 1e-12


def test_the_order_of_composition_does_not_matter():
    values = {"delta_nu": 0.3, "delta_s": 0.05, "sigma": 0.05}
    forward = building(1, values)
    backward = ShearBuilding(masses=[1.0], storey=storey())
    # The jump of delta_nu comes last in both: it needs the effect it belongs to.
    for placed in [*reversed(forward.effects[:4]), *forward.effects[4:]]:
        backward = backward.with_effect(placed.effect, placed.storeys)
    assert forward.law == backward.law
    response = [solve(m, shaking(), ["acceleration_1"], 1)["acceleration_1"] for m in (forward, backward)]
    np.testing.assert_array_equal(*response)


def test_what_was_used_can_be_sent_to_another_process():
    """Losses held functions that could not be pickled, once they had been asked for anything."""
    forms = [form for effect_class in registered() for form in effect_class.neutral_forms()]
    assert len(forms) > len(FURTHER_LOSSES)
    for form in forms:
        filled = form.fill(Slots())
        sent = pickle.loads(pickle.dumps(form))
        assert (sent, sent.form, sent.fill(Slots())) == (form, form.form, filled)
