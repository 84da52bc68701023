"""What a discovery returns, and ``discovery.json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Self

from bwbn_bayes.discovery.candidates import Hypothesis, place_in_words
from bwbn_bayes.discovery.cross_validation import CrossValidation
from bwbn_bayes.discovery.explanation import Explanation, Place, forced_storeys
from bwbn_bayes.discovery.held_out import HeldOut, Prediction
from bwbn_bayes.discovery.predictive import PredictiveInterval
from bwbn_bayes.discovery.probability import NAMED, POSSIBLE, Family, Verdict
from bwbn_bayes.discovery.where import Disagreement
from bwbn_bayes.elements.catalogue import title_of
from bwbn_bayes.inference.unnamed.further_link import Span
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.results import Result, finite
from bwbn_bayes.structures.structure import Structure

SCHEMA = 2
LEAST_SHOWN = 1e-6
"""Probability of an effect from which it is listed."""
Grade = Literal["named", "possible", "shape", "weak"]
"""Of an effect that was added: its name is certain, likely, or not deserved (its law helps without its signature)."""


@dataclass(frozen=True, kw_only=True)
class SignatureFacts:
    """What an effect does to the loop in an engineer's measure.

    Attributes
    ----------
    measure, unit : str
    measured : float or None
        Of the record; None where it cannot be read off it.
    mean, low, high : float
        Of the identified response, with its 90 % interval; not a number where it could not be measured.
    without : float
        Of the identified response with the effect taken away; not a number where that cannot be solved or told.
    deserved : float
        Probability, over the posterior, that it has the size from which the effect deserves its name.
    unmeasured : str
        Why it could not be measured, in words; empty where it was.
    """

    measure: str
    unit: str
    measured: float | None
    mean: float
    low: float
    high: float
    without: float
    deserved: float
    unmeasured: str = ""

    @classmethod
    def of_none(cls, measure: str, unit: str, why: str, deserved: float = 0.0) -> Self:
        """Of a measure that could not be taken: where a test measured the loop, nothing speaks for the name then."""
        unknown = {name: float("nan") for name in ("mean", "low", "high", "without")}
        return cls(measure=measure, unit=unit, measured=None, **unknown, deserved=deserved, unmeasured=why)

    def as_json(self) -> dict[str, Any]:
        """``signature`` of an effect."""
        return {
            "measure": self.measure,
            "unit": self.unit,
            "measured": self.measured,
            "identified": {"mean": self.mean, "low": self.low, "high": self.high},
            "without": self.without,
            "deserved": self.deserved,
            "unmeasured": self.unmeasured or None,
        }


def deserved_by(signature: SignatureFacts | None) -> float:
    """Probability that an effect deserves its name by its signature; certain of an effect that has no measure."""
    return 1.0 if signature is None else signature.deserved


@dataclass(frozen=True, kw_only=True)
class Added:
    """An effect of the improved model that the given one lacks.

    Attributes
    ----------
    hypothesis : Hypothesis
        The effect, its form, its place.
    probability, place_probability : float
        That the effect is part of the model, and that it is at this place.
    log_bayes_factor, log_bayes_factor_se : float
        Of all explanations with it against all without it, and its error. [nat]
    equivalent : tuple of str
        Other effects of which one is about as probable in its place.
    equivalent_places : tuple of tuple of int
        Other places at which it is about as probable.
    signature : SignatureFacts or None
        None where the effect has no measure.
    borne_out : float
        Where more than noise is left, so that no explanation is the right one: probability that the best with the
        effect explains more than the best without its mechanism, by their scatter over stretches, and that nothing
        without a name looks like it; else 1.
    moments : mapping of str to (float, float)
        Posterior mean and standard deviation of the parameters it brought.
    separation : tuple of str
        For each equivalent, the experiment that would tell them apart.
    """

    hypothesis: Hypothesis
    probability: float
    place_probability: float
    log_bayes_factor: float
    log_bayes_factor_se: float
    equivalent: tuple[str, ...]
    equivalent_places: tuple[tuple[int, ...], ...]
    signature: SignatureFacts | None
    borne_out: float
    moments: Mapping[str, tuple[float, float]]
    separation: tuple[str, ...] = ()

    @property
    def law_probability(self) -> float:
        """That its law is part of the model, and borne out."""
        return self.probability * self.borne_out

    @property
    def name_probability(self) -> float:
        """Of the name: that the effect is part of the model, borne out, and deserves the name."""
        return self.law_probability * self.deserved

    @property
    def deserved(self) -> float:
        """Probability that what the law does deserves the effect's name."""
        return deserved_by(self.signature)

    @property
    def grade(self) -> Grade:
        """How sure its name is."""
        if self.name_probability >= NAMED:
            return "named"
        if self.law_probability >= POSSIBLE and self.name_probability < 1.0 - POSSIBLE:
            return "shape"
        return "possible" if self.name_probability >= POSSIBLE else "weak"

    @property
    def is_plain(self) -> bool:
        """Whether it goes by its plain name, as a law that helps without its signature does."""
        return self.grade == "shape" or self.deserved < POSSIBLE

    @property
    def title(self) -> str:
        """What the effect is called, with its place."""
        hypothesis = self.hypothesis
        return f"{hypothesis.effect.signature.plain_name}{hypothesis.at_place}" if self.is_plain else hypothesis.label

    @property
    def title_probability(self) -> float:
        """That what it is called is so: a plain name says no more than that the law is there."""
        return self.law_probability if self.is_plain else self.name_probability

    @property
    def meaning(self) -> str:
        """What it is, in one line; of a law under its plain name, which law that is."""
        name, summary = title_of(self.hypothesis.name), self.hypothesis.effect.summary
        return f"what the law of {name} does here, which has not earned that name" if self.is_plain else summary

    @property
    def alternatives(self) -> tuple[str, ...]:
        """What the record cannot tell it from, in words: other effects, and the same one at other places."""
        level = self.hypothesis.effect.level
        places = (f"the same at {place_in_words(level, place)}" for place in self.equivalent_places)
        return (*(title_of(name) for name in self.equivalent), *places)

    def as_json(self) -> dict[str, Any]:
        """One entry of ``effects``."""
        return {
            "name": self.hypothesis.name,
            "form": self.hypothesis.effect.form,
            "title": self.title,
            "storeys": list(self.hypothesis.storeys),
            "grade": self.grade,
            "probability": self.name_probability,
            "law_probability": self.law_probability,
            "borne_out": self.borne_out,
            "place_probability": self.place_probability,
            "log_bayes_factor": self.log_bayes_factor,
            "log_bayes_factor_se": self.log_bayes_factor_se,
            "equivalent": list(self.equivalent),
            "equivalent_storeys": [list(place) for place in self.equivalent_places],
            "separation": list(self.separation),
            "signature": None if self.signature is None else self.signature.as_json(),
            "parameters": {name: {"mean": mean, "sd": sd} for name, (mean, sd) in self.moments.items()},
        }


@dataclass(frozen=True, kw_only=True)
class Step:
    """One round of the search: what was built upon, and what was then believed of every explanation, best first."""

    number: int
    parent: str
    sentence: str
    explanations: tuple[Explanation, ...]
    probabilities: tuple[float, ...]
    log_joint: tuple[float, ...]
    elapsed_s: float


@dataclass(frozen=True, kw_only=True)
class UnnamedForce:
    """The force of no known law beside the improved model, as it was inferred.

    Attributes
    ----------
    storey : int
    place : str
        In words.
    probability, any_probability : float
        That something without a name is part of the model at this place, and that anything is at any.
    share : float
        Its root mean square over that of the force; of a force in every storey, where that is largest.
    function : str
        What a building's is a function of, in words.
    nodes : tuple of int
        Of a further link, the two that it joins (0 is the ground); else none.
    over : {"drift", "drift_rate", "hysteretic_displacement", ""}
        The one state that it is a function of; empty where there is no such, and it is shown over the drift.
    state, force : (n_times,) arrays
        That state where it acts, and the force itself. [m] or [m/s], [N]
    """

    storey: int
    place: str
    probability: float
    any_probability: float
    share: float
    function: str = ""
    nodes: tuple[int, ...] = ()
    over: str = ""
    state: Floats
    force: Floats

    def as_json(self) -> dict[str, Any]:
        """``unnamed_force`` of ``discovery.json``."""
        facts = {name: getattr(self, name) for name in ("storey", "place", "probability", "any_probability", "share")}
        known = {"function": self.function, "over": self.over, "nodes": list(self.nodes)}
        return {**facts, **{name: text for name, text in known.items() if text}}


@dataclass(frozen=True, kw_only=True)
class UnnamedReading:
    """The error of no known kind of a sensor beside the improved model, as it was inferred.

    Attributes
    ----------
    channel : str
    probability, any_probability : float
        That something without a name is part of what this sensor shows, and that anything is of the model.
    share : float
        The error's root mean square over that of the channel.
    function : str
        What it is a function of, in words.
    shown, error : (n_times,) arrays
        What the model has the sensor show, and what it shows beyond that. [unit of the channel]
    """

    channel: str
    probability: float
    any_probability: float
    share: float
    function: str
    shown: Floats
    error: Floats

    def as_json(self) -> dict[str, Any]:
        """``unnamed_reading`` of ``discovery.json``."""
        return {
            name: getattr(self, name) for name in ("channel", "probability", "any_probability", "share", "function")
        }


@dataclass(frozen=True, kw_only=True)
class Gap:
    """The gap between model and record, before and after; with the one on data that the fit did not see, if any.

    Of a building ``nameless`` is what is left beside something unnamed, where that is likely and can be predicted.
    Held-out samples among the fitted ones have predictive intervals too.
    """

    noise_floor: float
    before: Prediction
    after: Prediction
    nameless: Prediction | None = None
    held_out: Gap | None = None
    interval: PredictiveInterval | None = None


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
        ``effects_found``, ``partly_explained``, ``no_missing_effect`` or ``unexplained``: the most probable; or
        ``not_searched``, where the time was over before any effect was tried: nothing is concluded then.
    verdict_probabilities : mapping of str to float
        Empty where nothing is concluded.
    probabilities : mapping of str to float
        Of each name, best first: that the effect is part of the model, borne out where laws leave more than noise, and,
        of those of the improved model, that it deserves the name.
    families : tuple of Family
        That one or another of effects that are alike is part of the model.
    sentences : tuple of str
        The verdict in words, the most important first.
    unexplained_share : float
        Of the residual energy beyond the noise, what is left at the end.
    unnamed : UnnamedForce, UnnamedReading or None
        The force of no known law, where one is likely.
    binding : tuple of str
        Parameters whose prior, as given, keeps them from where the record wants them, in sentences.
    added : tuple of Added
        Effects of the final model that the given one lacks, in order.
    steps : tuple of Step
    limits : tuple of DetectionLimit
    gap : Gap
    cross_validated : CrossValidation
        How well the improved model predicts blocks of the training record that were left out, or still to come.
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
    data : str
        Hash of the record as given.
    assumptions : tuple of str
        What the given model takes for granted.
    seed : int
    elapsed_s : float
        Without the final posterior.
    stopped : bool
        Whether the time limit ended the search before it was done.
    """

    verdict: Verdict | Literal["not_searched"]
    verdict_probabilities: Mapping[Verdict, float]
    probabilities: Mapping[str, float]
    families: tuple[Family, ...]
    sentences: tuple[str, ...]
    unexplained_share: float
    unnamed: UnnamedForce | UnnamedReading | None
    binding: tuple[str, ...]
    added: tuple[Added, ...]
    steps: tuple[Step, ...]
    limits: tuple[DetectionLimit, ...]
    gap: Gap
    cross_validated: CrossValidation
    before: Disagreement
    after: Disagreement
    histories: Mapping[str, Mapping[str, Floats]]
    model: Structure
    improved: Structure
    record: Record
    held_out: HeldOut | None
    result: Result
    name: str
    data: str
    assumptions: tuple[str, ...]
    seed: int
    elapsed_s: float
    stopped: bool = False

    @property
    def measurement(self) -> Record:
        """What fit and selection saw, as files can hold it: of one record all, where not every sample counted."""
        apart = self.held_out
        return apart.record if apart is not None and apart.repeats else self.record

    def as_json(self) -> dict[str, Any]:
        """``discovery.json``, schema 2; a number that is not finite becomes None, which JSON can hold."""
        gap: dict[str, Any] = {
            "metric": "nrmse",
            "noise_floor": self.gap.noise_floor,
            "fit": {"before": self.gap.before.nrmse, "after": self.gap.after.nrmse},
        }
        if self.gap.nameless is not None:
            gap["fit"]["beside_unnamed"] = self.gap.nameless.nrmse
        apart, unseen = self.held_out, self.gap.held_out
        if apart is not None and unseen is not None:
            before, after = unseen.before, unseen.after
            gap["held_out"] = {
                "record": apart.record.name,
                "repeats": apart.repeats,
                "after_s": apart.after_s if apart.record.has_time else None,
                "before": before.nrmse,
                "after": after.nrmse,
                "before_se": before.nrmse_se,
                "after_se": after.nrmse_se,
                "log_density_before": before.log_density,
                "log_density_after": after.log_density,
                "noise_floor": unseen.noise_floor,
                "coverage_90": None if unseen.interval is None else unseen.interval.coverage,
            }
            if unseen.nameless is not None:
                gap["held_out"]["beside_unnamed"] = unseen.nameless.nrmse
        facts: dict[str, Any] = {
            "schema": SCHEMA,
            "finished": True,
            "model": self.name,
            "record": self.record.name,
            "data_sha256": self.data,
            "verdict": self.verdict,
            "verdict_probabilities": dict(self.verdict_probabilities),
            "sentences": list(self.sentences),
            "unexplained_share": self.unexplained_share,
            "effects": [added.as_json() for added in self.added],
            "where": where_as_json(self.before),
            "gap": gap,
            "best_model": {
                "effects": [f"{one.hypothesis.name}{list(one.hypothesis.storeys)}" for one in self.added],
                "fit": self.gap.after.nrmse,
                "held_out": None if unseen is None else unseen.after.nrmse,
                "cross_validated": self.cross_validated.nrmse,
                "log_score": self.cross_validated.log_score,
            },
            "probabilities": {name: p for name, p in self.probabilities.items() if p >= LEAST_SHOWN},
            "families": [one.as_json() for one in self.families if one.probability >= LEAST_SHOWN],
            "unnamed_force": self.unnamed.as_json() if isinstance(self.unnamed, UnnamedForce) else None,
            "unnamed_reading": self.unnamed.as_json() if isinstance(self.unnamed, UnnamedReading) else None,
            "binding_priors": list(self.binding),
            **steps_as_json(self.steps),
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
            "stopped_by_time_limit": self.stopped,
            "elapsed_s": self.elapsed_s,
            "seed": self.seed,
        }
        return {key: finite(value) for key, value in facts.items()}


def where_as_json(before: Disagreement) -> list[dict[str, Any]]:
    """``where`` of ``discovery.json``."""
    return [
        {
            "channel": spot.channel,
            **({"record": spot.record} if spot.record else {}),
            "start_s": spot.start_s if spot.cycles is None else None,
            "end_s": spot.end_s if spot.cycles is None else None,
            "cycles": None if spot.cycles is None else list(spot.cycles),
            "residual_to_noise": spot.residual_to_noise,
            "sentence": spot.sentence,
        }
        for spot in before.spots
    ]


def steps_as_json(steps: tuple[Step, ...]) -> dict[str, Any]:
    """``steps`` and ``candidates`` of ``discovery.json``."""
    told = [
        {"step": step.number, "parent": step.parent, "sentence": step.sentence, "elapsed_s": step.elapsed_s}
        for step in steps
    ]
    return {"steps": told, "candidates": _candidates(steps)}


def _place_as_json(place: Place | None) -> dict[str, Any]:
    """Where an explanation has something unnamed: storeys of a force, nodes of a link, or the channel of a reading."""
    return {
        "unnamed_force": list(forced_storeys(place)) or None,
        "unnamed_link": list(place) if isinstance(place, Span) else None,
        "unnamed_reading": place if isinstance(place, str) else None,
    }


def _candidates(steps: tuple[Step, ...]) -> list[dict[str, Any]]:
    """What the last round believed."""
    return [
        {
            "effects": [{"name": h.name, "form": h.effect.form, "storeys": list(h.storeys)} for h in one.added],
            **_place_as_json(one.unnamed),
            "probability": probability,
            "log_joint": log_joint,
            "log_evidence": one.evidence.log_evidence,
            "log_evidence_se": one.evidence.log_evidence_se,
            "evidence": one.evidence.method,
            "pareto_k": one.evidence.pareto_k,
        }
        for step in steps[-1:]
        for one, probability, log_joint in zip(step.explanations, step.probabilities, step.log_joint, strict=True)
    ]
