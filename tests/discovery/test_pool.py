"""Which accounts of the errors a specimen's laws are weighed under."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from pulled_spring import TIME_STEP, explained, with_past

from bwbn_bayes.discovery import pool as pooling
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.pool import Pool
from bwbn_bayes.discovery.run import DiscoverySettings, Run

TRAVEL = 0.01 * np.sin(2.0 * np.pi * 0.5 * TIME_STEP * np.arange(900))
FORCE: Any = ("its functions", 1.0)


def leaving(cubic: float) -> Explanation:
    """A spring that leaves errors with a past, and the share of a cubic one."""
    errors = with_past(0.1 * np.random.default_rng(4).standard_normal(len(TRAVEL)), 0.8)
    return explained(TRAVEL, errors + cubic * (TRAVEL / 0.01) ** 3)


def pool_of(force: Any) -> Pool:
    return Pool(run=Run(DiscoverySettings(), np.random.default_rng(1), None), _force=force)


@pytest.mark.parametrize(
    ("has_force", "cubic", "coloured"), [(True, 0.0, True), (True, 8.0, False), (False, 8.0, True)]
)
def test_errors_with_a_past_are_for_laws_that_leave_noise(has_force: bool, cubic: float, coloured: bool) -> None:
    """A spring that is not linear leaves more: where a force of no known law stands beside it, that has it."""
    pool = pool_of(FORCE if has_force else None)
    pool.plain[frozenset()] = one = leaving(cubic)
    assert one.is_noise == (cubic == 0.0)
    pool._colour()
    assert (pool.plain[frozenset()].evidence.correlation is not None) == coloured


def test_a_law_that_leaves_more_than_noise_keeps_none_that_leaves_noise_waiting() -> None:
    """Nor is a law done with for good that was fitted anew."""
    pool, worse, better = pool_of(FORCE), leaving(8.0), leaving(0.0)
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


def test_of_the_likeliest_laws_optima_that_which_predicts_later_cycles_is_delivered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where it leaves more than noise; another law is not, however well it predicts some stretches."""
    pool, one = pool_of(FORCE), leaving(8.0)
    keys: list[Any] = [frozenset({((name,), (1,))}) for name in "ab"]
    laws = {key: replace(one, added=(SimpleNamespace(key=key),)) for key in keys}  # type: ignore[arg-type]
    monkeypatch.setattr(Explanation, "effects_key", property(lambda law: law.added[0].key))
    optima = tuple(replace(one.modes[0], log_likelihood=one.modes[0].log_likelihood - n) for n in range(3))
    pool.plain.update(laws)
    scores = {keys[0]: (5.0, 7.0, 6.0), keys[1]: (9.0, 9.0, 9.0)}

    def score(law: Explanation) -> float:
        number = [mode.log_likelihood for mode in optima].index(law.evidence.modes[0].log_likelihood)
        return scores[law.effects_key][number]

    monkeypatch.setattr(pooling, "_score_ahead", score)
    monkeypatch.setattr(pooling, "finely_solved", lambda law: law)
    monkeypatch.setattr(pooling, "find_modes", lambda *_, **__: ())
    monkeypatch.setattr(pooling, "settled", lambda *_, **__: optima)
    found = pool.delivered(cast(Any, SimpleNamespace(predictive=laws[keys[0]])))
    assert found.effects_key == keys[0]
    assert found.modes == found.evidence.modes == optima[1:]
