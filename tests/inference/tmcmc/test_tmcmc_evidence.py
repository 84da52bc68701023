"""The sampler against closed forms: evidence, its standard error, posterior means and standard deviations."""

import numpy as np
import pytest
from evidence_oracles import (
    EvidenceOracle,
    beta_binomial,
    exponential,
    gaussian_in_box,
    gumbel,
    linear_gaussian,
    normal_inverse_gamma,
    product_ridge,
    two_gaussians,
)

from bwbn_bayes.inference.tmcmc import TmcmcResult, sample

FAST = [
    linear_gaussian(2),
    linear_gaussian(3, n_data=1000, prior="uniform"),
    normal_inverse_gamma(),
    gaussian_in_box(np.array([0.5, 0.0, 1.02]), np.array([0.01, 0.05, 0.02])),
    two_gaussians(2, share=0.2),
    beta_binomial(),
    exponential(),
    gumbel(),
]
SLOW = [two_gaussians(2), two_gaussians(4), two_gaussians(4, share=0.3), product_ridge()]


def runs(oracle: EvidenceOracle, n_runs: int, n_particles: int) -> list[TmcmcResult]:
    return [sample(oracle, n_particles=n_particles, rng_seed=100 + seed) for seed in range(n_runs)]


def require_agreement(oracle: EvidenceOracle, results: list[TmcmcResult], largest_sd: float) -> None:
    """Mean error below 3 standard errors of the mean, sd within its limit, moments within 4 standard errors.

    The standard error of the mean evidence is the root mean square of the reported one and the one seen. Those of the
    moments are the larger of what the runs show and ``sd / sqrt(effective draws)`` as reported by the last stages: the
    spread of a few runs alone is itself a wild estimate.
    """
    errors = np.array([result.log_evidence for result in results]) - oracle.log_evidence
    reported = np.array([result.log_evidence_se for result in results])
    standard_error = np.sqrt(0.5 * (np.var(errors, ddof=1) + np.mean(reported**2)) / len(errors))
    assert abs(np.mean(errors)) < 3.0 * standard_error, (np.mean(errors), standard_error)
    assert np.std(errors, ddof=1) < largest_sd
    if oracle.posterior_mean is None or oracle.posterior_sd is None:
        return
    values = np.stack([oracle.values(result.particles) for result in results])
    effective_draws = sum(result.stages[-1].effective_sample_size for result in results)
    for seen, wanted in ((values.mean(axis=1), oracle.posterior_mean), (values.std(axis=1), oracle.posterior_sd)):
        spread = np.maximum(
            np.std(seen, axis=0, ddof=1) / np.sqrt(len(results)), oracle.posterior_sd / np.sqrt(effective_draws)
        )
        assert np.all(np.abs(seen.mean(axis=0) - wanted) < 4.0 * spread), (seen.mean(axis=0), wanted, spread)


@pytest.mark.parametrize("oracle", FAST, ids=lambda oracle: oracle.name)
def test_default_agrees_with_closed_forms(oracle: EvidenceOracle) -> None:
    require_agreement(oracle, runs(oracle, 3, 500), largest_sd=0.5)


def test_default_follows_a_curved_ridge() -> None:
    require_agreement(product_ridge(sd=0.02), runs(product_ridge(sd=0.02), 2, 500), largest_sd=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("oracle", FAST + SLOW, ids=lambda oracle: oracle.name)
def test_default_agrees_with_closed_forms_at_2000_particles(oracle: EvidenceOracle) -> None:
    require_agreement(oracle, runs(oracle, 20, 2000), largest_sd=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("prior", ["normal", "uniform"])
@pytest.mark.parametrize("n_dim", [5, 12, 20])
def test_long_records(n_dim: int, prior: str) -> None:
    oracle = linear_gaussian(n_dim, prior=prior)
    require_agreement(oracle, runs(oracle, 10, 2000), largest_sd=0.2)


@pytest.mark.slow
@pytest.mark.parametrize(
    "oracle", [linear_gaussian(5), two_gaussians(2), exponential()], ids=lambda oracle: oracle.name
)
def test_reported_standard_error_is_the_spread_of_runs(oracle: EvidenceOracle) -> None:
    results = runs(oracle, 60, 1000)
    spread = np.std([result.log_evidence for result in results], ddof=1)
    reported = np.mean([result.log_evidence_se for result in results])
    # Sixty runs know their own sd to 9 %.
    assert 1.0 / 1.5 < reported / spread < 1.5, (reported, spread)


def test_reported_standard_error_fast() -> None:
    oracle = gaussian_in_box(np.array([0.4, 0.6]), np.array([0.01, 0.02]))
    results = runs(oracle, 16, 300)
    spread = np.std([result.log_evidence for result in results], ddof=1)
    reported = np.mean([result.log_evidence_se for result in results])
    # Sixteen runs know their own sd to 18 %.
    assert 1.0 / 1.5 < reported / spread < 1.5, (reported, spread)


@pytest.mark.parametrize("n_dim", [2, 5])
def test_plain_tells_what_its_particles_are_worth(n_dim: int) -> None:
    """The last weights alone told 1,740 and 1,440 of 2,000 where means scatter like those of 170 and 26 draws.

    The standard error of their number is a quarter for 16 runs of two parameters; coordinates differ by half.
    """
    oracle = linear_gaussian(n_dim, n_data=9000 if n_dim == 2 else 200)
    results = [sample(oracle, rng_seed=seed, variant="plain") for seed in range(16)]
    assert oracle.posterior_mean is not None
    means = np.array([np.mean(oracle.values(result.particles), axis=0) for result in results])
    seen = 1.0 / np.mean(np.square((means - oracle.posterior_mean) / oracle.posterior_sd))
    told = np.median([result.stages[-1].effective_sample_size for result in results])
    assert 0.5 < told / seen < 2.0, (told, seen)


def test_plain_gets_a_small_problem_roughly_right() -> None:
    """The published variant keeps its published bias: only the order of magnitude is asked for."""
    oracle = gaussian_in_box(np.array([0.5, 0.5]), np.array([0.1, 0.1]))
    results = [sample(oracle, rng_seed=seed, variant="plain") for seed in range(5)]
    assert abs(np.mean([result.log_evidence for result in results]) - oracle.log_evidence) < 0.5
