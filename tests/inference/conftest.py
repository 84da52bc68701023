"""Fixtures of the inference tests: one model, one record, one posterior, made once."""

from __future__ import annotations

import pytest
from inference_cases import climbed, posterior_of, recorded, sdof_model, true_point, with_free_a, with_slip

from bwbn_bayes import Record
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode


@pytest.fixture(scope="session")
def record() -> Record:
    return recorded(1)


@pytest.fixture(scope="session")
def posterior(record: Record) -> Posterior:
    return posterior_of(sdof_model(), record)


@pytest.fixture(scope="session")
def mode(posterior: Posterior, record: Record) -> Mode:
    """The optimum next to the truth."""
    return climbed(posterior, true_point(sdof_model(), record))


@pytest.fixture(scope="session")
def free_posterior(record: Record) -> Posterior:
    """A is identified too: one redundant direction."""
    return posterior_of(with_free_a(sdof_model()), record)


@pytest.fixture(scope="session")
def free_mode(free_posterior: Posterior, record: Record) -> Mode:
    return climbed(free_posterior, true_point(with_free_a(sdof_model()), record))


@pytest.fixture(scope="session")
def slip_record() -> Record:
    return recorded(1, slip=True)


@pytest.fixture(scope="session")
def slip_posterior(slip_record: Record) -> Posterior:
    return posterior_of(with_slip(sdof_model()), slip_record)
