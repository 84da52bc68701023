"""Engines by name."""

from __future__ import annotations

import sys

import pytest

from bwbn_bayes.engines import available, cvodes
from bwbn_bayes.engines.available import NAMES, engine, engines
from bwbn_bayes.errors import UserError

ELSEWHERE = ("sunode", "cuda")
"""What this machine may lack: a package of conda-forge, a graphics card."""


@pytest.mark.parametrize("name", [name for name in NAMES if name not in ELSEWHERE])
def test_every_name_gives_its_engine(name: str) -> None:
    made = engine(name, n_threads=1)
    assert made.name == name
    assert made.scheme


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(UserError, match="'euler' is not known: choose one of lanes, cvodes, reference, scalar"):
        engine("euler")


def test_a_missing_library_is_a_reason_not_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    cvodes.load_library.cache_clear()
    monkeypatch.setitem(sys.modules, "sundials4py", None)
    facts = {fact.name: fact for fact in engines()}
    assert facts["lanes"].available
    assert not facts["cvodes"].available
    assert "needs sundials4py, which is not installed" in facts["cvodes"].reason
    monkeypatch.undo()
    assert all(fact.reason and (fact.available or fact.name in ELSEWHERE) for fact in available.engines())


def test_a_library_that_lacks_a_function_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Code that calls what the process does not have would end it."""
    cvodes.load_library.cache_clear()
    monkeypatch.setattr(cvodes, "LIBRARY", f"{cvodes.LIBRARY}def CVodeNowhere(memory: int) -> int32: ...\n")
    with pytest.raises(UserError, match=r"the engine cvodes finds no CVodeNowhere in .*: install another version"):
        engine("cvodes")
