"""A size that its prior holds back, and a fit to which no start led: both are found on the second look."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scipy import stats

from bwbn_bayes.discovery import second_look
from bwbn_bayes.discovery.candidates import Hypothesis, scales_of
from bwbn_bayes.discovery.race import Fit, race
from bwbn_bayes.discovery.second_look import crossed, leading, rescanned, searched, widened
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import CubicStiffness, StoreyParameter, SuddenDamage
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.elements.search_guide import guide_of
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import polish
from bwbn_bayes.parameters import Floats, Normal, Uniform
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.structures.shear_building import ShearBuilding

MODEL = ShearBuilding(
    masses=[1.0, 1.0],
    storey=BoucWen(
        k=Uniform(20, 120), c=Uniform(0.01, 2), alpha=Uniform(0.01, 0.5), beta=12.0, gamma=Uniform(-5, 11), n=1.3
    ),
)
TRUTH = {"k": 60.0, "c": 0.4, "alpha": 0.15, "gamma": 2.0}
HIDDEN = StoreyParameter(parameter="gamma", offset=20.0)
SIZE = 20.0
GROUND = el_centro("chopra", duration=8.0)
CHANNELS = ("acceleration_1", "acceleration_2")
SD = 0.02
"""Noise on both floors. [m/s^2]"""


@pytest.fixture(scope="module")
def clean() -> Floats:
    """Response with the offset by the reference engine."""
    hidden = MODEL.with_effect(HIDDEN, storeys=[2])
    return Reference().simulate(hidden, hidden.draws(TRUTH), GROUND, CHANNELS).values[0]


@pytest.fixture(scope="module")
def present(clean: Floats) -> Posterior:
    measured = clean + SD * np.random.default_rng(1).standard_normal(clean.shape)
    record = GROUND.with_channels(dict(zip(CHANNELS, measured, strict=True)))
    return Posterior(model=MODEL, record=record, engine=Lanes(n_threads=1), noise=default_noise(record))


@pytest.fixture(scope="module")
def base_points(present: Posterior) -> Floats:
    start = MODEL.space.to_unit(np.array([[TRUTH[name] for name in MODEL.space.names]]))
    return polish(present, start, n_iterations=30)[0]


def at(present: Posterior, base_points: Floats, effect: Effect, storey: int) -> Hypothesis:
    scales = scales_of(present, base_points[0])[storey - 1]
    return Hypothesis(base=MODEL, effect=effect, storeys=(storey,), scales=scales, guide=guide_of(type(effect)))


def hypothesis(present: Posterior, base_points: Floats, effect: Effect) -> Hypothesis:
    return at(present, base_points, effect, storey=2)


def narrow(present: Posterior, base_points: Floats, sd: float) -> Fit:
    """The fit under a normal prior of that width."""
    effect = StoreyParameter(parameter="gamma", offset=Normal(0.0, sd))
    (fit,) = race(present, [hypothesis(present, base_points, effect)], base_points)
    return fit


def log_likelihood_of_truth(present: Posterior, clean: Floats) -> float:
    noise = np.stack(list(present.record.channels.values())) - clean
    sums = np.sum(noise**2, axis=1)[None]
    return float(present.noise.log_likelihood(sums, GROUND.n_times, np.empty((1, 0)))[0])


def size_of(fit: Fit) -> tuple[float, float]:
    """Offset at the best fit and its standard deviation there."""
    space, mode = fit.posterior.space, fit.modes[0]
    column = space.names.index("gamma_offset[2]")
    values = space.from_unit(mode.point[None])
    sds = np.sqrt(np.diag(np.linalg.inv(mode.information))) * space.unit_scale(values)[0]
    return float(values[0, column]), float(sds[column])


def test_a_prior_that_holds_a_size_back_is_widened(present: Posterior, base_points: Floats, clean: Floats) -> None:
    """A prior of sd 4 ends at 4 x 4.75 in the unit cube; the truth is 20."""
    stuck = narrow(present, base_points, 4.0)
    assert size_of(stuck)[0] < 4.0 * stats.norm.ppf(1.0 - 1e-6) + 0.1
    (free,) = widened([stuck], n_threads=1)
    size, sd = size_of(free)
    assert abs(size - SIZE) < 4.0 * sd
    assert sd < 3.0
    assert abs(free.log_likelihood - log_likelihood_of_truth(present, clean)) < 0.5 * (5.0 + 4.0 * np.sqrt(10.0))
    effect = free.hypothesis.effect
    assert isinstance(effect, StoreyParameter)
    assert effect.offset == Normal(0.0, 16.0)
    assert free.hypothesis.symbols == stuck.hypothesis.symbols
    assert free.posterior.model is free.hypothesis.model


def test_a_prior_that_holds_nothing_back_stays(present: Posterior, base_points: Floats) -> None:
    fit = narrow(present, base_points, 10.0)
    (same,) = widened([fit], n_threads=1)
    assert same is fit


def test_a_fit_to_which_no_start_led_is_found(present: Posterior, base_points: Floats, clean: Floats) -> None:
    """The points are as far off as prior draws are, and not fitted at all; another effect leads."""
    own = hypothesis(present, base_points, StoreyParameter(parameter="gamma", offset=Normal(0.0, 10.0)))
    posterior = present.with_model(own.model)
    points = posterior.sample_prior(np.random.default_rng(2), 4)
    lost = Fit(hypothesis=own, posterior=posterior, points=points, local=posterior.linearise(points))
    other = hypothesis(present, base_points, CubicStiffness(k3=Normal(0.0, 1000.0)))
    (ahead,) = race(present, [other], base_points)
    assert ahead.log_likelihood > lost.log_likelihood + 100.0
    first, second = searched([ahead, lost], np.random.default_rng(3), n_threads=2)
    assert first.hypothesis is own
    assert second.log_likelihood >= ahead.log_likelihood - 0.1
    assert abs(first.log_likelihood - log_likelihood_of_truth(present, clean)) < 0.5 * (5.0 + 4.0 * np.sqrt(10.0))
    assert abs(size_of(first)[0] - SIZE) < 4.0 * size_of(first)[1]


def stand_in(log_likelihood: float, n_symbols: int, name: str, *storeys: int) -> Fit:
    """What the order of fits is made of."""
    hypothesis = SimpleNamespace(symbols=tuple(f"{name}{n}" for n in range(n_symbols)), storeys=storeys)
    return cast(Fit, SimpleNamespace(hypothesis=hypothesis, log_likelihood=log_likelihood))


def test_every_place_of_every_leading_form_may_be_held_back_by_its_prior(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a pinch led, an offset of gamma was widened at the wrong storey only."""
    pinch, wrong, right = stand_in(9.0, 6, "pinch", 1), stand_in(5.0, 1, "gamma", 1), stand_in(2.0, 1, "gamma", 2)
    monkeypatch.setattr(
        second_look, "_widened", lambda own, *_, **__: stand_in(8.4, 1, "gamma", 2) if own is right else own
    )
    found = widened([pinch, wrong, right], n_threads=1)
    assert [fit.log_likelihood for fit in found] == [9.0, 8.4, 5.0]


def test_effects_of_many_parameters_are_searched_for_wherever_they_stand(monkeypatch: pytest.MonkeyPatch) -> None:
    """Foliente's pinch: no grid covers it, so that the race may have led it nowhere at any storey."""
    ahead = [stand_in(90.0 - n, 1, f"effect {n} ", 1) for n in range(10)]
    behind = [stand_in(3.0 - n, 6, "pinch ", n) for n in (1, 2, 3)]
    everywhere = stand_in(-1.0, 6, "pinch ", 1, 2, 3)
    looked: list[Fit] = []
    monkeypatch.setattr(second_look, "_searched", lambda own, *_, **__: (looked.append(own), own)[1])
    found = searched([*ahead, *behind, everywhere], np.random.default_rng(1), n_threads=1)
    assert list(found) == [*ahead, *behind, everywhere]
    assert looked == [*ahead[: second_look._SEARCHED], *behind]


def test_the_leading_fits_are_the_best_of_each_form(present: Posterior, base_points: Floats) -> None:
    """Of the first form at every place."""
    priors = (StoreyParameter(parameter="gamma", offset=Normal(0.0, 10.0)), CubicStiffness(k3=Normal(0.0, 1000.0)))
    every = [hypothesis(present, base_points, effect) for effect in priors]
    every += [replace(every[0], storeys=(1,)), replace(every[1], storeys=(1,))]
    fits = race(present, every, base_points)
    gamma, spring = (effect.name for effect in priors)
    assert fits[0].hypothesis.name == gamma
    found = leading(fits)
    assert found[0] is fits[0]
    assert [fit.hypothesis.name for fit in found] == [gamma, gamma, spring]
    assert {fit.hypothesis.storeys for fit in found[:2]} == {(1,), (2,)}
    assert found[2] is next(fit for fit in fits if fit.hypothesis.name == spring)


def test_a_place_held_back_by_its_prior_is_looked_at_though_another_leads(
    present: Posterior, base_points: Floats
) -> None:
    """At the wrong storey a wide prior lets the fit go where the right one, held back, cannot follow."""
    stuck = narrow(present, base_points, 0.5)
    wide = StoreyParameter(parameter="gamma", offset=Normal(0.0, 10.0))
    elsewhere = replace(hypothesis(present, base_points, wide), storeys=(1,))
    (wrong,) = race(present, [elsewhere], base_points)
    assert wrong.log_likelihood > stuck.log_likelihood
    first, second = widened([wrong, stuck], n_threads=1)
    assert first.hypothesis.storeys == (2,)
    assert abs(size_of(first)[0] - SIZE) < 4.0 * size_of(first)[1]
    assert second is wrong


def test_a_time_between_two_starts_is_found(base_points: Floats) -> None:
    """A spring that breaks at 4.1 s; the fit sits in a local optimum three seconds later."""
    hidden = MODEL.with_effect(SuddenDamage(parameter="k", jump=-8.0, time=4.1), storeys=[1])
    response = Reference().simulate(hidden, hidden.draws(TRUTH), GROUND, CHANNELS).values[0]
    measured = response + SD * np.random.default_rng(4).standard_normal(response.shape)
    record = GROUND.with_channels(dict(zip(CHANNELS, measured, strict=True)))
    present = Posterior(model=MODEL, record=record, engine=Lanes(n_threads=1), noise=default_noise(record))
    effect = SuddenDamage(parameter="k", jump=Normal(0.0, 20.0), time=Uniform(0.5, 8.0))
    own = at(present, base_points, effect, storey=1)
    posterior = present.with_model(own.model)
    known = dict(zip(MODEL.space.names, MODEL.space.from_unit(base_points)[0].tolist(), strict=True))
    values = [{**known, "k_jump[1]": -1.0, "k_time[1]": 7.0}[name] for name in posterior.space.names]
    points, local = polish(posterior, posterior.space.to_unit(np.array([values])), n_iterations=25)
    stuck = Fit(hypothesis=own, posterior=posterior, points=points, local=local)
    exact = log_likelihood_of_truth(present, response)
    assert stuck.log_likelihood < exact - 1000.0
    (found,) = rescanned([stuck], n_threads=1)
    assert abs(found.log_likelihood - exact) < 5.0
    # Before 4.1 s the storey stands still for a while: a jump at 3.93 s does the same.
    times = posterior.space.from_unit(found.best(2))[:, posterior.space.names.index("k_time[1]")]
    assert np.min(np.abs(times - 4.1)) < 0.05


def test_a_fit_stays_where_no_value_of_a_scan_is_admitted(
    present: Posterior, base_points: Floats, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What priors admit together may lie between two of the values."""
    own = at(present, base_points, SuddenDamage(parameter="k", jump=Normal(0.0, 20.0), time=Uniform(0.5, 8.0)), 1)
    (fit,) = race(present, [own], base_points)
    monkeypatch.setattr(type(present.space), "log_prior_unit", lambda _, points: np.full(len(points), -np.inf))
    assert rescanned([fit], n_threads=1) == (fit,)


def test_a_form_starts_beside_what_another_form_of_its_effect_makes_of_the_rest() -> None:
    """A step in time was fitted five seconds late beside a fit bent by its lack; a ramp had found the place already."""
    hidden = MODEL.with_effect(SuddenDamage(parameter="k", jump=-25.0, time=2.6), storeys=[2])
    clean = Reference().simulate(hidden, hidden.draws(TRUTH), GROUND, CHANNELS).values[0]
    measured = clean + SD * np.random.default_rng(2).standard_normal(clean.shape)
    record = GROUND.with_channels(dict(zip(CHANNELS, measured, strict=True)))
    present = Posterior(model=MODEL, record=record, engine=Lanes(n_threads=1), noise=default_noise(record))
    points = polish(present, MODEL.space.to_unit(np.array([[60.0, 0.4, 0.15, 2.0]])), n_iterations=30)[0]
    scales = scales_of(present, points[0])[1]
    step, ramp = (
        Hypothesis(base=MODEL, effect=effect, storeys=(2,), scales=scales, guide=guide_of(SuddenDamage))
        for effect in guide_of(SuddenDamage).priors(scales)
    )
    (leads,) = race(present, [ramp], points)
    under = present.with_model(step.model)
    weaker = step.neutral_points(points[0], step.amplitudes[0], -0.19)
    late = under.space.to_unit(np.append(under.space.from_unit(weaker)[0][:-1], 6.5)[None])
    found, local = polish(under, late, n_iterations=1)
    stuck = Fit(hypothesis=step, posterior=under, points=found, local=local)
    truth = log_likelihood_of_truth(present, clean)
    assert leads.log_likelihood < truth - 20.0
    assert stuck.log_likelihood < leads.log_likelihood - 20.0
    leads.__dict__["leaves_noise"] = False
    best, other = crossed(present, [leads, stuck])
    assert best.hypothesis.symbols == step.symbols
    assert best.log_likelihood > leads.log_likelihood + 50.0
    assert other.log_likelihood == pytest.approx(leads.log_likelihood, abs=0.01)
    best.__dict__["leaves_noise"] = True
    assert crossed(present, [best, stuck]) == (best, stuck)  # then there is nothing to gain
