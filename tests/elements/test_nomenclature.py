"""docs/nomenclature.md names every parameter the code has, with the same unit, effect and source, and no other."""

from __future__ import annotations

from pathlib import Path

import pytest
from laboratory import FREE

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.catalogue import catalogue
from bwbn_bayes.elements.friction_pendulum import FrictionPendulum
from bwbn_bayes.elements.initial_state import InitialState
from bwbn_bayes.parameters import Parameter

PAGE = (Path(__file__).parents[2] / "docs" / "nomenclature.md").read_text(encoding="utf-8")


def table_under(heading: str) -> dict[str, list[str]]:
    """Cells of each row of the table under a heading, by symbol."""
    section = PAGE.split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in section.splitlines() if line.startswith("| `")
    ]
    return {row[0].strip("`"): row[1:] for row in rows}


ELEMENT = table_under("Parameters of the Bouc-Wen storey")
EFFECTS = table_under("Parameters of the effects")
FREE_SHAPES = table_under("Parameters of forms of free shape")
BY_SHAPE, BY_YIELD = BoucWen(k=1.0, beta=1.0, gamma=0.0), BoucWen(k=1.0, u_y=1.0, rho=0.5)
PARAMETERS = tuple(dict.fromkeys((*BY_SHAPE.parameters, *BY_YIELD.parameters)))
SLIDER = table_under("Parameters of the friction pendulum")
OF_SLIDER = FrictionPendulum(W=1.0, R=1.0, mu_slow=0.1, mu_fast=0.2, a_mu=1.0).parameters[1:]


def written(unit: str) -> str:
    return unit or "1"


@pytest.mark.parametrize("parameter", PARAMETERS, ids=lambda p: p.symbol)
def test_parameters_of_the_element(parameter: Parameter):
    _, unit, _, source = ELEMENT[parameter.symbol]
    assert unit == written(parameter.unit)
    assert source.split(";")[0] == parameter.source.split(";")[0]


@pytest.mark.parametrize("parameter", OF_SLIDER, ids=lambda p: p.symbol)
def test_parameters_of_the_friction_pendulum(parameter: Parameter):
    _, unit, _, source = SLIDER[parameter.symbol]
    assert (unit, source) == (written(parameter.unit), parameter.source)


@pytest.mark.parametrize("facts", catalogue(), ids=lambda facts: facts.name)
def test_parameters_of_the_effects(facts):
    for parameter in facts.parameters:
        effect, _, unit, _, source = EFFECTS[parameter.symbol]
        assert (effect, unit) == (facts.name, written(parameter.unit))
        assert parameter.source.startswith(source)


@pytest.mark.parametrize("form", FREE, ids=lambda form: form.name)
def test_parameters_of_forms_of_free_shape(form):
    for parameter in form.parameters:
        effect, _, unit, _, source = FREE_SHAPES[parameter.symbol]
        assert (effect, unit) == (form.name, written(parameter.unit))
        assert parameter.source.startswith(source)


def test_the_state_at_the_first_sample():
    rows = table_under("State at the first sample")
    assert rows == {p.symbol: [p.description, p.unit] for p in InitialState.parameters}


def test_the_page_names_no_parameter_that_does_not_exist():
    assert set(ELEMENT) == {parameter.symbol for parameter in PARAMETERS}
    assert set(SLIDER) == {parameter.symbol for parameter in OF_SLIDER}
    assert set(EFFECTS) == {parameter.symbol for facts in catalogue() for parameter in facts.parameters}
    assert set(FREE_SHAPES) == {parameter.symbol for form in FREE for parameter in form.parameters}
