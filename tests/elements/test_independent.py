"""Contract 4: every registered effect agrees with an implementation that shares no code with ours."""

from __future__ import annotations

import math
from dataclasses import replace

import independent
import numpy as np
import pytest
from laboratory import (
    NO_DRAW,
    OTHER_FORMS,
    building,
    cyclic_test,
    having,
    nrmse,
    shaking,
    solve,
    storey,
    with_others,
)

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.catalogue import registered
from bwbn_bayes.elements.effects import Backlash, MaxwellBranch, StrengthDegradation
from bwbn_bayes.elements.law import ENERGY, Slots, symbol
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen

CHANNELS = ("acceleration", "drift", "hysteretic_displacement", "hysteretic_energy")
JUMP_TIME = 2.513

# Sizes that change the response by much more than the tolerance; base sizes a jump needs stand beside it.
VALUES = {
    "stiffness_degradation": {"delta_eta": 0.4},
    "strength_degradation": {"delta_nu": 0.4},
    "slip_lock": {"delta_s": 0.05, "sigma": 0.05},
    "foliente_pinching": {
        "zeta_s": 0.8,
        "p": 0.5,
        "q": 0.2,
        "psi_0": 0.1,
        "delta_psi": 0.01,
        "lambda_": 0.3,
    },
    "sudden_damage": {"delta_nu": 0.1, "k_jump": -4.0, "delta_nu_jump": 1.2},
}
OTHERS = {
    "asymmetry": {"phi": 0.8},
    "asymmetry, sgn u sgn v": {"phi_uv": 1.0, "u_uv": 0.05},
    "asymmetry, sgn u": {"phi_u": -1.0, "u_u": 0.05},
    "backlash": {"b": 0.06, "w": 0.02},
    "backlash, slack": {"b_0": 0.05, "w_0": 0.02},
    "coulomb_friction": {"F_c": 0.5, "v0": 0.1},
    "coulomb_friction, ratio": {"F_ratio": 0.5, "v_ratio": 0.1},
    "coulomb_friction, root": {"F_root": 0.5, "v_root": 0.1},
    "coulomb_friction, dahl": {"F_dahl": 0.5, "x_dahl": 0.05},
    "cubic_stiffness": {"k3": -0.4},
    "gap_impact": {"k_g": 15.0, "g": 0.3},
    "gap_impact, positive": {"k_gp": 15.0, "g_p": 0.3},
    "gap_impact, negative": {"k_gn": 15.0, "g_n": 0.3},
    "maxwell_branch": {"k_m": 2.0, "tau": 0.3},
    "p_delta": {"k_geo": 0.7},
    "quadratic_damping": {"c2": 0.2},
    "stiffness_degradation, amplitude": {"eta_a": 0.8, "s_eta": 0.8, "q_eta": 1.5, "N_eta": 4.0, "u_eta": 0.4},
    "stiffness_degradation, path": {"theta_eta": 0.3},
    "stiffness_degradation, saturating": {"eta_inf": 1.2, "p_eta": 0.6},
    "strength_degradation, amplitude": {"nu_a": 0.9, "s_nu": 1.6, "q_nu": 0.6, "N_nu": 4.0, "u_nu": 0.4},
    "strength_degradation, path": {"theta_nu": 0.3},
    "strength_degradation, saturating": {"nu_inf": 1.5, "p_nu": 0.4},
    "storey_parameter": {"beta_offset": 1.0, "gamma_offset": -1.5, "n_offset": 0.4, "alpha_offset": 0.05},
    "viscous_damper": {"F_v": 0.5, "p_v": 0.6, "v_v": 1.3},
    "sudden_damage, ramp": {"k_ramp": -4.0, "k_ramp_time": 1.513, "k_ramp_duration": 2.1},
}
"""The same for the effects of ``OTHER_FORMS``."""

TOLERANCE = 5e-7
"""Of the NRMSE: RK4 at 1/1600 s meets the kinks of sgn at second order."""


def channels(n_storeys: int) -> list[str]:
    return [f"{kind}_{i + 1}" for kind in CHANNELS for i in range(n_storeys)]


def theirs(values: dict[str, float], n_storeys: int, where: int) -> dict[str, np.ndarray]:
    record = shaking()
    parameters = [values if i + 1 == where else {} for i in range(n_storeys)]
    solution = independent.respond(parameters, [1.0] * n_storeys, record.excitation, record.time_step, JUMP_TIME)
    return {f"{kind}_{i + 1}": solution[kind][i] for kind in CHANNELS for i in range(n_storeys)}


def ours(values: dict[str, float], n_storeys: int, where: int) -> dict[str, np.ndarray]:
    times = {"k_time": JUMP_TIME, "delta_nu_time": JUMP_TIME}
    model = building(n_storeys, {**values, **times}, storeys=[where])
    return solve(model, shaking(), channels(n_storeys), substeps=64)


def test_every_registered_effect_has_an_independent_check():
    link = {effect.name for effect in registered() if effect.level == "link"}
    # Hysteresis makes a linear link a Bouc-Wen link: tests/structures/test_topology.py.
    assert link - {"hysteresis"} == {name.split(",")[0] for name in (*VALUES, *OTHERS)}
    tried = {symbol for values in OTHERS.values() for symbol in values}
    assert tried == {parameter.symbol for form in OTHER_FORMS for parameter in form.parameters}


@pytest.mark.parametrize(("n_storeys", "where"), [(1, 1), (2, 2)])
@pytest.mark.parametrize("name", VALUES)
def test_agrees_with_the_independent_implementation(name, n_storeys, where):
    mine, other = ours(VALUES[name], n_storeys, where), theirs(VALUES[name], n_storeys, where)
    errors = {channel: nrmse(mine[channel], other[channel]) for channel in mine}
    assert max(errors.values()) < TOLERANCE, errors


@pytest.mark.parametrize("name", VALUES)
def test_the_effect_matters_in_this_comparison(name):
    without = ours({}, 1, 1)
    assert nrmse(ours(VALUES[name], 1, 1)["acceleration_1"], without["acceleration_1"]) > 1e3 * TOLERANCE


def differences(values: dict[str, float], n_storeys: int, where: int) -> dict[str, float]:
    """NRMSE of each channel between the reference engine and the independent code, over three seconds."""
    record = shaking(3.0)
    model = with_others(ShearBuilding(masses=[1.0] * n_storeys, storey=storey()), values, [where])
    mine = Reference(rtol=1e-11).simulate(model, NO_DRAW, record, channels(n_storeys)).values[0]
    parameters = [values if i + 1 == where else {} for i in range(n_storeys)]
    other = independent.respond(parameters, [1.0] * n_storeys, record.excitation, record.time_step)
    rows = [other[kind][i] for kind in CHANNELS for i in range(n_storeys)]
    return {name: nrmse(*pair) for name, *pair in zip(channels(n_storeys), mine, rows, strict=True)}


@pytest.mark.parametrize("name", OTHERS)
def test_the_other_effects_agree_with_the_independent_implementation(name):
    errors = differences(OTHERS[name], 1, 1)
    assert max(errors.values()) < TOLERANCE, errors


@pytest.mark.parametrize("where", [1, 2])
def test_the_other_effects_agree_together(where):
    # No link has both kinds of play.
    rows = [row for name, row in OTHERS.items() if name != "backlash, slack"]
    values = {symbol: size for row in rows for symbol, size in row.items()}
    values |= {"phi": 0.2, "phi_uv": 0.3, "phi_u": -0.2}
    errors = differences(values, 2, where)
    assert max(errors.values()) < TOLERANCE, errors


@pytest.mark.parametrize("name", OTHERS)
def test_the_other_effects_matter_in_this_comparison(name):
    record = shaking(3.0)
    plain = ShearBuilding(masses=[1.0], storey=storey())
    with_it, without = (
        Reference(rtol=1e-8).simulate(with_others(plain, values), NO_DRAW, record, ["acceleration_1"]).values[0, 0]
        for values in (OTHERS[name], {})
    )
    assert nrmse(with_it, without) > 1e3 * TOLERANCE


def play(drift: np.ndarray, half_width: float) -> np.ndarray:
    """What moves behind a play: the exact operator, sample by sample along a path that is monotonic between them."""
    behind = np.zeros_like(drift)
    for j in range(1, len(drift)):
        behind[j] = min(max(behind[j - 1], drift[j] - half_width), drift[j] + half_width)
    return behind


def with_play_and_branch(element: BoucWen, **values: float) -> Specimen:
    """A specimen that has both effects, neutral where no value is given."""
    model = Specimen(storey=element)
    for form in (Backlash(b=0.0, w=1.0), MaxwellBranch(k_m=0.0, tau=1.0)):
        model = model.with_effect(having(form, values))
    return model


def test_backlash_tends_to_the_play_operator():
    """A specimen behind a play moves as one that is driven by the exact operator's output, to within the width w."""
    record = cyclic_test([0.6, -0.5, 0.75, 0.1, 0.4, -0.8], 400)
    plain = with_play_and_branch(storey(c=0.0))
    inner = Record(
        name="behind the play",
        time_step=record.time_step,
        excitation=play(record.excitation, 0.05),
        excitation_kind="displacement",
    )
    exact = Reference(rtol=1e-9).simulate(plain, NO_DRAW, inner, ["force"]).values[0, 0]
    errors = []
    for width in (0.004, 0.001):
        behind = with_play_and_branch(storey(c=0.0), b=0.05, w=width)
        errors.append(nrmse(Reference(rtol=1e-9).simulate(behind, NO_DRAW, record, ["force"]).values[0, 0], exact))
    assert errors[1] < 3e-3
    assert errors[1] < 0.5 * errors[0]


def test_a_maxwell_branch_relaxes_and_creeps_as_the_closed_form_says():
    """Under a constant rate v: q = k_m tau v (1 - exp(-t/tau)), then exp(-t/tau) at rest."""
    record = cyclic_test([0.5, 0.5], 200, time_step=0.005)
    branch = with_play_and_branch(BoucWen(k=1e-9, beta=1.0, gamma=1.0), k_m=4.0, tau=0.3)
    force = Reference(rtol=1e-10).simulate(branch, NO_DRAW, record, ["force"]).values[0, 0]
    t, tau = record.times, 0.3
    loading = 4.0 * tau * 0.5 * (1.0 - np.exp(-np.minimum(t, 1.0) / tau))
    np.testing.assert_allclose(force, loading * np.exp(-np.maximum(t - 1.0, 0.0) / tau), atol=1e-8)


class WrongStrength(StrengthDegradation):
    """Degrades with the square root of the work: a plausible mistake."""

    def fill(self, slots: Slots) -> Slots:
        return replace(slots, nu=slots.nu + symbol("delta_nu") * (ENERGY**2 + 1e-12) ** 0.25)


@pytest.mark.parametrize(("effect_class", "agrees"), [(StrengthDegradation, True), (WrongStrength, False)])
def test_a_wrong_effect_is_caught(effect_class, agrees):
    model = ShearBuilding(masses=[1.0], storey=storey()).with_effect(effect_class(delta_nu=0.4))
    response = Reference().simulate(model, NO_DRAW, shaking(), channels(1))
    other = theirs({"delta_nu": 0.4}, 1, 1)
    error = max(nrmse(response.values[0, i], other[channel]) for i, channel in enumerate(channels(1)))
    assert (error < TOLERANCE) is agrees, error
    assert math.isfinite(error)
