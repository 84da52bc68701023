"""Blocks left out in turn, or still to come, against fits that never saw them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from bwbn_bayes.discovery.cross_validation import N_BLOCKS, CrossValidation, cross_validated
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.engines.base import Response
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.correlation import Correlation
from bwbn_bayes.inference.likelihood import IntegratedNoise, KnownNoise, Posterior
from bwbn_bayes.inference.modes import polish
from bwbn_bayes.parameters import Floats, Normal, Uniform
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen
from bwbn_bayes.structures.structure import Structure

GROUND = el_centro("chopra", duration=16.0)
STOREY = BoucWen(k=Uniform(20, 120), c=Uniform(0.01, 2.0), alpha=0.2, beta=20.0, gamma=5.0, n=1.0)
MODEL = ShearBuilding(masses=[1.0], storey=STOREY)
ENGINE = Lanes(substeps=2, n_threads=1)
SD = 0.05


def record_of(values: list[float]) -> Record:
    clean = ENGINE.simulate(MODEL, np.array([values]), GROUND, ("acceleration_1",)).values[0, 0]
    noise = SD * np.random.default_rng(4).standard_normal(len(clean))
    return GROUND.with_channels({"acceleration_1": clean + noise})


@pytest.mark.parametrize("ahead", [False, True])
def test_a_linear_model_is_predicted_as_by_fits_to_what_is_known(*, ahead: bool) -> None:
    """Closed form: least squares on the rows outside each block; of a cyclic test on those before it."""
    n, rng = 160, np.random.default_rng(5)
    design = rng.standard_normal((n, 2))
    measured = 0.02 * (design @ [600.0, 400.0]) + 0.3 * rng.standard_normal(n)

    class Linear:
        name = "linear"

        def simulate(self, _: Structure, draws: Floats, record: Record, *__: Any) -> Response:
            values = 0.02 * (draws @ design.T)[:, None]
            return Response(channels=tuple(record.channels), values=values, status=np.zeros(len(draws), dtype=np.int64))

        def sensitivities(self, model: Structure, draws: Floats, record: Record, **_: Any) -> tuple[Response, Floats]:
            slopes = np.repeat((0.02 * design.T)[None, :, None], len(draws), axis=0)
            return self.simulate(model, draws, record), slopes

    engine: Any = Linear()
    element = replace(STOREY, k=Uniform(0, 1000), c=Uniform(0, 1000))
    if ahead:
        model, kind, channel = Specimen(storey=element), "displacement", "force"
    else:
        model, kind, channel = ShearBuilding(masses=[1.0], storey=element), "ground_acceleration", "acceleration_1"
    record = Record(
        name="drawn", time_step=0.1, excitation=np.ones(n), channels={channel: measured}, excitation_kind=kind
    )
    posterior = Posterior(model=model, record=record, engine=engine, noise=KnownNoise(sd=(0.3,)))
    unit, target = 0.02 * design * 1000.0 / 0.3, measured / 0.3
    point = np.linalg.lstsq(unit, target)[0]
    found = cross_validated(posterior, point)
    missed, asked, log_score, ahead_of = 0.0, 0.0, 0.0, []
    every = np.arange(n)
    blocks = np.array_split(every, N_BLOCKS)
    for block in blocks[N_BLOCKS // 2 :] if ahead else blocks:
        known = every[: block[0]] if ahead else np.setdiff1d(every, block)
        fitted = np.linalg.lstsq(unit[known], target[known])[0]
        error = 0.3 * (target - unit @ fitted)
        missed += float(np.sum(np.square(error[block])))
        asked += float(np.sum(np.square(measured[block])))
        level = float(np.mean(np.square(error[known])))
        ahead_of.append(error[block])
        if not ahead:
            log_score += float(np.sum(norm.logpdf(error[block], scale=np.sqrt(level))))
        elif len(ahead_of) == 1:  # what comes before the first, at its own level
            log_score += float(np.sum(norm.logpdf(error[known], scale=np.sqrt(level))))
    if ahead:
        errors = np.concatenate(ahead_of)
        log_score += float(np.sum(norm.logpdf(errors, scale=np.sqrt(np.mean(np.square(errors))))))
    assert found.nrmse == pytest.approx(np.sqrt(missed / asked), rel=1e-9)
    assert found.log_score == pytest.approx(log_score, rel=1e-9)


def test_a_hysteretic_model_is_predicted_as_by_a_fit_to_the_other_blocks() -> None:
    """The step out of the normal equations against a search without the block's samples, at one block."""
    record = record_of([60.0, 0.5])
    posterior = Posterior(model=MODEL, record=record, engine=ENGINE, noise=KnownNoise(sd=(SD,)))
    (point,), _ = polish(posterior, np.full((1, 2), 0.4), n_iterations=30)
    found = cross_validated(posterior, point)
    # Two parameters of 800 samples: what they cost a prediction is far below the noise.
    rms = np.sqrt(np.mean(np.square(record.channels["acceleration_1"])))
    assert found.nrmse == pytest.approx(SD / rms, rel=0.05)
    best = -0.5 * record.n_times * (1.0 + np.log(2.0 * np.pi * SD**2))
    assert found.log_score == pytest.approx(best, abs=4.0 * np.sqrt(0.5 * record.n_times))


def test_a_parameter_that_only_fits_noise_lowers_the_log_score() -> None:
    """On the average over records: each useless parameter costs about half a nat in density and a half in the fit."""
    wider = replace(
        MODEL,
        links=(replace(MODEL.links[0], element=replace(STOREY, gamma=Normal(0.0, 10.0), alpha=Uniform(0.0, 0.9))),),
    )
    differences = []
    for seed in range(12):
        clean = ENGINE.simulate(MODEL, np.array([[60.0, 0.5]]), GROUND, ("acceleration_1",)).values[0, 0]
        noise = SD * np.random.default_rng(seed).standard_normal(len(clean))
        record = GROUND.with_channels({"acceleration_1": clean + noise})
        scores = []
        for model in (MODEL, wider):
            posterior = Posterior(model=model, record=record, engine=ENGINE, noise=KnownNoise(sd=(SD,)))
            (point,), _ = polish(posterior, np.full((1, posterior.n_dim), 0.4), n_iterations=30)
            scores.append(cross_validated(posterior, point).log_score)
        differences.append(scores[1] - scores[0])
    mean, error = np.mean(differences), np.std(differences) / np.sqrt(len(differences))
    assert mean < 0.0
    assert abs(mean + 1.0) < 4.0 * error + 1.0


def test_autoregressive_errors_are_whitened_first() -> None:
    """The same white errors behind a filter: the log score differs by the filter's volume alone, which is one."""
    record = record_of([60.0, 0.5])
    noise = IntegratedNoise(shape=1.0, scale=(SD**2,))
    white = Posterior(model=MODEL, record=record, engine=ENGINE, noise=noise)
    (point,), _ = polish(white, np.full((1, 2), 0.4), n_iterations=30)
    none = white.with_noise(replace(noise, correlation=Correlation(coefficients=(np.empty(0),))))
    assert cross_validated(none, point).log_score == pytest.approx(cross_validated(white, point).log_score)
    wrong = white.with_noise(replace(noise, correlation=Correlation(coefficients=(np.array([0.9]),))))
    assert cross_validated(wrong, point).log_score < cross_validated(white, point).log_score - 50.0


def test_a_model_that_cannot_be_solved_predicts_nothing() -> None:
    record = record_of([60.0, 0.5])
    posterior = Posterior(model=MODEL, record=record, engine=ENGINE, noise=KnownNoise(sd=(SD,)))

    class Lost(Lanes):
        def sensitivities(self, *asked: Any, **options: Any) -> tuple[Response, Floats]:
            found, slopes = super().sensitivities(*asked, **options)
            return replace(found, values=np.full_like(found.values, np.nan)), slopes

    found = cross_validated(posterior.with_engine(Lost(substeps=2, n_threads=1)), np.full(2, 0.5))
    assert (found.log_score, found.nrmse) == (-np.inf, np.inf)


def test_samples_that_are_held_out_have_no_part_in_it() -> None:
    """It chooses what is delivered: whatever was measured at repeat cycles, the score is the same."""
    travel = np.concatenate([size * np.sin(np.linspace(0.0, 4.0 * np.pi, 160)) for size in (0.5, 1.0, 1.5, 2.0)])
    counted = np.arange(len(travel)) % 160 < 80
    model = Specimen(storey=replace(STOREY, c=0.0, alpha=Uniform(0.0, 0.9)))
    test = Record(
        name="test",
        time_step=1.0,
        excitation=travel,
        channels={"force": np.zeros(len(travel))},
        excitation_kind="displacement",
        has_time=False,
    )
    force = ENGINE.simulate(model, np.array([[60.0, 0.3]]), test, ("force",)).values[0, 0]
    force = force + 0.5 * np.random.default_rng(2).standard_normal(len(force))
    found = []
    for held_out in (force, 1e3 + force):
        record = replace(test, channels={"force": np.where(counted, force, held_out)}, counted=counted)
        posterior = Posterior(model=model, record=record, engine=ENGINE, noise=KnownNoise(sd=(0.5,)))
        (point,), _ = polish(posterior, np.full((1, posterior.n_dim), 0.4), n_iterations=30)
        found.append(cross_validated(posterior, point))
    assert found[0] == found[1]
    assert np.isfinite(found[0].log_score)


def test_a_score_is_higher_where_it_is_by_more_than_the_error_of_the_difference() -> None:
    """Of 100 stretches whose differences have the sd 1, the sum has the error 10."""
    differences = np.tile([1.0, -1.0], 50)
    base = CrossValidation(log_scores=tuple(np.linspace(-5.0, 5.0, 100).tolist()), nrmse=0.1)
    for gained, is_better in ((9.0, False), (11.0, True), (-11.0, False)):
        scores = np.asarray(base.log_scores) + differences + 0.01 * gained
        own = CrossValidation(log_scores=tuple(scores.tolist()), nrmse=0.1)
        assert own.log_score == pytest.approx(base.log_score + gained)
        assert own.is_better_than(base) == is_better
    lost = CrossValidation(log_scores=(-np.inf,), nrmse=np.inf)
    assert base.is_better_than(lost)
    assert not lost.is_better_than(base)
    assert not lost.is_better_than(lost)
