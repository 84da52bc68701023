"""Runs the code blocks of a page in order."""

from __future__ import annotations

import re
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"


def run_page(name: str) -> dict[str, object]:
    """The names that the page's Python blocks leave behind."""
    names: dict[str, object] = {"__name__": name}
    for block in re.findall(r"^```python\n(.*?)^```$", (DOCS / name).read_text("utf-8"), re.MULTILINE | re.DOTALL):
        exec(compile(block, name, "exec", dont_inherit=True), names)
    return names
