"""What a link can be: the contract of an element, and the one law in which links of several elements are written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import sympy as sp

from bwbn_bayes.elements.law import Definition
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Parameter, Value


class Element(Protocol):
    """A frozen dataclass with one field, named by its symbol, for each of its parameters.

    The law of every link is the Bouc-Wen link's (:mod:`~bwbn_bayes.elements.combine`), in which an element has some
    parameters of its own and knows the others: an effect written for one then works on all that have what it changes.
    """

    @property
    def name(self) -> str:
        """What effects call it when they say which elements they act on."""
        ...

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters of a link, in order."""
        ...

    @property
    def derived(self) -> tuple[Definition, ...]:
        """Symbols of the Bouc-Wen link that are no parameters, in terms of the parameters or as numbers."""
        ...

    @property
    def constraints(self) -> tuple[sp.Basic, ...]:
        """Joint admissibility conditions on its parameters."""
        ...

    @property
    def values(self) -> Mapping[str, Value]:
        """The value (number, prior or PerStorey) of each parameter, by symbol."""
        ...


def common_element(elements: Sequence[Element]) -> Element:
    """The element whose parameters all others have too, or know.

    Raises
    ------
    UserError
        If there is none.
    """
    if not elements:
        raise UserError("the structure has no links: join every mass to the ground by a chain of them")
    most = max(elements, key=lambda one: len(one.parameters))
    own = {parameter.symbol for parameter in most.parameters}
    for element in elements:
        symbols = {parameter.symbol for parameter in element.parameters}
        known = {one.subject.name for one in element.derived if one.expression.is_number}
        if element.derived != most.derived and symbols | known != own:
            raise UserError(
                f"a {element.name} link with {', '.join(sorted(symbols))} does not go with a {most.name} link with "
                f"{', '.join(sorted(own))}: give the Bouc-Wen links beta and gamma in the place of u_y and rho"
            )
    return most
