"""Which accounts of the errors a specimen's laws are weighed under."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from pulled_spring import TIME_STEP, explained, with_past

from bwbn_bayes.discovery import pool as pooling
from bwbn_bayes.discovery.cross_validation import CrossValidation
from bwbn_bayes.discovery.evidence import laplace
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.pool import Pool
from bwbn_bayes.discovery.run import DiscoverySettings, Run
from bwbn_bayes.inference.as_one import samples_as_one
from bwbn_bayes.inference.likelihood import IntegratedNoise

TRAVEL = 0.01 * np.sin(2.0 * np.pi * 0.5 * TIME_STEP * np.arange(900))


def leaving(cubic: float) -> Explanation:
    """A spring that leaves errors with a past, and the share of a cubic one."""
    errors = with_past(0.1 * np.random.default_rng(4).standard_normal(len(TRAVEL)), 0.8)
    return explained(TRAVEL, errors + cubic * (TRAVEL / 0.01) ** 3)


def pool_of(*laws: Explanation) -> Pool:
    """Each of other effects; the first is the model as given."""
    pool = Pool(run=Run(DiscoverySettings(n_workers=1), np.random.default_rng(1), None))
    for number, law in enumerate(laws):
        put(pool, law, number)
    return pool


def put(pool: Pool, law: Explanation, number: int) -> None:
    """With the effect of a number, or as given."""
    key: Any = frozenset({((f"{number}",), (1,))}) if number else frozenset()
    added: Any = (SimpleNamespace(key=key, label=str(number)),) if number else ()
    pool.plain[key] = replace(law, added=added)


@pytest.fixture(autouse=True)
def _known_by_their_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    """Effects without a model."""
    monkeypatch.setattr(
        Explanation, "effects_key", property(lambda law: law.added[0].key if law.added else frozenset())
    )


@pytest.mark.parametrize("cubic", [0.0, 8.0])
def test_errors_with_a_past_are_for_laws_that_leave_noise(cubic: float) -> None:
    """A spring that is not linear leaves more: how far that hangs together is counted."""
    pool, one = pool_of(leaving(cubic)), leaving(cubic)
    assert one.is_noise == (cubic == 0.0)
    pool._colour()
    assert (pool.plain[frozenset()].evidence.correlation is not None) == one.is_noise


def test_a_law_that_leaves_more_than_noise_keeps_none_that_leaves_noise_waiting() -> None:
    """Nor is a law done with for good that was fitted anew."""
    worse, better = leaving(8.0), leaving(0.0)
    pool = pool_of(*[worse] * 5, better)
    *others, best = pool.plain
    pool._bounds.update(dict.fromkeys(others, 1e6))
    pool._colour()
    assert pool.plain[best].evidence.correlation is not None
    pool.first[frozenset()] = worse.evidence.log_evidence
    pool.add([better])
    pool._colour()
    assert pool.plain[frozenset()].evidence.correlation is not None


def test_samples_count_by_what_the_closest_law_leaves_and_in_all_alike() -> None:
    """Of two laws that leave more than noise; one by one as soon as a law leaves noise."""
    pool = pool_of(leaving(8.0), leaving(6.0))
    assert pool.count()
    best = max(pool.plain.values(), key=lambda one: one.evidence.log_likelihood)
    counted = samples_as_one(best.posterior, best.best)
    assert counted[0] > 2.0
    for one in pool.plain.values():
        assert isinstance(one.posterior.noise, IntegratedNoise)
        assert one.posterior.noise == one.evidence.posterior.noise
        assert one.posterior.noise.correlation_samples == pytest.approx(tuple(counted))
        assert one.evidence.log_evidence == pytest.approx(laplace(one.posterior, one.modes).log_evidence)
    assert not pool.count()
    put(pool, leaving(0.0), 2)
    assert pool.count()
    counts = {cast(IntegratedNoise, one.posterior.noise).correlation_samples for one in pool.plain.values()}
    assert counts == {1.0}


def scored(value: float, *differs: float) -> CrossValidation:
    """A score of four stretches, which differ by so much each."""
    return CrossValidation(log_scores=tuple(0.25 * value + one for one in differs or (0.0,) * 4), nrmse=0.1)


def test_the_law_is_delivered_that_predicts_blocks_of_the_record_best(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where it leaves more than noise: the most probable one within the error of that, at the best of its optima."""
    one = leaving(8.0)
    pool = pool_of(*[one] * 5)
    laws = pool.plain
    _, *keys = laws
    optima = tuple(replace(one.modes[0], log_likelihood=one.modes[0].log_likelihood - n) for n in range(3))
    scores = {
        keys[0]: (scored(5.0), scored(7.0), scored(6.0)),
        keys[1]: (scored(9.0),) * 3,
        keys[2]: (scored(10.0, 2.0, -2.0, 2.0, -2.0),) * 3,
        keys[3]: (scored(12.0),) * 3,
    }

    def score(law: Explanation) -> CrossValidation:
        number = [mode.log_likelihood for mode in optima].index(law.evidence.modes[0].log_likelihood)
        return scores[law.effects_key][number]

    def delivered(*numbers: int, grown: int | None = None) -> Explanation:
        further = [[] if grown is None else [laws[keys[grown]]], []]
        monkeypatch.setattr(pooling, "built_upon", lambda *_: further.pop(0))
        every = tuple(laws[keys[number]] for number in numbers)
        return pool.delivered(cast(Any, SimpleNamespace(deliverable=every)))

    monkeypatch.setattr(pooling, "_cross_validated", score)
    monkeypatch.setattr(pooling, "finely_solved", lambda law: law)
    monkeypatch.setattr(pooling, "find_modes", lambda *_, **__: ())
    monkeypatch.setattr(pooling, "settled", lambda *_, **__: optima)
    found = delivered(0)
    assert found.effects_key == keys[0]
    assert found.modes == found.evidence.modes == optima[1:]
    assert delivered(0, 1).effects_key == keys[1]
    # Its score is higher by one, and scatters by four.
    assert delivered(1, 2).effects_key == keys[1]
    assert delivered(2, 1).effects_key == keys[2]
    # What comes of it is delivered where that predicts better, and is not where it does not.
    assert delivered(1, grown=3).effects_key == keys[3]
    assert delivered(1, grown=2).effects_key == keys[1]
