"""Pages of results in Markdown, written from templates."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

_NOTHING = "\N{EN DASH}"


def write_page(path: Path, package: str, template: str, context: Mapping[str, object]) -> None:
    """Write a page from a template of a package.

    Parameters
    ----------
    path : Path
        The Markdown file.
    package : str
        Dotted name; templates lie in its folder ``templates``.
    template : str
        Name of the file; it may call :func:`table`.
    context : mapping
        What it shows.
    """
    environment = Environment(
        loader=PackageLoader(package),
        autoescape=False,  # Markdown
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    text = environment.get_template(template).render(**context, table=table)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(re.sub(r"\n{3,}", "\n\n", text), encoding="utf-8")


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table without the columns in which no row has anything; an empty cell among others is a dash."""
    kept = [column for column in range(len(head)) if any(row[column] for row in rows)]
    lines = [[head[column] for column in kept], ["---"] * len(kept)]
    lines += [[row[column].replace("|", "\\|") or _NOTHING for column in kept] for row in rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def probability(value: float | None) -> str:
    """To two digits; one that they would make a certainty is above 0.99, and None is empty."""
    if value is None:
        return ""
    return "> 0.99" if value > 0.995 else f"{value:.2f}"


def links(figures: Mapping[str, Path], page: Path) -> dict[str, str]:
    """Where figures lie as seen from a page."""
    folder = page.parent.resolve()
    return {name: Path(os.path.relpath(figure.resolve(), folder)).as_posix() for name, figure in figures.items()}
