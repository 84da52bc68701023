"""``docs/blind_trials.md``, written from the JSON of a trial."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks import markdown
from benchmarks.blind.scoring import label
from benchmarks.markdown import links, probability

Json = Mapping[str, Any]

KIND_TITLES = {
    "catalogue": "one effect of the catalogue",
    "none": "nothing hidden",
    "pairs": "two effects",
    "forms": "other forms",
    "more_forms": "more forms",
    "later": "joined later",
    "cyclic": "cyclic tests",
    "outside": "outside the catalogue",
}
"""Kinds of cases in the order of the page."""


def write_page(facts: Json, figures: Mapping[str, Path], path: Path) -> None:
    """Write the page.

    Parameters
    ----------
    facts : mapping
        The JSON of a trial: what it pools is shown.
    figures : mapping of str to Path
        PNG of the confusion matrix of each kind, and of ``reliability``, where drawn.
    path : Path
        The Markdown file.
    """
    pooled: Json = facts["pooled"]
    context = {
        "logs": facts["logs"],
        "n_cases": pooled["cases"],
        "versions": [_version(one) for one in pooled["versions"]],
        "rows": [_asked(row) for row in pooled["rows"]],
        "kinds": [_kind(one) for one in pooled["by_kind"]],
        "missing": [f"`{kind}`" for kind in KIND_TITLES if kind not in {one["kind"] for one in pooled["by_kind"]}],
        "processors": sorted({name for one in pooled["versions"] for name in one["processors"]}),
        "misses": [_miss(one) for one in pooled["misses"] if one["counted"]],
        "uncounted": [_miss(one) for one in pooled["misses"] if not one["counted"]],
        "confusions": [row for one in pooled["by_kind"] for row in _confusion(one)],
        "errors": _errors(pooled["reliability"]),
        "figures": links(figures, path),
        "titles": KIND_TITLES,
    }
    markdown.write_page(path, "benchmarks.blind", "blind_trials.md.j2", context)


def _version(one: Json) -> tuple[str, ...]:
    """Commits, hash, cases and kinds."""
    kinds = ", ".join(f"`{kind}`" for kind in one["kinds"])
    commits = ", ".join(f"`{commit}`" for commit in one["commits"])
    code = f"`{one['code']}`" if one["code"] else ""
    return commits or "not recorded", code, str(one["cases"]), kinds


def _asked(row: Json) -> tuple[str, ...]:
    return row["what"], row["asked"], f"{row['count']} of {row['total']}", *_share(row)


def _share(row: Json) -> tuple[str, str]:
    """Share and its interval in per cent."""
    low, high = (100.0 * end for end in row["interval95"])
    share = "" if row["share"] is None else f"{100.0 * row['share']:.0f} %"
    return share, f"{low:.0f} to {high:.0f} %" if row["total"] else ""


def _kind(one: Json) -> tuple[str, ...]:
    right = one["right"]
    seeds: dict[float, list[str]] = {}
    for snr_db, seed in one["seeds"]:
        seeds.setdefault(snr_db, []).append(str(seed))
    return (
        f"`{one['kind']}`",
        "; ".join(f"{snr_db:g} dB: {', '.join(own)}" for snr_db, own in seeds.items()),
        str(one["cases"]),
        str(right["total"]),
        str(right["count"]),
        _share(right)[1],
        _seconds(one["seconds"]),
        _seconds(one["processor_seconds"]),
    )


def _seconds(times: Json) -> str:
    return f"{times['median']:.0f} / {times['worst']:.0f}" if times["cases"] else ""


def _miss(one: Json) -> tuple[str, ...]:
    return (
        f"`{one['kind']}`",
        f"{one['snr_db']:g} dB, {one['seed']}/{one['index']}",
        "<br>".join(h["name"] + (f" ({h['form']})" if h["form"] else "") for h in one["hidden"]) or "nothing",
        "<br>".join(", ".join(map(str, h["storeys"])) or "\N{EN DASH}" for h in one["hidden"]),
        "<br>".join(_told(e) for e in one["told"]) or "none",
        f"{one['verdict']} {probability(one['verdict_probability'])}".strip(),
        one["what"],
    )


def _told(effect: Json) -> str:
    said = probability(effect["probability"])
    return label(effect["name"], effect["storeys"]) + (f" ({said})" if said else "")


def _confusion(one: Json) -> list[tuple[str, ...]]:
    """One row for each hidden effect of a kind: cases, rightly named, and every name given, rightly or not."""
    rows = []
    for hidden in dict.fromkeys(cell["hidden"] for cell in one["confusion"]):
        own = [cell for cell in one["confusion"] if cell["hidden"] == hidden]
        right = sum(cell["count"] for cell in own if cell["right"])
        names = {True: [], False: []}  # type: dict[bool, list[str]]
        for cell in own:
            names[cell["right"]].append(f"{cell['named']} {cell['count']}")
        total = sum(cell["count"] for cell in own)
        told = (", ".join(names[kind]) for kind in (True, False))
        rows.append((f"`{one['kind']}`", hidden, f"{right} of {total}", *told))
    return rows


def _errors(kept: Json) -> list[str]:
    """The expected calibration errors as sentences."""
    found = []
    for key, what in (
        ("expected_calibration_error", "statements of 0.1 and more"),
        ("expected_calibration_error_of_all", "all statements"),
    ):
        error = kept[key]
        if error["value"] is not None:
            found.append(
                f"Expected calibration error over {what} ({error['statements']}, of {kept['cases']} cases): "
                f"{error['value']:.3f} ± {error['se']:.3f}; perfect probabilities would give "
                f"{error['if_calibrated']:.3f}."
            )
    return found
