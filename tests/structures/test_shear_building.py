"""Model definitions: immutable, composable, named, truncated to what is admissible, refused in one sentence."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from laboratory import NO_DRAW, shaking, solve, storey

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import CubicStiffness, FolientePinching, SlipLock, StrengthDegradation, SuddenDamage
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import LogNormal, Normal, PerStorey, Truncated, Uniform
from bwbn_bayes.structures.oscillator import Oscillator
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen

SLIP = SlipLock(delta_s=Uniform(0.0, 0.3), sigma=0.05)


def three(**element: object) -> ShearBuilding:
    return ShearBuilding(masses=[1.0, 1.0, 1.0], storey=storey(**element))


def test_a_model_cannot_change():
    masses = [1.0, 2.0]
    model = ShearBuilding(masses=masses, storey=storey())
    masses[0] = 5.0
    assert model.masses == (1.0, 2.0)
    with pytest.raises(FrozenInstanceError):
        model.masses = (3.0,)
    extended = model.with_effect(SLIP)
    assert model.effects == () and len(extended.effects) == 1


def test_equal_definitions_are_equal_and_hashable():
    one, other = (three(k=PerStorey(Uniform(5, 60))).with_effect(SLIP, storeys=[2]) for _ in range(2))
    assert one == other and hash(one) == hash(other)


def test_parameters_are_named_after_symbol_and_place():
    model = three(k=PerStorey(Uniform(5, 60)), alpha=Uniform(0.0, 0.3), n=1.5)
    model = model.with_effect(SlipLock(delta_s=Uniform(0, 0.3), sigma=PerStorey(Uniform(0.01, 0.1))), storeys=[1, 2])
    model = model.with_effect(StrengthDegradation(delta_nu=Uniform(0, 1)), storeys=[3])
    expected = ("k[1]", "k[2]", "k[3]", "alpha", "delta_s[1,2]", "sigma[1]", "sigma[2]", "delta_nu[3]")
    assert model.space.names == expected
    assert [p.unit for p in model.space.parameters] == ["N/m", "N/m", "N/m", "", "m/J", "m", "m", "1/J"]
    assert model.space.parameters[4].storeys == (1, 2)


def test_an_effect_everywhere_has_a_plain_name():
    assert three().with_effect(SLIP).space.names == ("delta_s",)


def test_a_single_storey_keeps_its_place_in_per_storey_names():
    model = ShearBuilding(masses=[1.0], storey=storey(k=PerStorey(Uniform(1, 2)), c=Uniform(0, 1)))
    assert model.space.names == ("k[1]", "c")


def test_per_storey_lists_mix_known_and_identified():
    model = three(k=PerStorey([10.0, Uniform(5, 60), 30.0]))
    assert model.space.names == ("k[2]",)
    local = model.table.local(np.array([[20.0]]))
    column = [p.symbol for p in model.law.parameters].index("k")
    assert local[0, :, column].tolist() == [10.0, 20.0, 30.0]


def test_an_effect_acts_where_it_was_put():
    model = three().with_effect(StrengthDegradation(delta_nu=0.5), storeys=[2])
    column = [p.symbol for p in model.law.parameters].index("delta_nu")
    assert model.table.local(NO_DRAW)[0, :, column].tolist() == [0.0, 0.5, 0.0]


def test_the_same_kind_may_differ_between_storeys():
    model = three().with_effect(StrengthDegradation(delta_nu=0.5), storeys=[1])
    model = model.with_effect(StrengthDegradation(delta_nu=Uniform(0, 1)), storeys=[2, 3])
    assert model.space.names == ("delta_nu[2,3]",)


def test_draws_from_names():
    model = three(k=PerStorey(Uniform(5, 60)))
    np.testing.assert_array_equal(model.draws({"k[2]": 2.0, "k[1]": 1.0, "k[3]": 3.0}), [[1.0, 2.0, 3.0]])
    with pytest.raises(UserError, match=r"k\[3\] missing; k not identified"):
        model.draws({"k[2]": 2.0, "k[1]": 1.0, "k": 3.0})


def test_a_prior_that_reaches_outside_is_truncated():
    prior = three(n=Normal(1.5, 1.0)).space.parameters[0].prior
    assert isinstance(prior, Truncated)
    assert prior.support == (1.0, np.inf)
    inside = three(n=Uniform(1.0, 4.0)).space.parameters[0].prior
    assert inside == Uniform(1.0, 4.0)


def test_the_admissible_mass_is_the_exact_area():
    """beta on [0, 4], gamma on [-4, 2]: the triangle gamma < -beta has area 8 of 24, so 2/3 are left.

    Scrambled Sobol, 2^15 points, a half-plane in two dimensions: error well below 1e-3.
    """
    space = three(beta=Uniform(0, 4), gamma=Uniform(-4, 2)).space
    assert len(space.constraints) == 1
    assert np.exp(space.log_admissible_mass) == pytest.approx(2.0 / 3.0, abs=1e-3)
    points = np.array([[0.5, 0.9], [0.1, 0.1]])
    np.testing.assert_allclose(space.log_prior_unit(points), [-space.log_admissible_mass, -np.inf])


def test_samples_of_the_joint_prior_are_admissible_and_uniform_there():
    space = three(beta=Uniform(0, 4), gamma=Uniform(-4, 2)).space
    values = space.from_unit(space.sample_unit(np.random.default_rng(3), 20_000))
    assert np.all(values.sum(axis=1) >= 0.0)
    # Of the admissible 16, beta < 2 has 8 - 2 = 6 (8 above gamma = -2 less the triangle below -beta): share 6/16.
    se = np.sqrt(0.375 * 0.625 / 20_000)
    assert np.mean(values[:, 0] < 2.0) == pytest.approx(0.375, abs=4 * se)


def test_a_condition_that_cuts_nothing_is_left_out():
    assert three(beta=Uniform(0.1, 8), gamma=2.0).space.constraints == ()
    jump = SuddenDamage(parameter="k", jump=Uniform(-5, 0), time=2.0)
    assert three(k=Uniform(6, 60)).with_effect(jump).space.constraints == ()


def test_a_jump_may_not_leave_the_admissible_range():
    jump = SuddenDamage(parameter="k", jump=Uniform(-20, 0), time=2.0)
    space = ShearBuilding(masses=[1.0], storey=storey(k=10.0)).with_effect(jump).space
    assert np.exp(space.log_admissible_mass) == pytest.approx(0.5, abs=1e-3)
    with pytest.raises(UserError, match="does not hold for the values given"):
        three(k=10.0).with_effect(replace(jump, jump=-11.0))


def test_a_jump_acts_at_its_storey_only():
    model = three().with_effect(SuddenDamage(parameter="k", jump=PerStorey([-2.0]), time=1.0), storeys=[2])
    assert model.table.local(NO_DRAW)[0, :, -2].tolist() == [0.0, -2.0, 0.0]


def test_a_warning_where_a_loop_can_give_energy_back():
    assert three(beta=1.0, gamma=0.5).warnings == ()
    assert three(beta=PerStorey([10.0, 3.0, 3.0]), gamma=PerStorey([5.0, 2.0, 2.0])).warnings == ()
    assert three(beta=PerStorey([10.0, 3.0, 3.0]), gamma=PerStorey([5.0, 3.5, 2.0])).warnings != ()
    assert "more energy than it took" in three(beta=Uniform(0.1, 8), gamma=Uniform(-4, 8)).warnings[0]


@pytest.mark.parametrize(
    ("build", "sentence"),
    [
        (
            lambda: ShearBuilding(masses=[], storey=storey()),
            "give a list with one positive number of kg",
        ),
        (lambda: ShearBuilding(masses=1.0, storey=storey()), "masses = 1.0: give a list"),
        # Of a mapping and a set the keys were taken for masses, in whatever order they came.
        (lambda: ShearBuilding(masses={1.0: 2.0}, storey=storey()), r"masses = \{1.0: 2.0\}: give a list"),
        (lambda: ShearBuilding(masses={1.0, 2.0}, storey=storey()), r"masses = \{1.0, 2.0\}: give a list"),
        (lambda: ShearBuilding(masses=["1"], storey=storey()), r"masses = \['1'\]: give a list"),
        (lambda: ShearBuilding(masses=[True], storey=storey()), r"masses = \[True\]: give a list"),
        (lambda: ShearBuilding(masses=np.array(1.0), storey=storey()), r"masses = array\(1.\): give a list"),
        (lambda: ShearBuilding(masses=[1.0], heights={3.0: 1.0}, storey=storey()), r"heights = \{3.0: 1.0\}: give a"),
        (lambda: PerStorey({1: 10.0, 2: 20.0}), r"PerStorey\(\{1: 10.0, 2: 20.0\}\): give a list with a number or"),
        (lambda: PerStorey({10.0, 20.0}), "PerStorey.*: give a list with a number or a prior for each storey"),
        (lambda: PerStorey("12"), r"PerStorey\('12'\): give a list with a number or a prior for each storey"),
        (lambda: three(k=PerStorey(["1", 2.0, 3.0])), r"k\[1\] is '1': give a number"),
        (lambda: three(k=True), "k is True: give a number, a prior, or PerStorey of either"),
        (lambda: ShearBuilding(masses=[1.0], storey=3), "storey is of type int: give one element, such as BoucWen"),
        (lambda: ShearBuilding(masses=[1.0], storey=[storey()]), "storey is of type list: give one element"),
        (lambda: ShearBuilding(masses=[1.0], storey=BoucWen), "storey is the class BoucWen: give one element"),
        (lambda: ShearBuilding(masses=[1.0], storey=storey(), isolator=0), "isolator is of type int: give one element"),
        (lambda: Specimen(storey=Uniform(1, 2)), "storey is of type Uniform: give one element"),
        (lambda: Oscillator(mass=1.0, spring=Uniform(1, 2)), "spring is of type Uniform: give one element"),
        (lambda: Oscillator(mass="1", spring=storey()), "mass is '1': give a number"),
        (lambda: three().with_link(5.0, joins=(0, 2)), "element is 5.0: give one element"),
        (lambda: ShearBuilding(masses=["12 t"], storey=storey()), "one positive number of kg"),
        (lambda: ShearBuilding(masses=[1.0], heights=[3.0, 3.0], storey=storey()), "each of the 1 storeys"),
        (lambda: ShearBuilding(masses=[1.0], heights=[0.0], storey=storey()), "one positive number of m"),
        (lambda: ShearBuilding(masses=[1.0], heights=3.0, storey=storey()), "heights = 3.0: give a list"),
        (lambda: three().with_effect(SuddenDamage), "with_effect takes an effect and its values"),
        (lambda: three().with_effect("slip_lock"), "with_effect takes an effect and its values"),
        (lambda: three().with_effect(SuddenDamage(parameter="k", jump=-1.0, time=1.0), storeys=1), r"such as \[1\]"),
        (lambda: three(k=Uniform(5, 60)).draws({"k": -40.0}), r"k = -40 lies outside its admissible range \[0, inf\]"),
        (lambda: three(k=Uniform(5, 60)).draws({"k": "40"}), "k is '40': give a number"),
        (lambda: three(k=Uniform(5, 60)).draws({"k": 40.0, "c": 1.0}), "c not identified"),
        (
            lambda: ShearBuilding(masses=[1.0, -1.0], storey=storey()),
            "give a list with one positive number of kg",
        ),
        (lambda: three(alpha=1.5), r"alpha = 1.5 lies outside its admissible range \[-1, 1\]"),
        (lambda: three(k=float("nan")), "k = nan lies outside"),
        (lambda: three(k="stiff"), "k is 'stiff': give a number, a prior, or PerStorey of either"),
        (lambda: three(beta=1.0, gamma=-2.0), "storey 1: .* does not hold for the values given"),
        (lambda: three(beta=Uniform(0, 1), gamma=Uniform(-4, -2)).space.log_admissible_mass, "no point of the prior"),
        (lambda: three(n=Uniform(0.1, 0.9)), "no mass in the admissible range"),
        (lambda: three(k=PerStorey([1.0, 2.0])), "PerStorey holds 2 values for 3 storeys"),
        (lambda: three().with_effect(SLIP, storeys=[4]), "must be numbers from 1 to 3 in increasing order"),
        (lambda: three().with_effect(SLIP, storeys=[]), "must be numbers from 1 to 3 in increasing order"),
        (lambda: three().with_effect(SLIP, storeys=[2, 2]), "must be numbers from 1 to 3 in increasing order"),
        (lambda: three().with_effect(SLIP).with_effect(SLIP, storeys=[2]), "slip_lock already acts on storey"),
        (lambda: three().with_effect(SuddenDamage(parameter="n", jump=1.0, time=1.0)), "parameter 'n' cannot jump"),
        (
            lambda: three().with_effect(SuddenDamage(parameter="delta_nu", jump=1.0, time=1.0)),
            "an effect refers to delta_nu, which nothing in the model brings: add the effect that does first",
        ),
        (
            lambda: three(beta=0.0, gamma=0.0).with_effect(replace(FolientePinching.neutral_forms()[0], q=0.3)),
            "does not hold for the values given",
        ),
        (lambda: Uniform(2.0, 1.0), "the lower bound must lie below the upper"),
        (lambda: Normal(0.0, -1.0), "scale is -1.0, it must be a positive number"),
        (lambda: LogNormal(0.0, 1.0), "median is 0.0, it must be a positive number"),
    ],
)
def test_a_mistake_is_one_sentence(build, sentence):
    with pytest.raises(UserError, match=sentence) as caught:
        build()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("n_storeys", [1, 3, 50])
def test_any_number_of_storeys(n_storeys):
    model = ShearBuilding(masses=[1.0] * n_storeys, storey=storey(k=PerStorey(Uniform(500, 6000)), c=1.0))
    assert model.space.n_dim == n_storeys
    draws = np.full((2, n_storeys), 3000.0)
    top = [f"acceleration_{n_storeys}"]
    response = Lanes(substeps=4, n_threads=1).simulate(model, draws, shaking(2.0), top)
    assert response.status.tolist() == [0, 0]
    known = ShearBuilding(masses=[1.0] * n_storeys, storey=storey(k=3000.0, c=1.0))
    alone = solve(known, shaking(2.0), top, 4)[top[0]]
    np.testing.assert_array_equal(response.values[0, 0], alone)


def test_numbers_of_numpy_are_numbers() -> None:
    """As ``np.arange`` and arrays hand them out."""
    storey = BoucWen(k=PerStorey(np.int64(5)), c=np.float32(0.5), beta=PerStorey(np.array([1.0, 2.0])), gamma=1.0)
    model = ShearBuilding(masses=[1.0, 1.0], storey=storey)
    same = BoucWen(k=PerStorey(5), c=0.5, beta=PerStorey([1.0, 2.0]), gamma=1.0)
    other, nothing = ShearBuilding(masses=[1.0, 1.0], storey=same), np.empty((1, 0))
    np.testing.assert_array_equal(model.table.local(nothing), other.table.local(nothing))
    for storeys in (np.int64(1), "1"):
        with pytest.raises(UserError, match=r"it must be a list such as \[1\]"):
            model.with_effect(CubicStiffness(k3=1.0), storeys=storeys)  # type: ignore[arg-type]
