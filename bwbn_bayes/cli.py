"""The command line: options, one library call, an exit code.

Results go to stdout, everything else to stderr. Exit codes: 0; 2 for a mistake of the user's, told in one sentence;
1 for ours, with a traceback.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Literal

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from bwbn_bayes.baselines.methods import identify as identify_model
from bwbn_bayes.discovery.improved_model import improved_model_source
from bwbn_bayes.discovery.outcome import Discovery
from bwbn_bayes.discovery.run import DiscoverySettings
from bwbn_bayes.discovery.workflow import discover as discover_missing
from bwbn_bayes.elements.catalogue import catalogue
from bwbn_bayes.engines.available import engine as engine_by_name
from bwbn_bayes.engines.available import engines as available_engines
from bwbn_bayes.engines.simulation import simulate as simulate_record
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.identify import Listener, Method, Settings
from bwbn_bayes.records.readers import read_record, write_record
from bwbn_bayes.records.record import Record
from bwbn_bayes.report import write_discovery, write_report
from bwbn_bayes.report.discovery_text import discovery_in_words
from bwbn_bayes.report.numbers import decimal_place
from bwbn_bayes.reproduction.cases import DamageOrder, Options
from bwbn_bayes.reproduction.printed import TABLES
from bwbn_bayes.reproduction.workflow import reproduce as reproduce_tables
from bwbn_bayes.results import ParameterFacts, Result, StageFacts
from bwbn_bayes.structures.model_file import ModelFile, load_model_file

app = typer.Typer(
    help="Identify hysteretic structures from measured records, and say what the model is missing.",
    add_completion=False,
    pretty_exceptions_enable=False,
)

EngineName = Literal["lanes", "cvodes", "reference", "scalar", "sunode"]
ModelArgument = Annotated[Path, typer.Argument(help="Python file that defines `model`.", show_default=False)]
OutOption = Annotated[Path, typer.Option("--out", help="Directory to write to.")]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="The run is a function of it.")]
EngineOption = Annotated[EngineName, typer.Option("--engine", help="What solves the model; see `bwbn engines`.")]


@app.command()
def identify(
    model: ModelArgument,
    record: Annotated[Path | None, typer.Option("--record", help="Measured record: CSV or netCDF.")] = None,
    method: Annotated[
        Method, typer.Option("--method", help="Road to the posterior; ga finds one point, ipv forces only.")
    ] = "importance",
    out: Annotated[
        Path | None, typer.Option("--out", help="Directory to write to; reports/MODEL_METHOD by default.")
    ] = None,
    seed: SeedOption = 1,
    engine: EngineOption = "lanes",
    particles: Annotated[int, typer.Option("--particles", min=100, help="Posterior draws wanted.")] = 5000,
    variant: Annotated[
        Literal["default", "plain"],
        typer.Option("--variant", help="TMCMC as calibrated or published (plain); SMC batched or PyMC's own (plain)."),
    ] = "default",
    sampler: Annotated[Literal["pymc", "nutpie"], typer.Option("--sampler", help="Whose NUTS.")] = "pymc",
) -> None:
    """Identify the parameters of MODEL from a record and write a report."""
    file = load_model_file(model)
    directory = _writable(out or Path("reports") / f"{file.name}_{method}")
    notes = Console(stderr=True)
    with _progress(notes, particles) as listener:
        measured = _record(file, record, seed, listener)
        result = identify_model(
            file.model,
            measured,
            settings=Settings(
                method=method, engine=engine, seed=seed, particles=particles, variant=variant, sampler=sampler
            ),
            name=file.name,
            assumptions=file.assumptions,
            listener=listener,
        )
        listener("writing the report", None)
        _write(result, directory)
    for warning in file.model.warnings:
        notes.print(warning, markup=False, highlight=False, soft_wrap=True)
    _summarise(result, directory)


@app.command()
def discover(
    model: ModelArgument,
    record: Annotated[
        Path | None, typer.Option("--record", help="Measured record: CSV or netCDF; the model file's by default.")
    ] = None,
    held_out: Annotated[
        str | None,
        typer.Option(
            "--held-out",
            metavar="FILE|end",
            help="A second measurement, or `end` for the end of this one; predicted once, when all else is done.",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Directory to write to; reports/MODEL_discovery by default.")
    ] = None,
    seed: SeedOption = 1,
    particles: Annotated[
        int, typer.Option("--particles", min=100, help="Posterior draws of the final model.")
    ] = DiscoverySettings.particles,
) -> None:
    """Find the physical effect that MODEL lacks to explain a record, add it, and write a report."""
    file = load_model_file(model)
    directory = _writable(out or Path("reports") / f"{file.name}_discovery")
    notes = Console(stderr=True)
    with _told(notes) as tell:
        apart = _held_out(file, held_out, record)
        discovery = discover_missing(
            file.model,
            _record(file, record, seed, lambda text, _: tell(text)),
            held_out=apart,
            settings=DiscoverySettings(seed=seed, particles=particles),
            name=file.name,
            listener=tell,
        )
        tell("writing the report")
        _write_discovery(discovery, directory, model)
    console = _results()
    for line in discovery_in_words(discovery):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    for made in ("improved_model.py", "report.html"):
        console.print(Text(f"{made.split('.')[0].replace('_', ' ')}: {directory / made}"), soft_wrap=True)


@app.command()
def simulate(
    model: ModelArgument,
    record: Annotated[
        Path | None, typer.Option("--record", help="Excitation: CSV, netCDF or PEER AT2; the model file's by default.")
    ] = None,
    out: OutOption = Path("reports"),
    seed: SeedOption = 1,
    engine: EngineOption = "reference",
) -> None:
    """Write the record that MODEL gives at its `truth` under its `excitation`, as OUT/MODEL.csv."""
    file = load_model_file(model)
    excitation = read_record(record) if record is not None else file.excitation
    if excitation is None:
        raise UserError(f"{model} defines no `excitation`: add one, or give it with --record FILE")
    if not file.truth:
        raise UserError(f"{model} defines no `truth`: add the value of every identified parameter")
    path = _writable(out) / f"{file.name}.csv"
    made = simulate_record(
        file.model, excitation, file.truth, snr_db=file.snr_db, seed=seed, engine=engine_by_name(engine)
    )
    with _replacing(out) as partial:
        write_record(made, partial / path.name)
    print(path)


@app.command()
def reproduce(
    paper: Annotated[Literal["zhao2019"], typer.Argument(help="The paper.")],
    table: Annotated[
        list[int] | None, typer.Option("--table", min=1, max=7, help="Printed table, several allowed; all by default.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="A first look: 500 particles, 60 generations.")] = False,
    out: Annotated[Path | None, typer.Option("--out", help="Directory to write to; reports/PAPER by default.")] = None,
    seed: SeedOption = 1,
    seeds: Annotated[int, typer.Option("--seeds", min=1, help="Seeds of TMCMC with noise, group 1.")] = 1,
    particles: Annotated[int, typer.Option("--particles", min=100, help="TMCMC particles.")] = Options.particles,
    generations: Annotated[int, typer.Option("--generations", min=1, help="Of the GA.")] = Options.generations,
    whole_record: Annotated[
        bool, typer.Option("--whole-record", help="GA: judge every generation by the whole record.")
    ] = False,
    free_a: Annotated[bool, typer.Option("--free-a", help="Identify A too, as the paper does.")] = False,
    damage_order: Annotated[DamageOrder, typer.Option("--damage-order", help="Storeys in turn.")] = "123",
    sine_amplitude: Annotated[float, typer.Option("--sine-amplitude", help="[m/s^2]")] = Options.sine_amplitude,
    sine_frequency: Annotated[float, typer.Option("--sine-frequency", help="[Hz]")] = Options.sine_frequency_hz,
    el_centro: Annotated[
        Literal["rsn6_180", "chopra"], typer.Option("--el-centro", help="Version of the record.")
    ] = "rsn6_180",
    el_centro_scale: Annotated[float, typer.Option("--el-centro-scale", help="Factor on it.")] = 1.0,
    error_floor: Annotated[
        float, typer.Option("--error-floor", help="Of noise-free records, as a share of the rms.")
    ] = Options.error_floor,
) -> None:
    """Run the tables of PAPER again, printed figures beside ours; finished cases are kept."""
    options = Options(
        damage_order=damage_order,
        sine_amplitude=sine_amplitude,
        sine_frequency_hz=sine_frequency,
        el_centro_version=el_centro,
        el_centro_scale=el_centro_scale,
        error_floor=error_floor,
        free_a=free_a,
        particles=min(particles, 500) if quick else particles,
        generations=min(generations, 60) if quick else generations,
        growing=not whole_record,
        seed=seed,
        seeds=seeds,
        quick=quick,
    )
    directory = _writable(out or Path("reports") / paper)
    notes = Console(stderr=True)
    files = reproduce_tables(
        directory,
        tables=tuple(table or TABLES),
        options=options,
        say=lambda text: notes.print(text, markup=False, highlight=False, soft_wrap=True),
    )
    notes.print(f"{files.n_run} cases run, {files.n_kept} kept from before", highlight=False)
    print(files.html)


@app.command()
def effects() -> None:
    """List the catalogue of physical effects with their equations."""
    console = _results()
    for facts in catalogue():
        console.print(Text.assemble((facts.name, "bold"), f"  {facts.summary}  ", (f"({facts.source})", "dim")))
        for equation in facts.equations:
            console.print(f"    {equation.text}", highlight=False, markup=False)
        units = ", ".join(f"{p.symbol} [{p.unit or '1'}]" for p in facts.parameters)
        console.print(f"    parameters: {units}", highlight=False, markup=False)
        console.print(f"    leaves in the residual: {facts.leaves_in_the_residual}", highlight=False, markup=False)
        console.print(f"    hard to tell from: {facts.hard_to_tell_from}\n", highlight=False, markup=False)


@app.command()
def engines() -> None:
    """List the engines and whether each can be used here."""
    table = _table("engine", "available", "what it is, or why not")
    for facts in available_engines():
        table.add_row(facts.name, "yes" if facts.available else "no", Text(facts.reason))
    _results().print(table)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and leave the process with its exit code.

    Parameters
    ----------
    arguments : sequence of str, optional
        Those of the process by default.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        code = app(given or ["--help"], standalone_mode=False)
    except UserError as error:
        _refuse(str(error))
    except typer.TyperException as error:
        _refuse(error.format_message())
    sys.exit(code or 0)


def _refuse(sentence: str) -> None:
    message = Text.assemble(("error: ", "bold red"), " ".join(sentence.split()))
    Console(stderr=True).print(message, soft_wrap=True)
    sys.exit(2)


def _results() -> Console:
    """Stdout; a file or a pipe is not folded at 80 columns."""
    return Console() if sys.stdout.isatty() else Console(width=160)


def _record(file: ModelFile, path: Path | None, seed: int, listener: Listener) -> Record:
    if path is not None:
        return read_record(path)
    if file.record is not None:
        return file.record
    if file.excitation is None or not file.truth:
        raise UserError(f"model {file.name} brings no record of its own: give one with --record FILE")
    listener("making the record with the reference engine", None)
    return simulate_record(file.model, file.excitation, file.truth, snr_db=file.snr_db, seed=seed)


def _held_out(file: ModelFile, asked: str | None, record: Path | None) -> Record | Literal["end"] | None:
    if asked is None:
        # A record named on the command line is another test: the file's held-out one may not belong to it.
        return file.held_out if record is None else None
    return "end" if asked == "end" else read_record(asked)


@contextmanager
def _progress(console: Console, particles: int) -> Iterator[Listener]:
    """A bar with the time left on a terminal; one line per step elsewhere."""
    if not console.is_terminal:
        yield lambda text, facts: console.print(_line(text, facts), markup=False, highlight=False, soft_wrap=True)
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(24),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        yield _Bar(progress=progress, task=progress.add_task("starting", total=1.0), particles=particles)


@contextmanager
def _told(console: Console) -> Iterator[Callable[[str], None]]:
    """One line for each thing done or found; on a terminal also what goes on now, turning."""
    began = time.perf_counter()

    def write(text: str) -> None:
        line = f"{time.perf_counter() - began:6.1f} s  {text}"
        console.print(line, markup=False, highlight=False, soft_wrap=True)

    if not console.is_terminal:
        yield write
        return
    with console.status("starting") as status:

        def tell(text: str) -> None:
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
            self.progress.update(self.task, description=_line(text, facts), completed=self._share(facts))

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


def _line(text: str, facts: StageFacts | None) -> str:
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


def _writable(directory: Path) -> Path:
    """The directory, made and tried before a long run, not after it."""
    with _replacing(directory):
        return directory


@contextmanager
def _replacing(directory: Path) -> Iterator[Path]:
    """A place for new files beside the old ones; they take their names only when all of them are whole."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=directory, prefix=".partial-") as name:
            yield Path(name)
            for path in sorted(found for found in Path(name).rglob("*") if found.is_file()):
                place = directory / path.relative_to(name)
                place.parent.mkdir(exist_ok=True)
                path.replace(place)
    except OSError as error:
        raise UserError(
            f"--out {directory} cannot be written to ({error.strerror or error}): choose another directory"
        ) from error


def _write(result: Result, directory: Path) -> None:
    with _replacing(directory) as partial:
        _save(result, partial)
        write_report(result, partial)


def _save(result: Result, directory: Path) -> None:
    text = json.dumps(result.facts.as_json(), indent=1, allow_nan=False)
    (directory / "result.json").write_text(text + "\n", encoding="utf-8")
    result.save(directory / "result.nc")


def _write_discovery(discovery: Discovery, directory: Path, model: Path) -> None:
    """Page, numbers, record and improved model; ``identify/`` holds what ``bwbn identify`` writes of the latter."""
    with _replacing(directory) as partial:
        write_discovery(discovery, partial)
        _save(discovery.result, partial / "identify")
        text = json.dumps(discovery.as_json(), indent=1, allow_nan=False)
        (partial / "discovery.json").write_text(text + "\n", encoding="utf-8")
        write_record(discovery.record, partial / "record.csv")
        source = improved_model_source(
            discovery.improved,
            discovery.added,
            name=discovery.name,
            origin=model.resolve(),
            record_file="record.csv",
        )
        (partial / "improved_model.py").write_text(source, encoding="utf-8")


def _summarise(result: Result, directory: Path) -> None:
    facts = result.facts
    console = _results()
    console.print(Text(f"{facts.model}, {facts.record}\n", "bold"))
    if facts.parameters:
        console.print(_parameters(facts.parameters))
        console.print()
    failed = [check.sentence for check in facts.checks if not check.passed]
    for sentence in (*facts.verdict, *failed, *facts.identifiability):
        console.print(sentence, highlight=False, markup=False)
    for road, (value, error) in facts.evidences.items():
        console.print(f"log evidence, {road}: {value:.2f} +- {error:.2f}", highlight=False, markup=False)
    console.print(f"{facts.n_solves} solves, {facts.elapsed_s:.1f} s, engine {facts.engine}", highlight=False)
    console.print(Text(f"report: {directory / 'report.html'}"), soft_wrap=True)


def _parameters(parameters: Sequence[ParameterFacts]) -> Table:
    """One line for each parameter, also on 80 columns."""
    truth_known = any(p.true is not None for p in parameters)
    table = _table("parameter", "mean", "sd", "90 % from", "to", *(["true"] if truth_known else []), "unit", "")
    for p in parameters:
        true = [] if not truth_known else ["" if p.true is None else f"{p.true:.5g}"]
        table.add_row(Text(p.name), *_numbers(p), *true, Text(p.unit), p.flag)
    return table


def _numbers(facts: ParameterFacts) -> tuple[str, ...]:
    """Mean, sd and the interval's ends to the second digit of the sd."""
    values = (facts.mean, facts.sd, *facts.hdi90)
    if math.isnan(facts.sd):  # a point estimate
        return f"{facts.mean:.5g}", "", "", ""
    if not (math.isfinite(facts.sd) and facts.sd >= 1e-7):
        return tuple(f"{value:.4g}" for value in values)
    place = max(decimal_place(facts.sd), 0)
    return tuple(f"{value:.{place}f}" for value in values)


def _table(*columns: str) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    numeric = {"mean", "sd", "90 % from", "to", "true"}
    for column in columns:
        last = column == columns[-1]
        table.add_column(column, justify="right" if column in numeric else "left", no_wrap=not last)
    return table
