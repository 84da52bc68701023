"""The whole model as equations to read: the equation of motion, then the storey law."""

from __future__ import annotations

from dataclasses import replace

from bwbn_bayes.elements.equations import WrittenEquation, law_equations, sensor_equations
from bwbn_bayes.elements.law import FLOOR_FORCE, FLOOR_MASS
from bwbn_bayes.structures.structure import Structure

_GROUND = "<msub><mi>a</mi><mi>g</mi></msub>"


def structure_equations(model: Structure) -> tuple[WrittenEquation, ...]:
    """Equation of motion, drift and measured acceleration of a structure, then its storey law.

    Parameters
    ----------
    model : Structure
        A building or a specimen; of what its law merely carries nothing is written.

    Returns
    -------
    tuple of WrittenEquation
        With one storey the subscripts are left out.
    """
    model = replace(model, carried=())
    motion = _building(model) if not model.is_driven else (_SPECIMEN,)
    motion += (_BENDING,) if model.law.bends else ()
    return motion + law_equations(model.law) + sensor_equations(model.sensors)


_SPECIMEN = WrittenEquation(
    caption="the displacement is given, straight between samples",
    text="du/dt = v",
    mathml="<mrow><mfrac><mrow><mi>d</mi><mi>u</mi></mrow><mrow><mi>d</mi><mi>t</mi></mrow></mfrac>"
    "<mo>=</mo><mi>v</mi></mrow>",
)


_BENDING = WrittenEquation(
    caption="drift beyond that of the storeys below and above, as far as there are such",
    text="u_b = (u_i − u_(i−1)) + (u_i − u_(i+1))",
    mathml="<mrow><msub><mi>u</mi><mi>b</mi></msub><mo>=</mo>"
    + "<mo>+</mo>".join(
        "<mrow><mo>(</mo><msub><mi>u</mi><mi>i</mi></msub><mo>−</mo>"
        f"<msub><mi>u</mi><mrow><mi>i</mi><mo>{sign}</mo><mn>1</mn></mrow></msub><mo>)</mo></mrow>"
        for sign in "−+"
    )
    + "</mrow>",
)


def _building(model: Structure) -> tuple[WrittenEquation, ...]:
    n_storeys, law = model.n_floors, model.law
    subjects = {definition.subject for definition in law.definitions}
    # With one storey the indices are left out, unless floor or base have laws of their own, which write them.
    many = n_storeys > 1 or law.acceleration is not None or law.base is not None
    mass = FLOOR_MASS.name[0] if FLOOR_MASS in subjects else "m"
    m, x, u, force, measured = (_indexed(letter, "i" if many else "") for letter in (mass, "x", "u", "F", "a"))
    further = _indexed(FLOOR_FORCE.name[0], "i")
    further_text, further_mathml = (f" + {further[0]}", _then("+", further[1])) if FLOOR_FORCE in subjects else ("", "")
    acceleration = _sum(f"<mover>{x[1]}<mo>¨</mo></mover>", _GROUND)
    second = "ẍ_i" if many else "ẍ"
    above, below = _indexed("F", "i+1"), _indexed("x", "i−1")
    last, ground = _indexed("F", f"{n_storeys + 1}"), _indexed("x", "0")
    upper_text, upper = (
        (f" + {above[0]}{further_text}, {last[0]} = 0", _then("+", above[1]) + further_mathml + _zero(last[1]))
        if many
        else ("", "")
    )
    base = _indexed(*law.base_states[0].name.split("_")) if law.base_states else ("0", "<mn>0</mn>")
    lower_text, lower = (
        (f" − {below[0]}, {ground[0]} = {base[0]}", _then("−", below[1]) + _equal(ground[1], base[1]))
        if many
        else ("", "")
    )
    return (
        WrittenEquation(
            caption="motion of a floor, x relative to the ground",
            text=f"{m[0]} ({second} + a_g) = −{force[0]}{upper_text}",
            mathml=_row(
                m[1], f"<mrow><mo>(</mo>{acceleration}<mo>)</mo></mrow>", "<mo>=</mo><mo>−</mo>", force[1], upper
            ),
        ),
        WrittenEquation(
            caption="drift",
            text=f"{u[0]} = {x[0]}{lower_text}",
            mathml=_row(u[1], "<mo>=</mo>", x[1], lower),
        ),
        WrittenEquation(
            caption="total acceleration of a floor" if model.sensors.definitions else "measured total acceleration",
            text=f"{measured[0]} = {second} + a_g",
            mathml=_row(measured[1], "<mo>=</mo>", acceleration),
        ),
    )


def _indexed(letter: str, index: str) -> tuple[str, str]:
    """A symbol as text and as MathML."""
    if not index:
        return letter, f"<mi>{letter}</mi>"
    text = f"{letter}_({index})" if len(index) > 1 and not index.isdigit() else f"{letter}_{index}"
    tag = "mn" if index.isdigit() else "mi"
    inner = f"<{tag}>{index}</{tag}>"
    if len(index) > 1 and not index.isdigit():
        inner = f"<mrow><mi>{index[0]}</mi><mo>{index[1]}</mo><mn>{index[2:]}</mn></mrow>"
    return text, f"<msub><mi>{letter}</mi>{inner}</msub>"


def _row(*parts: str) -> str:
    return f"<mrow>{''.join(parts)}</mrow>"


def _sum(left: str, right: str) -> str:
    return _row(left, "<mo>+</mo>", right)


def _then(sign: str, operand: str) -> str:
    return f"<mo>{sign}</mo>{operand}"


def _zero(symbol: str) -> str:
    return _equal(symbol, "<mn>0</mn>")


def _equal(symbol: str, other: str) -> str:
    return f"<mo>,</mo><mspace width='1em'/>{symbol}<mo>=</mo>{other}"
