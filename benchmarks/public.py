"""``docs/public_benchmarks.md``, written from the JSON of the benchmarks that others publish figures of, too.

``python -m benchmarks.public --boucwen boucwen.json --silverbox silverbox.json --frame frame.json
--page docs/public_benchmarks.md``
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks import markdown
from benchmarks.markdown import probability

Json = Mapping[str, Any]

GRADES = {
    "named": "named",
    "possible": "possible",
    "shape": "kept without a name",
    "weak": "kept, hardly likely",
}
"""Of effects, in words."""
_LEAST_SHOWN = 0.01
_PUBLISHED = {
    "multisine": "7.53e-6, a black box; the true parameters leave 2.3e-7",
    "sinesweep": "the true parameters leave 2.55e-6",
    "test_arrow": "0.96 with 5 parameters, 0.26 with 37, linear 13.7",
    "test_multisine": "0.36",
}
_ASKED = {"multisine": 5e-7, "sinesweep": 4e-6, "test_arrow": 0.9, "test_multisine": 0.5}
_TITLES = {
    "multisine": "multisine [m]",
    "sinesweep": "sine sweep [m]",
    "test_arrow": "arrow [mV]",
    "test_multisine": "multisine [mV]",
}


def test_rows(lines: Sequence[Json], key: str) -> list[tuple[str, ...]]:
    """A row for each test file: what is asked, what each model misses, what is published."""
    files = list(lines[0][key])
    return [
        (
            _TITLES[name],
            f"{_ASKED[name]:g}",
            *(f"**{line[key][name]:.3g}**" for line in lines),
            _PUBLISHED[name],
        )
        for name in files
    ]


def test_head(lines: Sequence[Json]) -> list[str]:
    """Of that table; models with the number of their parameters."""
    models = (f"{line['model']}; {line['n_parameters']} parameters" for line in lines)
    return ["rmse of a test file", "asked", *models, "published"]


def effect_rows(line: Json) -> list[tuple[str, ...]]:
    """What was added, what it is graded, and its name's probability."""
    return [(one["title"], GRADES[one["grade"]], probability(one["probability"])) for one in line["effects"]]


def frame_rows(lines: Sequence[Json]) -> list[tuple[str, ...]]:
    """Models of the frame, what they were fitted to, and what they miss of each run."""
    return [
        (
            line["model"],
            str(line["n_parameters"]),
            line["fitted_on"],
            *(f"{error:.1f} %" for error in line["missed_percent"].values()),
            f"{line['processor_seconds']:.0f}",
        )
        for line in lines
    ]


def seconds(lines: Sequence[Json]) -> str:
    """Processor time of all of them."""
    return f"{sum(line['processor_seconds'] for line in lines):.0f} s"


def write_page(boucwen: Json, silverbox: Json, frame: Json, path: Path) -> None:
    """Write the page from what the three benchmarks wrote."""
    sources = {"boucwen": boucwen, "silverbox": silverbox, "frame": frame}
    context = {
        **{name: source["lines"] for name, source in sources.items()},
        "commits": sorted({str(source["commit"]) for source in sources.values()}),
        "processors": sorted({line["processor"] for source in sources.values() for line in source["lines"]}),
        "others": lambda line: {
            name: share
            for name, share in line["probabilities"].items()
            if share >= _LEAST_SHOWN and name not in {one["name"] for one in line["effects"]}
        },
        "test_rows": test_rows,
        "test_head": test_head,
        "effect_rows": effect_rows,
        "frame_head": ["model", "parameters", "fitted on", *frame["lines"][0]["missed_percent"], "processor [s]"],
        "frame_rows": frame_rows,
        "seconds": seconds,
        "probability": probability,
    }
    markdown.write_page(path, "benchmarks", "public_benchmarks.md.j2", context)


def main() -> None:
    """Read what the benchmarks wrote, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("boucwen", "silverbox", "frame"):
        parser.add_argument(f"--{name}", type=Path, required=True, help=f"JSON of benchmarks.{name}")
    parser.add_argument("--page", type=Path, required=True)
    options = parser.parse_args()
    boucwen, silverbox, frame = (
        json.loads(path.read_text("utf-8")) for path in (options.boucwen, options.silverbox, options.frame)
    )
    write_page(boucwen, silverbox, frame, options.page)


if __name__ == "__main__":
    main()
