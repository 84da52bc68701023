"""Fixtures of the engine tests."""

from __future__ import annotations

import pytest
from engine_cases import ENGINES

from bwbn_bayes.engines.base import Engine
from bwbn_bayes.engines.reference import Reference


@pytest.fixture(scope="session", params=list(ENGINES))
def engine(request: pytest.FixtureRequest) -> Engine:
    """Every engine in turn."""
    return ENGINES[request.param]


@pytest.fixture(scope="session")
def reference() -> Reference:
    """The oracle."""
    return Reference()
