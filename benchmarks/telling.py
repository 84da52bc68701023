"""What benchmarks tell of discoveries, and how they tell it: a table, all that it was made of, JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks.running import commit
from bwbn_bayes.discovery.outcome import Discovery, where_as_json

_KEPT = ("verdict", "verdict_probabilities", "sentences", "probabilities", "unexplained_share", "gap")
_OF_EFFECTS = ("name", "form", "title", "grade", "probability", "law_probability")


def told(found: Discovery) -> dict[str, Any]:
    """Verdict, effects and gap as ``discovery.json`` has them; where the improved model still disagrees."""
    facts = found.as_json()
    return {
        **{key: facts[key] for key in _KEPT},
        "effects": [{key: effect[key] for key in _OF_EFFECTS} for effect in facts["effects"]],
        "unnamed": facts["unnamed_force"] or facts["unnamed_reading"],
        "where_left": [spot["sentence"] for spot in where_as_json(found.after)],
    }


def gather(jobs: Mapping[str, Callable[[], dict[str, Any]]], path: Path | None) -> list[dict[str, Any]]:
    """What each job found; with a path it is filed as it ends, and by the same commit not run again.

    A job's name tells all that its result depends on but for the code.
    """
    filed = json.loads(path.read_text("utf-8")) if path is not None and path.exists() else {}
    known = {line.get("job"): line for line in filed.get("lines", ())} if _is_of_now(filed.get("commit")) else {}
    for name, job in jobs.items():
        if name not in known:
            known[name] = {"job": name, **job()}
            if path is not None:
                write(list(known.values()), path)
    return [known[name] for name in jobs]


def _is_of_now(version: str | None) -> bool:
    """Whether this commit wrote it; of changes that are not committed nobody can tell."""
    return version == commit() and not version.endswith("-dirty")


def write(lines: Sequence[dict[str, Any]], path: Path) -> None:
    """Lines with the version of the code."""
    path.write_text(json.dumps({"commit": commit(), "lines": list(lines)}, indent=1) + "\n", encoding="utf-8")


def tell(table: Table, lines: Sequence[dict[str, Any]], path: Path | None) -> None:
    """Print a table and all that it was made of; write that as JSON with the code's version, where a path is given."""
    Console(width=100).print(table)
    Console(width=100).print(lines)
    if path is not None:
        write(lines, path)
