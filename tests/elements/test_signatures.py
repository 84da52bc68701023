"""Every catalogued effect has a signature: none at neutral values, growing with its amplitude, named from its size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from laboratory import FREE, SEARCHED, cyclic_test, having, solve, specimen

from bwbn_bayes.elements.effects import CoulombFriction
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.signature import NO_SIGNATURE, PlaceResponse

SCALES = Scales(
    drift=1.0, path=40.0, drift_rate=2.0, hysteretic_displacement=0.3, energy=8.0, force=4.0, stiffness=10.0,
    damping=0.05, alpha=0.01, beta=2.0, gamma=2.0, n=1.5, mass=1.0, acceleration=2.0,
    ground_acceleration=1.5, period=2.0, onset=0.0, duration=20.0, total_mass=3, time_step=0.01,
)  # fmt: skip
STOREY = {"k": 10.0, "c": 0.05, "alpha": 0.01, "A": 1.0, "beta": 2.0, "gamma": 2.0, "n": 1.5}
JUMPING = {"delta_nu": 0.1, "delta_eta": 0.1, "delta_s": 0.01}
FORMS = [*(form for kind in SEARCHED for form in kind.neutral_forms()), *FREE]
CYCLES = [1.0, -1.0] * 10
DEGRADING = ("stiffness_degradation", "strength_degradation", "slip_lock", "foliente_pinching")
"""Effects that the specimen of the laboratory has."""
KINDS = ("drift", "drift_rate", "hysteretic_displacement", "hysteretic_energy", "restoring_force", "acceleration")

NUISANCES = {
    "sigma": 0.02, "p": 5.0, "q": 0.1, "psi_0": 0.1, "delta_psi": 0.0, "lambda_": 0.3, "v0": 0.05, "v_ratio": 0.05,
    "v_root": 0.05, "x_dahl": 0.02, "g": 0.5, "g_p": 0.5, "g_n": 0.5, "tau": 0.3, "w": 0.004, "f_t": 0.6, "m_b": 1.0,
    "R_s": 1.0, "m_s": 1.0, "W_s": 30.0, "Y_s": 0.01, "n_s": 2.0, "r_mu": 0.0, "a_s": 0.0,
    "k_time": 5.0, "u_uv": 0.03, "u_u": 0.03, "p_eta": 0.1, "p_nu": 0.1,
    "b_eta": 0.1, "m_eta": 0.7, "E_eta": 8.0, "b_nu": 0.1, "m_nu": 1.6, "E_nu": 8.0,
    "a_eta": 0.1, "r_eta": 0.7, "U_eta": 8.0, "a_nu": 0.1, "r_nu": 1.6, "U_nu": 8.0,
    "s_eta": 0.7, "q_eta": 1.5, "N_eta": 20.0, "u_eta": 1.1, "s_nu": 1.6, "q_nu": 0.6, "N_nu": 20.0, "u_nu": 1.1,
    "beta_h": 2.0, "gamma_h": 0.5, "n_h": 1.5, "x_h": 1.1,
    "sigma_w": 0.03, "b_w": 1.0, "m_w": 0.8, "p_w": 1.6, "E_w": 8.0, "p_h": 2.2, "u_h": 1.1, "p_q": 1.6, "v_q": 2.2,
    "p_v": 0.5, "v_v": 2.2,
    "p_g": 5.0, "t_g": 0.1, "i_g": 0.1, "x_d": 0.02, "r_d": 0.8, "g_d": 0.3, "u_d": 1.1, "c_d": 0.2, "U_d": 4.0,
    "w_k": 0.05, "s_k": 0.3, "v_k": 0.5, "w_f": 0.02, "s_f": 0.1,
    **{name + side: size for side in ("", "p", "n") for name, size in
       (("g_s", 0.5), ("p_s", 1.5), ("s_s", 0.005), ("w_s", 0.1), ("u_s", 1.1), ("E_s", 8.0))},
}  # fmt: skip


def label(form: Effect) -> str:
    return "-".join((form.name, *(p.symbol for p in form.parameters)))


@cache
def along_cycles(**values: float) -> Mapping[str, np.ndarray]:
    """Ten cycles of a specimen with the effects that degrade it, by the lanes engine."""
    return solve(specimen(values), cyclic_test(CYCLES, 100), [f"{kind}_1" for kind in KINDS], 4)


def response(form: Effect, values: Mapping[str, float]) -> PlaceResponse:
    """What the place of an effect shows: simulated where the specimen of the laboratory has the effect."""
    own = {p.symbol: values.get(p.symbol, p.neutral) for p in form.parameters}
    simulated = own if form.name in DEGRADING else {}
    rows = {kind: along_cycles(**simulated)[f"{kind}_1"] for kind in KINDS}
    if form.level == "structure":
        rows = {kind: np.stack([history, 0.5 * history]) for kind, history in rows.items()}
    return PlaceResponse(histories=rows, parameters={**JUMPING, **STOREY, **own}, scales=SCALES)


def amplitude_for(form: Effect, size: float) -> float:
    """The amplitude at which the law has a size on the loop of the storey without it; sizes grow with amplitudes."""
    parameter = form.parameters[0]
    sign = -1.0 if size < 0.0 else 1.0

    def reached(step: float) -> float:
        values = {**NUISANCES, parameter.symbol: parameter.neutral + sign * step}
        at = replace(response(form, {}), parameters={**JUMPING, **STOREY, **values})
        return abs(form.signature.size(at))

    low, high = 1e-12, min(1e3, parameter.upper - parameter.neutral)
    for _ in range(80):
        middle = np.sqrt(low * high)
        low, high = (low, middle) if reached(middle) > abs(size) else (middle, high)
    return float(parameter.neutral + sign * high)


@pytest.mark.parametrize("form", FORMS, ids=label)
def test_it_is_told_in_words(form):
    signature = form.signature
    assert signature is not NO_SIGNATURE
    for text in (signature.measure, signature.plain_name, signature.reason):
        assert text and "\n" not in text
    assert form.name not in signature.plain_name
    assert signature.size is not None and signature.least > 0.0


@pytest.mark.parametrize(
    "form", [form for form in FORMS if form.level == "link" and form.name != "storey_parameter"], ids=label
)
def test_what_a_specimen_may_have_is_told_of_no_building(form):
    """A specimen in a testing machine was said to have "dry friction between the floors"."""
    signature = form.signature
    for text in (form.summary, signature.measure, signature.plain_name, signature.reason):
        assert not any(word in text for word in ("storey", "floor", "building")), text


@pytest.mark.parametrize("form", FORMS, ids=label)
def test_at_neutral_it_has_no_size_and_no_name(form):
    at = response(form, {})
    assert form.signature.size(at) == 0.0
    assert not form.signature.is_engineering(at)


@pytest.mark.parametrize("form", FORMS, ids=label)
def test_its_size_grows_with_its_amplitude(form):
    amplitude = form.parameters[0]
    values = [amplitude_for(form, share * form.signature.least) for share in (0.5, 1.5, 4.0)]
    sizes = [
        form.signature.size(
            replace(response(form, {}), parameters={**JUMPING, **STOREY, **NUISANCES, amplitude.symbol: v})
        )
        for v in values
    ]
    assert np.all(np.diff(np.abs(sizes)) > 0.0)


@pytest.mark.parametrize("form", FORMS, ids=label)
def test_it_is_named_from_its_least_size_on(form):
    for share, named in ((0.02, False), (0.7, False), (1.4, True), (5.0, True)):
        value = amplitude_for(form, share * form.signature.least)
        at = response(form, {**NUISANCES, form.parameters[0].symbol: value})
        genuine = form.signature.is_genuine is None or form.signature.is_genuine(at)
        assert form.signature.is_engineering(at) == (named and genuine), share


def free(symbol: str) -> Effect:
    return next(form for form in FORMS if symbol in {p.symbol for p in form.parameters})


def test_a_stop_of_which_a_part_is_met_at_once_is_a_stiffening():
    reach = response(free("k_s"), {}).peak("drift")
    own = {"k_s": 100.0, "g_s": 0.3 * reach, "p_s": 1.0, "w_s": 0.0, "u_s": reach, "E_s": 8.0}
    named = [free("k_s").signature.is_engineering(response(free("k_s"), {**own, "s_s": s})) for s in (0.01, 0.29)]
    assert named == [True, False]


def test_friction_that_is_nearly_nothing_at_rest_is_a_damper():
    fastest = response(free("F_k"), {}).peak("drift_rate")
    own = {"F_k": 100.0, "w_k": 0.02 * fastest}
    near_rest = ((0.5, 0.1 * fastest, True), (-0.95, 2.0 * fastest, False), (-0.95, 0.03 * fastest, True))
    for s, v, named in near_rest:
        at = response(free("F_k"), {**own, "s_k": s, "v_k": v})
        assert free("F_k").signature.is_engineering(at) == named, (s, v)


def test_a_pinch_after_negative_work_has_no_size():
    """The law has none either; an exponential of it was too large for a number."""
    form = free("zeta_g")
    at = response(form, {**NUISANCES, "zeta_g": 0.9, "i_g": 0.0, "p_g": 1e4})
    at = replace(at, histories={**at.histories, "hysteretic_energy": -np.ones(3)})
    assert form.signature.size(at) == 0.0


@pytest.mark.parametrize(
    ("name", "values"),
    [("foliente_pinching", {**NUISANCES, "zeta_s": 0.9, "p": 0.1}), ("slip_lock", {"delta_s": 0.01})],
)
def test_a_pinch_is_as_large_as_it_ever_was(name, values):
    """A test that ends near zero force has given back what was elastic, and a pinch that grows with work with it."""
    form = next(form for form in FORMS if form.name == name)
    at = response(form, {s: v for s, v in values.items() if s in {p.symbol for p in form.parameters}})
    ends = [
        replace(at, histories={**at.histories, "hysteretic_energy": np.array([0.0, 9.0, end])}) for end in (9.0, 1.0)
    ]
    assert form.signature.size(ends[0]) == form.signature.size(ends[1]) > form.signature.least


MEASURED = {
    "strength_degradation": ([{"delta_nu": d} for d in (0.0, 0.02, 0.1)], 1.0),
    "stiffness_degradation": ([{"delta_eta": d} for d in (0.0, 0.003, 0.015)], 1.0),
    "slip_lock": ([{"delta_s": d, "sigma": 0.02} for d in (0.0, 0.01, 0.03)], -1.0),
    "foliente_pinching": ([{**NUISANCES, "zeta_s": d} for d in (0.0, 0.5, 0.95)], -1.0),
}


@pytest.mark.parametrize("name", MEASURED)
def test_what_the_loop_shows_moves_with_the_law(name):
    """The measure of a simulated test, with the law and without; a record of the same force would show the same."""
    cases, direction = MEASURED[name]
    form = next(form for form in FORMS if form.name == name)
    own = [{s: v for s, v in case.items() if s in {p.symbol for p in form.parameters}} for case in cases]
    responses = [response(form, values) for values in own]
    shown = [form.signature.of_response(at) for at in responses]
    assert np.all(direction * np.diff(shown) > 0.005), shown
    assert [form.signature.of_measured(*at.loop) for at in responses] == shown


def test_a_degrading_specimen_loses_what_its_law_says():
    """Strength ``nu^(-1/n)``, unloading stiffness ``1/eta`` with beta = gamma: per cycle, over ten cycles."""
    for name, values in (("strength_degradation", {"delta_nu": 0.03}), ("stiffness_degradation", {"delta_eta": 0.01})):
        form = next(form for form in FORMS if form.name == name)
        at = response(form, values)
        assert form.signature.of_response(at) == pytest.approx(form.signature.size(at), rel=0.35)


def test_a_pinch_in_a_full_loop_is_not_called_one():
    """A law of many parameters that bends the reloading branch of a fat loop a little."""
    form = next(form for form in FORMS if form.name == "foliente_pinching")
    shallow = {**NUISANCES, "zeta_s": 0.3, "p": 50.0}
    at = response(form, {s: v for s, v in shallow.items() if s in {p.symbol for p in form.parameters}})
    assert form.signature.size(at) > form.signature.least
    assert not form.signature.is_engineering(at)
    deep = response(form, {**at.parameters, "zeta_s": 0.95, "q": 0.0, "psi_0": 0.2})
    assert form.signature.is_engineering(deep)


def test_a_small_slip_keeps_its_name():
    """Three per cent of the largest drift, in a loop that yields but is not full."""
    form = next(form for form in FORMS if form.name == "slip_lock")
    rows = solve(
        specimen({"delta_s": 0.0, "sigma": 0.02}), cyclic_test([0.3, -0.3] * 5, 100), [f"{k}_1" for k in KINDS], 4
    )
    energy = rows["hysteretic_energy_1"][-1]
    values = {"delta_s": 0.5 * 0.03 * 0.3 / energy, "sigma": 0.02}
    rows = solve(specimen(values), cyclic_test([0.3, -0.3] * 5, 100), [f"{k}_1" for k in KINDS], 4)
    at = PlaceResponse(
        histories={kind: rows[f"{kind}_1"] for kind in KINDS}, parameters={**STOREY, **values}, scales=SCALES
    )
    assert form.signature.size(at) == pytest.approx(0.03, rel=0.1)
    assert form.signature.is_engineering(at)


@pytest.mark.parametrize("smoothing", ["tanh", "ratio", "root", "dahl"])
@pytest.mark.parametrize(("share", "dry"), [(0.12, True), (0.13, False)])
def test_friction_that_turns_slowly_is_not_dry(smoothing, share, dry):
    """Over more than an eighth of the largest drift rate; a contact that sticks: of the largest drift."""
    form = next(f for f in CoulombFriction.neutral_forms() if f.smoothing == smoothing)
    force, width = (p.symbol for p in form.parameters)
    still = response(form, {})
    values = {force: 0.1 * still.peak("restoring_force")}
    values[width] = share * still.peak("drift" if smoothing == "dahl" else "drift_rate")
    assert form.signature.is_engineering(response(form, values)) == dry


STOPS = [form for form in FORMS if form.name == "gap_impact"]


@pytest.mark.parametrize("form", STOPS, ids=label)
@pytest.mark.parametrize(("share", "stop"), [(0.12, True), (0.08, False)])
def test_a_stop_that_is_met_at_once_is_none(form, share, stop):
    """Within a tenth of the largest drift on its side it is a spring that stiffens."""
    stiffness, gap = (p.symbol for p in form.parameters[:2])
    still = response(form, {})
    reach = float(np.max((-1.0 if form.side == "negative" else 1.0) * still.histories["drift"]))
    at = response(form, {**NUISANCES, stiffness: 1.0, gap: share * reach})
    assert form.signature.size(at) > form.signature.least
    assert form.signature.is_engineering(at) == stop


def test_sizes_against_hand_calculations():
    """Damping at the first mode, play, a lengthened period, a stop, tuned peaks."""
    by_name = {form.name: form for form in reversed(FORMS)}
    omega = np.pi
    cases = {
        "mass_damping": ({"c_m": 0.1 * omega}, 0.05),
        "maxwell_branch": ({"k_m": 0.4, "tau": 1.0 / omega}, 0.5 * 0.4 * 0.5 / 10.0),
        "backlash": ({"b": 0.05}, 0.1),
        "gap_impact": ({"k_g": 2.0, "g": 0.8}, 0.4 / np.max(np.abs(along_cycles()["restoring_force_1"]))),
        "appendage": ({"mu_t": 0.04}, 0.2),
        "cubic_stiffness": ({"k3": -0.7}, -0.07),
        "sensor_bias": ({"bias": 0.1}, 0.05),
        "input_scale": ({"s_g": 1.03}, 0.03),
    }
    for name, (values, expected) in cases.items():
        assert by_name[name].signature.of_response(response(by_name[name], values)) == pytest.approx(expected), name


def test_the_base_lengthens_the_period_as_veletsos_and_meek_say():
    """One storey: ``sqrt(1 + k / k_b)``."""
    form = next(form for form in FORMS if form.name == "base_flexibility")
    u = np.sin(np.linspace(0.0, 20.0, 500))[None]
    at = PlaceResponse(
        histories={"drift": u, "restoring_force": 10.0 * u}, parameters={"compliance": 0.02}, scales=SCALES
    )
    assert form.signature.of_response(at) == pytest.approx(np.sqrt(1.0 + 10.0 * 0.02) - 1.0)


def test_bending_is_the_force_that_it_adds_to_a_storey():
    """Three storeys: what bending adds to each is a second difference of the drifts, one-sided at the ends."""
    form = next(form for form in FORMS if form.name == "storey_coupling")
    shape = np.array([[1.0], [0.4], [0.1]])
    u = shape * np.sin(np.linspace(0.0, 0.5 * np.pi, 500))
    bending = 3.0 * np.array([0.6, -0.6 + 0.3, -0.3])
    force = 10.0 * u + bending[:, None] * u[:1]
    at = PlaceResponse(histories={"drift": u, "restoring_force": force}, parameters={"k_bend": 3.0}, scales=SCALES)
    assert form.signature.of_response(at) == pytest.approx(np.max(np.abs(bending)) / np.max(np.abs(force)))


def test_the_whole_building_s_measures_know_which_links_stand_on_what():
    """Two storeys and a brace from the ground to the roof: it takes shear, and no bending between storeys."""
    base, bent = (next(form for form in FORMS if form.name == name) for name in ("base_flexibility", "storey_coupling"))
    phase = np.sin(np.linspace(0.0, 0.5 * np.pi, 500))
    u = np.array([[0.3], [0.5], [0.8]]) * phase
    force = np.array([[5.0], [3.0], [2.0]]) * phase
    at = PlaceResponse(
        histories={"drift": u, "restoring_force": force}, parameters={"compliance": 0.02, "k_bend": 3.0},
        scales=SCALES, joints=((0, 1), (1, 2), (0, 2)),
    )  # fmt: skip
    np.testing.assert_allclose(at.base_shear, 7.0 * phase)
    stored = 5.0 * 0.3 + 3.0 * 0.5 + 2.0 * 0.8
    assert base.signature.of_response(at) == pytest.approx(np.sqrt(1.0 + 0.02 * 7.0**2 / stored) - 1.0)
    np.testing.assert_allclose(at.bending_drifts, np.array([[-0.2], [0.2], [0.0]]) * phase)
    assert bent.signature.of_response(at) == pytest.approx(3.0 * 0.2 / 5.0)
    # Two towers side by side do not bend each other.
    apart = replace(at, joints=((0, 1), (1, 2), (0, 3)))
    np.testing.assert_allclose(apart.bending_drifts, np.array([[-0.2], [0.2], [0.0]]) * phase)


def test_quadratic_damping_is_worth_the_viscous_one_of_a_steady_vibration():
    """``8 c2 V / (3 pi)`` at velocity amplitude V."""
    form = next(form for form in FORMS if form.name == "quadratic_damping")
    v = 1.5 * np.sin(2.0 * np.pi * np.arange(1000) / 1000)
    at = PlaceResponse(histories={"drift_rate": v}, parameters={"c2": 0.2}, scales=SCALES)
    expected = 8.0 * 0.2 * 1.5 / (3.0 * np.pi) * np.pi / (2.0 * 10.0)
    assert form.signature.of_response(at) == pytest.approx(expected, rel=1e-4)


def test_the_strengths_of_an_asymmetric_loop():
    """z_u of ``beta + gamma +- 2 phi``."""
    form = next(form for form in FORMS if form.form == "sgn z + sgn v")
    positive, negative = ((1.0 / (4.0 + side * 0.4)) ** (1.0 / 1.5) for side in (1.0, -1.0))
    at = response(form, {"phi": 0.2})
    assert form.signature.size(at) == pytest.approx((positive - negative) / (positive + negative))


def test_a_users_effect_without_a_signature_may_always_be_named():
    own = having(FORMS[0], {})
    at = response(own, {})
    assert NO_SIGNATURE.is_engineering(at)
    assert np.isnan(NO_SIGNATURE.of_response(at))
    assert NO_SIGNATURE.of_measured(*at.loop) is None
