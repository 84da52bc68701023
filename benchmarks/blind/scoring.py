"""Score what discovery says against what was hidden: one case at a time, then a column of the trial.

Only the dictionary of ``discovery.json`` (schema 1) is read, so that hand-made ones can be scored as well.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest

Json = Mapping[str, Any]

FLOOR_FACTOR = 1.1
POSTERIOR_SDS = 4.0
NOTHING = "nothing"
UNEXPLAINED = "unexplained"
FAILED = "failed"


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How one case came out.

    Attributes
    ----------
    kind, name : str
        Column and label of the case.
    hidden : tuple of str
        What was hidden: names, with place and form.
    confusion : (str, str)
        Row and column of the confusion matrix: hidden name, first name given (or nothing, unexplained, failed).
    detectable, severe : bool
        See :class:`benchmarks.blind.cases.Truth`.
    verdict : str
        As discovery gives it, or ``failed``.
    named : tuple of str
        Every effect named, with its place.
    right_name, right_place, within_class : bool
        Of the first hidden effect: the first name given is right; it is at the right place as well; the right name
        is the first one given or among those it is said to be equivalent to.
    both_named : bool
        Every hidden effect is among the effects named.
    extra : tuple of str
        Effects named that are not hidden, at any place.
    wrong_with_confidence : bool
        The first name given is wrong, and the right one is not among those said to be equivalent to it.
    class_size : int
        Names in the first effect's equivalence class; 0 where nothing is named.
    held_out_before, held_out_after, noise_floor : float or None
        Error on the held-out record and that of a perfect model.
    z : mapping of str to float
        Added parameters: (mean - truth) / posterior sd, where the parametrisation is the same.
    elapsed_s : float or None
        As discovery gives it. [s]
    error : str
        What went wrong, where discovery failed.
    """

    kind: str
    name: str
    hidden: tuple[str, ...]
    confusion: tuple[str, str]
    detectable: bool
    severe: bool
    verdict: str
    named: tuple[str, ...]
    right_name: bool
    right_place: bool
    within_class: bool
    both_named: bool
    extra: tuple[str, ...]
    wrong_with_confidence: bool
    class_size: int
    held_out_before: float | None
    held_out_after: float | None
    noise_floor: float | None
    z: Mapping[str, float]
    elapsed_s: float | None
    error: str = ""

    @property
    def floor_ratio_before(self) -> float | None:
        """Held-out error before, over the noise floor."""
        if self.held_out_before is None or not self.noise_floor:
            return None
        return self.held_out_before / self.noise_floor

    @property
    def floor_ratio(self) -> float | None:
        """Held-out error after, over the noise floor."""
        if self.held_out_after is None or not self.noise_floor:
            return None
        return self.held_out_after / self.noise_floor


def case_outcome(truth: Json, discovery: Json) -> Outcome:
    """Score one case.

    Parameters
    ----------
    truth : mapping
        :meth:`benchmarks.blind.cases.Truth.as_json`, with the case's ``name``.
    discovery : mapping
        ``discovery.json``, or ``{"error": sentence}`` where it failed.

    Returns
    -------
    Outcome
    """
    hidden: Sequence[Json] = truth["effects"]
    effects: Sequence[Json] = discovery.get("effects", [])
    verdict = str(discovery.get("verdict", FAILED))
    first = effects[0] if effects else None
    right_name = bool(first and any(_is_right(first, h) for h in hidden))
    in_class = bool(first and any(_in_class(first, h) for h in hidden))
    held_out: Json = discovery.get("gap", {}).get("held_out") or {}
    floor = truth.get("held_out_floor", discovery.get("gap", {}).get("noise_floor"))
    return Outcome(
        kind=truth["kind"],
        name=truth["name"],
        hidden=tuple(_label(h["name"], h["storeys"], h.get("form", "")) for h in hidden),
        confusion=(_row(hidden, first), _column(first, verdict)),
        detectable=bool(truth["detectable"]),
        severe=bool(truth["severe"]),
        verdict=verdict,
        named=tuple(_label(e["name"], e["storeys"]) for e in effects),
        right_name=right_name,
        right_place=bool(first and any(_is_right(first, h) and _same_place(first, h) for h in hidden)),
        within_class=in_class,
        both_named=all(any(_is_right(e, h) for e in effects) for h in hidden),
        extra=tuple(_label(e["name"], e["storeys"]) for e in effects if not any(_is_right(e, h) for h in hidden)),
        wrong_with_confidence=first is not None and not in_class,
        class_size=_class_size(first),
        held_out_before=held_out.get("before"),
        held_out_after=held_out.get("after"),
        noise_floor=floor,
        z=_z(hidden, effects),
        elapsed_s=discovery.get("elapsed_s"),
        error=str(discovery.get("error", "")),
    )


def _label(name: str, storeys: Sequence[int], form: str = "") -> str:
    place = f"[{','.join(map(str, storeys))}]" if storeys else ""
    return f"{name}{place}" + (f" ({form})" if form else "")


def _is_right(effect: Json, hidden: Json) -> bool:
    return effect["name"] in hidden["accepted"]


def _same_place(effect: Json, hidden: Json) -> bool:
    return sorted(effect["storeys"]) == sorted(hidden["storeys"])


def _equivalents(effect: Json) -> set[str]:
    """Canonical names in a class, without the effect's own; an entry may carry a place behind the name."""
    names = set()
    for entry in effect.get("equivalent", []):
        match = re.match(r"[a-z_]+", entry if isinstance(entry, str) else entry["name"])
        if match:
            names.add(match.group())
    return names - {effect["name"]}


def _in_class(effect: Json, hidden: Json) -> bool:
    return _is_right(effect, hidden) or bool(_equivalents(effect) & set(hidden["accepted"]))


def _class_size(first: Json | None) -> int:
    return 1 + len(_equivalents(first)) if first else 0


def _row(hidden: Sequence[Json], first: Json | None) -> str:
    """Of a pair: the one that was named first, if it is one of them."""
    if not hidden:
        return NOTHING
    return str(next((h["name"] for h in hidden if first and _is_right(first, h)), hidden[0]["name"]))


def _column(first: Json | None, verdict: str) -> str:
    if first:
        return str(first["name"])
    return {UNEXPLAINED: UNEXPLAINED, FAILED: FAILED}.get(verdict, NOTHING)


def _z(hidden: Sequence[Json], effects: Sequence[Json]) -> dict[str, float]:
    found = {}
    for h in hidden:
        for effect in effects:
            if effect["name"] != h["name"] or not _same_place(effect, h):
                continue
            for label, moments in effect.get("parameters", {}).items():
                true = h["parameters"].get(label.partition("[")[0])
                if true is not None and moments["sd"]:
                    found[label] = (moments["mean"] - true) / moments["sd"]
    return found


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


Question = tuple[str, Callable[[Outcome], bool]]

_NAMED: tuple[Question, ...] = (
    ("right name", lambda o: o.right_name),
    ("right name and storey", lambda o: o.right_place),
    ("within the equivalence class", lambda o: o.within_class),
    ("wrong name, with confidence", lambda o: o.wrong_with_confidence),
    ("a second effect that is not there", lambda o: o.right_name and bool(o.extra)),
)

_QUESTIONS: dict[str, tuple[Question, ...]] = {
    "catalogue": _NAMED,
    "forms": _NAMED,
    "none": (
        ("an effect named", lambda o: bool(o.named)),
        ("called unexplained", lambda o: o.verdict == UNEXPLAINED),
    ),
    "outside": (
        ("reported as unexplained", lambda o: o.verdict == UNEXPLAINED),
        ("partly explained", lambda o: o.verdict == "partly_explained"),
        ("an effect named as the whole cause", lambda o: o.verdict == "effects_found"),
        ("nothing found missing", lambda o: o.verdict == "no_missing_effect"),
    ),
    "pairs": (
        ("both named", lambda o: o.both_named),
        ("first name is one of the two", lambda o: o.right_name),
        ("an effect that is not there", lambda o: bool(o.extra)),
    ),
}


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
    for what, test in _QUESTIONS[kind]:
        proportions.append(Proportion(what=what, count=sum(map(test, judged)), total=len(judged)))
    named = [o for o in judged if o.named and o.floor_ratio is not None]
    near = sum(o.floor_ratio <= FLOOR_FACTOR for o in named if o.floor_ratio is not None)
    z = [abs(value) for o in judged for value in o.z.values()]
    if kind != "none":
        proportions += [
            Proportion(what="named: held-out error <= 1.1 noise floor", count=near, total=len(named)),
            Proportion(what="added parameters within 4 sd", count=sum(v <= POSTERIOR_SDS for v in z), total=len(z)),
        ]
    sizes = [o.class_size for o in judged if o.class_size]
    seconds = [o.elapsed_s for o in outcomes if o.elapsed_s is not None]
    return {
        "cases": len(outcomes),
        "failed": [f"{o.name}: {o.error}" for o in outcomes if o.verdict == FAILED],
        "proportions": [p.as_json() for p in proportions],
        "mean_class_size": _mean(sizes),
        "held_out_over_floor_before": _median([o.floor_ratio_before for o in named]),
        "held_out_over_floor_after": _median([o.floor_ratio for o in named]),
        "seconds_median": _median(seconds),
        "seconds_max": max(seconds, default=None),
        "undetectable": [f"{o.name}: {', '.join(o.hidden)}" for o in outcomes if not o.detectable],
        "misses": [_miss(o) for o in judged if _missed(kind, o)],
        "confusion": confusion(judged),
    }


def confusion(outcomes: Sequence[Outcome]) -> dict[str, dict[str, int]]:
    """Counts by hidden name (row), then by first name given (column); names in alphabetical order."""
    counts = Counter(o.confusion for o in outcomes)
    rows = sorted({row for row, _ in counts})
    return {row: {c: counts[row, c] for r, c in sorted(counts) if r == row} for row in rows}


def _missed(kind: str, outcome: Outcome) -> bool:
    if kind == "none":
        return bool(outcome.named) or outcome.verdict == FAILED
    if kind == "outside":
        return outcome.verdict != UNEXPLAINED
    if kind == "pairs":
        return not outcome.both_named or bool(outcome.extra)
    return not outcome.right_place or bool(outcome.extra)


def _miss(outcome: Outcome) -> str:
    said = ", ".join(outcome.named) or outcome.verdict
    return f"{outcome.name}: {', '.join(outcome.hidden) or NOTHING}; said {said}"


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _median(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None
