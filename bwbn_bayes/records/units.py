"""Units of measured columns: text such as ``mm`` or ``g`` to a factor to SI."""

from __future__ import annotations

import math
import re
from functools import cache

import pint

from bwbn_bayes.errors import UserError
from bwbn_bayes.records.record import quantity_of, si_unit

# Only products of powers of plain words reach pint's parser, so that a header like [m^(9**9**9)] costs nothing.
_NUMBER = r"[+-]?(?:[0-9]{1,20}(?:\.[0-9]{0,20})?|\.[0-9]{1,20})(?:[eE][+-]?[0-9]{1,3})?"
_SCALED = re.compile(rf"({_NUMBER})\s*(?:\*\s*)?([^0-9\s].*)")
_TERM = r"(?:1|%?[A-Za-zµμ_]+(?:_0)?(?:(?:\^|\*\*)?-?[0-9]{1,2}|²)?)"
_SHOWN = 40
"""Length of the longest unit, and of what a sentence shows of one."""
_UNIT = re.compile(rf"{_TERM}(?:(?:\s*[*/·]\s*|\s+){_TERM})*")
_BARE_POWER = re.compile(r"(?<=[A-Za-zµμ])(-?[0-9]+)")

# In an acceleration column these are never gram, gallon or milligram.
_ACCELERATION_WORDS = {
    "g": "standard_gravity",
    "gn": "standard_gravity",
    "%g": "0.01 * standard_gravity",
    "mg": "0.001 * standard_gravity",
    "gal": "galileo",
    "mgal": "milligalileo",
}


@cache
def _registry() -> pint.UnitRegistry[float]:
    return pint.UnitRegistry()


def si_factor(column: str, unit: str) -> float:
    """Factor that takes a column's numbers to SI.

    Parameters
    ----------
    column : str
        Column name, e.g. ``acceleration_1``; it decides the dimension. In an acceleration ``g`` is standard gravity.
    unit : str
        As written in the file: ``m/s^2``, ``m/s2``, ``g``, ``gal``, ``mm``, ``in``, ``kN``, ``kip``, ``ms`` ..., or a
        sensor's scale and its unit: ``0.25 g`` for numbers in volts where a volt is a quarter of g.

    Returns
    -------
    float
        ``value [SI] = factor * value [unit]``.

    Raises
    ------
    UserError
        If the unit is not understood or has another dimension than the column.
    """
    target = si_unit(column)
    wanted = f"write a unit of {(quantity_of(column) or '').replace('_', ' ')} such as {target}"
    scaled = _SCALED.fullmatch(unit.strip())
    scale, text = (float(scaled.group(1)), scaled.group(2)) if scaled else (1.0, unit.strip())
    if scale == 0.0 or not math.isfinite(scale):
        raise UserError(f"the unit [{unit[:_SHOWN]}] is not understood: {wanted}")
    if target == "m/s^2" and text.lower() in _ACCELERATION_WORDS:
        text = _ACCELERATION_WORDS[text.lower()]
        return scale * float(_registry().Quantity(text).m_as(target))
    return scale * _pint_factor(text, unit, target, wanted)


def frequency_factor(unit: str) -> float:
    """Factor that takes a sampling rate to Hz: ``Hz``, ``kHz``, ``1/s``.

    Raises
    ------
    UserError
        If the unit is not understood or no frequency.
    """
    return _pint_factor(unit.strip(), unit, "Hz", "write a unit of frequency such as Hz")


def _pint_factor(text: str, unit: str, target: str, wanted: str) -> float:
    registry = _registry()
    if len(text) > _SHOWN or not _UNIT.fullmatch(text):
        raise UserError(f"the unit [{unit[:_SHOWN]}] is not understood: {wanted}")
    try:
        quantity = registry.Quantity(1.0, registry.parse_units(_BARE_POWER.sub(r"^\1", text).replace("·", "*")))
        return float(quantity.m_as(target))
    except pint.DimensionalityError:
        raise UserError(f"the unit [{unit}] has the wrong dimension: {wanted}") from None
    except (pint.PintError, AttributeError, KeyError, ValueError, AssertionError):
        raise UserError(f"the unit [{unit}] is not understood: {wanted}") from None
