"""Results that are kept: one line of JSON each, with the version of the code that made it."""

from __future__ import annotations

import ast
import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measured_tests.fitting import thinned
from benchmarks.measured_tests.specimens import MeasuredTest
from bwbn_bayes.parameters import Floats
from bwbn_bayes.results import finite

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "bwbn_bayes"
_NOT_DECIDING = ("cli", "report", "reproduction")
"""Rooms of the package that decide nothing about a discovery."""


def code_version(files: Iterable[Path]) -> str:
    """Hash of what Python files do: comments, docstrings and layout do not enter."""
    digest = hashlib.sha256()
    for path in sorted(files):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            body = getattr(node, "body", None)
            if isinstance(body, list):
                node.body = [one for one in body if not _is_remark(one)]  # type: ignore[attr-defined]
        digest.update(f"{path.name}\n{ast.dump(tree)}".encode())
    return digest.hexdigest()[:12]


def package_version() -> str:
    """Version of the code of the package that a discovery depends on."""
    rooms = PACKAGE.rglob("*.py")
    return code_version(path for path in rooms if path.relative_to(PACKAGE).parts[0] not in _NOT_DECIDING)


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
    found = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            entry = json.loads(line)
        except json.JSONDecodeError:
            continue
        found[entry["identity"]["name"], entry["identity"]["what"]] = entry
    return found


def is_current(entry: Mapping[str, Any] | None, wanted: Mapping[str, Any]) -> bool:
    """Whether a filed result is there, did not fail, and is of this code, data, split and seed."""
    return entry is not None and "error" not in entry and entry["identity"] == wanted


def file_result(path: Path, entry: Mapping[str, Any]) -> None:
    """Add a line; after one that was cut short it begins anew."""
    path.parent.mkdir(parents=True, exist_ok=True)
    whole = not path.exists() or path.read_bytes().endswith(b"\n") or path.stat().st_size == 0
    with path.open("a", encoding="utf-8") as file:
        file.write(("" if whole else "\n") + json.dumps(finite(entry)) + "\n")


def shown_response(test: MeasuredTest, response: Floats) -> dict[str, Any]:
    """A response ``(n_channels, n_times)`` at the points that a figure needs, to five digits."""
    if test.is_frame:
        index = np.arange(0, test.record.n_times, 2)
    else:
        index, _ = thinned(*test.pulled)
    values = [[float(f"{value:.5g}") for value in channel[index]] for channel in response]
    return {"index": index.tolist(), "values": values}


def _is_remark(statement: object) -> bool:
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
