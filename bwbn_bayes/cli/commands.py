"""The commands: options, one library call, an exit code.

Results go to stdout, everything else to stderr. Exit codes: 0; 2 for a mistake of the user's, told in one sentence;
130 for Ctrl-C; 1 for a mistake of ours, with a traceback. What takes seconds to load is imported by the command that
needs it: help and refusals should not wait for it.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Sequence
from functools import partial
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.console import Console
from rich.markup import escape
from rich.text import Text

from bwbn_bayes.cli import exporting
from bwbn_bayes.cli.console import plain_table, progress, results_console, summarise, told
from bwbn_bayes.cli.given import ColumnsOption, ExcitationsOption, SequenceOption, loaded, model_file, record_of
from bwbn_bayes.cli.interruption import EXIT_CODE, UNFINISHED_SEARCH, stopped_with
from bwbn_bayes.cli.refusal import refuse, refuse_what_the_system_refuses
from bwbn_bayes.errors import UserError, require_installed
from bwbn_bayes.inference.registry import METHODS, require_library, require_possible
from bwbn_bayes.inference.settings import MOST_PARTICLES, Settings
from bwbn_bayes.reproduction.options import DamageOrder, Options
from bwbn_bayes.reproduction.printed import TABLES
from bwbn_bayes.versions import version_of

if TYPE_CHECKING:
    from bwbn_bayes.discovery.pace import Progress
    from bwbn_bayes.discovery.run import Listener as DiscoveryListener
    from bwbn_bayes.inference.history import Listener
    from bwbn_bayes.records.record import Record
    from bwbn_bayes.structures.model_file import ModelFile
    from bwbn_bayes.structures.structure import Structure

DISCOVERY_PARTICLES = "2000"
"""What help says of the default in DiscoverySettings, which is loaded with all of discovery."""

_LONG = 4_000
"""Measured numbers from which a second process has loaded what it draws with, half a second, before it is asked."""

app = typer.Typer(
    help="Identify hysteretic structures from measured records, and say what the model is missing.",
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.add_typer(exporting.app, name="export")

EngineName = Literal["lanes", "cvodes", "reference", "scalar", "sunode", "cuda"]
ModelArgument = Annotated[
    Path,
    typer.Argument(help="Python file that defines `model`, or a record for its starting model.", show_default=False),
]
OutOption = Annotated[Path, typer.Option("--out", help="Directory to write to.")]
SeedOption = Annotated[
    int, typer.Option("--seed", min=0, help="Of the random numbers: the same seed, the same result.")
]
RecordsOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--record",
        help="Measured record: CSV, netCDF, MATLAB ...; several of one structure allowed; the model file's by default.",
    ),
]
WorkersOption = Annotated[
    int, typer.Option("--workers", min=1, max=1024, help="Processes that solve; with one, threads of this process.")
]
SchedulerOption = Annotated[
    str | None, typer.Option("--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers solve.")
]
EngineOption = Annotated[EngineName, typer.Option("--engine", help="What solves the model; see `bwbn engines`.")]


def _known_method(name: str) -> str:
    if name not in METHODS:
        raise typer.BadParameter(f"{name!r} is not one of {', '.join(map(repr, METHODS))}.")
    return name


@app.callback(invoke_without_command=True)
def about(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    """Print the version, or go on to the command."""
    if version:
        print(f"bwbn_bayes {version_of()}")


@app.command()
def identify(
    model: ModelArgument,
    record: RecordsOption = None,
    columns: ColumnsOption = None,
    sequence: SequenceOption = False,
    method: Annotated[
        str,
        typer.Option(
            "--method",
            metavar="|".join(METHODS),
            callback=_known_method,
            help="How the posterior is sampled; ga finds one point only, ipv storey forces only.",
        ),
    ] = "importance",
    out: Annotated[
        Path | None, typer.Option("--out", help="Directory to write to; reports/MODEL_METHOD by default.")
    ] = None,
    seed: SeedOption = 1,
    engine: EngineOption = "lanes",
    particles: Annotated[
        int,
        typer.Option(
            "--particles", min=100, max=MOST_PARTICLES, help="Posterior draws wanted; importance weighs 2000 at least."
        ),
    ] = 5000,
    variant: Annotated[
        Literal["default", "plain"],
        typer.Option("--variant", help="TMCMC as calibrated or published (plain); SMC batched or PyMC's own (plain)."),
    ] = "default",
    sampler: Annotated[
        Literal["pymc", "nutpie"], typer.Option("--sampler", help="Which NUTS, with --method nuts.")
    ] = "pymc",
    alternatives: Annotated[
        bool,
        typer.Option(
            "--alternatives/--no-alternatives", help="Ask the catalogue what else would explain the record, or not."
        ),
    ] = True,
    unnamed_force: Annotated[
        bool,
        typer.Option(
            "--unnamed-force",
            help="Put a force of no known law beside every storey, so that intervals allow for errors of the model.",
        ),
    ] = False,
    checkpoint: Annotated[
        Path | None,
        typer.Option(
            "--checkpoint",
            help="File, without suffix, that keeps what is solved: the same command goes on from there. Not for ipv.",
        ),
    ] = None,
    workers: WorkersOption = 1,
    scheduler: SchedulerOption = None,
) -> None:
    """Identify the parameters of MODEL from a record and write a report."""
    from bwbn_bayes.cli.files import writable, write_result
    from bwbn_bayes.engines.available import engine as engine_by_name
    from bwbn_bayes.identification import identify as identify_model
    from bwbn_bayes.report.second_process import second_process

    settings = Settings(
        method=method,
        engine=engine,
        seed=seed,
        particles=particles,
        variant=variant,
        sampler=sampler,
        alternatives=alternatives,
        checkpoint=checkpoint,
        workers=workers,
        scheduler=scheduler,
    )
    require_library(method, sampler)
    require_possible(method, unnamed_force=unnamed_force, checkpoint=checkpoint)
    if scheduler is not None:
        require_installed("distributed", "--scheduler")
    file = loaded(model, columns, *(record or ()))
    engine_by_name(engine)
    directory = writable(out or Path("reports") / f"{file.name}_{method}")
    notes = Console(stderr=True)
    goes_on = partial(_goes_on, directory, checkpoint)
    with stopped_with(goes_on), progress(notes, particles) as listener:
        measured = _record(file, record or (), seed, listener, in_sequence=sequence)
        with second_process(wanted=_draws_beside(measured)) as hand:
            result = identify_model(
                file.model,
                measured,
                settings=settings,
                unnamed_force=unnamed_force,
                name=file.name,
                assumptions=file.assumptions,
                listener=listener,
            )
            listener("writing the report", None)
            write_result(result, directory, hand)
    _warn(file.model, notes)
    summarise(result, directory)


@app.command()
def discover(
    model: ModelArgument,
    record: RecordsOption = None,
    columns: ColumnsOption = None,
    sequence: SequenceOption = False,
    held_out: Annotated[
        str | None,
        typer.Option(
            "--held-out",
            metavar="FILE|end|repeats",
            help="A second measurement, `end` for the end of this one or the last of several, or `repeats` for the "
            "cycles of a cyclic test that repeat an amplitude. Fit, selection and names never see it: it is predicted "
            "once, at the end, and shown.",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Directory to write to; reports/MODEL_discovery by default.")
    ] = None,
    seed: SeedOption = 1,
    particles: Annotated[
        int | None,
        typer.Option(
            "--particles",
            min=100,
            max=MOST_PARTICLES,
            help="Posterior draws of the final model.",
            show_default=DISCOVERY_PARTICLES,
        ),
    ] = None,
    time_limit: Annotated[
        float | None,
        typer.Option(
            "--time-limit",
            metavar="SECONDS",
            help="After it nothing further is tried: what was found by then is weighed and reported.",
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on from a run with the same --out that was stopped.")
    ] = False,
    workers: WorkersOption = 1,
    scheduler: SchedulerOption = None,
) -> None:
    """Find what MODEL lacks to explain a record, with probabilities, and write the improved model and a report."""
    from bwbn_bayes.cli.files import require_own_results, writable, write_discovery_files
    from bwbn_bayes.discovery.run import DiscoverySettings
    from bwbn_bayes.discovery.workflow import discover as discover_missing
    from bwbn_bayes.engines.journal import forget, has_begun
    from bwbn_bayes.report.discovery_text import discovery_in_words
    from bwbn_bayes.report.second_process import second_process

    if scheduler is not None:
        require_installed("distributed", "--scheduler")
    file = loaded(model, columns, *(record or ()), None if held_out in ("end", "repeats") else held_out)
    directory = writable(out or Path("reports") / f"{file.name}_discovery")
    settings = DiscoverySettings(
        seed=seed,
        particles=particles or DiscoverySettings.particles,
        time_limit_s=time_limit,
        checkpoint=directory / UNFINISHED_SEARCH,
        resume=resume,
        workers=workers,
        scheduler=scheduler,
    )
    notes = Console(stderr=True)
    with stopped_with(partial(_resumes, directory)), told(notes) as tell:
        apart = _held_out(file, held_out, record)
        measured = _record(file, record or (), seed, lambda text, _: tell(text, None), in_sequence=sequence)
        if resume and not has_begun(directory / UNFINISHED_SEARCH):
            require_own_results(directory, measured)
        with second_process(wanted=_draws_beside(measured)) as hand:
            discovery = discover_missing(
                _model_of(file, measured, apart),
                measured,
                held_out=apart,
                settings=settings,
                name=file.name,
                assumptions=file.assumptions,
                listener=_writing_steps(tell, directory),
            )
            tell("writing the report", None)
            write_discovery_files(discovery, directory, model, hand)
    if discovery.stopped:
        notes.print("stopped by the time limit: the same command with --resume goes on from there", soft_wrap=True)
    else:
        forget(directory / UNFINISHED_SEARCH)
    _warn(file.model, notes)
    console = results_console()
    for line in discovery_in_words(discovery):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    for made in ("improved_model.py", "report.html"):
        console.print(Text(f"{made.split('.')[0].replace('_', ' ')}: {directory / made}"), soft_wrap=True)


@app.command()
def batch(
    records: Annotated[
        str, typer.Argument(metavar="DIR|GLOB", help="Records: CSV, netCDF, MATLAB ...", show_default=False)
    ],
    model: Annotated[
        Path | None, typer.Option("--model", help="Model file for all; each record's starting model by default.")
    ] = None,
    discover: Annotated[bool, typer.Option("--discover", help="Search for missing effects too.")] = False,
    out: OutOption = Path("reports/batch"),
    seed: SeedOption = 1,
    particles: Annotated[
        int, typer.Option("--particles", min=100, max=MOST_PARTICLES, help="Posterior draws of each record.")
    ] = 5000,
    workers: Annotated[int, typer.Option("--workers", min=1, max=1024, help="Records at once.")] = 1,
) -> None:
    """Identify many records, or search them with --discover: one table and page of all; the same command goes on."""
    from bwbn_bayes.cli.batch import jobs_of, records_of, run_batch
    from bwbn_bayes.cli.files import writable
    from bwbn_bayes.structures.model_file import load_model_file

    found, directory, notes = records_of(records, out), writable(out), Console(stderr=True)
    if model is not None:
        load_model_file(model)
    options = ("--seed", str(seed), "--particles", str(particles))
    jobs = jobs_of(found, directory, model=model, discover=discover, options=options)
    with stopped_with(lambda: f"stopped: finished records are kept in {directory}, and the same command goes on"):
        rows = run_batch(
            jobs, directory, workers, lambda text: notes.print(text, markup=False, highlight=False, soft_wrap=True)
        )
    print(directory / "batch.html")
    n_refused = sum(row.status == "refused" for row in rows)
    if n_refused:
        raise UserError(f"{n_refused} of {len(rows)} records were refused: see above")


@app.command(name="model")
def starting_model(
    record: Annotated[
        Path | None, typer.Argument(help="Measured record: CSV, netCDF, MATLAB ...", show_default=False)
    ] = None,
    columns: ColumnsOption = None,
    example: Annotated[
        str | None, typer.Option("--example", metavar="NAME", help="Copy a model file that comes with the package.")
    ] = None,
    listed: Annotated[bool, typer.Option("--examples", help="List those.")] = False,
    out: Annotated[
        Path | None, typer.Option("--out", help="File to write, a new one; RECORD's name or NAME.py, here, by default.")
    ] = None,
) -> None:
    """Write a commented model file to start from, its priors of the sizes that RECORD shows; or copy an example."""
    from bwbn_bayes.cli.files import write_example, write_starting_model
    from bwbn_bayes.structures.examples import examples

    if (record is not None) + (example is not None) + listed != 1:
        raise UserError("give either a RECORD, --example NAME or --examples")
    if columns is not None and record is None:
        raise UserError("--columns says what the columns of a RECORD are, and none is given: leave it out")
    if listed and out is not None:
        raise UserError("--examples lists what there is and writes nothing: leave --out out")
    if listed:
        table = plain_table("example", "what it is")
        for name, what in examples().items():
            table.add_row(name, Text(what))
        results_console().print(table)
        return
    path = out or Path(f"{example or (record.stem if record else '')}.py")
    if example is not None:
        write_example(example, path)
    if record is not None:
        for sentence in write_starting_model(record, path, columns):
            Console(stderr=True).print(sentence, markup=False, highlight=False, soft_wrap=True)
    print(path)


@app.command()
def simulate(
    model: Annotated[
        Path, typer.Argument(help="Python file that defines `model` and its `truth`.", show_default=False)
    ],
    record: ExcitationsOption = None,
    columns: ColumnsOption = None,
    sequence: SequenceOption = False,
    out: OutOption = Path("reports"),
    seed: SeedOption = 1,
    engine: EngineOption = "reference",
) -> None:
    """Write the record that MODEL gives at its `truth` under its `excitation`: OUT/MODEL.csv, or MODEL_1.csv, ... ."""
    from bwbn_bayes.cli.files import replacing, writable, write_parts
    from bwbn_bayes.engines.available import engine as engine_by_name
    from bwbn_bayes.engines.simulation import simulate as simulate_record

    file = model_file(model, columns, *(record or ()))
    excitation = record_of(record or (), file, in_sequence=sequence) or file.excitation
    if excitation is None:
        raise UserError(f"{model} defines no `excitation`: add one, or give it with --record FILE")
    if not file.truth:
        raise UserError(f"{model} defines no `truth`: add the value of every identified parameter")
    directory = writable(out)
    made = simulate_record(
        file.model, excitation, file.truth, snr_db=file.snr_db, seed=seed, engine=engine_by_name(engine)
    )
    with replacing(out) as fresh:
        names = write_parts(made, fresh, file.name)
    for name in names:
        print(directory / name)


@app.command()
def reproduce(
    paper: Annotated[Literal["zhao2019"], typer.Argument(help="The paper.")],
    table: Annotated[
        list[int] | None, typer.Option("--table", min=1, max=7, help="Printed table, several allowed; all by default.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="A first look: 500 particles, 60 generations.")] = False,
    out: Annotated[Path | None, typer.Option("--out", help="Directory to write to; reports/PAPER by default.")] = None,
    seed: SeedOption = 1,
    seeds: Annotated[
        int, typer.Option("--seeds", min=1, max=1000, help="How many seeds of the noise TMCMC of group 1 is run for.")
    ] = 1,
    particles: Annotated[
        int, typer.Option("--particles", min=100, max=MOST_PARTICLES, help="TMCMC particles.")
    ] = Options.particles,
    generations: Annotated[
        int, typer.Option("--generations", min=1, max=100_000, help="Generations of the genetic algorithm.")
    ] = Options.generations,
    whole_record: Annotated[
        bool, typer.Option("--whole-record", help="Genetic algorithm: judge every generation by the whole record.")
    ] = False,
    free_a: Annotated[bool, typer.Option("--free-a", help="Identify A too, as the paper does.")] = False,
    damage_order: Annotated[
        DamageOrder, typer.Option("--damage-order", help="Storeys in the order in which they are damaged.")
    ] = "123",
    sine_amplitude: Annotated[
        float, typer.Option("--sine-amplitude", help=escape("Of the sine [m/s^2]."))
    ] = Options.sine_amplitude,
    sine_frequency: Annotated[
        float, typer.Option("--sine-frequency", help="Of the sine [Hz].")
    ] = Options.sine_frequency_hz,
    el_centro: Annotated[
        Literal["rsn6_180", "chopra"], typer.Option("--el-centro", help="Which version of El Centro.")
    ] = "rsn6_180",
    el_centro_scale: Annotated[float, typer.Option("--el-centro-scale", help="Factor on El Centro.")] = 1.0,
    error_floor: Annotated[
        float, typer.Option("--error-floor", help="Error assumed of noise-free records, as a share of their rms.")
    ] = Options.error_floor,
) -> None:
    """Run the tables of PAPER again, printed figures beside ours; finished cases are kept."""
    from bwbn_bayes.cli.files import writable
    from bwbn_bayes.reproduction.workflow import reproduce as reproduce_tables

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
    directory = writable(out or Path("reports") / paper)
    notes = Console(stderr=True)
    with stopped_with(lambda: f"stopped: finished cases are kept in {directory}, and the same command goes on"):
        files = reproduce_tables(
            directory,
            tables=tuple(table or TABLES),
            options=options,
            say=lambda text: notes.print(text, markup=False, highlight=False, soft_wrap=True),
        )
    notes.print(f"{files.n_run} cases run, {files.n_kept} kept from before", highlight=False)
    print(files.html)


@app.command()
def effects(name: Annotated[str | None, typer.Argument(help="One effect; all of them by default.")] = None) -> None:
    """List the catalogue of physical effects with their equations."""
    from bwbn_bayes.elements.catalogue import catalogue

    known = {facts.name: facts for facts in catalogue()}
    if name is not None and name not in known:
        raise UserError(f"effect {name!r} is not in the catalogue: choose one of {', '.join(known)}")
    console = results_console()
    for facts in known.values() if name is None else [known[name]]:
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
    from bwbn_bayes.engines.available import engines as available_engines

    table = plain_table("engine", "available", "what it is, or why not")
    for facts in available_engines():
        table.add_row(facts.name, "yes" if facts.available else "no", Text(facts.reason))
    results_console().print(table)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and leave the process with its exit code.

    Parameters
    ----------
    arguments : sequence of str, optional
        Those of the process by default.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    # A terminal without Greek letters shows question marks in their place.
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")
    # It tells in sentences of its own of a home that cannot be written; ours is said once (engines/cache_files.py).
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    try:
        code = app(given or ["--help"], standalone_mode=False)
        if sys.stdout is not None:  # as it is where a shell closed it
            sys.stdout.flush()
    except (KeyboardInterrupt, typer.Abort):
        code = EXIT_CODE
    except UserError as error:
        refuse(str(error))
    except typer.TyperException as error:
        refuse(error.format_message())
    except OSError as error:
        code = refuse_what_the_system_refuses(error)
    if code == EXIT_CODE:  # typer makes it of KeyboardInterrupt, and says nothing
        print("stopped", file=sys.stderr)
    sys.exit(code or 0)


def _writing_steps(tell: DiscoveryListener, directory: Path) -> DiscoveryListener:
    """A listener that also writes what a search knows after each step."""
    from bwbn_bayes.cli.files import write_unfinished
    from bwbn_bayes.discovery.unfinished import Unfinished

    def hear(text: str, facts: Progress | Unfinished | None) -> None:
        tell(text, facts)
        if isinstance(facts, Unfinished):
            write_unfinished(facts, directory)

    return hear


def _resumes(directory: Path) -> str:
    """What remains of a search that is stopped."""
    from bwbn_bayes.engines.journal import has_begun

    if has_begun(directory / UNFINISHED_SEARCH):
        return f"stopped: what was fitted is kept in {directory}, and the same command with --resume goes on from there"
    return f"stopped: nothing was written to {directory}"


def _goes_on(directory: Path, checkpoint: Path | None = None) -> str:
    """What remains of a run that is stopped."""
    from bwbn_bayes.engines.journal import has_begun

    if checkpoint is None:
        return f"stopped: nothing was written to {directory}"
    if has_begun(checkpoint):
        return f"stopped: what was solved is in checkpoint {checkpoint}, and the same command goes on from there"
    return f"stopped: nothing was solved, checkpoint {checkpoint} holds nothing yet"


def _draws_beside(record: Record) -> bool:
    """Whether a run is long enough, and has a processor to spare, for a second process to draw its figures."""
    from bwbn_bayes.engines.lanes import usable_processors

    return record.n_times * len(record.channels) >= _LONG and usable_processors() > 1


def _warn(model: Structure, notes: Console) -> None:
    for warning in model.warnings:
        notes.print(warning, markup=False, highlight=False, soft_wrap=True)


def _record(
    file: ModelFile, paths: Sequence[Path], seed: int, listener: Listener, *, in_sequence: bool = False
) -> Record:
    from bwbn_bayes.engines.simulation import simulate as simulate_record

    given = record_of(paths, file, in_sequence=in_sequence)
    if given is not None:
        _require_different(given.parts, paths)
        return given
    if file.record is not None:
        return file.record
    if file.excitation is None or not file.truth:
        raise UserError(f"model {file.name} brings no record of its own: give one with --record FILE")
    listener("making the record with the reference engine", None)
    return simulate_record(file.model, file.excitation, file.truth, snr_db=file.snr_db, seed=seed)


def _require_different(records: Sequence[Record], paths: Sequence[Path]) -> None:
    first: dict[str, Path] = {}
    for record, path in zip(records, paths, strict=True):
        if first.setdefault(record.content_hash, path) is not path and record.channels:
            raise UserError(
                f"--record {path} is the measurement of {first[record.content_hash]} again, which would count twice: "
                "leave it out"
            )


def _held_out(
    file: ModelFile, asked: str | None, record: Sequence[Path] | None
) -> Record | Literal["end", "repeats"] | None:
    from bwbn_bayes.records.readers import RECORD_SUFFIXES, read_record

    if asked is None:
        # A record named on the command line is another test: the file's held-out one may not belong to it.
        return None if record else file.held_out
    words: dict[str, Literal["end", "repeats"]] = {"end": "end", "repeats": "repeats"}
    if asked in words:
        return words[asked]
    if Path(asked).suffix.lower() not in RECORD_SUFFIXES:
        raise UserError(
            f"--held-out {asked} is neither `end` nor `repeats` nor the file of a record, which ends in "
            f"{', '.join(RECORD_SUFFIXES)}: give one of them"
        )
    return read_record(asked, file.columns)


def _model_of(file: ModelFile, measured: Record, apart: Record | Literal["end", "repeats"] | None) -> Structure:
    """The model, for which nothing was read off samples of the file's record that are held out."""
    from bwbn_bayes.discovery.held_out import set_apart

    if file.is_starting and apart in ("end", "repeats") and measured is file.record:
        return file.model_for(set_apart(file.model, measured, apart)[0])
    return file.model
