"""What a sampling method comes to."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from bwbn_bayes.inference.summary import Draws
from bwbn_bayes.results import Check


class Sampled(NamedTuple):
    """Its draws (none where its own check failed), log evidences with their errors by name, checks."""

    draws: Draws | None
    evidences: Mapping[str, tuple[float, float]]
    checks: tuple[Check, ...]
