"""What a search knows before it has ended: ``discovery.json`` as it stands after each step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.held_out import floor_of
from bwbn_bayes.discovery.outcome import LEAST_SHOWN, SCHEMA, Step, steps_as_json, where_as_json
from bwbn_bayes.discovery.probability import Beliefs
from bwbn_bayes.inference.residuals import residual_of
from bwbn_bayes.records.blocks import mean_squares
from bwbn_bayes.results import finite


@dataclass(frozen=True, kw_only=True)
class Unfinished:
    """A search that goes on.

    Attributes
    ----------
    name : str
        The model's.
    data : str
        Hash of the record as given.
    given : Explanation
        The model as given.
    believed : Beliefs
        By now.
    steps : tuple of Step
    notes : tuple of str
        What the reader of the verdict must know besides.
    binding : tuple of str
        Priors that bind, in sentences.
    seed : int
    elapsed_s : float
    """

    name: str
    data: str
    given: Explanation
    believed: Beliefs
    steps: tuple[Step, ...]
    notes: tuple[str, ...]
    binding: tuple[str, ...]
    seed: int
    elapsed_s: float

    @property
    def _probabilities(self) -> list[tuple[str, float]]:
        """Of each name, best first; none is of an improved model yet, and asked whether it is deserved."""
        return sorted(self.believed.law_probabilities.items(), key=lambda item: -item[1])

    def as_json(self) -> dict[str, Any]:
        """``discovery.json``, schema 2, with ``finished`` false; what is known at the end alone is empty or None.

        Held-out data are not looked at before the end.
        """
        record, best = self.given.posterior.record, self.believed.deliverable[0]
        fit = {"before": _nrmse(self.given), "after": _nrmse(best)}
        facts: dict[str, Any] = {
            "schema": SCHEMA,
            "finished": False,
            "model": self.name,
            "record": record.name,
            "data_sha256": self.data,
            "verdict": self.believed.verdict,
            "verdict_probabilities": dict(self.believed.verdicts),
            "sentences": ["The search goes on: this is what is known by now.", *self.notes],
            "unexplained_share": None,
            "effects": [],
            "where": where_as_json(self.given.disagreement),
            "gap": {"metric": "nrmse", "noise_floor": floor_of(record), "fit": fit},
            "best_model": {
                "effects": [f"{one.name}{list(one.storeys)}" for one in best.added],
                "fit": fit["after"],
                "held_out": None,
                "cross_validated": best.cross_validation.nrmse,
                "log_score": best.cross_validation.log_score,
            },
            "probabilities": {name: p for name, p in self._probabilities if p >= LEAST_SHOWN},
            "families": [],
            "unnamed_force": None,
            "unnamed_reading": None,
            "binding_priors": list(self.binding),
            **steps_as_json(self.steps),
            "detection_limits": [],
            "stopped_by_time_limit": False,
            "elapsed_s": self.elapsed_s,
            "seed": self.seed,
        }
        return {key: finite(value) for key, value in facts.items()}


def _nrmse(one: Explanation) -> float:
    """Root mean square over the channels of each one's rms error over its rms, at the best fit."""
    record = one.posterior.record
    left, measured = (mean_squares(record, rows) for rows in (residual_of(one.posterior, one.best), record.measured))
    return float(np.sqrt(np.mean(left / measured)))
