"""Fleet mode: many records, each identified or searched in a process of its own, in one table and one page.

A record's files stand in a directory of its own, as the single command writes them, beside a note of what they were
made from: records whose note still holds are not run again, and an identification that was cut off goes on.
"""

from __future__ import annotations

import csv
import hashlib
import json
import multiprocessing
import os
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Any
from urllib.parse import quote

from bwbn_bayes.cli.interruption import UNFINISHED_SEARCH
from bwbn_bayes.engines.children import end_with_parent
from bwbn_bayes.engines.journal import forget, has_begun
from bwbn_bayes.errors import UserError, replace_file, writing
from bwbn_bayes.records.readers import RECORD_SUFFIXES
from bwbn_bayes.records.record import one_line
from bwbn_bayes.report.batch_html import BatchRow, batch_page
from bwbn_bayes.versions import version_of

_NOTE, _SAID, _BEGUN = "batch.json", "said.txt", "begun.txt"
_STARTING = threading.Lock()
"""Processes are started one at a time: the list of this process' children is not made for more."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """One record to run.

    Attributes
    ----------
    name : str
        Its name in the table, and of its directory.
    record : Path
    directory : Path
        Where its files go.
    arguments : tuple of str
        The single command.
    finished_file : str
        What the command writes when it is done.
    key : str
        Hash of version, options, record and model file: what it depends on, but for what that file itself reads.
    """

    name: str
    record: Path
    directory: Path
    arguments: tuple[str, ...]
    finished_file: str
    key: str

    @property
    def checkpoint(self) -> Path:
        """Where an identification keeps what it has solved, until it is done."""
        return self.directory / "meanwhile"

    @property
    def row(self) -> BatchRow | None:
        """What its files say, of this record, model and options; None where they are not there, or damaged."""
        try:
            note = json.loads((self.directory / _NOTE).read_text(encoding="utf-8"))
            if note != {"key": self.key}:
                return None
            facts = json.loads((self.directory / self.finished_file).read_text(encoding="utf-8"))
            return _discovered(self, facts) if self.finished_file == "discovery.json" else _identified(self, facts)
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None


def records_of(pattern: str, out: Path) -> tuple[Path, ...]:
    """The records in a directory, or those that a pattern such as ``data/2011*/*.csv`` names, in order.

    What a batch with the same ``out`` has written is none of them.

    Raises
    ------
    UserError
        If there is none.
    """
    place = Path(pattern)
    if place.is_dir():
        found: Iterator[Path] | list[Path] = place.iterdir()
    elif place.is_absolute():
        found = Path(place.anchor).glob(str(place.relative_to(place.anchor)))
    else:
        found = Path().glob(pattern)
    try:
        files = sorted(path for path in found if path.suffix.lower() in RECORD_SUFFIXES and path.is_file())
    except ValueError as error:  # of Python 3.12, where ** is a part of a name
        raise UserError(f"{pattern}: {error}: write ** between slashes") from None
    records = tuple(path for path in files if not _is_result(path, out))
    if not records:
        raise UserError(
            f"{pattern}: no record (.csv, .nc, .mat ...) is there: give a directory, or a pattern in quotes"
        )
    return records


def _is_result(path: Path, out: Path) -> bool:
    """Whether a batch wrote a file: its table, or what lies in the directory of a record."""
    return path.absolute() == (out / "batch.csv").absolute() or any(
        (parent / _BEGUN).exists() for parent in path.parents
    )


def jobs_of(
    records: Sequence[Path], out: Path, *, model: Path | None, discover: bool, options: Sequence[str]
) -> list[Job]:
    """One job for each record; without a model, of the record's own starting model."""
    stems = Counter(path.stem for path in records)
    names = [p.stem if stems[p.stem] == 1 else f"{p.parent.name}_{p.stem}{p.suffix}" for p in records]
    alike = next((name for name, n in Counter(names).items() if n > 1), None)
    if alike is not None:
        both = " and ".join(str(p) for p, name in zip(records, names, strict=True) if name == alike)
        raise UserError(f"{both} have the same name and directory name: rename one, their results would mix")
    source = b"" if model is None else model.read_bytes()
    command = "discover" if discover else "identify"
    jobs = []
    for name, record in zip(names, records, strict=True):
        directory = out / name
        taken = (str(model), "--record", str(record)) if model is not None else (str(record),)
        words = (version_of(), command, *options)
        digest = hashlib.sha256("\n".join(words).encode() + b"\n" + source + b"\n" + _content(record))
        goes_on = (
            has_begun(directory / UNFINISHED_SEARCH) and _content(directory / _BEGUN) == digest.hexdigest().encode()
        )
        unfinished = ("--resume",) if goes_on else ()
        resumed = unfinished if discover else ("--checkpoint", str(directory / "meanwhile"))
        jobs.append(
            Job(
                name=name,
                record=record,
                directory=directory,
                arguments=(command, *taken, "--out", str(directory), *resumed, *options),
                finished_file="discovery.json" if discover else "result.json",
                key=digest.hexdigest(),
            )
        )
    return jobs


def _content(path: Path) -> bytes:
    """Of a file; nothing of one that cannot be read: the run of a record says why, and the others go on."""
    try:
        return path.read_bytes()
    except OSError:
        return b""


def run_batch(jobs: Sequence[Job], out: Path, n_at_once: int, say: Callable[[str], None]) -> tuple[BatchRow, ...]:
    """Run what is not finished, a few records at once, and write ``batch.csv``, ``batch.json`` and ``batch.html``.

    Tables and page are written anew after each record, so that they show at any time what is done.
    """
    waiting = [job for job in jobs if job.row is None]
    say(f"{len(jobs)} records, {len(jobs) - len(waiting)} of them done before")
    refused: dict[str, str] = {}
    rows = _written(jobs, refused, out)
    with ThreadPoolExecutor(n_at_once) as pool:
        running = {pool.submit(_run, job): job for job in waiting}
        try:
            for number, done in enumerate(as_completed(running), start=1):
                job, fault = running[done], done.result()
                if fault:
                    refused[job.name] = fault
                say(f"{number} of {len(waiting)}: {job.name}: {fault or 'done'}")
                rows = _written(jobs, refused, out)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)  # what waits is not run before the fault is told
            raise
    return rows


def _run(job: Job) -> str:
    """Run a job; the sentence by which it was refused, if it was."""
    try:
        return _ran(job)
    except UserError as error:
        return str(error)


def _ran(job: Job) -> str:
    """Run a job in a process of its own; the sentence by which that was refused, if it was."""
    writes = partial(writing, f"--out {job.directory}", "make room there, or choose another directory")
    with writes():
        job.directory.mkdir(parents=True, exist_ok=True)
        (job.directory / _BEGUN).write_text(job.key, encoding="utf-8")
    said = job.directory / _SAID
    process = multiprocessing.get_context("spawn").Process(target=_in_process, args=(job.arguments, str(said)))
    try:
        with _STARTING:
            process.start()
    except OSError as error:
        raise UserError(f"no process could be started ({error.strerror or error}): take fewer --workers") from error
    process.join()
    if process.exitcode == 0 and (job.directory / job.finished_file).exists():
        with writes():
            (job.directory / _NOTE).write_text(json.dumps({"key": job.key}) + "\n", encoding="utf-8")
            forget(job.checkpoint)
            said.unlink(missing_ok=True)
        return ""
    lines = said.read_text(encoding="utf-8", errors="replace").splitlines() if said.exists() else []
    last = lines[-1].removeprefix("error: ") if lines else "it said nothing"
    return last if process.exitcode == 2 else f"ended with exit code {process.exitcode} ({last}); see {said}"


def _in_process(arguments: tuple[str, ...], said: str) -> None:
    """The single command, in a process of its own; what it says goes to a file."""
    end_with_parent()
    with Path(said).open("wb") as file:
        for stream in (1, 2):
            os.dup2(file.fileno(), stream)
    from bwbn_bayes.cli import main

    main(arguments)


def _written(jobs: Sequence[Job], refused: dict[str, str], out: Path) -> tuple[BatchRow, ...]:
    """Rows of all jobs, also in the three files."""
    rows = tuple(_row(job, refused) for job in jobs)
    texts = {
        "batch.json": json.dumps([row.as_json() for row in rows], indent=1) + "\n",
        "batch.csv": _csv(rows),
        "batch.html": batch_page(rows),
    }
    with writing(f"--out {out}", "finished records are kept; make room there"):
        out.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            replace_file(out / name, text.encode())
    return rows


def _row(job: Job, refused: dict[str, str]) -> BatchRow:
    fault = refused.get(job.name, "")
    return job.row or BatchRow(
        record=one_line(job.name), status="refused" if fault else "waiting", sentence=one_line(fault)
    )


def _address(job: Job) -> str:
    """Of its report, for a browser, whatever bytes the record's name is made of."""
    return quote(os.fsencode(f"{job.name}/report.html"))


def _identified(job: Job, facts: dict[str, Any]) -> BatchRow:
    failed = [check["sentence"] for check in facts["checks"] if not check["passed"]]
    return BatchRow(
        record=one_line(job.name),
        status="done" if not failed else "done, with care",
        sentence=" ".join(failed) or "all checks passed",
        report=_address(job),
        nrmse=max(facts["fit"]["nrmse"].values()),
        log_evidence=facts["log_evidence"],
        elapsed_s=facts["elapsed_s"],
        parameters={name: (one["mean"], one["sd"]) for name, one in facts["parameters"].items()},
    )


def _discovered(job: Job, facts: dict[str, Any]) -> BatchRow:
    effects = "; ".join(effect["title"] for effect in facts["effects"])
    return BatchRow(
        record=one_line(job.name),
        status="done",
        sentence=": ".join(part for part in (facts["verdict"], effects) if part),
        report=_address(job),
        nrmse=facts["gap"]["fit"]["after"],
        parameters={
            f"{effect['name']}.{name}": (one["mean"], one["sd"])
            for effect in facts["effects"]
            for name, one in effect["parameters"].items()
        },
    )


def _csv(rows: Sequence[BatchRow]) -> str:
    """A line for each record; of each parameter that any of them has, mean and sd."""
    names = list(dict.fromkeys(name for row in rows for name in row.parameters))
    stream = StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    heads = ("record", "status", "sentence", "nrmse", "log_evidence", "elapsed_s")
    writer.writerow([*heads, *(f"{name} {what}" for name in names for what in ("mean", "sd"))])
    for row in rows:
        plain = row.as_json()
        moments = [row.parameters.get(name, (None, None)) for name in names]
        writer.writerow([*(plain[head] for head in heads), *(number for pair in moments for number in pair)])
    return stream.getvalue()
