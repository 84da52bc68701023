"""Which effects depend on rate or time: specimens run through one path at two paces, and what the law's symbols say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
import sympy as sp
from laboratory import NO_DRAW, cyclic_test, having, storey

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.catalogue import registered
from bwbn_bayes.elements.combine import combine
from bwbn_bayes.elements.effects import SlipLock, StiffnessDegradation, StrengthDegradation, SuddenDamage
from bwbn_bayes.elements.law import DRIFT, DRIFT_RATE, TIME, AddedState, Effect, Slots, symbol
from bwbn_bayes.elements.linear import Linear
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.parameters import Parameter, Value
from bwbn_bayes.structures.specimen import Specimen

FORMS = [form for kind in registered() for form in kind.neutral_forms()]
PLAIN = BoucWen(k=1.0, beta=1.0, gamma=0.0)
AT_STOREYS = [form for form in FORMS if form.level == "link"]
PATH = [0.3, -0.25, 0.5, -0.55, 0.6]
SIZES = {
    "delta_eta": 0.3, "eta_inf": 0.8, "p_eta": 1.5, "delta_nu": 0.4, "nu_inf": 1.0, "p_nu": 1.5,
    "theta_eta": 0.3, "theta_nu": 0.4, "F_v": 0.5, "p_v": 0.5, "v_v": 1.0,
    "eta_a": 0.5, "s_eta": 0.8, "q_eta": 1.5, "N_eta": 6.0, "u_eta": 0.4,
    "nu_a": 0.6, "s_nu": 1.6, "q_nu": 0.7, "N_nu": 6.0, "u_nu": 0.4,
    "r_h": 0.8, "beta_h": 1.0, "gamma_h": 0.5, "n_h": 1.3, "x_h": 0.3,
    "delta_s": 0.1, "sigma": 0.05,
    "zeta_s": 0.8, "p": 2.0, "q": 0.2, "psi_0": 0.1, "delta_psi": 0.01, "lambda_": 0.3,
    "phi": 0.8, "phi_uv": 1.0, "u_uv": 0.05, "phi_u": -1.0, "u_u": 0.05, "b": 0.06, "w": 0.02, "b_0": 0.06, "w_0": 0.02,
    "F_c": 0.5, "v0": 0.3, "F_ratio": 0.5, "v_ratio": 0.3, "F_root": 0.5, "v_root": 0.3, "F_dahl": 0.5, "x_dahl": 0.05,
    "k3": 2.0, "c2": 0.2, "k_g": 5.0, "g": 0.3, "k_gp": 5.0, "g_p": 0.3, "k_gn": 5.0, "g_n": 0.3, "k_m": 2.0,
    "k_geo": 1.0, "tau": 0.3, "alpha_offset": 0.1, "beta_offset": 1.0, "gamma_offset": -1.0, "n_offset": 0.4,
    **{f"{parameter}_{kind}": size for kind in ("jump", "ramp") for parameter, size in
       (("k", -4.0), ("c", 0.5), ("alpha", 0.2), ("delta_nu", 1.0), ("delta_eta", 1.0), ("delta_s", 0.2))},
    **{f"{parameter}{kind}_time": 1.1 for kind in ("", "_ramp") for parameter in
       ("k", "c", "alpha", "delta_nu", "delta_eta", "delta_s")},
}  # fmt: skip
"""Sizes that move the force by more than a hundredth of its peak; a ramp lasts a second."""

CHANGES = tuple(form for form in AT_STOREYS if isinstance(form, SuddenDamage))
CARRIERS = (
    StrengthDegradation(delta_nu=0.1), StiffnessDegradation(delta_eta=0.1), SlipLock(delta_s=0.02, sigma=0.05)
)  # fmt: skip
YIELDING = tuple(form for form in AT_STOREYS if form.elements == ("linear",))
LAWS = (
    tuple(form for form in AT_STOREYS if form not in (*CHANGES, *YIELDING)),
    (*CARRIERS, *CHANGES),
    YIELDING,
)
"""Few laws and so few kernels for all forms, which stand at neutral values but for the one that is tried; what changes
is kept with the effects whose parameters change, and what makes a linear link yield is tried on one."""


def label(form: Effect) -> str:
    return f"{form.name} {form.form}"


@cache
def forces(law: tuple[Effect, ...], acting: Effect | None, pace: float) -> np.ndarray:
    """Force of an undamped specimen along the path, at so many times the usual pace, in N."""
    record = cyclic_test(PATH, 10, time_step=0.04 / pace)
    model = Specimen(storey=Linear(k=10.0, c=0.0) if law == YIELDING else storey(c=0.0))
    for form in law:
        model = model.with_effect(having(form, SIZES) if form == acting else form)
    return Reference(rtol=1e-8).simulate(model, NO_DRAW, record, ["force"]).values[0, 0]


@pytest.mark.parametrize("form", AT_STOREYS, ids=label)
def test_the_law_says_so(form):
    """Force and rates at random states, at a drift rate and at three times it, without the damper of the storey."""
    beside = CARRIERS if form in CHANGES else ()
    law = combine(PLAIN.parameters, PLAIN.constraints, (*beside, form))
    symbols = (DRIFT_RATE, DRIFT, *law.states, *law.symbols, *(event.indicator for event in law.events))
    compute = sp.lambdify(symbols, (law.force, *law.rates), ["scipy", "numpy"])
    rng = np.random.default_rng(25)
    signs = rng.choice([-1.0, 1.0], (3, 200))
    values = {s.name: rng.uniform(0.2, 0.9, 200) for s in symbols} | {"c": np.zeros(200)}
    values |= {name: sign * values[name] for name, sign in zip("uvz", signs, strict=True)}
    slow, fast = (
        np.array(np.broadcast_arrays(*compute(pace * values["v"], *(values[s.name] for s in symbols[1:]))))
        for pace in (1.0, 3.0)
    )
    follows = np.allclose(fast, slow * np.array([1.0, *[3.0] * len(law.rates)])[:, None], rtol=1e-10)
    assert form.needs_time == (bool(law.events) or not follows)


@pytest.mark.slow
@pytest.mark.parametrize("form", AT_STOREYS, ids=label)
def test_a_law_that_needs_no_time_has_one_loop_at_every_pace(form):
    law = next(law for law in LAWS if form in law)
    slow, fast, without = forces(law, form, 0.5), forces(law, form, 2.0), forces(law, None, 0.5)
    peak = np.max(np.abs(slow))
    assert np.max(np.abs(slow - without)) > 0.01 * peak
    moved = np.max(np.abs(fast - slow)) / peak
    assert moved > 0.005 if form.needs_time else moved < 1e-5, moved


def test_what_acts_on_floors_ground_and_sensors_needs_time():
    assert all(form.needs_time for form in FORMS if form.level != "link")


def test_the_effects_of_a_record_without_time():
    """Written out by hand, so that no change of a law moves an effect from one side to the other unseen."""
    static = {form.name for form in AT_STOREYS if not form.needs_time}
    assert static == {
        "asymmetry", "backlash", "coulomb_friction", "cubic_stiffness", "foliente_pinching", "gap_impact", "hysteresis",
        "p_delta", "slip_lock", "stiffness_degradation", "storey_parameter", "strength_degradation",
    }  # fmt: skip
    assert [f.form for f in AT_STOREYS if f.name == "coulomb_friction" and not f.needs_time] == ["sticking (Dahl)"]


@dataclass(frozen=True, kw_only=True)
class Own(Effect):
    """A user's effect that fills one slot."""

    slots: Slots
    own: Value = 1.0
    name = "own"
    parameters = (Parameter(symbol="own", unit="", neutral=0.0),)

    def fill(self, slots: Slots) -> Slots:
        return self.slots


OWN, STATE = symbol("own"), symbol("own_state")
FILLED: Mapping[str, tuple[Slots, bool]] = {
    "a damper": (Slots(added_force=OWN * DRIFT_RATE), True),
    "a spring": (Slots(added_force=OWN * symbol("u")), False),
    "a clock": (Slots(stiffness_factor=1 - OWN * TIME), True),
    "more damping": (Slots(increments={symbol("c"): OWN}), True),
    "a stiffer spring": (Slots(increments={symbol("k"): OWN}), False),
    "a state that relaxes": (Slots(added_states=(AddedState(state=STATE, rate=DRIFT_RATE - STATE),)), True),
    "a state that follows": (Slots(added_states=(AddedState(state=STATE, rate=OWN * DRIFT_RATE),)), False),
    "path travelled": (Slots(added_states=(AddedState(state=STATE, rate=abs(DRIFT_RATE)),)), False),
}


@pytest.mark.parametrize("case", FILLED)
def test_a_users_effect_need_not_say_so(case):
    slots, needs_time = FILLED[case]
    assert Own(slots=slots).needs_time == needs_time
    assert replace(Own(slots=slots), own=2.0).needs_time == needs_time
