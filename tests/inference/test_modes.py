"""Finding the mode from the prior, and the climb that polishes it."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from inference_cases import ENGINE, posterior_of, sdof_model, true_point

from bwbn_bayes import Uniform, UserError
from bwbn_bayes.inference.likelihood import Linearisation, Posterior
from bwbn_bayes.inference.modes import Mode, WindowFacts, distinct, find_modes, first_window, polish, steps, windows
from bwbn_bayes.parameters import Floats


@pytest.mark.parametrize(("duration", "first"), [(150.0, 5.0), (53.7, 3.1), (25.0, 3.0), (8.0, 7.9)])
def test_windows_grow_to_the_whole_record(duration: float, first: float) -> None:
    ends = np.array(windows(duration, first))
    assert ends[0] == first
    assert ends[-1] == duration
    assert np.all(np.diff(ends) > 0.0)
    assert np.all(ends[1:] / ends[:-1] <= 1.5 / 0.9 + 1e-12)


def test_first_window_holds_enough_samples_and_energy(posterior: Posterior) -> None:
    record = posterior.record
    end = first_window(posterior)
    signal = record.channels["acceleration_1"]
    share = np.sum(signal[record.times <= end] ** 2) / np.sum(signal**2)
    assert end >= 150 * record.time_step
    assert share >= 0.02
    assert first_window(replace(posterior, record=record.until(1.0))) == pytest.approx(1.0)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_mode_of_the_truth_is_found_blind(posterior: Posterior, mode: Mode, seed: int) -> None:
    seen: list[WindowFacts] = []
    found = find_modes(posterior, np.random.default_rng(seed), n_starts=512, progress=seen.append)
    assert found[0].log_likelihood > mode.log_likelihood - 0.05
    step = found[0].point - mode.point
    assert np.sqrt(step @ mode.information @ step) < 0.3
    assert all(a.log_likelihood >= b.log_likelihood for a, b in pairwise(found))
    assert seen[-1].end == posterior.record.duration
    assert np.all(np.diff([facts.n_solves for facts in seen]) > 0)


def test_the_same_stream_finds_the_same(posterior: Posterior) -> None:
    short = posterior.until(4.0)
    first, second = (find_modes(short, np.random.default_rng(5), n_starts=64) for _ in range(2))
    np.testing.assert_array_equal(first[0].point, second[0].point)


def starts_near(point: Floats, n: int) -> Floats:
    return np.clip(point + np.random.default_rng(6).normal(0.0, 0.05, (n, len(point))), 0.01, 0.99)


def test_polish_never_loses_and_ends_where_newton_does(posterior: Posterior, mode: Mode) -> None:
    starts = starts_near(mode.point, 16)
    before = posterior.log_likelihood(starts)
    points, local = polish(posterior, starts, n_iterations=30)
    # The kernels with and without tangents round differently, and rounding may tip the choice of a step.
    np.testing.assert_allclose(local.log_likelihood, posterior.log_likelihood(points), rtol=1e-8)
    assert np.all(local.log_likelihood >= before - 1e-5)
    assert np.all((points > 0.0) & (points < 1.0))
    assert np.max(local.log_likelihood) == pytest.approx(mode.log_likelihood, abs=0.05)
    for n_iterations in (1, 2, 4):
        shorter = polish(posterior, starts, n_iterations=n_iterations)[1].log_likelihood
        assert np.all((shorter >= before - 1e-5) & (shorter <= local.log_likelihood + 1e-5))


def test_polish_keeps_what_is_held(posterior: Posterior, mode: Mode) -> None:
    held = np.zeros(len(mode.point), dtype=np.bool_)
    held[[0, 3]] = True
    starts = starts_near(mode.point, 8)
    points, local = polish(posterior, starts, n_iterations=8, held=held)
    np.testing.assert_array_equal(points[:, held], starts[:, held])
    assert np.all(local.log_likelihood > posterior.log_likelihood(starts))


def test_an_optimum_past_a_bound_is_found_on_it(posterior: Posterior) -> None:
    """The true stiffness is 40 N/m: with a prior from 41 N/m on, the constrained optimum presses on the bound."""
    bounded = posterior_of(sdof_model().with_values({"k": Uniform(41.5, 60)}), posterior.record)
    start = true_point(sdof_model(), posterior.record)
    start[0] = 0.2
    points, local = polish(bounded, starts_near(start, 16), n_iterations=40)
    best = int(np.argmax(local.log_likelihood))
    assert points[best, 0] < 1e-5
    assert local.gradient[best, 0] < 0.0
    others = np.linalg.solve(local.information[best, 1:, 1:] + 12.0 * np.eye(7), local.gradient[best, 1:])
    assert np.sqrt(others @ local.information[best, 1:, 1:] @ others) < 0.3


def test_a_start_closer_to_a_face_than_steps_go_climbs_from_where_they_do(posterior: Posterior, mode: Mode) -> None:
    """As a draw may lie; what is held there stays."""
    start = np.clip(mode.point, 0.01, 0.99)[None].copy()
    start[0, 0] = 1.0 - 1e-9
    found, local = polish(posterior, start, n_iterations=5)
    other, there = polish(posterior, np.minimum(start, 1.0 - 1e-6), n_iterations=5)
    np.testing.assert_array_equal(found, other)
    np.testing.assert_array_equal(local.log_likelihood, there.log_likelihood)
    held = np.zeros(start.shape[1], dtype=np.bool_)
    held[0] = True
    stayed, _ = polish(posterior, start, n_iterations=2, held=held)
    assert stayed[0, 0] == start[0, 0]


def test_starts_that_cannot_be_solved_do_not_spoil_the_rest(posterior: Posterior) -> None:
    stiff = posterior_of(sdof_model().with_values({"k": Uniform(20.0, 1e9)}), posterior.record)
    starts = np.tile(true_point(stiff.model, posterior.record), (3, 1))  # type: ignore[arg-type]
    starts[1, 0] = 0.999
    points, local = polish(stiff, starts, n_iterations=4)
    assert np.all(np.isfinite(points))
    assert np.all(np.isfinite(local.log_likelihood[[0, 2]]))


def test_a_prior_without_any_solution_is_a_user_error(posterior: Posterior) -> None:
    hopeless = sdof_model().with_values({"k": Uniform(1e9, 2e9)})
    view = Posterior(model=hopeless, record=posterior.record.until(4.0), engine=ENGINE, noise=posterior.noise)
    with pytest.raises(UserError, match="none of 64 draws of the prior can be solved"):
        find_modes(view, np.random.default_rng(7), n_starts=64)


def test_modes_closer_than_a_posterior_sd_are_one(posterior: Posterior, mode: Mode) -> None:
    values, vectors = np.linalg.eigh(mode.information)
    narrow = vectors[:, -1] / np.sqrt(values[-1])
    points = np.stack([mode.point, mode.point + 0.5 * narrow, mode.point + 2.0 * narrow])
    kept = distinct(points, posterior.linearise(points))
    assert len(kept) == 2
    assert kept[0].log_likelihood >= kept[1].log_likelihood


@pytest.mark.parametrize("worst", [np.inf, np.nan, 1e305])
def test_a_candidate_whose_derivatives_ran_away_stays_where_it_is(worst: float) -> None:
    """It ended a search in a LinAlgError, and every other candidate's with it."""
    information = np.tile(100.0 * np.eye(2), (2, 1, 1))
    information[1] = [[worst, 1.0], [1.0, 1.0]]
    local = Linearisation(
        log_likelihood=np.zeros(2), gradient=np.tile([1.0, -1.0], (2, 1)), information=information
    )  # fmt: skip
    points = np.full((2, 2), 0.5)
    for allowed in (None, np.array([[True, True], [True, False]])):
        moved = steps(points, local, np.full(2, 1e4), allowed)
        assert moved[1].tolist() == [0.5, 0.5]
        assert moved[0] - points[0] == pytest.approx([1e-6, -1e-6], rel=0.01)
