"""Intervals at a bound and away from it, and moments of weighted draws."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from bwbn_bayes.elements.linear import Linear
from bwbn_bayes.inference.summary import Draws, _parameter_facts, densest_interval
from bwbn_bayes.parameters import LogNormal
from bwbn_bayes.structures.oscillator import Oscillator


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_density_highest_at_a_bound_has_an_interval_that_reaches_it(sign: float) -> None:
    """Exponential: nine tenths lie below log 10; mirrored, above minus log 10."""
    draws = sign * np.random.default_rng(1).exponential(size=4000)
    low, high = densest_interval(draws, (0.0, 50.0) if sign > 0.0 else (-50.0, 0.0))
    assert (low if sign > 0.0 else high) == 0.0
    assert (high if sign > 0.0 else -low) == pytest.approx(np.log(10.0), rel=0.05)


@pytest.mark.parametrize("n", [20, 4000])
def test_away_from_the_bounds_it_is_the_densest_interval_of_the_draws(n: int) -> None:
    """Also of so few draws that it may end at the outermost one."""
    draws = np.random.default_rng(2).normal(5.0, 0.1, n)
    low, high = densest_interval(draws, (0.0, 50.0))
    assert draws.min() <= low < high <= draws.max()
    if n > 1000:
        assert (low, high) == pytest.approx(tuple(stats.norm.interval(0.9, 5.0, 0.1)), abs=0.03)


def test_draws_that_do_not_differ() -> None:
    assert densest_interval(np.full(100, 3.0), (3.0, 4.0)) == (3.0, 3.0)


def test_a_draw_outside_the_prior_has_no_part_in_the_moments() -> None:
    """It has a place outside the unit cube and no weight: nothing times no value left every mean without a number."""
    model = Oscillator(mass=1.0, spring=Linear(k=LogNormal(400.0, 1.0)))
    inside = np.array([[0.4], [0.5], [0.6]])
    draws = Draws(
        points=inside,
        log_likelihood=np.zeros(3),
        weighted_points=np.append(inside, [[2.0]], axis=0),
        weights=np.array([0.25, 0.5, 0.25, 0.0]),
        effective_sample_size=3.0,
    )
    posterior: Any = SimpleNamespace(space=model.space, record=SimpleNamespace(truth={}))
    (found,) = _parameter_facts(posterior, draws)
    values = 400.0 * np.exp(stats.norm.ppf(inside[:, 0]))
    assert found.mean == pytest.approx(np.average(values, weights=[1, 2, 1]))
    assert found.sd == pytest.approx(np.sqrt(np.cov(values, aweights=[1, 2, 1], ddof=0)))
