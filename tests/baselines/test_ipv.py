"""IPV: the network against its equation, the identity map and its noise, drifts by integration, prediction."""

from __future__ import annotations

import numpy as np
import pytest

from bwbn_bayes import BoucWen, PerStorey, Record, ShearBuilding, UserError, add_noise, filtered_noise, simulate
from bwbn_bayes.baselines.ipv import fit_forces, force_noise_sd, kinematics, predict
from bwbn_bayes.baselines.network import NetworkSettings, hidden, train
from bwbn_bayes.parameters import Floats

MASSES = (1.0, 2.0, 1.5)
CHANNELS = [f"{kind}_{i}" for kind in ("acceleration", "drift", "force", "displacement") for i in (1, 2, 3)]


def building(beta: float) -> ShearBuilding:
    storey = BoucWen(k=PerStorey([60.0, 50.0, 40.0]), c=0.8, alpha=0.1, A=1.0, beta=beta, gamma=0.0, n=1.0)
    return ShearBuilding(masses=MASSES, storey=storey)


def recorded(beta: float, seed: int = 1) -> Record:
    motion = filtered_noise(np.random.default_rng(seed), 20.0, 0.02, rms=1.0)
    return simulate(building(beta), motion, {}, channels=CHANNELS)


@pytest.fixture(scope="module")
def clean() -> Record:
    """A yielding building."""
    return recorded(20.0)


@pytest.fixture(scope="module")
def linear() -> Record:
    """A building that hardly yields: its force is a function of drift and drift rate."""
    return recorded(1e-6)


def forces(record: Record) -> Floats:
    return np.stack([record.channels[f"force_{i}"] for i in (1, 2, 3)])


def test_hidden_units_are_eq_11() -> None:
    inputs, centres = np.array([[0.0, 0.0], [1.0, 2.0]]), np.array([[0.0, 0.0], [1.0, 0.0]])
    expected = np.exp(-np.array([[0.0 / 4.0, 1.0 / 9.0], [5.0 / 4.0, 4.0 / 9.0]]))
    assert hidden(inputs, centres, np.array([2.0, 3.0])) == pytest.approx(expected)


def test_a_network_learns_a_function_of_its_own_form() -> None:
    rng = np.random.default_rng(1)
    inputs = rng.uniform(-1.0, 1.0, (800, 2))
    output = np.exp(-np.sum(inputs**2, axis=1)) - 0.3 * np.exp(-np.sum((inputs - 0.5) ** 2, axis=1))
    network = train(inputs, output, rng)
    fresh = rng.uniform(-0.95, 0.95, (200, 2))
    expected = np.exp(-np.sum(fresh**2, axis=1)) - 0.3 * np.exp(-np.sum((fresh - 0.5) ** 2, axis=1))
    assert np.sqrt(np.mean((network(fresh) - expected) ** 2)) < 0.01 * np.std(output)
    assert network(np.array([[50.0, 0.3]])) == pytest.approx(network(np.array([[np.max(inputs[:, 0]), 0.3]])))


def test_the_validation_prefers_no_large_network_for_noise() -> None:
    """Pure noise: nothing can be learned, and the error on the blocks kept back is about the noise itself."""
    rng = np.random.default_rng(2)
    network = train(rng.standard_normal((1000, 2)), rng.standard_normal(1000), rng)
    assert 0.9 < network.validation_error < 1.2


def test_printed_inputs_repeat_sums_of_measured_accelerations(clean: Record) -> None:
    record = add_noise(clean.select(CHANNELS[:3]), 20.0, np.random.default_rng(1))
    fit = fit_forces(record, MASSES, np.random.default_rng(1))
    accelerations = np.stack([record.channels[f"acceleration_{i}"] for i in (1, 2, 3)])
    sums = -np.cumsum((np.array(MASSES)[:, None] * accelerations)[::-1], axis=0)[::-1]
    assert np.all(np.sqrt(np.mean((fit.forces - sums) ** 2, axis=1)) < 0.003 * np.sqrt(np.mean(sums**2, axis=1)))
    assert np.all(fit.departure < 0.003)


def test_noise_of_the_forces_is_the_closed_form(clean: Record) -> None:
    """Standard error of an rms of 1,001 independent errors: 2.2 %; four of them, and the map's own error."""
    record = add_noise(clean.select(CHANNELS[:3]), 20.0, np.random.default_rng(3))
    fit = fit_forces(record, MASSES, np.random.default_rng(1))
    expected = force_noise_sd(record.noise_sd, MASSES)
    found = np.sqrt(np.mean((fit.forces - forces(clean)) ** 2, axis=1))
    assert found == pytest.approx(expected, rel=4.0 / np.sqrt(2 * record.n_times) + 0.02)
    by_hand = [record.noise_sd[f"acceleration_{i}"] * m for i, m in zip((1, 2, 3), MASSES, strict=True)]
    assert expected == pytest.approx([np.linalg.norm(by_hand[i:]) for i in range(3)])


def test_noise_free_forces_are_the_true_ones(clean: Record) -> None:
    """The true force never enters the training: only the accelerations are kept."""
    fit = fit_forces(clean.select(CHANNELS[:3]), MASSES, np.random.default_rng(1))
    assert [np.corrcoef(a, b)[0, 1] for a, b in zip(fit.forces, forces(clean), strict=True)] > [0.9999] * 3


def test_drifts_are_measured_or_integrated(linear: Record) -> None:
    measured = np.stack([linear.channels[f"drift_{i}"] for i in (1, 2, 3)])
    drift, rate = kinematics(linear, 3)
    assert drift == pytest.approx(measured)
    from_floors, _ = kinematics(linear.select([*CHANNELS[:3], *CHANNELS[9:]]), 3)
    assert from_floors == pytest.approx(measured, abs=1e-12)
    integrated, _ = kinematics(linear.select(CHANNELS[:3]), 3, high_pass_hz=0.1)
    inside = slice(100, 900)  # away from the ends, where a filter knows nothing
    for i in range(3):
        assert np.corrcoef(integrated[i, inside], measured[i, inside])[0, 1] > 0.99
        slope = np.gradient(measured[i], linear.time_step)
        assert np.corrcoef(rate[i, inside], slope[inside])[0, 1] > 0.99


def test_the_drift_variant_predicts_a_building_without_memory(linear: Record) -> None:
    """Another excitation, half as strong, so that the networks are asked inside what they have seen."""
    fit = fit_forces(linear, MASSES, np.random.default_rng(1), variant="drift")
    motion = filtered_noise(np.random.default_rng(7), 10.0, 0.02, rms=0.5)
    true = simulate(building(1e-6), motion, {}, channels=CHANNELS)
    predicted = predict(fit, MASSES, motion)
    for i in range(3):
        expected = true.channels[f"acceleration_{i + 1}"]
        assert np.sqrt(np.mean((predicted.acceleration[i] - expected) ** 2) / np.mean(expected**2)) < 0.15


def test_the_drift_variant_averages_loops(clean: Record) -> None:
    """A yielding storey's force is no function of drift and drift rate: it must miss more than the printed variant."""
    fit = fit_forces(clean, MASSES, np.random.default_rng(1), variant="drift")
    assert np.all(fit.departure > 0.03)


def test_printed_inputs_cannot_predict(clean: Record) -> None:
    fit = fit_forces(clean, MASSES, np.random.default_rng(1))
    with pytest.raises(UserError, match="cannot predict"):
        predict(fit, MASSES, clean)


def test_a_missing_sensor_is_one_sentence(clean: Record) -> None:
    with pytest.raises(UserError, match="acceleration_2"):
        fit_forces(clean.select(["acceleration_1", "acceleration_3"]), MASSES, np.random.default_rng(1))


@pytest.mark.parametrize("options", [{"sizes": ()}, {"widths": (0.0,)}, {"ridges": (-1.0,)}, {"least_width": 0.0}])
def test_bad_network_settings_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(UserError, match="network"):
        NetworkSettings(**options)  # type: ignore[arg-type]
