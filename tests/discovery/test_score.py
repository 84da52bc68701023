"""Projected scores against least squares on finite differences of the reference engine, and what they promise."""

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from bwbn_bayes.discovery.candidates import Hypothesis, hypotheses, scales_of
from bwbn_bayes.discovery.score import Score, _best, scores
from bwbn_bayes.discovery.workers import Threads
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import CubicStiffness, GapImpact, QuadraticDamping, SensorGain
from bwbn_bayes.engines.base import Response
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.inference.likelihood import KnownNoise, Posterior
from bwbn_bayes.inference.modes import polish
from bwbn_bayes.inference.slopes import Slopes
from bwbn_bayes.parameters import Floats, Uniform
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.structure import Structure

MODEL = ShearBuilding(
    masses=[2.0],
    storey=BoucWen(
        k=Uniform(20, 120), c=Uniform(0.01, 2), alpha=Uniform(0.01, 0.5), beta=Uniform(0.5, 40), gamma=2.0, n=1.3
    ),
)
TRUTH = MODEL.space.to_unit(np.array([[60.0, 0.4, 0.15, 12.0]]))[0]
GROUND = el_centro("chopra", duration=10.0)
ENGINE = Lanes(substeps=2, n_threads=1)
SD = 0.03
CHANNEL = "acceleration_1"
EFFECTS = (CubicStiffness, QuadraticDamping, SensorGain)


def posterior_of(record: Record) -> Posterior:
    """Known noise, so that the gain of a noise-free record is its expectation."""
    return Posterior(model=MODEL, record=record, engine=ENGINE, noise=KnownNoise(sd=(SD,)))


@pytest.fixture(scope="module")
def clean() -> Posterior:
    """The model's own record, without noise."""
    values = ENGINE.simulate(MODEL, MODEL.space.from_unit(TRUTH[None]), GROUND, (CHANNEL,)).values[0]
    return posterior_of(GROUND.with_channels({CHANNEL: values[0]}))


@pytest.fixture(scope="module")
def every(clean: Posterior) -> dict[str, Hypothesis]:
    found = hypotheses(MODEL, scales_of(clean, TRUTH), measured=(CHANNEL,), effects=EFFECTS)
    return {hypothesis.name: hypothesis for hypothesis in found}


@pytest.fixture(scope="module")
def found(clean: Posterior, every: dict[str, Hypothesis]) -> dict[str, Score]:
    return dict(zip(every, scores(clean, list(every.values()), TRUTH), strict=True))


def values_with(hypothesis: Hypothesis, amount: float) -> Floats:
    """The true base parameters and an amplitude above neutral, ``(1, n_parameters)``."""
    model = hypothesis.model
    known = dict(zip(MODEL.space.names, MODEL.space.from_unit(TRUTH[None])[0], strict=True))
    (name,) = hypothesis.brought
    known[name] = hypothesis.neutral(name) + amount
    return np.array([[known[label] for label in model.space.names]])


def with_effect(hypothesis: Hypothesis, amount: float) -> Posterior:
    """The present model given the response of the model with the effect."""
    values = ENGINE.simulate(hypothesis.model, values_with(hypothesis, amount), GROUND, (CHANNEL,)).values[0]
    return posterior_of(GROUND.with_channels({CHANNEL: values[0]}))


@cache
def slopes(hypothesis: Hypothesis, expected: float) -> tuple[Floats, Floats]:
    """Central differences of the reference response by base parameters ``(n_times, n_base)`` and by the amplitude."""
    model, reference = hypothesis.model, Reference()
    centre = values_with(hypothesis, 0.0)[0]
    (name,) = hypothesis.brought
    column = model.space.names.index(name)
    steps = 1e-4 * np.abs(centre)
    # The amplitude is neutral at an end of its range: a one-sided difference of a size that the response hardly feels.
    steps[column] = 1e-4 * expected
    moved = np.concatenate(
        [centre + np.diag(steps), centre - np.diag(np.where(np.arange(len(steps)) == column, 0, steps))]
    )
    rows = reference.simulate(model, moved, GROUND, (CHANNEL,)).values[:, 0]
    up, down = rows[: len(steps)], rows[len(steps) :]
    width = np.where(np.arange(len(steps)) == column, steps, 2.0 * steps)
    difference = ((up - down) / width[:, None]).T
    return np.delete(difference, column, axis=1), difference[:, column]


@pytest.mark.parametrize("name", ["cubic_stiffness", "quadratic_damping", "sensor_gain"])
def test_the_smallest_effect_is_that_of_least_squares(
    name: str, every: dict[str, Hypothesis], found: dict[str, Score]
) -> None:
    """One nat is half the square of what is left of the effect's slope, over the noise, beside the base's slopes."""
    base, own = slopes(every[name], found[name].smallest)
    left = own - base @ np.linalg.lstsq(base, own)[0]
    expected = SD * np.sqrt(2.0) / np.linalg.norm(left)
    assert found[name].smallest == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("name", ["cubic_stiffness", "quadratic_damping", "sensor_gain"])
def test_the_score_is_what_least_squares_gains(
    name: str, every: dict[str, Hypothesis], found: dict[str, Score]
) -> None:
    """A noisy record with a small effect, at the present model's optimum: residual against both sets of slopes."""
    hypothesis = every[name]
    hidden = with_effect(hypothesis, 5.0 * found[name].smallest)
    noise = SD * np.random.default_rng(1).standard_normal(GROUND.n_times)
    posterior = replace(hidden, record=hidden.record.with_channels({CHANNEL: hidden.record.channels[CHANNEL] + noise}))
    (point,), _ = polish(posterior, TRUTH[None], n_iterations=20)
    (score,) = scores(posterior, [hypothesis], point)
    base, own = slopes(hypothesis, found[name].smallest)
    at_point = ENGINE.simulate(MODEL, MODEL.space.from_unit(point[None]), GROUND, (CHANNEL,)).values[0, 0]
    residual = posterior.record.channels[CHANNEL] - at_point
    energies = []
    for design in (base, np.column_stack([base, own])):
        left = residual - design @ np.linalg.lstsq(design, residual)[0]
        energies.append(float(left @ left))
    gained = (energies[0] - energies[1]) / (2.0 * SD**2)
    # Slopes at the truth and at the optimum differ a little.
    assert score.nats == pytest.approx(gained, rel=0.1)
    assert score.amplitude == hypothesis.brought[0]


@pytest.mark.parametrize("nats", [8.0, 25.0])
@pytest.mark.parametrize("name", ["cubic_stiffness", "quadratic_damping", "sensor_gain"])
def test_an_effect_at_the_detection_limit_gains_what_was_promised(
    name: str, nats: float, every: dict[str, Hypothesis], found: dict[str, Score]
) -> None:
    """The record has the effect and no noise: what the present model's best fit lacks to a perfect fit is the gain."""
    posterior = with_effect(every[name], found[name].smallest * np.sqrt(nats))
    _, local = polish(posterior, TRUTH[None], n_iterations=30)
    perfect = posterior.noise.log_likelihood(np.zeros((1, 1)), GROUND.n_times, np.empty((1, 0)))[0]
    assert perfect - local.log_likelihood[0] == pytest.approx(nats, rel=0.3)


@pytest.mark.parametrize("prior_sd", [0.02, 0.3, 5.0])
def test_the_detection_limit_is_where_the_bayes_factor_of_a_normal_prior_reaches_the_odds(prior_sd: float) -> None:
    """Of one Gaussian measurement of the amplitude with sd 0.1, for which evidence is a normal density."""
    sd = 0.1
    seen = Score(nats=0.0, amplitude="a", unit="", smallest=sd * np.sqrt(2.0), size=0.0).named_from(12.0, prior_sd)
    assert norm.logpdf(seen, 0.0, np.hypot(sd, prior_sd)) - norm.logpdf(seen, 0.0, sd) == pytest.approx(12.0)
    assert Score(nats=0.0, amplitude="a", unit="", smallest=np.inf, size=0.0).named_from(12.0, prior_sd) == np.inf


@pytest.mark.parametrize("name", ["cubic_stiffness", "quadratic_damping", "sensor_gain"])
def test_a_score_starts_where_the_effect_is_not(name: str, clean: Posterior, every: dict[str, Hypothesis]) -> None:
    """However small an amount the noise would show: far less than what the amplitude is moved by for its slope."""
    sd = 1e-7
    quiet = replace(clean, noise=KnownNoise(sd=(sd,)))
    (at_truth,) = scores(quiet, [every[name]], TRUTH)
    hidden = with_effect(every[name], 5.0 * at_truth.smallest).record
    (score,) = scores(replace(quiet, record=hidden), [every[name]], TRUTH)
    assert score.nats == pytest.approx(25.0, rel=0.05)


def test_one_sided_amplitudes_gain_on_their_side_only(every: dict[str, Hypothesis], found: dict[str, Score]) -> None:
    """A damper that would have to be negative explains nothing; a spring may be softening."""
    damper, spring = every["quadratic_damping"], every["cubic_stiffness"]
    unit = found["quadratic_damping"].smallest
    # The response is linear in so little: what a damper adds is taken away instead.
    added = with_effect(damper, 5.0 * unit).record.channels[CHANNEL]
    own = with_effect(damper, 0.0).record.channels[CHANNEL]
    for sign, size in ((1.0, 25.0), (-1.0, 0.0)):
        posterior = posterior_of(GROUND.with_channels({CHANNEL: own + sign * (added - own)}))
        (score,) = scores(posterior, [damper], TRUTH)
        assert score.nats == pytest.approx(size, rel=0.2)
    for sign in (1.0, -1.0):
        amount = 5.0 * sign * found["cubic_stiffness"].smallest
        (score,) = scores(with_effect(spring, amount), [spring], TRUTH)
        assert score.nats == pytest.approx(25.0, rel=0.2)
        assert score.size == pytest.approx(amount, rel=0.2)


def test_the_size_is_that_of_the_best_of_the_grid(every: dict[str, Hypothesis]) -> None:
    """Not that of the point where the least could be seen, which may be another."""
    spring = every["cubic_stiffness"]
    best = _best(spring, spring.amplitudes[0], np.array([[2.0, 4.0], [-30.0, 1.0], [0.0, 0.0]]))
    assert (best.nats, best.size, best.smallest) == (450.0, -30.0, np.sqrt(0.5))


def test_noise_alone_scores_half_a_nat(clean: Posterior, every: dict[str, Hypothesis]) -> None:
    """Twice the score of one two-sided amplitude is chi-square with one degree: 40 records know its mean to 0.22."""
    doubled = []
    for seed in range(40):
        noise = SD * np.random.default_rng([3, seed]).standard_normal(GROUND.n_times)
        record = clean.record.with_channels({CHANNEL: clean.record.channels[CHANNEL] + noise})
        posterior = replace(clean, record=record)
        (score,) = scores(posterior, [every["cubic_stiffness"]], TRUTH)
        doubled.append(2.0 * score.nats)
    assert abs(np.mean(doubled) - 1.0) < 4.0 * np.sqrt(2.0 / 40)
    assert max(doubled) < 12.0


def test_the_order_and_the_number_of_workers_do_not_matter(clean: Posterior, every: dict[str, Hypothesis]) -> None:
    noise = SD * np.random.default_rng(4).standard_normal(GROUND.n_times)
    record = clean.record.with_channels({CHANNEL: clean.record.channels[CHANNEL] + noise})
    posterior, listed = replace(clean, record=record), list(every.values())
    one = scores(posterior, listed, TRUTH)
    assert scores(posterior, listed[::-1], TRUTH, workers=Threads(2)) == one[::-1]


@dataclass(frozen=True, kw_only=True)
class Failing(Lanes):
    """Cannot solve those draws whose gap is at least the given one; their response is NaN, as of a failed solve."""

    gap: float

    def simulate(self, model: Structure, draws: Floats, *given: Any, **options: Any) -> Response:
        response = super().simulate(model, draws, *given, **options)
        if "g" not in model.space.names:
            return response
        failed = draws[:, model.space.names.index("g")] >= self.gap
        return replace(response, values=np.where(failed[:, None, None], np.nan, response.values))


def test_a_grid_point_that_cannot_be_solved_scores_nothing(clean: Posterior) -> None:
    """The best of the grid falls away point by point; where none is left, the record cannot show the effect."""
    every = hypotheses(MODEL, scales_of(clean, TRUTH), measured=(CHANNEL,), effects=(GapImpact,))
    (two_sided,) = [h for h in every if h.effect.form == "two-sided"]
    noise = SD * np.random.default_rng(6).standard_normal(GROUND.n_times)
    record = clean.record.with_channels({CHANNEL: clean.record.channels[CHANNEL] + noise})
    gaps = sorted(
        two_sided.model.space.from_unit(two_sided.neutral_points(TRUTH, two_sided.amplitudes[0], 1e-3))[
            :, two_sided.model.space.names.index("g")
        ]
    )
    found = []
    for gap in (*gaps, np.inf):
        posterior = replace(clean, record=record, engine=Failing(gap=gap, substeps=2, n_threads=1))
        found += scores(posterior, [two_sided], TRUTH)
    (own,) = scores(replace(clean, record=record), [two_sided], TRUTH)
    assert found[0].nats == 0.0
    assert np.isinf(found[0].smallest)
    assert found[-1] == own
    assert own.nats > 0.0
    assert np.all(np.isfinite([score.smallest for score in found[1:]]))
    assert np.all(np.diff([score.nats for score in found]) >= 0.0)
    assert np.all(np.diff([score.smallest for score in found[1:]]) <= 1e-12)  # two that are alike, to rounding


def test_directions_are_those_of_the_normal_equations_without_the_base() -> None:
    """Base parameters of prior precision 12 widen the noise to ``I + B B^T / 12``: its inverse weighs directions."""
    rng = np.random.default_rng(8)
    n_base, n = 3, 40
    shape = (n, 2, 30)
    level, measured, values = np.array([0.1, 0.4]), rng.standard_normal(shape[1:]), rng.standard_normal(shape)
    base, own = rng.standard_normal((60, n_base)), rng.standard_normal(shape)
    channels = {f"acceleration_{floor}": row for floor, row in enumerate(measured, 1)}
    record, noise = Record(name="two", time_step=0.1, excitation=np.ones(30), channels=channels), level[:, None]
    slopes = Slopes(record=record, noise=level, base=base, residual=measured / noise)
    values[3], values[5, 0, 2], own[7], own[9] = np.nan, np.inf, 0.0, (base[:, 0].reshape(2, 30) * noise)
    found = slopes.projected(values, own)
    wide = np.linalg.inv(np.eye(60) + base @ base.T / 12.0)
    for number, (gradient, information) in enumerate(found):
        if number in (3, 5, 7):
            assert gradient == information == 0.0
            continue
        column, residual = (own[number] / noise).ravel(), ((measured - values[number]) / noise).ravel()
        assert gradient == pytest.approx(column @ wide @ residual, rel=1e-9)
        assert information == pytest.approx(column @ wide @ column, rel=1e-9)
