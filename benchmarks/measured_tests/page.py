"""``docs/measured_tests.md``, written from the JSON."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.measured_tests.tables import COMPETITORS, in_per_cent

_OPENING = """\
# Measured tests

Written by `benchmarks/measured.py` from its JSON; do not edit by hand.

```sh
uv run python -m benchmarks.measured --json measured.json --competitors --discover --whole --repeats \\
    --gallery docs/measured_tests --page docs/measured_tests.md
```

Cyclic tests of columns, a brace, a timber connection and dampers, and two shake-table runs of a three-storey frame
(displacements relative to its base, equal masses), read from `../shared/data`; PROVENANCE.md there says who measured
them. The first part of each is fitted, the rest predicted; the split is the same for all. Errors are NRMSE in %: rms
error over rms of the signal, fitted / held out. *BWBN* is the 13-parameter law with Foliente's pinch, *Pinching4*
OpenSees' material with 21 parameters, both by differential evolution and least squares with one seed; *chain* is a
linear one. Where no end moves as strongly as the whole (marked *), the last 30 % of the path are held out.
"""


def write_page(facts: Mapping[str, Any], figures: Mapping[str, Path], path: Path) -> None:
    """Write the page.

    Parameters
    ----------
    facts : mapping
        The benchmark's JSON.
    figures : mapping of str to Path
        PNG of each test, where drawn.
    path : Path
        The Markdown file.
    """
    parts = [
        _OPENING,
        *_rows(facts),
        *_labels(facts),
        *_repeats(facts),
        *_gallery(facts["rows"], figures, path.parent),
        "",
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(parts), encoding="utf-8")


def _rows(facts: Mapping[str, Any]) -> list[str]:
    lines = _head("test", "points", "fitted", "BWBN", "Pinching4", "chain", "discover", "verdict")
    for one in facts["rows"]:
        mark = "" if one["rule"] == "parting_time" else " *"
        share = f"{100.0 * one['n_fitted'] / one['n_points']:.0f} %{mark}"
        errors = [in_per_cent(one["competitors"].get(what)) for what in COMPETITORS]
        ours = in_per_cent(one["ours"])
        lines.append(_line(one["name"], one["n_points"], share, *errors, ours, one["in_words"]))
    return [*lines, "", *_sums(facts["sums"])]


def _labels(facts: Mapping[str, Any]) -> list[str]:
    if not facts["labels"]:
        return []
    lines = ["## Columns, whole records", ""]
    lines += _head("column", "loops", "said", "pinching index", "identified", "strength lost", "identified", "fit")
    for one in facts["labels"]:
        numbers = [_number(value, 3) for value in (*one["index"], *one["strength_lost"])]
        said = "pinched" if one["says_pinched"] else ""
        lines.append(_line(one["name"], one["loops"], said, *numbers, f"{_number(one['fit'], 1)} %"))
    return [*lines, "", *_sums(facts["label_sums"])]


def _repeats(facts: Mapping[str, Any]) -> list[str]:
    if not facts["repeats"]:
        return []
    lines = [
        "## Repeat cycles held out",
        "",
        "Fitted: the first cycle at each amplitude. Inside: held-out points within their 90 % predictive intervals.",
        "",
        *_head("test", "points", "held out", "as given", "fitted / held out", "inside"),
    ]
    for one in facts["repeats"]:
        errors = in_per_cent((one["given"],)), in_per_cent(one["errors"])
        inside = f"{_number(100.0 * one['coverage'], 0)} %"
        lines.append(_line(one["name"], one["n_points"], one["n_held_out"], *errors, inside))
    return [*lines, "", *_sums(facts["repeat_sums"])]


def _gallery(rows: Sequence[Mapping[str, Any]], figures: Mapping[str, Path], folder: Path) -> list[str]:
    shown = [one["name"] for one in rows if one["name"] in figures]
    if not shown:
        return []
    lines = ["## Loops", "", "Grey: measured. Blue: by the law named above the column.", ""]
    for name in shown:
        target = Path(os.path.relpath(figures[name].resolve(), folder.resolve())).as_posix()
        lines += [f"![{name}: measured loops and those of each law, fitted part above held-out part]({target})", ""]
    return lines


def _sums(totals: Sequence[Mapping[str, Any]]) -> list[str]:
    return [*(f"- {one['what']}: {one['count']} of {one['total']}" for one in totals), ""]


def _head(*cells: str) -> list[str]:
    return [_line(*cells), _line(*("---" for _ in cells))]


def _line(*cells: object) -> str:
    return f"| {' | '.join(str(cell) for cell in cells)} |"


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"
