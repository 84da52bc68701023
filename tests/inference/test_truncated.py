"""The truncated Student-t: densities against scipy.stats and quadrature, draws against densities."""

import numpy as np
import pytest
from scipy import special, stats

from bwbn_bayes.inference.truncated import Bend, TruncatedStudent, walk
from bwbn_bayes.parameters import Floats

DEGREES = [np.inf, 5.0]
CORRELATED = np.array([[0.04, 0.03], [0.03, 0.09]])
N = 40_000


def gauss_legendre(low: float, high: float, n: int) -> tuple[Floats, Floats]:
    nodes, weights = special.roots_legendre(n)
    return 0.5 * (high - low) * nodes + 0.5 * (high + low), 0.5 * (high - low) * weights


def grid(n: int) -> tuple[Floats, Floats]:
    """Points ``(n^2, 2)`` of the unit square and their quadrature weights."""
    nodes, weights = gauss_legendre(0.0, 1.0, n)
    points = np.stack(np.meshgrid(nodes, nodes, indexing="ij"), axis=-1).reshape(-1, 2)
    return points, np.outer(weights, weights).ravel()


def one_dimensional(mean: float, sd: float, degrees: float) -> TruncatedStudent:
    return TruncatedStudent.of(np.array([mean]), np.array([[sd**2]]), degrees=degrees)


@pytest.mark.parametrize("mean", [-0.3, 0.0, 0.4, 1.2])
@pytest.mark.parametrize("degrees", DEGREES)
def test_one_dimension_is_the_truncated_law_of_scipy(mean: float, degrees: float) -> None:
    sd = 0.15
    proposal = one_dimensional(mean, sd, degrees)
    x = np.linspace(0.0, 1.0, 101)[:, None]
    law = stats.norm(mean, sd) if np.isinf(degrees) else stats.t(degrees, mean, sd)
    mass = law.cdf(1.0) - law.cdf(0.0) if mean < 0.5 else law.sf(0.0) - law.sf(1.0)
    np.testing.assert_allclose(proposal.log_density(x), law.logpdf(x[:, 0]) - np.log(mass), rtol=1e-9, atol=1e-9)
    draws = proposal.sample(np.random.default_rng(1), N)[:, 0]
    below = (law.cdf(np.sort(draws)) - law.cdf(0.0)) / mass
    assert stats.kstest(below, stats.uniform.cdf).pvalue > 1e-4


@pytest.mark.parametrize("mean", [-0.3, 0.0, 0.4, 1.2])
def test_one_dimension_has_the_truncated_moments(mean: float) -> None:
    sd = 0.15
    law = stats.truncnorm(-mean / sd, (1.0 - mean) / sd, loc=mean, scale=sd)
    draws = one_dimensional(mean, sd, np.inf).sample(np.random.default_rng(2), N)[:, 0]
    assert abs(draws.mean() - law.mean()) < 4.0 * law.std() / np.sqrt(N)
    error = np.sqrt((float(law.stats("k")) + 2.0) / N)
    assert abs(draws.var() / law.var() - 1.0) < 4.0 * error


@pytest.mark.parametrize("degrees", DEGREES)
@pytest.mark.parametrize("mean", [(0.5, 0.5), (0.05, 0.9), (-0.2, 1.1)])
def test_two_dimensions_integrate_to_one(mean: tuple[float, float], degrees: float) -> None:
    proposal = TruncatedStudent.of(np.array(mean), CORRELATED, degrees=degrees)
    points, weights = grid(120)
    assert weights @ np.exp(proposal.log_density(points)) == pytest.approx(1.0, abs=1e-7)


@pytest.mark.parametrize("degrees", DEGREES)
def test_draws_fill_cells_as_their_density_says(degrees: float) -> None:
    """Chi-square over 64 cells, each cell's probability by quadrature."""
    proposal = TruncatedStudent.of(np.array([0.1, 0.8]), CORRELATED, degrees=degrees)
    draws = proposal.sample(np.random.default_rng(3), N)
    n_cells = 8
    counts, *_ = np.histogram2d(draws[:, 0], draws[:, 1], bins=n_cells, range=[[0, 1], [0, 1]])
    nodes = [gauss_legendre(i / n_cells, (i + 1) / n_cells, 12) for i in range(n_cells)]
    x, w = np.concatenate([a for a, _ in nodes]), np.concatenate([b for _, b in nodes])
    points = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    mass = (np.outer(w, w).ravel() * np.exp(proposal.log_density(points))).reshape(n_cells, 12, n_cells, 12)
    expected = N * mass.sum(axis=(1, 3))
    kept = expected > 5.0
    statistic = np.sum((counts - expected)[kept] ** 2 / expected[kept])
    assert stats.chi2.sf(statistic, np.count_nonzero(kept) - 1) > 1e-4


def random_covariance(n_dim: int, scale: float, seed: int) -> Floats:
    root = np.random.default_rng(seed).standard_normal((n_dim, n_dim)) + np.eye(n_dim)
    covariance = root @ root.T
    sd = np.sqrt(np.diag(covariance))
    return scale**2 * covariance / np.outer(sd, sd)


def test_far_from_the_bounds_it_is_the_multivariate_law() -> None:
    """Six dimensions, the bounds fourteen (normal) or five hundred (Student-t) scales away."""
    mean = np.full(6, 0.5)
    for degrees, scale in ((np.inf, 0.03), (8.0, 0.001)):
        covariance = random_covariance(6, scale, 4)
        proposal = TruncatedStudent.of(mean, covariance, degrees=degrees)
        points = proposal.sample(np.random.default_rng(5), 200)
        if np.isinf(degrees):
            expected = stats.multivariate_normal(mean, covariance).logpdf(points)
        else:
            expected = stats.multivariate_t(mean, covariance, degrees).logpdf(points)
        np.testing.assert_allclose(proposal.log_density(points), expected, atol=1e-8)


@pytest.mark.parametrize("degrees", DEGREES)
def test_six_dimensions_integrate_to_one(degrees: float) -> None:
    """The mean of density over an independent density, under the latter, is one within 4 standard errors."""
    mean, sd = np.array([0.02, 0.5, 0.97, 0.3, 0.6, 1.05]), 0.15
    proposal = TruncatedStudent.of(mean, random_covariance(6, sd, 6), degrees=degrees)
    rng = np.random.default_rng(7)
    pilot = proposal.sample(rng, 4000)
    centre, spread = pilot.mean(axis=0), 1.6 * pilot.std(axis=0)
    simple = stats.truncnorm(-centre / spread, (1.0 - centre) / spread, loc=centre, scale=spread)
    points = simple.rvs(size=(100_000, 6), random_state=rng)
    ratio = np.exp(proposal.log_density(points) - np.sum(simple.logpdf(points), axis=1))
    standard_error = ratio.std() / np.sqrt(len(ratio))
    assert standard_error < 0.05
    assert abs(ratio.mean() - 1.0) < 4.0 * standard_error


def test_conditional_masses_average_to_the_box_probability() -> None:
    """The simulator's other use: untruncated over truncated density averages to the probability of the box."""
    mean, covariance = np.array([0.1, 0.9, 0.4]), random_covariance(3, 0.3, 8)
    proposal = TruncatedStudent.of(mean, covariance)
    points = proposal.sample(np.random.default_rng(9), N)
    law = stats.multivariate_normal(mean, covariance)
    weight = np.exp(law.logpdf(points) - proposal.log_density(points))
    box = law.cdf(np.ones(3), lower_limit=np.zeros(3))
    assert abs(weight.mean() - box) < 4.0 * weight.std() / np.sqrt(N) + 1e-5


@pytest.mark.parametrize("distance", [20.0, 60.0, 433.0])
@pytest.mark.parametrize("side", [0.0, 1.0])
def test_a_mean_far_outside_leaves_nearly_an_exponential_at_the_bound(distance: float, side: float) -> None:
    """Regression: past 38 standard deviations a floor of 1e-300 on the mass put every draw on the bound.

    Their density came out as e^-100 and less, evidences too large by as many nats, and no check noticed.
    """
    sd = 0.1
    proposal = one_dimensional(side + np.sign(side - 0.5) * distance * sd, sd, np.inf)
    rate = distance / sd
    depth, weights = gauss_legendre(0.0, 40.0 / rate, 200)
    density = np.exp(proposal.log_density(np.abs(side - depth)[:, None]))
    assert weights @ density == pytest.approx(1.0, abs=1e-6)
    # density(0) exp(-rate x - x^2 / (2 sd^2)), where Mills's ratio gives density(0) = rate (1 + 1 / distance^2 - ...).
    expected = rate * np.exp(-rate * depth - 0.5 * (depth / sd) ** 2)
    np.testing.assert_allclose(density, expected, rtol=1.1 / distance**2)
    draws = np.abs(side - proposal.sample(np.random.default_rng(10), N)[:, 0])
    mean = weights @ (depth * density)
    spread = np.sqrt(weights @ (depth**2 * density) - mean**2)
    assert abs(draws.mean() - mean) < 4.0 * spread / np.sqrt(N)
    # An exponential's excess kurtosis is 6, so its sd from N draws has a relative standard error of sqrt(8 / N) / 2.
    assert abs(draws.std() / spread - 1.0) < 4.0 * np.sqrt(2.0 / N)


@pytest.mark.parametrize("degrees", [np.inf, 8.0])
def test_a_corner_far_from_the_mean_stays_finite(degrees: float) -> None:
    mean = np.array([-3.0, 0.5, 4.0])
    proposal = TruncatedStudent.of(mean, random_covariance(3, 0.15, 11), degrees=degrees)
    draws = proposal.sample(np.random.default_rng(12), 1000)
    assert np.all((draws >= 0.0) & (draws <= 1.0))
    assert np.all(np.isfinite(proposal.log_density(draws)))


def test_density_is_zero_outside_the_cube() -> None:
    proposal = TruncatedStudent.of(np.array([0.5, 0.5]), CORRELATED)
    outside = np.array([[-1e-9, 0.5], [0.5, 1.0 + 1e-9], [2.0, -3.0]])
    assert np.all(proposal.log_density(outside) == -np.inf)


def test_coordinates_nearest_to_a_bound_come_first() -> None:
    mean = np.array([0.5, 0.9, 0.02])
    proposal = TruncatedStudent.of(mean, np.diag([0.1, 0.1, 0.1]) ** 2)
    np.testing.assert_array_equal(proposal.order, [2, 1, 0])
    np.testing.assert_array_equal(proposal.mean, mean[[2, 1, 0]])


def test_expansion_is_a_newton_step_no_wider_than_the_prior() -> None:
    information = np.diag([400.0, 1.0])
    proposal = TruncatedStudent.at(np.array([0.5, 0.4]), np.array([20.0, 1.2]), information, inflation=2.0)
    np.testing.assert_allclose(proposal.mean[np.argsort(proposal.order)], [0.55, 0.5])
    covariance = proposal.factor @ proposal.factor.T
    np.testing.assert_allclose(np.diag(covariance)[np.argsort(proposal.order)], [2.0 / 400.0, 2.0 / 12.0])


BEND = Bend(n_wide=1, coefficients=np.array([[0.0, 2.0], [0.0, -0.3]]))


def test_a_bent_density_integrates_to_one() -> None:
    mean, factor = np.array([0.3, 0.4]), np.array([[0.2, 0.0], [0.05, 0.06]])
    points, weights = grid(160)
    _, log_density = walk(mean, factor, np.inf, points=points, bend=BEND)
    assert weights @ np.exp(log_density) == pytest.approx(1.0, abs=1e-6)


def test_a_bend_moves_the_later_mean_by_its_polynomial() -> None:
    mean, factor = np.array([0.3, 0.4]), np.array([[0.1, 0.0], [0.0, 1e-4]])
    draws, _ = walk(mean, factor, np.inf, uniforms=np.random.default_rng(13).random((500, 2)), bend=BEND)
    deviation = draws[:, 0] - 0.3
    np.testing.assert_allclose(draws[:, 1], 0.4 + 2.0 * deviation**2 - 0.3 * deviation, atol=6e-4)


@pytest.mark.parametrize("degrees", DEGREES)
@pytest.mark.parametrize("bend", [None, BEND])
def test_drawing_and_evaluating_agree(degrees: float, bend: Bend | None) -> None:
    """The density given with a draw is the density found at it, one location and factor per draw included."""
    rng = np.random.default_rng(14)
    mean = rng.uniform(-0.1, 1.1, (300, 2))
    factor = np.tile(np.array([[0.2, 0.0], [0.1, 0.1]]), (300, 1, 1)) * rng.uniform(0.5, 2.0, (300, 1, 1))
    points, drawn = walk(mean, factor, degrees, uniforms=rng.random((300, 2)), bend=bend)
    _, found = walk(mean, factor, degrees, points=points, bend=bend)
    np.testing.assert_allclose(drawn, found, rtol=1e-7, atol=1e-7)


def test_walk_needs_something_to_visit() -> None:
    with pytest.raises(ValueError, match="points or uniforms"):
        walk(np.zeros(1), np.eye(1), np.inf)
