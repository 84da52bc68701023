"""Fixtures of the inference tests: one model, one record, one posterior, made once."""

from __future__ import annotations

import numpy as np
import pytest
from inference_cases import (
    A_RANGE,
    climbed,
    jacobian_determinant,
    posterior_of,
    recorded,
    sdof_model,
    true_point,
    with_free_a,
    with_slip,
)
from scipy import integrate

from bwbn_bayes import Record, Result, Settings, identify
from bwbn_bayes.inference.importance import WeightedDraws, laplace_mixture, sample_importance
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.parameters import Floats


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
def identified() -> Result:
    """The run of the method that is the default."""
    return identify(sdof_model(), recorded(1), settings=Settings(particles=2000), name="sdof")


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


@pytest.fixture(scope="session")
def at_one(posterior: Posterior, mode: Mode) -> WeightedDraws:
    """The posterior with A known."""
    return sample_importance(posterior, laplace_mixture([mode]), np.random.default_rng(1), effective=2000)


@pytest.fixture(scope="session")
def marginal(posterior: Posterior, at_one: WeightedDraws) -> tuple[Floats, Floats]:
    """Exact posterior density of A on a grid: the mean Jacobian, normalised on the prior's range."""
    grid = np.linspace(*A_RANGE, 141)
    values = posterior.space.from_unit(at_one.points)
    weights = np.exp(at_one.log_weights)
    density = np.array([weights @ jacobian_determinant(values, posterior.space.names, scale) for scale in grid])
    return grid, density / integrate.simpson(density, grid)
