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


def at_random(material: str, seed: int) -> dict[str, float]:
    """Parameters of a law with z_u and force of the order of one; gamma of either sign, A apart from one."""
    rng = np.random.default_rng(seed)
    n, bound, ratio = rng.uniform(1.0, 3.0), rng.uniform(0.3, 1.5), rng.uniform(0.5, 1.3)
    spring = {"alpha": rng.uniform(-0.03, 0.3), "k": rng.uniform(1.0, 5.0), "n": n, "A": rng.uniform(0.7, 1.5)}
    spring |= {"beta": ratio * bound**-n, "gamma": (1.0 - ratio) * bound**-n}
    if material == "BoucWen":
        return {**spring, "delta_nu": rng.uniform(0.0, 0.2), "delta_eta": rng.uniform(0.0, 0.2)}
    pinch = {"q": rng.uniform(0.0, 0.4), "zeta_s": rng.uniform(0.2, 0.9), "p": rng.uniform(0.1, 2.0)}
    return {**spring, **pinch, "psi_0": rng.uniform(0.1, 0.5), "delta_psi": 0.01, "lambda_": rng.uniform(0.1, 0.5)}


@pytest.mark.parametrize("material", ["BoucWen", "BWBN"])
@pytest.mark.parametrize("seed", range(6))
def test_a_law_at_random_is_that_of_opensees(material: str, seed: int):
    """Forces of the order of one at twelve turning points; first order in the step, extrapolated."""
    values = at_random(material, seed)
    turning = np.random.default_rng(100 + seed).uniform(0.3, 3.0, 12) * np.tile([1.0, -1.0], 6)
    model = specimen(
        {s: v for s, v in values.items() if s not in ELEMENT}, **{s: values[s] for s in ELEMENT & {*values}}
    )
    solution = solve(model, cyclic_test(turning, PER_SEGMENT), ["force"], substeps=32)
    forces = solution["force"][PER_SEGMENT::PER_SEGMENT]
    coarse, fine = (forces_at_turning_points(material, values, turning, step) for step in (4e-4, 2e-4))
    assert np.max(np.abs(fine - forces)) < SHORT_OF_THE_LIMIT
    np.testing.assert_allclose(2.0 * fine - coarse, forces, atol=2e-5)


def test_opensees_approaches_the_listed_limit_too():
    for number in NUMBERS:
        np.testing.assert_allclose(opensees(number, 2e-4), VECTORS[number]["forces"], atol=SHORT_OF_THE_LIMIT)


def test_a_specimen_has_one_storey_and_no_masses():
    model = Specimen(storey=BoucWen(k=1.0, beta=1.0, gamma=1.0))
    assert model.n_links == 1
    assert model.excitation_kind == "displacement"


def test_a_ground_motion_does_not_drive_a_specimen():
    with pytest.raises(UserError, match="is driven by ground_acceleration, the model by displacement"):
        solve(Specimen(storey=BoucWen(k=1.0, beta=1.0, gamma=1.0)), shaking(), ["force"], 1)
