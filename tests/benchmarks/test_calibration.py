"""The benchmark of calibration: its records against the reference engine, and its sums."""

from __future__ import annotations

from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.blind.simulator import respond
from benchmarks.calibrating.outcome import Outcome
from benchmarks.calibrating.records import CONDITIONS, building_of, replicate
from benchmarks.calibrating.summary import calibration, wrong
from benchmarks.calibrating.wrong import FORCES, KINDS, force_replicate, wrong_replicate
from bwbn_bayes import Uniform, simulate
from bwbn_bayes.structures.model_file import ModelFile, load_model_file

FILE = load_model_file(Path(__file__).parents[2] / "models" / "sdof.py")


@pytest.mark.parametrize("a", [1.0, 0.8])
def test_a_truth_is_recorded_as_the_reference_engine_solves_it(a: float) -> None:
    """Also where A is not one, which the simulator does not know: it is taken into the other numbers."""
    assert FILE.excitation is not None
    values = {"A": a} if a != 1.0 else {}
    model = FILE.model.with_values(values)
    drawn = np.array([[FILE.truth[name] for name in model.space.names]])
    ground = FILE.excitation
    found = respond(building_of(model, drawn[0]), ground.excitation, ground.time_step, 40).measured[0]
    expected = simulate(model, ground, FILE.truth, snr_db=None).channels["acceleration_1"]
    assert np.max(np.abs(found - expected)) < 1e-5 * np.std(expected)


def test_a_condition_shapes_the_record() -> None:
    short, near = (replicate(FILE, CONDITIONS[name], 1, 0) for name in ("100 samples", "n near 1"))
    assert short.record.n_times == 100
    assert 1.0 <= near.truth["n"] <= 1.1
    assert near.model.space.parameters[near.model.space.names.index("n")].prior == Uniform(1.0, 1.1)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_wrong_model_can_be_recorded(kind: str) -> None:
    made = wrong_replicate(FILE, kind, 30.0, 1, 0)
    assert set(made.truth) == set(made.model.space.names)
    if kind == "prior excludes c":
        low, high = made.model.space.parameters[made.model.space.names.index("c")].prior.support
        assert not low <= made.truth["c"] <= high


def test_a_wrong_model_is_recorded_with_one_force_in_one_storey() -> None:
    """Another in each case, of its own size; the record is another than that of the plain building."""
    names = set()
    for number in range(8):
        name, made = force_replicate(FILE, 30.0, 11, number)
        kind, _, storey = name.partition(", ")
        assert kind in FORCES and storey == "storey 1"
        names.add(kind)
        plain = building_of(made.model, np.array([made.truth[one] for one in made.model.space.names]))
        changed = [a != b for a, b in zip(astuple(made.building.storeys[0]), astuple(plain.storeys[0]), strict=True)]
        assert 1 <= sum(changed) <= 2
    assert len(names) > 2


def outcome(rank: float, z: float, grade: str) -> Outcome:
    return Outcome(
        method="importance",
        ranks={"k": rank},
        z={"k": z},
        covered={"k": abs(z) < 1.645},
        checks={},
        grade=grade,
        effective=1000.0,
        log_evidence=0.0,
        log_evidence_se=0.0,
        elapsed_s=1.0,
    )


def test_sums() -> None:
    rng = np.random.default_rng(1)
    right = [outcome(float(rng.random()), float(rng.standard_normal()), "explains") for _ in range(400)]
    found = calibration(right)
    assert found.coverage_low < 0.9 < found.coverage_high
    assert abs(found.rms_z - 1.0) < 4.0 / np.sqrt(800)
    assert found.rank_p > 0.001
    lying = [replace(one, ranks={"k": 0.5 * one.ranks["k"]}) for one in right]
    assert calibration(lying).rank_p < 1e-6
    found_wrong = wrong(
        [outcome(0.5, z, grade) for z, grade in ((9.0, "doubtful"), (5.0, "explains"), (1.0, "refused"))]
    )
    assert (found_wrong.n_misleading, found_wrong.misleading_doubtful, found_wrong.misleading_refused) == (2, 1, 0)
    assert found_wrong.others_refused_or_doubtful == 1


def test_a_specimen_is_refused(specimen_file: ModelFile) -> None:
    with pytest.raises(ValueError, match="no chain of storeys"):
        CONDITIONS["regular"].model(specimen_file)


@pytest.fixture
def specimen_file() -> ModelFile:
    return load_model_file(Path(__file__).parents[2] / "models" / "cyclic_test.py")
