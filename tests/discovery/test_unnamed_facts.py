"""What is left beside something unnamed is told where it is less than without; nothing is solved here."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from bwbn_bayes.discovery import unnamed_facts
from bwbn_bayes.discovery.held_out import Prediction
from bwbn_bayes.discovery.outcome import Gap
from bwbn_bayes.discovery.probability import Beliefs


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
