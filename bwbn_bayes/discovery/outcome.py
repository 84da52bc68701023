"""What a discovery returns, and ``discovery.json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from bwbn_bayes.discovery.candidates import place_in_words
from bwbn_bayes.discovery.held_out import HeldOut, Prediction
from bwbn_bayes.discovery.name import Candidate, Decision
from bwbn_bayes.discovery.unexplained import Unexplained
from bwbn_bayes.discovery.where import Disagreement
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.results import Result, finite
from bwbn_bayes.structures.structure import Structure

SCHEMA = 1
CLOSED = 1.25
"""Error over noise up to which a gap counts as closed."""
Verdict = Literal["effects_found", "partly_explained", "no_missing_effect", "unexplained"]


@dataclass(frozen=True, kw_only=True)
class Added:
    """An effect that was added.

    Attributes
    ----------
    candidate : Candidate
        As it was weighed when it was added.
    decision : Decision
        The round that added it.
    moments : mapping of str to (float, float)
        Posterior mean and standard deviation of the parameters it brought, in the final model.
    separation : tuple of str
        For each effect that the record cannot tell it from, the experiment that would.
    """

    candidate: Candidate
    decision: Decision
    moments: Mapping[str, tuple[float, float]]
    separation: tuple[str, ...] = ()

    @property
    def alternatives(self) -> tuple[str, ...]:
        """What the record cannot tell it from, in words: other effects, and the same one at other places."""
        level = self.candidate.hypothesis.effect.level
        places = (f"the same at {place_in_words(level, place)}" for place in self.decision.equivalent_places)
        return (*self.decision.equivalent, *places)

    @property
    def doubt(self) -> str:
        """Why the sizes that it was given are hardly what its name says, after its label; empty where they are."""
        hypothesis, means = self.candidate.hypothesis, self.candidate.evidence.means
        sizes = {p.symbol: means[p.name] for p in hypothesis.model.space.parameters if p.name in hypothesis.brought}
        why = hypothesis.effect.doubt(sizes, hypothesis.scales)
        return f"{hypothesis.label}: {why}" if why else ""

    def as_json(self) -> dict[str, Any]:
        """One entry of ``effects``."""
        hypothesis = self.candidate.hypothesis
        return {
            "name": hypothesis.name,
            "form": hypothesis.effect.form,
            "storeys": list(hypothesis.storeys),
            "log_bayes_factor": self.candidate.log_bayes_factor,
            "log_bayes_factor_se": self.candidate.log_bayes_factor_se,
            "equivalent": list(self.decision.equivalent),
            "separation": list(self.separation),
            "equivalent_storeys": [list(place) for place in self.decision.equivalent_places],
            "parameters": {name: {"mean": mean, "sd": sd} for name, (mean, sd) in self.moments.items()},
        }


@dataclass(frozen=True, kw_only=True)
class Step:
    """One round of the loop: the disagreement it began with and what it decided."""

    number: int
    model: Structure
    disagreement: Disagreement
    decision: Decision | None
    sentence: str
    elapsed_s: float
    withdrawn: bool = False
    """Whether the effect that it added did not stay."""


@dataclass(frozen=True, kw_only=True)
class Gap:
    """The gap between model and record, before and after; with the one on data that the fit did not see, if any."""

    noise_floor: float
    before: Prediction
    after: Prediction
    held_out: Gap | None = None

    @property
    def left(self) -> float:
        """The error after, over the noise."""
        return self.after.nrmse / self.noise_floor

    @property
    def is_closed(self) -> bool:
        """Whether the error after is that of the noise, within a quarter or two standard errors."""
        return self.left <= CLOSED or self.after.nrmse - 2.0 * self.after.nrmse_se <= self.noise_floor


@dataclass(frozen=True, kw_only=True)
class DetectionLimit:
    """The smallest size of an effect that this record could have shown at a place; infinite where it could not."""

    label: str
    name: str
    storeys: tuple[int, ...]
    parameter: str
    unit: str
    smallest: float
    expected: float
    """Size that the default prior expects."""


@dataclass(frozen=True, kw_only=True)
class Discovery:
    """Everything a discovery found.

    Attributes
    ----------
    verdict : str
        ``effects_found``, ``partly_explained``, ``no_missing_effect`` or ``unexplained``.
    sentences : tuple of str
        The verdict in words, the most important first.
    unexplained_share : float
        Of the residual energy beyond the noise, what is left at the end.
    unexplained : Unexplained or None
        What is known of the rest, where some of it stays unexplained.
    added : tuple of Added
        Effects of the final model that the given one lacks, in order.
    steps : tuple of Step
    limits : tuple of DetectionLimit
    gap : Gap
    before, after : Disagreement
    histories : mapping of str to mapping of str to array
        ``before`` and ``after``: drift, drift rate, restoring force and so on, ``(n_storeys, n_times)``.
    model, improved : Structure
    record : Record
        What fit and selection saw.
    held_out : HeldOut or None
    result : Result
        The posterior of the improved model.
    name : str
    assumptions : tuple of str
        What the given model takes for granted.
    seed : int
    elapsed_s : float
        Without the final posterior.
    """

    verdict: Verdict
    sentences: tuple[str, ...]
    unexplained_share: float
    unexplained: Unexplained | None
    added: tuple[Added, ...]
    steps: tuple[Step, ...]
    limits: tuple[DetectionLimit, ...]
    gap: Gap
    before: Disagreement
    after: Disagreement
    histories: Mapping[str, Mapping[str, Floats]]
    model: Structure
    improved: Structure
    record: Record
    held_out: HeldOut | None
    result: Result
    name: str
    assumptions: tuple[str, ...]
    seed: int
    elapsed_s: float

    def as_json(self) -> dict[str, Any]:
        """``discovery.json``, schema 1; a number that is not finite becomes None, which JSON can hold."""
        gap: dict[str, Any] = {
            "metric": "nrmse",
            "noise_floor": self.gap.noise_floor,
            "fit": {"before": self.gap.before.nrmse, "after": self.gap.after.nrmse},
        }
        apart, unseen = self.held_out, self.gap.held_out
        if apart is not None and unseen is not None:
            before, after = unseen.before, unseen.after
            gap["held_out"] = {
                "record": apart.record.name,
                "after_s": apart.after_s,
                "before": before.nrmse,
                "after": after.nrmse,
                "before_se": before.nrmse_se,
                "after_se": after.nrmse_se,
                "log_density_before": before.log_density,
                "log_density_after": after.log_density,
                "noise_floor": unseen.noise_floor,
            }
        facts: dict[str, Any] = {
            "schema": SCHEMA,
            "model": self.name,
            "record": self.record.name,
            "verdict": self.verdict,
            "sentences": list(self.sentences),
            "unexplained_share": self.unexplained_share,
            "effects": [added.as_json() for added in self.added],
            "where": [
                {
                    "channel": spot.channel,
                    "start_s": spot.start_s,
                    "end_s": spot.end_s,
                    "residual_to_noise": spot.residual_to_noise,
                    "sentence": spot.sentence,
                }
                for spot in self.before.spots
            ],
            "gap": gap,
            "unexplained": None if self.unexplained is None else self.unexplained.as_json(),
            "steps": [
                {
                    "step": step.number,
                    "sentence": step.sentence,
                    "withdrawn": step.withdrawn,
                    "elapsed_s": step.elapsed_s,
                }
                for step in self.steps
            ],
            "candidates": _candidates(self.steps),
            "detection_limits": [
                {
                    "effect": limit.name,
                    "storeys": list(limit.storeys),
                    "parameter": limit.parameter,
                    "unit": limit.unit,
                    "smallest": limit.smallest,
                }
                for limit in self.limits
            ],
            "elapsed_s": self.elapsed_s,
            "seed": self.seed,
        }
        return {key: finite(value) for key, value in facts.items()}


def _candidates(steps: tuple[Step, ...]) -> list[dict[str, Any]]:
    return [
        {
            "step": step.number,
            "name": candidate.hypothesis.name,
            "form": candidate.hypothesis.effect.form,
            "storeys": list(candidate.hypothesis.storeys),
            "log_bayes_factor": candidate.log_bayes_factor,
            "log_bayes_factor_se": candidate.log_bayes_factor_se,
            "evidence": candidate.evidence.method,
            "pareto_k": candidate.evidence.pareto_k,
            "log_odds": candidate.log_odds,
        }
        for step in steps
        if step.decision is not None
        for candidate in step.decision.candidates
    ]
