"""Derivatives as the likelihood sees them, where some have run away."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, override

import numpy as np

from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.slopes import Slopes


@dataclass(frozen=True, kw_only=True)
class _RunAway(Lanes):
    """Lanes whose first derivative runs away from halfway on, where the response itself does not."""

    @override
    def sensitivities(self, *arguments: Any, **options: Any) -> Any:
        response, slopes = super().sensitivities(*arguments, **options)
        halfway = slopes.shape[-1] // 2
        slopes[:, 0, :, halfway] = 1e200
        slopes[:, 0, :, halfway + 1 :] = np.nan
        return response, slopes


def test_a_derivative_that_has_run_away_says_nothing(posterior: Posterior) -> None:
    """Discovery ended in a singular matrix: such a fit of the model as given is one that guesses stand beside.

    Nor does what it was before it was no number: such ones made scores of 1e198 nats.
    """
    point = np.full(posterior.n_dim, 0.5)
    base = Slopes.at(posterior.with_engine(_RunAway(n_threads=1)), point).base
    assert np.all(np.isfinite(base))
    np.testing.assert_allclose(base[:, 1:], Slopes.at(replace(posterior, engine=Lanes(n_threads=1)), point).base[:, 1:])
    assert not np.any(base[:, 0])
