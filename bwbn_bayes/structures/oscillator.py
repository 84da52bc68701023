"""One mass on one spring: a shaker test, a device on a table, an electronic oscillator."""

from __future__ import annotations

from bwbn_bayes.elements.element import Element, require_element
from bwbn_bayes.parameters import require_number
from bwbn_bayes.structures.parts import Links
from bwbn_bayes.structures.structure import Structure


def Oscillator(*, mass: float, spring: Element) -> Structure:  # noqa: N802  as the other structures
    """A mass that a link joins to the ground, moved by a force on it, by the ground, or by both.

    Parameters
    ----------
    mass : float
        [kg]
    spring : Element
        The link between ground and mass.

    Raises
    ------
    UserError
        If the mass is not positive, the spring is no element, or a value lies outside its admissible range.
    """
    require_number("mass", mass)
    require_element("spring", spring)
    return Structure(masses=(mass,), links=(Links(element=spring, joins=((0, 1),)),))
