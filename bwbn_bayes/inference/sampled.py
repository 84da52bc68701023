"""What a sampler is given, and what it comes to."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from bwbn_bayes.inference.history import History
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.settings import Settings
from bwbn_bayes.inference.summary import Draws
from bwbn_bayes.results import Check


class Given(NamedTuple):
    """A posterior at its final scheme and its optima, best first; streams; whether the model leaves but noise."""

    target: Posterior
    modes: tuple[Mode, ...]
    settings: Settings
    rng: np.random.Generator
    seeds: np.random.SeedSequence
    history: History
    explains: bool


class Sampled(NamedTuple):
    """Which method ran in the end, its draws, log evidences with their errors by name, checks."""

    method: str
    draws: Draws
    evidences: Mapping[str, tuple[float, float]]
    checks: tuple[Check, ...]
