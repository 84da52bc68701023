"""The band of filtered noise: found behind every kind of filter, and nowhere else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from bwbn_bayes import CubicStiffness, Linear, Oscillator, as_force, multisine, simulate, sine, sweep
from bwbn_bayes.parameters import Floats, Uniform
from bwbn_bayes.records import Envelope, Record, filtered_noise, noise_band, noise_sds
from bwbn_bayes.structures.model_file import load_model_file

Filter = Callable[[float], Floats]
FILTERS: dict[str, Filter] = {
    "Butterworth of order 4": lambda corner: signal.butter(4, corner, output="sos"),
    "Butterworth of order 8": lambda corner: signal.butter(8, corner, output="sos"),
    "Chebyshev": lambda corner: signal.cheby2(8, 60.0, 1.25 * corner, output="sos"),
}


@cache
def clean(time_step: float = 0.01) -> Record:
    """Three storeys under an earthquake, 31 s."""
    model = load_model_file(Path(__file__).parents[2] / "models" / "plain_three_storey.py").model
    ground = filtered_noise(
        np.random.default_rng(1), 31.0, time_step, peak=3.0, ground_frequency_hz=2.0, envelope=Envelope()
    )
    values = {}
    for parameter in model.space.parameters:
        assert isinstance(parameter.prior, Uniform)
        values[parameter.name] = 0.5 * (parameter.prior.lower + parameter.prior.upper)
    return simulate(model, ground, values)


def with_noise(record: Record, snr_db: float, sos: Floats | None, seed: int) -> tuple[Record, Floats]:
    """The record with white or filtered noise, and its standard deviations ``(n_channels,)``."""
    noise = np.random.default_rng(seed).standard_normal((len(record.channels), record.n_times + 1000))
    noise = noise if sos is None else signal.sosfilt(sos, noise, axis=1)
    noise = noise[:, 1000:] / np.std(noise[:, 1000:], axis=1, keepdims=True)
    sds = np.std(record.measured, axis=1) * 10.0 ** (-snr_db / 20.0)
    noisy = dict(zip(record.channels, record.measured + sds[:, None] * noise, strict=True))
    return record.with_channels(noisy), sds


@pytest.mark.parametrize("kind", FILTERS)
@pytest.mark.parametrize("corner", [0.35, 0.5, 0.75])
@pytest.mark.parametrize("snr_db", [20.0, 30.0, 40.0])
def test_the_band_of_filtered_noise_is_found(kind: str, corner: float, snr_db: float) -> None:
    """Its share is the filter's equivalent noise bandwidth: the mean of the squared gain, which is one at rest."""
    sos = FILTERS[kind](corner)
    record, sds = with_noise(clean(), snr_db, sos, seed=int(100 * corner + snr_db))
    band = noise_band(record)
    assert band is not None
    bandwidth = np.mean(np.square(np.abs(signal.freqz_sos(sos, 4096)[1])))
    assert band.share == pytest.approx(bandwidth, rel=0.12)
    assert band.correlation_samples == pytest.approx(1.0 / band.share)
    assert np.all(np.abs(band.sds / sds - 1.0) < 0.25)
    np.testing.assert_array_equal(noise_sds(record), band.sds)


@pytest.mark.parametrize("snr_db", [10.0, 30.0, 60.0])
def test_white_noise_has_no_band(snr_db: float) -> None:
    for seed in range(20):
        record, sds = with_noise(clean(0.02), snr_db, None, seed)
        assert noise_band(record) is None
        assert np.all(np.abs(noise_sds(record) / sds - 1.0) < 0.25)


def test_noise_with_a_memory_has_no_band() -> None:
    for memory in (0.3, 0.8):
        autoregression = signal.tf2sos([1.0], [1.0, -memory])
        for seed in range(10):
            assert noise_band(with_noise(clean(0.02), 30.0, autoregression, seed)[0]) is None


def test_a_motion_without_noise_has_no_band() -> None:
    assert noise_band(clean()) is None
    assert noise_band(clean(0.02)) is None


def test_one_filter_is_asked_for_all_channels() -> None:
    filtered, _ = with_noise(clean(), 30.0, FILTERS["Butterworth of order 4"](0.4), seed=3)
    white, _ = with_noise(clean(), 30.0, None, seed=3)
    mixed = filtered.with_channels({**filtered.channels, "acceleration_2": white.channels["acceleration_2"]})
    assert noise_band(filtered) is not None
    assert noise_band(mixed) is None


def test_a_channel_that_hides_its_noise_shows_it_in_quiet_times() -> None:
    """Jolts that come and go, louder than the noise at every frequency, before the same filter."""
    sos = FILTERS["Butterworth of order 8"](0.4)
    record, sds = with_noise(clean(), 30.0, sos, seed=6)
    rng = np.random.default_rng(8)
    jolts = 40.0 * sds[2] * rng.standard_normal(record.n_times) * (rng.random(record.n_times) < 0.03)
    jolts[(record.times < 5.0) | (record.times > 20.0)] = 0.0
    shaken = record.channels["acceleration_3"] + signal.sosfilt(sos, jolts)
    band = noise_band(record.with_channels({**record.channels, "acceleration_3": shaken}))
    alone = noise_band(record.with_channels({"acceleration_3": shaken}))
    assert alone is None
    assert band is not None
    assert band.share == pytest.approx(0.4, rel=0.12)
    assert np.all(np.abs(band.sds / sds - 1.0) < 0.3)


def test_a_short_record_tells_nothing() -> None:
    record, _ = with_noise(clean(), 30.0, FILTERS["Butterworth of order 4"](0.4), seed=3)
    assert noise_band(record.until(4.0)) is None


def test_thinned_noise_is_white() -> None:
    """At twice the band's rate, with the same level; a motion is taken at the same instants."""
    record, sds = with_noise(clean(), 30.0, FILTERS["Butterworth of order 8"](0.4), seed=5)
    band = noise_band(record)
    assert band is not None
    noise = record.measured - clean().measured
    thinned = band.thinned(noise)
    assert thinned.shape == (3, round(band.share * record.n_times))
    assert np.all(np.abs(np.std(thinned, axis=1) / sds - 1.0) < 0.1)
    # Filtered noise has a correlation of 0.7 from one sample to the next.
    assert np.all(np.abs([np.corrcoef(row[1:], row[:-1])[0, 1] for row in thinned]) < 0.15)
    times = band.at_thinned(record.times)
    assert times.shape == (thinned.shape[1],)
    assert np.max(np.abs(np.diff(times) - record.time_step / band.share)) < record.time_step


def multisine_force(seed: int) -> Record:
    """Random phases, from 5 to 100 Hz, on a mass."""
    return as_force(multisine(np.random.default_rng(seed), (5.0, 100.0), 2048, 1.0 / 750.0, rms=50.0))


def white_force(seed: int) -> Record:
    """Random, up to 100 Hz, on a mass."""
    noise = signal.sosfilt(signal.butter(8, 100.0 / 375.0, output="sos"), np.random.default_rng(seed).normal(size=4096))
    return as_force(Record(name="white", time_step=1.0 / 750.0, excitation=50.0 * noise))


def swept_force(seed: int) -> Record:
    """A sine that goes from 5 to 100 Hz, on a mass."""
    return as_force(sweep(50.0 * (seed + 1), (5.0, 100.0), 5.0, 1.0 / 750.0))


def sine_force(seed: int) -> Record:
    """One sine on a mass."""
    return as_force(sine(50.0, 12.0 + seed, 5.0, 1.0 / 750.0))


@pytest.mark.parametrize("spring", [0.0, 6e9], ids=["linear", "cubic"])
@pytest.mark.parametrize("force", [multisine_force, white_force, swept_force, sine_force])
def test_the_response_to_a_steady_force_is_no_noise(force: Callable[[int], Record], spring: float) -> None:
    """It is as steady as noise, about as flat, and ends where the force does: its level was taken for the noise's."""
    model = Oscillator(mass=2.0, spring=Linear(k=8e4, c=12.0)).with_effect(CubicStiffness(k3=spring))
    for seed in range(3):
        record = simulate(model, force(seed), {}, channels=["acceleration_1", "displacement_1"])
        for snr_db in (20.0, 40.0, 60.0):
            noisy, sds = with_noise(record, snr_db, None, seed)
            assert noise_band(noisy) is None
            one = noisy.with_channels({"acceleration_1": noisy.channels["acceleration_1"]})
            assert noise_band(one) is None
            if spring == 0.0:
                assert np.all(noise_sds(noisy) < 1.3 * sds)


def test_filtered_noise_shows_once_a_steady_force_has_stopped() -> None:
    force = multisine_force(1)
    stopped = force.forces["applied_force_1"].copy()
    stopped[1200:] = 0.0
    driven = replace(force, forces={"applied_force_1": stopped})
    model = Oscillator(mass=2.0, spring=Linear(k=8e4, c=12.0))
    record, sds = with_noise(
        simulate(model, driven, {}, channels=["displacement_1"]), 30.0, FILTERS["Butterworth of order 8"](0.6), seed=2
    )
    band = noise_band(record)
    assert band is not None
    assert band.sds == pytest.approx(sds, rel=0.25)
