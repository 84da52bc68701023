"""Noise: the level that is added, and the level that is found without a model."""

from __future__ import annotations

import numpy as np
import pytest

from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records import Record, add_noise, model_free_noise_sd
from bwbn_bayes.records.noise import with_least_noise


def clean(n_times: int = 20_000) -> Record:
    times: Floats = 0.02 * np.arange(n_times, dtype=np.float64)
    channels: dict[str, Floats] = {
        "acceleration_1": 3.0 * np.sin(times),
        "drift_1": 0.01 * np.cos(2.0 * times),
        "drift_2": 0.0 * times,
    }
    return Record(name="clean", time_step=0.02, excitation=np.sin(times), channels=channels)


@pytest.mark.parametrize("snr_db", [0.0, 10.0, 30.0])
def test_noise_has_the_stated_ratio(snr_db: float) -> None:
    record = clean()
    noisy = add_noise(record, snr_db, np.random.default_rng(5))
    for channel in ("acceleration_1", "drift_1"):
        noise = noisy.channels[channel] - record.channels[channel]
        variance = np.mean(record.channels[channel] ** 2) / 10.0 ** (snr_db / 10.0)
        assert noisy.noise_sd[channel] == pytest.approx(np.sqrt(variance), rel=1e-12)
        # Standard errors: sqrt(2 / n) of the variance ratio, 1 / sqrt(n) of the lag-one correlation.
        assert abs(np.mean(noise**2) / variance - 1.0) < 4.0 * np.sqrt(2.0 / record.n_times)
        assert abs(np.mean(noise[1:] * noise[:-1]) / variance) < 4.0 / np.sqrt(record.n_times)
    one, two = (noisy.channels[c] - record.channels[c] for c in ("acceleration_1", "drift_1"))
    assert abs(np.corrcoef(one, two)[0, 1]) < 4.0 / np.sqrt(record.n_times)
    np.testing.assert_array_equal(noisy.channels["drift_2"], 0.0)
    np.testing.assert_array_equal(noisy.excitation, record.excitation)
    assert noisy.provenance["noise"] == f"white Gaussian, {snr_db:g} dB of mean square"


def test_no_noise_and_repeated_noise() -> None:
    record = clean(500)
    rng = np.random.default_rng(1)
    assert add_noise(record, None, rng) is record
    assert add_noise(record, np.inf, rng) is record
    once = add_noise(record, 20.0, rng)
    twice = add_noise(once, 20.0, rng)
    added = np.mean(once.channels["drift_1"] ** 2) / 100.0
    assert twice.noise_sd["drift_1"] ** 2 == pytest.approx(once.noise_sd["drift_1"] ** 2 + added, rel=1e-12)
    assert add_noise(record, 20.0, np.random.default_rng(1)).equals(once)
    for bad in (np.nan, -np.inf):
        with pytest.raises(UserError, match="it must be a number of decibels"):
            add_noise(record, bad, rng)


def kinked(seconds: float, rng: np.random.Generator) -> Floats:
    """Three tones and one kink a second (a jump of the slope by 3 sd per second), at 50 Hz."""
    times = np.arange(0.0, seconds, 0.02)
    signal = np.sin(2 * np.pi * 0.8 * times) + 0.5 * np.sin(2 * np.pi * 2.3 * times + 1.0)
    signal += 0.2 * np.sin(2 * np.pi * 5.0 * times)
    for knot in rng.uniform(0.0, seconds, int(seconds)):
        after = np.maximum(times - knot, 0.0)
        signal += rng.normal(0.0, 3.0) * after * np.exp(-2.0 * after)
    return signal


@pytest.mark.parametrize("snr_db", [10.0, 20.0, 30.0, 40.0])
@pytest.mark.parametrize("seed", range(5))
def test_noise_level_of_a_kinked_oscillation(snr_db: float, seed: int) -> None:
    # 60 s: the relative scatter of one estimate is 2 to 3 % (measured), the bias at 40 dB 2 %.
    rng = np.random.default_rng(100 + seed)
    signal = kinked(60.0, rng)
    sd = np.sqrt(np.mean(signal**2) * 10.0 ** (-snr_db / 10.0))
    assert model_free_noise_sd(signal + sd * rng.standard_normal(len(signal))) == pytest.approx(sd, rel=0.1)


def test_pure_noise_is_found_with_the_efficiency_of_its_differences() -> None:
    # First differences of 2,000 points: relative standard error sqrt(1.5 / 4000) = 0.019; the rule may pick a higher
    # order now and then, so the scatter over 200 draws may be larger, but not twice as large.
    rng = np.random.default_rng(7)
    estimates = np.array([model_free_noise_sd(rng.standard_normal(2000)) for _ in range(200)])
    assert abs(np.mean(estimates) - 1.0) < 0.02
    assert np.std(estimates) < 0.038


def test_without_noise_next_to_nothing_is_found() -> None:
    times = np.arange(0.0, 60.0, 0.02)
    assert model_free_noise_sd(np.sin(5.0 * times)) < 1e-12
    assert model_free_noise_sd(kinked(60.0, np.random.default_rng(0))) < 1e-6
    assert model_free_noise_sd(np.zeros(100)) == 0.0
    assert model_free_noise_sd(0.3 * times - 2.0) < 1e-12


def test_scale_and_offset() -> None:
    rng = np.random.default_rng(8)
    signal = kinked(20.0, rng) + 0.1 * rng.standard_normal(1000)
    found = model_free_noise_sd(signal)
    assert model_free_noise_sd(-1e4 * signal) == pytest.approx(1e4 * found, rel=1e-9)
    assert model_free_noise_sd(signal + 100.0) == pytest.approx(found, rel=1e-6)


def test_jumps_and_outliers_drop_out() -> None:
    rng = np.random.default_rng(9)
    signal = np.sin(np.arange(3000) / 15.0) + 0.02 * rng.standard_normal(3000)
    signal[1000:] += 5.0
    signal[rng.integers(0, 3000, 10)] += 20.0
    assert model_free_noise_sd(signal) == pytest.approx(0.02, rel=0.1)


def test_stated_limit_a_tone_near_half_the_sampling_rate_counts_as_noise() -> None:
    assert model_free_noise_sd(np.sin(2.0 * np.pi * 0.45 * np.arange(2000))) > 0.5


@pytest.mark.parametrize("signal", [np.zeros(31), np.zeros((40, 2)), np.full(40, np.nan)])
def test_too_little_to_go_on(signal: Floats) -> None:
    with pytest.raises(UserError, match="a noise level needs at least 32 finite values of one channel"):
        model_free_noise_sd(signal)


def test_a_record_without_noise_gets_the_least() -> None:
    """A thousandth of the rms on the silent channel; the noisy one stays as it is, and so does a noisy record."""
    t = np.arange(2000) * 0.02
    silent = np.sin(2.0 * np.pi * 1.1 * t) * np.exp(-0.05 * t)
    noisy = silent + 0.01 * np.random.default_rng(1).standard_normal(2000)
    record = Record(
        name="r", time_step=0.02, excitation=silent, channels={"acceleration_1": silent, "acceleration_2": noisy}
    )
    heard = with_least_noise(record, np.random.default_rng(2))
    added = heard.channels["acceleration_1"] - silent
    rms = float(np.sqrt(np.mean(silent**2)))
    assert np.std(added) == pytest.approx(1e-3 * rms, rel=4.0 / np.sqrt(2.0 * 2000))
    assert model_free_noise_sd(heard.channels["acceleration_1"]) == pytest.approx(1e-3 * rms, rel=0.1)
    assert heard.noise_sd["acceleration_1"] == pytest.approx(1e-3 * rms)
    np.testing.assert_array_equal(heard.channels["acceleration_2"], noisy)
    assert "acceleration_1" in heard.provenance["noise"]
    loud = record.with_channels({"acceleration_2": noisy})
    assert with_least_noise(loud, np.random.default_rng(3)) is loud
