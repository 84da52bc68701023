"""A small blind trial: every catalogued effect once, at 30 dB, hidden by a simulator that knows nothing of the package.

One effect of each kind in the default run, the others in the slow one. Two storeys, 12 s of strong motion at 50 Hz.
``benchmarks.discovery`` draws its cases in the same way on a larger scale.
Seed and setting were chosen before discovery saw a case: sizes come from the benchmark's own ranges less the lowest
quarter beside what the noise takes, for a record a quarter as informative. One draw of the 21 could not be seen at all
(``storey_parameter``: the plain model's best fit, by the simulator, stays 0.7 nats behind the truth where 40 count as
visible); the next draw of that effect stands in for it.

Asked of every case, by the fields of ``discovery.json`` alone: the effect named first, with a probability of 0.9, is
the hidden one at its place, or the hidden one is of the class that the record is said not to tell from it; and no
effect is named that is not there.
"""

from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from benchmarks.blind.cases import DETECTABLE_NATS, Case, Kind, Setting, make_case
from benchmarks.blind.scoring import case_outcome
from bwbn_bayes.discovery.run import DiscoverySettings
from bwbn_bayes.discovery.workflow import discover
from bwbn_bayes.elements.catalogue import registered
from bwbn_bayes.elements.search_guide import is_sought
from bwbn_bayes.structures.model_file import load_model_file
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.structure import Structure

SEED, SNR_DB = 4, 30.0
SETTING = Setting(n_storeys=2, duration=12.0, raise_by=0.25, judged=False)
INDEX = {
    "foliente_pinching": 0, "sudden_damage": 1, "mass_damping": 2, "appendage": 3, "strength_degradation": 4,
    "cubic_stiffness": 5, "backlash": 6, "sensor_gain": 7, "mass_error": 8, "coulomb_friction": 9,
    "base_flexibility": 10, "gap_impact": 11, "sensor_lag": 12, "asymmetry": 13, "storey_parameter": 23,
    "maxwell_branch": 15, "stiffness_degradation": 16, "input_scale": 17, "quadratic_damping": 18, "slip_lock": 19,
    "sensor_bias": 20,
}  # fmt: skip
"""The case that hides each effect, of those in the catalogue's table."""
LATER: dict[str, tuple[Kind, int]] = {
    "sliding_base": ("later", 0), "storey_coupling": ("later", 2), "viscous_damper": ("outside", 6),
}  # fmt: skip
"""Kind and case of those that joined the catalogue later."""
SOUGHT = tuple(effect.name for effect in registered() if is_sought(effect) and "bouc_wen" in effect.elements)
"""What discovery looks for in a building whose storeys are Bouc-Wen's."""
EFFECTS = tuple(sorted(SOUGHT, key=lambda name: name in LATER))
"""Those that joined later last."""
QUICK = ("slip_lock", "sudden_damage", "input_scale", "sensor_gain")
"""Of a storey's law, at an instant, of the whole building, of a sensor. A search takes 15 to 60 s of processor."""


@cache
def plain_model() -> Structure:
    """The plain three-storey model with two storeys."""
    model = load_model_file(Path(__file__).parents[2] / "models" / "plain_three_storey.py").model
    assert not model.is_driven
    return ShearBuilding(masses=(1.0, 1.0), storey=model.element)


def case_of(name: str, setting: Setting = SETTING) -> Case:
    kind, index = LATER[name] if name in LATER else ("catalogue", INDEX[name])
    case = make_case(kind, SEED, index, SNR_DB, setting)
    (hidden,) = case.truth.effects
    assert name in hidden.accepted
    return case


def test_every_catalogued_effect_is_on_trial_once() -> None:
    assert {*INDEX, *LATER} == set(EFFECTS)
    assert len(set(INDEX.values())) == len(INDEX) == 21
    assert len(set(LATER.values())) == len(LATER)


def discovered(name: str) -> dict[str, Any]:
    """``discovery.json`` of the case that hides an effect."""
    case = case_of(name)
    assert not case.record.truth
    return discover(plain_model(), case.record, settings=DiscoverySettings(particles=100)).as_json()


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in EFFECTS]
)
def test_the_hidden_effect_is_named_at_its_place(name: str) -> None:
    case, found = case_of(name), discovered(name)
    outcome = case_outcome({**case.truth.as_json(), "name": case.name}, found)
    probabilities = {one["name"]: one["probability"] for one in found["effects"]}
    said = f"hidden {outcome.hidden}, said {outcome.verdict} {outcome.named} {probabilities}"
    assert outcome.within_class, said
    assert outcome.right_place or not outcome.right_name, said
    assert not set(outcome.extra) - set(outcome.named[:1]), said
    assert sum(found["verdict_probabilities"].values()) == pytest.approx(1.0)


EVIDENCE_MOVES = 0.15
"""Evidences are sampled to some tenths of a nat, and six tenths move a probability by so much at most."""
DOUBLED: dict[str, dict[str, Any]] = {
    "search": {"REACH": 12.0, "BEAM": 4, "N_KEPT": 80},
    "build": {"MOST_LATER": 24, "N_KEPT": 80, "N_TOGETHER": 1024},
    "unnamed": {"_N_UNNAMED": 16},
    "pool": {
        "_MOST_COLOURED": 8, "_COLOURED_REACH": 800.0, "_N_TURNS": 8, "_MOST_SAMPLED": 12,
        "_SAMPLED_REACH": 20.0, "_N_SAMPLED": 800,
    },
    "race": {"ROUNDS": ((4, 1.0), (8, 0.8), (50, 0.24)), "_LEAST": 16, "_LEADING_FORMS": 16, "_FEWEST": 10},
    "second_look": {
        "_LEADING": 12, "_SEARCHED": 6, "_N_SCANNED": 64, "_N_POINTS": 16, "_N_STARTS": 2048, "_N_FIRST": 128,
    },
}  # fmt: skip
"""Budgets of the search, by module, twice what they are: iterations, draws, shares, reaches and numbers kept."""


def test_doubled_budgets_are_twice_those_in_force() -> None:
    """So that a budget that is changed or renamed is doubled again."""
    for module, budgets in DOUBLED.items():
        own = import_module(f"bwbn_bayes.discovery.{module}")
        for budget, doubled in budgets.items():
            now = getattr(own, budget)
            if budget == "ROUNDS":
                assert doubled == tuple((2 * n, min(2.0 * share, 1.0)) for n, share in now)
            else:
                assert doubled == 2 * now, budget


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["slip_lock", "coulomb_friction", "strength_degradation", "sensor_gain", "storey_parameter"]
)
def test_twice_the_budget_changes_no_verdict(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is found follows from evidence; how long was looked for it moves probabilities by evidence's error alone."""
    before = discovered(name)
    for module, budgets in DOUBLED.items():
        for budget, doubled in budgets.items():
            monkeypatch.setattr(f"bwbn_bayes.discovery.{module}.{budget}", doubled)
    after = discovered(name)
    assert after["verdict"] == before["verdict"]
    assert best(after) == best(before)
    for own in {*before["probabilities"], *after["probabilities"]}:
        first, second = (one["probabilities"].get(own, 0.0) for one in (before, after))
        assert second == pytest.approx(first, abs=EVIDENCE_MOVES), own


def best(found: dict[str, Any]) -> tuple[str, list[int]]:
    """The most probable effect and its place."""
    first = max(found["effects"], key=lambda one: one["probability"])
    return first["name"], first["storeys"]


@pytest.mark.slow
@pytest.mark.parametrize("name", EFFECTS)
def test_every_case_can_be_seen(name: str) -> None:
    """By the simulator's own least squares, not by the package."""
    (nats,) = case_of(name, replace(SETTING, judged=True)).truth.nats
    assert nats > DETECTABLE_NATS
