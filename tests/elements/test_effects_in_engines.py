"""Contracts 2 and 3 for the storey's effects: every engine solves them together, and differentiates them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from laboratory import FREE, OTHER_FORMS, having, nrmse, shaking, storey

from bwbn_bayes.elements.law import Effect
from bwbn_bayes.engines.base import Engine
from bwbn_bayes.engines.cvodes import Cvodes
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.engines.scalar import ScalarRk4
from bwbn_bayes.parameters import Floats, Uniform
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.structure import Structure

SIZES = {
    "phi": 0.2, "phi_uv": 0.3, "u_uv": 0.1, "phi_u": -0.2, "u_u": 0.1, "b": 0.04, "w": 0.03, "b_0": 0.03, "w_0": 0.04,
    "F_c": 0.3, "v0": 0.2, "F_ratio": 0.2, "v_ratio": 0.2, "F_root": 0.2, "v_root": 0.2, "F_dahl": 0.2, "x_dahl": 0.1,
    "k3": 0.6, "c2": 0.1,
    "k_g": 4.0, "g": 0.15, "k_gp": 3.0, "g_p": 0.02, "k_gn": 2.0, "g_n": 0.1, "k_m": 2.0, "tau": 0.3,
    "alpha_offset": 0.05, "beta_offset": 0.3, "gamma_offset": -0.3, "n_offset": 0.3,
    "eta_inf": 0.5, "p_eta": 1.1, "nu_inf": 0.6, "p_nu": 0.7, "theta_eta": 0.2, "theta_nu": 0.3,
    "F_v": 0.3, "p_v": 0.6, "v_v": 1.1,
    "eta_e": 0.5, "b_eta": 1.1, "m_eta": 0.8, "E_eta": 2.0, "nu_e": 0.6, "b_nu": 0.7, "m_nu": 1.6, "E_nu": 2.0,
    "eta_c": 0.5, "a_eta": 1.1, "r_eta": 0.8, "U_eta": 2.0, "nu_c": 0.6, "a_nu": 0.7, "r_nu": 1.6, "U_nu": 2.0,
    "eta_a": 0.5, "s_eta": 0.8, "q_eta": 1.5, "N_eta": 6.0, "u_eta": 0.4,
    "nu_a": 0.6, "s_nu": 1.6, "q_nu": 0.7, "N_nu": 6.0, "u_nu": 0.4,
    "s_w": 0.1, "sigma_w": 0.2, "b_w": 0.5, "m_w": 0.7, "p_w": 1.5, "E_w": 2.0,
    "F_d": 0.2, "x_d": 0.1, "r_d": 1.4, "g_d": 0.4, "u_d": 0.5, "c_d": 0.3, "U_d": 4.0,
    "F_k": 0.2, "w_k": 0.1, "s_k": 0.6, "v_k": 0.3,
    "b_f": 0.05, "w_f": 0.04, "s_f": 0.1, "F_h": 0.6, "p_h": 2.4, "u_h": 0.5,
    "F_q": 0.3, "p_q": 1.6, "v_q": 1.5,
    **{name + side: size for side in ("", "p", "n") for name, size in
       (("k_s", 4.0), ("g_s", 0.1), ("p_s", 1.5), ("s_s", 0.15), ("w_s", 0.3), ("u_s", 0.4), ("E_s", 2.0))},
    "zeta_g": 0.6, "p_g": 0.8, "q_g": 0.2, "psi_g": 0.1, "delta_g": 0.02, "lambda_g": 0.3, "m_g": 1.7, "t_g": 0.6,
    "i_g": 0.2,
    "k_geo": 0.5,
    "k_ramp": -3.0, "k_ramp_time": 0.71, "k_ramp_duration": 0.83,
}  # fmt: skip
"""Where every effect acts and every nuisance is felt within two seconds."""

ONE_OF_EACH = ("sgn u sgn v", "tanh(v/v0)", "one-sided, negative", "n", "saturating", "k, ramp", "")
"""One form of each effect, the least smooth where there are several."""

ENGINES: dict[str, Engine] = {
    "lanes": Lanes(substeps=256, n_threads=1),
    "scalar": ScalarRk4(substeps=256),
    "cvodes": Cvodes(rtol=1e-10, atol=1e-12),
}
"""A step that straddles a kink leaves an error of first order in the derivatives: 64 steps leave 2e-3 of w's."""
CHANNELS = ("acceleration_1", "acceleration_2")
DIFFERENCES = (5e-4, 1e-3)
"""Relative steps of the reference's differences; Richardson's extrapolation from both takes out how a slope bends. Of
many laws together its solves scatter by 1e-10, which a step of 1e-4 alone makes up to 3e-3 of a derivative."""


def record() -> Record:
    return shaking(2.4, time_step=0.03, amplitude=6.0)


def model_of(forms: tuple[Effect, ...]) -> Structure:
    """Two storeys with every form at both; each of its parameters is identified."""
    model = ShearBuilding(masses=[1.0, 1.0], storey=storey())
    for form in forms:
        spread = {p.symbol: Uniform(*sorted((0.9 * SIZES[p.symbol], 1.1 * SIZES[p.symbol]))) for p in form.parameters}
        model = model.with_effect(having(form, spread))
    return model


@cache
def expected(forms: tuple[Effect, ...]) -> tuple[Structure, Floats, Floats, Floats]:
    """Model, draw, and the reference's response and derivatives."""
    model = model_of(forms)
    draw = model.draws({name: SIZES[name] for name in model.space.names})
    (response, short), (_, long) = (
        Reference(difference_step=step).sensitivities(model, draw, record(), CHANNELS) for step in DIFFERENCES
    )
    return model, draw, response.values, (4.0 * short - long) / 3.0


def check(engine: Engine, forms: tuple[Effect, ...]) -> None:
    model, draw, values, slopes = expected(forms)
    response, own = engine.sensitivities(model, draw, record(), CHANNELS)
    assert nrmse(response.values, values) < 1e-5
    errors = {name: nrmse(own[:, k], slopes[:, k]) for k, name in enumerate(model.space.names)}
    assert max(errors.values()) < 1e-3, errors


REPRESENTATIVES = tuple(form for form in OTHER_FORMS if form.form in ONE_OF_EACH)
HARDEST = tuple(
    form for form in REPRESENTATIVES if form.name in {"asymmetry", "backlash", "gap_impact", "sudden_damage"}
)
"""Those with added states, events and kinks that no sign of z or v tells: a kernel that compiles in good time. The
derivatives of every form are tested as expressions in test_contract."""


def test_lanes_solve_and_differentiate_the_hardest() -> None:
    assert len(HARDEST) == 4
    check(ENGINES["lanes"], HARDEST)


@pytest.mark.slow
@pytest.mark.parametrize("name", ENGINES)
def test_every_engine_solves_and_differentiates_one_form_of_each_effect(name: str) -> None:
    check(ENGINES[name], REPRESENTATIVES)


@pytest.mark.slow
@pytest.mark.parametrize("name", ENGINES)
def test_every_engine_solves_and_differentiates_every_form_together(name: str) -> None:
    check(ENGINES[name], OTHER_FORMS)


@pytest.mark.slow
@pytest.mark.parametrize("name", ENGINES)
def test_every_engine_solves_and_differentiates_the_forms_of_free_shape(name: str) -> None:
    check(ENGINES[name], FREE)


@pytest.mark.parametrize("substeps", [1, 2])
def test_no_size_of_a_play_makes_steps_unstable(substeps: int) -> None:
    """The play closes over a distance of steps that are far too long for it, and stays within its width."""
    plain = ShearBuilding(masses=[1.0, 1.0], storey=storey())
    engine = Lanes(substeps=substeps, n_threads=1)
    for half_width in (1e-9, 1e-3, 0.03, 0.3):
        model = with_play(plain, half_width)
        response = engine.simulate(model, np.zeros((1, 0)), shaking(), CHANNELS)
        assert response.status.tolist() == [0]
        assert np.max(np.abs(response.values)) < 20.0


def with_play(plain: Structure, half_width: float) -> Structure:
    """The play alone has a size; the kernel is that of the test above."""
    values = {"b": half_width, "w": 1e-4}
    for form in HARDEST:
        plain = plain.with_effect(having(form, values))
    return plain
