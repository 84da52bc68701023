"""What a trial files: lines of JSON, and how each came about: version of the code, processor, seconds."""

from __future__ import annotations

import ast
import hashlib
import json
import subprocess
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from bwbn_bayes.inference.summary import processor_name

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "bwbn_bayes"
_NOT_DECIDING = ("cli", "report", "reproduction")
"""Rooms of the package that decide nothing about a discovery."""


def filed_lines(path: Path) -> Iterator[dict[str, Any]]:
    """What a file holds, one line of JSON each; a line cut short is left out, and nothing is where no file is."""
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        with suppress(json.JSONDecodeError):
            yield json.loads(line)


@cache
def commit() -> str:
    """Commit of the code, as it was when first asked for: a long run may outlive a checkout."""
    found = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    return found.stdout.strip() or "unknown"


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


@cache
def package_version() -> str:
    """Version of the code of the package that a discovery depends on, as it was when first asked for."""
    rooms = PACKAGE.rglob("*.py")
    return code_version(path for path in rooms if path.relative_to(PACKAGE).parts[0] not in _NOT_DECIDING)


@dataclass(frozen=True, kw_only=True)
class Clock:
    """Seconds since it was made."""

    wall: float = field(default_factory=time.perf_counter)
    processor: float = field(default_factory=time.process_time)

    @property
    def processor_seconds(self) -> float:
        """Of the processor, all threads together."""
        return time.process_time() - self.processor

    def as_json(self) -> dict[str, str | float]:
        """Seconds by the clock and of the processor, of all threads, and which processor it is."""
        return {
            "processor": processor_name(),
            "seconds": time.perf_counter() - self.wall,
            "processor_seconds": self.processor_seconds,
        }


def _is_remark(statement: object) -> bool:
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
