"""Measured tests: ``discover`` beside laws that engineers fit to them, on the same split.

``python -m benchmarks.measured --json FILE [--only NAME ...] [--competitors] [--discover] [--whole] [--repeats]
[--gallery DIR] [--also FILE] [--keep FILE]``

The competitors are fitted in the same run: the 13-parameter BWBN with Foliente's pinch, OpenSees' Pinching4 (21
parameters), and a linear chain for the frames. ``--whole`` fits the whole records of the reinforced-concrete columns,
for which labels hold; ``--repeats`` fits the first cycle at each amplitude of the cyclic tests that repeat some,
predicts the others, and tells how many of their points lie inside their 90 % intervals. What is finished is kept in
``.jsonl`` files beside the JSON, competitors and discoveries apart, with the version of the code, and is not run again;
tables and figures come from what is filed. ``--keep`` files in one place what tables and figures come from, and
``--also`` goes on from there, on another machine or in another folder.
"""

from __future__ import annotations

import argparse
import json
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from benchmarks.measured_tests import bouc_wen_baber_noori, discovering, fitting, linear_chain, pinching4
from benchmarks.measured_tests.discovering import discover_first_cycles, discover_first_part, discover_whole
from benchmarks.measured_tests.filing import file_result, filed, identity, is_current, keep, shown_response
from benchmarks.measured_tests.gallery import draw_gallery
from benchmarks.measured_tests.page import write_page
from benchmarks.measured_tests.specimens import DATA, MeasuredTest, both_errors, load, names
from benchmarks.measured_tests.tables import (
    COMPETITORS,
    KNOWN,
    LabelRow,
    RepeatRow,
    Row,
    in_per_cent,
    in_words,
    label_row,
    label_sums,
    names_in_words,
    repeat_row,
    repeat_sums,
    row,
    sums,
    verdict_in_words,
)
from benchmarks.running import Clock, code_version, commit, package_version
from bwbn_bayes import UserError
from bwbn_bayes.inference.summary import processor_name
from bwbn_bayes.parameters import Floats
from bwbn_bayes.results import finite

Entries = dict[tuple[str, str], dict[str, Any]]
KINDS = (*COMPETITORS, "discover", "whole", "repeats")
APART = ("whole", "repeats")
"""Kinds of trials with tables of their own."""
_NONE = {"error": "not run"}


@dataclass(frozen=True, kw_only=True)
class Trial:
    """Something to run on one test: its kind, the version of its code, and the run itself.

    Attributes
    ----------
    what : str
        What it is filed under.
    code : str
        Version of the code that decides its result.
    seed : int
    log : Path
        Where it is filed.
    run : callable
        Of a test: the result, and the response ``(n_channels, n_times)`` of the whole record.
    """

    what: str
    code: str
    seed: int
    log: Path
    run: Callable[[MeasuredTest], tuple[dict[str, Any], Floats]]


def run_force_law(
    kind: type[bouc_wen_baber_noori.BoucWenBaberNoori | pinching4.Pinching4],
    budget: fitting.Budget,
    test: MeasuredTest,
) -> tuple[dict[str, Any], Floats]:
    """Fit a law of force against displacement to the first part of a cyclic test and judge it on all points."""
    displacement, force = test.pulled
    n = test.n_fitted
    law = kind(travel=float(np.max(np.abs(displacement[:n]))), peak=float(np.max(np.abs(force[:n]))))
    fitted = fitting.fit_force(law, displacement[:n], force[:n], budget)
    parameters = law.parameters(fitted.point)
    response = law.force(parameters, displacement)[None]
    return _result(test, law.symbols, parameters, fitted, budget, response)


def run_linear_chain(budget: fitting.Budget, test: MeasuredTest) -> tuple[dict[str, Any], Floats]:
    """Fit a linear chain to the first part of a frame's run and judge it on all points."""
    chain = linear_chain.LinearChain(n_storeys=len(test.record.channels))
    fitted = chain.fit(test.training, budget)
    parameters = chain.parameters(fitted.point)
    response = chain.displacements(parameters, test.record)
    return _result(test, chain.symbols, parameters, fitted, budget, response)


def _result(
    test: MeasuredTest,
    symbols: Sequence[str],
    parameters: Floats,
    fitted: fitting.Fitted,
    budget: fitting.Budget,
    response: Floats,
) -> tuple[dict[str, Any], Floats]:
    facts = {
        "errors": both_errors(test, response),
        "parameters": dict(zip(symbols, parameters.tolist(), strict=True)),
        "n_runs": fitted.n_runs,
        "budget": asdict(budget),
    }
    return facts, response


def trials(json_path: Path, seed: int) -> dict[str, Trial]:
    """Everything that can be run, by kind."""

    def trial(what: str, code: str, log: str, run: Callable[[MeasuredTest], tuple[dict[str, Any], Floats]]) -> Trial:
        return Trial(what=what, code=code, seed=seed, log=json_path.with_suffix(f".{log}.jsonl"), run=run)

    def law(what: str, module: Any, run: Callable[..., tuple[dict[str, Any], Floats]], *kind: Any) -> Trial:
        code = code_version(Path(str(one.__file__)) for one in (fitting, module))
        budget = fitting.Budget(**{**asdict(module.BUDGET), "seed": seed})
        return trial(what, code, "competitors", lambda test: run(*kind, budget, test))

    def discovery(what: str, run: Callable[[MeasuredTest, int], tuple[dict[str, Any], Floats]]) -> Trial:
        code = f"{package_version()}-{code_version([Path(discovering.__file__)])}"

        def facts_and_response(test: MeasuredTest) -> tuple[dict[str, Any], Floats]:
            facts, response = run(test, seed)
            return {"facts": facts}, response

        return trial(what, code, "discover", facts_and_response)

    return {
        "bwbn": law("bwbn", bouc_wen_baber_noori, run_force_law, bouc_wen_baber_noori.BoucWenBaberNoori),
        "pinching4": law("pinching4", pinching4, run_force_law, pinching4.Pinching4),
        "linear_chain": law("linear_chain", linear_chain, run_linear_chain),
        "discover": discovery("discover", discover_first_part),
        "whole": discovery("whole", discover_whole),
        "repeats": discovery("repeats", discover_first_cycles),
    }


def concerns(what: str, test: MeasuredTest) -> bool:
    """Whether a kind of trial is for this test."""
    if what == "linear_chain":
        return test.is_frame
    if what in ("bwbn", "pinching4"):
        return not test.is_frame
    if what == "repeats":
        return test.repeats is not None
    return what != "whole" or test.label is not None


def run_trials(
    wanted: Sequence[Trial], tests: Sequence[MeasuredTest], console: Console, also: Path | None = None
) -> None:
    """Run what is not filed yet, and file each result as it ends."""
    elsewhere = filed(also) if also else {}
    done = {trial.log: {**elsewhere, **filed(trial.log)} for trial in wanted}
    for test in tests:
        for trial in (one for one in wanted if concerns(one.what, test)):
            key = identity(test, trial.what, trial.code, trial.seed)
            if is_current(done[trial.log].get((test.name, trial.what)), key):
                continue
            entry = _filed_run(trial, test, key)
            file_result(trial.log, entry)
            console.print(_line(test, trial.what, entry), highlight=False, markup=False, soft_wrap=True)


def _filed_run(trial: Trial, test: MeasuredTest, key: dict[str, Any]) -> dict[str, Any]:
    entry: dict[str, Any] = {"identity": key, "commit": commit()}
    clock = Clock()
    try:
        result, response = trial.run(test)
        entry |= {"result": result, "shown": shown_response(test, response)}
    except Exception as error:  # a crash is a miss, to be counted and seen
        entry |= {"error": f"{type(error).__name__}: {error}", "traceback": traceback.format_exc()}
    return {**entry, **clock.as_json()}


def _line(test: MeasuredTest, what: str, entry: Mapping[str, Any]) -> str:
    if "error" in entry:
        return f"{test.name}, {what}: {entry['error']}"
    errors = entry["result"].get("errors") or entry["result"]["facts"]["errors"]
    told = " / ".join("none" if error is None else f"{error:.1f}" for error in errors)
    return f"{test.name}, {what}: {told} %, {entry['seconds']:.1f} s"


def print_rows(console: Console, rows: Sequence[Row]) -> None:
    """Print one line per test, errors fitted / held out in per cent."""
    table = Table(title="NRMSE in %, fitted / held out", title_justify="left", box=None, pad_edge=False)
    for name in ("test", "points", "fitted", *COMPETITORS, "discover", ""):
        table.add_column(name, justify="left" if name in ("test", "") else "right", no_wrap=name != "")
    for one in rows:
        share = f"{100.0 * one.n_fitted / one.n_points:.0f} %{'' if one.rule == 'parting_time' else ' *'}"
        errors = [in_per_cent(one.competitors.get(what)) for what in COMPETITORS]
        words = "; ".join(part for part in (in_words(one.answer), *one.failed) if part)
        table.add_row(one.name, str(one.n_points), share, *errors, in_per_cent(one.ours), Text(words))
    console.print(table)
    console.print("* the last 30 % of the path are held out: no end moves as strongly as the whole", markup=False)
    for total in sums(rows):
        console.print(f"{total['what']}: {total['count']} of {total['total']}", highlight=False, markup=False)
    for one in (one for one in rows if one.name == "chiu_bracing"):
        for what in (what for what in KNOWN if what in one.competitors):
            here, there = in_per_cent(one.competitors[what]), in_per_cent(KNOWN[what])
            console.print(f"chiu, {what}: {here}; PROVENANCE.md: {there}", highlight=False, markup=False)


def print_labels(console: Console, rows: Sequence[LabelRow], totals: Sequence[Mapping[str, Any]]) -> None:
    """Print what discovery says of the columns' whole records."""
    table = Table(title="whole records", title_justify="left", box=None, pad_edge=False)
    for name in ("column", "loops", "said", "index measured", "identified", "strength lost measured", "identified",
                 "fit %"):  # fmt: skip
        table.add_column(name, justify="left" if name in ("column", "loops", "said") else "right")
    for one in rows:
        numbers = [f"{value:.3f}" for value in (*one.index, *one.strength_lost)]
        table.add_row(one.name, one.loops, "pinched" if one.says_pinched else "", *numbers, f"{one.fit:.1f}")
    console.print(table)
    for total in totals:
        console.print(f"{total['what']}: {total['count']} of {total['total']}", highlight=False, markup=False)


def print_repeats(console: Console, rows: Sequence[RepeatRow], totals: Sequence[Mapping[str, Any]]) -> None:
    """Print errors on the repeat cycles and how many points their intervals hold."""
    table = Table(title="repeat cycles held out", title_justify="left", box=None, pad_edge=False)
    for name in ("test", "points", "held out", "as given %", "fitted / held out %", "inside 90 % interval", ""):
        table.add_column(name, justify="left" if name in ("test", "") else "right", no_wrap=name != "")
    for one in rows:
        given, errors = in_per_cent((one.given,)), in_per_cent(one.errors)
        counts = str(one.n_points), str(one.n_held_out)
        table.add_row(one.name, *counts, given, errors, f"{100.0 * one.coverage:.0f} %", Text(in_words(one.answer)))
    console.print(table)
    for total in totals:
        console.print(f"{total['what']}: {total['count']} of {total['total']} specimens", highlight=False, markup=False)


def gather(
    tests: Sequence[MeasuredTest], entries: Entries
) -> tuple[list[Row], list[LabelRow], list[RepeatRow], dict[str, Any]]:
    """Rows of all tables, and the JSON."""
    by_test = {test.name: {what: e for (name, what), e in entries.items() if name == test.name} for test in tests}
    rows = [row(test, {w: e for w, e in by_test[test.name].items() if w not in APART}) for test in tests]
    good = {
        what: [(test, by_test[test.name][what]) for test in tests if "error" not in by_test[test.name].get(what, _NONE)]
        for what in APART
    }
    labels = [label_row(test, entry) for test, entry in good["whole"]]
    repeated = [repeat_row(test, entry) for test, entry in good["repeats"]]
    failed = {what: [test for test in tests if "error" in by_test[test.name].get(what, {})] for what in APART}
    failed_loops = [test.label.loops for test in failed["whole"] if test.label is not None]
    facts = {
        "processor": processor_name(),
        "versions": versions(entries),
        "not_run": not_run(tests, by_test),
        "failed": failures(tests, by_test),
        "sums": sums(rows),
        "rows": [
            {
                **asdict(one),
                "verdict": verdict_in_words(one.answer),
                "names": names_in_words(one.answer),
                "fits": one.fits,
                "predicts": one.predicts,
                "is_run": one.is_run,
            }
            for one in rows
        ],
        "label_sums": label_sums(labels, failed_loops) if labels or failed_loops else [],
        "labels": [{**asdict(one), "names": names_in_words(one.answer)} for one in labels],
        "repeat_sums": repeat_sums(repeated, len(failed["repeats"])) if repeated or failed["repeats"] else [],
        "repeats": [
            {**asdict(one), "is_covered": one.is_covered, "names": names_in_words(one.answer)} for one in repeated
        ],
        "results": {
            test.name: {what: {k: v for k, v in e.items() if k != "shown"} for what, e in by_test[test.name].items()}
            for test in tests
        },
    }
    return rows, labels, repeated, finite(facts)


def versions(entries: Entries) -> list[dict[str, Any]]:
    """Versions of the code by kind of trial, with the commits at which each was run and on what."""
    found: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for (_, what), entry in entries.items():
        found.setdefault((what, entry["identity"]["code"]), []).append(entry)
    return [
        {
            "what": what,
            "code": code,
            "commits": sorted({entry.get("commit", "") for entry in own} - {""}),
            "processors": sorted({entry.get("processor", "") for entry in own} - {""}),
            "tests": [entry["identity"]["name"] for entry in own],
        }
        for (what, code), own in sorted(found.items())
    ]


def failures(tests: Sequence[MeasuredTest], by_test: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """What ended in an error, of every kind of trial, with the error."""
    return [
        f"{test.name}, {what}: {entry['error']}"
        for test in tests
        for what, entry in by_test[test.name].items()
        if "error" in entry
    ]


def not_run(tests: Sequence[MeasuredTest], by_test: Mapping[str, Mapping[str, Any]]) -> dict[str, list[str]]:
    """Tests that each kind of trial is for and of which nothing is filed."""
    return {
        what: [test.name for test in tests if concerns(what, test) and what not in by_test[test.name]] for what in KINDS
    }


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, required=True, help="results; what is finished is filed beside it")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="these measured tests; all by default")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the measured tests")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--competitors", action="store_true", help="fit the competitors")
    parser.add_argument("--discover", action="store_true", help="discover on the fitted part of each test")
    parser.add_argument("--whole", action="store_true", help="discover on the whole records of the columns")
    parser.add_argument("--repeats", action="store_true", help="discover with the repeat cycles held out")
    parser.add_argument("--gallery", type=Path, metavar="DIR", help="draw the loops into this folder")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the page, with figures where drawn")
    parser.add_argument("--also", type=Path, metavar="FILE", help="what an earlier run kept; its results count, too")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="file what tables and figures come from")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is asked for, print the tables, write JSON, figures and the page.

    Parameters
    ----------
    arguments : sequence of str, optional
        Those of the process by default.

    Returns
    -------
    int
        0, or 2 where the user can mend it.
    """
    options = _parser().parse_args(arguments)
    console = Console(width=None if Console().is_terminal else 200)
    try:
        tests = [load(name, options.data) for name in options.only or names(options.data)]
    except UserError as error:
        print(error, file=sys.stderr)
        return 2
    known = trials(options.json, options.seed)
    asked = {
        **dict.fromkeys(COMPETITORS, options.competitors), "discover": options.discover, "whole": options.whole,
        "repeats": options.repeats,
    }  # fmt: skip
    run_trials([known[what] for what, wanted in asked.items() if wanted], tests, console, options.also)
    logs = dict.fromkeys([*([options.also] if options.also else []), *(one.log for one in known.values())])
    entries = {key: entry for log in logs for key, entry in filed(log).items()}
    if options.keep:
        keep(options.keep, entries)
    rows, labels, repeated, facts = gather(tests, entries)
    print_rows(console, rows)
    if facts["label_sums"]:
        print_labels(console, labels, facts["label_sums"])
    if facts["repeat_sums"]:
        print_repeats(console, repeated, facts["repeat_sums"])
    for one in facts["failed"]:
        console.print(f"failed: {one}", highlight=False, markup=False)
    for what, n_versions in Counter(one["what"] for one in facts["versions"]).items():
        if n_versions > 1:
            console.print(f"{what}: filed by {n_versions} versions of the code; run it again to have one")
    options.json.parent.mkdir(parents=True, exist_ok=True)
    options.json.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    figures = draw_gallery(tests, entries, options.gallery) if options.gallery else {}
    if options.page:
        write_page(facts, figures, options.page)
    return 0


if __name__ == "__main__":
    sys.exit(main())
