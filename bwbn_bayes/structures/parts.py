"""What a structure is made of: links of an element between nodes, and effects with their places."""

from __future__ import annotations

from dataclasses import dataclass
from operator import index

from bwbn_bayes.elements.element import Element, require_element
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.errors import UserError

SPECIMEN = "the specimen"
"""The one place in a testing machine, in words."""


@dataclass(frozen=True, kw_only=True)
class Links:
    """Links of one element, which share what of it is not ``PerStorey``.

    Attributes
    ----------
    element : Element
        Their law: :class:`~bwbn_bayes.elements.bouc_wen.BoucWen`, :class:`~bwbn_bayes.elements.linear.Linear` or
        :class:`~bwbn_bayes.elements.friction_pendulum.FrictionPendulum`.
    joins : tuple of (int, int)
        The nodes of each link: the one that it stands on, the one where it ends. Its drift is the displacement of the
        second less that of the first.
    """

    element: Element
    joins: tuple[tuple[int, int], ...]

    def __post_init__(self) -> None:
        """Nodes are whole numbers, of whatever kind they were given."""
        require_element("element", self.element)
        try:
            joins = tuple((index(lower), index(upper)) for lower, upper in self.joins)
        except (TypeError, ValueError):
            raise UserError(
                f"joins = {self.joins!r}: give the two nodes of each link, such as ((0, 1), (1, 2))"
            ) from None
        object.__setattr__(self, "joins", joins)


@dataclass(frozen=True, kw_only=True)
class PlacedEffect:
    """An effect and the storeys (or floors, from 1) it acts on; none where it acts on the whole building."""

    effect: Effect
    storeys: tuple[int, ...]
