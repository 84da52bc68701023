"""The reference engine's answers, solved once for a record and for the truth that is shown beside its posterior."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bwbn_bayes import BoucWen, ShearBuilding, Uniform, el_centro
from bwbn_bayes.engines.exact import exact_response, observable
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.engines.simulation import simulate
from bwbn_bayes.inference.summary import true_histories

GROUND = el_centro("chopra", duration=2.0)
TRUTH = {"k": 40.0, "c": 0.2}


def building(alpha: float = 0.05) -> ShearBuilding:
    storey = BoucWen(k=Uniform(20, 60), c=Uniform(0.01, 1), alpha=alpha, A=1.0, beta=30.0, gamma=15.0, n=1.2)
    return ShearBuilding(masses=[1.0, 1.0], storey=storey)


@pytest.fixture
def solves(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many draws each call of the reference engine solves."""
    found, solve = [], Reference.simulate

    def counted(self: Reference, model: Any, draws: Any, *others: Any) -> Any:
        found.append(len(draws))
        return solve(self, model, draws, *others)

    monkeypatch.setattr(Reference, "simulate", counted)
    return found


def test_the_truth_beside_a_posterior_is_not_solved_again(solves: list[int]) -> None:
    """Two seconds of eighteen went into solving the true model twice."""
    model = building(alpha=0.051)
    record = simulate(model, GROUND, TRUTH, snr_db=30.0)
    truth = true_histories(model, record)
    assert solves == [1]
    assert truth is not None
    alone = Reference().simulate(model, model.draws(TRUTH), record, ["drift_2", "hysteretic_energy_1"]).values
    assert np.array_equal(truth["drift"][:, 1], alone[:, 0])
    assert np.array_equal(truth["hysteretic_energy"][:, 0], alone[:, 1])


def test_a_record_is_what_the_engine_says_whatever_is_kept_beside_it() -> None:
    model = building(alpha=0.052)
    record = simulate(model, GROUND, TRUTH)
    alone = Reference().simulate(model, model.draws(TRUTH), GROUND, ["acceleration_1", "acceleration_2"]).values[0]
    assert np.array_equal(record.measured, alone)


@pytest.mark.parametrize(
    ("model", "record", "truth"),
    [
        (building(alpha=0.06), GROUND, TRUTH),
        (building(), el_centro("chopra", duration=2.0, scale=0.9), TRUTH),
        (building(), GROUND, {"k": 41.0, "c": 0.2}),
    ],
    ids=["model", "record", "values"],
)
def test_another_question_is_solved(model: Any, record: Any, truth: Any, solves: list[int]) -> None:
    first = exact_response(building(), building().draws(TRUTH), GROUND, ["drift_1"])
    solves.clear()
    second = exact_response(model, model.draws(truth), record, ["drift_1"])
    assert solves == [1]
    assert not np.allclose(first.values, second.values)


def test_what_is_kept_cannot_be_changed_by_who_asked() -> None:
    model, draws = building(), building().draws(TRUTH)
    asked = exact_response(model, draws, GROUND, ["drift_1"])
    before = asked.values.copy()
    asked.values[:] = 0.0
    assert np.array_equal(exact_response(model, draws, GROUND, ["drift_1"]).values, before)


def test_a_response_too_large_to_keep_is_solved_for_what_is_asked(
    solves: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every history of a million samples would take gigabytes."""
    monkeypatch.setattr("bwbn_bayes.engines.exact._MOST_KEPT", 100)
    model = building(alpha=0.07)
    for _ in range(2):
        found = exact_response(model, model.draws(TRUTH), GROUND, ["drift_1"])
    assert solves == [1, 1]
    assert found.values.shape == (1, 1, GROUND.n_times)
    assert all(len(names) == 2 for names in observable(model).values())
