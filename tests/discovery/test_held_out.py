"""Predictions of unseen data against closed forms, and their standard error against the spread of many records."""

from dataclasses import replace

import numpy as np
import pytest

from bwbn_bayes.discovery.held_out import Prediction, floor_of, predict
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.parameters import Floats, Uniform
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding

MODEL = ShearBuilding(
    masses=[2.0, 1.0], storey=BoucWen(k=Uniform(20, 100), c=0.3, alpha=0.1, beta=8.0, gamma=2.0, n=1.3)
)
POINT = np.array([0.5])
ENGINE = Lanes(substeps=1, n_threads=1)
CHANNELS = ("acceleration_1", "acceleration_2")
TRAINING, UNSEEN = el_centro("chopra", duration=8.0), el_centro("rsn6_180", duration=10.0)
TRAINING_SD = (0.05, 0.02)


def response(ground: Record) -> Floats:
    return ENGINE.simulate(MODEL, MODEL.space.from_unit(POINT[None]), ground, CHANNELS).values[0]


@pytest.fixture(scope="module")
def clean() -> Floats:
    return response(UNSEEN)


@pytest.fixture(scope="module")
def posterior() -> Posterior:
    """Fitted to a record whose residual at POINT has an rms of exactly TRAINING_SD."""
    values = response(TRAINING)
    signs = np.where(np.arange(TRAINING.n_times) % 2 == 0, 1.0, -1.0)
    channels = {name: row + sd * signs for name, row, sd in zip(CHANNELS, values, TRAINING_SD, strict=True)}
    record = replace(TRAINING, channels=channels)
    return Posterior(model=MODEL, record=record, engine=ENGINE, noise=default_noise(record))


def predicted(posterior: Posterior, measured: Floats, seed: int = 1) -> Prediction:
    record = replace(UNSEEN, channels=dict(zip(CHANNELS, measured, strict=True)))
    return predict(posterior, POINT, record, np.random.default_rng(seed))


def test_the_error_is_the_closed_form(posterior: Posterior, clean: Floats) -> None:
    """Gains off by 10 % and 30 %: errors of 0.1 / 1.1 and 0.3 / 1.3 of what was measured, whatever the motion."""
    found = predicted(posterior, clean * np.array([[1.1], [1.3]]))
    assert found.channels == CHANNELS
    np.testing.assert_array_equal(found.values, clean)
    assert found.nrmse == pytest.approx(np.sqrt(0.5 * ((0.1 / 1.1) ** 2 + (0.3 / 1.3) ** 2)), rel=1e-12)


def test_the_log_density_is_the_closed_form(posterior: Posterior, clean: Floats) -> None:
    """Errors of one and two of the training record's noise levels: the normal density at 1 and at 2."""
    shifts = np.array([[TRAINING_SD[0]], [2.0 * TRAINING_SD[1]]])
    found = predicted(posterior, clean + shifts)
    each = -0.5 * np.array([1.0, 4.0]) - np.log(TRAINING_SD) - 0.5 * np.log(2.0 * np.pi)
    assert found.log_density == pytest.approx(np.mean(each), rel=1e-9)


def test_a_perfect_prediction(posterior: Posterior, clean: Floats) -> None:
    found = predicted(posterior, clean)
    assert (found.nrmse, found.nrmse_se) == (0.0, 0.0)


def test_the_standard_error_is_the_spread_of_records(posterior: Posterior, clean: Floats) -> None:
    """White noise of a tenth of each channel's rms: over 60 records the sd of the error is known to 9 %.

    Blocks of ten samples have a heavy-tailed spread of their own, so that the mean of the bootstrap is asked for a
    quarter.
    """
    sd = 0.1 * np.sqrt(np.mean(clean**2, axis=1, keepdims=True))
    found = [
        predicted(posterior, clean + sd * np.random.default_rng([2, seed]).standard_normal(clean.shape), seed)
        for seed in range(60)
    ]
    errors = np.array([one.nrmse for one in found])
    assert np.mean(errors) == pytest.approx(0.1 / np.sqrt(1.01), rel=0.01)
    assert np.mean([one.nrmse_se for one in found]) == pytest.approx(np.std(errors, ddof=1), rel=0.25)


def test_an_error_in_one_stretch_is_less_certain_than_one_throughout(posterior: Posterior, clean: Floats) -> None:
    """The bootstrap sees time: the same energy in a tenth of the record could as well have been missed."""
    n = clean.shape[1]
    signs = np.where(np.arange(n) % 2 == 0, 1.0, -1.0)
    throughout = predicted(posterior, clean + 0.1 * signs)
    burst = (np.arange(n) < n // 10) * np.sqrt(n / (n // 10))
    local = predicted(posterior, clean + 0.1 * signs * burst)
    # What was measured differs by the error itself.
    assert local.nrmse == pytest.approx(throughout.nrmse, rel=0.02)
    assert local.nrmse_se > 20.0 * throughout.nrmse_se
    # Three of thirty blocks hold all: the share drawn has an sd of sqrt(0.1 0.9 / 30) = 0.055 about 0.1.
    assert local.nrmse_se == pytest.approx(0.5 * local.nrmse * 0.0548 / 0.1, rel=0.3)


def test_the_draws_come_from_the_stream_given(posterior: Posterior, clean: Floats) -> None:
    noisy = clean + 0.05 * np.random.default_rng(3).standard_normal(clean.shape)
    assert predicted(posterior, noisy, 4).nrmse_se == predicted(posterior, noisy, 4).nrmse_se
    assert predicted(posterior, noisy, 4).nrmse_se != predicted(posterior, noisy, 5).nrmse_se


def test_a_channel_that_was_not_trained_on_has_a_noise_level_of_its_own(posterior: Posterior) -> None:
    rng = np.random.default_rng(6)
    drift = ENGINE.simulate(MODEL, MODEL.space.from_unit(POINT[None]), UNSEEN, ("drift_1",)).values[0, 0]
    record = replace(UNSEEN, channels={"drift_1": drift + 1e-3 * rng.standard_normal(UNSEEN.n_times)})
    found = predict(posterior, POINT, record, rng)
    # The mean log density of a normal sample at its own sd; the model-free level is good to a few per cent.
    assert found.log_density == pytest.approx(-0.5 - np.log(1e-3) - 0.5 * np.log(2.0 * np.pi), abs=0.2)


def test_the_floor_is_the_noise_over_the_signal(clean: Floats) -> None:
    """30 and 20 dB: the root mean square of 10^-1.5 and 10^-1, to the few per cent of a model-free estimate."""
    rng = np.random.default_rng(7)
    rms = np.sqrt(np.mean(clean**2, axis=1))
    noisy = clean + (rms * np.array([10.0**-1.5, 10.0**-1.0]))[:, None] * rng.standard_normal(clean.shape)
    record = replace(UNSEEN, channels=dict(zip(CHANNELS, noisy, strict=True)))
    assert floor_of(record) == pytest.approx(np.sqrt(0.5 * (1e-3 + 1e-2)), rel=0.12)


def test_a_record_that_measures_nothing_is_the_users_mistake(posterior: Posterior) -> None:
    with pytest.raises(UserError, match="measures nothing"):
        predict(posterior, POINT, replace(UNSEEN, channels={}), np.random.default_rng(8))
