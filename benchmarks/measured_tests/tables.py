"""What the filed results come to: one row per test, sums over all, the labels of the columns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.markdown import probability
from benchmarks.measured_tests.discovering import SURE, Answer, Effect, read_answer, says_pinched
from benchmarks.measured_tests.specimens import MeasuredTest

COMPETITORS = ("bwbn", "pinching4", "linear_chain")
OF_SPECIMENS = {"bwbn": "BWBN", "pinching4": "Pinching4"}
"""Competitors that are fitted to the same tests, as the tables call them."""
KNOWN = {"bwbn": (30.4, 50.9), "pinching4": (16.7, 31.0)}
"""Errors [%] that PROVENANCE.md states for chiu, fitted and held out; its split is not stated."""
HELD_OUT_FACTOR = 1.1
"""By how much the held-out error may exceed the better competitor's."""
INDEX_WITHIN, STRENGTH_WITHIN = 0.15, 1.0 / 3.0
COVERED = 0.8, 0.97
"""Share of held-out points inside their 90 % intervals that counts as covered."""
POSSIBLE = 0.5
"""Probability from which an effect is said to be possible."""
HOPELESS = 100.0
"""Error [%] above which a prediction is worse than none."""

Json = Mapping[str, Any]
Errors = tuple[float, float]
"""Fitted and held-out error [%]; infinite where the prediction runs away."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One test: what every competitor and discovery made of it.

    Attributes
    ----------
    name : str
    n_points, n_fitted : int
    rule : str
        Of its split.
    competitors : mapping of str to (float, float)
    ours : (float, float) or None
    answer : Answer or None
        None where discovery was not run or failed.
    failed : tuple of str
        What ended in an error, with the error.
    seconds : float or None
        Of discovery, by the clock.
    """

    name: str
    n_points: int
    n_fitted: int
    rule: str
    competitors: Mapping[str, Errors]
    ours: Errors | None
    answer: Answer | None
    failed: tuple[str, ...]
    seconds: float | None

    @property
    def is_run(self) -> bool:
        """Whether anything was run on it."""
        return bool(self.competitors or self.failed) or self.answer is not None

    @property
    def best(self) -> Errors | None:
        """The better competitor's error, for fit and held-out part each."""
        if not self.competitors:
            return None
        fit, held_out = zip(*self.competitors.values(), strict=True)
        return min(fit), min(held_out)

    @property
    def fits(self) -> bool | None:
        """Whether discovery fits at least as well as the better competitor; None where either is missing."""
        if self.best is None or self.ours is None:
            return None
        return bool(np.isfinite(self.ours[0])) and self.ours[0] <= self.best[0]

    @property
    def predicts(self) -> bool | None:
        """Whether it predicts the held-out end within the stated factor; None where either is missing."""
        return self.keeps_up("discover")

    @property
    def laws(self) -> dict[str, Errors]:
        """Of each competitor and of discovery."""
        return {**self.competitors, **({} if self.ours is None else {"discover": self.ours})}

    def keeps_up(self, what: str) -> bool | None:
        """Whether one predicts the held-out end within the stated factor of the best other; None where one is alone."""
        own, others = self.laws.get(what), [errors[1] for other, errors in self.laws.items() if other != what]
        if own is None or not others:
            return None
        return bool(np.isfinite(own[1])) and own[1] <= HELD_OUT_FACTOR * min(others)

    @property
    def is_hopeless(self) -> bool:
        """Whether every held-out error there is exceeds 100 %."""
        errors = self.laws.values()
        return bool(errors) and all(error[1] > HOPELESS for error in errors)


@dataclass(frozen=True, kw_only=True)
class LabelRow:
    """A column's whole record: its label and what discovery says of it.

    Attributes
    ----------
    name, loops : str
    says_pinched : bool
    index, strength_lost : (float, float)
        Measured and identified at the most probable draw; NaN where it cannot be told.
    index_interval, strength_interval : (float, float) or None
        Of the posterior, 90 %; None where the answer lists no effect with that signature.
    fit : float
        Error [%] over the whole record.
    unnamed_share : float or None
        Of the force of no known law in the whole force, rms; None where there is none.
    answer : Answer
    seconds : float or None
        By the clock.
    """

    name: str
    loops: str
    says_pinched: bool
    index: tuple[float, float]
    index_interval: tuple[float, float] | None
    strength_lost: tuple[float, float]
    strength_interval: tuple[float, float] | None
    fit: float
    unnamed_share: float | None
    answer: Answer
    seconds: float | None

    @property
    def index_agrees(self) -> bool:
        """Whether the identified pinching index is within 0.15 of the measured one."""
        return abs(self.index[1] - self.index[0]) <= INDEX_WITHIN

    @property
    def strength_agrees(self) -> bool:
        """Whether the identified strength lost per cycle is within a third of the measured one."""
        return abs(self.strength_lost[1] - self.strength_lost[0]) <= STRENGTH_WITHIN * abs(self.strength_lost[0])


@dataclass(frozen=True, kw_only=True)
class RepeatRow:
    """A cyclic test whose repeat cycles were held out.

    Attributes
    ----------
    name : str
    n_points, n_held_out : int
    given : float
        Held-out error of the model as given [%]; infinite where it runs away.
    errors : (float, float)
        Of the improved model, fitted and held out. [%]
    coverage : float
        Share of the held-out points inside their 90 % intervals.
    answer : Answer
    seconds : float or None
        By the clock.
    """

    name: str
    n_points: int
    n_held_out: int
    given: float
    errors: Errors
    coverage: float
    answer: Answer
    seconds: float | None

    @property
    def is_covered(self) -> bool:
        """Whether the intervals hold 80 to 97 % of the points."""
        return COVERED[0] <= self.coverage <= COVERED[1]


def row(test: MeasuredTest, entries: Mapping[str, Json]) -> Row:
    """One row from the filed results of a test, by kind."""
    good = {what: entry["result"] for what, entry in entries.items() if "error" not in entry}
    answer = read_answer(good["discover"]["facts"]) if "discover" in good else None
    return Row(
        name=test.name,
        n_points=test.record.n_times,
        n_fitted=test.n_fitted,
        rule=test.rule,
        competitors={what: _errors(good[what]["errors"]) for what in COMPETITORS if what in good},
        ours=None if answer is None else _ours(answer, good["discover"]["facts"]["errors"], test.rule),
        answer=answer,
        failed=tuple(f"{what}: {entry['error']}" for what, entry in entries.items() if "error" in entry),
        seconds=None if answer is None else entries["discover"].get("seconds"),
    )


def label_row(test: MeasuredTest, entry: Json) -> LabelRow:
    """One row of the columns' table from the filed result of a whole record.

    Raises
    ------
    ValueError
        If the test has no label.
    """
    if test.label is None:
        raise ValueError(f"{test.name} has no label")
    facts = entry["result"]["facts"]
    loops = facts["loops"]
    answer = read_answer(facts)
    return LabelRow(
        name=test.name,
        loops=test.label.loops,
        says_pinched=says_pinched(answer, loops["pinching_index"]["identified"]),
        index=_pair(loops["pinching_index"]),
        index_interval=_interval(facts, "pinching index"),
        strength_lost=_pair(loops["strength_lost"]),
        strength_interval=_interval(facts, "strength lost per cycle"),
        fit=_errors(facts["errors"])[0] if answer.fit is None else answer.fit,
        unnamed_share=(facts.get("unnamed_force") or {}).get("share"),
        answer=answer,
        seconds=entry.get("seconds"),
    )


def repeat_row(test: MeasuredTest, entry: Json) -> RepeatRow:
    """One row of the repeat cycles' table from the filed result of a test.

    Raises
    ------
    ValueError
        If the test has no repeat cycles.
    """
    if test.repeats is None:
        raise ValueError(f"{test.name} has no repeat cycles")
    facts = entry["result"]["facts"]
    held_out = facts["gap"]["held_out"]
    given = held_out["before"]
    return RepeatRow(
        name=test.name,
        n_points=test.record.n_times,
        n_held_out=len(test.repeats.counted),
        given=float("inf") if given is None else 100.0 * given,
        errors=_errors(facts["errors"]),
        coverage=held_out["coverage_90"],
        answer=read_answer(facts),
        seconds=entry.get("seconds"),
    )


def repeat_sums(rows: Sequence[RepeatRow], n_failed: int = 0) -> list[dict[str, Any]]:
    """Over the tests with repeat cycles, those that failed too: whose intervals cover what they should."""
    low, high = (100.0 * end for end in COVERED)
    return [
        {
            "what": f"coverage within {low:.0f} to {high:.0f} %",
            "count": sum(one.is_covered for one in rows),
            "total": len(rows) + n_failed,
            "asked": "all",
        }
    ]


def sums(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Over all rows that tell: how often discovery keeps up with the better competitor."""
    fits = [one.fits for one in rows if one.fits is not None]
    predicts = [one.predicts for one in rows if one.predicts is not None]
    told = [one for one in rows if one.laws]
    others = {title: [one.keeps_up(what) for one in rows if one.ours] for what, title in OF_SPECIMENS.items()}
    hopeless = [one.name for one in told if one.is_hopeless]
    return [
        {"what": "fit error at most the better competitor's", "count": sum(fits), "total": len(fits), "asked": ""},
        {
            "what": f"held-out error at most {HELD_OUT_FACTOR:g} times the better competitor's",
            "count": sum(predicts),
            "total": len(predicts),
            "asked": "",
        },
        *(
            {
                "what": f"the same of {title} beside the better of the other and discover",
                "count": sum(map(bool, kept)),
                "total": sum(own is not None for own in kept),
                "asked": "",
            }
            for title, kept in others.items()
        ),
        {
            "what": f"tests of whose held-out part every law misses more than 100 %: {', '.join(hopeless) or 'none'}",
            "count": len(hopeless),
            "total": len(told),
            "asked": "",
        },
    ]


def label_sums(rows: Sequence[LabelRow], failed: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Over the columns: labels told, and measures of the identified loops.

    Parameters
    ----------
    rows : sequence of LabelRow
    failed : sequence of str
        Loops of the columns whose runs ended in an error: misses of every sum.
    """
    lost = Counter(failed)
    n_columns = len(rows) + len(failed)
    said = {loops: [one.says_pinched for one in rows if one.loops == loops] for loops in ("pinched", "fat")}
    errors = [abs(one.index[1] - one.index[0]) for one in rows if np.isfinite(one.index).all()]
    median = float(np.median(errors)) if errors else float("nan")
    return [
        {
            "what": "pinched said of the pinched",
            "count": sum(said["pinched"]),
            "total": len(said["pinched"]) + lost["pinched"],
            "asked": ">= 10 of 12",
        },
        {
            "what": "pinched said of the fat, or failed",
            "count": sum(said["fat"]) + lost["fat"],
            "total": len(said["fat"]) + lost["fat"],
            "asked": "<= 1 of 12",
        },
        {
            "what": f"pinching index within {INDEX_WITHIN:g} (median error {median:.2f})",
            "count": sum(one.index_agrees for one in rows),
            "total": n_columns,
            "asked": "",
        },
        {
            "what": "strength lost per cycle within a third",
            "count": sum(one.strength_agrees for one in rows),
            "total": n_columns,
            "asked": "",
        },
    ]


def in_per_cent(errors: Sequence[float | None] | None) -> str:
    """Fitted and held-out error as text; an empty text where there is none, and None is not finite, as in JSON."""
    if errors is None:
        return ""
    return " / ".join("runs away" if error is None or not error < 1e3 else f"{error:.1f}" for error in errors)


def in_words(answer: Answer | None) -> str:
    """Verdict and effects with their probabilities, as text."""
    if answer is None:
        return ""
    effects = (
        one.name + "".join(f"[{storey}]" for storey in one.storeys) + _probability(one.probability)
        for one in answer.effects
    )
    return ": ".join(part for part in (verdict_in_words(answer), ", ".join(effects)) if part)


def verdict_in_words(answer: Answer | None) -> str:
    """Verdict with its probability, as text."""
    return "" if answer is None else answer.verdict + _probability(answer.probability)


def names_in_words(answer: Answer | None) -> str:
    """Names with their probabilities: those that are named, families of which none is, then those that are possible."""
    told, families = ((), ()) if answer is None else (answer.effects, answer.families)
    named = [one for one in told if one.probability is None or one.probability >= SURE]
    possible = [one for one in told if one.probability is not None and POSSIBLE <= one.probability < SURE]
    unsplit = [kin for kin in families if kin.probability >= SURE and not {one.name for one in named} & {*kin.names}]
    kin = [f"{one.title} ({probability(one.probability)})" for one in unsplit]
    words = [*(_named(one) for one in named), *kin, *(f"possibly {_named(one)}" for one in possible)]
    return ", ".join(words)


def _named(effect: Effect) -> str:
    said = probability(effect.probability)
    return effect.name + (f" ({said})" if said else "")


def _interval(facts: Json, measure: str) -> tuple[float, float] | None:
    """Posterior interval, 90 %, of a signature that an effect listed has."""
    for effect in facts["effects"]:
        signature = effect.get("signature") or {}
        identified = signature.get("identified") or {}
        if signature.get("measure") == measure and identified.get("low") is not None:
            return identified["low"], identified["high"]
    return None


def _probability(value: float | None) -> str:
    return "" if value is None else f" {value:.2f}"


def _ours(answer: Answer, errors: Sequence[float | None], rule: str) -> Errors:
    """Errors of discovery's best model; where nothing was held out for it, those of the identified response."""
    found = _errors((answer.fit, answer.held_out))
    return found if rule == "parting_time" else (found[0], _errors(errors)[1])


def _errors(pair: Sequence[float | None]) -> Errors:
    fit, held_out = (float("inf") if error is None else error for error in pair)
    return fit, held_out


def _pair(measure: Json) -> tuple[float, float]:
    measured, identified = (
        float("nan") if measure[which] is None else measure[which] for which in ("measured", "identified")
    )
    return measured, identified
