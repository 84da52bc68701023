"""On measured tests, where what a law leaves is model error: no law fits worse than the one that it contains.

Every effect in every form, of free shape too. One law was once put 379 nats below the one that it contains.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bwbn_bayes.discovery.candidates import Hypothesis, hypotheses, scales_of
from bwbn_bayes.discovery.evidence import laplace
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.race import Fit, race
from bwbn_bayes.discovery.run import DiscoverySettings
from bwbn_bayes.discovery.workflow import discover
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.accuracy import LADDER
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import find_modes
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records import read_record
from bwbn_bayes.structures.starting_model import starting_model

COLUMNS = Path(__file__).parents[3] / "shared" / "data" / "rc_columns"
NAMES = ("peer_407",)
"""The column of the fewest points."""
WITHIN = 0.5
"""What the search for an optimum may leave. [nat]"""

pytestmark = pytest.mark.slow


@cache
def given(name: str) -> Explanation:
    """The model to start from, fitted to the whole record."""
    path = COLUMNS / f"{name}.csv"
    if not path.exists():
        pytest.skip(f"measured file {path} is not here")
    record = read_record(path)
    engine = LADDER[0]
    assert isinstance(engine, Lanes)
    model = starting_model(record)
    posterior = Posterior(model=model, record=record, engine=replace(engine, n_threads=1), noise=default_noise(record))
    modes = find_modes(posterior, np.random.default_rng(1))
    return Explanation(added=(), posterior=posterior, modes=modes, evidence=laplace(posterior, modes))


def every(posterior: Posterior, point: Floats) -> tuple[Hypothesis, ...]:
    """Each effect in each form, of the sizes that a fit suggests."""
    usual = hypotheses(
        posterior.model, scales_of(posterior, point), measured=("force",), has_time=False, most_carried=np.inf
    )
    general = {type(form.effect): form for one in usual for form in one.free_shapes}
    return (*usual, *(replace(form, carried=()) for form in general.values()))


@cache
def fits(name: str) -> dict[tuple[str, ...], Fit]:
    base = given(name)
    found = race(base.posterior, every(base.posterior, base.best), base.points)
    return {fit.hypothesis.symbols: fit for fit in found}


@pytest.mark.parametrize("name", NAMES)
def test_no_law_fits_worse_than_the_one_it_contains(name: str) -> None:
    least = given(name).evidence.log_likelihood - WITHIN
    worse = {fit.hypothesis.label: fit.log_likelihood for fit in fits(name).values() if fit.log_likelihood < least}
    assert not worse, f"at least {least:.1f}"
    assert len(fits(name)) >= 15


def test_candidates_that_gain_slowly_are_followed():
    """Laws come near a column's loops by many small steps: given up by their own outlook, they left 16.6 % of it."""
    path = COLUMNS / "peer_132.csv"
    if not path.exists():
        pytest.skip(f"measured file {path} is not here")
    record = read_record(path)
    found = discover(starting_model(record), record, settings=DiscoverySettings(seed=1))
    assert found.gap.after.nrmse < 0.12
