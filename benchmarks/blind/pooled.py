"""What the cases of several trials come to together: by version, by kind, and every one that is not right."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.blind.columns import Proportion, confusion, is_missed
from benchmarks.blind.filed import FiledCase, Json
from benchmarks.blind.scoring import FAILED, SEVERAL, is_right, showing
from benchmarks.blind.stated import SURE

POSSIBLE = 0.5
"""Probability from which an effect that is not named is told beside a miss."""


def versions(cases: Sequence[FiledCase]) -> list[dict[str, Any]]:
    """Versions of the code that ran the cases, with how many each; empty where not recorded.

    Commits between which the code does the same, by its hash, are one version.
    """
    found: dict[tuple[str, str], list[FiledCase]] = {}
    for case in cases:
        commit, code = case.version
        found.setdefault((code, "" if code else commit), []).append(case)
    return [
        {
            "commits": sorted({case.version[0] for case in own} - {""}),
            "code": code,
            "cases": len(own),
            "kinds": sorted({case.outcome.kind for case in own}),
            "processors": sorted({case.processor for case in own} - {""}),
        }
        for (code, _), own in sorted(found.items())
    ]


def by_kind(cases: Sequence[FiledCase], kinds: Sequence[str]) -> list[dict[str, Any]]:
    """Of every kind that has cases: how many, how many are right, seconds, confusion.

    Parameters
    ----------
    cases : sequence of FiledCase
    kinds : sequence of str
        In the order of the table.
    """
    found = []
    for kind in kinds:
        own = [case for case in cases if case.outcome.kind == kind]
        if not own:
            continue
        judged = [case.outcome for case in own if case.outcome.detectable]
        right = Proportion(what=kind, count=sum(not is_missed(o) for o in judged), total=len(judged))
        found.append(
            {
                "kind": kind,
                "seeds": sorted({(case.outcome.snr_db, case.entry["truth"]["seed"]) for case in own}),
                "cases": len(own),
                "right": right.as_json(),
                "seconds": _median_and_worst(own, lambda case: case.seconds),
                "processor_seconds": _median_and_worst(own, lambda case: case.processor_seconds),
                "confusion": confusion(judged),
            }
        )
    return found


def misses(cases: Sequence[FiledCase], kinds: Sequence[str]) -> list[dict[str, Any]]:
    """Every case that is not right: what was hidden, what was told, and in what it is wrong.

    A case that cannot be detected counts nowhere, and is told where a wrong effect was named.

    Parameters
    ----------
    cases : sequence of FiledCase
    kinds : sequence of str
        In the order of the table.
    """
    found = [_miss(case) for case in cases if (is_missed(case.outcome) if case.outcome.detectable else _is_wrong(case))]
    return sorted(found, key=lambda one: (kinds.index(one["kind"]), -one["snr_db"], one["seed"], one["index"]))


def _is_wrong(case: FiledCase) -> bool:
    outcome = case.outcome
    return bool(outcome.extra or outcome.sure_and_wrong) or outcome.verdict == FAILED


def _miss(case: FiledCase) -> dict[str, Any]:
    truth, discovery, outcome = case.entry["truth"], case.entry["discovery"], case.outcome
    listed: Sequence[Json] = discovery.get("effects", [])
    shown = [e for e in listed if e.get("probability", 1.0) >= POSSIBLE]
    return {
        "kind": outcome.kind,
        "snr_db": outcome.snr_db,
        "seed": truth["seed"],
        "index": truth["index"],
        "counted": outcome.detectable,
        "hidden": [{"name": h["name"], "storeys": h["storeys"], "form": h.get("form", "")} for h in truth["effects"]],
        "told": [{"name": e["name"], "storeys": e["storeys"], "probability": e.get("probability")} for e in shown],
        "verdict": outcome.verdict,
        "verdict_probability": outcome.verdict_probabilities.get(outcome.verdict),
        "what": "; ".join(_what(case)),
    }


def _what(case: FiledCase) -> list[str]:
    """In what a case is wrong."""
    outcome, truth = case.outcome, case.entry["truth"]
    if outcome.verdict == FAILED:
        return [f"failed: {outcome.error.splitlines()[0]}"]
    listed: Sequence[Json] = case.entry["discovery"].get("effects", [])
    named = [e for e in listed if e.get("probability", 1.0) >= SURE]
    parts = []
    if outcome.kind not in ("none", "outside"):
        missing = [h["name"] for h in showing(truth) if not any(is_right(e, h) for e in named)]
        if missing and outcome.detectable:
            parts.append(f"not named: {', '.join(missing)}")
        elif not missing and outcome.kind not in SEVERAL and not outcome.right_name:
            parts.append("rightly named, but not first")
        elif outcome.right_name and not outcome.right_place and outcome.kind not in SEVERAL:
            parts.append("at another storey")
    extra = list(dict.fromkeys(one.partition("[")[0] for one in outcome.extra))
    if extra:
        parts.append(f"not there: {', '.join(extra)}")
    spread = [name for name in outcome.sure_and_wrong if name not in extra]
    if spread:
        parts.append(f"above 0.9 in `probabilities`, and not there: {', '.join(spread)}")
    return parts


def _median_and_worst(
    cases: Sequence[FiledCase], seconds: Callable[[FiledCase], float | None]
) -> dict[str, float | int | None]:
    known = [value for case in cases if (value := seconds(case)) is not None]
    return {
        "cases": len(known),
        "median": float(np.median(known)) if known else None,
        "worst": max(known, default=None),
    }
