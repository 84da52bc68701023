"""The registry of effects: what it lists and what it refuses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import pytest

from bwbn_bayes.elements import catalogue as catalogue_module
from bwbn_bayes.elements.catalogue import catalogue, register, registered
from bwbn_bayes.elements.effects import CoulombFriction, SlipLock, SuddenDamage
from bwbn_bayes.elements.law import DRIFT, Effect, Slots, symbol
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Parameter, Value


@pytest.fixture
def own_registry(monkeypatch):
    """A copy of the registry that the test may change."""
    monkeypatch.setattr(catalogue_module, "_REGISTRY", dict(catalogue_module._REGISTRY))


@dataclass(frozen=True, kw_only=True)
class Hardening(Effect):
    """A user's own effect."""

    k3: Value
    name: ClassVar[str] = "hardening"
    summary: ClassVar[str] = "a spring that stiffens"
    source: ClassVar[str] = "this test"
    residual: ClassVar[str] = "third harmonic"
    confusable: ClassVar[str] = "gap"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter(symbol="k3", unit="N/m^3", neutral=0.0),)

    def fill(self, slots: Slots) -> Slots:
        return replace(slots, added_force=slots.added_force + symbol("k3") * DRIFT**3)


STOREY_EFFECTS = {
    "asymmetry", "backlash", "coulomb_friction", "cubic_stiffness", "foliente_pinching", "gap_impact", "hysteresis",
    "maxwell_branch", "p_delta", "quadratic_damping", "slip_lock", "stiffness_degradation", "storey_parameter",
    "strength_degradation", "sudden_damage", "viscous_damper",
}  # fmt: skip


def test_the_catalogue_lists_the_storeys_effects():
    assert {facts.name for facts in catalogue() if facts.level == "link"} == STOREY_EFFECTS


@pytest.mark.parametrize("facts", catalogue(), ids=lambda facts: facts.name)
def test_facts_are_complete(facts):
    assert facts.level in ("link", "node", "structure", "excitation", "observation")
    for text in (facts.summary, facts.source, facts.leaves_in_the_residual, facts.hard_to_tell_from):
        assert text and "\n" not in text
    assert facts.parameters
    assert all(parameter.description and parameter.source for parameter in facts.parameters)


def test_sudden_damage_lists_every_parameter_that_can_jump():
    facts = next(facts for facts in catalogue() if facts.name == SuddenDamage.name)
    assert {"k_jump", "k_time", "delta_nu_jump", "delta_nu_time"} <= {p.symbol for p in facts.parameters}


@pytest.mark.usefixtures("own_registry")
def test_a_users_effect_is_registered_the_same_way():
    assert register(Hardening) is Hardening
    assert Hardening in registered()
    facts = catalogue()[-1]
    assert facts.name == "hardening"
    assert facts.equations[0].text == "F_added = k3 u³"
    register(Hardening)
    assert registered().count(Hardening) == 1


@pytest.mark.usefixtures("own_registry")
def test_a_taken_name_is_refused():
    thief = type("Thief", (Hardening,), {"name": SlipLock.name})
    with pytest.raises(UserError, match="the name slip_lock belongs to SlipLock"):
        register(thief)


@pytest.mark.usefixtures("own_registry")
def test_a_class_of_the_same_name_does_not_take_the_place_of_a_catalogued_one():
    """A user's class called SlipLock stood in the place of the package's without a word."""
    thief = type("SlipLock", (Hardening,), {"name": SlipLock.name})
    with pytest.raises(UserError, match="the name slip_lock belongs to SlipLock"):
        register(thief)
    assert SlipLock in registered()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"summary": ""}, "the class attribute summary is missing"),
        ({"name": "My Effect"}, "use lower-case words"),
        ({"parameters": (Parameter(symbol="k5", unit="", neutral=0.0),)}, "no field for the parameter k5"),
    ],
)
def test_an_incomplete_effect_is_refused(change, sentence):
    with pytest.raises(UserError, match=sentence):
        register(type("Broken", (Hardening,), change))


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"v0": 0.1, "smoothing": "atan"}, "'atan' is not known: choose one of tanh, ratio, root, dahl"),
        ({"x0": 0.1}, "'tanh' has a width v0: give it, not x0"),
        ({"v0": 0.1, "smoothing": "dahl"}, "'dahl' has a width x0: give it, not v0"),
        ({"v0": 0.1, "x0": 0.1, "smoothing": "dahl"}, "'dahl' has a width x0"),
    ],
)
def test_a_friction_has_the_width_of_its_law(given, sentence):
    with pytest.raises(UserError, match=sentence):
        CoulombFriction(F_c=1.0, **given)


def test_a_class_that_is_not_a_frozen_dataclass_is_refused():
    with pytest.raises(UserError, match="frozen=True"):
        register(type("Plain", (), {"name": "plain"}))
