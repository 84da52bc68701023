"""What ``discovery.json`` states with probabilities (schema 2), read in one place; of schema 1 nothing is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

SURE = 0.9
"""From this probability an effect is named; a wrong one above it is wrong with confidence."""


@dataclass(frozen=True, kw_only=True)
class Stated:
    """Probabilities that a discovery states.

    Attributes
    ----------
    names : mapping of str to float
        That an effect of this name is part of the model, at any place; 0 where it is not listed.
    verdicts : mapping of str to float
        Of each verdict.
    """

    names: Mapping[str, float]
    verdicts: Mapping[str, float]


def stated(discovery: Mapping[str, Any]) -> Stated | None:
    """Read the probabilities of a ``discovery.json``; None where it states none.

    An effect's own ``probability`` counts where ``probabilities`` lacks its name.
    """
    if discovery.get("schema") != 2:
        return None
    own = {e["name"]: e["probability"] for e in discovery["effects"] if e.get("probability") is not None}
    listed = {name: p for name, p in discovery["probabilities"].items() if p is not None}
    verdicts = {name: p for name, p in discovery["verdict_probabilities"].items() if p is not None}
    return Stated(names={**own, **listed}, verdicts=verdicts)
