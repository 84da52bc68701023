"""An error of a sensor: whether it is found as what it is, and what its sums over size and noise level come to."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import logsumexp
from scipy.stats import halfnorm, invgamma, multivariate_normal

from bwbn_bayes.discovery.evidence import laplace
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.correlation import SharedFunctions
from bwbn_bayes.inference.likelihood import IntegratedNoise, Posterior
from bwbn_bayes.inference.modes import Mode, distinct, polish
from bwbn_bayes.inference.residuals import leaves_noise
from bwbn_bayes.inference.unnamed import UNNAMED_SCALE, reading
from bwbn_bayes.inference.unnamed.reading import reading_errors
from bwbn_bayes.parameters import Floats, Uniform
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding

STEP = 0.02
TIMES = STEP * np.arange(600)
GROUND = 2.5 * np.sin(2.0 * np.pi * 0.9 * TIMES) * np.minimum(TIMES / 4.0, 1.0) + np.sin(9.0 * TIMES)
NOISE = 0.02
MODEL = ShearBuilding(
    masses=(1.0, 1.0),
    storey=BoucWen(k=Uniform(40.0, 80.0), c=0.5, alpha=Uniform(0.05, 0.5), beta=5.0, gamma=5.0, n=1.0),
)


def floors() -> Floats:
    """Accelerations of two floors, by SciPy."""
    k, c, alpha, beta, gamma = 60.0, 0.5, 0.2, 5.0, 5.0

    def rates(t: float, y: Floats) -> Floats:
        u, v, z = y[0:2], y[2:4], y[4:6]
        force = c * v + alpha * k * u + (1.0 - alpha) * k * z
        floor = np.append(force[1:], 0.0) - force
        relative = np.array([floor[0] - np.interp(t, TIMES, GROUND), floor[1] - floor[0]])
        return np.concatenate([v, relative, v - beta * np.abs(v) * z - gamma * v * np.abs(z)])

    found = solve_ivp(rates, (0.0, TIMES[-1]), np.zeros(6), t_eval=TIMES, rtol=1e-9, atol=1e-11, max_step=0.01)
    total = np.array([rates(t, y)[2:4] for t, y in zip(TIMES, found.y.T, strict=True)])
    return np.asarray(np.cumsum(total, axis=1).T + GROUND)


TRUE = floors()
LARGEST = float(np.max(np.abs(TRUE[1])))


def record_of(error: Floats | float) -> Record:
    rng = np.random.default_rng(5)
    shown = TRUE + NOISE * rng.standard_normal(TRUE.shape) + np.vstack([np.zeros(len(TIMES)), error + 0.0 * TIMES])
    channels = {f"acceleration_{i}": own for i, own in enumerate(shown, start=1)}
    return Record(name="shaken", time_step=STEP, excitation=GROUND, channels=channels)


def fitted(record: Record) -> tuple[Posterior, tuple[Mode, ...]]:
    noise = IntegratedNoise(shape=1.0, scale=(NOISE**2, NOISE**2))
    posterior = Posterior(model=MODEL, record=record, engine=Lanes(substeps=4, n_threads=1), noise=noise)
    starts = np.random.default_rng(2).uniform(0.2, 0.8, (6, posterior.space.n_dim))
    return posterior, distinct(*polish(posterior, starts, n_iterations=30))


ERRORS: dict[str, Callable[[], Floats]] = {
    "of what the sensor shows": lambda: 0.7 * LARGEST * np.tanh(TRUE[1] / (0.7 * LARGEST)) - TRUE[1],
    "that changes in time": lambda: 0.15 * LARGEST * np.sin(2.0 * np.pi * TIMES / 5.0),
    "of a gain that changes in time": lambda: -0.3 * TRUE[1] * np.maximum(TIMES / 6.0 - 1.0, 0.0),
}


@pytest.mark.parametrize("kind", ERRORS)
def test_an_error_is_found_in_its_channel_and_as_what_it_is(kind: str) -> None:
    """Saturation, drift and a gain that fades; beside it the parameters are those of the structure."""
    hidden = ERRORS[kind]()
    posterior, modes = fitted(record_of(hidden))
    points = np.array([mode.point for mode in modes])
    found = {one.channel: one for one in reading_errors(posterior, points, UNNAMED_SCALE)}
    gained = {name: laplace(one.posterior, one.modes).log_evidence for name, one in found.items()}
    assert gained["acceleration_2"] > laplace(posterior, modes).log_evidence + 50.0
    assert gained["acceleration_2"] > gained["acceleration_1"] + 50.0
    own = found["acceleration_2"]
    assert own.kind == kind
    assert np.sqrt(np.mean(np.square(own.error - hidden))) < NOISE
    assert leaves_noise(*own.beside(posterior))
    assert not leaves_noise(posterior, modes[0].point)
    values = posterior.space.from_unit(own.modes[0].point[None])[0]
    truth = [0.2 if name.startswith("alpha") else 60.0 for name in posterior.space.names]
    np.testing.assert_allclose(values, truth, rtol=0.03)


def test_such_an_error_is_known_of_other_readings() -> None:
    hidden = ERRORS["of what the sensor shows"]()
    posterior, modes = fitted(record_of(hidden))
    own = reading_errors(posterior, np.array([modes[0].point]), UNNAMED_SCALE)[1]
    assert own.is_of_shown
    shown = np.array([-0.8, -0.3, 0.2, 0.6]) * LARGEST
    expected = 0.7 * LARGEST * np.tanh(shown / (0.7 * LARGEST)) - shown
    np.testing.assert_allclose(own.error_at(shown), expected, atol=2.0 * NOISE)


def test_where_there_is_no_error_none_pays() -> None:
    posterior, modes = fitted(record_of(0.0))
    plain = laplace(posterior, modes).log_evidence
    for one in reading_errors(posterior, np.array([modes[0].point]), UNNAMED_SCALE):
        assert laplace(one.posterior, one.modes).log_evidence < plain - 1.0


def test_size_and_noise_level_are_integrated_out() -> None:
    """By quadrature over both of the normal density of the samples, whose covariance has the functions in it."""
    rng, n = np.random.default_rng(8), 80
    basis = rng.standard_normal((n, 3)) / np.sqrt(3.0)
    left = 0.05 * rng.standard_normal(n) + 0.2 * basis @ rng.standard_normal(3)
    record = Record(name="short", time_step=STEP, excitation=GROUND[:n], channels={"acceleration_1": left})
    noise = IntegratedNoise(shape=2.0, scale=(0.003,))
    posterior = replace(fitted(record_of(0.0))[0], record=record, noise=noise)
    shared = SharedFunctions.of(basis, np.ones(1))
    largest = 0.3
    _, _, total = reading._by_scale(posterior, left[None], 0, shared, largest)
    levels, sizes = np.geomspace(0.03, 0.09, 60), np.geomspace(1e-3, 6.0, 90) * largest
    density = np.array(
        [
            [multivariate_normal.logpdf(left, cov=level**2 * np.eye(n) + size**2 * basis @ basis.T) for size in sizes]
            for level in levels
        ]
    )
    prior = invgamma.logpdf(levels**2, 2.0, scale=0.003)[:, None] + halfnorm.logpdf(sizes, scale=largest)
    steps = np.gradient(levels**2)[:, None] * np.gradient(sizes)
    expected = float(logsumexp(density + prior, b=steps))
    assert total == pytest.approx(expected, abs=0.3)
