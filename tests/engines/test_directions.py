"""Derivatives that nobody wants cost nothing and change nothing."""

from __future__ import annotations

import numpy as np
import pytest
from engine_cases import FREE, building, record_of

from bwbn_bayes.engines.directions import Directions
from bwbn_bayes.engines.lane_source import LANES
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.parameters import PerStorey, Uniform

NOWHERE = 9
MOVED = np.array([[4, 4], [5, NOWHERE], [NOWHERE, 5], [NOWHERE, 6], [NOWHERE, NOWHERE]])
"""Two storeys: one shared parameter, the same parameter of either storey, another of the second, a sensor's."""


def test_every_wanted_parameter_has_a_direction_of_its_own_where_all_are_wanted() -> None:
    directions = Directions.of(MOVED, NOWHERE, np.ones((2, 5), dtype=np.bool_))
    assert directions.n == 4
    assert directions.owner.tolist() == [[0, 1, 2, 3]] * 2


def test_the_same_parameter_of_two_storeys_shares_a_direction() -> None:
    wanted = np.array([[True, True, False, False, True], [True, False, True, False, True]])
    directions = Directions.of(MOVED, NOWHERE, wanted)
    assert directions.n == 2
    assert directions.owner.tolist() == [[0, 1], [0, 2]]
    assert directions.active[:, 1].tolist() == [[1.0, 0.0], [0.0, 1.0]]
    assert directions.column(own=10).tolist() == [[4, 4], [5, 5]]


def test_different_parameters_of_one_storey_do_not_share() -> None:
    wanted = np.array([[False, False, True, False, False], [False, False, False, True, False]])
    assert Directions.of(MOVED, NOWHERE, wanted).n == 2


def test_a_row_is_divided_among_its_shares() -> None:
    directions = Directions.of(
        MOVED, NOWHERE, np.array([[True, True, True, True, True], [True, False, False, True, True]])
    )
    divided = directions.divided(3)
    assert divided.n == 2
    assert divided.owner.tolist() == [[0, 1], [2, 3], [-1, -1], [0, 3], [-1, -1], [-1, -1]]
    assert divided.seed[1].tolist() == [[NOWHERE, 5], [NOWHERE, 6]]
    assert divided.column(own=10).tolist() == [[4, 10], [5, 6]]


@pytest.mark.parametrize("n_draws", [1, 3, 8, 18])
def test_a_draw_that_fills_several_lanes_gives_the_same_bits(n_draws: int) -> None:
    each = {name: PerStorey(one) if isinstance(one, Uniform) else one for name, one in FREE.items()}
    model = building(2, {**each, "delta_nu": PerStorey(Uniform(0.0, 0.1)), "delta_s": PerStorey(Uniform(0.0, 0.2))})
    record = record_of(model, 3.0)
    rng = np.random.default_rng(6)
    draws = model.space.from_unit(model.space.sample_unit(rng, 32))
    free = rng.random(draws.shape) < 0.7
    engine = Lanes(substeps=2, resolution=0.5, n_threads=1)
    assert model.space.n_dim == LANES  # with the residual one more
    full, few = engine.normal_equations(model, draws, record, free=free), slice(0, n_draws)
    part = engine.normal_equations(model, draws[few], record, free=free[few])
    np.testing.assert_array_equal(part.misfit, full.misfit[few])
    np.testing.assert_array_equal(part.gradient, full.gradient[few])
    np.testing.assert_array_equal(part.information, full.information[few])
    response, slopes = engine.sensitivities(model, draws, record, free=free)
    own_response, own_slopes = engine.sensitivities(model, draws[few], record, free=free[few])
    np.testing.assert_array_equal(own_response.values, response.values[few])
    np.testing.assert_array_equal(own_slopes, slopes[few])


def test_wanted_derivatives_are_those_of_the_full_run_bit_for_bit() -> None:
    model = building(2, FREE)
    record = record_of(model, 3.0)
    rng = np.random.default_rng(5)
    draws = model.space.from_unit(model.space.sample_unit(rng, 20))
    free = rng.random(draws.shape) < 0.4
    free[:, 0] = False
    engine = Lanes(n_threads=1)
    full, part = engine.normal_equations(model, draws, record), engine.normal_equations(model, draws, record, free=free)
    both = free[:, None, :, None] & free[:, None, None, :]
    np.testing.assert_array_equal(part.misfit, full.misfit)
    np.testing.assert_array_equal(part.gradient, np.where(free[:, None], full.gradient, 0.0))
    np.testing.assert_array_equal(part.information, np.where(both, full.information, 0.0))
    slopes = engine.sensitivities(model, draws, record, free=free)[1]
    whole = engine.sensitivities(model, draws, record)[1]
    np.testing.assert_array_equal(slopes, np.where(free[:, :, None, None], whole, 0.0))
