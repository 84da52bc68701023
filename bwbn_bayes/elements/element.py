"""What a link can be: the contract of an element, and the one law in which links of several elements are written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import sympy as sp

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.law import Addition, Definition
from bwbn_bayes.errors import UserError, in_short
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
    def adds(self) -> tuple[Addition, ...]:
        """What it adds to the law of the Bouc-Wen link, with parameters that at neutral values add nothing."""
        ...

    @property
    def constraints(self) -> tuple[sp.Basic, ...]:
        """Joint admissibility conditions on its parameters."""
        ...

    @property
    def values(self) -> Mapping[str, Value]:
        """The value (number, prior or PerStorey) of each parameter, by symbol."""
        ...


def require_element(name: str, given: object) -> None:
    """Raise :class:`UserError` unless an argument is an element with its values."""
    if isinstance(given, type) or not all(hasattr(given, one) for one in ("parameters", "derived", "values")):
        raise UserError(f"{name} is {in_short(given)}: give one element, such as BoucWen(...) or Linear(...)")


_PLAIN = BoucWen(k=0.0, beta=0.0, gamma=0.0)


def common_element(elements: Sequence[Element]) -> Element:
    """The element whose parameters all others have too, or know; what some add to the law comes on top.

    Raises
    ------
    UserError
        If there is none.
    """
    if not elements:
        raise UserError("the structure has no links: join every mass to the ground by a chain of them")
    added = {parameter.symbol for element in elements for more in element.adds for parameter in more.parameters}
    plain = [element for element in elements if not element.adds]
    most = max([*plain, *([_PLAIN] if added else [])], key=lambda one: len(one.parameters))
    own = {parameter.symbol for parameter in most.parameters}
    for element in elements:
        symbols = {parameter.symbol for parameter in element.parameters} - added
        known = {one.subject.name for one in element.derived if one.expression.is_number}
        if element.derived != most.derived and not symbols <= own <= symbols | known:
            raise UserError(
                f"a {element.name} link with {', '.join(sorted(symbols))} does not go with a {most.name} link with "
                f"{', '.join(sorted(own))}: give all Bouc-Wen links beta and gamma, or all of them u_y and rho"
            )
    return most
