"""Squared residuals and derivatives of few points from a prepared solve: those of the normal equations."""

from __future__ import annotations

import numpy as np
import pytest
from engine_cases import FREE, building, record_of

from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.records.joined import join_records

ENGINE = Lanes(n_threads=1)


@pytest.mark.parametrize("n_draws", [1, 3, 5, 16])
@pytest.mark.parametrize("n_storeys", [1, 3])
def test_they_are_those_of_the_normal_equations(n_storeys: int, n_draws: int) -> None:
    model = building(n_storeys, FREE)
    record = record_of(model)
    solve = ENGINE.of_points(model, record)
    assert solve is not None
    rng = np.random.default_rng(1)
    for _ in range(2):
        values = model.space.from_unit(rng.uniform(0.2, 0.8, (n_draws, model.space.n_dim)))
        misfit, slopes = solve(values, record.measured)
        expected = ENGINE.normal_equations(model, values, record)
        np.testing.assert_allclose(misfit, expected.misfit, rtol=1e-10)
        scale = np.max(np.abs(expected.gradient))
        np.testing.assert_allclose(slopes, -2.0 * expected.gradient, rtol=1e-8, atol=1e-12 * scale)
    values[-1, 0] = np.nan
    failed, _ = solve(values, record.measured)
    assert not np.any(np.isfinite(failed[-1]))
    np.testing.assert_array_equal(failed[:-1], misfit[:-1])


def test_records_that_measure_different_floors() -> None:
    """Each is compared with its own channels; of other numbers of channels the sums of all were taken, or it failed."""
    model = building(3, FREE)
    floors = (("acceleration_1", "acceleration_2"), ("acceleration_2",), ("acceleration_3", "acceleration_1"))
    record = join_records([record_of(model, channels=names) for names in floors])
    solve = ENGINE.of_points(model, record)
    assert solve is not None
    values = model.space.from_unit(np.random.default_rng(2).uniform(0.2, 0.8, (3, model.space.n_dim)))
    misfit, slopes = solve(values, record.measured)
    expected = ENGINE.normal_equations(model, values, record)
    np.testing.assert_allclose(misfit, expected.misfit, rtol=1e-10)
    scale = np.max(np.abs(expected.gradient))
    np.testing.assert_allclose(slopes, -2.0 * expected.gradient, rtol=1e-8, atol=1e-12 * scale)
