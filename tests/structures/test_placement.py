"""Where effects of floors, of the whole building and of sensors may be placed, and what is carried."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
import sympy as sp
from laboratory import NO_DRAW, storey
from scipy.integrate import solve_ivp

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import (
    BaseFlexibility,
    FolientePinching,
    InputScale,
    MassDamping,
    MassError,
    SensorGain,
    SlipLock,
    StoreyCoupling,
    StrengthDegradation,
    SuddenDamage,
)
from bwbn_bayes.elements.law import DRIFT, FLOOR_ACCELERATION, Effect, Slots, symbol
from bwbn_bayes.elements.linear import Linear
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import HalfNormal, Normal, Parameter, PerStorey, Uniform, Value
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.structures.equations import structure_equations
from bwbn_bayes.structures.parts import Links
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen
from bwbn_bayes.structures.structure import Structure

BASE = BaseFlexibility(compliance=HalfNormal(0.1), m_b=1.0, c_b=0.1)


def three(**element: Value) -> ShearBuilding:
    return ShearBuilding(masses=[1.0, 1.0, 1.0], storey=storey(**element))


def test_labels_are_plain_for_the_whole_building():
    model = three().with_effect(BASE).with_effect(InputScale(s_g=Normal(1.0, 0.1)))
    model = model.with_effect(MassError(e_m=PerStorey(Normal(0.0, 0.1))), storeys=[1, 3])
    model = model.with_effect(SensorGain(gain=Normal(1.0, 0.1)), storeys=[2])
    assert model.space.names == ("compliance", "s_g", "e_m[1]", "e_m[3]", "gain[2]")
    assert [p.storeys for p in model.space.parameters] == [(), (), (1,), (3,), (2,)]
    assert model.effects[0].storeys == ()
    local = model.table.local(np.array([[0.02, 1.1, 0.2, 0.3, 0.9]]))[0]
    columns = {p.symbol: local[:, i].tolist() for i, p in enumerate(model.parameters)}
    assert columns["compliance"] == [0.02] * 3
    assert columns["e_m"] == [0.2, 0.0, 0.3]
    assert columns["gain"] == [1.0, 0.9, 1.0]


class Wrong(StrengthDegradation):
    """A storey's law that looks at the floor."""

    def fill(self, slots: Slots) -> Slots:
        return replace(slots, nu=slots.nu + FLOOR_ACCELERATION)


@dataclass(frozen=True, kw_only=True)
class PowerSpring(Effect):
    """A user's effect with an option that its symbols do not show."""

    k_p: Value
    power: int = 3

    name: ClassVar[str] = "power_spring"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(symbol="k_p", unit="N/m^p", neutral=0.0, description="stiffness", source="here"),
    )

    def fill(self, slots: Slots) -> Slots:
        return replace(slots, added_force=slots.added_force + symbol("k_p") * DRIFT**self.power)


def test_an_option_makes_another_law():
    cubic, fifth = (three().with_effect(PowerSpring(k_p=2.0, power=power)).law.force for power in (3, 5))
    assert sp.simplify(fifth - cubic - symbol("k_p") * (DRIFT**5 - DRIFT**3)) == 0
    both = three().with_effect(PowerSpring(k_p=2.0, power=3), storeys=[1])
    same = both.with_effect(PowerSpring(k_p=3.0, power=3), storeys=[2])
    assert same.law.force == both.law.force


@pytest.mark.parametrize(
    ("build", "sentence"),
    [
        (lambda: three().with_effect(BASE, storeys=[1]), "base_flexibility acts on the whole building: leave storeys"),
        (lambda: three().with_effect(MassDamping(c_m=0.1), storeys=[1, 2, 3]), "acts on the whole building"),
        (lambda: three().with_effect(BASE).with_effect(BASE), "base_flexibility already acts on the building"),
        (lambda: three().with_effect(InputScale(s_g=PerStorey(1.0))), "s_g belongs to the whole building"),
        (lambda: three().with_effect(MassError(e_m=-0.95)), r"e_m = -0.95 lies outside its admissible range"),
        (lambda: three().with_effect(MassError(e_m=0.1), storeys=[4]), "must be numbers from 1 to 3"),
        (
            lambda: three().with_effect(MassError(e_m=0.1), storeys=[1.5]),
            r"storeys \[1.5\] must be numbers from 1 to 3",
        ),
        (lambda: ShearBuilding(masses="12", storey=storey()), "masses = '12': give a list with one positive number"),
        (lambda: Links(element=storey(), joins=((0, 1.5),)), "joins = .*: give the two nodes of each link, such as"),
        (lambda: Specimen(storey=storey()).with_effect(MassError(e_m=0.1)), "mass_error acts on floors"),
        (lambda: Specimen(storey=storey()).with_effect(SensorGain(gain=0.9)), "sensor_gain acts on floors"),
        (lambda: Specimen(storey=storey()).with_effect(InputScale(s_g=0.9)), "input_scale acts on floors"),
        (
            lambda: ShearBuilding(masses=[1.0], storey=storey()).with_effect(StoreyCoupling(k_bend=1.0)),
            "storey_coupling acts between storeys: the model has none that stands on another",
        ),
        (
            lambda: three().with_effect(PowerSpring(k_p=1.0), [1]).with_effect(PowerSpring(k_p=1.0, power=5), [2]).law,
            "two effects bring k_p and are not of one kind: name the parameters of one otherwise",
        ),
        (lambda: three().with_effect(Wrong(delta_nu=0.1)), "refers to a_i, which nothing in the model brings"),
    ],
)
def test_a_mistake_is_one_sentence(build, sentence):
    with pytest.raises(UserError, match=sentence) as caught:
        build()
    assert "\n" not in str(caught.value)


def test_what_is_carried_brings_a_law_and_nothing_else():
    slip, strength = SlipLock(delta_s=Uniform(0, 1), sigma=0.1), StrengthDegradation(delta_nu=Uniform(0, 1))
    carrying = replace(three(k=Uniform(5, 60)), carried=(slip, strength, BASE))
    assert carrying.space.names == ("k",)
    assert carrying.table.local(np.array([[9.0]])).shape == (1, 3, len(carrying.parameters))
    placed = carrying.with_effect(slip, storeys=[2])
    assert placed.space.names == ("k", "delta_s[2]")
    assert placed.law == carrying.law
    other = three(k=Uniform(5, 60)).with_effect(BASE).with_effect(strength).with_effect(slip)
    assert other.law == carrying.law


def test_a_carried_condition_does_not_bind():
    """A linear storey may carry Foliente's pinching, which asks for beta + gamma > 0 where it acts."""
    pinching = FolientePinching.neutral_forms()[0]
    linear = replace(three(beta=0.0, gamma=0.0), carried=(pinching,))
    assert linear.space.constraints == ()
    with pytest.raises(UserError, match="does not hold"):
        linear.with_effect(replace(pinching, q=0.3))
    jump = SuddenDamage(parameter="k", jump=Uniform(-20, 0), time=2.0)
    assert replace(three(k=10.0), carried=(jump,)).space.constraints == ()


def test_a_storey_is_pinched_below_one_that_is_linear():
    """Foliente's bound of z is none in the linear storey, where its law does nothing; SciPy solves the two by hand."""
    lower = BoucWen(k=40.0, c=0.2, alpha=0.1, beta=8.0, gamma=2.0, n=1.5)
    pinching = FolientePinching(zeta_s=0.7, p=5.0, q=0.3, psi_0=0.02, delta_psi=0.0, lambda_=0.2)
    links = (Links(element=lower, joins=((0, 1),)), Links(element=Linear(k=30.0, c=0.2), joins=((1, 2),)))
    model = Structure(masses=(1.0, 1.0), links=links).with_effect(pinching, storeys=[1])
    ground = el_centro("chopra", duration=8.0)

    def rates(t, y):
        u, u2, v, v2, z, energy = y
        bound = (1.0 / 10.0) ** (1.0 / 1.5)
        depth = 0.7 * (1.0 - np.exp(-5.0 * energy))
        offset = (z * np.sign(v) - 0.3 * bound) / (0.02 * (0.2 + depth))
        rate = (v - 8.0 * abs(v) * abs(z) ** 0.5 * z - 2.0 * v * abs(z) ** 1.5) * (1.0 - depth * np.exp(-(offset**2)))
        below, above = 0.1 * 40.0 * u + 0.9 * 40.0 * z + 0.2 * v, 30.0 * u2 + 0.2 * v2
        first, second = above - below, -above
        shaken = np.interp(t, ground.times, ground.excitation)
        return [v, v2, first - shaken, second - first, rate, 0.9 * 40.0 * z * v]

    solved = solve_ivp(rates, (0.0, 8.0), np.zeros(6), t_eval=ground.times, max_step=0.002, rtol=1e-8, atol=1e-10)
    found = Lanes(substeps=8).simulate(model, np.empty((1, 0)), ground, ("drift_1", "drift_2")).values[0]
    assert np.max(np.abs(found - solved.y[:2])) < 1e-3 * np.max(np.abs(solved.y[:2]))


def test_equations_say_what_floors_and_base_do():
    model = three().with_effect(BASE).with_effect(MassError(e_m=0.1)).with_effect(MassDamping(c_m=0.1))
    texts = [equation.text for equation in structure_equations(model.with_effect(SensorGain(gain=0.9)))]
    for expected in (
        "M_i (ẍ_i + a_g) = −F_i + F_(i+1) + G_i, F_4 = 0",
        "u_i = x_i − x_(i−1), x_0 = x_b",
        "M_i = (1 + e_m) m_i",
        "G_i = −c_m M_i w_i",
        "dw_i/dt = a_i − a_g",
        "y_i = gain a_i",
    ):
        assert expected in texts
    assert model.table.local(NO_DRAW).shape[0] == 1


def test_values_are_replaced_by_their_labels():
    """In the element, per storey, and in effects whose fields are and are not called as their symbols."""
    model = three(k=PerStorey([Uniform(5, 60), 20.0, Uniform(5, 60)]), A=Uniform(0.5, 2.0))
    model = model.with_effect(SlipLock(delta_s=HalfNormal(0.1), sigma=0.05), storeys=[2])
    model = model.with_effect(SuddenDamage(parameter="k", jump=Normal(0.0, 1.0), time=3.0), storeys=[1, 3])
    changed = model.with_values(
        {"A": 1.5, "k[2]": Uniform(1, 2), "k[3]": 7.0, "sigma[2]": HalfNormal(0.2), "k_jump[1,3]": -1.0}
    )
    assert changed.space.names == ("k[1]", "k[2]", "delta_s[2]", "sigma[2]")
    assert changed.space.parameters[1].prior == Uniform(1, 2)
    assert [placed.storeys for placed in changed.effects] == [(2,), (1, 3)]
    columns = [p.symbol for p in changed.parameters]
    assert changed.table.fixed[:, columns.index("A")].tolist() == [1.5] * 3
    assert changed.table.fixed[:, columns.index("k_jump")].tolist() == [-1.0, 0.0, -1.0]
    assert changed.table.fixed[2, columns.index("k")] == 7.0
    assert model.space.names == ("k[1]", "k[3]", "A", "delta_s[2]", "k_jump[1,3]")
    assert model.with_values({}) == model


def test_a_value_is_replaced_in_its_own_field_though_another_holds_the_same():
    """Two fields with one number ended a search in "which field stands for k_ramp_time cannot be told"."""
    ramp = SuddenDamage(parameter="k", jump=Normal(0.0, 1.0), time=5.0, duration=5.0)
    (changed,) = three().with_effect(ramp).with_values({"k_ramp": -1.0}).effects
    assert changed.effect == replace(ramp, jump=-1.0)
    prior = Uniform(1.0, 9.0)
    both = three().with_effect(replace(ramp, time=prior, duration=prior)).with_values({"k_ramp_time": 4.0})
    assert both.effects[0].effect == replace(ramp, time=4.0, duration=prior)


def test_a_label_that_the_model_lacks_is_refused():
    with pytest.raises(UserError, match=r"the model has no parameter k\[4\], zeta: it has A, alpha, beta"):
        three(k=PerStorey(Uniform(5, 60))).with_values({"zeta": 1.0, "k[4]": 2.0})


def test_a_value_outside_its_range_is_refused_by_its_label():
    with pytest.raises(UserError, match="alpha = 2 lies outside"):
        three().with_values({"alpha": 2.0})
