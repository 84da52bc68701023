"""Count over the cases of a column of the trial: proportions with their intervals, figures, misses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest

from benchmarks.blind.scoring import FAILED, NOTHING, SEVERAL, Outcome

VERDICTS = ("effects_found", "partly_explained", "unexplained", "no_missing_effect")
FLOOR_FACTOR = 1.1
POSTERIOR_SDS = 4.0


@dataclass(frozen=True, kw_only=True)
class Proportion:
    """A count out of a total, with its exact (Clopper-Pearson) 95 % interval."""

    what: str
    count: int
    total: int

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of the interval; the whole range where there are no cases."""
        if self.total == 0:
            return 0.0, 1.0
        found = binomtest(self.count, self.total).proportion_ci(0.95, "exact")
        return float(found.low), float(found.high)

    def as_json(self) -> dict[str, object]:
        """Count, total, share and interval."""
        low, high = self.interval
        share = self.count / self.total if self.total else None
        return {"what": self.what, "count": self.count, "total": self.total, "share": share, "interval95": [low, high]}


@dataclass(frozen=True, kw_only=True)
class Question:
    """What is counted over cases; one about probabilities, over the cases that state some, or failed to."""

    what: str
    test: Callable[[Outcome], bool]
    of_probabilities: bool = False
    of_failed: bool = False

    def over(self, outcomes: Sequence[Outcome], what: str = "") -> Proportion:
        """The answer, under another heading if one is given."""
        asked = [o for o in outcomes if self._is_asked(o)]
        return Proportion(what=what or self.what, count=sum(map(self.test, asked)), total=len(asked))

    def _is_asked(self, outcome: Outcome) -> bool:
        states_enough = outcome.claims is not None or not self.of_probabilities
        return states_enough or (self.of_failed and outcome.verdict == FAILED)


RIGHT_NAME = Question(what="right name", test=lambda o: o.right_name)
RIGHT_PLACE = Question(what="right name and storey", test=lambda o: o.right_place)
SOMETHING_NAMED = Question(what="an effect named", test=lambda o: bool(o.named))
NAMED_OR_FAILED = Question(what="an effect named, or failed", test=lambda o: bool(o.named) or o.verdict == FAILED)
ALL_NAMED = Question(what="every hidden effect named", test=lambda o: o.all_named)
NOT_THERE = Question(what="an effect that is not there", test=lambda o: bool(o.extra))
SURE_AND_WRONG = Question(
    what="a wrong effect with probability above 0.9", test=lambda o: bool(o.sure_and_wrong), of_probabilities=True
)
NONE_SURE = Question(
    what="no name above 0.9",
    test=lambda o: not o.sure_and_wrong and o.verdict != FAILED,
    of_probabilities=True,
    of_failed=True,
)

_NAMED: tuple[Question, ...] = (
    RIGHT_NAME,
    RIGHT_PLACE,
    Question(what="within the equivalence class", test=lambda o: o.within_class),
    Question(what="wrong name, with confidence", test=lambda o: o.wrong_with_confidence),
    Question(what="a second effect that is not there", test=lambda o: o.right_name and bool(o.extra)),
    SURE_AND_WRONG,
)

_QUESTIONS: dict[str, tuple[Question, ...]] = {
    "catalogue": _NAMED,
    "forms": _NAMED,
    "more_forms": _NAMED,
    "later": _NAMED,
    "none": (NAMED_OR_FAILED, SURE_AND_WRONG),
    "outside": (NONE_SURE, SOMETHING_NAMED, NOT_THERE),
    "pairs": (
        ALL_NAMED,
        Question(what="first name is one of the two", test=lambda o: o.right_name),
        NOT_THERE,
        SURE_AND_WRONG,
    ),
    "cyclic": (
        ALL_NAMED,
        NOT_THERE,
        SURE_AND_WRONG,
    ),
}


def verdict_proportions(outcomes: Sequence[Outcome]) -> list[Proportion]:
    """How often each verdict was given, and how often discovery failed."""
    return [
        Proportion(what=f"verdict {v}", count=sum(o.verdict == v for o in outcomes), total=len(outcomes))
        for v in (*VERDICTS, FAILED)
    ]


def _mean_verdict(outcomes: Sequence[Outcome]) -> dict[str, float]:
    """Mean probability of each verdict over the cases that state some."""
    asked = [o.verdict_probabilities for o in outcomes if o.claims is not None]
    return {v: float(np.mean([given.get(v, 0.0) for given in asked])) for v in VERDICTS} if asked else {}


def column_summary(kind: str, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Proportions and figures of one column of the trial; proportions are over its detectable cases.

    Parameters
    ----------
    kind : str
        The column.
    outcomes : sequence of Outcome
        All of its cases.
    """
    judged = [o for o in outcomes if o.detectable]
    proportions = [Proportion(what="detectable", count=len(judged), total=len(outcomes))]
    proportions += [question.over(judged) for question in _QUESTIONS[kind]]
    named = [o for o in judged if o.named and o.floor_ratio is not None]
    near = sum(o.floor_ratio <= FLOOR_FACTOR for o in named if o.floor_ratio is not None)
    z = [abs(value) for o in judged for value in o.z.values()]
    if kind != "none":
        proportions += [
            Proportion(what="named: held-out error <= 1.1 noise floor", count=near, total=len(named)),
            Proportion(what="added parameters within 4 sd", count=sum(v <= POSTERIOR_SDS for v in z), total=len(z)),
        ]
    proportions += verdict_proportions(judged)
    sizes = [o.class_size for o in judged if o.class_size]
    seconds = [o.elapsed_s for o in outcomes if o.elapsed_s is not None]
    return {
        "cases": len(outcomes),
        "failed": [f"{o.name}: {o.error}" for o in outcomes if o.verdict == FAILED],
        "proportions": [p.as_json() for p in proportions],
        "mean_verdict_probabilities": _mean_verdict(judged),
        "mean_class_size": _mean(sizes),
        "held_out_over_floor_before": _median([o.floor_ratio_before for o in named]),
        "held_out_over_floor_after": _median([o.floor_ratio for o in named]),
        "seconds_median": _median(seconds),
        "seconds_max": max(seconds, default=None),
        "undetectable": [f"{o.name}: {', '.join(o.hidden)}" for o in outcomes if not o.detectable],
        "misses": [_miss(o) for o in judged if is_missed(o)],
        "confusion": confusion(judged),
    }


def confusion(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """Counts by what was hidden and what was named for it, in alphabetical order; ``right`` where that is right."""
    counts = Counter(cell for outcome in outcomes for cell in outcome.confusion)
    return [{**cell._asdict(), "count": counts[cell]} for cell in sorted(counts)]


def is_missed(outcome: Outcome) -> bool:
    """Whether a case is not right: an effect not named, or at another place, or one named that is not there."""
    wrong = bool(outcome.extra or outcome.sure_and_wrong) or outcome.verdict == FAILED
    if outcome.kind in ("none", "outside"):
        return wrong
    return wrong or not (outcome.all_named if outcome.kind in SEVERAL else outcome.right_place)


def _miss(outcome: Outcome) -> str:
    said = ", ".join(outcome.named) or outcome.verdict
    return f"{outcome.name}: {', '.join(outcome.hidden) or NOTHING}; said {said}"


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _median(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None
