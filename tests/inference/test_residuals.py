"""Whiteness under noise and under a known colour; the checks at the truth, at a wrong fit and for a wrong model."""

from dataclasses import replace

import numpy as np
import pytest
from inference_cases import SDOF, climbed, posterior_of, recorded, sdof_model, true_point
from scipy import optimize, signal, stats

from bwbn_bayes import BoucWen, Record, Specimen, Uniform, simulate
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference import residuals
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.residuals import (
    LARGEST_RATIO,
    LEAST_PROBABILITY,
    N_STRETCHES,
    ColouredNoise,
    are_quiet,
    coloured_noise,
    has_past,
    is_noise,
    leaves_noise,
    leaves_quiet,
    residual_checks,
    residual_of,
    steadiness,
    whiteness_probability,
)
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records import Envelope, filtered_noise


def test_whiteness_is_uniform_under_white_noise() -> None:
    rng = np.random.default_rng(1)
    probabilities = [whiteness_probability(3.0 * rng.standard_normal(2000) + 5.0) for _ in range(500)]
    assert stats.kstest(probabilities, stats.uniform.cdf).pvalue > 1e-3


def test_whiteness_of_innovations_is_uniform_where_their_noise_was_fitted() -> None:
    """A fitted coefficient takes a degree of freedom: with all twenty lags counted five in a hundred were 1.5."""
    rng = np.random.default_rng(12)
    coefficients, found = np.array([0.5, -0.3, 0.2, -0.1]), []
    for _ in range(500):
        residual = signal.lfilter([1.0], [1.0, *-coefficients], rng.standard_normal(2000))
        lagged = np.stack([residual[4 - lag : -lag] for lag in range(1, 5)], axis=1)
        fitted = ColouredNoise(np.linalg.lstsq(lagged, residual[4:], rcond=None)[0], 0.0)
        found.append(whiteness_probability(fitted.innovations(residual), 4))
    assert stats.kstest(found, stats.uniform.cdf).pvalue > 1e-3


@pytest.mark.parametrize("n_channels", [1, 17])
def test_noise_of_many_channels_is_loud_no_oftener(monkeypatch: pytest.MonkeyPatch, n_channels: int) -> None:
    """Of seventeen channels four in five failed where of one, at 0.025 for each of the two tests, one in twenty did."""
    monkeypatch.setattr(residuals, "QUIET_PROBABILITY", 0.05)
    rng, n = np.random.default_rng(14), 150
    loud = sum(not are_quiet(list(rng.standard_normal((n_channels, 2000)))) for _ in range(n))
    assert abs(loud / n - 0.05) < 4.0 * np.sqrt(0.05 * 0.95 / n)


def test_one_loud_channel_of_many_is_heard() -> None:
    rests = list(np.random.default_rng(15).standard_normal((17, 2000)))
    assert are_quiet(rests)
    rests[8] = signal.lfilter([1.0], [1.0, -0.3], rests[8])
    assert not are_quiet(rests)


def test_whiteness_is_tiny_under_an_autoregression() -> None:
    """At a coefficient of 0.3 the first lag alone is worth n 0.09: 180 of a chi-square with 20 degrees."""
    rng = np.random.default_rng(2)
    for _ in range(20):
        coloured = signal.lfilter([1.0], [1.0, -0.3], rng.standard_normal(2000))
        assert whiteness_probability(coloured) < 1e-10


def test_steadiness_is_levene_s_test_of_the_stretches() -> None:
    rng = np.random.default_rng(3)
    for n in (40, 500, 1501):
        residual = rng.standard_normal(n) * np.linspace(1.0, 1.3, n)
        expected = stats.levene(*np.array_split(residual, N_STRETCHES), center="mean").pvalue
        assert steadiness(residual) == pytest.approx(expected, rel=1e-10)


def test_innovations_are_judged_as_scipy_s_tests_judge_them() -> None:
    """A mean, or a strength, that depends on the motion: refused from where SciPy's probability falls below the least.

    Alone each of the two decides: the other, whiteness, mean and steadiness stay far above it.
    """
    rng = np.random.default_rng(5)
    white, motion = rng.standard_normal(1500), rng.permutation(np.sin(np.arange(1500.0)))
    part = np.searchsorted(np.unique(np.quantile(motion, residuals._SHARES)), motion)
    verdicts = []
    for size in np.linspace(0.0, 0.4, 9):
        for residual in (white + size * np.sign(motion), white * (1.0 + size * np.sign(motion))):
            residual = residual - np.mean(residual)
            groups = [residual[part == n] for n in range(part.max() + 1)]
            least = min(stats.f_oneway(*groups).pvalue, stats.levene(*groups, center="mean").pvalue)
            verdicts.append((is_noise(residual, [motion], noise=ColouredNoise(np.empty(0), 0.0)), least))
    assert all(passes == (least > LEAST_PROBABILITY) for passes, least in verdicts)
    assert {passes for passes, _ in verdicts} == {True, False}


def test_a_residual_of_zero_is_white() -> None:
    assert whiteness_probability(np.zeros(100)) == 1.0


def test_both_checks_pass_at_the_truth(posterior: Posterior, record: Record) -> None:
    level, white = residual_checks(posterior, true_point(sdof_model(), record))
    assert level.passed
    assert white.passed
    residual_sd = record.noise_sd["acceleration_1"]
    # The model-free level is itself an estimate, good to a few per cent.
    assert 0.85 < level.value < 1.1, residual_sd
    assert "acceleration_1" in level.sentence
    assert (level.limit, white.limit) == (LARGEST_RATIO, LEAST_PROBABILITY)


def test_both_checks_pass_at_the_fit_of_every_seed() -> None:
    for seed in (1, 2, 3):
        record = recorded(seed)
        posterior = posterior_of(sdof_model(), record)
        assert all(c.passed for c in residual_checks(posterior, true_point(sdof_model(), record)))


def test_a_residual_below_its_yardstick_passes_and_is_told(
    posterior: Posterior, record: Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 80 dB it was ".09 times its model-free noise level", which is the thousandth of the rms that counts as none.

    A level that is too high, as of motion near half the sampling rate, hides what lies below it.
    """
    quiet = recorded(1, snr_db=80.0)
    level, _ = residual_checks(posterior_of(sdof_model(), quiet), true_point(sdof_model(), quiet))
    assert level.passed
    assert "thousandths of its rms, of which one counts as noise" in level.sentence
    point = true_point(sdof_model(), record)
    assert "holds motion" not in residual_checks(posterior, point)[0].sentence
    levels = residuals.noise_sds
    monkeypatch.setattr(residuals, "noise_sds", lambda part: 2.0 * levels(part))
    level, _ = residual_checks(posterior, point)
    assert level.passed
    assert "holds motion" in level.sentence


def test_both_checks_pass_at_the_truth_behind_a_filter() -> None:
    """Judged by the samples as they are, the residual would be hundreds of times its level, and coloured."""
    model, rng = sdof_model(), np.random.default_rng(4)
    ground = filtered_noise(rng, 20.0, 0.01, peak=3.0, ground_frequency_hz=2.0, envelope=Envelope())
    clean = simulate(model, ground, SDOF.truth)
    measured = clean.channels["acceleration_1"]
    noise = signal.sosfilt(signal.butter(8, 0.4, output="sos"), rng.standard_normal(len(measured) + 500))[500:]
    noisy = measured + 0.03 * np.std(measured) * noise / np.std(noise)
    record = clean.with_channels({"acceleration_1": noisy}, truth=SDOF.truth)
    posterior, point = posterior_of(model, record), true_point(model, record)
    level, white = residual_checks(posterior, point)
    assert level.passed
    assert white.passed
    assert leaves_noise(posterior, point)
    assert leaves_quiet(posterior, point)
    assert whiteness_probability(residual_of(posterior, point)[0]) < 1e-50


def test_an_offset_is_no_noise(record: Record) -> None:
    """Ten times the noise, at the truth: a level about the mean would not see it."""
    offset = 10.0 * record.noise_sd["acceleration_1"]
    shifted = record.with_channels({"acceleration_1": record.channels["acceleration_1"] + offset})
    posterior = posterior_of(sdof_model(), shifted)
    point = true_point(sdof_model(), record)
    level, _ = residual_checks(posterior, point)
    assert level.value > 8.0
    assert not level.passed
    (rest,) = residual_of(posterior, point)
    assert is_noise(rest - offset)
    assert not is_noise(rest)


def test_they_fail_at_a_wrong_fit(posterior: Posterior, mode: Mode) -> None:
    """Three per cent off in stiffness, a wrong mode in miniature: 14 posterior sds."""
    wrong = mode.point.copy()
    wrong[0] += 0.03
    level, white = residual_checks(posterior, wrong)
    assert not (level.passed and white.passed)
    assert white.value < 1e-10


def test_they_fail_for_a_model_that_lacks_an_effect(slip_record: Record) -> None:
    """The record has slip; the best fit without it leaves bursts near z = 0."""
    posterior = posterior_of(sdof_model(), slip_record)
    unslipped = posterior.space.to_unit(np.array([[SDOF.truth[name] for name in posterior.space.names]]))[0]
    fit = climbed(posterior, unslipped, n_steps=20)
    level, white = residual_checks(posterior, fit.point)
    assert not level.passed
    assert not white.passed


def test_a_noise_free_record_passes_at_its_truth(record: Record) -> None:
    """Without noise the model-free level is next to zero: the floor of a thousandth of the rms keeps the ratio sane."""
    posterior = posterior_of(sdof_model(), record)
    point = true_point(sdof_model(), record)
    values = posterior.space.from_unit(point[None])
    exact = posterior.engine.simulate(posterior.model, values, record).values[0, 0]
    clean = posterior_of(sdof_model(), record.with_channels({"acceleration_1": exact}))
    level, white = residual_checks(clean, point)
    assert level.value == 0.0
    assert white.value == 1.0


def test_the_solver_s_error_has_no_colour_that_counts() -> None:
    """A record of the reference engine, without noise, against coarse steps: coloured, but below a thousandth."""
    assert SDOF.excitation is not None
    clean = simulate(SDOF.model, SDOF.excitation, SDOF.truth, snr_db=None)
    posterior, point = posterior_of(sdof_model(), clean), true_point(sdof_model(), clean)
    (rest,) = residual_of(posterior, point)
    assert whiteness_probability(rest) < 1e-10
    assert 0.0 < np.std(rest) < 1e-3 * np.std(clean.channels["acceleration_1"])
    assert all(check.passed for check in residual_checks(posterior, point))


def autoregression(rng: np.random.Generator, coefficients: tuple[float, ...], n: int = 1500) -> Floats:
    """A stationary stretch of autoregressive noise."""
    return np.asarray(signal.lfilter([1.0], [1.0, *(-c for c in coefficients)], rng.standard_normal(n + 500))[500:])


@pytest.mark.parametrize("coefficients", [(), (0.5,), (0.95,), (-0.4,), (0.6, -0.3)], ids=str)
def test_stationary_noise_is_noise(coefficients: tuple[float, ...]) -> None:
    """Each of the tests fails one draw in 1e5; successive magnitudes at 0.95 are correlated over 20 samples."""
    rng = np.random.default_rng(3)
    t = np.arange(1500) * 0.02
    motions = np.stack([np.sin(2.0 * np.pi * f * t) * np.exp(-(((t - 12.0) / 6.0) ** 2)) for f in (0.4, 1.1, 2.7)])
    passed = [is_noise(0.01 * autoregression(rng, coefficients), motions) for _ in range(100)]
    assert np.mean(passed) >= 0.99


def test_without_time_errors_have_no_past_and_noise_is_white() -> None:
    """A law's own error along a cyclic test is smooth, and passed for noise of an autoregression near one."""
    path = np.concatenate([a * np.sin(np.linspace(0.0, 2.0 * np.pi, 40)) for a in np.linspace(0.5, 2.0, 12)])
    cyclic = Record(name="cyclic", time_step=0.1, excitation=path, excitation_kind="displacement")
    model = Specimen(storey=BoucWen(k=Uniform(5.0, 20.0), alpha=0.2, beta=0.8, gamma=0.2, n=1.0))
    drawn = simulate(model, cyclic, {"k": 10.0})
    rng = np.random.default_rng(5)
    errors = {True: rng.standard_normal(len(path)), False: autoregression(rng, (0.97,), len(path))}
    answers = {}
    for is_white, error in errors.items():
        measured = drawn.with_channels({"force": drawn.channels["force"] + 0.3 * error})
        for has_time in (True, False):
            record = replace(measured, has_time=has_time)
            posterior = Posterior(model=model, record=record, engine=Lanes(substeps=8), noise=default_noise(record))
            point = posterior.space.to_unit(np.array([[10.0]]))[0]
            assert has_past(record) is has_time
            answers[is_white, has_time] = leaves_noise(posterior, point)
    assert answers == {(True, True): True, (True, False): True, (False, True): True, (False, False): False}


def test_what_comes_and_goes_with_the_motion_is_not_noise() -> None:
    """A coloured residual under an envelope as large as the noise, and a sine of the noise's size."""
    rng = np.random.default_rng(4)
    t = np.arange(1500) * 0.02
    envelope = np.exp(-(((t - 10.0) / 3.0) ** 2))
    for _ in range(20):
        assert not is_noise(rng.standard_normal(1500) * (1.0 + 2.0 * envelope))
        assert not is_noise(rng.standard_normal(1500) + np.sin(2.0 * np.pi * 1.3 * t))


def test_what_knows_of_the_motion_is_not_noise() -> None:
    """A sensor that saturates on three samples in a hundred; noise half as strong again at large motion.

    Both are white and steady: beside a motion that has nothing to do with them they pass.
    """
    rng = np.random.default_rng(8)
    passed, caught = [], []
    for _ in range(20):
        motion, other = autoregression(rng, (0.6, -0.3)), autoregression(rng, (0.6, -0.3))
        noise = 0.2 * rng.standard_normal(1500)
        limit = np.quantile(np.abs(motion), 0.97)
        saturated = noise + np.clip(motion, -limit, limit) - motion
        louder = noise * np.where(np.abs(motion) > np.quantile(np.abs(motion), 0.8), 1.5, 1.0)
        passed += [is_noise(residual, [other]) for residual in (saturated, louder)]
        caught += [not is_noise(residual, [other, motion]) for residual in (saturated, louder)]
    assert sum(passed) >= 36
    assert sum(caught) >= 36


def test_innovations_are_what_the_past_does_not_tell() -> None:
    rng = np.random.default_rng(5)
    driven = rng.standard_normal(5000)
    residual = np.asarray(signal.lfilter([1.0], [1.0, -0.8], driven))
    fitted = coloured_noise(residual)
    # The estimate of the coefficient has a standard error of sqrt((1 - 0.64) / 5000).
    assert abs(fitted.coefficients[0] - 0.8) < 4.0 * np.sqrt(0.36 / 5000) + 0.02 * (len(fitted.coefficients) - 1)
    innovations = fitted.innovations(residual)
    assert np.corrcoef(innovations, driven[len(fitted.coefficients) :])[0, 1] > 0.999


def exact_gain(residual: Floats) -> float:
    """Log ratio of the largest exact likelihoods of stationary AR(1) and of white noise."""
    n = len(residual)
    centred = residual - np.mean(residual)

    def minus_log_likelihood(rho: float) -> float:
        squares = (1.0 - rho**2) * centred[0] ** 2 + np.sum((centred[1:] - rho * centred[:-1]) ** 2)
        return float(0.5 * n * np.log(squares / n) - 0.5 * np.log(1.0 - rho**2))

    best = optimize.minimize_scalar(minus_log_likelihood, bounds=(-0.999, 0.999), method="bounded")
    return minus_log_likelihood(0.0) - float(best.fun)


@pytest.mark.parametrize("rho", [0.15, 0.5, 0.9])
def test_the_gain_is_the_exact_likelihood_ratio_less_the_price_of_the_coefficients(rho: float) -> None:
    rng = np.random.default_rng(6)
    n = 1500
    for _ in range(20):
        residual = 2.0 * autoregression(rng, (rho,), n)
        exact = exact_gain(residual) - 0.5 * np.log(n)
        # A higher order is chosen only where it gains more than it costs: seldom, and little. Yule and Walker's
        # equations take silence before and after for measured: a cost of the order of the first and last values squared
        # over the innovations' variance.
        ends = 0.5 * (residual[0] ** 2 + residual[-1] ** 2) * rho**2 / 4.0
        assert -3.0 - ends < coloured_noise(residual).gain - exact < 4.0


def test_white_noise_and_silence_gain_nothing() -> None:
    rng = np.random.default_rng(7)
    gains = [coloured_noise(rng.standard_normal(1500)).gain for _ in range(200)]
    # A coefficient is worth its price, ln(n) / 2, with the probability that chi-square exceeds ln(n).
    assert np.mean(np.array(gains) > 0.0) < 4.0 * stats.chi2.sf(np.log(1500), 1)
    assert max(gains) < 6.0
    silent = coloured_noise(np.zeros(100))
    assert silent.gain == 0.0
    assert len(silent.coefficients) == 0
