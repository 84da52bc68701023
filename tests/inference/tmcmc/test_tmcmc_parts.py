"""Tempering, resampling, coordinates, mixtures, checkpoints and the mistakes a user can make."""

from dataclasses import replace

import numpy as np
import pytest
from evidence_oracles import Floats, gaussian_in_box, linear_gaussian

from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.tmcmc import sample
from bwbn_bayes.inference.tmcmc.coordinates import UNBOUNDED, Coordinates, to_probit
from bwbn_bayes.inference.tmcmc.mixture import fit_mixture
from bwbn_bayes.inference.tmcmc.resampling import multinomial, systematic
from bwbn_bayes.inference.tmcmc.stages import Streams, _shapes
from bwbn_bayes.inference.tmcmc.tempering import (
    coefficient_of_variation,
    family_excess,
    independent_draws,
    integrated_autocorrelation_time,
    log_mean_variance,
    next_tempering_parameter,
)
from bwbn_bayes.results import StageFacts

ORACLE = gaussian_in_box(np.array([0.3, 0.6]), np.array([0.02, 0.05]))


@pytest.mark.parametrize("scale", [1.0, 1e5, 1e12, 1e30])
def test_the_step_has_no_floor(scale: float) -> None:
    """A floor of 1e-6 on the step once cost an evidence thousands of nats."""
    log_ratio = -scale * np.random.default_rng(1).chisquare(5, 2000)
    step = next_tempering_parameter(log_ratio, 0.0, 1.0)
    assert coefficient_of_variation(step * log_ratio) == pytest.approx(1.0, rel=1e-9)


def test_failed_solves_do_not_stall_the_step() -> None:
    log_ratio = -np.random.default_rng(1).chisquare(5, 2000)
    log_ratio[:1900] = -np.inf
    assert next_tempering_parameter(log_ratio, 0.0, 0.5) > 0.1


def test_systematic_keeps_every_share_to_one_draw() -> None:
    weights = np.random.default_rng(2).dirichlet(np.ones(50))
    counts = np.bincount(systematic(weights, 1000, np.random.default_rng(3)), minlength=50)
    assert np.all(np.abs(np.cumsum(counts) - 1000 * np.cumsum(weights)) <= 1.0 + 1e-9)


@pytest.mark.parametrize("scheme", [multinomial, systematic])
def test_resampling_is_unbiased_and_avoids_zero_weights(scheme) -> None:  # type: ignore[no-untyped-def]
    weights = np.array([0.0, 0.1, 0.0, 0.6, 0.3, 0.0])
    rng = np.random.default_rng(4)
    counts = np.array([np.bincount(scheme(weights, 10, rng), minlength=6) for _ in range(4000)])
    assert np.all(counts[:, weights == 0.0] == 0)
    assert np.all(np.abs(counts.mean(axis=0) - 10 * weights) <= 4.0 * counts.std(axis=0) / np.sqrt(4000))


def test_coordinates_are_inverse_and_their_jacobian_is_right() -> None:
    rng = np.random.default_rng(5)
    points = rng.beta(0.5, 2.0, (500, 3))
    coordinates = Coordinates.straightening(to_probit(points))
    mapped, _ = coordinates.forward(to_probit(points))
    back, log_volume = coordinates.inverse(mapped)
    np.testing.assert_allclose(back, points, rtol=1e-9)
    step = 1e-6
    slopes = np.ones(len(points))
    for axis in np.eye(3):
        ahead, behind = coordinates.inverse(mapped + step * axis)[0], coordinates.inverse(mapped - step * axis)[0]
        slopes *= ((ahead - behind) @ axis) / (2.0 * step)
    np.testing.assert_allclose(log_volume, np.log(slopes), atol=1e-4)


def test_mixture_finds_two_clumps_and_keeps_to_one() -> None:
    rng = np.random.default_rng(6)
    one = rng.standard_normal((800, 3))
    two = one * 0.2 + np.where(rng.random((800, 1)) < 0.3, 3.0, -3.0)
    even = np.full(800, 1.0 / 800)
    assert len(fit_mixture(one, even, 800.0).weights) == 1
    fit = fit_mixture(two, even, 800.0)
    assert len(fit.weights) == 2
    assert fit.weights.min() == pytest.approx(0.3, abs=4 * np.sqrt(0.21 / 800))


def test_variance_of_the_mean_weight_counts_families() -> None:
    """Twenty copies of each of 50 weights are worth 50 weights."""
    log_weights = np.random.default_rng(7).normal(0.0, 0.5, 50)
    weights = np.exp(log_weights)
    expected = np.var(weights, ddof=1) / 50 / np.mean(weights) ** 2
    excess = family_excess(np.tile(log_weights, 20), np.tile(np.arange(50), 20))
    assert log_mean_variance(excess, np.arange(50), np.zeros(50)) == pytest.approx(expected)


def test_variance_of_the_log_evidence_counts_what_chains_inherit() -> None:
    """Of errors that keep a quarter from stage to stage, the sum has 1 / (1 - 1/4)^2 of the variance of fresh ones.

    One stage back tells (1 + 1/4)^2 of it. Each stage has 200 chains, begun in those before.
    """
    rng = np.random.default_rng(9)
    n, kept, n_stages, told, error = 200, 0.25, 400, 0.0, rng.standard_normal(200)
    parents, inherited = np.arange(n), np.zeros(n)
    for _ in range(n_stages):
        excess = (error - np.mean(error)) / n
        told += log_mean_variance(excess, parents, inherited)
        parents = rng.integers(n, size=n)
        inherited = excess[parents]
        error = kept * error[parents] + np.sqrt(1.0 - kept**2) * rng.standard_normal(n)
    assert told == pytest.approx(n_stages / n * (1.0 + kept) ** 2, rel=0.1)


def test_copies_are_no_independent_draws() -> None:
    """Twenty copies of each of 50 points, which the weights of a stage do not tell from 1,000 points."""
    points, labels = np.random.default_rng(10).standard_normal((50, 3)), np.tile(np.arange(50), 20)
    assert independent_draws(np.tile(points, (20, 1)), labels[None]) == pytest.approx(49.0)
    assert independent_draws(np.ones((1000, 3)), labels[None]) == 1.0


def test_draws_are_as_many_as_the_generation_tells_that_leaves_fewest() -> None:
    """4,000 families of 5 families of 5 points, which have half of their squares from the older ones."""
    rng = np.random.default_rng(11)
    young = np.arange(100_000) // 5
    old = young // 5
    points = np.sqrt([0.5, 0.25]) @ [rng.standard_normal(len(own) + 1)[own] for own in (old, young)]
    points += np.sqrt(0.25) * rng.standard_normal(len(points))
    expected = len(points) / (0.5 * 25 + 0.25 * 5 + 0.25)
    told = independent_draws(points[:, None], np.stack([young, old]))
    assert told == pytest.approx(expected, rel=4.0 * np.sqrt(2.0 / 4000))


def test_autocorrelation_time_of_an_autoregression() -> None:
    """The first-order autoregression with coefficient a has (1 + a) / (1 - a) = 5.67 for a = 0.7."""
    rng = np.random.default_rng(8)
    noise = rng.standard_normal((200, 4000, 1))
    traces = noise.copy()
    for step in range(1, 200):
        traces[step] = 0.7 * traces[step - 1] + np.sqrt(1.0 - 0.49) * noise[step]
    assert integrated_autocorrelation_time(traces) == pytest.approx(1.7 / 0.3, rel=0.1)


def test_seeds_differ_and_repeat() -> None:
    first, again, other = (sample(ORACLE, n_particles=300, rng_seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.particles, again.particles)
    assert not np.any(np.isin(first.particles[:, 0], other.particles[:, 0]))


def test_no_finite_likelihood_is_said_plainly() -> None:
    hopeless = replace(ORACLE, log_likelihood_of_values=lambda x: np.full(len(x), -np.inf))
    with pytest.raises(UserError, match="have a finite likelihood"):
        sample(hopeless, rng_seed=1)


def test_too_few_particles_are_refused() -> None:
    with pytest.raises(UserError, match="use at least"):
        sample(linear_gaussian(5), n_particles=20, rng_seed=1)


@pytest.mark.parametrize("failed", [-np.inf, np.nan])
def test_failed_solves_cost_their_share_of_the_evidence(failed: float) -> None:
    """Where half of the box cannot be solved the evidence is that of the other half."""
    oracle = gaussian_in_box(np.array([0.5, 0.4]), np.array([0.1, 0.1]))

    def half(x: Floats) -> Floats:
        return np.where(x[:, 0] < 0.5, failed, oracle.log_likelihood_of_values(x))

    results = [sample(replace(oracle, log_likelihood_of_values=half), n_particles=1000, rng_seed=s) for s in range(4)]
    errors = [result.log_evidence - (oracle.log_evidence + np.log(0.5)) for result in results]
    assert abs(np.mean(errors)) < 4.0 * np.mean([result.log_evidence_se for result in results]) / 2.0
    assert all(np.all(result.particles[:, 0] >= 0.5) for result in results)


def test_history_is_complete() -> None:
    seen: list[StageFacts] = []
    result = sample(ORACLE, n_particles=500, rng_seed=1, progress=seen.append)
    assert tuple(seen) == result.stages
    assert [facts.stage for facts in seen] == list(range(len(seen)))
    assert seen[0].tempering_parameter == 0.0
    assert seen[-1].tempering_parameter == 1.0
    assert np.all(np.diff([facts.tempering_parameter for facts in seen]) > 0.0)
    assert np.all(np.diff([facts.n_solves for facts in seen]) > 0)
    assert seen[-1].n_solves == result.n_solves
    assert seen[-1].log_evidence == result.log_evidence
    assert result.particles.shape == (500, 2)
    assert result.log_likelihood == pytest.approx(ORACLE.log_likelihood(result.particles))


def test_points_without_bounds_are_their_own_positions() -> None:
    positions = np.random.default_rng(6).standard_normal((500, 3)) ** 3 * [1e-3, 1.0, 1e9]
    coordinates = Coordinates.straightening(UNBOUNDED.positions(positions))
    mapped, log_slope = coordinates.forward(positions)
    back, log_volume = coordinates.inverse(mapped, UNBOUNDED)
    np.testing.assert_allclose(back / positions.std(axis=0), positions / positions.std(axis=0), atol=1e-12)
    np.testing.assert_allclose(log_volume, -log_slope, rtol=1e-9)


def test_no_chain_is_moved_by_what_was_fitted_to_it() -> None:
    """Each half of the families is moved by what the other half looks like."""
    positions, families = np.random.default_rng(7).standard_normal((400, 3)), np.arange(400) % 8
    even = families % 2 == 0

    def of(positions: Floats) -> tuple[Floats, Floats]:
        moved = _shapes(positions, np.full(400, 1.0 / 400), families, 400.0, 400, Streams(1, 1))
        return moved[0].archive, moved[1].archive

    before, after = of(positions), of(np.where(even[:, None], positions + 5.0, positions))
    np.testing.assert_array_equal(before[0], after[0])
    assert not np.any(np.isin(before[1], after[1]))


def test_a_marginal_of_one_value_has_coordinates() -> None:
    """Draws of which one alone has any weight: knots were equal, and a fit to them ended in NaN."""
    positions = np.column_stack([np.full(50, 1.7), np.linspace(-1.0, 1.0, 50)])
    coordinates = Coordinates.straightening(positions)
    mapped, log_slope = coordinates.forward(positions)
    assert np.all(np.isfinite(mapped))
    assert np.all(np.isfinite(log_slope))
    points, _ = coordinates.inverse(mapped)
    assert to_probit(points) == pytest.approx(positions, abs=1e-9)
