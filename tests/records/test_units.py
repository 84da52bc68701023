"""Units: factors to SI against their definitions, and what is refused."""

from __future__ import annotations

import time

import pytest

from bwbn_bayes.errors import UserError
from bwbn_bayes.records.units import si_factor

POUND_FORCE = 0.45359237 * 9.80665


@pytest.mark.parametrize(
    ("column", "unit", "factor"),
    [
        ("time", "s", 1.0),
        ("time", "ms", 1e-3),
        ("ground_acceleration", "m/s^2", 1.0),
        ("ground_acceleration", "m/s2", 1.0),
        ("ground_acceleration", "m/s**2", 1.0),
        ("ground_acceleration", "m/s²", 1.0),
        ("ground_acceleration", "m s^-2", 1.0),
        ("ground_acceleration", "m·s^-2", 1.0),
        ("ground_acceleration", "m/s/s", 1.0),
        ("acceleration_1", "g", 9.80665),
        ("acceleration_1", " G ", 9.80665),
        ("acceleration_1", "g_0", 9.80665),
        ("acceleration_1", "mg", 9.80665e-3),
        ("acceleration_1", "%g", 9.80665e-2),
        ("acceleration_1", "gal", 1e-2),
        ("acceleration_1", "Gal", 1e-2),
        ("acceleration_1", "cm/s^2", 1e-2),
        ("relative_acceleration_2", "mm/s^2", 1e-3),
        ("acceleration_1", "in/s^2", 0.0254),
        ("acceleration_1", "ft/s^2", 0.3048),
        ("displacement", "mm", 1e-3),
        ("displacement_1", "in", 0.0254),
        ("drift_1", "inch", 0.0254),
        ("drift_1", "µm", 1e-6),
        ("force", "kN", 1e3),
        ("force", "kip", 1e3 * POUND_FORCE),
        ("force_1", "lbf", POUND_FORCE),
        ("force_1", "kg m/s^2", 1.0),
        ("acceleration_1", "0.25 g", 0.25 * 9.80665),
        ("acceleration_1", "-1 g", -9.80665),
        ("acceleration_1", "2.4e-6 m/s2", 2.4e-6),
        ("drift_1", "5mm", 5e-3),
    ],
)
def test_factor_to_si(column: str, unit: str, factor: float) -> None:
    assert si_factor(column, unit) == pytest.approx(factor, rel=1e-15)


@pytest.mark.parametrize(
    ("column", "unit"),
    [("acceleration_1", "m"), ("force", "kg"), ("time", "Hz"), ("displacement", "g"), ("drift_1", "degC")],
)
def test_wrong_dimension(column: str, unit: str) -> None:
    with pytest.raises(UserError, match=rf"the unit \[{unit}\] has the wrong dimension: write a unit of"):
        si_factor(column, unit)


@pytest.mark.parametrize(
    "unit",
    [
        "",
        "g0",
        "furlongish",
        "2 2 m",
        "0 m",
        "1e999 m",
        "9" * 60 + " m",
        "2",
        "m;",
        "m^(9**9**9)",
        "m^999999999",
        "__import__('os')",
        "m" * 60,
        "m*" * 5000 + "m",
    ],
)
def test_text_that_is_no_unit(unit: str) -> None:
    start = time.perf_counter()
    with pytest.raises(UserError, match="is not understood: write a unit of drift such as m") as refused:
        si_factor("drift_1", unit)
    assert len(str(refused.value)) < 120
    assert time.perf_counter() - start < 5.0
