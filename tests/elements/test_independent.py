"""Contract 4: every registered effect agrees with an implementation that shares no code with ours."""

from __future__ import annotations

import math
from dataclasses import replace

import independent
import numpy as np
import pytest
from laboratory import NO_DRAW, building, nrmse, shaking, solve, storey

from bwbn_bayes.elements.catalogue import registered
from bwbn_bayes.elements.effects import StrengthDegradation
from bwbn_bayes.elements.law import ENERGY, Slots, symbol
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.structures.shear_building import ShearBuilding

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
    assert {effect.name for effect in registered()} == set(VALUES)


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
