"""Forms of free shape: the written law in NumPy and SciPy alone, and the usual forms that they contain."""

from __future__ import annotations

import math
from collections.abc import Mapping

import independent
import numpy as np
import pytest
import sympy as sp
from laboratory import FREE, NO_DRAW, SEARCHED, cyclic_test, having, neutral, nrmse, shaking, storey
from scipy.special import gamma

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.combine import combine
from bwbn_bayes.elements.effects import FolientePinching, SlipLock
from bwbn_bayes.elements.law import DRIFT, DRIFT_RATE, Effect
from bwbn_bayes.elements.scales import NOMINAL
from bwbn_bayes.elements.search_guide import guide_of
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen

STOREY = {"k": 10.0, "c": 0.05, "alpha": 0.01, "A": 1.0, "beta": 2.0, "gamma": 1.5, "n": 1.5}
N_STATES = 400
SHAPES = {
    "stiffness_degradation": {"eta_e": 0.7, "b_eta": 1.4, "m_eta": 0.6, "E_eta": 3.0},
    "stiffness_degradation, path": {"eta_c": 0.8, "a_eta": 0.9, "r_eta": 0.7, "U_eta": 4.0},
    "strength_degradation, path": {"nu_c": 0.6, "a_nu": 1.6, "r_nu": 1.4, "U_nu": 4.0},
    "strength_degradation": {"nu_e": 0.9, "b_nu": 0.3, "m_nu": 1.8, "E_nu": 3.0},
    "slip_lock": {"s_w": 0.2, "sigma_w": 0.3, "b_w": 0.5, "m_w": 0.6, "p_w": 1.3, "E_w": 3.0},
    "foliente_pinching": {
        "zeta_g": 0.7,
        "p_g": 1.1,
        "q_g": 0.2,
        "psi_g": 0.25,
        "delta_g": 0.03,
        "lambda_g": 0.3,
        "m_g": 1.4,
        "t_g": 0.6,
        "i_g": 0.3,
    },
    "coulomb_friction": {"F_d": 0.9, "x_d": 0.05, "r_d": 1.6, "g_d": -0.6, "u_d": 0.4, "c_d": 0.7, "U_d": 4.0},
    "coulomb_friction, speed": {"F_k": 0.4, "w_k": 0.06, "s_k": 0.7, "v_k": 0.3},
    "cubic_stiffness": {"F_h": -0.6, "p_h": 2.3, "u_h": 0.8},
    "quadratic_damping": {"F_q": 1.4, "p_q": 1.6, "v_q": 1.7},
    "backlash": {"b_f": 0.5, "w_f": 0.3, "s_f": 0.15},
    "gap_impact": {"k_s": 6.0, "g_s": 0.3, "p_s": 1.5, "s_s": 0.2, "w_s": 0.4, "u_s": 0.8, "E_s": 3.0},
    "gap_impact, positive": {"k_sp": 6.0, "g_sp": 0.3, "p_sp": 1.5, "s_sp": 0.2, "w_sp": 0.4, "u_sp": 0.8, "E_sp": 3.0},
    "gap_impact, negative": {"k_sn": 6.0, "g_sn": 0.3, "p_sn": 1.5, "s_sn": 0.2, "w_sn": 0.4, "u_sn": 0.8, "E_sn": 3.0},
}
"""Off the usual shape, by effect and side."""


def form_of(symbols: Mapping[str, float]) -> Effect:
    return next(form for form in FREE if {p.symbol for p in form.parameters} == set(symbols))


def test_every_form_is_tried() -> None:
    assert {frozenset(values) for values in SHAPES.values()} == {
        frozenset(p.symbol for p in f.parameters) for f in FREE
    }


def risen(share: Floats | float, bend: float, power: float) -> Floats:
    """The stretched exponential, without the offset that keeps its slope finite."""
    return np.asarray(1.0 - np.exp(-bend * share**power))


def stop(name: str, p: Mapping[str, float], u: Floats, eps: Floats) -> Floats:
    """A worn stop by Hertz's power that is met bit by bit, on one side or both."""
    tail = {"positive": "p", "negative": "n"}.get(name.partition(", ")[2], "")
    k, g, power, spread, w, largest, work = (p[s + tail] for s in ("k_s", "g_s", "p_s", "s_s", "w_s", "u_s", "E_s"))
    sides = {"p": (1.0,), "n": (-1.0,)}.get(tail, (1.0, -1.0))
    nodes, weights = np.polynomial.legendre.leggauss(200)
    later = nodes[:, None] * spread * largest
    met = [
        side * 0.5 * weights @ np.maximum(side * u - g * (1.0 + w * eps / work) + later, 0.0) ** power for side in sides
    ]
    return np.asarray(k * largest ** (1.0 - power) * np.sum(met, axis=0))


def written_beside(name: str, p: Mapping[str, float], states: Mapping[str, Floats]) -> tuple[Floats, list[Floats]]:
    """Force of what stands beside the springs, and of a contact that sticks the rate of its share."""
    u, v = states["u"], states["v"]
    if name == "coulomb_friction":
        q = states["q_d"]
        pressure = np.maximum(1.0 + p["g_d"] * np.abs(u) / p["u_d"], 0.0)
        force = p["F_d"] * q * pressure * np.exp(-p["c_d"] * states["u_c"] / p["U_d"])
        return force, [v / p["x_d"] * (1.0 - np.sign(v) * q) ** p["r_d"], np.abs(v)]
    if name == "coulomb_friction, speed":
        return p["F_k"] * np.tanh(v / p["w_k"]) * (1.0 + p["s_k"] * p["v_k"] ** 2 / (p["v_k"] ** 2 + v**2)), []
    if name == "cubic_stiffness":
        return p["F_h"] * np.sign(u) * np.abs(u / p["u_h"]) ** p["p_h"], []
    if name == "quadratic_damping":
        return p["F_q"] * np.sign(v) * np.abs(v / p["v_q"]) ** p["p_q"], []
    return stop(name, p, u, states["epsilon"]), []


def written(name: str, p: Mapping[str, float], states: Mapping[str, Floats]) -> list[Floats]:
    """Force, rate of z and, of a contact that sticks, of its share; of the path; of a slack's place."""
    u, v, z, eps = (states[s] for s in ("u", "v", "z", "epsilon"))
    nu, eta, slip, beside = (np.zeros(N_STATES) for _ in range(4))
    multiplier = np.ones(N_STATES)
    share: list[Floats] = []
    if name == "stiffness_degradation":
        eta = p["eta_e"] * risen(eps / p["E_eta"], p["b_eta"], p["m_eta"]) / risen(1.0, p["b_eta"], p["m_eta"])
    elif name == "strength_degradation":
        nu = p["nu_e"] * risen(eps / p["E_nu"], p["b_nu"], p["m_nu"]) / risen(1.0, p["b_nu"], p["m_nu"])
    elif name == "stiffness_degradation, path":
        eta = (
            p["eta_c"] * risen(states["u_c"] / p["U_eta"], p["a_eta"], p["r_eta"]) / risen(1.0, p["a_eta"], p["r_eta"])
        )
        share = [np.abs(v)]
    elif name == "strength_degradation, path":
        nu = p["nu_c"] * risen(states["u_c"] / p["U_nu"], p["a_nu"], p["r_nu"]) / risen(1.0, p["a_nu"], p["r_nu"])
        share = [np.abs(v)]
    elif name == "slip_lock":
        bell = np.exp(-(np.abs(z / p["sigma_w"]) ** p["p_w"])) / (p["sigma_w"] * gamma(1.0 + 1.0 / p["p_w"]))
        slip = p["s_w"] * risen(eps / p["E_w"], p["b_w"], p["m_w"]) / risen(1.0, p["b_w"], p["m_w"]) * bell
    elif name == "foliente_pinching":
        eps = np.maximum(eps, 0.0)
        depth = p["zeta_g"] * (1.0 - (1.0 - p["i_g"]) * np.exp(-p["p_g"] * eps))
        width = (p["psi_g"] + p["delta_g"] * eps) * (p["lambda_g"] + depth)
        bound = (STOREY["beta"] + STOREY["gamma"]) ** (-1.0 / STOREY["n"])
        away = 1.0 + p["t_g"] * np.abs((z * np.sign(v) - p["q_g"] * bound) / width) ** p["m_g"]
        multiplier = 1.0 - depth * away ** -(1.0 / p["t_g"])
    elif name == "backlash":
        d, forward = states["d_f"], np.sign(v)
        force = STOREY["alpha"] * (u - d) + (1.0 - STOREY["alpha"]) * z
        room = np.clip((p["b_f"] - d * forward) / p["w_f"], 0.0, 1.0)
        crossed = (1.0 - p["s_f"]) * room * np.clip(1.0 + force * forward / p["w_f"], 0.0, 1.0)
        u, share, multiplier = u - d, [v * crossed], 1.0 - crossed
    else:
        beside, share = written_beside(name, p, states)
    s = STOREY
    f = s["A"] - (1.0 + nu) * np.abs(z) ** s["n"] * (s["beta"] * np.sign(z * v) + s["gamma"])
    f /= 1.0 + eta
    spring = s["alpha"] * s["k"] * u + (1.0 - s["alpha"]) * s["k"] * z
    return [spring + s["c"] * v + beside, multiplier * f * v / (1.0 + slip * f), *share]


@pytest.mark.parametrize("name", SHAPES)
def test_the_law_is_the_written_one(name: str) -> None:
    """At random states. What keeps slopes finite, and the bell's area by a polynomial, move it by a few per mille."""
    rng = np.random.default_rng(3)
    states = {
        s: rng.uniform(0.05, 0.9, N_STATES) * rng.choice([-1.0, 1.0], N_STATES) for s in ("u", "v", "z", "q_d", "d_f")
    }
    states |= {"epsilon": rng.uniform(0.1, 3.0, N_STATES), "u_c": rng.uniform(0.1, 4.0, N_STATES)}
    if name == "foliente_pinching":  # which can let out more work than went in
        states["epsilon"] = states["epsilon"] - 1.0
    law = combine(BoucWen(**STOREY).parameters, (), (form_of(SHAPES[name]),))
    values = {**STOREY, **SHAPES[name], **states}
    symbols = (DRIFT, DRIFT_RATE, *law.states, *law.symbols)
    mine = sp.lambdify(symbols, (law.force, law.rates[0], *law.rates[2:]), "numpy")(*(values[s.name] for s in symbols))
    for own, other in zip(mine, written(name, SHAPES[name], states), strict=True):
        assert np.max(np.abs(own - other)) < 0.02 * np.max(np.abs(other))
        assert nrmse(own, other) < 5e-3
    plain = written(name, {**SHAPES[name], **dict.fromkeys(list(SHAPES[name])[:1], 0.0)}, states)
    assert max(nrmse(own, other) for own, other in zip(mine[:2], plain[:2], strict=True)) > 0.02


CONTAINED = {
    "stiffness, saturating": (
        {"eta_inf": 1.2, "p_eta": 0.6},
        {"eta_e": 1.2 * (1.0 - math.exp(-1.8)), "b_eta": 1.8, "m_eta": 1.0, "E_eta": 3.0},
    ),
    "stiffness, linear": ({"delta_eta": 0.4}, {"eta_e": 1.2, "b_eta": 1e-5, "m_eta": 1.0, "E_eta": 3.0}),
    "strength, saturating": (
        {"nu_inf": 1.5, "p_nu": 0.4},
        {"nu_e": 1.5 * (1.0 - math.exp(-1.2)), "b_nu": 1.2, "m_nu": 1.0, "E_nu": 3.0},
    ),
    "stiffness, with the path": ({"theta_eta": 0.3}, {"eta_c": 1.2, "a_eta": 1e-5, "r_eta": 1.0, "U_eta": 4.0}),
    "strength, with the path": ({"theta_nu": 0.3}, {"nu_c": 1.2, "a_nu": 1e-5, "r_nu": 1.0, "U_nu": 4.0}),
    "slip": (
        {"delta_s": 0.05, "sigma": 0.05},
        {"s_w": 0.15, "sigma_w": 0.05 * math.sqrt(2.0), "b_w": 1e-5, "m_w": 1.0, "p_w": 2.0, "E_w": 3.0},
    ),
    "pinch": (
        {"zeta_s": 0.8, "p": 2.0, "q": 0.2, "psi_0": 0.08, "delta_psi": 0.01, "lambda_": 0.3},
        {
            "zeta_g": 0.8,
            "p_g": 2.0,
            "q_g": 0.2,
            "psi_g": 0.08,
            "delta_g": 0.01,
            "lambda_g": 0.3,
            "m_g": 2.0,
            "t_g": 1e-5,
            "i_g": 0.0,
        },
    ),
    "friction": (
        {"F_dahl": 0.5, "x_dahl": 0.05},
        {"F_d": 0.5, "x_d": 0.05, "r_d": 1.0, "g_d": 0.0, "u_d": 0.8, "c_d": 0.0, "U_d": 4.0},
    ),
    "friction, speed": ({"F_c": 0.5, "v0": 0.05}, {"F_k": 0.5, "w_k": 0.05, "s_k": 0.0, "v_k": 0.3}),
    "slack": ({"b_0": 0.05, "w_0": 0.02}, {"b_f": 0.05, "w_f": 0.02, "s_f": 0.0}),
    "spring": ({"k3": -0.4}, {"F_h": -0.4 * 0.8**3, "p_h": 3.0, "u_h": 0.8}),
    "damper": ({"c2": 0.2}, {"F_q": 0.2 * 1.7**2, "p_q": 2.0, "v_q": 1.7}),
    "stop": (
        {"k_g": 15.0, "g": 0.3},
        {"k_s": 15.0, "g_s": 0.3, "p_s": 1.0, "s_s": 1e-5, "w_s": 0.0, "u_s": 0.8, "E_s": 3.0},
    ),
    "stop, positive": (
        {"k_gp": 15.0, "g_p": 0.3},
        {"k_sp": 15.0, "g_sp": 0.3, "p_sp": 1.0, "s_sp": 1e-5, "w_sp": 0.0, "u_sp": 0.8, "E_sp": 3.0},
    ),
    "stop, negative": (
        {"k_gn": 15.0, "g_n": 0.3},
        {"k_sn": 15.0, "g_sn": 0.3, "p_sn": 1.0, "s_sn": 1e-5, "w_sn": 0.0, "u_sn": 0.8, "E_sn": 3.0},
    ),
}
"""Parameters of a usual form, and those of the free shape that are the same law."""


@pytest.mark.parametrize("name", CONTAINED)
def test_the_usual_form_is_contained(name: str) -> None:
    """The response is that of the independent implementation of the usual form; the bell's area is known to 5e-5."""
    usual, free = CONTAINED[name]
    record = shaking(2.0)
    model = ShearBuilding(masses=[1.0], storey=storey()).with_effect(having(form_of(free), free))
    kinds = ("acceleration", "drift", "hysteretic_displacement")
    mine = Reference(rtol=1e-9).simulate(model, NO_DRAW, record, [f"{kind}_1" for kind in kinds]).values[0]
    other = independent.respond([usual], [1.0], record.excitation, record.time_step)
    without = independent.respond([{}], [1.0], record.excitation, record.time_step)
    assert max(nrmse(own, other[kind][0]) for own, kind in zip(mine, kinds, strict=True)) < 2e-5
    assert max(nrmse(without[kind][0], other[kind][0]) for kind in kinds) > 2e-3


@pytest.mark.parametrize("exponent", [0.3, 1.0, 1.3, 3.0])
def test_a_contact_that_turns_between_two_samples_is_solved(exponent: float) -> None:
    """Ten samples a half cycle, and a contact that turns within a twentieth of what lies between two of them."""
    record = cyclic_test([0.3, -0.25, 0.5, -0.55, 0.6], 10)
    shape = {"F_d": 0.5, "x_d": 0.004, "r_d": exponent, "g_d": 0.4, "u_d": 0.8, "c_d": 0.3, "U_d": 4.0}
    model = Specimen(storey=storey(c=0.0)).with_effect(having(form_of(shape), shape))
    exact = Reference(method="LSODA", rtol=1e-8).simulate(model, NO_DRAW, record, ["force"]).values[0, 0]
    mine = Lanes(resolution=0.5).simulate(model, NO_DRAW, record, ["force"]).values[0, 0]
    assert nrmse(mine, exact) < 1e-3


def test_both_pinches_share_a_free_shape() -> None:
    slip, pinch = (guide_of(one).free_shapes(NOMINAL) for one in (SlipLock, FolientePinching))
    assert slip == pinch[1:]


def test_a_free_shape_is_of_the_same_mechanism() -> None:
    for effect_class in SEARCHED:
        freer = guide_of(effect_class).free_shapes(NOMINAL)
        for form in freer:
            (usual, *_) = effect_class.neutral_forms()
            assert form.mechanism == usual.mechanism
            assert form.form.startswith("free shape")
            assert guide_of(type(form)).free_shapes(NOMINAL) in ((), freer)
            assert form.needs_time <= any(one.needs_time for one in effect_class.neutral_forms())
            assert neutral(form).values[form.parameters[0].symbol] == 0.0


def test_a_side_that_does_not_exist_is_refused() -> None:
    stopped = next(form for form in FREE if form.name == "gap_impact")
    with pytest.raises(UserError, match="FreeStop: side 'left' is not known"):
        type(stopped)(k_h=1.0, g=0.1, p=1.5, s=0.01, w=0.0, u=1.0, E=1.0, side="left")
