"""Score what discovery says against what was hidden, one case at a time.

Only the dictionary of ``discovery.json`` is read, so that hand-made ones can be scored as well. Of schema 2 an effect
counts as named from a probability of 0.9; schema 1 states none, and what asks for them has no cases.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from benchmarks.blind.stated import SURE, stated

Json = Mapping[str, Any]
Claim = tuple[float, bool]
"""A probability stated for a name, and whether it was hidden."""

SHOWS_NATS = 40.0
NOTHING = "nothing"
UNEXPLAINED = "unexplained"
FAILED = "failed"
SEVERAL = ("pairs", "cyclic")
"""Kinds of cases that may hide more than one effect: each is asked for, in any order."""


class Confusion(NamedTuple):
    """Cell of the confusion matrix: an effect hidden (or nothing), what was named for it, and whether that is right."""

    hidden: str
    named: str
    right: bool


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How one case came out.

    Attributes
    ----------
    kind, name : str
        Column and label of the case.
    hidden : tuple of str
        What was hidden: names, with place and form.
    confusion : tuple of Confusion
        Of the hidden effect, with the first name given (or nothing, unexplained, failed); where there may be several,
        of each, with the name that is right for it or else the first that is right for none.
    detectable, severe : bool
        See :class:`benchmarks.blind.cases.Truth`.
    verdict : str
        As discovery gives it, or ``failed``.
    snr_db : float
        Signal-to-noise ratio. [dB of mean square]
    named : tuple of str
        Every effect named, with its place.
    right_name, right_place, within_class : bool
        Of the first hidden effect: the first name given is right; it is at the right place as well; the right name
        is the first one listed, named or not, or among those it is said to be equivalent to.
    all_named : bool
        Every hidden effect is among the effects named; of a cyclic test, every one that shows.
    extra : tuple of str
        Effects named that are not hidden, at any place.
    wrong_with_confidence : bool
        The first name given is wrong, and the right one is not among those said to be equivalent to it.
    sure_and_wrong : tuple of str
        Names with a probability above 0.9 that are not hidden.
    claims : tuple of (float, bool), or None
        Every probability stated for a name, and whether it was hidden. Names that are right for one hidden effect count
        as one, by the sum of their probabilities; a hidden effect that is not listed has probability zero, but for one
        outside the catalogue, which is no statement. None where no probabilities are stated.
    verdict_probabilities : mapping of str to float
        As stated.
    class_size : int
        Names in the equivalence class of the first effect listed; 0 where none is.
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
    confusion: tuple[Confusion, ...]
    detectable: bool
    severe: bool
    snr_db: float
    verdict: str
    named: tuple[str, ...]
    right_name: bool
    right_place: bool
    within_class: bool
    all_named: bool
    extra: tuple[str, ...]
    wrong_with_confidence: bool
    sure_and_wrong: tuple[str, ...]
    claims: tuple[Claim, ...] | None
    verdict_probabilities: Mapping[str, float]
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
    listed: Sequence[Json] = discovery.get("effects", [])
    effects = [e for e in listed if e.get("probability", 1.0) >= SURE]
    probabilities = stated(discovery)
    names = {} if probabilities is None else probabilities.names
    verdict = str(discovery.get("verdict", FAILED))
    first = effects[0] if effects else None
    right_name = bool(first and any(is_right(first, h) for h in hidden))
    leading = listed[0] if listed else None  # of a class that shares a probability none is named
    in_class = bool(leading and any(_in_class(leading, h) for h in hidden))
    held_out: Json = discovery.get("gap", {}).get("held_out") or {}
    floor = truth.get("held_out_floor", discovery.get("gap", {}).get("noise_floor"))
    return Outcome(
        kind=truth["kind"],
        name=truth["name"],
        hidden=tuple(label(h["name"], h["storeys"], h.get("form", "")) for h in hidden),
        confusion=_confusion(truth, effects, verdict),
        detectable=bool(truth["detectable"]) or (truth["kind"] == "cyclic" and bool(showing(truth))),
        severe=bool(truth["severe"]),
        snr_db=truth["snr_db"],
        verdict=verdict,
        named=tuple(label(e["name"], e["storeys"]) for e in effects),
        right_name=right_name,
        right_place=bool(first and any(is_right(first, h) and same_place(first, h) for h in hidden)),
        within_class=in_class,
        all_named=all(any(is_right(e, h) for e in effects) for h in showing(truth)),
        extra=tuple(label(e["name"], e["storeys"]) for e in effects if not any(is_right(e, h) for h in hidden)),
        wrong_with_confidence=first is not None and not any(_in_class(first, h) for h in hidden),
        sure_and_wrong=tuple(name for name, p in names.items() if p > SURE and not _is_hidden(name, hidden)),
        claims=None if probabilities is None else _claims(truth["kind"], names, hidden),
        verdict_probabilities={} if probabilities is None else probabilities.verdicts,
        class_size=_class_size(leading),
        held_out_before=held_out.get("before"),
        held_out_after=held_out.get("after"),
        noise_floor=floor,
        z=_z(hidden, effects),
        elapsed_s=discovery.get("elapsed_s"),
        error=str(discovery.get("error", "")),
    )


def label(name: str, storeys: Sequence[int], form: str = "") -> str:
    """Name, place and form as one word."""
    place = f"[{','.join(map(str, storeys))}]" if storeys else ""
    return f"{name}{place}" + (f" ({form})" if form else "")


def showing(truth: Json) -> list[Json]:
    """Hidden effects to be named: all; of a cyclic test, where another may cover one, those that show."""
    hidden: Sequence[Json] = truth["effects"]
    if truth["kind"] != "cyclic" or not truth["nats"]:
        return list(hidden)
    return [h for h, nats in zip(hidden, truth["nats"], strict=True) if nats > SHOWS_NATS]


def _claims(kind: str, names: Mapping[str, float], hidden: Sequence[Json]) -> tuple[Claim, ...]:
    # What no catalogue holds has no name that could be stated; bending at one floor has one.
    right = [
        (min(sum(names.get(name, 0.0) for name in h["accepted"]), 1.0), True)
        for h in hidden
        if kind != "outside" or names.keys() & set(h["accepted"])
    ]
    return (*right, *((p, False) for name, p in names.items() if not _is_hidden(name, hidden)))


def _is_hidden(name: str, hidden: Sequence[Json]) -> bool:
    return any(name in h["accepted"] for h in hidden)


def is_right(effect: Json, hidden: Json) -> bool:
    """Whether an effect named bears a name that is right for a hidden one."""
    return effect["name"] in hidden["accepted"]


def same_place(effect: Json, hidden: Json) -> bool:
    """Whether an effect named stands where a hidden one does."""
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
    return is_right(effect, hidden) or bool(_equivalents(effect) & set(hidden["accepted"]))


def _class_size(first: Json | None) -> int:
    return 1 + len(_equivalents(first)) if first else 0


def _confusion(truth: Json, effects: Sequence[Json], verdict: str) -> tuple[Confusion, ...]:
    """What was named for each hidden effect; and each further name, where nothing of the kind is hidden."""
    hidden: Sequence[Json] = truth["effects"]
    extra = [e for e in effects if not any(is_right(e, h) for h in hidden)]
    cells = _named_for(truth, effects, extra, verdict)
    told = {cell.named for cell in cells}
    row = cells[0].hidden if truth["kind"] == "outside" else NOTHING
    beside = [Confusion(hidden=row, named=str(e["name"]), right=False) for e in extra if e["name"] not in told]
    return (*cells, *beside)


def _named_for(truth: Json, effects: Sequence[Json], extra: Sequence[Json], verdict: str) -> tuple[Confusion, ...]:
    hidden: Sequence[Json] = truth["effects"]
    first = _column(effects[0] if effects else None, verdict)
    if not hidden or truth["kind"] == "outside":
        row = hidden[0]["name"] if hidden else NOTHING
        return (Confusion(hidden=row, named=first, right=not extra and verdict != FAILED),)
    if truth["kind"] not in SEVERAL:
        right = bool(effects) and is_right(effects[0], hidden[0])
        return (Confusion(hidden=hidden[0]["name"], named=first, right=right),)
    cells = []
    for h in showing(truth):
        found = next((str(e["name"]) for e in effects if is_right(e, h)), None)
        named = found or _column(extra[0] if extra else None, verdict)
        cells.append(Confusion(hidden=h["name"], named=named, right=found is not None))
    return tuple(cells)


def _column(first: Json | None, verdict: str) -> str:
    if first:
        return str(first["name"])
    return {UNEXPLAINED: UNEXPLAINED, FAILED: FAILED}.get(verdict, NOTHING)


def _z(hidden: Sequence[Json], effects: Sequence[Json]) -> dict[str, float]:
    found = {}
    for h in hidden:
        for effect in effects:
            if effect["name"] != h["name"] or not same_place(effect, h):
                continue
            for label, moments in effect.get("parameters", {}).items():
                true = h["parameters"].get(label.partition("[")[0])
                if true is not None and moments["sd"]:
                    found[label] = (moments["mean"] - true) / moments["sd"]
    return found
