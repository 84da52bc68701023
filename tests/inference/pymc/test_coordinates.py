"""Coordinates in which the posterior is nearly normal: the same posterior, and rounder than its own linear map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from inference_cases import climbed, posterior_of, recorded, sdof_model, true_point
from pymc_cases import ENGINE, small_mode, small_model, small_posterior, small_record
from scipy.special import logsumexp

from bwbn_bayes.inference.importance import laplace_mixture, sample_importance
from bwbn_bayes.inference.likelihood import Posterior, SampledNoise
from bwbn_bayes.inference.pymc.coordinates import NormalCoordinates
from bwbn_bayes.parameters import Floats, HalfNormal, LogNormal

_STEP = 1e-4


def with_sampled_noise() -> Posterior:
    """Two channels, the noise of each with a prior of its own kind."""
    record = small_record()
    drift = 0.01 * np.random.default_rng(1).standard_normal(record.n_times)
    two = record.with_channels(record.channels | {"drift_1": drift})
    noise = SampledNoise(channels=tuple(two.channels), priors=(HalfNormal(0.2), LogNormal(0.1, 0.5)))
    return Posterior(model=small_model(), record=two, engine=ENGINE, noise=noise)


def short_sdof() -> Posterior:
    """Eight parameters over five seconds."""
    return posterior_of(sdof_model(), recorded(1)).until(5.0)


def log_weights(coordinates: NormalCoordinates, x: Floats) -> Floats:
    """Of draws of the standard normal for the posterior, by the log density of the coordinates."""
    return coordinates.log_density(x)[0] + 0.5 * np.sum(np.square(x), axis=1) + 0.5 * x.shape[1] * np.log(2.0 * np.pi)


def effective_share(weights: Floats) -> float:
    """Effective draws for each draw."""
    return float(np.exp(2.0 * logsumexp(weights) - logsumexp(2.0 * weights)) / len(weights))


@pytest.mark.parametrize("posterior", [small_posterior(), with_sampled_noise()], ids=["integrated", "sampled noise"])
def test_the_density_is_that_of_the_posterior_and_the_map(posterior: Posterior) -> None:
    """Against the likelihood on the unit cube and the determinant of the map by differences.

    Steps that are not cut where a drift rate changes sign: the likelihood has no ripples from the cuts.
    """
    posterior = posterior.with_engine(replace(ENGINE, cut_at_turns=False))
    start = np.full(posterior.n_dim, 0.4)
    start[:3] = small_mode(small_posterior()).point
    coordinates = NormalCoordinates.at(posterior, start)
    x = np.random.default_rng(1).standard_normal(posterior.n_dim)
    sides = [coordinates.points(x + side * _STEP * np.eye(posterior.n_dim)) for side in (1.0, -1.0)]
    log_volume = np.linalg.slogdet((sides[0] - sides[1]) / (2.0 * _STEP)).logabsdet
    point = coordinates.points(x[None])
    (value,), (gradient,) = coordinates.log_density(x[None])
    assert value == pytest.approx(posterior.log_likelihood(point)[0] + log_volume, abs=1e-4)
    forth, back = (coordinates.log_density(x + side * _STEP * np.eye(len(x)))[0] for side in (1.0, -1.0))
    np.testing.assert_allclose(gradient, (forth - back) / (2.0 * _STEP), rtol=1e-3, atol=1e-3)


def test_the_bends_of_the_sdof_case_are_taken_out() -> None:
    """On ten seconds of it beta and n bend stiff directions: by a linear map NUTS had 57 effective draws of 500."""
    model, record = sdof_model(), recorded(1)
    posterior = posterior_of(model, record).until(10.0)
    bent = NormalCoordinates.at(posterior, climbed(posterior, true_point(model, record)).point)
    straight = replace(bent, bend=np.zeros_like(bent.bend))
    x = np.random.default_rng(2).standard_normal((400, posterior.n_dim))
    bent_weights = log_weights(bent, x)
    assert effective_share(bent_weights) > 0.7
    assert np.var(bent_weights) < 0.3 * np.var(log_weights(straight, x))


def test_its_normalisation_is_the_evidence() -> None:
    """Draws of the standard normal, weighed, beside importance sampling on the unit cube."""
    posterior = small_posterior()
    mode = small_mode(posterior)
    weights = log_weights(
        NormalCoordinates.at(posterior, mode.point), np.random.default_rng(3).standard_normal((400, 3))
    )
    expected = sample_importance(posterior, laplace_mixture([mode]), np.random.default_rng(4), effective=2000)
    found = logsumexp(weights) - np.log(len(weights))
    error = np.hypot(expected.log_evidence_se, np.std(np.exp(weights - found)) / np.sqrt(len(weights)))
    assert abs(found - expected.log_evidence) < 4.0 * error


def test_what_cannot_be_solved_has_no_density() -> None:
    posterior = small_posterior()
    coordinates = NormalCoordinates.at(posterior, small_mode(posterior).point)
    x = np.zeros((3, posterior.n_dim))
    x[1] = np.nan
    value, gradient = coordinates.log_density(x)
    assert value[1] == -np.inf
    assert not np.any(gradient[1])
    (alone,), (slope,) = coordinates.log_density(x[:1])
    assert np.isfinite(alone)
    np.testing.assert_array_equal(value[::2], [alone, alone])
    np.testing.assert_array_equal(gradient[::2], [slope, slope])
    nowhere, _ = coordinates.log_density(x[1:2])
    assert nowhere[0] == -np.inf


@pytest.mark.parametrize("case", ["integrated", "sampled noise", "sdof"])
def test_points_do_not_depend_on_those_beside_them(case: str) -> None:
    """To the last bit, else a chain's draws would depend on how many others run."""
    posterior = {"integrated": small_posterior, "sampled noise": with_sampled_noise, "sdof": short_sdof}[case]()
    coordinates = NormalCoordinates.at(posterior, np.full(posterior.n_dim, 0.4))
    x = np.random.default_rng(5).standard_normal((17, posterior.n_dim))
    singly = [coordinates.log_density(one[None]) for one in x]
    for n in (2, 3, 4, 7, 16):
        value, gradient = coordinates.log_density(x[:n])
        np.testing.assert_array_equal(value, [one[0][0] for one in singly[:n]])
        np.testing.assert_array_equal(gradient, [one[1][0] for one in singly[:n]])
    # More than there are lanes are summed by other code.
    np.testing.assert_allclose(coordinates.log_density(x)[0], [one[0][0] for one in singly], rtol=1e-10)
