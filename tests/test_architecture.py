"""Imports run one way through the house, and PyMC stays in its room."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "bwbn_bayes"

ORDER = (
    "__main__", "cli", "__init__", "export", "report", "reproduction", "identification", "discovery", "baselines",
    "inference", "engines", "structures", "elements", "results", "records", "parameters", "errors", "lazily",
    "versions",
)  # fmt: skip
"""From the top of the house to the bottom: a module may import its own room and those below."""

GUARDED = {"pymc": "inference/pymc", "pytensor": "inference/pymc", "nutpie": "inference/pymc", "sunode": "engines"}
"""Libraries that one room alone may import."""


def imported(path: Path, package: Path) -> Iterator[tuple[int, str]]:
    """Line and absolute dotted name of everything a module imports."""
    parts = path.relative_to(package.parent).with_suffix("").parts
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = parts[: len(parts) - node.level] if node.level else ()
            base = ".".join((*above, *((node.module,) if node.module else ())))
            yield from ((node.lineno, f"{base}.{alias.name}") for alias in node.names)


def room(dotted: str, package: Path) -> str | None:
    """The room of a dotted name inside the package; None for another library."""
    head, *rest = dotted.split(".")
    if head != package.name:
        return None
    return rest[0] if rest and rest[0] in ORDER else "__init__"


def violations(package: Path) -> list[str]:
    """Every import against the order, as a sentence."""
    found = []
    for path in sorted(package.rglob("*.py")):
        place = path.relative_to(package)
        own = place.parts[0].removesuffix(".py")
        if own not in ORDER:
            found.append(f"{place}: room {own} has no place in the order")
            continue
        for line, name in imported(path, package):
            there = room(name, package)
            if there is not None and ORDER.index(there) < ORDER.index(own):
                found.append(f"{place}:{line}: {own} imports {name} from above")
            home = GUARDED.get(name.split(".")[0])
            if home and not place.as_posix().startswith(f"{home}/"):
                found.append(f"{place}:{line}: {name} is imported outside {home}")
    return found


def test_imports_run_one_way():
    assert violations(PACKAGE) == []


@pytest.mark.parametrize(
    ("place", "source", "sentence"),
    [
        ("elements/law.py", "from pkg.engines import lanes", "elements imports pkg.engines.lanes from above"),
        ("records/record.py", "import pkg.inference.tmcmc", "records imports pkg.inference.tmcmc from above"),
        ("engines/base.py", "def f():\n    from ..report import html", "engines imports pkg.report.html from above"),
        ("parameters.py", "from pkg import simulate", "parameters imports pkg.simulate from above"),
        ("report/html.py", "from pkg import cli", "report imports pkg.cli from above"),
        ("inference/modes.py", "import pymc as pm", "pymc is imported outside inference/pymc"),
        ("tools/x.py", "", "room tools has no place"),
        ("inference/modes.py", "from pkg.engines import base\nfrom . import other\nimport numpy", None),
        ("inference/pymc/op.py", "import pymc\nfrom pytensor import tensor", None),
        ("report/html.py", "from ..results import Result", None),
    ],
)
def test_the_check_itself(tmp_path, place, source, sentence):
    path = tmp_path / "pkg" / place
    path.parent.mkdir(parents=True)
    path.write_text(source)
    found = violations(tmp_path / "pkg")
    assert (found == []) if sentence is None else (len(found) == 1 and sentence in found[0]), found
