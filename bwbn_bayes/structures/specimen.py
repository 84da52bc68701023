"""A specimen in a testing machine: the displacement is given, the force is measured."""

from __future__ import annotations

from bwbn_bayes.elements.element import Element, require_element
from bwbn_bayes.structures.parts import Links
from bwbn_bayes.structures.structure import Structure


def Specimen(*, storey: Element) -> Structure:  # noqa: N802  a model reads like the class it once was
    """One link driven by a displacement history that is straight between samples.

    Parameters
    ----------
    storey : Element
        Its drift is the displacement.

    Raises
    ------
    UserError
        If it is no element, or a value lies outside its admissible range.
    """
    require_element("storey", storey)
    return Structure(masses=(), links=(Links(element=storey, joins=((0, 1),)),), excitation_kind="displacement")
