"""The sheet that redundant and weakly seen directions leave: its density, exact marginals, exact evidences.

With A free, z and A scale by a factor lambda, and nothing that is measured changes if at the same time

    k' = alpha k + (1 - alpha) k / lambda,    alpha' = alpha k / k',
    beta' = lambda^(1 - n) beta,    gamma' = lambda^(1 - n) gamma,    (sigma' = lambda sigma)

(Ma et al., J. Appl. Mech. 71(3), 2004). So the likelihood is a function of the parameters carried to A = 1, and where
no bound binds but A's own the marginal posterior of A is the mean, over the posterior at A = 1, of the Jacobian
determinant of the map at lambda = A. By hand it is ``k / (lambda k') lambda^(2 (1 - n))`` with one storey: about
lambda^(-0.4) at n = 1.2. Three storeys have three k for one alpha, and slip has sigma: there it is about lambda^-2.
"""

import numpy as np
import pytest
from inference_cases import A_RANGE, MOVED, SDOF, carried, jacobian_determinant, require_posterior_of_a
from scipy import integrate, stats

from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.inference import nested_laplace
from bwbn_bayes.inference.importance import PARETO_LIMIT, WeightedDraws, laplace_mixture, sample_importance
from bwbn_bayes.inference.likelihood import Linearisation, Posterior
from bwbn_bayes.inference.modes import Mode, polish
from bwbn_bayes.inference.nested_laplace import NestedLaplace, Sheet
from bwbn_bayes.inference.sheet_nodes import Box, Nodes, Stretch, first_nodes, wide_coordinates
from bwbn_bayes.parameters import Floats, Uniform


@pytest.fixture(scope="module")
def along_a(free_posterior: Posterior) -> int:
    return free_posterior.space.names.index("A")


@pytest.fixture(scope="module")
def nested(free_posterior: Posterior, free_mode: Mode) -> NestedLaplace:
    return NestedLaplace.through(first_nodes(free_posterior, [free_mode]))


@pytest.fixture(scope="module")
def free_draws(free_posterior: Posterior, free_mode: Mode) -> WeightedDraws:
    rng = np.random.default_rng(2)
    sheet = Sheet(free_posterior, [free_mode], rng)
    sheet.lay()
    return sample_importance(free_posterior, sheet.proposal, rng, effective=3000)


def test_a_draw_whose_weight_is_lost_in_rounding_is_not_drawn() -> None:
    """Of an elastic specimen without noise all weight lay on few draws, and the choice among them ended in an error."""
    log_weights = np.array([0.0] * 10 + [-1488.0, -np.inf]) - np.log(10.0)
    points = np.arange(12.0)[:, None]
    pilot = WeightedDraws(
        points=points, log_likelihood=log_weights, log_weights=log_weights, log_evidence=0.0, log_evidence_se=0.0,
        pareto_k=0.9,
    )  # fmt: skip
    found = nested_laplace._heavy(pilot, np.random.default_rng(1))
    assert sorted(found.ravel().tolist()) == list(range(10))


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


def test_the_redundant_direction_is_taken_out(free_mode: Mode, free_posterior: Posterior) -> None:
    """One of the parameters that share the scale; what is left is seen by the data."""
    wide = wide_coordinates(free_mode.information)
    assert free_posterior.space.names[wide[0]] in {"A", *MOVED}
    rest = np.setdiff1d(np.arange(free_posterior.n_dim), wide)
    covariance = np.linalg.inv(free_mode.information[np.ix_(rest, rest)] + 12.0 * np.eye(len(rest)))
    assert np.all(np.sqrt(np.diag(covariance)) < 0.05)


def test_the_sheet_holds_the_orbit(free_posterior: Posterior, free_mode: Mode, nested: NestedLaplace) -> None:
    """The mode carried along the redundant scale stays within two conditional sds of the surface."""
    names = free_posterior.space.names
    start = free_posterior.space.from_unit(free_mode.point[None])
    own = start[0, names.index("A")]
    orbit = [carried(start, names, a / own)[0] for a in np.linspace(0.8 * own, 1.25 * own, 10)]
    points = free_posterior.space.to_unit(np.array(orbit))
    inside = np.all((points > 0.0) & (points < 1.0), axis=1)
    assert np.count_nonzero(inside) > 4
    assert np.max(nested.distance(points[inside])) < 2.0


def test_transport_sample_and_density_agree(nested: NestedLaplace) -> None:
    n_dim = len(nested.order) + len(nested.box.wide)
    points, log_density = nested.transport(np.random.default_rng(3).random((2000, n_dim)))
    np.testing.assert_allclose(nested.log_density(points), log_density, atol=1e-5)
    np.testing.assert_array_equal(nested.sample(np.random.default_rng(3), 2000), points)
    assert np.all((points >= 0.0) & (points <= 1.0))
    outside = points[:2].copy()
    outside[0, nested.order[0]] = 1.01
    outside[1, nested.box.wide[0]] = nested.box.high[0] + 1e-6
    assert np.all(nested.log_density(outside) == -np.inf)


@pytest.mark.parametrize(("factor", "degrees"), [(1.0, np.inf), (4.0, np.inf), (1.5, 6.0)])
def test_the_density_is_that_of_the_transport(nested: NestedLaplace, factor: float, degrees: float) -> None:
    """One over the Jacobian determinant of the map from uniform points, by central differences: so it is normalised."""
    spread = nested.inflated(factor, degrees)
    rng = np.random.default_rng(4)
    n, n_dim = 40, len(nested.order) + len(nested.box.wide)
    uniforms = rng.uniform(0.05, 0.95, (n, n_dim))
    points, log_density = spread.transport(uniforms)
    step = 1e-7
    slopes = np.empty((n, n_dim, n_dim))
    for i in range(n_dim):
        ahead, behind = (spread.transport(uniforms + side * step * np.eye(n_dim)[i])[0] for side in (1.0, -1.0))
        slopes[:, :, i] = (ahead - behind) / (2.0 * step)
    error = np.abs(log_density + np.linalg.slogdet(slopes)[1])
    # The map has kinks at the borders of cells, which a difference may straddle.
    assert np.count_nonzero(error > 1e-3) <= 2
    np.testing.assert_allclose(spread.log_density(points), log_density, atol=1e-5)


BEND, WIDTH = 0.8, 0.01


def banana_nodes(n: int = 64) -> Nodes:
    """Exact nodes of a density over the unit cube: uniform in x1 and x2, normal in x3 about a bent surface."""
    rng = np.random.default_rng(5)
    points = rng.random((n, 3))
    points[:, 2] = surface(points)
    information = np.zeros((n, 3, 3))
    information[:, 2, 2] = 1.0 / WIDTH**2 - 12.0
    local = Linearisation(log_likelihood=np.zeros(n), gradient=np.zeros((n, 3)), information=information)
    box = Box(wide=np.array([0, 1]), low=np.zeros(2), high=np.ones(2))
    return Nodes(points=points, local=local, box=box, stretch=Stretch(ratio=np.zeros(3)))


def surface(points: Floats) -> Floats:
    return np.asarray(0.5 + BEND * (points[:, 0] - 0.5) * (points[:, 1] - 0.5))


def test_a_bent_sheet_is_found_exactly() -> None:
    """Density by quadrature integrates to one, and equals the truth where the nodes are dense enough."""
    nested = NestedLaplace.through(banana_nodes())
    draws = nested.sample(np.random.default_rng(6), 4000)
    ratio = stats.norm.logpdf(draws[:, 2], surface(draws), WIDTH) - nested.log_density(draws)
    assert np.mean(np.exp(ratio)) == pytest.approx(1.0, abs=0.02)
    assert np.std(np.exp(ratio)) < 0.35
    wide = (np.arange(64) + 0.5) / 64
    across = np.linspace(0.0, 1.0, 2001)
    grid = np.stack(np.meshgrid(wide, wide[::8], across, indexing="ij"), axis=-1)
    density = np.exp(nested.log_density(grid.reshape(-1, 3))).reshape(grid.shape[:-1])
    per_column = integrate.simpson(density, across, axis=2)
    # The mass is uniform but for rounding of the interpolated heights.
    assert np.mean(per_column) == pytest.approx(1.0, abs=0.02)


def test_what_a_bound_holds_back_far_from_its_mean_is_still_followed() -> None:
    """Uniform in x1 and x2; x3 presses on its upper bound with slopes worth 20 of its standard deviations.

    Such means and widths, interpolated apart, are worth 200 nats at the bound and a few per cent off between nodes.
    """
    nodes = banana_nodes()

    def slope_and_curvature(points: Floats) -> tuple[Floats, Floats]:
        wave = np.sin(9.0 * points[:, 0]) * np.cos(7.0 * points[:, 1])
        return 20.0 / WIDTH * (1.0 + 0.2 * wave), np.square((1.0 + 0.2 * points[:, 0]) / WIDTH)

    def log_truth(points: Floats) -> Floats:
        """Normal about a mean beyond the bound, normalised below it."""
        slope, curvature = slope_and_curvature(points)
        mean, sd = 1.0 + slope / curvature, 1.0 / np.sqrt(curvature)
        return np.asarray(stats.norm.logpdf(points[:, 2], mean, sd) - stats.norm.logcdf(1.0, mean, sd))

    nodes.points[:, 2] = 1.0
    slope, curvature = slope_and_curvature(nodes.points)
    nodes.local.gradient[:, 2], nodes.local.information[:, 2, 2] = slope, curvature - 12.0
    nodes.local.log_likelihood[:] = log_truth(nodes.points)
    nested = NestedLaplace.through(nodes)
    draws = nested.sample(np.random.default_rng(10), 4000)
    ratio = np.exp(log_truth(draws) - nested.log_density(draws))
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.02)
    assert np.mean(ratio) ** 2 / np.mean(np.square(ratio)) > 0.8


def test_powers_of_each_other_lie_on_a_plane() -> None:
    """k between 15 and 25, A = 25 / k between 0.5 and 2: from three nodes A is exact at every other k."""
    k, a = Uniform(15, 25), Uniform(0.5, 2)

    def nodes(at: Floats, stretch: Stretch) -> Nodes:
        points = np.column_stack([k.probability(at), a.probability(25.0 / at)])
        information = np.tile(np.diag([0.0, 1.0 / WIDTH**2]), (len(at), 1, 1))
        local = Linearisation(
            log_likelihood=np.zeros(len(at)), gradient=np.zeros((len(at), 2)), information=information
        )
        box = Box(wide=np.array([0]), low=np.zeros(1), high=np.ones(1))
        return Nodes(points=points, local=local, box=box, stretch=stretch)

    given, everywhere = np.array([15.0, 18.0, 24.0]), np.linspace(15.5, 25.0, 20)
    logarithmic, plain = Stretch(ratio=np.array([25 / 15 - 1, 2 / 0.5 - 1])), Stretch(ratio=np.zeros(2))
    elsewhere = nodes(everywhere, plain).points
    far = [NestedLaplace.through(nodes(given, one)).distance(elsewhere) for one in (logarithmic, plain)]
    assert np.max(far[0]) < 1e-3
    assert np.max(far[1]) > 1.0


def test_a_stretch_is_undone_within_the_cube_and_beyond() -> None:
    stretch = Stretch(ratio=np.array([0.0, 0.67, 99.0]))
    points = np.random.default_rng(8).uniform(-0.3, 1.3, (200, 3))
    columns = np.array([2, 0, 1])
    np.testing.assert_allclose(stretch.back(stretch.forward(points, columns), columns), points, atol=1e-12)
    np.testing.assert_allclose(stretch.forward(np.eye(3), np.arange(3)), np.diag([1.0, np.log(1.67), np.log(100.0)]))


def test_nodes_on_one_face_of_the_box_still_make_a_sheet() -> None:
    """No slope across the face can be known; the density stays proper."""
    nodes = banana_nodes()
    nodes.points[:, 1] = 0.0
    nodes.points[:, 2] = surface(nodes.points)
    nested = NestedLaplace.through(nodes)
    points, log_density = nested.transport(np.random.default_rng(9).random((500, 3)))
    assert np.all(np.isfinite(points))
    np.testing.assert_allclose(nested.log_density(points), log_density, atol=1e-5)


def test_distance_from_the_sheet_counts_standard_deviations() -> None:
    nested = NestedLaplace.through(banana_nodes())
    points = np.random.default_rng(7).uniform(0.2, 0.8, (50, 3))
    points[:, 2] = surface(points) + 2.0 * np.sqrt(1.1) * WIDTH
    np.testing.assert_allclose(nested.distance(points), 2.0, atol=0.2)


def test_nodes_are_alive_within_reach_of_the_best_but_never_too_few() -> None:
    nodes = banana_nodes(16)
    nodes.local.log_likelihood[:] = -100.0 * np.arange(16)
    np.testing.assert_array_equal(np.flatnonzero(nodes.alive), np.arange(6))
    nodes.local.log_likelihood[:] = np.r_[np.zeros(10), np.full(6, -31.0)]
    assert np.count_nonzero(nodes.alive) == 10


@pytest.mark.parametrize(
    ("log_likelihood", "gradient", "information"),
    [
        pytest.param(-np.inf, np.nan, np.nan, id="unsolved"),
        pytest.param(-1e4, 4e129, 3e257, id="runaway derivatives"),
        pytest.param(-1e4, 2e169, 0.0, id="information that overflowed"),
    ],
)
def test_what_cannot_be_solved_is_no_node(
    log_likelihood: float,
    gradient: float,
    information: float,
    free_posterior: Posterior,
    free_mode: Mode,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Half of the refits fail; the sheet goes through the rest, and bends as they do."""

    def failing(*given: object, **options: object) -> tuple[Floats, Linearisation]:
        points, local = polish(*given, **options)  # type: ignore[arg-type]
        local.log_likelihood[1::2] = log_likelihood
        local.gradient[1::2] = gradient
        local.information[1::2] = information
        return points, local

    monkeypatch.setattr("bwbn_bayes.inference.sheet_nodes.polish", failing)
    nodes = first_nodes(free_posterior, [free_mode])
    assert 0 < len(nodes.points) < 32
    sheet = NestedLaplace.through(nodes)
    assert np.all(np.isfinite(sheet.log_density(free_mode.point[None])))
    assert np.all(np.isfinite(sheet.bent(free_posterior, nodes).log_density(free_mode.point[None])))


def test_a_posterior_that_no_gaussian_covers(free_posterior: Posterior, free_mode: Mode) -> None:
    """Laplace's mixture alone fails here, so that what follows shows something."""
    poor = sample_importance(
        free_posterior, laplace_mixture([free_mode]), np.random.default_rng(8), effective=2000, most=4000
    )
    assert poor.effective_sample_size < 0.1 * len(poor.points)


def test_importance_over_the_sheet_is_efficient(free_draws: WeightedDraws) -> None:
    assert free_draws.effective_sample_size > 0.25 * len(free_draws.points)
    assert free_draws.pareto_k < PARETO_LIMIT


def test_the_posterior_of_a_is_exact(
    free_posterior: Posterior, free_draws: WeightedDraws, along_a: int, marginal: tuple[Floats, Floats]
) -> None:
    a = free_posterior.space.from_unit(free_draws.points)[:, along_a]
    require_posterior_of_a(a, np.exp(free_draws.log_weights), free_draws.effective_sample_size, marginal)


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
