"""Reading a signal late, and the price of sensors that do nothing."""

from __future__ import annotations

import numpy as np
import pytest

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import SensorBias, SensorGain, SensorLag
from bwbn_bayes.engines.observation import delayed, sensors_of
from bwbn_bayes.engines.stretches import stretches_of
from bwbn_bayes.parameters import Uniform
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding

DT = 0.02


def grown(t: np.ndarray, frequency: float) -> np.ndarray:
    """A sine that grows smoothly from rest at t = 0."""
    return np.where(
        t > 0.0, (1.0 - np.exp(-((np.maximum(t, 0.0) / 0.5) ** 4))) * np.sin(2.0 * np.pi * frequency * t), 0
    )


@pytest.mark.parametrize("lag", [0.3, 0.5, 1.0, 2.7, 7.5, 40.25])
@pytest.mark.parametrize("frequency", [1.0, 4.0, 8.0])
def test_a_late_signal_is_the_signal_earlier(frequency: float, lag: float) -> None:
    """Against the function itself: 6e-5 in the record, 5e-3 in its last five samples, as stated."""
    t = np.arange(400) * DT
    late, rate = delayed(grown(t, frequency)[None], lag)
    exact = grown(t - lag * DT, frequency)
    assert np.max(np.abs(late[0] - exact)[:-5]) < 6e-5
    assert np.max(np.abs(late[0] - exact)[-5:]) < 5e-3
    slope = (grown(t - (lag + 1e-4) * DT, frequency) - grown(t - (lag - 1e-4) * DT, frequency)) / 2e-4
    assert np.max(np.abs(rate - slope)[:-5]) < 4e-4


@pytest.mark.parametrize("lag", [0.4, 3.6])
def test_the_derivative_is_that_of_the_interpolant(lag: float) -> None:
    """Of noise, which no interpolant follows: to the rounding of a central difference."""
    rows = np.random.default_rng(1).normal(size=(2, 60))
    step = 1e-5
    ends = [delayed(rows, lag + side * step)[0][0] for side in (1.0, -1.0)]
    np.testing.assert_allclose(delayed(rows, lag)[1], (ends[0] - ends[1]) / (2 * step), rtol=0, atol=1e-6)


def test_without_a_lag_signals_stay_and_have_a_derivative_in_it() -> None:
    rows = np.random.default_rng(3).normal(size=(3, 60))
    late, rate = delayed(rows, 0.0)
    np.testing.assert_array_equal(late, rows)
    np.testing.assert_allclose(rate, (delayed(rows, 1e-6)[0][0] - rows[0]) / 1e-6, rtol=1e-5, atol=1e-4)


def test_whole_samples_short_records_and_long_lags() -> None:
    rows = np.random.default_rng(2).normal(size=(3, 30))
    np.testing.assert_allclose(delayed(rows, 0.0)[0], rows, rtol=0, atol=1e-12)
    np.testing.assert_allclose(delayed(rows, 4.0)[0][:, 4:], rows[:, :-4], rtol=0, atol=1e-12)
    np.testing.assert_allclose(delayed(rows[:, :5], 2.0)[0][:, 2:], rows[:, :3], rtol=0, atol=1e-12)
    assert not np.any(delayed(rows, 100.0)[0])


@pytest.mark.parametrize("lag", [0.0, 0.4, 3.0, 3.6, 100.0])
def test_a_first_value_may_be_held(lag: float) -> None:
    """A constant stays one; what comes later is as from zero before. 1e-2: the swing starts with a kink."""
    t = np.arange(60) * DT
    swing = np.cos(2.0 * np.pi * 2.0 * t)
    late, rate = delayed(np.stack([swing, np.full(60, 3.0)]), lag, holds=True)
    exact = np.cos(2.0 * np.pi * 2.0 * np.maximum(t - lag * DT, 0.0))
    np.testing.assert_allclose(late[0], exact, rtol=0, atol=1e-2)
    np.testing.assert_allclose(late[1], 3.0)
    step = 1e-5
    if lag % 1.0:  # there the polynomials change
        ends = [delayed(swing[None], lag + side * step, holds=True)[0][0] for side in (1.0, -1.0)]
        np.testing.assert_allclose(rate, (ends[0] - ends[1]) / (2.0 * step), rtol=0, atol=1e-4)


def test_neutral_sensors_cost_nothing_and_need_no_kernel_of_their_own() -> None:
    plain = ShearBuilding(masses=[1.0, 1.0], storey=BoucWen(k=10.0, beta=1.0, gamma=1.0))
    record = Record(name="still", time_step=DT, excitation=np.zeros(10))
    names = ["acceleration_1", "drift_2", "relative_acceleration_2"]
    neutral = plain.with_effect(SensorGain(gain=1.0)).with_effect(SensorBias(bias=0.0)).with_effect(SensorLag(lag=0.0))
    assert neutral.law == plain.law
    (stretch,) = stretches_of(record)
    assert sensors_of(plain, record, stretch, names) is None
    assert sensors_of(neutral, record, stretch, names) is None
    one = plain.with_effect(SensorGain(gain=Uniform(0.5, 1.5)), storeys=[2])
    assert one.law == plain.law
    assert sensors_of(one, record, stretch, names[:2]) is None
    sensors = sensors_of(one, record, stretch, names)
    assert sensors is not None
    assert sensors.places == ((2, 1, True),)
