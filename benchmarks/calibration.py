"""Simulation-based calibration over a model file's own prior, and what is said of wrong models.

``python -m benchmarks.calibration --model models/sdof.py --condition regular "20 dB" --replicates 200 --json FILE``
``python -m benchmarks.calibration --model models/sdof.py --wrong --replicates 20 --snr 20 30 --json FILE``
``python -m benchmarks.calibration --model models/sdof.py --unnamed-force --replicates 40 --snr 30 --json FILE``

A simulator that shares no code with the package's engines draws a truth from the prior and records it; ``identify``
does the rest, blind. If the posterior is right the rank of the truth among its draws is uniform, for every parameter
and for the log likelihood [1]_. With ``--checkpoint FILE`` each finished replicate is a line of that file, and a run
that was cut off goes on, unless the code or the model file has changed.

.. [1] S. Talts et al., "Validating Bayesian Inference Algorithms with Simulation-Based Calibration", 2018,
   arXiv:1804.06788.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks.calibrating.outcome import Outcome, judged, not_identified
from benchmarks.calibrating.records import CONDITIONS, Replicate, replicate
from benchmarks.calibrating.summary import Calibration, Wrong, calibration, wrong
from benchmarks.calibrating.wrong import KINDS, force_replicate, wrong_replicate
from benchmarks.running import ROOT, Clock, code_version, filed_lines, package_version
from bwbn_bayes import Settings, el_centro, identify
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.summary import processor_name
from bwbn_bayes.structures.model_file import ModelFile, load_model_file

_DECIDING = (
    "calibration.py", "calibrating/frame.py", "calibrating/framing.py", "calibrating/outcome.py",
    "calibrating/records.py", "calibrating/wrong.py", "blind/path.py", "blind/simulator.py", "blind/storey.py",
)  # fmt: skip
"""Files of the benchmarks that decide what comes of a replicate."""


def run(made: Replicate, settings: Settings, *, unnamed_force: bool = False) -> Outcome:
    """Identify a replicate blind and compare with its truth; where that cannot be done it counts as not identified."""
    clock = Clock()
    try:
        result = identify(made.model, made.record, settings=settings, unnamed_force=unnamed_force)
    except UserError:
        return not_identified(clock.processor_seconds)
    return judged(result, made, settings.seed, clock.processor_seconds)


def origin(file: ModelFile, options: argparse.Namespace) -> str:
    """What must agree for a kept replicate to stand for a new one: code, model file and settings."""
    code = f"{package_version()}-{code_version(ROOT / 'benchmarks' / name for name in _DECIDING)}"
    content = hashlib.sha256(options.model.read_bytes()).hexdigest()[:12]
    return f"{code}, {file.name} {content}, {options.method}, {options.particles}, seed {options.seed}"


class Kept:
    """Finished replicates of one origin, one a line of a file; a line that a kill cut short is none."""

    def __init__(self, path: Path | None, origin: str) -> None:
        self._path = path
        self._origin = origin
        self._found: dict[str, Outcome] = {}
        for entry in filed_lines(path) if path is not None else ():
            # Files of earlier versions tell elapsed seconds alone.
            self._found[entry["key"]] = Outcome(**{"processor_s": math.nan, **entry["outcome"]})

    def outcome(self, key: str, run_it: Callable[[], Outcome]) -> Outcome:
        """The kept outcome, or that of running it, which is then kept."""
        key = f"{self._origin}, {key}"
        if key not in self._found:
            self._found[key] = run_it()
            if self._path is not None:
                with self._path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps({"key": key, "outcome": asdict(self._found[key])}, default=float) + "\n")
        return self._found[key]


def outcomes_of(label: str, make: Callable[[int], Replicate], options: argparse.Namespace, kept: Kept) -> list[Outcome]:
    """The outcomes of one row of the table."""
    found = []
    for number in range(options.replicates):

        def run_it(number: int = number) -> Outcome:
            seed = options.seed + number
            return run(make(number), Settings(method=options.method, particles=options.particles, seed=seed))

        found.append(kept.outcome(f"{label}, {number}", run_it))
    return found


def with_forces(file: ModelFile, snr_db: float, options: argparse.Namespace, kept: Kept) -> dict[str, list[Outcome]]:
    """Wrong models whose effect, storey and size are drawn, identified alone and with an unnamed force.

    Together, and by effect.
    """
    found: dict[str, list[Outcome]] = {}
    by_effect: dict[str, list[Outcome]] = {}
    for label, has_force in (("with an unnamed force", True), ("alone", False)):
        for number in range(options.first, options.replicates):

            def run_it(number: int = number, has_force: bool = has_force) -> Outcome:
                _, made = force_replicate(file, snr_db, options.seed, number)
                seed = options.seed + number
                # That the model is wrong is known here: nothing is asked what else it could be, and nothing falls back.
                settings = Settings(
                    method=options.method, particles=options.particles, seed=seed, alternatives=False, fallback=False
                )
                return run(made, settings, unnamed_force=has_force)

            outcome = kept.outcome(f"force, {snr_db:g} dB, {label}, {number}", run_it)
            found.setdefault(f"{label}, {snr_db:g} dB", []).append(outcome)
            effect = force_replicate(file, snr_db, options.seed, number)[0].partition(",")[0]
            by_effect.setdefault(f"{label}, {snr_db:g} dB: {effect}", []).append(outcome)
    return found | dict(sorted(by_effect.items()))


def show_calibration(console: Console, title: str, rows: dict[str, Calibration]) -> None:
    """Print a line for each condition."""
    table = Table("condition", "n", "coverage of 90 %", "rms z", "ranks: p", "ran", "said", "processor s", title=title)
    for name, row in rows.items():
        table.add_row(
            name,
            str(row.n_replicates),
            f"{row.coverage:.3f} ({row.coverage_low:.3f} to {row.coverage_high:.3f})",
            f"{row.rms_z:.2f}",
            f"{row.rank_p:.2g} ({row.rank_quantity})",
            _counts(row.methods),
            _counts(row.grades),
            f"{row.median_s:.1f}, worst {row.worst_s:.0f}",
        )
    console.print(table)


def show_parameters(console: Console, rows: dict[str, Calibration]) -> None:
    """Print how many intervals of each parameter hold their truth."""
    names = list(dict.fromkeys(name for row in rows.values() for name in row.held))
    table = Table("90 % intervals that hold the truth", "n", *names)
    for label, row in rows.items():
        table.add_row(label, str(row.n_replicates), *(str(row.held.get(name, 0)) for name in names))
    console.print(table)


def show_wrong(console: Console, title: str, rows: dict[str, Wrong]) -> None:
    """Print a line for each kind of wrong model."""
    table = Table("what is wrong", "n", "misleading", "refused", "doubtful", "largest z", title=title)
    for name, row in rows.items():
        figures = (row.n, row.n_misleading, row.misleading_refused, row.misleading_doubtful)
        table.add_row(name, *map(str, figures), f"{row.largest_z:.0f}")
    console.print(table)


def _counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{name} {n}" for name, n in counts.items())


def parsed(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """The options."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path, default=Path("models/sdof.py"))
    parser.add_argument("--condition", nargs="+", choices=tuple(CONDITIONS), default=["regular"])
    parser.add_argument("--wrong", action="store_true", help="wrong models in the place of conditions")
    parser.add_argument(
        "--unnamed-force", action="store_true", help="coverage under wrong models, alone and with an unnamed force"
    )
    parser.add_argument("--snr", nargs="+", type=float, default=[20.0, 30.0], help="of wrong models [dB]")
    parser.add_argument("--method", default="importance", choices=("importance", "tmcmc", "smc", "nuts"))
    parser.add_argument("--replicates", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="of --unnamed-force: cases before it are left out")
    parser.add_argument("--particles", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--checkpoint", type=Path, help="where finished replicates are kept")
    return parser.parse_args(arguments)


def rows_of(file: ModelFile, options: argparse.Namespace, console: Console, kept: Kept) -> dict[str, Any]:
    """Run what the options ask for, print its table, and return its rows."""
    title = f"{file.name}, {options.method}"
    rows: dict[str, Any] = {}
    if options.unnamed_force:
        every: dict[str, list[Outcome]] = {}
        for snr_db in options.snr:
            every |= with_forces(file, snr_db, options, kept)
        rows |= {name: calibration(own) for name, own in every.items()}
        show_calibration(console, title, rows)
        show_parameters(console, rows)
    elif options.wrong:
        for snr_db in options.snr:
            for kind in KINDS:
                label = f"{kind}, {snr_db:g} dB"

                def make(number: int, kind: str = kind, snr_db: float = snr_db) -> Replicate:
                    return wrong_replicate(file, kind, snr_db, options.seed, number)

                rows[label] = wrong(outcomes_of(label, make, options, kept))
        show_wrong(console, title, rows)
    else:
        for name in options.condition:

            def make_right(number: int, name: str = name) -> Replicate:
                return replicate(file, CONDITIONS[name], options.seed, number)

            rows[name] = calibration(outcomes_of(name, make_right, options, kept))
        show_calibration(console, title, rows)
        show_parameters(console, rows)
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the replicates, print a table, write JSON."""
    options = parsed(arguments)
    console = Console()
    try:
        file = load_model_file(options.model)
        if file.excitation is None:
            file = replace(file, excitation=el_centro("chopra", duration=12.0))
        rows = rows_of(file, options, console, Kept(options.checkpoint, origin(file, options)))
    except UserError as error:
        print(error, file=sys.stderr)
        sys.exit(2)
    if options.json is not None:
        summary = {name: asdict(row) for name, row in rows.items()}
        facts = {"model": file.name, "method": options.method, "seed": options.seed, "processor": processor_name()}
        options.json.write_text(json.dumps({**facts, "rows": summary}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
