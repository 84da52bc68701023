"""The displacement-driven specimen against OpenSees, live and from the list of the differential equation's limit."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from laboratory import cyclic_test, shaking, solve, specimen
from opensees_material import VECTORS, forces_at_turning_points

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.errors import UserError
from bwbn_bayes.structures.specimen import Specimen

PER_SEGMENT = 400
SHORT_OF_THE_LIMIT = 5e-3
"""OpenSees's own error at a step of 2e-4, in forces of about 20."""
ELEMENT = {p.symbol for p in BoucWen(k=1.0, beta=1.0, gamma=0.0).parameters}
NUMBERS = range(len(VECTORS))


@cache
def ours(number: int) -> tuple[np.ndarray, float]:
    """Forces at the turning points and the energy at the end, by the lanes engine."""
    vector = VECTORS[number]
    element = {symbol: value for symbol, value in vector["parameters"].items() if symbol in ELEMENT}
    model = specimen({s: v for s, v in vector["parameters"].items() if s not in ELEMENT}, **element)
    record = cyclic_test(vector["turning_points"], PER_SEGMENT)
    solution = solve(model, record, ["force", "hysteretic_energy_1"], substeps=32)
    return solution["force"][PER_SEGMENT::PER_SEGMENT], float(solution["hysteretic_energy_1"][-1])


@cache
def opensees(number: int, step: float) -> np.ndarray:
    vector = VECTORS[number]
    return forces_at_turning_points(vector["material"], vector["parameters"], vector["turning_points"], step)


@pytest.mark.parametrize("number", NUMBERS)
def test_forces_and_energy_meet_the_listed_limit(number):
    forces, energy = ours(number)
    np.testing.assert_allclose(forces, VECTORS[number]["forces"], atol=1e-7)
    # The list is rounded: half a unit of its last digit, and the integration error of ours.
    assert energy == pytest.approx(
        VECTORS[number]["energy"], abs=0.5 * 10.0 ** -VECTORS[number]["energy_digits"] + 1e-6
    )


@pytest.mark.parametrize("number", NUMBERS)
def test_opensees_approaches_us_at_first_order(number):
    forces, _ = ours(number)
    errors = [np.max(np.abs(opensees(number, step) - forces)) for step in (4e-4, 2e-4)]
    assert errors[1] < SHORT_OF_THE_LIMIT
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("number", NUMBERS)
def test_opensees_extrapolated_agrees_with_us(number):
    forces, _ = ours(number)
    extrapolated = 2.0 * opensees(number, 2e-4) - opensees(number, 4e-4)
    np.testing.assert_allclose(extrapolated, forces, atol=2e-5)


def test_opensees_approaches_the_listed_limit_too():
    for number in NUMBERS:
        np.testing.assert_allclose(opensees(number, 2e-4), VECTORS[number]["forces"], atol=SHORT_OF_THE_LIMIT)


def test_a_specimen_has_one_storey_and_no_masses():
    model = Specimen(storey=BoucWen(k=1.0, beta=1.0, gamma=1.0))
    assert model.n_storeys == 1
    assert model.excitation_kind == "displacement"


def test_a_ground_motion_does_not_drive_a_specimen():
    with pytest.raises(UserError, match="is driven by ground_acceleration, the model by displacement"):
        solve(Specimen(storey=BoucWen(k=1.0, beta=1.0, gamma=1.0)), shaking(), ["force"], 1)
