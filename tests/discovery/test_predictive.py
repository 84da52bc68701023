"""Intervals hold as many samples as they say; draws that leave out a part of a posterior are told."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pulled_spring import explained

from bwbn_bayes.discovery.predictive import PredictiveInterval, _Draws, _draws, predictive_interval
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.parameters import Floats

PATH = 0.01 * np.concatenate(
    [a * np.sin(np.linspace(0.0, 2.0 * np.pi, 60)) for a in np.repeat([1.0, 2.0, 3.0, 4.0], 3)]
)


@pytest.mark.parametrize("tails", [2.5, np.inf])
def test_nine_of_ten_samples_amid_the_fitted_ones_lie_inside(tails: float) -> None:
    """Whatever the distribution of the errors, of 360 samples each: heavy tails widen no interval of nine in ten."""
    rng = np.random.default_rng(3)
    errors = rng.standard_t(tails, len(PATH)) if np.isfinite(tails) else rng.standard_normal(len(PATH))
    whole = explained(PATH, errors).posterior.record
    apart = np.flatnonzero(np.arange(len(PATH)) % 120 >= 60)
    one = explained(PATH, errors, left_out=apart)
    believed: Any = SimpleNamespace(explanations=(one,), probabilities=np.ones(1))
    found = predictive_interval(believed, whole, apart, rng)
    assert found.covered == 1.0
    assert found.coverage == pytest.approx(0.9, abs=4.0 * np.sqrt(0.09 / len(apart)))
    width = np.mean(found.high - found.low)
    assert width == pytest.approx(np.diff(np.quantile(errors, (0.05, 0.95)))[0], rel=0.15)


class Bent:
    """Eight coordinates: the first is normal, the others follow its square within a small share of its spread."""

    n_dim = 8

    def log_prior(self, points: Floats) -> Floats:
        return np.where(np.all((points >= 0.0) & (points <= 1.0), axis=1), 0.0, -np.inf)

    def log_likelihood(self, points: Floats) -> Floats:
        along = (points[:, :1] - 0.5) / 0.05
        beside = (points[:, 1:] - 0.5 - 0.001 * along**2) / 0.003
        return -0.5 * np.asarray(along[:, 0] ** 2 + np.sum(np.square(beside), axis=1))


def draws_of_a_bent_posterior(seed: int) -> _Draws:
    information = np.diag([0.05**-2, *[0.003**-2] * 7])
    mode = Mode(point=np.full(8, 0.5), log_likelihood=0.0, gradient=np.zeros(8), information=information)
    one: Any = SimpleNamespace(evidence=SimpleNamespace(posterior=Bent(), modes=(mode,)))
    return _draws(one, 400, np.random.default_rng(seed))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_draws_of_a_bent_posterior_are_to_be_had(seed: int) -> None:
    """By the approximation at the optimum alone 160 to 430 draws counted, with a tail of up to 0.96."""
    assert draws_of_a_bent_posterior(seed).covers


@pytest.mark.xfail(strict=True, reason="the ends of the bend are reached late: 0.88 of the standard deviation")
def test_draws_follow_a_bent_posterior() -> None:
    """400 draws know a standard deviation to 3.5 %, twelve times as many to 1 %."""
    every = [draws_of_a_bent_posterior(seed).points[:, 0] for seed in range(1, 13)]
    assert np.mean(np.std(every, axis=1)) == pytest.approx(0.05, rel=0.05)


def test_draws_that_leave_out_a_part_are_told() -> None:
    interval = PredictiveInterval(low=np.zeros((1, 2)), high=np.ones((1, 2)), coverage=0.5, covered=0.75)
    assert interval.in_words.endswith("Of their draws 25 % may leave out a part of the posterior.")
    assert "leave out" not in replace(interval, covered=1.0).in_words
