"""A family solves for its members at once: what it says of each is what the member's own model says."""

import numpy as np
import pytest

from bwbn_bayes.discovery.candidates import Hypothesis, hypotheses, scales_of
from bwbn_bayes.discovery.family import Family, families
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import CubicStiffness, InputScale, QuadraticDamping, SensorGain
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import polish
from bwbn_bayes.parameters import PerStorey, Uniform
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.structures.shear_building import ShearBuilding

MODEL = ShearBuilding(
    masses=[2.0, 1.0],
    storey=BoucWen(k=PerStorey(Uniform(20, 120)), c=Uniform(0.01, 2), alpha=0.15, beta=12.0, gamma=2.0, n=1.3),
)
POINT = np.array([0.4, 0.45, 0.2])
GROUND = el_centro("chopra", duration=8.0)
ENGINE = Lanes(substeps=1, n_threads=1)
CHANNELS = ("acceleration_1", "acceleration_2")
EFFECTS = (CubicStiffness, QuadraticDamping, SensorGain)
RELATIVE = 1e-6


@pytest.fixture(scope="module")
def posterior() -> Posterior:
    """At 30 dB, and off by a sine that no parameter explains."""
    values = ENGINE.simulate(MODEL, MODEL.space.from_unit(POINT[None]), GROUND, CHANNELS).values[0]
    rng = np.random.default_rng(1)
    times = np.arange(GROUND.n_times) * GROUND.time_step
    rows = values + np.std(values) * (0.03 * rng.standard_normal(values.shape) + 0.05 * np.sin(9.0 * times))
    record = GROUND.with_channels(dict(zip(CHANNELS, rows, strict=True)))
    return Posterior(model=MODEL, record=record, engine=ENGINE, noise=default_noise(record))


@pytest.fixture(scope="module")
def every(posterior: Posterior) -> tuple[Hypothesis, ...]:
    return hypotheses(MODEL, scales_of(posterior, POINT), measured=CHANNELS, effects=EFFECTS)


def test_families_are_forms(every: tuple[Hypothesis, ...]) -> None:
    grouped = families(every[::-1])
    assert {(f.members[0].name, tuple(m.storeys for m in f.members)) for f in grouped} == {
        ("cubic_stiffness", ((1,), (2,))),
        ("cubic_stiffness", ((1, 2),)),
        ("quadratic_damping", ((1,), (2,))),
        ("quadratic_damping", ((1, 2),)),
        ("sensor_gain", ((1,), (2,))),
    }
    assert sum(len(f.members) for f in grouped) == len(every)


@pytest.mark.parametrize("name", ["cubic_stiffness", "quadratic_damping", "sensor_gain"])
def test_members_priors_are_their_own(name: str, every: tuple[Hypothesis, ...]) -> None:
    """Scales differ from storey to storey, and so do the priors that are made of them."""
    family = next(f for f in families(every) if f.members[0].name == name)
    priors = {p.name: p.prior for p in family.model.space.parameters}
    for member in family.members:
        own = {p.name: p.prior for p in member.model.space.parameters}
        assert all(priors[label] == own[label] for label in own)


@pytest.mark.parametrize("name", ["cubic_stiffness", "quadratic_damping", "sensor_gain"])
def test_the_family_says_what_each_member_says(name: str, posterior: Posterior, every: tuple[Hypothesis, ...]) -> None:
    """Log likelihood, gradient and information at random points, relative to the largest entry of each."""
    family = next(f for f in families(every) if f.members[0].name == name)
    view = family.posterior(posterior)
    rng = np.random.default_rng(2)
    for member in family.members:
        points = np.clip(
            member.starts(POINT[None]) + 0.05 * rng.standard_normal((1, MODEL.space.n_dim + 1)), 0.05, 0.95
        )
        embedded, held = family.embed(member, points)
        assert embedded.shape == held.shape == (len(points), family.model.space.n_dim)
        assert np.all(np.count_nonzero(~held, axis=1) == member.model.space.n_dim)
        np.testing.assert_array_equal(embedded[:, family.columns(member)], points)
        own = posterior.with_model(member.model).linearise(points)
        shared = family.extract(member, view.linearise(embedded))
        np.testing.assert_allclose(shared.log_likelihood, own.log_likelihood, rtol=RELATIVE)
        np.testing.assert_allclose(view.log_likelihood(embedded), own.log_likelihood, rtol=RELATIVE)
        for mine, theirs in ((shared.gradient, own.gradient), (shared.information, own.information)):
            assert np.max(np.abs(theirs)) > 1.0
            np.testing.assert_allclose(mine, theirs, atol=RELATIVE * np.max(np.abs(theirs)))


def test_what_is_held_is_neutral(every: tuple[Hypothesis, ...]) -> None:
    family = next(f for f in families(every) if f.members[0].name == "sensor_gain")
    first, second = family.members
    embedded, held = family.embed(first, first.starts(POINT[None]))
    values = dict(zip(family.model.space.names, family.model.space.from_unit(embedded).T, strict=True))
    np.testing.assert_allclose(values[second.brought[0]], 1.0)
    column = family.model.space.names.index(second.brought[0])
    assert np.all(held[:, column])


def test_held_coordinates_do_not_move_in_polish(posterior: Posterior, every: tuple[Hypothesis, ...]) -> None:
    """Each member ends where it ends alone, though both were fitted in one block."""
    family = next(f for f in families(every) if f.members[0].name == "cubic_stiffness")
    view = family.posterior(posterior)
    parts = [family.embed(member, member.starts(POINT[None])) for member in family.members]
    starts = np.concatenate([embedded for embedded, _ in parts])
    held = np.concatenate([fixed for _, fixed in parts])
    ended, local = polish(view, starts, n_iterations=40, held=held)
    np.testing.assert_array_equal(ended[held], starts[held])
    assert np.all(np.any(ended != starts, axis=1))
    first = 0
    for member, (embedded, _) in zip(family.members, parts, strict=True):
        rows = np.arange(first, first + len(embedded))
        first += len(embedded)
        _, alone = polish(posterior.with_model(member.model), member.starts(POINT[None]), n_iterations=40)
        assert np.max(local.log_likelihood[rows]) == pytest.approx(np.max(alone.log_likelihood), abs=0.1)


def test_a_family_of_one_is_its_member(posterior: Posterior) -> None:
    every = hypotheses(MODEL, scales_of(posterior, POINT), measured=CHANNELS, effects=[InputScale])
    (family,) = families(every)
    assert isinstance(family, Family)
    (member,) = family.members
    assert family.model is member.model
    embedded, held = family.embed(member, member.starts(POINT[None]))
    np.testing.assert_array_equal(embedded, member.starts(POINT[None]))
    assert not np.any(held)


def test_an_expansion_goes_in_as_it_came_out(posterior: Posterior, every: tuple[Hypothesis, ...]) -> None:
    """And a fit that is given it ends where one that takes it anew does."""
    family = next(f for f in families(every) if f.members[0].name == "cubic_stiffness")
    view, (member, *_) = family.posterior(posterior), family.members
    starts, held = family.embed(member, member.starts(POINT[None]))
    local = family.extract(member, view.linearise(starts, ~held))
    inside = family.embed_expansion(member, local)
    again = family.extract(member, inside)
    for one in ("log_likelihood", "gradient", "information"):
        np.testing.assert_array_equal(getattr(again, one), getattr(local, one))
    assert not np.any(inside.gradient[held])
    anew, _ = polish(view, starts, n_iterations=5, held=held)
    given, _ = polish(view, starts, n_iterations=5, held=held, local=inside)
    np.testing.assert_allclose(given, anew, atol=1e-9)
