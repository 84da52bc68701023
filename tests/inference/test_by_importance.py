"""How long importance sampling goes on where nothing takes over, and what stands for a posterior no draw comes near."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bwbn_bayes.inference.by_importance import _reaches, _taken_back, weighted_draws
from bwbn_bayes.inference.importance import WeightedDraws
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.parameters import Floats

N_DIM = 12
CENTRE = np.full(N_DIM, 0.5)
WIDE = 1.0 / 0.05**2
MODE = Mode(point=CENTRE, log_likelihood=100.0, gradient=np.zeros(N_DIM), information=WIDE * np.eye(N_DIM))


def weighted(log_likelihood: Floats) -> WeightedDraws:
    n = len(log_likelihood)
    return WeightedDraws(
        points=np.tile(CENTRE, (n, 1)), log_likelihood=log_likelihood, log_weights=np.full(n, -np.log(n)),
        log_evidence=0.0, log_evidence_se=1.0, pareto_k=3.0,
    )  # fmt: skip


class Bent:
    """Normal about the centre, but that every coordinate pays dearly for leaving the parabola of the one before it."""

    n_dim = N_DIM
    n_asked = 0

    def log_prior(self, points: Floats) -> Floats:
        return np.where(np.all(np.abs(points - 0.5) < 0.5, axis=1), 0.0, -np.inf)

    def log_likelihood(self, points: Floats) -> Floats:
        self.n_asked += len(points)
        step = points - CENTRE
        off = step[:, 1:] - 20.0 * np.square(step[:, :-1])
        return np.asarray(100.0 - 0.5 * WIDE * (np.square(step[:, 0]) + 30.0 * np.sum(np.square(off), axis=1)))


def drawn(mode: Mode) -> WeightedDraws:
    """From a posterior with such a mode, of a model that leaves more than noise, where nothing takes over."""
    history: Any = SimpleNamespace(say=lambda _: None, tell_draws=lambda *_: None)
    bent: Any = Bent()
    rng = np.random.default_rng(1)
    return weighted_draws(bent, (mode,), rng, 300, history, follows=False, most=20_000)[0]


def test_draws_near_the_fit_are_learnt_from_until_they_are_worth_enough() -> None:
    """Cut off at 6,000 draws, those of a frame on sliders were worth one; at 16,000 they are worth 2,000."""
    found = drawn(replace(MODE, information=WIDE * np.diag([1.0, *(N_DIM - 1) * [30.0]])))
    assert 6_000 < len(found.points) < 20_000
    assert found.effective_sample_size > 2_000
    assert found.pareto_k < 0.6


def test_draws_that_never_come_near_the_fit_end_soon() -> None:
    found = drawn(replace(MODE, log_likelihood=1000.0))
    assert 6_000 <= len(found.points) < 7_000


def test_draws_that_are_all_less_likely_than_a_posteriors_do_not_reach_it() -> None:
    """Half a chi-square of twelve degrees below the mode: 6 on the average, 13.1 in one draw of a hundred."""
    assert _reaches(weighted(np.array([-900.0, 94.0])), MODE)
    assert not _reaches(weighted(np.array([-900.0, 86.8])), MODE)


def test_draws_are_taken_back_to_where_the_record_is_as_likely_as_it_should_be() -> None:
    """Of column 407 a law that left 8 % was shown by a draw that left 36 %: the only one with any weight."""
    given: Any = SimpleNamespace(
        target=(bent := Bent()), modes=(MODE,), rng=np.random.default_rng(1), settings=SimpleNamespace(particles=500)
    )
    laplace = CENTRE + 0.05 * np.random.default_rng(2).standard_normal((500, N_DIM))
    assert not _reaches(weighted(Bent().log_likelihood(laplace)), MODE)
    draws = _taken_back(given, weighted(np.array([-900.0])))
    assert draws.points.shape == (500, N_DIM)
    assert bent.n_asked < 6 * 500  # each until it is near enough, no longer
    lost = 100.0 - draws.log_likelihood
    assert np.all(lost >= 0.0)
    assert np.max(lost) < 60.0  # the tail of a Student's t among the proposals
    assert np.median(lost) < 0.5 * N_DIM
    assert np.all(np.std(draws.points, axis=0) > 1e-3)
    assert draws.effective_sample_size == pytest.approx(1.0)
