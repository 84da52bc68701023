"""Loops that may harden in the place of those that may not."""

from __future__ import annotations

from dataclasses import replace

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Constraint
from bwbn_bayes.structures.structure import Structure


def free_of(model: Structure, condition: Constraint) -> Structure | None:
    """The model whose Bouc-Wen loops may harden, where that lifts a condition and no effect needs the bound."""
    groups = tuple(
        replace(group, element=replace(group.element, hardens=True)) if isinstance(group.element, BoucWen) else group
        for group in model.links
    )
    try:
        freed = replace(model, links=groups)
    except UserError:
        return None
    return None if condition.text in (one.text for one in freed.space.constraints) else freed
