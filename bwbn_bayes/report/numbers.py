"""Numbers and symbols as people read them: sensible digits, SI multiples, Greek letters."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from markupsafe import Markup, escape

MINUS = "\N{MINUS SIGN}"
NOTHING = "\N{EN DASH}"
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_GREEK = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "zeta": "ζ", "eta": "η", "theta": "θ",
    "kappa": "κ", "lambda": "λ", "mu": "μ", "nu": "ν", "xi": "ξ", "rho": "ρ", "sigma": "σ", "tau": "τ", "phi": "φ",
    "psi": "ψ", "omega": "ω",
}  # fmt: skip
_MULTIPLES = {
    "m": ((0.05, "mm", 1e3), (math.inf, "m", 1.0)),
    **{
        f"N{rest}": ((1e4, f"N{rest}", 1.0), (1e7, f"kN{rest}", 1e-3), (math.inf, f"MN{rest}", 1e-6))
        for rest in ("", "/m", " s/m", "/m^3")
    },
    "J": ((1e4, "J", 1.0), (1e7, "kJ", 1e-3), (math.inf, "MJ", 1e-6)),
}


class Scale(NamedTuple):
    """A display unit and the factor that takes SI values to it."""

    unit: str
    factor: float


def display_scale(unit: str, magnitude: float) -> Scale:
    """The multiple of an SI unit in which a magnitude reads well.

    Parameters
    ----------
    unit : str
        SI unit; ``m``, ``N``, ``N/m``, ``N s/m``, ``N/m^3`` and ``J`` have multiples, others stay.
    magnitude : float
        Largest absolute value to be shown, in that unit.
    """
    for below, name, factor in _MULTIPLES.get(unit, ()):
        if magnitude < below:
            return Scale(name, factor)
    return Scale(unit, 1.0)


def decimal_place(sd: float) -> int:
    """Decimal place (2 for hundredths, -1 for tens) that shows an sd with two digits."""
    rounded = float(f"{sd:.1e}")
    return 1 - math.floor(math.log10(abs(rounded)))


def with_uncertainty(values: tuple[float, ...], sd: float) -> tuple[str, ...]:
    """Values rounded to the place of the sd's second digit; very large or small ones share a power of ten.

    Parameters
    ----------
    values : tuple of float
        Numbers that belong together, such as mean, sd and interval ends.
    sd : float
        Their uncertainty. Where it is none, lost in rounding or not finite, four significant digits are shown.

    Returns
    -------
    tuple of str
        ``("0.0204", "0.0012")`` for ``(0.02041, 0.00123)`` and sd 0.00123; an en dash for what is not finite.
    """
    largest = max((abs(value) for value in values if math.isfinite(value)), default=0.0)
    if not (math.isfinite(sd) and sd > math.ulp(largest)):
        return tuple(significant(value) for value in values)
    exponent = math.floor(math.log10(largest)) if largest > 0.0 else 0
    exponent = 0 if -3 <= exponent < 5 else exponent
    place = decimal_place(sd) + exponent
    return tuple(_fixed(value / 10.0**exponent, place, exponent) for value in values)


def significant(value: float, digits: int = 4) -> str:
    """A number with a number of significant digits, trailing zeros dropped."""
    if not math.isfinite(value):
        return NOTHING if math.isnan(value) else ("∞" if value > 0 else f"{MINUS}∞")
    if value == 0.0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if -4 <= exponent < 6:
        return _trimmed(f"{value:.{max(digits - 1 - exponent, 0)}f}").replace("-", MINUS)
    return (_trimmed(f"{value / 10.0**exponent:.{digits - 1}f}") + _power(exponent)).replace("-", MINUS)


def percent(share: float) -> str:
    """A share as a percentage with two significant digits, trailing zero kept."""
    if not math.isfinite(share) or share == 0.0:
        return f"{significant(share)}\N{NO-BREAK SPACE}%"
    (text,) = with_uncertainty((100.0 * share,), 100.0 * abs(share))
    return f"{text}\N{NO-BREAK SPACE}%"


def duration(seconds: float) -> str:
    """A duration in seconds, minutes or hours."""
    if not math.isfinite(seconds):
        return NOTHING
    if seconds < 120.0:
        return f"{significant(seconds, 3)}\N{NO-BREAK SPACE}s"
    minutes = seconds / 60.0
    if minutes < 120.0:
        return f"{significant(minutes, 2)}\N{NO-BREAK SPACE}min"
    return f"{significant(minutes / 60.0, 2)}\N{NO-BREAK SPACE}h"


def html_symbol(name: str) -> Markup:
    """A parameter's label as italic symbol with subscripts: ``delta_nu[2]`` becomes delta with subscript nu, 2."""
    base, subscripts = _parts(name)
    subscript = Markup("<sub>{}</sub>").format(",\N{THIN SPACE}".join(subscripts)) if subscripts else Markup("")
    return Markup("<i>{}</i>{}").format(base, subscript)


def math_symbol(name: str) -> str:
    """A parameter's label in Matplotlib's math text, safe for any name."""
    base, subscripts = _parts(name)
    subscript = ",".join(_math_word(word) for word in subscripts)
    return f"${_math_word(base)}_{{{subscript}}}$" if subscript else f"${_math_word(base)}$"


def html_unit(unit: str) -> Markup:
    """A unit with its powers raised: ``m/s^2``, ``1/m^n``."""
    raised = re.sub(r"\^(-?\w+)", r"<sup>\1</sup>", str(escape(unit)))
    return Markup(raised.replace("1/", "1/\N{WORD JOINER}"))


def math_unit(unit: str) -> str:
    """A unit in Matplotlib's math text, in brackets; empty where dimensionless."""
    text = re.sub(r"\^(-?\w+)", r"$^{\1}$", re.sub(r"[\\${}]", "", unit))
    return f" [{text}]" if text else ""


def _parts(name: str) -> tuple[str, tuple[str, ...]]:
    symbol, _, index = name.partition("[")
    words = [_GREEK.get(word, word) for word in symbol.split("_") if word] or [symbol]
    place = index.rstrip("]").replace("_", " ")
    return words[0], (*words[1:], *([place] if place else []))


def _math_word(word: str) -> str:
    plain = re.sub(r"[^\w. -]|_", "", word).replace(" ", r"\ ")
    return plain if len(plain) <= 1 or plain.isdigit() else rf"\mathrm{{{plain}}}"


def _fixed(value: float, place: int, exponent: int) -> str:
    if not math.isfinite(value):
        return NOTHING
    text = f"{round(value, place):.{max(place, 0)}f}"
    text = text.lstrip("-") if float(text) == 0.0 else text
    return (text + (_power(exponent) if exponent else "")).replace("-", MINUS)


def _power(exponent: int) -> str:
    return f"\N{THIN SPACE}×\N{THIN SPACE}10{str(exponent).translate(_SUPERSCRIPTS)}"


def _trimmed(text: str) -> str:
    return text.rstrip("0").rstrip(".") if "." in text else text
