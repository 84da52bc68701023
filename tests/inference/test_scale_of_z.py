"""The posterior along the scale that A shares: identities of the prior, and what keeps the scale fixed.

What no data can change must come back as it was: prior draws carried to the section and spread again are prior draws,
and the section's prior is normalised. Three storeys are in test_slow_statistics.py.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from inference_cases import A_RANGE, posterior_of, recorded, require_posterior_of_a, sdof_model, with_free_a
from scipy import special, stats

from bwbn_bayes import (
    BoucWen,
    FolientePinching,
    LogNormal,
    Normal,
    PerStorey,
    Record,
    ShearBuilding,
    SlipLock,
    StrengthDegradation,
    Uniform,
    identify,
    simulate,
)
from bwbn_bayes.inference.importance import WeightedDraws
from bwbn_bayes.inference.likelihood import Posterior, SampledNoise
from bwbn_bayes.inference.scale_of_z import Section, section_of
from bwbn_bayes.inference.settings import Settings
from bwbn_bayes.parameters import Floats, HalfNormal, Prior, Value
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.results import Result

FREE: dict[str, Value] = {
    "k": PerStorey(Uniform(5, 60)), "c": 0.05, "alpha": Uniform(0.001, 0.1), "A": Uniform(0.5, 2),
    "beta": Uniform(0.1, 8), "gamma": Uniform(-4, 8), "n": Uniform(1, 4),
}  # fmt: skip


def two_storeys(**changed: Value) -> ShearBuilding:
    return ShearBuilding(masses=[1.0, 1.0], storey=BoucWen(**(FREE | changed)))


@cache
def record_of_two_storeys() -> Record:
    """Two seconds; the tests that use it ask nothing of its truth."""
    known = {"c": 0.1, "k": 20.0, "alpha": 0.05, "beta": 2.0, "gamma": 1.0, "n": 1.5}
    model = ShearBuilding(masses=[1.0, 1.0], storey=BoucWen(**known))
    return simulate(model, el_centro("chopra", duration=2.0), {}, snr_db=30.0, seed=1)


def posterior(model: ShearBuilding) -> Posterior:
    return posterior_of(model, record_of_two_storeys())


def section(model: ShearBuilding) -> Section:
    found = section_of(posterior(model))
    assert found is not None
    return found


MODELS = {
    "two storeys": two_storeys(),
    "no springs beside z": two_storeys(alpha=0.0, k=Uniform(5, 60)),
    "priors without bounds": two_storeys(k=PerStorey(LogNormal(20.0, 0.4)), beta=HalfNormal(2.0), A=LogNormal(1, 0.3)),
    "narrow priors": two_storeys(k=Normal(40, 0.4), beta=LogNormal(2, 0.2)),
    "slip at one storey": two_storeys().with_effect(
        SlipLock(delta_s=Uniform(0, 0.03), sigma=Uniform(0.001, 0.02)), storeys=[2]
    ),
    "an A for each storey": two_storeys(
        **{name: PerStorey(FREE[name]) for name in ("A", "alpha", "beta", "gamma")}  # type: ignore[arg-type]
    ),
}


@pytest.mark.parametrize("name", MODELS)
def test_prior_draws_come_back_as_prior_draws(name: str) -> None:
    """Kolmogorov and Smirnov's test of every parameter, and of the product of A with each other one."""
    rng = np.random.default_rng(5)
    own = section(MODELS[name])
    drawn = own.full.sample_prior(rng, 6000)
    at_section = own.to_section(drawn)
    assert np.all(np.isfinite(own.log_prior(at_section)))
    again = own.spread(at_section, rng)
    assert np.all((again >= 0.0) & (again <= 1.0))
    a = own.orbits[0].a
    assert np.max(np.abs(again - drawn)) > 0.5
    fresh = own.full.sample_prior(rng, 6000)
    worst = [
        stats.ks_2samp(f(again), f(fresh)).pvalue
        for column in range(own.full.n_dim)
        for f in (lambda x, c=column: x[:, c], lambda x, c=column: x[:, a] * x[:, c])
    ]
    assert min(worst) > 1e-4 / len(worst)


@pytest.mark.parametrize("name", MODELS)
def test_the_prior_of_the_section_is_normalised(name: str) -> None:
    """Its integral, by draws from a Student-t fitted to prior draws in logits."""
    rng = np.random.default_rng(6)
    own = section(MODELS[name])
    logits = special.logit(own.to_section(own.full.sample_prior(rng, 20_000)))
    cover = stats.multivariate_t(np.mean(logits, axis=0), 2.0 * np.cov(logits.T), df=4, seed=rng)
    drawn = cover.rvs(100_000)
    points = special.expit(drawn)
    log_ratio = (
        own.log_prior(points)
        + np.sum(special.log_expit(drawn) + special.log_expit(-drawn), axis=1)
        - cover.logpdf(drawn)
    )
    ratio = np.exp(log_ratio)
    error = np.std(ratio) / np.sqrt(len(ratio))
    assert error < 0.02
    assert abs(np.mean(ratio) - 1.0) < 4.0 * error


@pytest.mark.parametrize("name", MODELS)
def test_the_integral_along_the_orbit_is_exact(name: str) -> None:
    """Against the trapezium rule with 200,000 cells.

    Twenty-four fixed nodes stepped over priors a hundredth as wide as the orbit: the log marginal was off by up to
    14 nats for ``Normal(40, 0.4)`` on k, the evidence by 6, and no check saw it.
    """
    own = section(MODELS[name])
    values = own._values(own.to_section(own.full.sample_prior(np.random.default_rng(4), 20)))
    for orbit in own.orbits:
        found = orbit.log_marginal(values)
        low, high = orbit.span(values)
        share = (np.arange(200_000) + 0.5) / 200_000
        for i in range(len(values)):
            density = orbit.log_density(values[i : i + 1], low[i] + (high[i] - low[i]) * share[None])[0]
            assert found[i] == pytest.approx(special.logsumexp(density) + np.log((high[i] - low[i]) / 2e5), abs=1e-5)


def test_a_narrow_prior_on_k_comes_back_as_its_posterior() -> None:
    """No record can tell k from A: where k's prior is narrow and A's wide, k's posterior is its prior.

    Its sd came out as 0.411 for 0.400, and log evidence as 3227.3 for 3233.5: what the nodes of the integral missed.
    """
    own, wide = sdof_model(), Normal(40.0, 4.0)
    priors = (Normal(40.0, 0.4), wide)
    record = recorded(1)
    results = [
        identify(
            own.with_values({"A": Uniform(0.5, 2), "k": prior}),
            record,
            settings=Settings(particles=2000, seed=3),
        )
        for prior in priors
    ]
    k = results[0].tree["posterior"]["k"].values.ravel()
    n = len(k)
    assert abs(np.mean(k) - 40.0) < 4.0 * 0.4 / np.sqrt(n) + 0.02
    assert abs(np.std(k) - 0.4) < 4.0 * 0.4 / np.sqrt(2 * n)
    evidence = [result.facts.log_evidence for result in results]
    assert evidence[0] - evidence[1] == pytest.approx(_shift_of_evidence(results[1], priors), abs=0.1)


def _shift_of_evidence(under: Result, priors: tuple[Prior, Prior]) -> float:
    """What another prior on k adds to the log evidence: the mean of their ratio over the posterior draws."""
    k = under.tree["posterior"]["k"].values.ravel()
    ratio = np.exp(priors[0].log_density(k) - priors[1].log_density(k))
    return float(np.log(np.mean(ratio)))


@pytest.mark.parametrize("name", MODELS)
def test_the_likelihood_is_the_same_along_the_orbit(name: str) -> None:
    rng = np.random.default_rng(7)
    own = section(MODELS[name])
    drawn = own.full.sample_prior(rng, 8)
    at_section = own.to_section(drawn)
    expected = own.full.log_likelihood(drawn)
    np.testing.assert_allclose(own.log_likelihood(at_section), expected, rtol=1e-6)
    np.testing.assert_allclose(own.full.log_likelihood(own.spread(at_section, rng)), expected, rtol=1e-6)


def test_sampled_noise_stays_beside_the_scale() -> None:
    free = posterior(two_storeys())
    channels = tuple(free.record.channels)
    noise = SampledNoise(channels=channels, priors=(HalfNormal(0.1), HalfNormal(0.2)))
    own = section_of(replace(free, noise=noise))
    assert own is not None
    rng = np.random.default_rng(8)
    drawn = own.full.sample_prior(rng, 50)
    again = own.spread(own.to_section(drawn), rng)
    np.testing.assert_allclose(again[:, -2:], drawn[:, -2:], atol=1e-12)


@pytest.mark.parametrize(
    "model",
    [
        two_storeys(A=1.0),
        two_storeys(beta=2.0),
        two_storeys(alpha=0.05),
        two_storeys(k=PerStorey([Uniform(5, 60), 20.0])),
        two_storeys(alpha=Uniform(-0.1, 0.1)),
        two_storeys(A=PerStorey([Uniform(0.5, 2), 1.0])),
        two_storeys(A=PerStorey(Uniform(0.5, 2))),
        two_storeys().with_effect(SlipLock(delta_s=Uniform(0, 0.03), sigma=0.01)),
        two_storeys().with_effect(
            FolientePinching(zeta_s=Uniform(0, 1), p=1.0, q=0.1, psi_0=0.1, delta_psi=0.1, lambda_=0.2)
        ),
    ],
)
def test_what_is_known_fixes_the_scale(model: ShearBuilding) -> None:
    assert section_of(posterior(model)) is None


def test_known_zeros_do_not_fix_the_scale() -> None:
    model = two_storeys(gamma=0.0, alpha=0.0).with_effect(StrengthDegradation(delta_nu=0.01))
    assert section_of(posterior(model)) is not None


@pytest.mark.parametrize("method", ["importance", pytest.param("tmcmc", marks=pytest.mark.slow)])
def test_the_posterior_of_a_and_the_evidence_are_exact(
    method: str, record: Record, marginal: tuple[Floats, Floats], at_one: WeightedDraws
) -> None:
    """The mean Jacobian of the orbit, and the ratio of Savage and Dickey at A = 1: see test_nested_laplace.py.

    Of transitional MCMC within the error that it tells: twelve seeds scatter by 0.14 nats, 0.11 is told.
    """
    settings = Settings(method=method, particles=2000, seed=3)  # type: ignore[arg-type]
    facts = (result := identify(with_free_a(sdof_model()), record, settings=settings)).facts
    assert facts.method == method
    assert any("scale of" in sentence or "scale that" in sentence for sentence in facts.assumptions)
    a = result.tree["posterior"]["A"].values.ravel()
    require_posterior_of_a(a, np.full(len(a), 1.0 / len(a)), facts.effective_sample_size, marginal)
    grid, density = marginal
    ratio = 1.0 / (A_RANGE[1] - A_RANGE[0]) / np.interp(1.0, grid, density)
    assert facts.log_evidence_se < 0.15
    within = max(0.1, 4.0 * facts.log_evidence_se)
    assert facts.log_evidence - at_one.log_evidence == pytest.approx(np.log(ratio), abs=within)
