"""What the record cannot see, said in words that name the right parameters."""

import numpy as np
import pytest
from inference_cases import climbed, posterior_of, sdof_model, true_point, with_free_a, with_slip
from scipy import stats

from bwbn_bayes import Record
from bwbn_bayes.inference.identifiability import (
    PRIOR_SD,
    covariance_factor,
    covariance_of,
    describe,
    flag,
    unseen_directions,
)
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode

NAMES = ("k", "c", "alpha")


def test_prior_sd_is_that_of_a_uniform() -> None:
    assert pytest.approx(np.sqrt(1.0 / 12.0)) == PRIOR_SD


def test_directions_are_those_of_the_information() -> None:
    """Eigenvalues 1e6, 30 (0.63 prior sds) and 0.01 (35 prior sds) along a known rotated frame."""
    frame, _ = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))
    information = (frame * [1e6, 30.0, 0.01]) @ frame.T
    (widest, first), (next_one, second) = unseen_directions(information)
    assert widest == pytest.approx(10.0 / PRIOR_SD)
    assert next_one == pytest.approx(1.0 / np.sqrt(30.0) / PRIOR_SD)
    assert abs(first @ frame[:, 2]) == pytest.approx(1.0)
    assert abs(second @ frame[:, 1]) == pytest.approx(1.0)


def test_the_factor_of_the_covariance_is_that_of_the_inverse() -> None:
    slopes = np.random.default_rng(2).standard_normal((3, 30, 5)) * [1.0, 30.0, 0.1, 5.0, 200.0]
    information = np.swapaxes(slopes, 1, 2) @ slopes
    expected = np.linalg.inv(information + np.eye(5) / PRIOR_SD**2)
    np.testing.assert_allclose(covariance_of(information), expected, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(covariance_factor(information), np.linalg.cholesky(expected), rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("sharpest", [1e13, 1e16, 1e22])
def test_information_that_rounding_leaves_indefinite_has_a_factor(sharpest: float) -> None:
    """Two directions are sharp; the rest, as far as rounding lets one see, is held by the prior alone."""
    frame, _ = np.linalg.qr(np.random.default_rng(5).standard_normal((6, 6)))
    information = (frame[:, :2] * [sharpest, 1e-3 * sharpest]) @ frame[:, :2].T
    assert np.linalg.eigvalsh(information)[0] < 0.0
    factor = covariance_factor(information)
    assert np.all(np.diag(factor) > 0.0)
    assert np.max(np.linalg.eigvalsh(factor @ factor.T)) < 1.001 * PRIOR_SD**2
    if sharpest < 1e14:
        rest = PRIOR_SD**2 * (np.eye(6) - frame[:, :2] @ frame[:, :2].T)
        np.testing.assert_allclose(factor @ factor.T, rest, atol=1e-3)


def test_a_parameter_without_effect_is_named_alone() -> None:
    (sentence,) = describe(np.diag([1e5, 0.0, 1e5]), NAMES)
    assert "says little about c" in sentence


def test_what_a_bound_cuts_is_not_said_to_be_as_its_prior() -> None:
    """An elastic specimen's n was counted as identified, up to a bound, and said to lie as its prior does."""
    (sentence,) = describe(np.diag([1e5, 0.0, 1e5]), NAMES, ["c"])
    assert sentence == "The record says little more of c than at which end of its prior it lies."


def test_two_parameters_that_act_as_one_are_named_together() -> None:
    """The data see k + alpha only."""
    both = np.array([1.0, 0.0, 1.0])
    (sentence,) = describe(1e6 * (np.outer(both, both) + np.diag([0.0, 1.0, 0.0])), NAMES)
    assert "cannot tell" in sentence
    assert "k and alpha" in sentence or "alpha and k" in sentence
    assert " c " not in sentence


def test_where_no_parameter_takes_much_part_those_that_take_most_are_named() -> None:
    """Twenty parameters of which the data see five combinations: every open direction is spread over all of them."""
    frame, _ = np.linalg.qr(np.random.default_rng(3).standard_normal((20, 20)))
    information = (frame[:, :5] * 1e6) @ frame[:, :5].T
    sentences = describe(information, [f"p{i}" for i in range(20)])
    assert len(sentences) > 1
    assert all("cannot tell p" in sentence or "little about p" in sentence for sentence in sentences)


def test_everything_seen_is_said_once() -> None:
    assert describe(1e4 * np.eye(3), NAMES) == ("The record sees every identified parameter.",)


def named(posterior: Posterior, mode: Mode) -> set[str]:
    (sentence,) = describe(mode.information, posterior.space.names)
    assert "cannot tell" in sentence
    words = sentence.split("cannot tell ")[1].split(" apart")[0]
    return set(words.replace(" and ", ", ").split(", "))


def test_with_a_fixed_the_record_sees_everything(posterior: Posterior, mode: Mode) -> None:
    assert describe(mode.information, posterior.space.names) == ("The record sees every identified parameter.",)


def test_with_a_free_the_redundant_scale_is_named(free_posterior: Posterior, free_mode: Mode) -> None:
    """z and A scale together; k, alpha, beta and gamma undo it, n and the rest do not take part."""
    assert named(free_posterior, free_mode) == {"k", "A", "alpha", "beta", "gamma"}


def test_with_slip_its_width_shares_the_scale(slip_record: Record) -> None:
    model = with_free_a(with_slip(sdof_model()))
    posterior = posterior_of(model, slip_record)
    mode = climbed(posterior, true_point(model, slip_record), n_steps=4)
    assert named(posterior, mode) == {"k", "A", "alpha", "beta", "gamma", "sigma"}


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        (stats.uniform(0.0, 1.0), "unidentified"),
        (stats.uniform(0.0, 0.85), "unidentified"),
        (stats.truncnorm(0.0, 9.0, 0.0, 0.1), "prior-bound"),
        (stats.truncnorm(-9.0, 0.0, 1.0, 0.1), "prior-bound"),
        (stats.truncexpon(50.0, 0.0, 0.02), "prior-bound"),
        (stats.truncnorm(-1.0, 9.0, 0.1, 0.1), "prior-bound"),
        (stats.truncnorm(-3.0, 9.0, 0.3, 0.1), ""),
        (stats.norm(0.97, 0.01), ""),
    ],
)
def test_flags(law: stats.rv_continuous, expected: str) -> None:
    """On quantiles of known laws: a bound at or within one sd of the peak cuts, one three sds away does not."""
    assert flag(law.ppf((np.arange(10_000) + 0.5) / 10_000)) == expected
