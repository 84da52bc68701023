"""The race: a planted effect wins and stays ahead, and what is shared to save time changes no fit."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from bwbn_bayes.discovery import race as racing
from bwbn_bayes.discovery.candidates import Hypothesis, hypotheses, scales_of
from bwbn_bayes.discovery.family import Family
from bwbn_bayes.discovery.pace import Pace
from bwbn_bayes.discovery.race import Fit, race
from bwbn_bayes.discovery.workers import Threads
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import (
    CubicStiffness,
    InputScale,
    MassError,
    QuadraticDamping,
    SensorGain,
    StiffnessDegradation,
)
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.inference.likelihood import Linearisation, Posterior, default_noise
from bwbn_bayes.inference.modes import polish
from bwbn_bayes.parameters import Floats, PerStorey, Uniform
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.structures.shear_building import ShearBuilding

MODEL = ShearBuilding(
    masses=[2.0, 1.0],
    storey=BoucWen(
        k=PerStorey(Uniform(20, 120)), c=Uniform(0.01, 2), alpha=Uniform(0.01, 0.5), beta=12.0, gamma=2.0, n=1.3
    ),
)
TRUTH = {"k[1]": 60.0, "k[2]": 50.0, "c": 0.4, "alpha": 0.15}
K3 = 1000.0
"""At storey 2. [N/m^3]"""
GROUND = el_centro("chopra", duration=8.0)
ENGINE = Lanes(resolution=0.5, cut_at_turns=False, n_threads=1)
CHANNELS = ("acceleration_1", "acceleration_2")
EFFECTS = (CubicStiffness, QuadraticDamping, StiffnessDegradation, MassError, SensorGain, InputScale)
SD = 0.05
"""Noise on both floors. [m/s^2]"""


@pytest.fixture(scope="module")
def clean() -> Floats:
    """Response with the cubic spring by the reference engine."""
    hidden = MODEL.with_effect(CubicStiffness(k3=K3), storeys=[2])
    return Reference().simulate(hidden, hidden.draws(TRUTH), GROUND, CHANNELS).values[0]


@pytest.fixture(scope="module")
def present(clean: Floats) -> Posterior:
    measured = clean + SD * np.random.default_rng(1).standard_normal(clean.shape)
    record = GROUND.with_channels(dict(zip(CHANNELS, measured, strict=True)))
    return Posterior(model=MODEL, record=record, engine=ENGINE, noise=default_noise(record))


@pytest.fixture(scope="module")
def base_points(present: Posterior) -> Floats:
    """Fits of the present model to the whole record and to its first half."""
    start = MODEL.space.to_unit(np.array([[TRUTH[name] for name in MODEL.space.names]]))
    whole, young = (polish(view, start, n_iterations=30)[0] for view in (present, present.until(4.0)))
    return np.concatenate([whole, young])


@pytest.fixture(scope="module")
def every(present: Posterior, base_points: Floats) -> tuple[Hypothesis, ...]:
    return hypotheses(MODEL, scales_of(present, base_points[0]), measured=CHANNELS, effects=EFFECTS)


@pytest.fixture(scope="module")
def fits(present: Posterior, every: tuple[Hypothesis, ...], base_points: Floats) -> tuple[Fit, ...]:
    return race(present, every, base_points)


def is_planted(hypothesis: Hypothesis) -> bool:
    return (hypothesis.name, hypothesis.storeys) == ("cubic_stiffness", (2,))


def test_the_planted_effect_wins(fits: tuple[Fit, ...], present: Posterior, clean: Floats) -> None:
    """Its fit is as good as the truth is, and better than the truth by no more than its coordinates are worth."""
    first, second = fits[:2]
    assert is_planted(first.hypothesis)
    assert first.log_likelihood > second.log_likelihood + 20.0
    noise = np.stack(list(present.record.channels.values())) - clean
    at_truth = present.noise.log_likelihood(np.sum(noise**2, axis=1)[None], GROUND.n_times, np.empty((1, 0)))[0]
    # Twice the gain over the truth is chi-square with one degree for each of five coordinates.
    assert -0.1 < first.log_likelihood - at_truth < 0.5 * (5.0 + 4.0 * np.sqrt(10.0))


def test_the_size_found_is_the_size_planted(fits: tuple[Fit, ...]) -> None:
    (mode, *_), space = fits[0].modes, fits[0].posterior.space
    sds = np.sqrt(np.diag(np.linalg.inv(mode.information))) * space.unit_scale(space.from_unit(mode.point[None]))[0]
    found = dict(zip(space.names, zip(space.from_unit(mode.point[None])[0], sds, strict=True), strict=True))
    for name, truth in {**TRUTH, "k3[2]": K3}.items():
        value, sd = found[name]
        assert abs(value - truth) < 4.0 * sd, name
    assert found["k3[2]"][1] < 0.1 * K3


def test_every_hypothesis_has_a_fit_and_the_best_comes_first(
    fits: tuple[Fit, ...], every: tuple[Hypothesis, ...]
) -> None:
    assert {fit.hypothesis for fit in fits} == set(every)
    likelihoods = [fit.log_likelihood for fit in fits]
    assert likelihoods == sorted(likelihoods, reverse=True)
    for fit in fits:
        assert fit.points.shape[1] == fit.hypothesis.model.space.n_dim == fit.posterior.n_dim
        np.testing.assert_allclose(fit.posterior.log_likelihood(fit.points), fit.local.log_likelihood, atol=0.01)
        np.testing.assert_array_equal(fit.best(1)[0], fit.modes[0].point)


def test_no_effect_fits_worse_than_none(fits: tuple[Fit, ...], present: Posterior, base_points: Floats) -> None:
    """Every hypothesis holds the present model as its neutral case."""
    (without,) = present.log_likelihood(base_points[:1])
    # They start a thousandth of the prior from neutral, and most take two iterations only.
    assert all(fit.log_likelihood > without - 1.0 for fit in fits)


def test_later_rounds_keep_the_planted_effect(
    present: Posterior, every: tuple[Hypothesis, ...], base_points: Floats, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With room for four of sixteen in the last round it is among them, and alone is told as the best by then."""
    entered: list[tuple[int, Hypothesis]] = []
    whole = racing._fit_family

    def noted(
        posterior: Posterior,
        family: Family,
        points: Sequence[Floats],
        n_iterations: int,
        local: Linearisation | None = None,
    ) -> list[Fit]:
        entered.extend((n_iterations, member) for member in family.members)
        return whole(posterior, family, points, n_iterations, local)

    monkeypatch.setattr(racing, "_fit_family", noted)
    monkeypatch.setattr(racing, "in_reach", list)
    monkeypatch.setattr(racing, "_LEAST", 1)
    monkeypatch.setattr(racing, "ROUNDS", ((2, 1.0), (4, 0.4), (25, 0.2)))
    told: list[str] = []
    fits = race(present, every, base_points, progress=told.append)
    numbers = [n for n, _ in entered]
    assert [numbers.count(n) for n in (2, 4, 25)] == [15, 13, 4]
    assert all(any(is_planted(h) for n, h in entered if n == wanted) for wanted in (2, 4, 25))
    assert is_planted(fits[0].hypothesis)
    assert told[-1] == "best so far: cubic stiffness in storey 2"
    assert len(told) == 3


def test_every_storey_alike_is_tried_of_the_leading_forms_only(
    present: Posterior, every: tuple[Hypothesis, ...], base_points: Floats, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cubic spring leads at one storey, so that it alone is tried in both; where it was planted stays ahead."""
    monkeypatch.setattr(racing, "_LEADING_FORMS", 1)
    fits = race(present, every, base_points)
    assert [fit.hypothesis.name for fit in fits if len(fit.hypothesis.storeys) > 1] == ["cubic_stiffness"]
    assert is_planted(fits[0].hypothesis)
    assert len(fits) == 16


def test_what_cannot_come_near_a_fit_that_leaves_noise_is_fitted_no_further(
    fits: tuple[Fit, ...],
    present: Posterior,
    every: tuple[Hypothesis, ...],
    base_points: Floats,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The planted effect is; fitted to the end, those left behind stay tens of nats behind all the same."""
    assert fits[0].leaves_noise
    left_behind = {fit.hypothesis for fit in fits} - {fit.hypothesis for fit in racing.in_reach(fits)}
    assert len(left_behind) > len(every) / 2
    monkeypatch.setattr(racing, "in_reach", list)
    monkeypatch.setattr(racing, "ROUNDS", ((2, 1.0), (4, 1.0), (25, 1.0)))
    to_the_end = race(present, every, base_points)
    assert to_the_end[0].log_likelihood == pytest.approx(fits[0].log_likelihood, abs=0.1)
    near = [fit for fit in to_the_end if fit.log_likelihood > to_the_end[0].log_likelihood - 20.0]
    assert not left_behind & {fit.hypothesis for fit in near}


def test_families_fit_their_members_as_well_as_each_is_fitted_alone(
    present: Posterior, every: tuple[Hypothesis, ...], base_points: Floats, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those that are fitted to the end; 0.1 nat is far below what a decision turns on."""
    monkeypatch.setattr(racing, "in_reach", list)
    fits = race(present, every, base_points)
    shared = [fit for fit in fits if len(fit.hypothesis.storeys) == 1][:6]
    assert len({fit.hypothesis.name for fit in shared}) < len(shared)
    for fit in shared:
        (alone,) = race(present, [fit.hypothesis], base_points)
        assert fit.log_likelihood == pytest.approx(alone.log_likelihood, abs=0.1), fit.hypothesis.label


def test_the_number_of_workers_changes_nothing(
    fits: tuple[Fit, ...], present: Posterior, every: tuple[Hypothesis, ...], base_points: Floats
) -> None:
    again = race(present, every, base_points, pace=Pace(workers=Threads(3)))
    assert [fit.hypothesis for fit in again] == [fit.hypothesis for fit in fits]
    for one, other in zip(fits, again, strict=True):
        np.testing.assert_array_equal(one.points, other.points)


def test_where_little_is_missing_the_scores_own_steps_are_enough(
    clean: Floats, present: Posterior, every: tuple[Hypothesis, ...], base_points: Floats
) -> None:
    """A hundredth of the spring, so that slopes tell all: no guessed sizes, the same optima."""
    hidden = MODEL.with_effect(CubicStiffness(k3=0.01 * K3), storeys=[2])
    faint = Reference().simulate(hidden, hidden.draws(TRUTH), GROUND, CHANNELS).values[0]
    measured = faint + SD * np.random.default_rng(2).standard_normal(clean.shape)
    record = present.record.with_channels(dict(zip(CHANNELS, measured, strict=True)))
    posterior = replace(present, record=record)
    points, _ = polish(posterior, base_points, n_iterations=20)
    found = {
        guess: {f.hypothesis: f.log_likelihood for f in race(posterior, every, points, guess=guess)[:4]}
        for guess in (True, False)
    }
    for hypothesis in found[True].keys() & found[False].keys():
        assert found[False][hypothesis] == pytest.approx(found[True][hypothesis], abs=0.1)
    assert max(found[False].values()) == pytest.approx(max(found[True].values()), abs=0.1)


def test_a_family_of_more_members_than_a_block_holds_is_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """An effect at one of 17 storeys: no start was left of any, and the search ended in a ValueError."""
    monkeypatch.setattr(racing, "ROUNDS", ((1, 1.0),))
    tower = ShearBuilding(masses=[1.0] * 17, storey=BoucWen(k=Uniform(2e3, 8e3), c=1.0, alpha=0.5, beta=1.0, gamma=1.0))
    ground, point = el_centro("chopra", duration=2.0), np.array([0.5])
    values = ENGINE.simulate(tower, tower.space.from_unit(point[None]), ground, ("acceleration_17",)).values[0]
    noise = SD * np.random.default_rng(1).standard_normal(ground.n_times)
    record = ground.with_channels({"acceleration_17": values[0] + noise})
    posterior = Posterior(model=tower, record=record, engine=ENGINE, noise=default_noise(record))
    found = hypotheses(tower, scales_of(posterior, point), measured=("acceleration_17",), effects=(QuadraticDamping,))
    at_one = [hypothesis for hypothesis in found if len(hypothesis.storeys) == 1]
    assert {fit.hypothesis for fit in race(posterior, at_one, point[None])} == set(at_one)
    assert len(at_one) == 17


def test_nothing_to_race(present: Posterior, base_points: Floats) -> None:
    told: list[str] = []
    assert race(present, (), base_points, progress=told.append) == ()
    assert told == []
