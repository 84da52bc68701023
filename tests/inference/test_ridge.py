"""The ridge that one redundant scale leaves: its proposal, its exact marginal, and the evidence that goes with it.

With A free, z and A scale by a factor lambda, and nothing that is measured changes if at the same time

    k' = alpha k + (1 - alpha) k / lambda,    alpha' = alpha k / k',
    beta' = lambda^(1 - n) beta,    gamma' = lambda^(1 - n) gamma,    (sigma' = lambda sigma)

(Ma et al., J. Appl. Mech. 71(3), 2004). So the likelihood is a function of the parameters carried to A = 1, and where
no bound binds but A's own the marginal posterior of A is the mean, over the posterior at A = 1, of the Jacobian
determinant of the map at lambda = A. By hand it is ``k / (lambda k') lambda^(2 (1 - n))`` with one storey: about
lambda^(-0.4) at n = 1.2. Three storeys have three k for one alpha, and slip has sigma: there it is about lambda^-2.
"""

from itertools import pairwise

import numpy as np
import pytest
from inference_cases import A_RANGE, SDOF
from scipy import integrate

from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.inference.importance import Mixture, WeightedDraws, laplace_mixture, sample_importance
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.ridge import RidgeProposal, ridge_coordinate
from bwbn_bayes.inference.truncated import Bend, TruncatedStudent
from bwbn_bayes.parameters import Floats

MOVED = ("k", "alpha", "beta", "gamma")


def carried(values: Floats, names: tuple[str, ...], scale: float) -> Floats:
    """Parameters ``(n, d)`` carried along the orbit by ``scale``; A, where it is identified, is multiplied by it."""
    column = {name: i for i, name in enumerate(names)}
    result = values.copy()
    k, alpha, n = (values[:, column[name]] for name in ("k", "alpha", "n"))
    result[:, column["k"]] = alpha * k + (1.0 - alpha) * k / scale
    result[:, column["alpha"]] = alpha * k / result[:, column["k"]]
    for name in ("beta", "gamma"):
        result[:, column[name]] = scale ** (1.0 - n) * values[:, column[name]]
    if "A" in column:
        result[:, column["A"]] *= scale
    return result


def jacobian_determinant(values: Floats, names: tuple[str, ...], scale: float) -> Floats:
    """Of the orbit map at A = 1 in the parameters that it moves, by central differences, ``(n,)``."""
    moved = [names.index(name) for name in MOVED]
    matrix = np.empty((len(values), len(moved), len(moved)))
    for j, i in enumerate(moved):
        step = np.zeros(values.shape[1])
        step[i] = 1e-6 * np.mean(np.abs(values[:, i]))
        ahead, behind = (carried(values + side * step, names, scale) for side in (1.0, -1.0))
        matrix[:, :, j] = (ahead - behind)[:, moved] / (2.0 * step[i])
    return np.abs(np.linalg.det(matrix))


@pytest.fixture(scope="module")
def at_one(posterior: Posterior, mode: Mode) -> WeightedDraws:
    """The posterior with A known."""
    return sample_importance(posterior, laplace_mixture([mode]), np.random.default_rng(1), effective=2000)


@pytest.fixture(scope="module")
def along_a(free_posterior: Posterior) -> int:
    return free_posterior.space.names.index("A")


@pytest.fixture(scope="module")
def ridge(free_posterior: Posterior, free_mode: Mode, along_a: int) -> RidgeProposal:
    return RidgeProposal.along(free_posterior, free_mode, along_a)


@pytest.fixture(scope="module")
def free_draws(free_posterior: Posterior, free_mode: Mode, ridge: RidgeProposal) -> WeightedDraws:
    tails = TruncatedStudent.at(free_mode.point, free_mode.gradient, free_mode.information, inflation=1.6, degrees=8.0)
    proposal = Mixture(weights=(0.85, 0.15), components=(ridge, tails))
    return sample_importance(free_posterior, proposal, np.random.default_rng(2), effective=3000)


@pytest.fixture(scope="module")
def marginal(posterior: Posterior, at_one: WeightedDraws) -> tuple[Floats, Floats]:
    """Exact posterior density of A on a grid: the mean Jacobian, normalised on the prior's range."""
    grid = np.linspace(*A_RANGE, 141)
    values = posterior.space.from_unit(at_one.points)
    weights = np.exp(at_one.log_weights)
    density = np.array([weights @ jacobian_determinant(values, posterior.space.names, scale) for scale in grid])
    return grid, density / integrate.simpson(density, grid)


@pytest.mark.parametrize("scale", [0.75, 1.3])
def test_the_orbit_leaves_the_response_alone(free_posterior: Posterior, scale: float) -> None:
    """By the reference engine, to rounding and solver accuracy."""
    names = free_posterior.space.names
    values = np.array([[{**SDOF.truth, "A": 1.0}[name] for name in names]])
    both = np.concatenate([values, carried(values, names, scale)])
    first, second = Reference().simulate(free_posterior.model, both, free_posterior.record.until(6.0)).values[:, 0]
    assert np.sqrt(np.mean((first - second) ** 2) / np.mean(first**2)) < 1e-8


def test_the_jacobian_by_hand(posterior: Posterior, at_one: WeightedDraws) -> None:
    values, names = posterior.space.from_unit(at_one.points[:20]), posterior.space.names
    for scale in (0.7, 1.0, 1.4):
        k, n = values[:, names.index("k")], values[:, names.index("n")]
        moved = carried(values, names, scale)[:, names.index("k")]
        expected = k / (scale * moved) * scale ** (2.0 * (1.0 - n))
        np.testing.assert_allclose(jacobian_determinant(values, names, scale), expected, rtol=1e-6)


def test_the_redundant_direction_is_recognised(free_mode: Mode, free_posterior: Posterior) -> None:
    assert free_posterior.space.names[ridge_coordinate(free_mode)] in {"A", "k"}


def test_the_ridge_runs_along_the_orbit(free_posterior: Posterior, free_mode: Mode, ridge: RidgeProposal) -> None:
    """At every node the mean of the rest is the mode carried to that A, within two tenths of a conditional sd."""
    names = free_posterior.space.names
    start = free_posterior.space.from_unit(free_mode.point[None])
    nodes = np.tile(free_mode.point, (len(ridge.nodes), 1))
    nodes[:, ridge.coordinate] = ridge.nodes
    targets = free_posterior.space.from_unit(nodes)[:, ridge.coordinate]
    expected = [carried(start, names, a / start[0, ridge.coordinate])[0] for a in targets]
    wanted = free_posterior.space.to_unit(np.array(expected))[:, ridge.order]
    factor = np.zeros((len(ridge.nodes), len(ridge.order), len(ridge.order)))
    factor[:, *np.tril_indices(len(ridge.order))] = ridge.factors
    distance = np.linalg.solve(factor, (ridge.means - wanted)[:, :, None])[:, :, 0]
    assert ridge.nodes[0] < 0.01
    assert ridge.nodes[-1] > 0.99
    assert np.max(np.sqrt(np.sum(distance**2, axis=1))) < 0.5


def test_transport_sample_and_density_agree(ridge: RidgeProposal) -> None:
    n_dim = len(ridge.order) + 1
    points, log_density = ridge.transport(np.random.default_rng(3).random((2000, n_dim)))
    np.testing.assert_allclose(ridge.log_density(points), log_density, atol=1e-5)
    np.testing.assert_array_equal(ridge.sample(np.random.default_rng(3), 2000), points)
    assert np.all((points >= 0.0) & (points <= 1.0))
    outside = points[:2].copy()
    outside[0, ridge.order[0]] = 1.01
    outside[1, ridge.coordinate] = ridge.edges[-1] + 1e-6
    assert np.all(ridge.log_density(outside) == -np.inf)


@pytest.mark.parametrize("factor", [1.0, 4.0])
def test_the_density_is_that_of_the_transport(ridge: RidgeProposal, factor: float) -> None:
    """One over the Jacobian determinant of the map from uniform points, by central differences: so it is normalised."""
    wide = ridge.inflated(factor)
    rng = np.random.default_rng(4)
    n, n_dim = 40, len(ridge.order) + 1
    uniforms = rng.uniform(0.05, 0.95, (n, n_dim))
    above = np.cumsum(wide.mass)
    cell = np.searchsorted(above, uniforms[:, 0])
    uniforms[:, 0] = above[cell] - 0.5 * wide.mass[cell]  # mid-cell: the map has kinks between cells
    points, log_density = wide.transport(uniforms)
    step = 1e-6
    slopes = np.empty((n, n_dim, n_dim))
    for i in range(n_dim):
        ahead, behind = (wide.transport(uniforms + side * step * np.eye(n_dim)[i])[0] for side in (1.0, -1.0))
        slopes[:, :, i] = (ahead - behind) / (2.0 * step)
    np.testing.assert_allclose(log_density, -np.linalg.slogdet(slopes)[1], atol=1e-4)
    np.testing.assert_allclose(wide.log_density(points), log_density, atol=1e-5)


def test_a_bent_ridge_in_two_dimensions_integrates_to_one() -> None:
    """Made by hand, by quadrature on a grid: uneven cell masses, a mean and a width that change along the walk."""
    edges = np.linspace(0.1, 0.9, 4097)
    mass = 1.0 + np.sin(9.0 * edges[1:]) ** 2
    nodes = np.linspace(0.1, 0.9, 6)
    hand = RidgeProposal(
        coordinate=1,
        order=np.array([0]),
        edges=edges,
        mass=mass / mass.sum(),
        nodes=nodes,
        means=(0.2 + nodes**2)[:, None],
        factors=(0.05 + 0.1 * nodes)[:, None],
        bend=Bend(n_wide=0, coefficients=np.zeros((0, 1))),
    )
    along, across = 0.5 * (edges[1:] + edges[:-1])[::16], np.linspace(0.0, 1.0, 401)
    points = np.stack(np.meshgrid(across, along, indexing="ij"), axis=-1).reshape(-1, 2)
    density = np.exp(hand.log_density(points)).reshape(len(across), len(along))
    whole = np.sum(integrate.simpson(density, across, axis=0)) * 0.8 / len(along)
    assert whole == pytest.approx(1.0, abs=2e-3)


def test_importance_along_the_ridge_is_efficient(free_draws: WeightedDraws) -> None:
    """The shape of a tail of ``3 sqrt(n)`` weights is itself known to ``(1 + k) / sqrt(3 sqrt(n))``."""
    n = len(free_draws.points)
    assert free_draws.effective_sample_size > 0.1 * n
    assert free_draws.pareto_k < 0.7 + 1.7 / np.sqrt(3.0 * np.sqrt(n))


def test_the_posterior_of_a_is_exact(
    free_posterior: Posterior, free_draws: WeightedDraws, along_a: int, marginal: tuple[Floats, Floats]
) -> None:
    """Mean, sd and five cells of the weighted draws within 4 standard errors of the mean Jacobian."""
    grid, density = marginal
    a = free_posterior.space.from_unit(free_draws.points)[:, along_a]
    weights = np.exp(free_draws.log_weights)
    size = free_draws.effective_sample_size
    mean = integrate.simpson(grid * density, grid)
    sd = np.sqrt(integrate.simpson((grid - mean) ** 2 * density, grid))
    assert abs(weights @ a - mean) < 4.0 * sd / np.sqrt(size)
    cells = np.linspace(*A_RANGE, 6)
    below = integrate.cumulative_simpson(density, x=grid, initial=0.0)
    expected = np.diff(np.interp(cells, grid, below))
    seen = np.array([weights @ ((a >= low) & (a < high)) for low, high in pairwise(cells)])
    assert np.all(np.abs(seen - expected) < 4.0 * np.sqrt(expected * (1.0 - expected) / size))


def test_the_evidences_differ_by_the_savage_dickey_ratio(
    free_draws: WeightedDraws, at_one: WeightedDraws, marginal: tuple[Floats, Floats]
) -> None:
    """The model with A = 1 is nested in the free one: the evidences differ by prior over posterior density at A = 1."""
    grid, density = marginal
    posterior_at_one = np.interp(1.0, grid, density)
    prior_at_one = 1.0 / (A_RANGE[1] - A_RANGE[0])
    difference = free_draws.log_evidence - at_one.log_evidence
    assert np.hypot(free_draws.log_evidence_se, at_one.log_evidence_se) < 0.03
    assert difference == pytest.approx(np.log(prior_at_one / posterior_at_one), abs=0.1)
