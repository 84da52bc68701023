"""Several records, virgin or in sequence, and states that do not start at rest, in every engine.

The oracle integrates the equations of motion, written out here, over the excitations end to end with SciPy.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from engine_cases import ENGINES
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.linalg import expm

from bwbn_bayes import (
    BoucWen,
    InitialState,
    Linear,
    MassDamping,
    Oscillator,
    PerStorey,
    Record,
    SensorLag,
    ShearBuilding,
    Specimen,
    StrengthDegradation,
    SuddenDamage,
    Uniform,
    UserError,
    join_records,
    periodic,
    periods_until_repeated,
)
from bwbn_bayes.engines.base import Engine
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.scalar import ScalarRk4
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.structure import Structure

K, C, ALPHA, BETA, GAMMA, N, DELTA = (40.0, 35.0), 0.4, 0.1, 25.0, 12.0, 2.0, 0.15
START = {"u_0": (0.08, -0.03), "v_0": (0.2, 0.1), "z_0": (0.03, -0.02)}
CHANNELS = ("acceleration_1", "displacement_2", "hysteretic_energy_1")


def shaken(name: str, time_step: float, n: int, seed: int, measured: tuple[str, ...] = ()) -> Record:
    """A ground motion of a few sines."""
    rng, t = np.random.default_rng(seed), time_step * np.arange(n)
    ground = sum(rng.normal(0.0, 1.5) * np.sin(w * t + rng.uniform(0.0, 6.0)) for w in (3.0, 5.0, 8.0))
    return Record(
        name=name,
        time_step=time_step,
        excitation=np.asarray(ground),
        channels={channel: rng.normal(size=n) for channel in measured},
    )


FIRST, SECOND = shaken("first", 0.02, 150, 1), shaken("second", 0.0125, 220, 2)


def frame(*, starts: bool = False, free: bool = False) -> Structure:
    """Two storeys that lose strength."""
    storey = BoucWen(
        k=PerStorey([Uniform(20, 60), Uniform(20, 60)]) if free else PerStorey(list(K)),
        c=C, alpha=ALPHA, A=1.0, beta=Uniform(1, 80) if free else BETA, gamma=GAMMA, n=N,
    )  # fmt: skip
    model = ShearBuilding(masses=[1.0, 0.8], storey=storey)
    model = model.with_effect(StrengthDegradation(delta_nu=Uniform(0, 1) if free else DELTA))
    if not starts:
        return model
    priors = {name: PerStorey([Uniform(-1, 1)] * 2) if free else PerStorey(list(v)) for name, v in START.items()}
    return model.with_effect(InitialState(**priors))


TRUTH = {"k[1]": K[0], "k[2]": K[1], "beta": BETA, "delta_nu": DELTA}
TRUTH_OF_START = {f"{name}[{i}]": value for name, pair in START.items() for i, value in enumerate(pair, 1)}


def rates(y: Floats, ground: float) -> Floats:
    """Equations of motion of the frame: ``y`` holds u, v, z, epsilon of both storeys."""
    u, v, z, epsilon = y.reshape(4, 2)
    k, m = np.array(K), np.array([1.0, 0.8])
    force = ALPHA * k * u + (1.0 - ALPHA) * k * z + C * v
    total = np.array([(force[1] - force[0]) / m[0], -force[1] / m[1]])
    dz = v - (1.0 + DELTA * epsilon) * (BETA * np.abs(v) * np.abs(z) ** (N - 1.0) * z + GAMMA * v * np.abs(z) ** N)
    dv = np.array([total[0] - ground, total[1] - total[0]])
    return np.concatenate([v, dv, dz, (1.0 - ALPHA) * k * z * v])


def integrated(times: Floats, ground: Floats, start: Floats) -> Floats:
    """Channels ``(3, n_times)`` of the frame by SciPy, restarted at each sample; the ground is straight in between."""
    states = [start]
    for i in range(len(times) - 1):
        slope = (ground[i + 1] - ground[i]) / (times[i + 1] - times[i])
        piece = solve_ivp(
            lambda t, y, i=i, slope=slope: rates(y, ground[i] + slope * (t - times[i])),
            (times[i], times[i + 1]), states[-1], method="DOP853", rtol=1e-10, atol=1e-12,
        )  # fmt: skip
        states.append(piece.y[:, -1])
    y = np.array(states)
    first = np.array([rates(one, g)[2] + g for one, g in zip(y, ground, strict=True)])
    return np.array([first, y[:, 0] + y[:, 1], y[:, 6]])


def rms_error(found: Floats, true: Floats) -> float:
    """Worst channel's rms error over its rms."""
    return float(np.max(np.sqrt(np.mean((found - true) ** 2, axis=1) / np.mean(true**2, axis=1))))


SEQUENCE = join_records([FIRST, SECOND], in_sequence=True)
VIRGIN = join_records([FIRST, SECOND])


@pytest.mark.parametrize("engine", ENGINES.values(), ids=ENGINES)
def test_a_sequence_is_one_long_excitation(engine: Engine) -> None:
    """Damage, drift and velocity of the first record go on into the second, of another time step."""
    times = np.concatenate([FIRST.times, FIRST.duration + SECOND.time_step * np.arange(1, SECOND.n_times + 1)])
    np.testing.assert_allclose(SEQUENCE.times, times)
    true = integrated(times, SEQUENCE.excitation, np.zeros(8))
    found = engine.simulate(frame(), np.empty((1, 0)), SEQUENCE, CHANNELS).values[0]
    assert rms_error(found, true) < 2e-5
    apart = engine.simulate(frame(), np.empty((1, 0)), SECOND, CHANNELS).values[0]
    assert rms_error(found[:, FIRST.n_times :], apart) > 0.1


@pytest.mark.parametrize("engine", ENGINES.values(), ids=ENGINES)
def test_virgin_records_know_nothing_of_each_other(engine: Engine) -> None:
    found = engine.simulate(frame(), np.empty((1, 0)), VIRGIN, CHANNELS).values
    each = [engine.simulate(frame(), np.empty((1, 0)), one, CHANNELS).values for one in (FIRST, SECOND)]
    np.testing.assert_array_equal(found, np.concatenate(each, axis=2))


@pytest.mark.parametrize("engine", ENGINES.values(), ids=ENGINES)
def test_a_structure_starts_in_the_state_it_is_given(engine: Engine) -> None:
    start = np.concatenate([*(np.array(START[name]) for name in ("u_0", "v_0", "z_0")), np.zeros(2)])
    true = integrated(FIRST.times, FIRST.excitation, start)
    found = engine.simulate(frame(starts=True), np.empty((1, 0)), FIRST, CHANNELS).values[0]
    assert rms_error(found, true) < 2e-5
    assert found[1, 0] == pytest.approx(sum(START["u_0"]))


LATE = ("acceleration_2", "relative_acceleration_2")


def late(model: Structure, lag: float) -> tuple[Structure, Floats]:
    """With an accelerometer on the second floor that is late, and the draw that says how much."""
    model = model.with_effect(SensorLag(lag=Uniform(0.0, 0.2)), storeys=[2])
    return model, np.array([[lag]])


BLIND = {name: engine for name, engine in ENGINES.items() if name != "sunode"}
"""Sunode refuses sensors."""


@pytest.mark.parametrize("engine", BLIND.values(), ids=BLIND)
def test_a_late_sensor_shows_how_the_records_before_ended(engine: Engine) -> None:
    """Of a sequence it showed zeros at the beginning of each record. Here they are one record, cut twice."""
    model, draw = late(frame(), 0.193)
    one, two, three = np.split(FIRST.excitation, [60, 68])  # 9.65 samples reach past the second
    cut = [replace(FIRST, name=name, excitation=part) for name, part in (("a", one), ("b", two), ("c", three))]
    whole = engine.sensitivities(model, draw, FIRST, LATE)
    parts = engine.sensitivities(model, draw, join_records(cut, in_sequence=True), LATE)
    np.testing.assert_allclose(parts[0].values[..., 68:], whole[0].values[..., 68:], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(parts[1][..., 68:], whole[1][..., 68:], rtol=0.0, atol=1e-4)


@pytest.mark.parametrize("engine", BLIND.values(), ids=BLIND)
def test_a_late_sensor_shows_the_end_of_a_record_of_another_time_step(engine: Engine) -> None:
    """Against a spline through the true response to both; of records that know nothing of each other it shows rest."""
    model, draw = late(frame(), 0.043)
    n, times = FIRST.n_times, SEQUENCE.times
    true = engine.simulate(frame(), np.empty((1, 0)), SEQUENCE, LATE).values[0]
    total = CubicSpline(times, true[0])(times[n:] - 0.043)
    found = engine.simulate(model, draw, SEQUENCE, LATE).values[0, :, n:]
    expected = np.array([total, total - SECOND.excitation])
    assert np.max(np.abs(found - expected)[:, :-5]) < 2e-3 * np.max(np.abs(true))
    assert np.max(np.abs(true[0, n : n + 3])) > 0.1 * np.max(np.abs(true[0]))
    virgin = engine.simulate(model, draw, VIRGIN, LATE).values[..., n:]
    np.testing.assert_array_equal(virgin, engine.simulate(model, draw, SECOND, LATE).values)


@pytest.mark.parametrize("engine", BLIND.values(), ids=BLIND)
def test_a_late_sensor_holds_the_first_value_of_what_did_not_start_at_rest(engine: Engine) -> None:
    """It showed zero until the lag had passed. Nobody knows what was before."""
    model, draw = late(frame(starts=True), 0.053)
    true = engine.simulate(frame(starts=True), np.empty((1, 0)), FIRST, LATE[:1]).values[0, 0]
    found = engine.simulate(model, draw, FIRST, LATE[:1]).values[0, 0]
    expected = CubicSpline(FIRST.times, true)(np.maximum(FIRST.times - 0.053, 0.0))
    assert np.max(np.abs(found - expected)[:-5]) < 1e-2 * np.max(np.abs(true))


FINE = {
    name: replace(engine, substeps=64) if isinstance(engine, (Lanes, ScalarRk4)) else engine
    for name, engine in ENGINES.items()
    if name != "reference"
}
"""Derivatives jump where a drift rate changes sign: they take shorter steps than the response."""


@pytest.fixture(scope="module")
def differences() -> Floats:
    """Derivatives of the response to the sequence by central differences of the reference engine."""
    model = frame(starts=True, free=True)
    return ENGINES["reference"].sensitivities(model, model.draws({**TRUTH, **TRUTH_OF_START}), SEQUENCE, CHANNELS)[1]


@pytest.mark.parametrize("engine", FINE.values(), ids=FINE)
def test_derivatives_go_on_through_a_sequence(engine: Engine, differences: Floats) -> None:
    """Those in what the structure is and in how it started."""
    model = frame(starts=True, free=True)
    _, found = engine.sensitivities(model, model.draws({**TRUTH, **TRUTH_OF_START}), SEQUENCE, CHANNELS)
    error = np.sqrt(np.mean((found - differences) ** 2, axis=3) / np.mean(differences**2, axis=3))
    assert np.max(error) < 1e-3


@pytest.mark.parametrize("engine", ENGINES.values(), ids=ENGINES)
@pytest.mark.parametrize("in_sequence", [False, True], ids=["virgin", "in sequence"])
def test_sums_are_those_of_each_channel_of_each_record(engine: Engine, in_sequence: bool) -> None:
    """Records that measure different channels, with a pause between them that measures none."""
    pause = Record(name="pause", time_step=0.02, excitation=np.zeros(20))
    first = shaken("first", 0.02, 60, 1, ("acceleration_1", "acceleration_2"))
    record = join_records([first, pause, shaken("second", 0.0125, 90, 2, ("drift_1",))], in_sequence=in_sequence)
    model = frame(free=True)
    draws = np.repeat(model.draws(TRUTH), 2, axis=0)
    draws[1, 0] *= 1.05
    assert [block.label for block in record.blocks] == [
        "acceleration_1 of first", "acceleration_2 of first", "drift_1 of second",
    ]  # fmt: skip
    response, slopes = engine.sensitivities(model, draws, record)
    residual = record.measured - response.values
    stretches = [(0, slice(0, 60)), (1, slice(0, 60)), (2, slice(80, 170))]
    misfit = np.array([np.sum(residual[:, row, part] ** 2, axis=1) for row, part in stretches]).T
    gradient = np.array([np.einsum("npt,nt->np", slopes[:, :, c, s], residual[:, c, s]) for c, s in stretches])
    found = engine.normal_equations(model, draws, record)
    np.testing.assert_allclose(engine.misfit(model, draws, record), misfit, rtol=1e-6)
    np.testing.assert_allclose(found.misfit, misfit, rtol=1e-9)
    np.testing.assert_allclose(found.gradient, np.moveaxis(gradient, 0, 1), rtol=1e-6, atol=1e-9)
    for block, (c, s) in enumerate(stretches):
        expected = np.einsum("npt,nqt->npq", slopes[:, :, c, s], slopes[:, :, c, s])
        np.testing.assert_allclose(found.information[:, block], expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("engine", ENGINES.values(), ids=ENGINES)
def test_an_event_happens_once_in_a_sequence(engine: Engine) -> None:
    """At a time that counts from the first sample of the first record, whichever record it falls in."""
    model = frame().with_effect(SuddenDamage(parameter="k", jump=-15.0, time=Uniform(0, 6)), storeys=[1])
    one = Record(name="one", time_step=0.02, excitation=np.tile(FIRST.excitation, 2))
    two = join_records([FIRST, FIRST], in_sequence=True)
    for time in (1.23, 4.11):
        whole = engine.sensitivities(model, np.array([[time]]), one, CHANNELS)
        parts = engine.sensitivities(model, np.array([[time]]), two, CHANNELS)
        np.testing.assert_allclose(parts[0].values, whole[0].values, rtol=0.0, atol=1e-6)
        difference = np.sqrt(np.mean((parts[1] - whole[1]) ** 2) / np.mean(whole[1] ** 2))
        assert difference < 1e-3


@pytest.mark.parametrize("engine", ENGINES.values(), ids=ENGINES)
def test_a_link_past_a_floor_and_a_floor_s_velocity_start_with_the_storeys(engine: Engine) -> None:
    """A linear frame with a brace and damping to the ground, let go in motion, by the matrix exponential."""
    model = ShearBuilding(masses=[2.0, 1.0], storey=Linear(k=PerStorey([90.0, 60.0]), c=0.5))
    model = model.with_link(Linear(k=20.0, c=0.2), joins=(0, 2)).with_effect(MassDamping(c_m=0.3))
    model = model.with_effect(InitialState(u_0=PerStorey([0.1, -0.04]), v_0=PerStorey([0.5, 0.3])), storeys=[1, 2])
    mass, incidence = np.diag([2.0, 1.0]), np.array([[1.0, 0.0], [-1.0, 1.0], [0.0, 1.0]])
    stiffness = incidence.T @ np.diag([90.0, 60.0, 20.0]) @ incidence
    damping = incidence.T @ np.diag([0.5, 0.5, 0.2]) @ incidence + 0.3 * mass
    inverse = np.linalg.inv(mass)
    matrix = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ stiffness, -inverse @ damping]])
    step, states = expm(0.01 * matrix), [np.array([0.1, 0.06, 0.5, 0.8])]
    for _ in range(199):
        states.append(step @ states[-1])
    still = Record(name="still", time_step=0.01, excitation=np.zeros(200))
    names = ("displacement_1", "displacement_2", "drift_3")
    found = engine.simulate(model, np.empty((1, 0)), still, names).values[0]
    true = np.array(states)[:, [0, 1, 1]].T
    np.testing.assert_allclose(found, true, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("engine", ENGINES.values(), ids=ENGINES)
def test_periods_before_the_measured_one_make_it_steady(engine: Engine) -> None:
    """A linear oscillator under a force: the response is that of the transfer function, line by line."""
    n, dt, m, k, c = 256, 0.01, 2.0, 300.0, 6.0
    rng, lines = np.random.default_rng(3), np.arange(1, 9)
    sines = rng.normal(size=8)[:, None] * np.sin(2.0 * np.pi * np.outer(lines, np.arange(n) / n) + rng.random((8, 1)))
    force = np.sum(sines, axis=0)
    one = Record(
        name="period", time_step=dt, excitation=np.zeros(n), forces={"applied_force_1": force},
        channels={"displacement_1": np.ones(n)},
    )  # fmt: skip
    steady = periodic(one, periods=6)
    assert [block.label for block in steady.blocks] == ["displacement_1 of record 7"]
    model = Oscillator(mass=m, spring=Linear(k=k, c=c))
    found = engine.simulate(model, np.empty((1, 0)), steady).values[0, 0, -n:]
    # Samples joined by straight lines: each line and its aliases pass the transfer function with the hat's spectrum.
    spectrum, true = np.fft.fft(force), np.zeros(n)
    for alias in range(-40, 41):
        order = np.fft.fftfreq(n, 1.0 / n) + alias * n
        omega = 2.0 * np.pi * order / (n * dt)
        hat = np.sinc(order / n) ** 2
        true += np.fft.ifft(spectrum * hat / (k - m * omega**2 + 1j * c * omega)).real
    np.testing.assert_allclose(found, true, rtol=0.0, atol=1e-5 * np.max(np.abs(true)))


def test_periods_are_counted_until_the_response_repeats() -> None:
    """A linear oscillator forgets its start by exp(-zeta omega T) a period; one that degrades never repeats."""
    n, dt, m, k, c = 200, 0.01, 2.0, 300.0, 1.2
    force = {"applied_force_1": np.sin(2.0 * np.pi * np.arange(n) / n)}
    one = Record(name="period", time_step=dt, excitation=np.zeros(n), forces=force)
    kept = math.exp(-0.5 * c / m * n * dt)
    linear = Oscillator(mass=m, spring=Linear(k=Uniform(100.0, 400.0), c=c))
    for within in (1e-2, 1e-4, 1e-6):
        # What is left after p periods is kept^p of what began: of about the size of the steady vibration here.
        found = periods_until_repeated(linear, one, {"k": k}, within=within)
        assert math.log(within) / math.log(kept) - 4.0 < found < math.log(within) / math.log(kept) + 4.0
    spring = BoucWen(k=k, c=c, alpha=0.1, A=1.0, beta=400.0, gamma=100.0, n=1.0)
    wears = Oscillator(mass=m, spring=spring).with_effect(StrengthDegradation(delta_nu=2e-3))
    with pytest.raises(UserError, match="does not repeat within 1024 periods: does the structure degrade"):
        periods_until_repeated(wears, one, {})
    for within in (0.0, -1.0, math.nan, math.inf):  # not a number was taken for one period, zero solved 1,024
        with pytest.raises(UserError, match="it must be a positive number"):
            periods_until_repeated(linear, one, {"k": k}, within=within)


def test_a_specimen_is_led_from_the_end_of_one_test_to_the_beginning_of_the_next() -> None:
    spring = BoucWen(k=10.0, c=0.0, alpha=0.1, A=1.0, beta=0.5, gamma=0.3, n=1.0)
    path = np.concatenate([np.linspace(0.0, 3.0, 30), np.linspace(2.9, -2.0, 40)])
    halves = [
        Record(name=name, time_step=1.0, excitation=part, excitation_kind="displacement", has_time=False)
        for name, part in (("a", path[:45]), ("b", path[45:]))
    ]
    whole = Record(name="whole", time_step=1.0, excitation=path, excitation_kind="displacement", has_time=False)
    for engine in ENGINES.values():
        one = engine.simulate(Specimen(storey=spring), np.empty((1, 0)), whole, ["force"]).values
        two = engine.simulate(
            Specimen(storey=spring), np.empty((1, 0)), join_records(halves, in_sequence=True), ["force"]
        )
        np.testing.assert_allclose(two.values, one, rtol=0.0, atol=1e-6)


def test_virgin_records_start_in_no_state_of_one_of_them() -> None:
    with pytest.raises(UserError, match="join them in sequence, or give one"):
        ENGINES["lanes"].simulate(frame(starts=True), np.empty((1, 0)), VIRGIN, CHANNELS)
