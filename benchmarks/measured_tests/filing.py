"""Results that are kept: one line of JSON each, with the version of the code that made it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measured_tests.fitting import thinned
from benchmarks.measured_tests.specimens import MeasuredTest
from benchmarks.running import filed_lines
from bwbn_bayes.parameters import Floats
from bwbn_bayes.results import finite

_ON_THE_WAY = ("candidates", "steps", "where", "sentences", "detection_limits")
"""Parts of ``discovery.json`` that no table reads."""


def identity(test: MeasuredTest, what: str, code: str, seed: int) -> dict[str, Any]:
    """What must agree for a filed result to stand for a new run."""
    return {
        "name": test.name,
        "what": what,
        "code": code,
        "seed": seed,
        "data": test.record.content_hash[:12],
        "n_fitted": test.n_fitted,
    }


def filed(path: Path) -> dict[tuple[str, str], dict[str, Any]]:
    """The last result of each test and kind, by name and kind; a line cut short is left out."""
    return {(entry["identity"]["name"], entry["identity"]["what"]): entry for entry in filed_lines(path)}


def is_current(entry: Mapping[str, Any] | None, wanted: Mapping[str, Any]) -> bool:
    """Whether a filed result is there, did not fail, and is of this code, data, split and seed."""
    return entry is not None and "error" not in entry and entry["identity"] == wanted


def file_result(path: Path, entry: Mapping[str, Any]) -> None:
    """Add a line; after one that was cut short it begins anew."""
    path.parent.mkdir(parents=True, exist_ok=True)
    whole = not path.exists() or path.read_bytes().endswith(b"\n") or path.stat().st_size == 0
    with path.open("a", encoding="utf-8") as file:
        file.write(("" if whole else "\n") + json.dumps(finite(entry)) + "\n")


def keep(path: Path, entries: Mapping[tuple[str, str], Mapping[str, Any]]) -> None:
    """File anew, by test and kind, what tables and figures come from: all but what a search tried on the way."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = (json.dumps(finite(_shortened(entries[key]))) + "\n" for key in sorted(entries))
    path.write_text("".join(lines), encoding="utf-8")


def _shortened(entry: Mapping[str, Any]) -> dict[str, Any]:
    result = entry.get("result", {})
    if "facts" not in result:
        return dict(entry)
    facts = {name: value for name, value in result["facts"].items() if name not in _ON_THE_WAY}
    return {**entry, "result": {**result, "facts": facts}}


def shown_response(test: MeasuredTest, response: Floats) -> dict[str, Any]:
    """A response ``(n_channels, n_times)`` at the points that a figure needs, to five digits."""
    if test.is_frame:
        index = np.arange(0, test.record.n_times, 2)
    else:
        index, _ = thinned(*test.pulled)
    values = [[float(f"{value:.5g}") for value in channel[index]] for channel in response]
    return {"index": index.tolist(), "values": values}
