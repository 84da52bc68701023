"""The rows that are asked of a trial, pooled over its kinds, beside what is asked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmarks.blind.columns import (
    ALL_NAMED,
    NAMED_OR_FAILED,
    NONE_SURE,
    NOT_THERE,
    RIGHT_NAME,
    RIGHT_PLACE,
    SURE_AND_WRONG,
    Question,
)
from benchmarks.blind.scoring import Outcome

_ASKED_BY_SNR = {40.0: ">= 98 %", 30.0: ">= 97 %", 20.0: ">= 93 %", 10.0: ">= 85 %"}

_ROWS: tuple[tuple[tuple[str, ...], str, Question, str], ...] = (
    (("none",), "nothing hidden", NAMED_OR_FAILED, "<= 1 %"),
    (("later",), "joined later", RIGHT_NAME, ">= 95 % at 30 dB"),
    (("later",), "joined later", SURE_AND_WRONG, ""),
    (("forms", "more_forms"), "other forms", RIGHT_NAME, ">= 85 %"),
    (("forms", "more_forms"), "other forms", SURE_AND_WRONG, "<= 3 %"),
    (("outside",), "outside the catalogue", NONE_SURE, ">= 95 %"),
    (("pairs",), "pairs", ALL_NAMED, ">= 88 %"),
    (("pairs",), "pairs", NOT_THERE, "<= 3 %"),
)


def show_rows(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """Count every row that has cases, over its detectable cases.

    Parameters
    ----------
    outcomes : sequence of Outcome
        Of any kinds and noise levels.

    Returns
    -------
    list of dict
        As :meth:`benchmarks.blind.scoring.Proportion.as_json`, with ``asked`` (empty where nothing is).
    """
    judged = [o for o in outcomes if o.detectable]
    rows = []
    for snr_db in sorted({o.snr_db for o in judged if o.kind == "catalogue"}, reverse=True):
        cases = [o for o in judged if o.kind == "catalogue" and o.snr_db == snr_db]
        heading = f"catalogue, {snr_db:g} dB: {RIGHT_PLACE.what}"
        rows.append(_row(RIGHT_PLACE, cases, heading, _ASKED_BY_SNR.get(snr_db, "")))
    for kinds, heading, question, asked in _ROWS:
        rows.append(_row(question, [o for o in judged if o.kind in kinds], f"{heading}: {question.what}", asked))
    hiding, plain = ([o for o in judged if o.kind == "cyclic" and bool(o.hidden) == some] for some in (True, False))
    asked_of_cyclic = (ALL_NAMED, NOT_THERE, SURE_AND_WRONG)
    rows += [_row(question, hiding, f"cyclic tests: {question.what}", "") for question in asked_of_cyclic]
    rows.append(_row(NAMED_OR_FAILED, plain, f"cyclic tests, nothing hidden: {NAMED_OR_FAILED.what}", ""))
    return [row for row in rows if row["total"]]


def _row(question: Question, cases: Sequence[Outcome], what: str, asked: str) -> dict[str, Any]:
    return {**question.over(cases, what).as_json(), "asked": asked}
