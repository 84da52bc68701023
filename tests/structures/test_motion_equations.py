"""The printed equations of motion and drift against the incidence: which link joins which nodes, what pushes where."""

from __future__ import annotations

import re
from xml.dom.minidom import parseString

import numpy as np
import pytest
from test_topology import BRACED, MASSES, STOREY, TOWERS, driven

from bwbn_bayes import BoucWen, FrictionPendulum, Linear, Oscillator, Record, ShearBuilding
from bwbn_bayes.elements.effects import BaseFlexibility, SlipLock, StoreyCoupling
from bwbn_bayes.elements.equations import WrittenEquation
from bwbn_bayes.structures.equations import structure_equations
from bwbn_bayes.structures.parts import Links
from bwbn_bayes.structures.structure import Structure

CHAIN = ShearBuilding(masses=MASSES, storey=STOREY)
TALL = ShearBuilding(masses=[1.0] * 9, storey=Linear(k=5.0)).with_link(Linear(k=1.0), joins=(3, 5))
"""Most of its floors are alike and written once."""
MIXED = Structure(
    masses=MASSES,
    links=(
        Links(element=FrictionPendulum(W=10.0, R=1.0, mu_slow=0.05), joins=((0, 1),)),
        Links(element=BoucWen(k=50.0, beta=8.0, gamma=4.0), joins=((1, 2),)),
        Links(element=Linear(k=50.0), joins=((2, 3),)),
    ),
)
STRUCTURES = {"chain": CHAIN, "braced": BRACED, "towers": TOWERS, "tall": TALL, "mixed": MIXED}


def numbered(equation: WrittenEquation, n: int) -> list[str]:
    """An equation, for each place for which it is written: with the place in the place of i."""
    if "_i" not in equation.text:
        return [equation.text]
    runs = re.search(r"s ([\d, to]+\d)", equation.caption)
    places = range(1, n + 1)
    if runs:
        ends = [[int(one) for one in run.split(" to ")] for run in runs[1].split(", ")]
        places = [i for run in ends for i in range(run[0], run[-1] + 1)]

    def at(i: int) -> str:
        moved = {"_i": f"_{i}", "_(i+1)": f"_{i + 1}", "_(i−1)": f"_{i - 1}"}
        return re.sub(r"_i|_\(i.1\)", lambda found: moved[found[0]], equation.text)

    return [at(i) for i in places]


def printed(model: Structure, record: Record, letter: str, n: int, left: str) -> np.ndarray:
    """Signs of ``letter_1``, ``letter_2`` ... on the right sides of the equations whose left side is ``left_1 ...``."""
    signs = {}
    for equation in structure_equations(model, record):
        parseString(equation.mathml)
        for text in numbered(equation, n):
            head, _, right = text.partition(", ")[0].partition(" = ")
            if re.match(rf"{left}_\d+( |$)", head) and "a_g" not in right:
                row = [
                    int(f"{sign}1".replace("−", "-")) * (np.arange(20) == int(i))
                    for sign, i in re.findall(rf"([+−]?) ?{letter}_(\d+)", right)
                ]
                assert head not in signs
                signs[head] = np.sum([np.zeros(20, dtype=int), *row], axis=0)
    return np.array([signs[head] for head in sorted(signs, key=lambda head: int(re.findall(r"\d+", head)[0]))])


@pytest.mark.parametrize("name", STRUCTURES)
def test_forces_and_drifts_follow_the_incidence(name):
    """Of braces and towers those of a plain chain were written: x_i − x_(i−1) of nodes that no link joins."""
    model = STRUCTURES[name]
    n, record = model.n_floors, driven()
    low, high = np.array(model.joints).T
    stretches = np.eye(20)[high] - np.eye(20)[low]
    stretches[:, 0] = 0.0  # of the ground
    forces = printed(model, record, "F", n, "m")
    np.testing.assert_array_equal(forces[:, 1 : model.n_links + 1], -stretches[:, 1 : n + 1].T)
    drifts = printed(model, record, "x", model.n_links, "u")
    drifts[:, 0] = 0
    np.testing.assert_array_equal(drifts, stretches)


@pytest.mark.parametrize(("still", "inertia"), [(True, "m_i ẍ_i"), (False, "m_i (ẍ_i + a_g)")])
def test_a_force_from_outside_stands_where_it_acts_and_the_ground_where_it_moves(still, inertia):
    record = driven(2)
    if still:
        record = Record(name="pushed", time_step=0.02, excitation=np.zeros(301), forces=record.forces)
    texts = [one.text for one in structure_equations(BRACED, record)]
    assert texts[:3] == [
        inertia.replace("_i", "_1") + " = −F_1 + F_2",
        inertia.replace("_i", "_2") + " = −F_2 + F_3 − F_4 + P_2",
        inertia.replace("_i", "_3") + " = −F_3",
    ]


def test_a_forced_oscillator():
    """The force was missing, and a ground that stands still was written."""
    record = Record(name="pushed", time_step=0.02, excitation=np.zeros(301), forces=driven(1).forces)
    texts = [one.text for one in structure_equations(Oscillator(mass=2.0, spring=Linear(k=60.0)), record)]
    assert texts == ["m ẍ = −F + P", "u = x", "a = ẍ", "F = k u + c v"]


def test_each_kind_of_element_has_its_law():
    """Links of several kinds had the one law in whose parameters all can be written."""
    model = MIXED.with_effect(SlipLock(delta_s=0.1, sigma=0.05), storeys=[2])
    written = {one.caption: one.text for one in structure_equations(model)}
    assert written["storey force, storey 3"] == "F = k u + c v"
    assert written["storey force, storey 2"] == "F = α k u + (1 − α) k z + c v"
    assert written["friction pendulum, storey 1"]
    assert "a(z)" not in written["rate of the hysteretic displacement, storey 1"]
    assert "s a" in written["rate of the hysteretic displacement, storey 2"]
    braced = {one.caption: one.text for one in structure_equations(BRACED)}
    assert braced["storey force, storeys 1 to 3"] == "F = α k u + (1 − α) k z + c v"
    assert braced["storey force, ground to floor 2"] == "F = k u + c v"


def test_what_stands_on_a_base_and_what_bends_in_towers():
    model = TOWERS.with_link(Linear(k=1.0), joins=(0, 3)).with_effect(StoreyCoupling(k_bend=3.0))
    texts = [
        one.text for one in structure_equations(model.with_effect(BaseFlexibility(compliance=0.01, m_b=1.0, c_b=2.0)))
    ]
    assert {"u_1 = x_1 − x_b", "u_6 = x_3 − x_b", "u_b = (u_1 − u_2) + (u_1 − u_3)", "u_b = 0"} <= {*texts}
    assert any("(F_6 + F_1 − m_b a_g)" in text for text in texts if text.startswith("dv_b/dt"))
