"""Intervals at a bound and away from it."""

import numpy as np
import pytest
from scipy import stats

from bwbn_bayes.inference.summary import densest_interval


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
