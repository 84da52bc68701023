"""What the command line shows: progress on stderr, results on stdout."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from bwbn_bayes.discovery import pace

if TYPE_CHECKING:
    from bwbn_bayes.discovery.run import Listener as DiscoveryListener
    from bwbn_bayes.inference.history import Listener
    from bwbn_bayes.results import ParameterFacts, Result, StageFacts


def results_console() -> Console:
    """Stdout; a file or a pipe is not folded at 80 columns."""
    return Console() if sys.stdout is not None and sys.stdout.isatty() else Console(width=160)


@contextmanager
def progress(console: Console, particles: int) -> Iterator[Listener]:
    """A bar with the time left on a terminal; one line per step elsewhere."""
    if not console.is_terminal:
        yield lambda text, facts: console.print(line_of(text, facts), markup=False, highlight=False, soft_wrap=True)
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(24),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as shown:
        yield _Bar(progress=shown, task=shown.add_task("starting", total=1.0), particles=particles)


@contextmanager
def told(console: Console) -> Iterator[DiscoveryListener]:
    """One line for each thing done or found; on a terminal also what goes on now, turning, and how far it is."""
    began = time.perf_counter()

    def write(text: str, _: object = None) -> None:
        line = f"{time.perf_counter() - began:6.1f} s  {text}"
        console.print(line, markup=False, highlight=False, soft_wrap=True)

    if not console.is_terminal:
        yield write
        return
    with console.status("starting") as status:

        def tell(text: str, facts: object = None) -> None:
            if not isinstance(facts, pace.Progress):
                write(text)
            status.update(Text(text))

        yield tell


@dataclass(kw_only=True)
class _Bar:
    """Fills once for each phase of a run, so that the time left is that phase's own."""

    progress: Progress
    task: TaskID
    particles: int
    first_tempering: float = 1.0

    def __call__(self, text: str, facts: StageFacts | None) -> None:
        if facts is None:
            self.progress.reset(self.task, description=text)
            self.first_tempering = 1.0
        else:
            self.progress.update(self.task, description=line_of(text, facts), completed=self._share(facts))

    def _share(self, facts: StageFacts) -> float:
        reached = facts.tempering_parameter
        if facts.label.startswith("TMCMC"):
            # The steps of the tempering parameter are about equal on a logarithmic scale.
            if reached > 0.0 and self.first_tempering == 1.0:
                self.first_tempering = reached
            return 1.0 - math.log(reached) / math.log(self.first_tempering) if 0.0 < reached < 1.0 else float(reached)
        if facts.label.startswith("importance"):
            return min(1.0, facts.effective_sample_size / self.particles)
        return reached


def line_of(text: str, facts: StageFacts | None) -> str:
    """A step in one line: what is done, how far it is, what it took."""
    if facts is None:
        return text
    details = []
    if facts.label.startswith("TMCMC"):
        details = [
            f"stage {facts.stage}",
            f"tempering parameter {facts.tempering_parameter:.3g}",
            f"acceptance {facts.acceptance:.2f}",
        ]
    return ", ".join((text, *details, f"{facts.n_solves} solves"))


def summarise(result: Result, directory: Path) -> None:
    """Print parameters, verdict, evidences and where the report lies."""
    from bwbn_bayes.records.record import one_line

    facts = result.facts
    console = results_console()
    console.print(Text(one_line(f"{facts.model}, {facts.record}") + "\n", "bold"))
    if facts.parameters:
        console.print(parameter_table(facts.parameters))
        console.print()
    told = " ".join(facts.verdict)
    failed = [check.sentence for check in facts.checks if not check.passed and check.sentence not in told]
    for sentence in (*facts.verdict, *failed, *facts.identifiability):
        console.print(sentence, highlight=False, markup=False)
    for road, (value, error) in facts.evidences.items():
        spread = f" +- {error:.2f}" if math.isfinite(error) else ""
        console.print(f"log evidence, {road}: {value:.2f}{spread}", highlight=False, markup=False)
    console.print(f"{facts.n_solves} solves, {facts.elapsed_s:.1f} s, engine {facts.engine}", highlight=False)
    console.print(Text(f"report: {directory / 'report.html'}"), soft_wrap=True)


def parameter_table(parameters: Sequence[ParameterFacts]) -> Table:
    """One line for each parameter, also on 80 columns."""
    truth_known = any(p.true is not None for p in parameters)
    table = plain_table("parameter", "mean", "sd", "90 % from", "to", *(["true"] if truth_known else []), "unit", "")
    for p in parameters:
        true = [] if not truth_known else ["" if p.true is None else f"{p.true:.5g}"]
        table.add_row(Text(p.name), *_numbers(p), *true, Text(p.unit), p.flag)
    return table


def _numbers(facts: ParameterFacts) -> tuple[str, ...]:
    """Mean, sd and the interval's ends to the second digit of the sd."""
    from bwbn_bayes.report.numbers import decimal_place

    values = (facts.mean, facts.sd, *facts.hdi90)
    if math.isnan(facts.sd):  # a point estimate
        return f"{facts.mean:.5g}", "", "", ""
    if not (math.isfinite(facts.sd) and facts.sd >= 1e-7):
        return tuple(f"{value:.4g}" for value in values)
    place = max(decimal_place(facts.sd), 0)
    return tuple(f"{value:.{place}f}" for value in values)


def plain_table(*columns: str) -> Table:
    """An empty table without rules, numbers to the right."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    numeric = {"mean", "sd", "90 % from", "to", "true"}
    for column in columns:
        last = column == columns[-1]
        table.add_column(column, justify="right" if column in numeric else "left", no_wrap=not last)
    return table
