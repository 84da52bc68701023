"""What rows cost beside what an explanation leaves, against likelihoods of records to which they are added."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bwbn_bayes.discovery.evidence import autoregressive, beside_force, laplace
from bwbn_bayes.discovery.explanation import SPECIMEN, Explanation
from bwbn_bayes.elements.linear import Linear
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.correlation import SharedFunctions
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import distinct, polish
from bwbn_bayes.inference.unnamed.specimen import unnamed_basis
from bwbn_bayes.parameters import Floats, Uniform
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.specimen import Specimen

TIME = 0.02 * np.arange(600)
TRAVEL = 0.01 * np.sin(2.0 * np.pi * 0.5 * TIME) * TIME / TIME[-1]
ROWS = 3.0 * np.sin(2.0 * np.pi * 1.7 * TIME)[None]
STIFFNESS = 2000.0


def explained(errors: Floats) -> Explanation:
    """A linear spring pulled to and fro, of which only the stiffness is unknown."""
    channels = {"force": STIFFNESS * TRAVEL + errors}
    record = Record(name="loop", time_step=0.02, excitation=TRAVEL, excitation_kind="displacement", channels=channels)
    model = Specimen(storey=Linear(k=Uniform(1000.0, 3000.0), c=0.0))
    posterior = Posterior(model=model, record=record, engine=Lanes(n_threads=1), noise=default_noise(record))
    modes = distinct(*polish(posterior, np.array([[0.4]]), n_iterations=10))
    return Explanation(added=(), posterior=posterior, modes=modes, evidence=laplace(posterior, modes))


def coloured(white: Floats) -> Explanation:
    errors = np.zeros_like(white)
    for number in range(1, len(white)):
        errors[number] = 0.9 * errors[number - 1] + white[number]
    one = explained(errors)
    return replace(one, evidence=autoregressive(one.posterior, one.modes))


def forced(white: Floats) -> Explanation:
    one = explained(white + 0.2 * STIFFNESS * TRAVEL**3 / 1e-4)
    evidence = beside_force(one.posterior, one.modes, SharedFunctions.of(unnamed_basis(one.posterior.record)), 4.0)
    return replace(one, posterior=evidence.posterior, modes=evidence.modes, evidence=evidence, unnamed=SPECIMEN)


@pytest.mark.parametrize("kind", [explained, coloured, forced])
def test_what_rows_cost_is_what_the_likelihood_loses_by_them(kind: Callable[[Floats], Explanation]) -> None:
    """Taken to and fro, so that only their squares tell; small, so that the level of noise stays."""
    one = kind(0.3 * np.random.default_rng(5).standard_normal(len(TIME)))
    posterior, point, share = one.evidence.posterior, one.best[None], 1e-2
    assert (posterior.noise.correlation is None) == (kind is explained)

    def with_rows(times: float) -> float:
        record = posterior.record
        added = record.with_channels({"force": record.channels["force"] + times * ROWS[0]})
        return float(replace(posterior, record=added).log_likelihood(point)[0])

    lost = 2.0 * with_rows(0.0) - with_rows(share) - with_rows(-share)
    assert one.over_noise(ROWS) == pytest.approx(lost / (2.0 * share**2), rel=0.02)
    stiffness = posterior.space.from_unit(point)[0, 0]
    assert one.residual[0] == pytest.approx(posterior.record.channels["force"] - stiffness * TRAVEL, abs=1e-9)
