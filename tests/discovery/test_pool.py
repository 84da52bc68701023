"""Which accounts of the errors a specimen's laws are weighed under."""

from typing import Any

import numpy as np
import pytest

from bwbn_bayes.discovery.evidence import laplace
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.pool import Pool
from bwbn_bayes.discovery.run import DiscoverySettings, Run
from bwbn_bayes.elements.linear import Linear
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import distinct, polish
from bwbn_bayes.parameters import Floats, Uniform
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.specimen import Specimen

TIME = 0.02 * np.arange(900)
TRAVEL = 0.01 * np.sin(2.0 * np.pi * 0.5 * TIME)


def explained(errors: Floats) -> Explanation:
    channels = {"force": 2000.0 * TRAVEL + errors}
    record = Record(name="loop", time_step=0.02, excitation=TRAVEL, excitation_kind="displacement", channels=channels)
    model = Specimen(storey=Linear(k=Uniform(1000.0, 3000.0), c=0.0))
    posterior = Posterior(model=model, record=record, engine=Lanes(n_threads=1), noise=default_noise(record))
    modes = distinct(*polish(posterior, np.array([[0.4]]), n_iterations=10))
    return Explanation(added=(), posterior=posterior, modes=modes, evidence=laplace(posterior, modes))


@pytest.mark.parametrize(
    ("has_force", "cubic", "coloured"), [(True, 0.0, True), (True, 8.0, False), (False, 8.0, True)]
)
def test_errors_with_a_past_are_for_laws_that_leave_noise(has_force: bool, cubic: float, coloured: bool) -> None:
    """A spring that is not linear leaves more: where a force of no known law stands beside it, that has it."""
    rng, errors = np.random.default_rng(4), np.zeros(len(TIME))
    for number in range(1, len(TIME)):
        errors[number] = 0.8 * errors[number - 1] + 0.1 * rng.standard_normal()
    force: Any = ("its functions", 1.0)
    run = Run(DiscoverySettings(), np.random.default_rng(1), None)
    pool = Pool(run=run, _force=force if has_force else None)
    pool.plain[frozenset()] = one = explained(errors + cubic * (TRAVEL / 0.01) ** 3)
    assert one.is_noise == (cubic == 0.0)
    pool._colour()
    assert (pool.plain[frozenset()].evidence.correlation is not None) == coloured


def test_a_law_that_leaves_more_than_noise_keeps_none_that_leaves_noise_waiting() -> None:
    """Nor is a law done with for good that was fitted anew."""
    rng, errors = np.random.default_rng(4), np.zeros(len(TIME))
    for number in range(1, len(TIME)):
        errors[number] = 0.8 * errors[number - 1] + 0.1 * rng.standard_normal()
    force: Any = ("its functions", 1.0)
    pool = Pool(run=Run(DiscoverySettings(), np.random.default_rng(1), None), _force=force)
    worse, better = explained(errors + 8.0 * (TRAVEL / 0.01) ** 3), explained(errors)
    keys: list[Any] = [frozenset({((f"{number}",), (1,))}) for number in range(6)]
    pool.plain.update(dict.fromkeys(keys[:5], worse))
    pool.plain[keys[5]] = better
    pool._bounds.update(dict.fromkeys(keys[:5], 1e6))
    pool._colour()
    assert pool.plain[keys[5]].evidence.correlation is not None
    pool.plain[frozenset()] = worse
    pool._colour()
    pool.add_alone([better])
    pool._colour()
    assert pool.plain[frozenset()].evidence.correlation is not None
