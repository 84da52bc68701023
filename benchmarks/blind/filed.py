"""Cases that trials have filed, one line of JSON each, and who ran them: version of the code, processor, seconds."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from benchmarks.blind.scoring import Outcome, case_outcome
from benchmarks.running import filed_lines

Json = Mapping[str, Any]

_SCORED = ("schema", "verdict", "verdict_probabilities", "probabilities", "elapsed_s", "error")
_OF_EFFECT = ("name", "storeys", "probability", "equivalent", "parameters")
"""What of ``discovery.json`` decides how a case came out, beside errors on what was held out."""


@dataclass(frozen=True, kw_only=True)
class FiledCase:
    """A case as filed, and how it came out.

    Attributes
    ----------
    entry : mapping
        ``key``, ``truth``, ``discovery``; of cases run since they are recorded also ``commit``, ``code`` (hash of what
        the package's code does), ``processor``, ``seconds`` and ``processor_seconds``.
    outcome : Outcome
    """

    entry: Json
    outcome: Outcome

    @classmethod
    def of(cls, entry: Json) -> Self:
        """Score what is filed."""
        return cls(entry=entry, outcome=case_outcome(entry["truth"], entry["discovery"]))

    @property
    def kept(self) -> dict[str, Any]:
        """The entry without what does not decide how it came out, a thirtieth of it: as it is kept with the code."""
        told: Json = self.entry["discovery"]
        gap: Json = told.get("gap", {})
        held_out: Json = gap.get("held_out") or {}
        scored: dict[str, Any] = {name: told[name] for name in _SCORED if name in told}
        if "effects" in told:
            scored["effects"] = [{name: one[name] for name in _OF_EFFECT if name in one} for one in told["effects"]]
        errors = {name: held_out[name] for name in ("before", "after") if name in held_out}
        scored["gap"] = {"noise_floor": gap.get("noise_floor"), "held_out": errors}
        return {**self.entry, "discovery": scored}

    @property
    def version(self) -> tuple[str, str]:
        """Commit and hash of the code that ran it; empty where not recorded."""
        return str(self.entry.get("commit", "")), str(self.entry.get("code", ""))

    @property
    def processor(self) -> str:
        """That ran it; empty where not recorded."""
        return str(self.entry.get("processor", ""))

    @property
    def seconds(self) -> float | None:
        """By the clock [s]: of the whole run where recorded, else as discovery itself tells."""
        value = self.entry.get("seconds", self.outcome.elapsed_s)
        return None if value is None else float(value)

    @property
    def processor_seconds(self) -> float | None:
        """Of all threads [s]; None where not recorded."""
        value = self.entry.get("processor_seconds")
        return None if value is None else float(value)


def keep(cases: Sequence[FiledCase], path: Path) -> None:
    """File what decides how cases came out."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(json.dumps(case.kept) + "\n" for case in cases), encoding="utf-8")


def filed_entries(path: Path) -> dict[str, dict[str, Any]]:
    """Entries by key, of one that was tried again the last; a line cut short is left out."""
    return {entry["key"]: entry for entry in filed_lines(path)}


def finished_entries(path: Path) -> dict[str, dict[str, Any]]:
    """Entries by key without those that failed, which are to be tried again."""
    return {key: entry for key, entry in filed_entries(path).items() if "error" not in entry["discovery"]}


def other_cases(logs: Sequence[Path], own: set[str]) -> list[FiledCase]:
    """Cases that other trials have filed: failures too, each case once, and none that this trial holds.

    Of a case that several files hold the last file's counts.

    Raises
    ------
    FileNotFoundError
        If a file is not there.
    """
    found: dict[str, dict[str, Any]] = {}
    for log in logs:
        if not log.exists():
            raise FileNotFoundError(log)
        found |= filed_entries(log)
    return [FiledCase.of(entry) for key, entry in found.items() if key not in own]
