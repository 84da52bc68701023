"""Engineering quantities against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
import xarray as xr
from scipy import linalg

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.catalogue import registered
from bwbn_bayes.elements.combine import combine
from bwbn_bayes.elements.effects import (
    PDelta,
    StiffnessDegradation,
    StoreyCoupling,
    StoreyParameter,
    StrengthDegradation,
    SuddenDamage,
)
from bwbn_bayes.elements.law import HYSTERETIC_DISPLACEMENT, Slots, StoreyLaw
from bwbn_bayes.elements.linear import Linear
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.simulation import simulate
from bwbn_bayes.parameters import PerStorey
from bwbn_bayes.records import Record
from bwbn_bayes.structures.quantities import (
    dissipated_energy,
    engineering_quantities,
    landmarks_of,
    link_matrix,
    modes,
    parameters_at,
    storey_parameters,
    tangent_stiffness,
    ultimate_hysteretic_displacement,
    yield_drift,
)
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.structure import Structure

VALUES = {"k": 10.0, "c": 0.05, "alpha": 0.1, "A": 1.0, "beta": 2.0, "gamma": 2.0, "n": 2.0}
PLAIN = ShearBuilding(masses=[1.0, 1.0], storey=BoucWen(**VALUES))


def law_with(*effects) -> StoreyLaw:
    model = PLAIN
    for effect in effects:
        model = model.with_effect(effect)
    return model.law


def parameters(n_storeys=2, n_draws=3, **changes):
    values = VALUES | changes
    shape = (n_draws, n_storeys)
    return xr.Dataset(
        {name: (("draw", "storey"), np.broadcast_to(value, shape).copy()) for name, value in values.items()},
        coords={"storey": np.arange(1, n_storeys + 1)},
    )


def response(drift, energy, z, time):
    dims = ("draw", "storey", "time")
    return xr.Dataset(
        {
            "drift": (dims, drift),
            "hysteretic_energy": (dims, energy),
            "hysteretic_displacement": (dims, z),
        },
        coords={"time": time, "storey": np.arange(1, drift.shape[1] + 1)},
    )


def ramp_response(n_draws=3, n_storeys=2, end_energy=2.0):
    time = np.linspace(0.0, 10.0, 201)
    shape = (n_draws, n_storeys, time.size)
    drift = np.broadcast_to(np.where(time < 5.0, -0.4 * time, 0.3), shape).copy()
    energy = np.broadcast_to(end_energy * time / 10.0, shape).copy()
    return response(drift, energy, np.zeros(shape), time)


def quantities(given, *, law=None, masses=(1.0, 1.0), histories=None, **further):
    histories = ramp_response() if histories is None else histories
    law = PLAIN.law if law is None else law
    return engineering_quantities(landmarks_of(histories, law, given), given, masses, law, **further)


def test_two_equal_storeys_have_the_golden_ratio_frequencies():
    k, m = 10.0, 2.0
    periods, _ = modes(np.array([k, k]), np.zeros(2), np.array([m, m]))
    omega_squared = k / m * (3.0 + np.array([-1.0, 1.0]) * np.sqrt(5.0)) / 2.0
    np.testing.assert_allclose(periods, 2 * np.pi / np.sqrt(omega_squared), rtol=1e-13)


def test_stiffness_proportional_damping_gives_ratios_proportional_to_frequency():
    k, masses, ratio = np.array([[30.0, 20.0, 10.0]]), np.array([3.0, 2.0, 1.0]), 0.004
    periods, zeta = modes(k, ratio * k, masses)
    np.testing.assert_allclose(zeta, ratio * (2 * np.pi / periods) / 2.0, rtol=1e-12)


def test_modes_agree_with_the_generalised_eigenproblem():
    k, c, masses = np.array([30.0, 7.0, 12.0]), np.array([0.1, 0.5, 0.02]), np.array([3.0, 1.0, 2.0])
    stiffness = np.array([[37.0, -7.0, 0.0], [-7.0, 19.0, -12.0], [0.0, -12.0, 12.0]])
    np.testing.assert_allclose(link_matrix(k), stiffness)
    squares, shapes = linalg.eigh(stiffness, np.diag(masses))
    periods, zeta = modes(k, c, masses)
    np.testing.assert_allclose(periods, 2 * np.pi / np.sqrt(squares), rtol=1e-12)
    damping = np.diag(shapes.T @ link_matrix(c) @ shapes)
    np.testing.assert_allclose(zeta, damping / (2 * np.sqrt(squares)), rtol=1e-12)


def test_ultimate_hysteretic_displacement_and_yield_drift():
    np.testing.assert_allclose(ultimate_hysteretic_displacement(parameters()), 0.5)
    np.testing.assert_allclose(yield_drift(parameters(A=4.0)), 1.0 / 4.0)
    linear = parameters(beta=0.0, gamma=0.0)
    assert np.all(np.isinf(yield_drift(linear)))


def test_yield_drift_does_not_change_with_the_redundant_scale_of_z():
    scale, n = 3.0, 2.0
    scaled = parameters(A=scale, beta=2.0 * scale ** (1 - n), gamma=2.0 * scale ** (1 - n))
    np.testing.assert_allclose(yield_drift(scaled), yield_drift(parameters()), rtol=1e-14)


def test_a_jump_acts_from_its_time_on():
    law = law_with(StiffnessDegradation(delta_eta=1.0), SuddenDamage(parameter="delta_eta", jump=2.0, time=5.0))
    times = xr.DataArray([4.9, 5.0], dims="time_point")
    jumping = parameters(delta_eta=1.0, delta_eta_jump=2.0, delta_eta_time=5.0)
    found = parameters_at(law, jumping, times)
    np.testing.assert_allclose(found["delta_eta"].isel(draw=0, storey=0), [1.0, 3.0])
    assert found["k"].dims == ("draw", "storey")


def test_a_ramp_and_an_offset_are_seen_everywhere():
    """A stiffness that falls from 40 to 20 N/m within 2 s from 3 s on; a storey with another beta."""
    law = law_with(
        SuddenDamage(parameter="k", jump=0.0, time=3.0, duration=2.0), StoreyParameter(parameter="beta", offset=100.0)
    )
    given = parameters(k=40.0, k_ramp=-20.0, k_ramp_time=3.0, k_ramp_duration=2.0, beta_offset=[0.0, 100.0])
    times = xr.DataArray([0.0, 3.0, 4.0, 5.0, 9.0], dims="time_point")
    at = parameters_at(law, given, times)
    np.testing.assert_allclose(at["k"].isel(draw=0, storey=0), [40.0, 40.0, 30.0, 20.0, 20.0])
    found = quantities(given, law=law, histories=ramp_response(end_energy=0.0))
    for column, k in ((0, 40.0), (-1, 20.0)):
        periods, _ = modes(np.array([k, k]), np.zeros(2), np.ones(2))
        np.testing.assert_allclose(found["period"].isel(time_point=column), periods[0])
    yields = np.array([0.5, (2.0 + 100.0 + 2.0) ** -0.5])
    np.testing.assert_allclose(found["ductility"], np.broadcast_to(found["peak_drift"] / yields, (3, 2)))


def changing():
    """Every form of every catalogued effect that changes a parameter."""
    forms = [form for effect in registered() if "bouc_wen" in effect.elements for form in effect.neutral_forms()]
    return [form for form in forms if form.fill(Slots()).increments]


@pytest.mark.parametrize("effect", changing(), ids=lambda effect: " ".join(effect.values))
def test_every_change_has_an_expression_in_time(effect):
    filled = effect.fill(Slots())
    assert {base.name for base in filled.increments} == set(law_with(*carriers(effect), effect).changes)


def carriers(effect):
    """The effects that bring what this one changes."""
    bringing = {p.symbol: other for other in registered() for p in other.neutral_forms()[0].parameters}
    changed = [base.name for base in effect.fill(Slots()).increments if base.name not in VALUES]
    return tuple(bringing[name].neutral_forms()[0] for name in changed)


def test_drift_ratios_need_storey_heights():
    found = quantities(parameters(), heights=[3.0, 4.0])
    np.testing.assert_allclose(found["peak_drift_ratio"], np.broadcast_to([0.4 * 4.95 / 3.0, 0.4 * 4.95 / 4.0], (3, 2)))
    assert found["peak_drift_ratio"].dims == ("draw", "storey")
    assert "peak_drift_ratio" not in quantities(parameters())


def test_every_quantity_has_a_unit():
    """They had none; ratios have the empty one, as parameters without a dimension have."""
    found = quantities(parameters(), heights=[3.0, 4.0])
    units = {name: values.attrs["units"] for name, values in found.items()}
    assert {name for name, unit in units.items() if unit == ""} == {
        "ductility", "stiffness_lost", "strength_lost", "modal_damping_ratio", "peak_drift_ratio"
    }  # fmt: skip
    assert units["peak_drift"] == units["residual_drift"] == "m"
    assert units["modal_period"] == units["period"] == found["time"].attrs["units"] == "s"
    assert units["dissipated_energy"] == "J"


def test_losses_drifts_and_ductility_from_known_histories():
    law = law_with(StrengthDegradation(delta_nu=1.5), StiffnessDegradation(delta_eta=0.5))
    found = quantities(parameters(delta_nu=1.5, delta_eta=0.5), law=law)
    dims = ("draw", "storey")
    for name in ("peak_drift", "residual_drift", "ductility", "stiffness_lost", "strength_lost", "dissipated_energy"):
        assert found[name].dims == dims, name
    np.testing.assert_allclose(found["peak_drift"], 0.4 * 4.95)
    np.testing.assert_allclose(found["residual_drift"], 0.3)
    np.testing.assert_allclose(found["ductility"], 0.4 * 4.95 / 0.5)
    np.testing.assert_allclose(found["stiffness_lost"], 1.0 - 1.0 / (1.0 + 0.5 * 2.0))
    np.testing.assert_allclose(found["strength_lost"], 1.0 - (1.0 + 1.5 * 2.0) ** (-1.0 / 2.0))
    np.testing.assert_allclose(found["dissipated_energy"], 2.0)


def test_a_loss_that_saturates_is_lost_all_the_same():
    """The quantities knew ``delta_eta`` and ``delta_nu`` alone: of the saturating forms they said that nothing was."""
    stiffness, strength = StiffnessDegradation(eta_inf=0.6, p_eta=0.4), StrengthDegradation(nu_inf=1.5, p_nu=0.7)
    given = parameters(**stiffness.values, **strength.values)
    found = quantities(given, law=law_with(stiffness, strength))
    np.testing.assert_allclose(found["stiffness_lost"], 1.0 - 1.0 / (1.0 + 0.6 * (1.0 - np.exp(-0.4 * 2.0))))
    np.testing.assert_allclose(found["strength_lost"], 1.0 - (1.0 + 1.5 * (1.0 - np.exp(-0.7 * 2.0))) ** -0.5)


RAMP_PATH = 0.4 * 4.95 + (0.4 * 4.95 + 0.3)
"""Of the ramp: out to its largest drift, and back past zero."""


def test_a_loss_with_the_path_is_of_the_drift_gone_through():
    effect = StrengthDegradation(theta_nu=0.1)
    found = quantities(parameters(theta_nu=0.1), law=law_with(effect))
    np.testing.assert_allclose(found["strength_lost"], 1.0 - (1.0 + 0.1 * RAMP_PATH) ** -0.5)
    np.testing.assert_array_equal(found["stiffness_lost"], 0.0)


@pytest.mark.parametrize("at", ["the path", "the work"])
def test_a_loss_in_a_free_shape_is_what_it_is_at_where_it_is_measured(at):
    effect = {
        "the path": StiffnessDegradation(eta_c=0.7, a_eta=2.0, r_eta=0.6, U_eta=RAMP_PATH),
        "the work": StiffnessDegradation(eta_e=0.7, b_eta=2.0, m_eta=0.6, E_eta=2.0),
    }[at]
    found = quantities(parameters(**effect.values), law=law_with(effect))
    np.testing.assert_allclose(found["stiffness_lost"], 1.0 - 1.0 / 1.7)
    assert np.all(np.diff(found["period"], axis=1) >= 0.0)


@pytest.mark.parametrize("q_eta", [0.5, 2.0, 7.0])
def test_a_loss_with_the_amplitude_counts_excursions_by_their_size(q_eta):
    """Of the ramp one way out, one back and a small one, for every draw by its own exponent."""
    effect = StiffnessDegradation(eta_a=0.5, s_eta=1.6, q_eta=1.0, N_eta=9.0, u_eta=0.8)
    exponents = np.array([1.0, q_eta, 2.0 * q_eta])[:, None]
    given = parameters(**{**effect.values, "q_eta": exponents})
    excursions = 2.0 * (0.4 * 4.95 / 0.8) ** (exponents + 1.0) + (0.3 / 0.8) ** (exponents + 1.0)
    time = np.linspace(0.0, 10.0, 20_001)
    drift = np.interp(time, [0.0, 4.0, 8.0, 10.0], [0.0, -0.4 * 4.95, 0.3, 0.3])
    shape = (3, 2, len(time))
    histories = response(np.broadcast_to(drift, shape), np.zeros(shape), np.zeros(shape), time)
    found = quantities(given, law=law_with(effect), histories=histories)
    lost = 0.5 * (excursions / 9.0) ** (1.6 / (exponents + 1.0))
    np.testing.assert_allclose(found["stiffness_lost"], np.broadcast_to(1.0 - 1.0 / (1.0 + lost), (3, 2)), rtol=1e-3)


def test_a_further_record_that_finds_the_structure_new_finds_nothing_worn():
    effect, histories = StrengthDegradation(theta_nu=0.1), ramp_response()
    twice = xr.concat([histories, histories.assign_coords(time=histories["time"] + 10.05)], dim="time")
    law, given = law_with(effect), parameters(theta_nu=0.1)
    known = landmarks_of(twice, law, given, begins=[0, histories.sizes["time"]])
    found = engineering_quantities(known, given, [1.0, 1.0], law)
    np.testing.assert_allclose(found["strength_lost"], quantities(given, law=law)["strength_lost"])


@pytest.mark.parametrize(
    ("factor", "lost", "other"),
    [("nu", "strength_lost", "stiffness_lost"), ("eta", "stiffness_lost", "strength_lost")],
)
def test_a_loss_of_a_users_effect_that_depends_on_more_is_not_told(factor, lost, other):
    class Weakening:
        name, level, parameters = "weakening", "link", ()

        def fill(self, slots):
            return replace(slots, **{factor: getattr(slots, factor) + sp.Abs(HYSTERETIC_DISPLACEMENT)})

    law = combine(PLAIN.law.parameters, (), (Weakening(),))
    found = quantities(parameters(), law=law)
    assert np.all(np.isnan(found[lost]))
    np.testing.assert_array_equal(found[other], 0.0)
    assert ("period" in found) == (factor == "nu")
    np.testing.assert_allclose(found["modal_period"], quantities(parameters())["modal_period"])


def test_absent_effects_lose_nothing_and_keep_the_period():
    found = quantities(parameters())
    np.testing.assert_array_equal(found["stiffness_lost"], 0.0)
    np.testing.assert_array_equal(found["strength_lost"], 0.0)
    np.testing.assert_allclose(found["period"], found["period"][0, 0], rtol=1e-13)
    np.testing.assert_allclose(found["period"][0, 0], found["modal_period"][0, 0], rtol=1e-13)


def test_period_of_one_storey_follows_the_degraded_tangent():
    mass, k, alpha, delta_eta = 2.0, 10.0, 0.1, 0.5
    found = quantities(
        parameters(n_storeys=1, delta_eta=delta_eta),
        law=law_with(StiffnessDegradation(delta_eta=delta_eta)),
        masses=np.array([mass]),
        histories=ramp_response(n_storeys=1),
    )
    eta = 1.0 + delta_eta * 2.0 * found["time"].values / 10.0
    expected = 2 * np.pi * np.sqrt(mass / (alpha * k + (1 - alpha) * k / eta))
    assert found["period"].dims == ("draw", "time_point")
    assert 24 <= found.sizes["time_point"] <= 48
    np.testing.assert_allclose(found["period"].isel(draw=1), expected, rtol=1e-12)
    np.testing.assert_allclose(found["modal_damping_ratio"], 0.05 / (2 * np.sqrt(k * mass)), rtol=1e-12)


def swung(model: Structure) -> np.ndarray:
    """Periods of an undamped model, longest first, from how its accelerations follow its displacements."""
    floors = range(1, model.n_floors + 1)
    pulse = Record(name="pulse", time_step=0.01, excitation=np.where(np.arange(800) < 20, 1e-3, 0.0))
    channels = [f"{kind}_{floor}" for kind in ("displacement", "acceleration") for floor in floors]
    motion = simulate(model, pulse, {}, engine=Lanes(substeps=16), channels=channels).measured
    displacement, acceleration = np.split(motion, 2)
    squares = np.linalg.eigvals(-np.linalg.lstsq(displacement.T, acceleration.T)[0]).real
    return np.sort(2.0 * np.pi / np.sqrt(squares))[::-1]


WEAK = {"c": 0.0, "alpha": 0.1, "A": 1.0, "beta": 0.5, "gamma": 0.5, "n": 1.0}
TWO_STOREYS = ShearBuilding(masses=[2e3, 2e3], storey=BoucWen(k=PerStorey([2e5, 5e4]), **WEAK))


@pytest.mark.parametrize(
    "model",
    [
        TWO_STOREYS,
        ShearBuilding(masses=[2618.0], storey=BoucWen(k=1e5, **WEAK)).with_effect(PDelta(k_geo=3e4)),
        TWO_STOREYS.with_effect(StoreyCoupling(k_bend=1e5)),
        TWO_STOREYS.with_link(Linear(k=3e4), joins=(0, 2))
        .with_effect(PDelta(k_geo=1e4), storeys=[2])
        .with_effect(StoreyCoupling(k_bend=4e4)),
    ],
    ids=["neither", "p_delta", "coupled", "both, braced"],
)
def test_periods_are_those_in_which_the_model_swings(model):
    """Geometric stiffness and bending between storeys were left out: 1.02 s told where a storey swung in 1.22."""
    found = quantities(
        storey_parameters(model, np.zeros((1, 0))),
        law=model.law,
        masses=model.masses,
        histories=ramp_response(1, model.n_links, end_energy=0.0),
        joints=model.joints,
    )
    np.testing.assert_allclose(found["modal_period"][0], swung(model), rtol=1e-3)
    np.testing.assert_array_equal(found["period"][0], found["modal_period"][0, 0])


def test_a_jump_of_stiffness_shows_in_the_tangent():
    times = xr.DataArray([1.0, 9.0], dims="time_point")
    law = law_with(SuddenDamage(parameter="k", jump=-4.0, time=5.0))
    jumping = parameters_at(law, parameters(k_jump=-4.0, k_time=5.0), times)
    tangent = tangent_stiffness(jumping, xr.ones_like(times)).isel(draw=0, storey=0)
    np.testing.assert_allclose(tangent, [10.0, 6.0])


@pytest.mark.parametrize("peak_force_share", [0.3, 0.9])
def test_an_elastic_half_cycle_dissipates_only_the_loop(peak_force_share):
    """Monotonic n = 1 loading has z and work in closed form; unloading with beta = gamma is straight."""
    k, alpha, decay = 10.0, 0.1, 4.0
    u = -np.log(1.0 - peak_force_share) / decay
    z = (1.0 - np.exp(-decay * u)) / decay
    work = (1 - alpha) * k * (u - z) / decay
    returned = (1 - alpha) * k * z**2 / 2.0
    at_end = response(np.full((1, 1, 1), u), np.full((1, 1, 1), work), np.full((1, 1, 1), z), np.array([1.0])).isel(
        time=0
    )
    given = parameters(n_storeys=1, n_draws=1, n=1.0)
    found = dissipated_energy(at_end, given, xr.ones_like(given["k"]))
    np.testing.assert_allclose(found, work - returned, rtol=1e-12)
    assert float(found.squeeze()) > 0.0
