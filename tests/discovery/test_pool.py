"""Which accounts of the errors a specimen's laws are weighed under."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pulled_spring import TIME_STEP, explained, with_past

from bwbn_bayes.discovery import pool as pooling
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.pool import Pool
from bwbn_bayes.discovery.run import DiscoverySettings, Run
from bwbn_bayes.parameters import Floats

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


def test_what_predicts_later_cycles_is_delivered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of laws that leave more than noise the likeliest, unless stretches agree on another; of its optima the best."""
    pool, one = pool_of(FORCE), leaving(8.0)
    keys: list[Any] = [frozenset({((name,), (1,))}) for name in "abc"]
    laws = {key: replace(one, added=(SimpleNamespace(key=key),)) for key in keys}  # type: ignore[arg-type]
    monkeypatch.setattr(Explanation, "effects_key", property(lambda law: law.added[0].key))
    optima = tuple(replace(one.modes[0], log_likelihood=one.modes[0].log_likelihood - n) for n in range(3))
    pool.plain.update(laws)
    # The second is ahead in each stretch; the third by more, but in one of them alone.
    ahead = {
        keys[0]: ([2.0, 2.0, 2.0, 2.0], [9.0] * 4, [9.0] * 4),
        keys[1]: ([3.0, 3.1, 2.9, 3.0], [4.0] * 4, [3.5] * 4),
        keys[2]: ([0.0, 0.0, 0.0, 99.0], [9.0] * 4, [9.0] * 4),
    }

    def score(law: Explanation) -> Floats:
        number = [mode.log_likelihood for mode in optima].index(law.evidence.modes[0].log_likelihood)
        return np.array(ahead[law.effects_key][number])

    monkeypatch.setattr(pooling, "_scores_ahead", score)
    monkeypatch.setattr(pooling, "finely_solved", lambda law: law)
    monkeypatch.setattr(pooling, "find_modes", lambda *_, **__: ())
    monkeypatch.setattr(pooling, "settled", lambda *_, **__: optima)
    believed: Any = SimpleNamespace(predictive=laws[keys[0]], deliverable=tuple(laws.values()))
    found = pool.delivered(believed)
    assert found.effects_key == keys[1]
    assert found.modes == found.evidence.modes == optima[1:]
