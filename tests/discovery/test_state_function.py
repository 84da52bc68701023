"""A force of one state: its basis, its law, its prior, and whether it is found as what it is."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import norm

from bwbn_bayes.discovery import unnamed
from bwbn_bayes.discovery.evidence import laplace
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.unnamed_facts import _of_storey, _Sure
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import IntegratedNoise, Posterior
from bwbn_bayes.inference.modes import distinct, polish
from bwbn_bayes.inference.summary import observe
from bwbn_bayes.inference.unnamed import UNNAMED_SCALE, hats
from bwbn_bayes.inference.unnamed import state_function as own
from bwbn_bayes.inference.unnamed.pulses import knots_of
from bwbn_bayes.inference.unnamed.state_function import StateForce, StateFunction, TiedPosterior, state_forces
from bwbn_bayes.inference.unnamed.storey import Estimate
from bwbn_bayes.parameters import Floats, Uniform
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.parts import PlacedEffect
from bwbn_bayes.structures.shear_building import ShearBuilding

STEP = 0.02
TIMES = STEP * np.arange(500)
GROUND = np.sin(2.0 * np.pi * 0.9 * TIMES) * np.minimum(TIMES / 4.0, 1.0) * 2.5
MODEL = ShearBuilding(
    masses=(1.0, 1.0),
    storey=BoucWen(k=Uniform(40.0, 80.0), c=0.5, alpha=0.2, beta=5.0, gamma=5.0, n=1.0),
)


def window(drift: Floats | float) -> Floats:
    """A storey that stiffens between two drifts: no law of the catalogue. [N]."""
    return np.asarray(0.8 * np.tanh((drift - 0.06) / 0.012) + 0.8 * np.tanh(5.0))


def test_a_hat_is_a_triangle_seen_through_a_slit() -> None:
    x, slit = np.linspace(-1.4, 1.4, 61), np.linspace(-hats._ROUNDED, hats._ROUNDED, 2001)
    for hat in hats.HATS:
        seen = x[:, None] + slit
        half = 2.0**-hat.level
        triangle = np.maximum(0.0, 1.0 - np.abs(hat.side * seen - hat.centre) / half)
        if hat.level == 0:  # and stays at one beyond the reach
            triangle = np.clip(hat.side * seen, 0.0, 1.0)
        np.testing.assert_allclose(hat.over(x), np.mean(triangle, axis=1), atol=2e-3)


def test_its_weights_are_those_of_a_brownian_motion() -> None:
    """Of unit variance at the end of the reach: the variance at x is x, of what 64 corners resolve."""
    x = np.array([-0.75, -0.5, 0.25, 0.5, 0.625, 1.0])
    basis = np.array([hat.sd * hat.over(x) for hat in hats.HATS])
    covariance = basis.T @ basis
    same_side = np.sign(x)[:, None] == np.sign(x)
    expected = np.where(same_side, np.minimum.outer(np.abs(x), np.abs(x)), 0.0)
    np.testing.assert_allclose(covariance, expected, atol=0.02)


def posterior_of(record: Record) -> Posterior:
    noise = IntegratedNoise(shape=1.0, scale=tuple(1e-4 for _ in record.channels))
    return Posterior(model=MODEL, record=record, engine=Lanes(substeps=4, n_threads=1), noise=noise)


@pytest.fixture(scope="module")
def record() -> Record:
    """Floor accelerations of the building with the force in storey 2, by SciPy."""
    k, c, alpha, beta, gamma = 60.0, 0.5, 0.2, 5.0, 5.0

    def rates(t: float, y: Floats) -> Floats:
        u, v, z = y[0:2], y[2:4], y[4:6]
        force = c * v + alpha * k * u + (1.0 - alpha) * k * z
        force[1] += window(u[1])
        floors = (np.append(force[1:], 0.0) - force) / 1.0
        ground = np.interp(t, TIMES, GROUND)
        relative = np.array([floors[0] - ground, floors[1] - floors[0]])
        return np.concatenate([v, relative, v - beta * np.abs(v) * z - gamma * v * np.abs(z)])

    found = solve_ivp(rates, (0.0, TIMES[-1]), np.zeros(6), t_eval=TIMES, rtol=1e-9, atol=1e-11, max_step=0.01)
    total = np.array([rates(t, y)[2:4] for t, y in zip(TIMES, found.y.T, strict=True)])
    floors = np.cumsum(total, axis=1).T + GROUND
    rng = np.random.default_rng(3)
    noisy = {f"acceleration_{i + 1}": own + 0.01 * rng.standard_normal(len(TIMES)) for i, own in enumerate(floors)}
    return Record(name="shaken", time_step=STEP, excitation=GROUND, channels=noisy)


def test_the_tie_is_the_ratio_of_two_normal_priors(record: Record) -> None:
    """And its expansion has the slope of that, by differences."""
    placed = PlacedEffect(effect=StateFunction(state="drift", reach=0.2, scale=5.0), storeys=(2,))
    model = replace(MODEL, effects=(placed,))
    plain = posterior_of(record).with_model(model)
    tied = TiedPosterior(model=model, record=record, engine=plain.engine, noise=plain.noise, scale=0.2, smoothness=0.5)
    assert [model.space.names[i].split("[")[0] for i in tied.columns] == [p.symbol for p in own._WEIGHTS]
    rng = np.random.default_rng(1)
    points = rng.uniform(0.49, 0.51, (3, model.space.n_dim))
    weights = model.space.from_unit(points)[:, tied.columns]
    sd = 5.0 * np.array([hat.sd for hat in hats.HATS])
    narrow = 0.2 * sd * np.array([2.0 ** (-0.5 * hat.level) for hat in hats.HATS])
    ratio = np.sum(norm.logpdf(weights, scale=narrow) - norm.logpdf(weights, scale=sd), axis=1)
    np.testing.assert_allclose(tied.log_likelihood(points) - plain.log_likelihood(points), ratio, rtol=1e-6)
    slope = tied.linearise(points).gradient - plain.linearise(points).gradient
    for column in tied.columns[:3]:
        ends = []
        for step in (-1e-4, 1e-4):
            at = points.copy()
            at[:, column] += step
            ends.append(tied.log_likelihood(at) - plain.log_likelihood(at))
        np.testing.assert_allclose(slope[:, column], (ends[1] - ends[0]) / 2e-4, rtol=1e-3, atol=1e-3)
    assert tied.about != plain.about


@pytest.fixture(scope="module")
def plain(record: Record) -> Explanation:
    """The model as given, fitted."""
    posterior = posterior_of(record)
    modes = distinct(*polish(posterior, np.full((1, posterior.n_dim), 0.5), n_iterations=20))
    return Explanation(added=(), posterior=posterior, modes=modes, evidence=laplace(posterior, modes), n_places=3)


@pytest.fixture(scope="module")
def best(plain: Explanation) -> StateForce:
    """The force beside it that explains most."""
    found = state_forces(plain.posterior, plain.points, UNNAMED_SCALE, np.random.default_rng(1))
    return max(found, key=lambda force: force.modes[0].log_likelihood)


def test_it_is_found_in_its_storey_as_a_function_of_its_state(record: Record, best: StateForce) -> None:
    assert (best.storey, best.effect.state) == (2, "drift")
    rows = best.posterior.engine.simulate(
        best.posterior.model, best.posterior.split(best.modes[0].point[None])[0], record, ("drift_2",)
    )
    drift = rows.values[0, 0]
    found, true = best.effect.force(best.weights, drift), window(drift)
    # A constant is borne by a shift of the floor, and the springs may take up what is linear.
    design = np.column_stack([np.ones(len(drift)), drift])
    apart = [own - design @ np.linalg.lstsq(design, own, rcond=None)[0] for own in (found, true)]
    assert np.corrcoef(*apart)[0, 1] > 0.97
    residual = (
        record.measured
        - best.posterior.engine.simulate(
            best.posterior.model, best.posterior.split(best.modes[0].point[None])[0], record, tuple(record.channels)
        ).values[0]
    )
    assert np.std(residual) < 1.15 * 0.01


def test_its_shape_is_told_over_its_state(plain: Explanation, best: StateForce, record: Record) -> None:
    with_force = replace(plain, posterior=best.posterior, modes=best.modes, unnamed=(2,), estimate=best)
    told = _of_storey(with_force, _Sure(there=0.99, anywhere=0.995))
    assert (told.storey, told.over, told.function) == (2, "drift", "of the drift alone")
    assert 0.02 < told.share < 1.0
    # One value of the force at each drift.
    order = np.argsort(told.state)
    jumps = np.abs(np.diff(told.force[order])) / np.ptp(told.force)
    assert np.max(jumps[np.diff(told.state[order]) < 1e-3 * np.ptp(told.state)]) < 0.05
    assert len(told.force) == record.n_times


def test_what_cannot_be_solved_with_a_force_to_first_order_is_told_of_the_model_alone(plain: Explanation) -> None:
    knots = knots_of(plain.posterior.record, MODEL)
    force = {2: np.full(len(knots.times), 1e150)}
    estimate = Estimate(gain=1.0, kind="of no simple kind", forces=force, point=plain.best)
    told = _of_storey(replace(plain, unnamed=(2,), estimate=estimate), _Sure(there=0.99, anywhere=0.99))
    assert np.all(np.isfinite(told.state))


@pytest.mark.parametrize(("times", "acts"), [(1.0, True), (30.0, False)])
def test_a_force_to_first_order_acts_where_it_leaves_less_than_the_laws(
    record: Record, plain: Explanation, best: StateForce, times: float, acts: bool
) -> None:
    """The true one, and one of thirty times its size."""
    values = best.posterior.split(best.modes[0].point[None])[0]
    drift = best.posterior.engine.simulate(best.posterior.model, values, record, ("drift_2",)).values[0, 0]
    force = {2: times * window(drift)[knots_of(record, MODEL).samples]}
    point = best.modes[0].point[[best.posterior.space.names.index(name) for name in plain.posterior.space.names]]
    beside = replace(plain, unnamed=(2,), estimate=Estimate(gain=1.0, kind="of drift", forces=force, point=point))
    posterior, at = beside.whole
    assert (posterior is not plain.posterior) == acts
    assert (posterior.log_likelihood(at[None])[0] > plain.modes[0].log_likelihood + 10.0) == acts
    assert (beside.over_noise(record.measured) > 2.0 * plain.over_noise(record.measured)) == acts


def test_a_force_that_would_explain_the_noise_itself_is_none(
    record: Record, plain: Explanation, monkeypatch: pytest.MonkeyPatch
) -> None:
    """About a base that slides a force to first order gained 26,000 nats more than there were to explain."""
    scale = tuple(0.01**2 for _ in record.channels)
    noisy = replace(plain.posterior, noise=IntegratedNoise(shape=1.0, scale=scale))
    modes = distinct(*polish(noisy, plain.points, n_iterations=5))
    beside = replace(plain, posterior=noisy, modes=modes, evidence=laplace(noisy, modes))
    samples = record.n_times * len(record.channels)
    missing = samples * np.log(np.std(beside.residual) / 0.01)
    gains = {(1,): missing, (2,): missing + 2.0 * samples, (1, 2): missing + 5.0 * samples}
    found = {place: Estimate(gain=gain, kind="any", forces={}, point=beside.best) for place, gain in gains.items()}
    monkeypatch.setattr(unnamed, "unnamed_forces", lambda *_, **__: found)
    asked = unnamed._Asked(beside, 0.0, np.random.default_rng(1), 1, beside)
    assert [one.unnamed for one in unnamed._to_first_order(asked)] == [(1,), (2,)]


def test_a_function_told_anew_over_another_reach_is_the_same(record: Record) -> None:
    """Within the old reach; beyond it the force stays what it was at its end."""
    posterior = posterior_of(record)
    points = np.full((1, posterior.space.n_dim), 0.5)
    rows = observe(posterior.engine, MODEL, posterior.split(points)[0], record)
    old = own._Rival.of(posterior, points, 2, "drift", rows, UNNAMED_SCALE)
    weights = np.random.default_rng(2).standard_normal(len(hats.HATS))
    values = old.posterior.split(old.points)[0]
    values[:, old.posterior.columns] = old.effect.scale * np.array([hat.sd for hat in hats.HATS]) * weights * 0.3
    moved = replace(old, points=old.posterior.space.to_unit(values))
    new = moved._reaching(1.6 * old.effect.reach)
    assert new.effect.reach == 1.6 * old.effect.reach

    def force(rival: own._Rival, state: Floats) -> Floats:
        return rival.effect.force(rival.posterior.split(rival.points)[0][0, rival.posterior.columns], state)

    state = np.linspace(-1.6, 1.6, 801) * old.effect.reach
    expected, size = force(moved, state), np.ptp(force(moved, state))
    assert np.sqrt(np.mean(np.square(force(new, state) - expected))) < 0.01 * size
    end = force(moved, np.array([1.5]) * old.effect.reach)
    assert force(moved, np.array([1.1]) * old.effect.reach) == pytest.approx(end)


def test_a_force_without_which_the_motion_would_be_small_is_found_over_all_of_it(record: Record) -> None:
    """As if the model alone had moved a fifth as far: the reach follows the fit."""
    posterior = posterior_of(record)
    points = np.full((1, posterior.space.n_dim), 0.5)
    rows = observe(posterior.engine, MODEL, posterior.split(points)[0], record)
    small = {kind: values / (5.0 if kind == "drift" else 1.0) for kind, values in rows.items()}
    rival = own._Rival.of(posterior, points, 2, "drift", small, UNNAMED_SCALE)
    begun = rival.effect.reach
    for end in (4.0, record.duration):
        rival = rival.fitted(end, 12, np.random.default_rng(3))
    view = rival.posterior
    moved = observe(view.engine, view.model, view.split(rival.points[:1])[0], record)["drift"][0, 1]
    largest = float(np.max(np.abs(moved)))
    assert begun < largest <= rival.effect.reach <= own._TOO_FAR * largest


def test_a_part_of_the_record_is_told_nothing_fine(record: Record) -> None:
    """Most of a fit is derivatives by the finest weights: the whole record alone is asked for them."""
    posterior = posterior_of(record)
    points = np.full((1, posterior.space.n_dim), 0.5)
    rows = observe(posterior.engine, MODEL, posterior.split(points)[0], record)
    rival = own._Rival.of(posterior, points, 2, "drift", rows, UNNAMED_SCALE)
    fine = np.array([hat.level >= own._FINE for hat in hats.HATS])
    parts = rival
    for end in (4.0, 6.0):
        parts = parts.fitted(end, 3, np.random.default_rng(3))
        weights = parts.points[:, parts.posterior.columns]
        assert np.all(weights[:, fine] == 0.5)
        assert np.all(np.any(weights[:, ~fine] != 0.5, axis=1))
    whole = parts.fitted(record.duration, 3, np.random.default_rng(3))
    assert np.any(whole.points[:, whole.posterior.columns][:, fine] != 0.5)


def test_what_a_known_law_leaves_far_behind_is_not_fitted_to_the_end(
    plain: Explanation, best: StateForce, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not even to the second part: beside an answer, forces of a model without it took most of a search."""
    asked: list[float] = []
    fitted = own._Rival.fitted

    def counted(rival: own._Rival, end: float, *others: object) -> own._Rival:
        asked.append(end)
        return fitted(rival, end, *others)  # type: ignore[arg-type]

    monkeypatch.setattr(own._Rival, "fitted", counted)
    monkeypatch.setattr(own, "_BEHIND", 0.0)
    damped = BoucWen(k=Uniform(40.0, 80.0), c=5.0, alpha=0.2, beta=5.0, gamma=5.0, n=1.0)
    wrong = plain.posterior.with_model(ShearBuilding(masses=(1.0, 1.0), storey=damped))
    known = best.posterior, best.modes[0].point
    rng = np.random.default_rng(1)
    assert state_forces(wrong, plain.points, UNNAMED_SCALE, rng, known) == ()
    assert len(set(asked)) <= 2


def test_a_fit_whose_state_cannot_be_solved_is_left(plain: Explanation, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is measured is solved, and the state, with another step, is not: it ended the search of a measured frame."""

    def lost(*arguments: object) -> Mapping[str, Floats]:
        rows = observe(*arguments)  # type: ignore[arg-type]
        return rows if arguments[1] is plain.posterior.model else {k: np.full_like(v, np.nan) for k, v in rows.items()}

    monkeypatch.setattr(own, "observe", lost)
    assert state_forces(plain.posterior, plain.points, UNNAMED_SCALE, np.random.default_rng(1)) == ()
