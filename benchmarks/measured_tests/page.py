"""``docs/measured_tests.md``, written from the JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks import markdown
from benchmarks.markdown import links
from benchmarks.measured_tests.tables import COMPETITORS, OF_SPECIMENS, in_per_cent

Json = Mapping[str, Any]

TITLES = {
    **OF_SPECIMENS,
    "linear_chain": "chain",
    "discover": "`discover`, first part",
    "whole": "`discover`, whole record",
    "repeats": "`discover`, repeat cycles held out",
}
"""Kinds of trials in the order of the page."""


def write_page(facts: Json, figures: Mapping[str, Path], path: Path) -> None:
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
    context = {
        "versions": _versions(facts["versions"]),
        "not_run": _not_run(facts),
        "asked": [_asked(one) for one in (*facts["sums"], *facts["label_sums"], *facts["repeat_sums"]) if one["total"]],
        "processors": sorted({name for one in facts["versions"] for name in one["processors"]}),
        "rows": [_row(one) for one in facts["rows"] if one["is_run"]],
        "failed": facts["failed"],
        "labels": [_label(one) for one in facts["labels"]],
        "repeats": [_repeat(one) for one in facts["repeats"]],
        "figures": links(figures, path),
    }
    markdown.write_page(path, "benchmarks.measured_tests", "measured_tests.md.j2", context)


def _versions(versions: Sequence[Json]) -> list[tuple[str, ...]]:
    """Of a kind that more than one version ran, each with its tests by name."""
    return [
        (
            TITLES[one["what"]],
            ", ".join(f"`{commit}`" for commit in one["commits"]),
            f"`{one['code']}`",
            ", ".join(one["tests"])
            if sum(other["what"] == one["what"] for other in versions) > 1
            else str(len(one["tests"])),
        )
        for one in sorted(versions, key=lambda one: list(TITLES).index(one["what"]))
    ]


def _not_run(facts: Json) -> list[str]:
    """What is missing, a sentence for each kind of trial."""
    ran = {one["what"] for one in facts["versions"]}
    sentences = []
    for what, names in facts["not_run"].items():
        if what not in ran:
            sentences.append(f"{TITLES[what]}: not run.")
        elif names:
            sentences.append(f"{TITLES[what]}: not run on {', '.join(names)}.")
    return sentences


def _asked(one: Json) -> tuple[str, ...]:
    return one["what"], one["asked"], f"{one['count']} of {one['total']}"


def _row(one: Json) -> tuple[str, ...]:
    mark = "" if one["rule"] == "parting_time" else " *"
    share = f"{100.0 * one['n_fitted'] / one['n_points']:.0f} %{mark}"
    errors = [in_per_cent(one["competitors"].get(what)) for what in COMPETITORS]
    said = one["verdict"], one["names"], _number(one["seconds"], 0)
    return one["name"], str(one["n_points"]), share, *errors, in_per_cent(one["ours"]), *said


def _label(one: Json) -> tuple[str, ...]:
    said = "pinched" if one["says_pinched"] else ""
    measures = (
        (*(_number(value, 3) for value in one[measure]), _interval(one[interval]))
        for measure, interval in (("index", "index_interval"), ("strength_lost", "strength_interval"))
    )
    index, lost = measures
    unnamed = "" if one["unnamed_share"] is None else f"{100.0 * one['unnamed_share']:.0f} %"
    shares = f"{_number(one['fit'], 1)} %", unnamed
    return one["name"], one["loops"], said, *shares, one["names"], *index, *lost, _number(one["seconds"], 0)


def _repeat(one: Json) -> tuple[str, ...]:
    errors = in_per_cent((one["given"],)), in_per_cent(one["errors"])
    inside = f"{_number(100.0 * one['coverage'], 0)} %"
    points = str(one["n_points"]), str(one["n_held_out"])
    return one["name"], *points, *errors, inside, one["names"], _number(one["seconds"], 0)


def _interval(ends: Sequence[float] | None) -> str:
    return "" if ends is None else f"{ends[0]:.3f} to {ends[1]:.3f}"


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"
