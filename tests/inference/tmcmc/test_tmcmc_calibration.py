"""Simulation-based calibration on a conjugate model; a sampler that returns the prior must fail it."""

from collections.abc import Callable

import numpy as np
import pytest
from calibration import calibration_verdict, normalised_rank
from evidence_oracles import EvidenceOracle, Floats

from bwbn_bayes.inference.tmcmc import sample

DESIGN = np.column_stack([np.ones(12), np.linspace(-1.0, 1.0, 12)])
NOISE_SD = 0.1
Sampler = Callable[[EvidenceOracle, int], Floats]


def oracle_for(data: Floats) -> EvidenceOracle:
    """A straight line through twelve points, coefficients uniform in [-1, 1]."""

    def log_likelihood(theta: Floats) -> Floats:
        return -0.5 * np.sum((theta @ DESIGN.T - data) ** 2, axis=1) / NOISE_SD**2

    return EvidenceOracle(
        name="line", n_dim=2, values=lambda x: 2.0 * x - 1.0, log_likelihood_of_values=log_likelihood, log_evidence=0.0
    )


def ranks(sampler: Sampler, n_replicates: int) -> Floats:
    """Ranks of both coefficients and of the log likelihood among 100 thinned draws."""
    rng = np.random.default_rng(42)
    rows = []
    for replicate in range(n_replicates):
        truth = rng.random((1, 2))
        oracle = oracle_for((2.0 * truth[0] - 1.0) @ DESIGN.T + NOISE_SD * rng.standard_normal(len(DESIGN)))
        points = sampler(oracle, replicate)
        points = points[np.arange(100) * len(points) // 100]
        draws = np.column_stack([points, oracle.log_likelihood(points)])
        rows.append(normalised_rank(np.append(truth[0], oracle.log_likelihood(truth)), draws, rng))
    return np.array(rows)


def default(oracle: EvidenceOracle, seed: int) -> Floats:
    return sample(oracle, n_particles=200, rng_seed=seed).particles


def prior(oracle: EvidenceOracle, seed: int) -> Floats:
    return oracle.sample_prior(np.random.default_rng(seed), 300)


def test_default_is_calibrated() -> None:
    verdict = calibration_verdict(ranks(default, 20))
    assert verdict.passed, verdict


@pytest.mark.slow
def test_default_is_calibrated_over_500_replicates() -> None:
    verdict = calibration_verdict(ranks(default, 500))
    assert verdict.passed, verdict


def test_a_sampler_that_returns_the_prior_fails_by_its_log_likelihood() -> None:
    verdict = calibration_verdict(ranks(prior, 20))
    assert not verdict.passed
    assert np.all(verdict.smallest_p[:2] >= verdict.limit)
    assert verdict.smallest_p[2] < verdict.limit
