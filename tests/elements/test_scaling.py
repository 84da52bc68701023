"""The scale of z: powers found from the law against those worked out by hand, and responses that must not change."""

from __future__ import annotations

import numpy as np
import pytest
from laboratory import having, shaking

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.combine import combine
from bwbn_bayes.elements.effects import (
    Asymmetry,
    Backlash,
    FolientePinching,
    SlipLock,
    StiffnessDegradation,
    StoreyParameter,
    StrengthDegradation,
    SuddenDamage,
)
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.elements.scaling import Power, powers_of_scale
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.shear_building import ShearBuilding

LIKE_BETA, LIKE_Z = Power(1, -1), Power(1, 0)
"""``|z|^n beta`` is a rate of z; a width is a z."""

PLAIN = BoucWen(k=1.0, beta=1.0, gamma=0.0)
STOREY = {"k": 10.0, "c": 0.05, "alpha": 0.1, "A": 1.0, "beta": 1.2, "gamma": 0.7, "n": 1.6}
SIZES = {
    "delta_nu": 0.05, "delta_eta": 0.04, "delta_s": 0.02, "sigma": 0.05, "phi": 0.2, "phi_u": -0.2, "u_u": 0.1,
    "b": 0.04, "w": 0.03, "gamma_offset": -0.3, "nu_inf": 0.3, "p_nu": 0.4, "c_jump": 0.3, "c_time": 0.7,
}  # fmt: skip

FOLLOWING: dict[Effect | None, dict[str, Power]] = {
    None: {},
    StiffnessDegradation(delta_eta=0.0): {},
    StrengthDegradation(nu_inf=0.0, p_nu=1.0): {},
    SlipLock(delta_s=0.0, sigma=1.0): {"sigma": LIKE_Z},
    Backlash(b=0.0, w=1.0): {},
    SuddenDamage(parameter="c", jump=0.0, time=0.0): {},
    Asymmetry.neutral_forms()[0]: {"phi": LIKE_BETA},
    Asymmetry.neutral_forms()[2]: {"phi_u": LIKE_BETA},
    StoreyParameter(parameter="gamma", offset=0.0): {"gamma_offset": LIKE_BETA},
}
"""Powers beside those of beta and gamma."""

FIXING: tuple[Effect, ...] = (
    FolientePinching.neutral_forms()[0],
    StoreyParameter(parameter="n", offset=0.0),
    StoreyParameter(parameter="alpha", offset=0.0),
)
"""These stand for the pinch where A = 1, or let the powers differ within a storey."""


def named(effect: Effect | None) -> str:
    return "plain" if effect is None else f"{effect.name} {effect.form}"


def response(effect: Effect | None, values: dict[str, float]) -> Floats:
    """Accelerations of two storeys at both of which the effect acts."""
    model = ShearBuilding(masses=[1.0, 1.0], storey=BoucWen(**{name: values[name] for name in STOREY}))
    if effect is not None:
        model = model.with_effect(having(effect, values))
    channels = ("acceleration_1", "acceleration_2", "force_1")
    return Reference().simulate(model, np.zeros((1, 0)), shaking(1.5, 0.03, 6.0), channels).values[0]


@pytest.mark.parametrize("effect", FOLLOWING, ids=named)
def test_powers_are_those_worked_out_by_hand(effect: Effect | None) -> None:
    law = combine(PLAIN.parameters, PLAIN.constraints, () if effect is None else (effect,))
    assert powers_of_scale(law) == {"beta": LIKE_BETA, "gamma": LIKE_BETA, **FOLLOWING[effect]}


@pytest.mark.parametrize("effect", FOLLOWING, ids=named)
def test_the_response_is_the_same_at_another_scale(effect: Effect | None) -> None:
    """Powers and springs by hand, the response by the reference engine; with one power wrong it differs."""
    before, scale = {**STOREY, **SIZES}, 1.9
    after = before | {"A": scale}
    pre, post = before["alpha"] * before["k"], (1.0 - before["alpha"]) * before["k"] / scale
    after |= {"k": pre + post, "alpha": pre / (pre + post)}
    for name, power in {"beta": LIKE_BETA, "gamma": LIKE_BETA, **FOLLOWING[effect]}.items():
        after[name] = before[name] * scale ** (power.constant + power.of_n * before["n"])
    expected = response(effect, before)
    size = np.sqrt(np.mean(np.square(expected)))
    assert np.max(np.abs(response(effect, after) - expected)) / size < 1e-6
    for name in FOLLOWING[effect] or ("beta",):
        assert np.max(np.abs(response(effect, after | {name: before[name]}) - expected)) > 1e-4 * size, name


@pytest.mark.parametrize("effect", FIXING, ids=named)
def test_some_effects_fix_the_scale(effect: Effect) -> None:
    assert powers_of_scale(combine(PLAIN.parameters, PLAIN.constraints, (effect,))) is None


def test_powers_of_several_effects_stand_together() -> None:
    effects = (StrengthDegradation(delta_nu=0.0), SlipLock(delta_s=0.0, sigma=1.0), Asymmetry.neutral_forms()[0])
    powers = powers_of_scale(combine(PLAIN.parameters, PLAIN.constraints, effects))
    assert powers == {"beta": LIKE_BETA, "gamma": LIKE_BETA, "sigma": LIKE_Z, "phi": LIKE_BETA}
