"""What discovery gets from an effect: priors of every form and the points from which fits start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from laboratory import SEARCHED

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import FolientePinching, SlipLock, StoreyParameter, SuddenDamage
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.elements.linear import Linear
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import guide_of
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import HalfNormal, Normal, Prior, Truncated
from bwbn_bayes.structures.shear_building import ShearBuilding

SCALES = Scales(
    drift=0.02, path=0.8, drift_rate=0.3, hysteretic_displacement=0.012, energy=800.0, force=9e4, stiffness=8e6,
    damping=6e4, alpha=0.04, beta=60.0, gamma=30.0, n=1.3, mass=1.2e4, acceleration=2.0,
    ground_acceleration=1.0, period=0.7, onset=1.5, duration=31.0, total_mass=36000, time_step=0.02,
)  # fmt: skip
STOREY = BoucWen(k=8e6, c=6e4, alpha=0.04, beta=60.0, gamma=30.0, n=1.3)
FORMS: list[Effect] = [
    form
    for effect in SEARCHED
    if effect.level == "link"
    for form in (*guide_of(effect).priors(SCALES), *guide_of(effect).free_shapes(SCALES))
]


def starts_of(form: Effect) -> Mapping[str, tuple[float, ...]]:
    return guide_of(type(form)).starts(form, SCALES)


@pytest.mark.parametrize("form", FORMS, ids=lambda form: f"{form.name} {form.form}")
def test_starts_lie_in_the_priors_and_are_few(form):
    storey = STOREY if "bouc_wen" in form.elements else Linear(k=8e6, c=6e4)
    model = ShearBuilding(masses=[1.2e4, 1.2e4], storey=storey).with_effect(form, storeys=[2])
    grid = starts_of(form)
    assert [p.symbol for p in model.space.parameters] == list(grid)
    # The score tells the size of a change: starts of it are times alone.
    sizes = {form.parameters[0].symbol: (-0.15 * SCALES.stiffness,)} if isinstance(form, SuddenDamage) else {}
    starts = np.array(list(product(*{**grid, **sizes}.values())))
    assert 1 <= len(starts) <= (400 if isinstance(form, SuddenDamage) else 12)
    assert np.all(model.space.admissible(starts))
    unit = model.space.to_unit(starts)
    assert np.all((unit > 1e-3) & (unit < 1.0 - 1e-3)), unit


@pytest.mark.parametrize("form", FORMS, ids=lambda form: f"{form.name} {form.form}")
def test_the_first_parameter_is_an_amplitude_with_a_prior_about_neutral(form):
    amplitude, *nuisances = [p for p in form.parameters if isinstance(form.values[p.symbol], Prior)]
    prior = form.values[amplitude.symbol]
    parent = prior.parent if isinstance(prior, Truncated) else prior
    assert isinstance(parent, (HalfNormal, Normal))
    assert amplitude.neutral == 0.0
    assert isinstance(parent, HalfNormal) == (amplitude.lower == 0.0)
    assert getattr(parent, "location", 0.0) == 0.0
    starts = starts_of(form)[amplitude.symbol]
    if isinstance(form, SuddenDamage):
        assert starts == ()
    else:
        assert (min(starts) < 0.0 < max(starts)) == isinstance(parent, Normal)
    for nuisance in nuisances:
        assert np.all(np.isfinite(form.values[nuisance.symbol].support))


def test_forms_of_one_effect_can_stand_in_one_building():
    """Their parameters have symbols of their own: otherwise one storey would follow the other's form."""
    for effect in SEARCHED:
        if effect.level == "link":
            forms = (*effect.neutral_forms(), *guide_of(effect).free_shapes(SCALES))
            symbols = [p.symbol for form in forms for p in form.parameters]
            assert len(set(symbols)) == len(symbols)


def test_damage_starts_at_every_second_and_a_half_of_the_strong_motion():
    step = next(form for form in FORMS if form.form == "k, step")
    times = np.array(starts_of(step)["k_time"])
    assert np.all(np.diff(times) <= 1.5)
    assert times[0] - SCALES.onset <= 0.75 and SCALES.duration - times[-1] <= 0.75


def test_the_slip_is_narrow():
    """A wider sigma imitates stiffness_degradation."""
    (form,) = guide_of(SlipLock).priors(SCALES)
    np.testing.assert_allclose(form.sigma.support, (0.03 * 0.012, 0.5 * 0.012))


def test_the_pinch_identifies_all_its_parameters():
    # With delta_psi and lambda held at usual values a hidden pinch was named, and a slip that is not there beside it.
    (form,) = guide_of(FolientePinching).priors(SCALES)
    assert set(starts_of(form)) == {p.symbol for p in FolientePinching.parameters}


def test_a_pinch_may_be_there_from_the_start_and_in_the_middle():
    """With p = 1e3 / E a hundredth of the work done brings it out; q = 0 needs no z_u, which the base may not have."""
    (form,) = guide_of(FolientePinching).priors(SCALES)
    grid = starts_of(form)
    assert max(grid["p"]) * SCALES.energy == pytest.approx(1e3)
    assert form.p.support[1] > max(grid["p"])
    assert 0.0 in grid["q"]


@pytest.mark.parametrize(
    ("parameter", "offset", "sentence"),
    [("n", -0.4, "n \\+ n_offset"), ("alpha", 0.97, "alpha \\+ alpha_offset"), ("gamma", -95.0, "gamma_offset")],
)
def test_an_offset_that_leaves_the_admissible_range_is_refused(parameter, offset, sentence):
    plain = ShearBuilding(masses=[1.0, 1.0], storey=STOREY)
    with pytest.raises(UserError, match=sentence):
        plain.with_effect(StoreyParameter(parameter=parameter, offset=offset), storeys=[1])


def test_starts_of_a_step_resolve_the_cycles_of_the_drift():
    """A step moved in time adds the drift that passes meanwhile: between two starts that must not change its sign."""
    step = next(form for form in FORMS if isinstance(form, SuddenDamage) and form.duration is None)
    scales = replace(SCALES, duration=15.0)
    times = np.array(guide_of(SuddenDamage).starts(step, scales)["k_time"])
    cycle = 2.0 * np.pi * SCALES.drift / SCALES.drift_rate
    assert np.max(np.diff(times)) <= cycle / 8.0 + 1e-9
    assert times[0] - SCALES.onset <= cycle / 8.0
    assert scales.duration - times[-1] <= cycle / 8.0
