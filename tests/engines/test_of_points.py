"""One point's squared residuals and derivatives from a prepared solve: those of the normal equations."""

from __future__ import annotations

import numpy as np
import pytest
from engine_cases import FREE, building, record_of

from bwbn_bayes.engines.lanes import Lanes

ENGINE = Lanes(n_threads=1)


@pytest.mark.parametrize("n_storeys", [1, 3])
def test_they_are_those_of_the_normal_equations(n_storeys: int) -> None:
    model = building(n_storeys, FREE)
    record = record_of(model)
    solve = ENGINE.of_points(model, record)
    assert solve is not None
    for share in (0.3, 0.6):
        values = model.space.from_unit(np.full((1, model.space.n_dim), share))
        misfit, slopes = solve(values[0], record.measured)
        expected = ENGINE.normal_equations(model, values, record)
        np.testing.assert_allclose(misfit, expected.misfit[0], rtol=1e-10)
        np.testing.assert_allclose(slopes, -2.0 * expected.gradient[0], rtol=1e-8, atol=1e-12)
    misfit, _ = solve(np.full(model.space.n_dim, np.nan), record.measured)
    assert not np.all(np.isfinite(misfit))
