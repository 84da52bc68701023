"""Whiteness under noise and under a known colour; the checks at the truth, at a wrong fit and for a wrong model."""

import numpy as np
from inference_cases import SDOF, climbed, posterior_of, recorded, sdof_model, true_point
from scipy import signal, stats

from bwbn_bayes import Record
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.residuals import LARGEST_RATIO, LEAST_PROBABILITY, residual_checks, whiteness_probability


def test_whiteness_is_uniform_under_white_noise() -> None:
    rng = np.random.default_rng(1)
    probabilities = [whiteness_probability(3.0 * rng.standard_normal(2000) + 5.0) for _ in range(500)]
    assert stats.kstest(probabilities, stats.uniform.cdf).pvalue > 1e-3


def test_whiteness_is_tiny_under_an_autoregression() -> None:
    """At a coefficient of 0.3 the first lag alone is worth n 0.09: 180 of a chi-square with 20 degrees."""
    rng = np.random.default_rng(2)
    for _ in range(20):
        coloured = signal.lfilter([1.0], [1.0, -0.3], rng.standard_normal(2000))
        assert whiteness_probability(coloured) < 1e-10


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
