"""Blind trials of discovery: what share of hidden effects is named rightly, and what is named where nothing is hidden.

``python -m benchmarks.discovery --cases 40 --snr 30 --seed 7 --json trial.json --kind all --workers 2``

An independent simulator draws structure, effect, place, size, ground motion and noise and writes the records; discovery
reads those files, with the plain model (a linear one where hysteresis is hidden; of a cyclic test, the model to start
from), and nothing else. Finished cases are kept in a ``.jsonl`` file beside the JSON and are not run again; records and
truths lie in a folder beside it. Cases are a function of seed, kind and index.

``--kind all --cases 4`` is a small balanced trial: four cases of every kind, taken in turns. ``--also`` pools the cases
of other trials with these; with ``--cases 0`` nothing is run. ``--keep`` files what of all pooled cases decides how
they came out, so that a count goes on from there. ``--page`` writes a page of all pooled cases, with the figures that
``--gallery`` draws:

``python -m benchmarks.discovery --cases 0 --also a.jsonl b.jsonl --json pooled.json --page docs/blind_trials.md
--gallery docs/blind_trials``
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks.blind.cases import KINDS, STARTING_MODEL, Kind, make_case
from benchmarks.blind.columns import column_summary
from benchmarks.blind.filed import FiledCase, finished_entries, keep, other_cases
from benchmarks.blind.page import KIND_TITLES, write_page
from benchmarks.blind.picture import draw_confusion, draw_reliability
from benchmarks.blind.pooled import by_kind, misses, versions
from benchmarks.blind.reliability import reliability
from benchmarks.blind.scoring import case_outcome
from benchmarks.blind.show import show_rows
from benchmarks.running import Clock, commit, package_version
from bwbn_bayes.discovery.run import DiscoverySettings
from bwbn_bayes.discovery.workflow import discover
from bwbn_bayes.inference.summary import processor_name
from bwbn_bayes.records import Record, read_csv, write_csv
from bwbn_bayes.structures.model_file import load_model_file
from bwbn_bayes.structures.starting_model import starting_model

MODELS = Path(__file__).parents[1] / "models"

Json = Mapping[str, Any]
Discoverer = Callable[[str, Record, Record, int, int], Json]
"""Model given (:attr:`~benchmarks.blind.cases.Case.given`), training and held-out record, seed and threads to
``discovery.json``."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """One case to run.

    Attributes
    ----------
    kind, seed, index, snr_db
        See :func:`benchmarks.blind.cases.make_case`.
    folder : Path
        Where records and truths go.
    n_threads : int
        Threads of this case's discovery.
    """

    kind: Kind
    seed: int
    index: int
    snr_db: float
    folder: Path
    n_threads: int

    @property
    def key(self) -> str:
        """What the case is filed under."""
        return f"{self.kind}/{self.snr_db:g} dB/seed {self.seed}/{self.index}"


def discover_blind(given: str, record: Record, held_out: Record, seed: int, n_threads: int) -> Json:
    """Run discovery on a record from the model given, knowing nothing else."""
    settings = DiscoverySettings(seed=seed, n_workers=n_threads)
    model = starting_model(record) if given == STARTING_MODEL else load_model_file(MODELS / f"{given}.py").model
    return discover(model, record, held_out=held_out, settings=settings, name=given).as_json()


def run_job(job: Job, discoverer: Discoverer = discover_blind) -> dict[str, Any]:
    """Draw a case, write its records, discover, and keep both truth and answer.

    Parameters
    ----------
    job : Job
        The case.
    discoverer : callable
        What is on trial; it is given what the written files say.

    Returns
    -------
    dict
        ``key``, ``truth``, ``discovery``, processor and seconds; where discovery raised, ``discovery`` holds the error.
    """
    case = make_case(job.kind, job.seed, job.index, job.snr_db)
    stem = f"{job.kind}-{job.snr_db:g}dB-seed{job.seed}-{job.index:04d}"
    records, truths = job.folder / "records", job.folder / "truth"
    for folder in (records, truths):
        folder.mkdir(parents=True, exist_ok=True)
    write_csv(case.record, records / f"{stem}.csv")
    write_csv(case.held_out, records / f"{stem}-held-out.csv")
    truth = {**case.truth.as_json(), "name": stem}
    (truths / f"{stem}.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    train, held_out = read_csv(records / f"{stem}.csv"), read_csv(records / f"{stem}-held-out.csv")
    clock = Clock()
    try:
        answer: Json = discoverer(case.given, train, held_out, job.seed + job.index, job.n_threads)
    except Exception as error:  # a crash is a miss, to be counted and seen
        answer = {"error": f"{type(error).__name__}: {error}", "traceback": traceback.format_exc()}
    return {"key": job.key, "truth": json.loads(json.dumps(truth)), "discovery": dict(answer), **clock.as_json()}


def run_trial(
    jobs: Sequence[Job], log: Path, *, workers: int, console: Console, discoverer: Discoverer = discover_blind
) -> list[FiledCase]:
    """Run what is not yet finished, file each case as it ends with the version of the code, and score all.

    Parameters
    ----------
    jobs : sequence of Job
        The trial.
    log : Path
        The ``.jsonl`` file of finished cases.
    workers : int
        Processes; with one, everything runs in this process.
    console : Console
        Told of each case.
    discoverer : callable
        What is on trial.

    Returns
    -------
    list of FiledCase
        In the order of the jobs.
    """
    entries = finished_entries(log)
    waiting = [job for job in jobs if job.key not in entries]
    if waiting:
        log.parent.mkdir(parents=True, exist_ok=True)
        version = {"commit": commit(), "code": package_version()}
        started = not log.exists() or log.read_bytes().endswith(b"\n")
        with log.open("a", encoding="utf-8") as file:
            file.write("" if started else "\n")
            for number, case in enumerate(_entries(waiting, workers, discoverer), start=1):
                entry = {**case, **version}
                file.write(json.dumps(entry) + "\n")
                file.flush()
                entries[entry["key"]] = entry
                console.print(_line(number, len(waiting), entry), highlight=False, markup=False, soft_wrap=True)
    return [FiledCase.of(entries[job.key]) for job in jobs]


def _entries(jobs: Sequence[Job], workers: int, discoverer: Discoverer) -> Iterator[dict[str, Any]]:
    if workers == 1:
        yield from (run_job(job, discoverer) for job in jobs)
        return
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        for future in as_completed([pool.submit(run_job, job, discoverer) for job in jobs]):
            yield future.result()


def _line(number: int, total: int, entry: Json) -> str:
    outcome = case_outcome(entry["truth"], entry["discovery"])
    said = ", ".join(outcome.named) or outcome.verdict
    seconds = "" if outcome.elapsed_s is None else f", {outcome.elapsed_s:.1f} s"
    hidden = ", ".join(outcome.hidden) or "nothing"
    faint = "" if outcome.detectable else ", undetectable"
    return f"{number}/{total} {outcome.name}: hidden {hidden}{faint}; said {said}{seconds} {outcome.error}".rstrip()


def print_proportions(console: Console, rows: Sequence[Json], title: str) -> None:
    """Print counts, shares and intervals, beside what is asked where something is."""
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    table.add_column("")
    for name in ("cases", "of", "share", "95 %", "asked"):
        table.add_column(name, justify="right")
    for row in rows:
        low, high = row["interval95"]
        share = "" if row["share"] is None else f"{100 * row['share']:.1f} %"
        interval = f"{100 * low:.1f} to {100 * high:.1f}"
        table.add_row(row["what"], str(row["count"]), str(row["total"]), share, interval, row.get("asked", ""))
    console.print(table)


def print_column(console: Console, kind: str, summary: Json, title: str) -> None:
    """Print one column of the trial: proportions with their intervals, figures, misses, undetectable cases."""
    print_proportions(console, summary["proportions"], f"{kind}, {title}")
    for verdict, probability in summary["mean_verdict_probabilities"].items():
        console.print(f"mean probability of {verdict}: {probability:.3f}", highlight=False)
    for name in (
        "mean_class_size",
        "held_out_over_floor_before",
        "held_out_over_floor_after",
        "seconds_median",
        "seconds_max",
    ):
        if summary[name] is not None:
            console.print(f"{name.replace('_', ' ')}: {summary[name]:.3g}", highlight=False)
    for name in ("misses", "undetectable", "failed"):
        for line in summary[name]:
            console.print(f"{name}: {line}", highlight=False, markup=False, soft_wrap=True)
    console.print()


def print_reliability(console: Console, summary: Json) -> None:
    """Print the bins of the reliability diagram and the expected calibration error."""
    table = Table(title="reliability of the names' probabilities", title_justify="left", box=None, pad_edge=False)
    for name in ("from", "to", "statements", "mean probability", "share hidden", "se"):
        table.add_column(name, justify="right")
    for b in summary["bins"]:
        found = [b["mean_probability"], b["share"], b["share_se"]]
        shown = ["" if value is None else f"{value:.3f}" for value in found]
        table.add_row(f"{b['from']:.1f}", f"{b['to']:.1f}", str(b["statements"]), *shown)
    console.print(table)
    for key, what in (
        ("expected_calibration_error", "of statements of 0.1 and more"),
        ("expected_calibration_error_of_all", "of all statements"),
    ):
        error = summary[key]
        if error["value"] is not None:
            value = f"expected calibration error {what}: {error['value']:.3f} +- {error['se']:.3f}"
            basis = f"{error['statements']} statements, {summary['cases']} cases"
            console.print(f"{value} ({basis}; {error['if_calibrated']:.3f} if calibrated)", highlight=False)
    console.print()


def balanced_jobs(options: argparse.Namespace, kinds: Sequence[Kind]) -> list[Job]:
    """So many cases of every kind, in turns: a trial that is cut short is balanced too."""
    return [
        Job(
            kind=kind,
            seed=options.seed,
            index=index,
            snr_db=options.snr,
            folder=options.json.with_suffix(""),
            n_threads=1 if options.workers > 1 else 2,
        )
        for index in range(options.cases)
        for kind in kinds
    ]


def pooled_summary(cases: Sequence[FiledCase]) -> dict[str, Any]:
    """The rows asked, versions, figures by kind, misses and the reliability of probabilities over all cases."""
    outcomes = [case.outcome for case in cases]
    return {
        "cases": len(cases),
        "versions": versions(cases),
        "rows": show_rows(outcomes),
        "by_kind": by_kind(cases, tuple(KIND_TITLES)),
        "misses": misses(cases, tuple(KIND_TITLES)),
        "reliability": reliability([outcome.claims for outcome in outcomes if outcome.claims is not None]),
    }


def print_pooled(console: Console, pooled: Json) -> None:
    """Print the rows asked and the reliability of probabilities."""
    print_proportions(console, pooled["rows"], f"rows asked, {pooled['cases']} cases")
    if pooled["reliability"]["cases"]:
        console.print()
        print_reliability(console, pooled["reliability"])


def draw_gallery(pooled: Json, folder: Path) -> dict[str, Path]:
    """Draw a confusion matrix of each kind that hides several effects and the reliability diagram, and return where."""
    folder.mkdir(parents=True, exist_ok=True)
    drawn = {}
    for one in pooled["by_kind"]:
        if len({cell["hidden"] for cell in one["confusion"]}) > 1:
            drawn[one["kind"]] = folder / f"confusion-{one['kind']}.png"
            title = f"{KIND_TITLES[one['kind']]}, {one['right']['total']} detectable cases"
            draw_confusion(one["confusion"], drawn[one["kind"]], title)
    if _draw_reliability(pooled["reliability"], folder / "reliability.png"):
        drawn["reliability"] = folder / "reliability.png"
    return drawn


def _draw_reliability(kept: Json, picture: Path) -> bool:
    """Draw the diagram where a case states probabilities."""
    if kept["cases"]:
        draw_reliability(kept, picture, f"names' probabilities, {kept['cases']} cases")
    return bool(kept["cases"])


def read_options(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Options of a trial."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=21, help="cases of each kind")
    parser.add_argument("--snr", type=float, default=30.0, help="signal-to-noise ratio in dB of mean square")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, required=True)
    parser.add_argument("--kind", choices=(*KINDS, "all"), default="catalogue")
    parser.add_argument("--workers", type=int, choices=(1, 2), default=1, help="processes, one case each at a time")
    parser.add_argument("--also", type=Path, nargs="+", default=(), help=".jsonl files of other trials, to be pooled")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="file what decides how all pooled cases came out")
    parser.add_argument("--gallery", type=Path, metavar="DIR", help="draw the figures of all pooled cases there")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the page, with figures where drawn")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a trial, print its tables, write JSON, one confusion matrix per column and the reliability diagram.

    Parameters
    ----------
    arguments : sequence of str, optional
        Those of the process by default.
    """
    options = read_options(arguments)
    options.json.parent.mkdir(parents=True, exist_ok=True)
    kinds: tuple[Kind, ...] = KINDS if options.kind == "all" else (options.kind,)
    folder = options.json.with_suffix("")
    jobs = balanced_jobs(options, kinds)
    console = Console(width=None if Console().is_terminal else 160)
    log = options.json.with_suffix(".jsonl")
    cases = run_trial(jobs, log, workers=options.workers, console=console)
    outcomes = [case.outcome for case in cases]
    title = f"{options.snr:g} dB, seed {options.seed}"
    columns = {}
    for kind in kinds if options.cases else ():
        columns[kind] = column_summary(kind, [outcome for outcome in outcomes if outcome.kind == kind])
        print_column(console, kind, columns[kind], title)
        picture = folder.with_name(f"{folder.name}-{kind}.png")
        draw_confusion(columns[kind]["confusion"], picture, f"{kind}, {title}, detectable cases")
    every = [*cases, *other_cases(options.also, {job.key for job in jobs})]
    if options.keep:
        keep(every, options.keep)
    pooled = pooled_summary(every)
    print_pooled(console, pooled)
    _draw_reliability(pooled["reliability"], folder.with_name(f"{folder.name}-reliability.png"))
    facts = {
        "snr_db": options.snr,
        "seed": options.seed,
        "cases_per_column": options.cases,
        "workers": options.workers,
        "processor": processor_name(),
        "columns": columns,
        "logs": [str(one) for one in (*([log] if options.cases else []), *options.also)],
        "pooled": pooled,
        "cases": [{**vars(outcome), "floor_ratio": outcome.floor_ratio} for outcome in outcomes],
    }
    options.json.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    figures = draw_gallery(pooled, options.gallery) if options.gallery else {}
    if options.page:
        write_page(facts, figures, options.page)


if __name__ == "__main__":
    main()
