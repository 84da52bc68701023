"""The page's effect is registered, placed, simulated and named."""

from __future__ import annotations

import pytest
from pages import run_page

from bwbn_bayes import Discovery
from bwbn_bayes.elements import catalogue


@pytest.fixture
def own_registry(monkeypatch: pytest.MonkeyPatch) -> None:
    """A copy of the registry that the page may change."""
    monkeypatch.setattr(catalogue, "_REGISTRY", dict(catalogue._REGISTRY))


@pytest.mark.usefixtures("own_registry")
def test_the_page_runs() -> None:
    names = run_page("effects.md")
    found = names["found"]
    assert isinstance(found, Discovery)
    assert found.verdict == "effects_found"
    (added,) = found.added
    assert added.hypothesis.name == "cubic_damping"
    mean, sd = added.moments["c3"]
    assert abs(mean - 4.0) < 4.0 * sd < 2.0
