"""The model files that come with the package, to copy and to edit."""

from __future__ import annotations

import ast
from pathlib import Path

from bwbn_bayes.errors import UserError

_PACKAGE = Path(__file__).parents[1]


def examples() -> dict[str, str]:
    """Name of each model file, with the first line that it says of itself."""
    return {path.stem: _first_line(path) for path in sorted(_folder().glob("*.py"))}


def example_files(name: str) -> tuple[Path, ...]:
    """The model file of that name, then the records that it reads: their names begin with its own.

    Raises
    ------
    UserError
        If there is none.
    """
    if name not in examples():
        raise UserError(f"example {name!r} does not come with the package: choose one of {', '.join(examples())}")
    return (_folder() / f"{name}.py", *sorted(_folder().glob(f"{name}*.csv")))


def _folder() -> Path:
    """In an installed package they stand in it, in a clone beside it."""
    inside = _PACKAGE / "models"
    return inside if inside.is_dir() else _PACKAGE.parent / "models"


def _first_line(path: Path) -> str:
    said = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return said.partition("\n")[0]
