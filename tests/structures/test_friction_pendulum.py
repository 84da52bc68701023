"""The friction pendulum under buildings and alone: against equations written out here, OpenSees, and its own energy."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import xarray as xr
from opensees_analysis import analysis
from scipy.integrate import solve_ivp

from bwbn_bayes import (
    BoucWen,
    FrictionPendulum,
    Linear,
    Oscillator,
    PerStorey,
    Record,
    ShearBuilding,
    Uniform,
    UserError,
)
from bwbn_bayes.engines.cvodes import Cvodes
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.engines.scalar import ScalarRk4
from bwbn_bayes.structures.model_source import ModelWriter
from bwbn_bayes.structures.quantities import engineering_quantities, landmarks_of
from bwbn_bayes.structures.structure import Structure

G = 9.81
MASSES = [3.0, 2.0, 1.5]
WEIGHT = G * sum(MASSES)
SLIDER = {"W": WEIGHT, "R": 2.0, "mu_slow": 0.04, "mu_fast": 0.09, "a_mu": 12.0, "Y": 0.002, "c": 0.3}
STIFFNESS, DAMPING = [900.0, 700.0], [1.5, 1.0]
TIME_STEP = 0.02
ENGINES = {
    "lanes": Lanes(substeps=16, resolution=0.03, n_threads=1),
    "scalar": ScalarRk4(substeps=16, resolution=0.03),
    "cvodes": Cvodes(rtol=1e-9, atol=1e-12),
    "reference": Reference(),
}


def isolated(slider: FrictionPendulum, *, alpha: float = 1.0) -> Structure:
    """Two storeys on a sliding base; Bouc-Wen storeys where alpha is below one."""
    k, c = PerStorey(STIFFNESS), PerStorey(DAMPING)
    above = Linear(k=k, c=c) if alpha == 1.0 else BoucWen(k=k, c=c, alpha=alpha, beta=40.0, gamma=20.0, n=1.3)
    return ShearBuilding(masses=MASSES, storey=above, isolator=slider)


def shaking(n: int = 201) -> Record:
    times = TIME_STEP * np.arange(n)
    return Record(name="shaking", time_step=TIME_STEP, excitation=2.5 * np.cos(4.0 * times) * np.exp(-0.2 * times))


def friction(slider: dict[str, float], v: np.ndarray) -> np.ndarray:
    fast, slow = slider.get("mu_fast", slider["mu_slow"]), slider["mu_slow"]
    return fast - (fast - slow) * np.exp(-slider.get("a_mu", 0.0) * np.abs(v))


def independent(slider: dict[str, float], masses: list[float], record: Record, *, alpha: float = 1.0) -> np.ndarray:
    """Displacements relative to the ground and total accelerations ``(2 n_floors, n_times)``: a chain on a slider."""
    n, mass = len(masses), np.array(masses)
    k, c = np.array(STIFFNESS[: n - 1]), np.array(DAMPING[: n - 1])

    def rates(t, y):
        x, w, z = y[:n], y[n : 2 * n], y[2 * n :]
        u, v = np.diff(x), np.diff(w)
        mu, share = friction(slider, w[0]), z[0] / slider["Y"]
        below = slider["W"] * (x[0] / slider["R"] + mu * share) + slider["c"] * w[0]
        force = np.append(below, alpha * k * u + (1.0 - alpha) * k * z[1:] + c * v)
        slides = share**2 if z[0] * w[0] > 0.0 else 0.0
        z_rate = (1.0 - np.abs(z[1:]) ** 1.3 * (40.0 * np.sign(z[1:] * v) + 20.0)) * v
        total = (np.append(force[1:], 0.0) - force) / mass
        ground = np.interp(t, record.times, record.excitation)
        return np.concatenate([w, total - ground, [(1.0 - slides) * w[0]], z_rate]), total

    y, found = np.zeros(3 * n), []
    for start, end in pairwise([*record.times, record.times[-1] + TIME_STEP]):
        found.append(np.concatenate([y[:n], rates(start, y)[1]]))
        y = solve_ivp(lambda t, y: rates(t, y)[0], (start, end), y, method="DOP853", rtol=1e-9, atol=1e-12).y[:, -1]
    return np.transpose(found)


@pytest.mark.parametrize("alpha", [1.0, 0.2])
def test_every_engine_solves_an_isolated_building(alpha):
    record = shaking()
    expected = independent(SLIDER, MASSES, record, alpha=alpha)
    channels = [*(f"displacement_{i}" for i in (1, 2, 3)), *(f"acceleration_{i}" for i in (1, 2, 3))]
    model = isolated(FrictionPendulum(**SLIDER), alpha=alpha)
    for name, engine in ENGINES.items():
        found = engine.simulate(model, np.zeros((1, 0)), record, channels).values[0]
        error = np.sqrt(np.mean((found - expected) ** 2, axis=1) / np.mean(expected**2, axis=1))
        assert np.max(error) < 1e-4, name


def test_one_coefficient_of_friction_is_that_at_every_speed():
    own = {"W": 2.0 * G, "R": 1.5, "mu_slow": 0.05, "Y": 0.002, "c": 0.0}
    record = shaking()
    model = Oscillator(mass=2.0, spring=FrictionPendulum(**own))
    found = Reference().simulate(model, np.zeros((1, 0)), record, ["displacement_1", "acceleration_1"]).values[0]
    expected = independent(own, [2.0], record)
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.max(np.abs(expected)))


def bearing(slider: dict[str, float], mass: float, record: Record, substeps: int) -> np.ndarray:
    """Displacement of a mass on OpenSees' ``singleFPBearing``, relative to the ground. [m]"""
    ops = pytest.importorskip("openseespy.opensees")
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    ops.node(1, 0.0, 0.0)
    ops.node(2, 0.0, 0.0)
    ops.fix(1, 1, 1, 1)
    ops.fix(2, 0, 0, 1)
    ops.mass(2, mass, mass, 1e-6)
    ops.frictionModel("VelDependent", 1, slider["mu_slow"], slider["mu_fast"], slider["a_mu"])
    ops.uniaxialMaterial("Elastic", 1, 1e8)
    ops.uniaxialMaterial("Elastic", 2, 1e3)
    stiffness = slider["mu_slow"] * slider["W"] / slider["Y"]
    towards = ("-P", 1, "-Mz", 2, "-orient", 0, 1, 0, -1, 0, 0, "-iter", 100, 1e-9)
    ops.element("singleFPBearing", 1, 1, 2, 1, slider["R"], stiffness, *towards)

    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    ops.load(2, 0.0, -slider["W"], 0.0)
    analysis(ops, "Static", "LoadControl", 1.0)
    assert ops.analyze(1) == 0
    ops.loadConst("-time", 0.0)
    ops.timeSeries("Path", 2, "-dt", TIME_STEP, "-values", *record.excitation, record.excitation[-1])
    ops.pattern("UniformExcitation", 2, 1, "-accel", 2)
    analysis(ops, "Transient", "Newmark", 0.5, 0.25)
    found = np.zeros(record.n_times)
    for j in range(1, record.n_times):
        assert ops.analyze(substeps, TIME_STEP / substeps) == 0
        found[j] = ops.nodeDisp(2, 1)
    ops.wipe()
    return found


def test_a_mass_on_a_slider_moves_as_on_a_bearing_of_opensees():
    """OpenSees' contact is elastic, then perfectly plastic, and its dish is curved: both small here."""
    own = {"W": 4.0 * G, "R": 10.0, "mu_slow": 0.05, "mu_fast": 0.1, "a_mu": 20.0, "Y": 0.0002}
    record = shaking()
    expected = bearing(own, 4.0, record, 40)
    size = np.max(np.abs(expected))

    def error(**changed: float) -> float:
        model = Oscillator(mass=4.0, spring=FrictionPendulum(**{**own, **changed}))
        found = Reference().simulate(model, np.zeros((1, 0)), record, ["displacement_1"]).values[0, 0]
        return float(np.max(np.abs(found - expected))) / size

    assert error() < 0.01
    assert error(a_mu=200.0) > 0.03  # the friction at rest matters
    assert error(R=9.0) > 0.01


def test_derivatives_agree_with_finite_differences():
    model = isolated(
        FrictionPendulum(
            W=Uniform(0.8 * WEIGHT, 1.2 * WEIGHT),
            R=Uniform(1.0, 3.0),
            mu_slow=Uniform(0.02, 0.06),
            mu_fast=Uniform(0.06, 0.12),
            a_mu=Uniform(5.0, 20.0),
            Y=Uniform(0.005, 0.02),
            c=Uniform(0.0, 1.0),
        )
    )
    draws, record = model.space.from_unit(np.full((1, 7), 0.45)), shaking(101)
    channels = ["acceleration_1", "acceleration_3", "drift_1"]
    expected = Reference(difference_step=1e-5).sensitivities(model, draws, record, channels)[1]
    scale = np.max(np.abs(expected), axis=3, keepdims=True)
    # With fixed steps tangents are of first order at a turn: the slope of z jumps there from sliding to sticking.
    engines = {"lanes": Lanes(substeps=200, n_threads=1), "scalar": ScalarRk4(substeps=200)}
    for name, engine in {**engines, "cvodes": ENGINES["cvodes"]}.items():
        found = engine.sensitivities(model, draws, record, channels)[1]
        assert np.max(np.abs(found - expected) / scale) < 1e-3, name


def test_energy_put_in_is_kept_stored_or_lost_in_friction():
    record = shaking()
    fine = Record(
        name="fine",
        time_step=TIME_STEP / 20,
        excitation=np.interp(np.arange(4001) / 20, np.arange(201), record.excitation),
    )
    names = [f"{kind}_{i}" for kind in ("drift", "drift_rate", "hysteretic_energy") for i in (1, 2, 3)]
    model = isolated(FrictionPendulum(**SLIDER))
    u, v, eps = Reference().simulate(model, np.zeros((1, 0)), fine, names).values[0].reshape(3, 3, -1)
    velocity, mass = np.cumsum(v, axis=0), np.array(MASSES)
    elastic = 0.5 * np.array([SLIDER["W"] / SLIDER["R"], *STIFFNESS]) @ u**2
    power = -fine.excitation * (mass @ velocity) - np.array([SLIDER["c"], *DAMPING]) @ v**2
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) * fine.time_step])
    assert np.max(np.abs(elastic + eps[0] + 0.5 * mass @ velocity**2 - work)) < 2e-4 * np.max(np.abs(work))
    lost = np.sum(friction(SLIDER, v[0]) * WEIGHT * np.abs(v[0])) * fine.time_step
    assert eps[0, -1] == pytest.approx(lost, rel=0.02)  # but for the elastic part of each stroke
    assert np.all(eps[1:] == 0.0)


def test_quantities_are_those_of_the_slider():
    """The stiffness at rest is that of the dish and the contact, and the drift is measured by ``Y``."""
    model = Oscillator(mass=4.0, spring=FrictionPendulum(W=4.0 * G, R=2.0, mu_slow=0.05, Y=0.001))
    record = shaking(51)
    names = ("drift", "hysteretic_displacement", "hysteretic_energy")
    values = Reference().simulate(model, np.zeros((1, 0)), record, [f"{name}_1" for name in names]).values
    response = xr.Dataset(
        {name: (("draw", "storey", "time"), values[:, i : i + 1]) for i, name in enumerate(names)},
        coords={"time": record.times},
    )
    own = dict(zip([p.symbol for p in model.law.parameters], model.table.fixed[0], strict=True))
    parameters = xr.Dataset({name: (("draw", "storey"), [[value]]) for name, value in own.items()})
    found = engineering_quantities(landmarks_of(response, model.law, parameters), parameters, model.masses, model.law)
    stiffness = 4.0 * G * (1.0 / 2.0 + 0.05 / 0.001)
    np.testing.assert_allclose(found["modal_period"].values, 2.0 * np.pi * np.sqrt(4.0 / stiffness))
    np.testing.assert_allclose(found["ductility"].values, np.max(np.abs(values[0, 0])) / 0.001)


def test_an_isolated_building_is_written_as_a_person_would_write_it():
    model = isolated(FrictionPendulum(**{**SLIDER, "R": Uniform(1.0, 3.0)})).with_link(Linear(k=5.0), joins=(1, 3))
    writer = ModelWriter()
    source = writer.structure(model)
    read: dict[str, Structure] = {}
    exec("\n".join([*writer.header(), source]), read)
    assert read["model"] == model


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: FrictionPendulum(W=1.0, R=1.0, mu_slow=0.1, a_mu=3.0), "a_mu without mu_fast: give both"),
        (lambda: FrictionPendulum(W=1.0, R=1.0, mu_slow=0.1, mu_fast=0.2), "mu_fast without a_mu"),
        (lambda: Oscillator(mass=1.0, spring=FrictionPendulum(W=1.0, R=0.0, mu_slow=0.1)), "R = 0 lies outside"),
    ],
)
def test_mistakes_end_in_one_sentence(make, sentence):
    with pytest.raises(UserError, match=sentence):
        make()
