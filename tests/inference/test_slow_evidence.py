"""The evidence of ``identify`` against nested sampling by other hands, at draws of the prior.

Run with ``pytest -m slow tests/inference/test_slow_evidence.py``.
"""

from __future__ import annotations

import time
from dataclasses import replace

import dynesty
import numpy as np
import pytest
from inference_cases import SDOF

from bwbn_bayes import Settings, Uniform, identify, simulate
from bwbn_bayes.inference.accuracy import LADDER
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.structure import Structure

N_LIVE, N_STEPS = 100, 60
"""Walks of 60 steps: another nested sampler needed as many. A draw takes 65,000 solves, a minute of one core."""
REST = 0.1
"""Log evidence that may be left in the live points when it stops. [nat]"""


def building(*, a_is_free: bool) -> Structure:
    return SDOF.model.with_values({"A": Uniform(0.5, 2.0)}) if a_is_free else SDOF.model


def nested_evidence(posterior: Posterior, seed: int) -> tuple[float, float]:
    """Log evidence and its standard error, random walks within the bounding ellipsoids."""

    def log_density(point: Floats) -> float:
        prior = float(posterior.log_prior(point[None])[0])
        density = prior + float(posterior.log_likelihood(point[None])[0]) if np.isfinite(prior) else -np.inf
        return density if np.isfinite(density) else -1e300

    sampler = dynesty.NestedSampler(
        log_density, np.array, posterior.n_dim, nlive=N_LIVE, bound="multi", sample="rwalk", walks=N_STEPS,
        rstate=np.random.default_rng(seed),
    )  # fmt: skip
    sampler.run_nested(dlogz=REST, print_progress=False)
    return float(sampler.results.logz[-1]), float(sampler.results.logzerr[-1])


@pytest.mark.slow
@pytest.mark.parametrize("a_is_free", [False, True], ids=["A fixed", "A free"])
@pytest.mark.parametrize("number", range(10))
def test_the_evidence_is_that_of_nested_sampling(number: int, a_is_free: bool) -> None:
    """By the scheme that ``identify`` took: what another scheme would say is not its sampler's error."""
    assert SDOF.excitation is not None
    model = building(a_is_free=a_is_free)
    unit = model.space.sample_unit(np.random.default_rng([2026, number]), 1)
    truth = dict(zip(model.space.names, model.space.from_unit(unit)[0].tolist(), strict=True))
    record = simulate(model, SDOF.excitation.until(10.0), truth, snr_db=20.0, seed=number)
    facts = identify(model, record, settings=Settings(seed=1, particles=2000, alternatives=False)).facts
    scheme = facts.discretisation["scheme"]
    engine = next(replace(rung, n_threads=1) for rung in LADDER if rung.scheme == scheme)
    began = time.perf_counter()
    posterior = Posterior(model=model, record=record, engine=engine, noise=default_noise(record))
    log_evidence, error = nested_evidence(posterior, seed=number)
    solves, seconds = posterior.solves.total, time.perf_counter() - began
    print(number, a_is_free, facts.log_evidence, log_evidence, error, scheme, solves, f"{seconds:.0f} s")
    assert abs(facts.log_evidence - log_evidence) < 3.0 * np.hypot(error, facts.log_evidence_se)
