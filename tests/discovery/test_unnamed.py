"""The force of no known law: its functions, what it takes up and what it leaves, its history, its Bayes factor."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.signal import lsim
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm

from bwbn_bayes.discovery.evidence import laplace
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.outcome import UnnamedForce
from bwbn_bayes.discovery.probability import beliefs
from bwbn_bayes.discovery.unnamed_facts import unnamed_facts
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import IntegratedNoise, Posterior
from bwbn_bayes.inference.modes import distinct, polish
from bwbn_bayes.inference.unnamed import UNNAMED_SCALE
from bwbn_bayes.inference.unnamed.pulses import Knots, answers
from bwbn_bayes.inference.unnamed.specimen import expected_force, unnamed_basis
from bwbn_bayes.inference.unnamed.storey import functions, places_of, unnamed_forces
from bwbn_bayes.inference.unnamed.sums import Sums
from bwbn_bayes.parameters import Floats, Normal, Uniform
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen

N = 240
PATH = 0.02 * np.sin(np.linspace(0.0, 8.0 * np.pi, N)) * np.linspace(0.3, 1.0, N)
"""Four growing cycles. [m]"""
SPECIMEN = Specimen(storey=BoucWen(k=60.0, alpha=Normal(0.15, 0.01).truncated(0.0, 1.0), beta=40.0, gamma=10.0, n=1.0))
ENGINE = Lanes(substeps=1, n_threads=1)
PUSHED = Record(name="pushed", time_step=1.0, excitation=PATH, channels={}, excitation_kind="displacement")
SD = 0.002
"""Noise on the force, of which the largest is about 0.5. [N]"""


@pytest.fixture(scope="module")
def law() -> Floats:
    """Force ``(N,)`` of the specimen as it is."""
    return np.asarray(ENGINE.simulate(SPECIMEN, np.array([[0.15]]), PUSHED, ("force",)).values[0, 0])


def fitted(force: Floats) -> Explanation:
    record = PUSHED.with_channels({"force": force + SD * np.random.default_rng(7).standard_normal(N)})
    posterior = Posterior(
        model=SPECIMEN, record=record, engine=ENGINE, noise=IntegratedNoise(shape=1.0, scale=(SD**2,))
    )
    modes = distinct(*polish(posterior, np.full((1, 1), 0.5), n_iterations=20))
    return Explanation(added=(), posterior=posterior, modes=modes, evidence=laplace(posterior, modes))


def test_the_functions_have_unit_variance_on_the_average_over_the_test(law: Floats) -> None:
    """By drawing forces: a law that is missing and what no law holds have half of it each."""
    basis = unnamed_basis(PUSHED.with_channels({"force": law}))
    assert basis.shape[0] == N
    assert np.mean(np.sum(np.square(basis), axis=1)) == pytest.approx(1.0)
    weights = np.random.default_rng(1).standard_normal((basis.shape[1], 4000))
    power = np.mean(np.square(basis @ weights), axis=0)
    assert abs(np.mean(power) - 1.0) < 4.0 * np.std(power) / np.sqrt(4000)


def test_a_force_of_the_states_goes_on_where_the_direction_turns(law: Floats) -> None:
    """No function jumps between two samples: a sign of the drift rate once did, and took up every turn's noise."""
    basis = unnamed_basis(PUSHED.with_channels({"force": law}))
    spread = np.sqrt(np.sum(np.square(np.diff(basis, axis=0)), axis=1))
    assert np.max(spread) < 1.0
    turns = np.flatnonzero(np.diff(np.sign(np.diff(PATH)))) + 1
    assert len(turns) == 8
    assert np.max(spread[turns]) < np.median(spread) * 2.0


def test_a_smooth_force_that_the_law_lacks_is_told(law: Floats) -> None:
    missing = 0.05 * np.max(np.abs(law)) * np.sin(PATH / 0.004)
    plain = fitted(law + missing)
    believed = beliefs((plain,), 1, {})
    assert believed.verdict == "unexplained"
    found = unnamed_facts(believed, plain)
    assert isinstance(found, UnnamedForce)
    assert (found.storey, found.place) == (1, "the specimen")
    assert found.probability == found.any_probability > 0.999
    assert np.corrcoef(found.force, missing)[0, 1] > 0.95
    expected = np.std(missing) / np.sqrt(np.mean(np.square(plain.posterior.record.channels["force"])))
    assert found.share == pytest.approx(expected, rel=0.2)


def test_beside_a_law_that_leaves_noise_no_force_is_told(law: Floats) -> None:
    plain = fitted(law)
    believed = beliefs((plain,), 1, {})
    assert believed.verdict == "no_missing_effect"
    assert unnamed_facts(believed, plain) is None


@pytest.mark.parametrize("scale", [0.01, 0.1])
def test_the_force_is_the_conditional_of_a_normal_at_its_likeliest_scale(law: Floats, scale: float) -> None:
    """By dense matrices; the noise level is the one that is likeliest at each scale."""
    rng, record = np.random.default_rng(6), PUSHED.with_channels({"force": law})
    record = replace(record, counted=rng.random(N) < 0.8)
    basis = unnamed_basis(record)
    drawn = scale * (basis @ rng.standard_normal(basis.shape[1])) + 0.01 * rng.standard_normal(N)
    known = np.arange(N)[record.kept]
    process = basis[known] @ basis[known].T

    def at(over_noise: float) -> tuple[float, Floats]:
        whole = np.eye(len(known)) + over_noise**2 * process
        weights = np.linalg.solve(whole, drawn[known])
        level = np.mean(drawn[known] * weights)
        likelihood = multivariate_normal(cov=level * whole).logpdf(drawn[known])
        return float(likelihood), over_noise**2 * process @ weights

    _, expected = max((at(own) for own in 2.0 ** np.arange(-3.0, 9.0, 0.25)), key=lambda one: one[0])
    found = expected_force(record, record.where_counted(drawn[None])[0])
    np.testing.assert_allclose(found[known], expected, atol=1e-8)


STOREY = BoucWen(k=Uniform(40, 80), c=0.4, alpha=1.0, beta=12.0, gamma=2.0)
LINEAR = ShearBuilding(masses=[2.0, 1.0], storey=STOREY)
"""With nothing hysteretic in its force."""
GROUND = Record(
    name="ground",
    time_step=0.02,
    excitation=np.sin(2.0 * np.pi * 0.8 * np.arange(200) * 0.02),
    channels={"acceleration_1": np.zeros(200), "drift_2": np.zeros(200)},
)


@pytest.mark.parametrize("storey", [1, 2])
def test_answers_are_those_of_the_equation_of_motion(storey: int) -> None:
    """Of a linear building with a force in a storey, by SciPy's simulation of its state space."""
    posterior = Posterior(
        model=LINEAR, record=GROUND, engine=ENGINE, noise=IntegratedNoise(shape=1.0, scale=(1.0, 1.0))
    )
    history = np.exp(-np.square((np.arange(200) - 80) / 15.0)) * np.sin(np.arange(200) / 9.0)
    shown = answers(posterior, np.array([0.5]), storey, np.array([history, 2.0 * history]), 50.0)
    mass, drifts = np.diag([2.0, 1.0]), np.array([[1.0, 0.0], [-1.0, 1.0]])
    stiffness = drifts.T @ drifts
    rate = -np.linalg.solve(mass, np.hstack([60.0 * stiffness, 0.4 * stiffness]))
    pushed = -np.linalg.solve(mass, drifts[storey - 1])[:, None]
    system = (
        np.block([[np.zeros((2, 2)), np.eye(2)], [rate]]),
        np.vstack([np.zeros((2, 1)), pushed]),
        np.vstack([rate[:1], [-1.0, 1.0, 0.0, 0.0]]),
        np.vstack([pushed[:1], [[0.0]]]),
    )
    _, expected, _ = lsim(system, history, np.arange(200) * 0.02)
    largest = np.max(np.abs(expected), axis=0)[:, None]
    np.testing.assert_allclose(shown[0] / largest, expected.T / largest, atol=2e-3)
    np.testing.assert_allclose(shown[1], 2.0 * shown[0], rtol=1e-6, atol=1e-12)


def test_functions_of_a_storeys_states_have_unit_variance_and_few_are_left_out() -> None:
    rng = np.random.default_rng(4)
    states = {
        kind: np.cumsum(rng.standard_normal((2, 300)), axis=1)
        for kind in ("drift", "drift_rate", "hysteretic_displacement")
    }
    states["hysteretic_energy"] = np.cumsum(np.abs(rng.standard_normal((2, 300))), axis=1)
    knots = Knots(samples=np.arange(300), times=0.02 * np.arange(300), runs=np.zeros(300, dtype=np.int64))
    for place in (0, 1):
        for own in functions(states, knots, place).values():
            assert np.mean(np.sum(np.square(own), axis=0)) == pytest.approx(1.0, abs=0.06)
    assert len(functions(states, knots, 0)) == 4
    alone = {kind: own[:1] for kind, own in states.items()}
    assert "of the other storeys' motion" not in functions(alone, knots, 0)
    at_rest = functions({kind: np.zeros((2, 300)) for kind in states}, knots, 0)
    assert all(np.all(np.isfinite(own)) for own in at_rest.values())


def sums(rng: np.random.Generator, shape: float, hidden: float) -> Sums:
    """A linear model of one slope with three functions of a force, 80 samples of two channels."""
    columns = rng.standard_normal((5, 2, 80))
    columns[:4] *= np.array([3.0, 0.2, 0.3, 0.1])[:, None, None]
    columns[4] += hidden * (columns[1] - columns[2])
    products = np.array([own @ own.T for own in np.moveaxis(columns, 1, 0)])
    noise = IntegratedNoise(shape=shape, scale=(shape, shape))
    ones = np.ones(2)
    return Sums(products=products, n_base=1, n_counted=80, noise=noise, level=ones, floor=ones, present=np.zeros(3))


def log_marginal(given: Sums, scale: float, precision: Floats) -> Floats:
    """By a normal of 160 samples whose covariance holds slope and force; from sums of products, by Woodbury.

    For precisions ``(..., 2)``.
    """
    n = len(given.products[0]) - 1
    prior = np.diag([1.0 / 12.0, *[scale**2] * 3][:n])
    whole = np.tensordot(precision, given.products, axes=1)
    inner = np.eye(n) + prior @ whole[..., :n, :n]
    solved = np.linalg.solve(inner, (prior @ whole[..., :n, n, None]))[..., 0]
    quadratic = whole[..., n, n] - np.sum(whole[..., n, :n] * solved, axis=-1)
    return np.asarray(0.5 * (80 * np.sum(np.log(precision), axis=-1) - quadratic - np.linalg.slogdet(inner)[1]))


@pytest.mark.parametrize("hidden", [0.0, 2.0])
def test_the_gain_of_a_linear_model_is_its_bayes_factor(hidden: float) -> None:
    """Under noise as good as known, over scales by quadrature."""
    given = sums(np.random.default_rng(3), 1e6, hidden)
    known = np.ones(2)
    nothing = log_marginal(given, 0.0, known)
    expected = quad(lambda s: np.exp(log_marginal(given, s, known) - nothing) * 2.0 * norm.pdf(s), 0.0, 8.0, limit=200)
    assert given.settled()[0] - given.alone == pytest.approx(np.log(expected[0]), abs=0.02)
    assert given.at_scale(0.7) - given.alone == pytest.approx(log_marginal(given, 0.7, known) - nothing, abs=1e-9)


def test_a_force_that_is_there_already_is_stepped_from() -> None:
    """The same linear model about other weights: what is left changes, the answer does not."""
    given, present = sums(np.random.default_rng(3), 1e6, 2.0), np.array([1.5, -0.4, 2.5])
    # The residual beside the present force is what the weights do not take up yet.
    change = np.eye(5)
    change[1:4, 4] = -present
    moved = replace(given, products=np.array([change.T @ one @ change for one in given.products]), present=present)
    for one, other in zip(given.settled(), moved.settled(), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9)


def test_where_the_force_explains_what_was_taken_for_noise_the_noise_is_smaller() -> None:
    """Over scales and both noise levels by sums over grids, from either start; the weights are those hidden."""
    given = sums(np.random.default_rng(5), 1.0, 8.0)
    # The noise of the model alone, over which products are: with the force it is a good deal smaller.
    misfit = given.products[:, -1, -1]
    level = np.sqrt((2.0 + misfit) / 82.0)
    own = Sums(
        products=given.products / np.square(level)[:, None, None],
        n_base=1,
        n_counted=80,
        noise=given.noise,
        level=level,
        floor=np.ones(2),
        present=np.zeros(3),
    )
    grid = np.stack(np.meshgrid(*[np.linspace(-1.5, 3.0, 61)] * 2), axis=-1)
    log_prior = np.sum(grid - np.exp(grid) / np.square(level), axis=-1)

    def marginal(scale: float) -> float:
        return float(logsumexp(log_marginal(own, scale, np.exp(grid)) + log_prior))

    scales = np.linspace(0.05, 6.0, 60)
    density = 2.0 * norm.pdf(scales) * (scales[1] - scales[0])
    expected = logsumexp([marginal(s) for s in scales], b=density) - marginal(0.0)
    for floor in (np.ones(2), level):
        log_evidence, _, weights, _ = replace(own, floor=floor).settled()
        assert log_evidence - own.alone == pytest.approx(expected, abs=1.0)
        np.testing.assert_allclose(weights, [8.0, -8.0, 0.0], atol=1.5)


def test_it_is_found_in_the_storey_that_has_it_with_its_history() -> None:
    """A force of the second storey's drift that no law is, by SciPy; the building as given explains nothing of it."""
    posterior = Posterior(
        model=LINEAR, record=GROUND, engine=ENGINE, noise=IntegratedNoise(shape=1.0, scale=(1e-4, 1e-8))
    )
    mass, drifts = np.array([2.0, 1.0]), np.array([[1.0, 0.0], [-1.0, 1.0]])

    def force(drift: Floats) -> Floats:
        return np.array([np.zeros_like(drift[0]), 1.5 * np.sin(drift[1] / 0.05)])

    def rate(t: float, y: Floats) -> Floats:
        drift, speed = drifts @ y[:2], drifts @ y[2:]
        pull = drifts.T @ (60.0 * drift + 0.4 * speed + force(drift))
        return np.concatenate([y[2:], -np.sin(2.0 * np.pi * 0.8 * t) - pull / mass])

    times = np.arange(200) * 0.02
    found = solve_ivp(rate, (0.0, times[-1]), np.zeros(4), t_eval=times, rtol=1e-9, atol=1e-11).y
    relative = np.array([rate(t, y)[2:] for t, y in zip(times, found.T, strict=True)])
    rng = np.random.default_rng(2)
    total = relative[:, 0] + np.sin(2.0 * np.pi * 0.8 * times)
    channels = {"acceleration_1": total, "drift_2": found[1] - found[0]}
    noisy = {name: own + 0.002 * np.std(own) * rng.standard_normal(200) for name, own in channels.items()}
    measured = posterior.record.with_channels(noisy)
    posterior = replace(posterior, record=measured)
    modes = distinct(*polish(posterior, np.full((1, 1), 0.5), n_iterations=20))
    estimates = unnamed_forces(posterior, modes[0].point, UNNAMED_SCALE)
    assert set(estimates) == {(1,), (2,), (1, 2)}
    assert estimates[(2,)].kind in ("of the storey's own states", "of no simple kind")
    assert estimates[(2,)].gain > max(100.0, estimates[(1,)].gain + 20.0)
    true = force(drifts @ found[:2])[1]
    # The stiffness may take up the part that is linear in the drift.
    drift = channels["drift_2"]
    apart = [own - drift * (drift @ own) / (drift @ drift) for own in (true, estimates[(2,)].forces[2])]
    assert np.corrcoef(*apart)[0, 1] > 0.9


def test_where_a_building_has_it() -> None:
    assert places_of(1) == ((1,),)
    assert places_of(3) == ((1,), (2,), (3,), (1, 2, 3))
