"""What rows cost beside what an explanation leaves, against likelihoods of records to which they are added."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from pulled_spring import TIME_STEP, explained, with_past

from bwbn_bayes.discovery.evidence import autoregressive, recounted
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.inference.likelihood import default_noise
from bwbn_bayes.parameters import Floats

TIME = TIME_STEP * np.arange(600)
TRAVEL = 0.01 * np.sin(2.0 * np.pi * 0.5 * TIME) * TIME / TIME[-1]
ROWS = 3.0 * np.sin(2.0 * np.pi * 1.7 * TIME)[None]


def plain(white: Floats) -> Explanation:
    return explained(TRAVEL, white)


def coloured(white: Floats) -> Explanation:
    one = explained(TRAVEL, with_past(white, 0.9))
    return replace(one, evidence=autoregressive(one.posterior, one.modes))


def counted(white: Floats) -> Explanation:
    """Five samples count as one."""
    one = explained(TRAVEL, white)
    noise = replace(default_noise(one.posterior.record), correlation_samples=5.0)
    return replace(one, evidence=recounted(one.posterior, one.modes, noise))


@pytest.mark.parametrize("kind", [plain, coloured, counted])
def test_what_rows_cost_is_what_the_likelihood_loses_by_them(kind: Callable[[Floats], Explanation]) -> None:
    """Taken to and fro, so that only their squares tell; small, so that the level of noise stays."""
    one = kind(0.3 * np.random.default_rng(5).standard_normal(len(TIME)))
    posterior, point, share = one.evidence.posterior, one.best[None], 1e-2
    assert (posterior.noise.correlation is None) == (kind is not coloured)

    def with_rows(times: float) -> float:
        record = posterior.record
        added = record.with_channels({"force": record.channels["force"] + times * ROWS[0]})
        return float(replace(posterior, record=added).log_likelihood(point)[0])

    lost = 2.0 * with_rows(0.0) - with_rows(share) - with_rows(-share)
    assert one.over_noise(ROWS) == pytest.approx(lost / (2.0 * share**2), rel=0.02)
    stiffness = posterior.space.from_unit(point)[0, 0]
    assert one.residual[0] == pytest.approx(posterior.record.channels["force"] - stiffness * TRAVEL, abs=1e-9)
