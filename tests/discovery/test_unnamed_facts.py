"""How sure something unnamed is, and that what is left beside it is told where that is less; nothing is solved."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from bwbn_bayes.discovery import unnamed_facts
from bwbn_bayes.discovery.explanation import Place
from bwbn_bayes.discovery.held_out import Prediction
from bwbn_bayes.discovery.outcome import Gap
from bwbn_bayes.discovery.probability import Beliefs
from bwbn_bayes.inference.unnamed.further_link import Span


@pytest.mark.parametrize(("place", "there"), [((2,), 0.3), (Span(0, 2), 0.25), ("acceleration_1", 0.2), ((1, 2), 0.1)])
def test_something_unnamed_is_told_with_the_probability_of_its_own_place(
    place: Place, there: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A force in storey 2 was told with the probability that anything, anywhere, has no name."""
    shares = [((2,), 0.2), (Span(0, 2), 0.25), ("acceleration_1", 0.2), ((2,), 0.1), ((1, 2), 0.1), (Span(1, 2), 0.1)]
    every: list[Any] = [
        SimpleNamespace(
            unnamed=own,
            has_unnamed=own is not None,
            estimate=None,
            is_specimen=False,
            evidence=SimpleNamespace(log_evidence=np.log(p)),
        )
        for own, p in (*shares, (None, 0.05))
    ]
    first = next(n for n, (own, _) in enumerate(shares) if own == place)
    order = [first, *(n for n in range(len(every)) if n != first)]
    none = np.zeros(len(every))
    explanations = tuple(every[n] for n in order)
    believed = Beliefs(explanations=explanations, log_prior=none, law_error=none, forgiven=none)
    for of_kind in ("_of_storey", "_of_link", "_of_sensor"):
        monkeypatch.setattr(unnamed_facts, of_kind, lambda *given: given[-1])
    sure: Any = unnamed_facts.unnamed_facts(believed, every[-1])
    assert sure == pytest.approx((there, 0.95))


def prediction(nrmse: float) -> Prediction:
    return cast(Prediction, SimpleNamespace(nrmse=nrmse))


@pytest.mark.parametrize(("left", "is_told"), [(0.02, True), (0.055, False), (float("nan"), False)])
def test_a_force_that_leaves_more_once_it_is_solved_for_is_not_shown(
    left: float, is_told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the Silverbox, hardly damped, 0.5 % was left; beside a force known to first order 5.5, and that was told."""
    monkeypatch.setattr(unnamed_facts, "predict", lambda *_, **__: prediction(left))
    record = SimpleNamespace(kept=slice(None))
    one = SimpleNamespace(
        has_unnamed=True, is_specimen=False, whole=(SimpleNamespace(record=record), np.zeros(1)), estimate=None
    )
    believed: Any = SimpleNamespace(explanations=(one,), unnamed=0.99)
    gap = Gap(noise_floor=0.002, before=prediction(0.16), after=prediction(0.005 if left > 0.05 else 0.03))
    found = unnamed_facts.beside_it(cast(Beliefs, believed), None, gap, np.random.default_rng(1))
    assert (found.nameless is not None) == is_told
    assert found.after is gap.after
