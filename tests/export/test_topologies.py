"""Links between any two nodes, forces from outside and sequences of records, written and run in OpenSees."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from opensees_runs import Histories, error, in_the_limit

from bwbn_bayes import (
    BaseFlexibility,
    BoucWen,
    InitialState,
    Linear,
    Links,
    Oscillator,
    PerStorey,
    Record,
    Settings,
    ShearBuilding,
    Specimen,
    StoreyCoupling,
    Structure,
    Uniform,
    UserError,
    el_centro,
    identify,
    join_records,
    simulate,
)
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.export import of_model, of_result, script_of

MASSES = [2e5, 1.5e5, 1e5]
YIELDING = BoucWen(k=PerStorey([9e7, 7e7, 5e7]), c=3e5, alpha=0.05, beta=3000.0, gamma=2000.0, n=1.7)
BRACED = ShearBuilding(masses=MASSES, storey=YIELDING).with_link(Linear(k=3e7, c=1e5), joins=(0, 2))
TOWERS = Structure(
    masses=MASSES,
    links=(
        Links(element=YIELDING, joins=((0, 1), (1, 2), (1, 3))),
        Links(element=Linear(k=1e7), joins=((2, 3), (0, 3))),
    ),
)
LONE = Oscillator(mass=2.0, spring=BoucWen(k=60.0, c=0.5, alpha=0.1, beta=8.0, gamma=4.0, n=1.4))
SHAKEN = el_centro("chopra", duration=6.0)
PUSH = 3e5 * np.cos(7.0 * SHAKEN.times) * np.exp(-0.2 * SHAKEN.times)
"""It begins at once. [N]"""
PUSHED = replace(SHAKEN, name="pushed", forces={"applied_force_3": PUSH})


def by_reference(model: Structure, record: Record) -> Histories:
    n = range(1, model.n_links + 1)
    names = [f"acceleration_{i}" for i in range(1, model.n_floors + 1)]
    names += [f"drift_{i}" for i in n] + [f"force_{i}" for i in n]
    return dict(zip(names, Reference().simulate(model, np.zeros((1, 0)), record, names).values[0], strict=True))


@pytest.mark.parametrize(
    ("model", "record"),
    [
        (BRACED, SHAKEN),
        (TOWERS, PUSHED),
        (
            TOWERS.with_effect(StoreyCoupling(k_bend=2e7)).with_effect(
                BaseFlexibility(compliance=3e-9, m_b=1e5, c_b=1e5)
            ),
            SHAKEN,
        ),
        (replace(LONE, masses=(2e5,)).with_values({"k": 9e7, "c": 3e5, "beta": 3e3, "gamma": 2e3}),
         replace(PUSHED, excitation=np.zeros(SHAKEN.n_times), forces={"applied_force_1": PUSH})),
    ],
    ids=["braced", "towers, shaken and pushed", "towers that bend, on a base", "pushed oscillator"],
)  # fmt: skip
def test_floors_and_loops_of_every_link_follow_the_reference_engine(
    model: Structure, record: Record, tmp_path: Path
) -> None:
    """They were refused whole."""
    script = script_of(of_model(model, record, {}, name="frame"))
    truth = by_reference(model, record)
    if "k_bend" in {p.symbol for p in model.law.parameters}:
        truth = {name: signal for name, signal in truth.items() if not name.startswith("force")}
    coarse, _, limit = in_the_limit(script, tmp_path, substeps=40)
    assert error(coarse, truth) < 1e-2
    assert error(limit, truth) < 1e-3


def test_records_in_sequence_keep_their_time_steps(tmp_path: Path) -> None:
    """The steps were averaged, or that of the first was taken for all: the script was wrong by 131 %."""
    fine = el_centro("chopra", duration=3.0)
    twice = replace(fine, name="twice", time_step=2.0 * fine.time_step)
    record = join_records([fine, twice], in_sequence=True)
    path = tmp_path / "sequence.py"
    path.write_text(script_of(of_model(LONE, record, {}, name="sequence")).text, encoding="utf-8")
    subprocess.run([sys.executable, str(path), "60"], check=True, capture_output=True)
    rows = np.loadtxt(path.with_suffix(".csv"), delimiter=",", skiprows=1)
    np.testing.assert_allclose(rows[:, 0], record.times, atol=1e-9)
    truth = by_reference(LONE, record)
    assert error({"drift_1": rows[:, 3]}, {"drift_1": truth["drift_1"]}) < 0.01


@pytest.mark.parametrize(
    ("model", "record", "sentence"),
    [
        (LONE, join_records([SHAKEN, SHAKEN]), "2 records that each find the structure as built"),
        (
            Specimen(storey=BoucWen(k=1e3, beta=10.0, gamma=5.0)),
            join_records([replace(SHAKEN, excitation=1e-2 * SHAKEN.excitation, excitation_kind="displacement")] * 2),
            "one record at a time",
        ),
        (LONE.with_effect(InitialState(u_0=0.05)), SHAKEN, r"storey 1 begins with u_0 = 0.05.*begin at rest"),
    ],
)
def test_what_a_script_cannot_do_is_refused(model: Structure, record: Record, sentence: str) -> None:
    """They were written in silence as one sequence from rest: wrong by half and more."""
    with pytest.raises(UserError, match=sentence):
        of_model(model, record, {}, name="x")


def test_at_rest_an_initial_state_is_none() -> None:
    script = script_of(of_model(LONE.with_effect(InitialState()), SHAKEN, {}, name="x"))
    assert [link.error for link in script.links] == [None]


def test_a_result_has_links_forces_and_records_as_its_model() -> None:
    model = TOWERS.with_values({"k[4,5]": Uniform(5e6, 2e7)})
    record = simulate(model, PUSHED, {"k[4,5]": 1e7}, channels=["acceleration_2", "acceleration_3"], snr_db=30.0)
    found = identify(model, record, settings=Settings(particles=100, alternatives=False))
    one, given = of_result(found), of_model(model, record, {"k[4,5]": 1e7}, name="x")
    assert [(link.joins, link.place) for link in one.links] == [(link.joins, link.place) for link in given.links]
    np.testing.assert_array_equal(one.forces[3], given.forces[3])
    np.testing.assert_allclose(one.time_steps, given.time_steps)
    found.tree["constant_data"].attrs["n_runs"] = 2
    with pytest.raises(UserError, match="one record at a time"):
        of_result(found)
