"""A posterior with an unnamed force beside the model: its likelihood, its intervals, the responses of its draws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import multivariate_normal

from bwbn_bayes import BoucWen, KnownNoise, Record, Settings, ShearBuilding, Specimen, Uniform, UserError, identify
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.correlation import Correlation, SharedFunctions
from bwbn_bayes.inference.likelihood import IntegratedNoise, Posterior
from bwbn_bayes.inference.modes import distinct, polish
from bwbn_bayes.inference.unnamed.beside import BELIEVED, beside
from bwbn_bayes.inference.unnamed.first_order import FirstOrder
from bwbn_bayes.parameters import Floats

ENGINE = Lanes(n_threads=1)
N, DT = 200, 0.02
TIMES = DT * np.arange(N)
GROUND = np.sin(2.0 * np.pi * 0.8 * TIMES)
MODEL = ShearBuilding(
    masses=[2.0, 1.0],
    storey=BoucWen(k=Uniform(40, 80), c=Uniform(0.1, 1.0), alpha=1.0, beta=12.0, gamma=2.0, n=1.0),
)
"""Linear, so that it lacks whatever bends."""
SETTINGS = Settings(particles=400, alternatives=False, fallback=False)


def recorded(cubic: float) -> tuple[Record, Floats]:
    """By SciPy: both floors' total accelerations, and the storeys' forces, with a cubic spring in the second storey."""
    mass, drifts = np.array([2.0, 1.0]), np.array([[1.0, 0.0], [-1.0, 1.0]])

    def force(y: Floats) -> Floats:
        drift, rate = drifts @ y[:2], drifts @ y[2:]
        return np.asarray(60.0 * drift + 0.4 * rate + np.array([0.0, cubic]) * drift**3)

    def rates(t: float, y: Floats) -> Floats:
        return np.concatenate([y[2:], -np.interp(t, TIMES, GROUND) - drifts.T @ force(y) / mass])

    found = solve_ivp(rates, (0.0, TIMES[-1]), np.zeros(4), t_eval=TIMES, rtol=1e-9, atol=1e-11, max_step=DT).y
    forces = np.array([force(y) for y in found.T]).T
    rng = np.random.default_rng(3)
    total = [-(drifts.T @ own) / mass for own in forces.T]
    channels = {}
    for floor, signal in enumerate(np.array(total).T, start=1):
        channels[f"acceleration_{floor}"] = signal + 0.01 * np.std(signal) * rng.standard_normal(N)
    return Record(name="bent", time_step=DT, excitation=GROUND, channels=channels), forces


@pytest.fixture(scope="module")
def bent() -> tuple[Record, Floats]:
    return recorded(400.0)


def test_errors_that_channels_share_have_the_covariance_that_they_say() -> None:
    """By SciPy's multivariate normal of all samples of two channels."""
    rng = np.random.default_rng(1)
    level, basis = np.array([0.5, 2.0]), rng.standard_normal((60, 3))
    correlation = Correlation(shared=SharedFunctions.of(basis, level))
    rows = rng.standard_normal((1, 1, 2, 30))
    scale = np.diag(np.repeat(level, 30))
    covariance = scale @ (np.eye(60) + basis @ basis.T) @ scale
    expected = multivariate_normal(np.zeros(60), covariance).logpdf(rows.ravel())
    squared = correlation.products(rows)[0, :, 0, 0] / np.square(level)
    plain = -0.5 * np.sum(squared) - 30 * np.sum(np.log(level)) - 30 * np.log(2.0 * np.pi)
    assert plain + correlation.log_volume == pytest.approx(expected)
    first = correlation.until(Record(name="ten", time_step=DT, excitation=GROUND[:10]))
    assert first.shared is not None
    kept = (basis.reshape(2, 30, 3)[:, :10]).reshape(20, 3)
    inner = np.eye(20) + kept @ kept.T
    own = rows[..., :10] / level[:, None]
    quadratic = float(own.ravel() @ np.linalg.solve(inner, own.ravel()))
    assert np.sum(first.products(rows[..., :10])[0, :, 0, 0] / np.square(level)) == pytest.approx(quadratic)


def test_a_first_order_engine_answers_as_its_parts_say() -> None:
    rng = np.random.default_rng(2)
    slopes, response = rng.standard_normal((2, 2, N)), rng.standard_normal((2, N))
    engine = FirstOrder(values=np.array([60.0, 0.4]), response=response, slopes=slopes, scheme="")
    record = Record(name="x", time_step=DT, excitation=GROUND, channels={"acceleration_1": GROUND, "drift_2": GROUND})
    draws = np.array([[60.0, 0.4], [61.0, 0.2]])
    rest = GROUND - response - slopes[0] + 0.2 * slopes[1]
    np.testing.assert_allclose(engine.misfit(MODEL, draws, record)[1], np.sum(rest**2, axis=1))
    equations = engine.normal_equations(MODEL, draws, record)
    np.testing.assert_allclose(equations.gradient[1], np.einsum("pct,ct->cp", slopes, rest))
    np.testing.assert_allclose(equations.information[0], np.einsum("pct,qct->cpq", slopes, slopes))
    other = FirstOrder(values=engine.values, response=response + 1e-9, slopes=slopes, scheme="")
    assert repr(other) != repr(engine)


def test_intervals_of_a_wrong_model_hold_the_truth_once_they_know_of_a_force(bent: tuple[Record, Floats]) -> None:
    """Alone the linear model is sure of a stiffness that is far off; the bands hold the force that acted."""
    record, forces = bent
    alone = identify(MODEL, record, settings=SETTINGS)
    result = identify(MODEL, record, settings=SETTINGS, unnamed_force=True)
    assert alone.facts.grade == result.facts.grade == "refused"
    assert "--unnamed-force" in alone.facts.verdict[0]
    assert "the intervals know of it" in result.facts.verdict[0]
    stiffness, before = (facts.parameters[0] for facts in (result.facts, alone.facts))
    assert abs(before.mean - 60.0) > 4.0 * before.sd
    assert stiffness.hdi90[0] < 60.0 < stiffness.hdi90[1]
    assert stiffness.sd > 3.0 * before.sd
    assert any(f"{100.0 * BELIEVED:.2g} %" in sentence for sentence in result.facts.assumptions)
    band = result.tree["response_bands"]["restoring_force"]
    size = np.max(np.abs(forces), axis=1)[:, None]
    shown = np.mean(np.abs(band.sel(statistic="mean").values - forces) / size)
    assert shown < 0.03
    inside = (band.sel(statistic="lower").values - 0.01 * size < forces) & (
        forces < band.sel(statistic="upper").values + 0.01 * size
    )
    assert np.mean(inside) > 0.8
    # What the record shows the draws show too, each solved with a force of its own.
    assert max(result.facts.nrmse.values()) < 0.015
    assert max(alone.facts.nrmse.values()) > 0.02


def test_a_specimens_force_adds_to_its_laws() -> None:
    """Its marginal likelihood is a normal one whose covariance holds the force, by SciPy."""
    path = 0.02 * np.sin(np.linspace(0.0, 6.0 * np.pi, 120)) * np.linspace(0.3, 1.0, 120)
    specimen = Specimen(storey=BoucWen(k=Uniform(40, 80), alpha=0.15, beta=40.0, gamma=10.0, n=1.0))
    pushed = Record(name="pushed", time_step=1.0, excitation=path, channels={}, excitation_kind="displacement")
    law = ENGINE.simulate(specimen, np.array([[60.0]]), pushed, ("force",)).values[0, 0]
    missing = 0.06 * np.max(np.abs(law)) * np.sin(path / 0.004)
    record = pushed.with_channels({"force": law + missing + 0.002 * np.random.default_rng(4).standard_normal(120)})
    noise = IntegratedNoise(shape=1e7, scale=(1e7 * 0.002**2,))
    posterior = Posterior(model=specimen, record=record, engine=ENGINE, noise=noise)
    found = beside(posterior, distinct(*polish(posterior, np.full((1, 1), 0.5), n_iterations=20)))
    shared = found.posterior.noise.correlation
    assert shared is not None and shared.shared is not None
    basis = shared.shared.functions * np.sqrt(shared.shared.variance)
    covariance = 0.002**2 * (np.eye(120) + basis @ basis.T)
    points = np.array([[0.4], [0.5], [0.6]])
    left = record.measured[0] - ENGINE.simulate(specimen, posterior.split(points)[0], record).values[:, 0]
    expected = multivariate_normal(np.zeros(120), covariance).logpdf(left)
    value = found.posterior.log_likelihood(points)
    np.testing.assert_allclose(value - value[0], expected - expected[0], rtol=1e-3, atol=1e-3)
    draws = [found.drawn(np.array([0.5]), np.random.default_rng(seed))[1] for seed in range(30)]
    size = np.max(np.abs(law))
    assert np.mean(np.abs(np.mean(draws, axis=0) + law - record.measured[0])) < 0.01 * size


def test_where_no_force_can_stand_beside_a_model(bent: tuple[Record, Floats]) -> None:
    record = bent[0]
    with pytest.raises(UserError, match="unnamed force needs noise levels that are integrated out"):
        identify(MODEL, record, settings=SETTINGS, noise=KnownNoise(sd=(0.1, 0.1)), unnamed_force=True)
    for method in ("ga", "ipv"):
        with pytest.raises(UserError, match="samples no posterior that an unnamed force could widen"):
            identify(MODEL, record, settings=Settings(method=method), unnamed_force=True)
