"""A law solved under given motion, and the response beside an unnamed force that is exact along the ridge of both."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from bwbn_bayes import Appendage, BoucWen, InitialState, MassError, Oscillator, Record, ShearBuilding, Uniform
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.unnamed.along import AlongMotion, Pinned, Shown, can_be_pinned
from bwbn_bayes.inference.unnamed.first_order import FirstOrder
from bwbn_bayes.inference.unnamed.pulses import knots_of
from bwbn_bayes.inference.unnamed.storey import ANY_KIND, functions, pulled, whole_process
from bwbn_bayes.inference.unnamed.together import Together, Weights, together
from bwbn_bayes.parameters import Floats

ENGINE = Lanes(n_threads=1, substeps=8)
N, DT = 300, 0.02
TIMES = DT * np.arange(N)
GROUND = 2.0 * np.sin(2.0 * np.pi * 0.8 * TIMES) * np.minimum(TIMES, 1.0)
MODEL = ShearBuilding(
    masses=[2.0, 1.0],
    storey=BoucWen(k=Uniform(40, 80), c=Uniform(0.1, 1.0), alpha=0.1, beta=Uniform(5, 60), gamma=5.0, n=1.2),
)
HERE, FAR = np.array([60.0, 0.4, 15.0]), np.array([75.0, 0.9, 50.0])
MOTION = np.array([[0.05], [0.08]]) * np.square(np.sin(2.0 * np.pi * 0.6 * TIMES)) * np.exp(-0.2 * TIMES)
"""From rest, since it begins as the square of time."""


def law(values: Floats, motion: Floats) -> Floats:
    """By SciPy: forces of both storeys along a motion of the floors."""
    k, c, beta = values
    spline = CubicSpline(TIMES, np.array([motion[0], motion[1] - motion[0]]), axis=1, bc_type=("clamped", "natural"))

    def rates(t: float, z: Floats) -> Floats:
        v = spline(t, 1)
        return np.asarray(v - np.abs(z) ** 1.2 * (beta * np.sign(z * v) + 5.0) * v)

    z = solve_ivp(rates, (0.0, TIMES[-1]), np.zeros(2), t_eval=TIMES, rtol=1e-9, atol=1e-12, max_step=DT / 4).y
    return np.asarray(0.1 * k * spline(TIMES) + 0.9 * k * z + c * spline(TIMES, 1))


def test_links_are_solved_along_a_motion_that_they_cannot_change() -> None:
    record = Record(name="moved", time_step=DT, excitation=GROUND)
    pinned = Pinned.along(ENGINE, MODEL, record, MOTION)
    drawn = np.array([HERE, FAR])
    moved = ENGINE.simulate(pinned.model, drawn, pinned.record, ("displacement_1", "displacement_2")).values
    np.testing.assert_allclose(moved, np.broadcast_to(MOTION, moved.shape), atol=1e-5 * np.max(MOTION))
    forces, (same, slopes) = pinned.forces(drawn), pinned.rates(drawn)
    np.testing.assert_allclose(same, forces, rtol=1e-6, atol=1e-6 * np.max(forces))
    for own, values in zip(forces, drawn, strict=True):
        expected = law(values, MOTION)
        assert np.max(np.abs(own - expected)) < 2e-4 * np.max(np.abs(expected))
    steps = 1e-4 * HERE
    for number, step in enumerate(steps):
        ends = pinned.forces(HERE + np.outer([1.0, -1.0], step * np.eye(3)[number]))
        quotient = (ends[0] - ends[1]) / (2.0 * step)
        np.testing.assert_allclose(slopes[0, number], quotient, atol=2e-3 * np.max(np.abs(quotient)))


def test_what_pulls_at_a_floor_is_not_left_out() -> None:
    """With a mass that is a billion times as large such an effect would be as well."""
    assert can_be_pinned(MODEL)
    assert not can_be_pinned(MODEL.with_effect(InitialState(u_0=Uniform(-0.01, 0.01))))
    for effect in (MassError(e_m=Uniform(-0.1, 0.1)), Appendage(mu_t=0.05, f_t=1.0, zeta_t=0.02)):
        assert not can_be_pinned(MODEL.with_effect(effect))


class Told(NamedTuple):
    """A record of the model beside a force, and what is told about the truth of both."""

    record: Record
    found: Together
    force: Floats


@pytest.fixture(scope="module")
def told() -> Told:
    """The model at HERE beside a friction of both storeys that it does not have, smoothed."""
    bare = Record(name="bare", time_step=DT, excitation=GROUND)
    rates = ENGINE.simulate(MODEL, HERE[None], bare, ("drift_rate_1", "drift_rate_2")).values[0]
    force = 0.3 * np.tanh(rates / 0.1)
    driven = pulled(bare, MODEL, {1: force[0], 2: force[1]})
    shown = ENGINE.simulate(MODEL, HERE[None], driven, ("acceleration_1", "acceleration_2")).values[0]
    rng = np.random.default_rng(5)
    level = 0.02 * np.std(shown, axis=1)
    channels = {
        f"acceleration_{i}": own + sd * rng.standard_normal(N) for i, own, sd in zip((1, 2), shown, level, strict=True)
    }
    record = bare.with_channels(channels)
    posterior = Posterior(model=MODEL, record=record, engine=ENGINE, noise=default_noise(record))
    point = posterior.space.to_unit(HERE[None])[0]
    return Told(record, together(posterior, point, 0.1, level), force)


def test_a_step_along_the_ridge_leaves_the_response_as_it_is(told: Told) -> None:
    """Parameters far away, and the force that makes up for them: solved in full, and as the engine has it.

    A response that is linear in the parameters is wrong there by many times the noise.
    """
    found, record = told.found, told.record
    view = found.view
    engine = view.engine
    assert isinstance(engine, AlongMotion)
    step = engine.pinned.forces(FAR[None])[0] - engine.forces
    acting = found.here.view.record.forces
    driven = record.driven_by(GROUND, acting)
    here = ENGINE.simulate(MODEL, found.values[None], driven).values[0]
    there = ENGINE.simulate(MODEL, FAR[None], pulled(driven, MODEL, {1: -step[0], 2: -step[1]})).values[0]
    sd = found.level[:, None]
    assert np.sqrt(np.mean(np.square((there - here) / sd))) < 0.3
    own = engine.simulate(MODEL, np.array([found.values, FAR]), record).values
    as_told = own[1] - own[0] - engine.shown(step)
    assert np.sqrt(np.mean(np.square(as_told / sd))) < 0.3
    linear = FirstOrder.simulate(engine, MODEL, np.array([found.values, FAR]), record).values
    assert np.sqrt(np.mean(np.square((linear[1] - linear[0] - engine.shown(step)) / sd))) > 5.0


def test_at_its_point_it_is_the_response_to_first_order(told: Told) -> None:
    found, record = told.found, told.record
    engine = found.view.engine
    assert isinstance(engine, AlongMotion)
    values = np.array([found.values, FAR])
    response, slopes = engine.sensitivities(MODEL, values, record)
    np.testing.assert_allclose(response.values, engine.simulate(MODEL, values, record).values, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(response.values[0], engine.response, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(slopes[0], engine.slopes, rtol=1e-6, atol=1e-6 * np.max(np.abs(engine.slopes)))
    for number, size in enumerate(1e-4 * FAR):
        ends = engine.simulate(MODEL, FAR + np.outer([1.0, -1.0], size * np.eye(3)[number]), record).values
        quotient = (ends[0] - ends[1]) / (2.0 * size)
        np.testing.assert_allclose(slopes[1, number], quotient, atol=5e-3 * np.max(np.abs(quotient)))
    again = AlongMotion.about(engine, engine.pinned, engine.shown)
    assert repr(again) == repr(engine)
    assert repr(AlongMotion.about(engine, engine.pinned, _louder(engine.shown))) != repr(engine)


def _louder(shown: Shown) -> Shown:
    return Shown(samples=shown.samples, n_times=shown.n_times, answers=1.1 * shown.answers, at_once=shown.at_once)


def test_what_is_faster_than_the_knots_shows_at_once() -> None:
    """A storey pulls at the floor above it and pushes the one below, and a base that shakes feels nothing."""
    record = Record(name="two", time_step=DT, excitation=GROUND, channels={"acceleration_1": GROUND, "drift_2": GROUND})
    samples = np.arange(0, N, 10)
    shown = Shown.of(MODEL, record, samples, np.zeros((2, len(samples), 2, N)))
    forces = np.zeros((2, N))
    forces[0, 15], forces[1, 25] = 3.0, 4.0
    expected = np.zeros((2, N))
    expected[0, 15], expected[0, 25] = -3.0 / 2.0, 4.0 / 2.0
    np.testing.assert_allclose(shown(forces), expected)
    # What is straight between knots is slow.
    np.testing.assert_allclose(
        shown(np.broadcast_to(np.linspace(0.0, 1.0, N), (2, N)))[:, : samples[-1]], 0.0, atol=1e-12
    )


def test_the_force_and_the_noise_are_found(told: Told) -> None:
    """The posterior of the parameters has room for the truth, the force comes close, and noise is what it was."""
    found, true_level = told.found, 0.02 * np.std(told.record.measured, axis=1)
    np.testing.assert_allclose(found.level, true_level, rtol=0.15)  # of 300 samples, of which functions follow a part
    truth = found.posterior.space.to_unit(HERE[None])
    view = found.view
    assert float(view.log_likelihood(truth)[0]) > float(view.log_likelihood(found.point[None])[0]) - 6.0
    knots = knots_of(told.record, MODEL)
    weights = found.weights_at(truth[0])
    for storey, own in found.forces_of(weights).items():
        expected = told.force[storey - 1, knots.samples]
        assert np.corrcoef(own, expected)[0, 1] > 0.9


def test_a_force_that_is_smaller_than_believed_is_not_taken_for_less_noise(told: Told) -> None:
    """A misfit counts by the noise's own level, whatever the functions leave; they leave of it what a smoother does."""
    rng = np.random.default_rng(8)
    shown = 3.0 * rng.standard_normal((60, 2 * N))
    weights = Weights.of(shown)
    hat = shown.T @ np.linalg.solve(shown @ shown.T + np.eye(60), shown)
    np.testing.assert_allclose(weights.unfollowed, np.sum(np.square(np.eye(2 * N) - hat), axis=1))
    noise = told.found.view.noise
    assert noise.correlation is not None
    misfit = np.array([[0.8, 1.1]]) * N * np.square(told.found.level)
    more = misfit * np.array([[1.01, 1.0]])
    values = np.empty((1, 0))
    lost = noise.log_likelihood(misfit, N, values) - noise.log_likelihood(more, N, values)
    assert lost[0] == pytest.approx(0.5 * 0.008 * N, rel=1e-4)


def test_nothing_is_left_out_of_a_process() -> None:
    """Its functions have the covariance that the process has: the mean of its parts, each of the same variance.

    By the formulas of the parts; 120 functions leave out some of the variance.
    """
    rng = np.random.default_rng(2)
    record = Record(name="long", time_step=DT, excitation=np.zeros(400))
    one = ShearBuilding(masses=[1.0], storey=BoucWen(k=1.0, beta=1.0, gamma=0.0))
    knots = knots_of(record, one)
    n = len(knots.samples)
    smooth = np.cumsum(rng.standard_normal((2, n)), axis=1)
    states = {
        "drift": smooth[:1],
        "drift_rate": np.gradient(smooth[0])[None],
        "hysteretic_displacement": np.tanh(smooth[:1]),
        "hysteretic_energy": np.cumsum(np.abs(smooth[1:]), axis=1),
    }
    all_of_it = whole_process(states, knots, 0, n)
    drift, rate, z, work = (own[0] / np.max(np.abs(own)) for own in states.values())

    def alike(own: Floats, length: float) -> Floats:
        return np.asarray(np.exp(-np.square(np.subtract.outer(own, own)) / (2.0 * length**2)))

    time, worn = knots.times / knots.times[-1], alike(work, 1.0)
    turned = alike(np.tanh(rate / 0.1), 1.0) * worn
    path = np.append(0.0, np.cumsum(np.abs(np.diff(drift))))
    slow = 0.5 * (alike(time, 0.3) + alike(time, 0.1))
    parts = [
        alike(z, 0.5) * turned,
        alike(z, 0.15) * turned,
        alike(drift, 0.5) * worn,
        alike(rate, 0.5) * worn,
        sum(np.outer(own, own) for own in (drift, rate, z)) * slow,
        np.exp(-np.abs(np.subtract.outer(path, path)) / 0.5) * alike(time, 0.02),
    ]
    expected = np.mean([part / np.mean(np.diag(part)) for part in parts], axis=0)
    np.testing.assert_allclose(all_of_it.T @ all_of_it, expected, atol=1e-6)
    cut_off = functions(states, knots, 0, 120)[ANY_KIND]
    assert np.sum(np.square(cut_off)) < 0.995 * np.trace(expected)


def test_an_oscillator_is_pinned_as_well() -> None:
    model = Oscillator(mass=3.0, spring=BoucWen(k=Uniform(40, 80), beta=10.0, gamma=2.0, n=1.0))
    record = Record(name="one", time_step=DT, excitation=GROUND)
    pinned = Pinned.along(ENGINE, model, record, MOTION[:1])
    moved = ENGINE.simulate(pinned.model, np.array([[60.0]]), pinned.record, ("drift_1",)).values[0]
    np.testing.assert_allclose(moved, MOTION[:1], atol=1e-6)
