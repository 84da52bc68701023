"""Noise beside a force of unknown scale: the mean of its levels, and views of the first samples."""

import numpy as np
import pytest

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.correlation import Correlation, SharedFunctions
from bwbn_bayes.inference.likelihood import IntegratedNoise, Posterior
from bwbn_bayes.inference.scaled import SCALES, ScaledCorrelation
from bwbn_bayes.inference.unnamed.any_scale import NoiseBesideForce, without_force
from bwbn_bayes.parameters import Floats, Uniform
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.specimen import Specimen

N = 60
BASIS = np.sin(np.outer(np.linspace(0.0, 9.0, N), np.arange(1, 5)))
WHITE = IntegratedNoise(shape=2.0, scale=(0.3,))
NOISE = NoiseBesideForce(white=WHITE, correlation=ScaledCorrelation(shared=SharedFunctions.of(BASIS)), largest=5.0)


def squares(residual: Floats) -> Floats:
    """By dense matrices, of each scale."""
    return np.array([residual @ np.linalg.solve(np.eye(N) + s**2 * BASIS @ BASIS.T, residual) for s in SCALES])


def test_squares_and_steps_of_every_scale_are_those_of_dense_matrices() -> None:
    rows = np.random.default_rng(1).standard_normal((2, 3, 1, N))
    found = NOISE.correlation.equations(rows)
    for draw, own in enumerate(rows[:, :, 0]):
        np.testing.assert_allclose(found.misfit[draw], squares(own[0]))
        np.testing.assert_allclose(NOISE.correlation.squares(rows[:, 0])[draw], squares(own[0]))
    weight = np.random.default_rng(2).random((2, len(SCALES)))
    gradient, information = found.weighted(weight)
    inverses = [np.linalg.inv(np.eye(N) + s**2 * BASIS @ BASIS.T) for s in SCALES]
    for draw, (residual, *slopes) in enumerate(rows[:, :, 0]):
        whole = np.tensordot(weight[draw], inverses, axes=1)
        np.testing.assert_allclose(gradient[draw], np.array(slopes) @ whole @ residual)
        np.testing.assert_allclose(information[draw], np.array(slopes) @ whole @ np.array(slopes).T)


def test_levels_are_drawn_from_each_scale_by_its_share() -> None:
    residual = np.random.default_rng(3).standard_normal(N) + BASIS @ [1.0, -2.0, 0.5, 0.0]
    misfit, nothing = squares(residual)[None], np.empty((1, 0))
    alone = [
        WHITE.log_likelihood(misfit[:, i : i + 1], N, nothing)[0]
        - 0.5 * np.linalg.slogdet(np.eye(N) + s**2 * BASIS @ BASIS.T)[1]
        for i, s in enumerate(SCALES)
    ]
    rate = 0.3 + 0.5 * misfit[0]
    share = SCALES / 5.0 * np.sqrt(rate / (2.0 + 0.5 * N))
    weights = np.exp(np.array(alone) - np.max(alone)) * share * np.exp(-0.5 * share**2)
    expected = np.sum(weights / np.sum(weights) * rate / (2.0 + 0.5 * N - 1.0))
    drawn = NOISE.draw_sd(np.random.default_rng(4), np.repeat(misfit, 20000, axis=0), N, np.empty((20000, 0)))
    assert drawn.shape == (20000, 1)
    assert np.mean(np.square(drawn)) == pytest.approx(expected, rel=0.01)
    settled = NOISE.settled(misfit, N)
    assert isinstance(settled.correlation, Correlation) and settled.correlation.shared is not None
    assert settled.correlation.shared.scale == SCALES[np.argmax(weights)]


def test_a_view_of_the_first_samples_knows_of_these_alone() -> None:
    path = 0.02 * np.sin(np.linspace(0.0, 12.0, N))
    force = np.random.default_rng(5).standard_normal(N)
    record = Record(
        name="pushed", time_step=1.0, excitation=path, channels={"force": force}, excitation_kind="displacement"
    )
    model = Specimen(storey=BoucWen(k=Uniform(20, 120), beta=40.0, gamma=10.0))
    posterior = Posterior(model=model, record=record, engine=Lanes(substeps=1, n_threads=1), noise=NOISE)
    points = np.array([[0.3], [0.6]])
    shown = posterior.until(29.0)
    assert shown.record.n_times == 30
    short = NoiseBesideForce(
        white=WHITE, correlation=ScaledCorrelation(shared=SharedFunctions.of(BASIS[:30])), largest=5.0
    )
    expected = Posterior(model=model, record=shown.record, engine=posterior.engine, noise=short)
    np.testing.assert_allclose(shown.log_likelihood(points), expected.log_likelihood(points))
    assert without_force(posterior).noise is WHITE
    assert without_force(without_force(posterior)).noise is WHITE


@pytest.mark.filterwarnings("error")
def test_a_draw_that_ran_away_is_impossible_and_says_nothing() -> None:
    misfit = np.array([np.full(len(SCALES), 40.0), np.full(len(SCALES), np.inf)])
    found = NOISE.log_likelihood(misfit, 50.0, np.empty((2, 0)))
    assert np.isfinite(found[0])
    assert found[1] == -np.inf


def test_no_residuals_have_no_squares() -> None:
    """Of column 222 no draw about an optimum lay inside the prior, and a search ended with an error."""
    none = NOISE.correlation.squares(np.empty((0, 1, len(BASIS))))
    assert none.shape == (0, len(SCALES))
