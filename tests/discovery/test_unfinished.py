"""What ``discovery.json`` says before a search has ended; nothing is solved here."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from bwbn_bayes.discovery import unfinished


def test_names_have_the_probability_that_they_have_at_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """An effect that is part of every explanation, and hardly borne out, was certain until the search ended."""
    monkeypatch.setattr(unfinished, "floor_of", lambda _: 0.01)
    monkeypatch.setattr(unfinished, "_nrmse", lambda _: 0.1)
    scores = SimpleNamespace(nrmse=0.1, log_score=-1.0)
    believed: Any = SimpleNamespace(
        names={"slip_lock": 1.0, "backlash": 0.7, "gap_impact": 1e-9},
        law_probabilities={"slip_lock": 0.4, "backlash": 0.7, "gap_impact": 1e-9},
        verdict="partly_explained",
        verdicts={},
        deliverable=(SimpleNamespace(added=(), cross_validation=scores),),
    )
    record = SimpleNamespace(name="a record")
    given: Any = SimpleNamespace(posterior=SimpleNamespace(record=record), disagreement=SimpleNamespace(spots=()))
    facts = unfinished.Unfinished(
        name="a model", data="", given=given, believed=believed, steps=(), notes=(), binding=(), seed=1, elapsed_s=1.0
    ).as_json()
    assert list(facts["probabilities"].items()) == [("backlash", 0.7), ("slip_lock", 0.4)]
