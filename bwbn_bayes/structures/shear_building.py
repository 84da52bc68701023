"""The base-excited shear building; one storey makes a single-degree-of-freedom oscillator."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from bwbn_bayes.elements.element import Element, require_element
from bwbn_bayes.structures.parts import Links
from bwbn_bayes.structures.structure import Structure, masses_of


def ShearBuilding(  # noqa: N802  a model reads like the class it once was
    *,
    masses: Sequence[float],
    storey: Element,
    isolator: Element | None = None,
    heights: Sequence[float] | None = None,
) -> Structure:
    """Floors on storeys that all have one element, on an isolation layer where one is given.

    Parameters
    ----------
    masses : sequence of float
        Floor masses from the ground up, one per storey; the slab on the isolators first. [kg]
    storey : Element
        The element of every storey above the isolators.
    isolator : Element, optional
        That of the isolators together, between ground and slab: storey 1.
    heights : sequence of float, optional
        Storey heights from the ground up; with them drifts are told as ratios too. [m]

    Raises
    ------
    UserError
        If a mass or a height is not positive, the heights are not one per storey, a storey is no element, or a value
        lies outside its admissible range.
    """
    require_element("storey", storey)
    if isolator is not None:
        require_element("isolator", isolator)
    masses = masses_of(masses)
    joins = tuple(pairwise(range(len(masses) + 1)))
    n_isolated = 1 if isolator is not None else 0
    elements = (storey if isolator is None else isolator, storey)
    layers = (joins[:n_isolated], joins[n_isolated:])
    links = tuple(Links(element=one, joins=own) for one, own in zip(elements, layers, strict=True) if own)
    return Structure(masses=masses, links=links, heights=heights)
