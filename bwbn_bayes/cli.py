"""The command line: options, one library call, an exit code."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from bwbn_bayes.elements.catalogue import catalogue
from bwbn_bayes.engines.available import engine as engine_by_name
from bwbn_bayes.engines.available import engines as available_engines
from bwbn_bayes.engines.simulation import simulate as simulate_record
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.identify import METHODS, Method, Settings
from bwbn_bayes.inference.identify import identify as identify_model
from bwbn_bayes.records.readers import read_record, write_record
from bwbn_bayes.records.record import Record
from bwbn_bayes.report import write_report
from bwbn_bayes.results import Result, StageFacts
from bwbn_bayes.structures.model_file import ModelFile, load_model_file

app = typer.Typer(
    help="Identify hysteretic structures from measured records, and say what the model is missing.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
notes = Console(stderr=True)

ModelArgument = Annotated[Path, typer.Argument(help="Python file that defines `model`.")]
RecordOption = Annotated[Path | None, typer.Option("--record", help="Measured record: CSV or netCDF.")]
OutOption = Annotated[Path | None, typer.Option("--out", help="Directory to write to.")]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="The run is a function of it.")]
EngineOption = Annotated[str, typer.Option("--engine", help="lanes, cvodes, reference or scalar.")]


@app.command()
def identify(
    model: ModelArgument,
    record: RecordOption = None,
    method: Annotated[str, typer.Option("--method", help=" or ".join(METHODS))] = "importance",
    out: OutOption = None,
    seed: SeedOption = 1,
    engine: EngineOption = "lanes",
    particles: Annotated[int, typer.Option("--particles", min=100, help="Posterior draws wanted.")] = 5000,
    variant: Annotated[str, typer.Option("--variant", help="TMCMC as calibrated (default) or published (plain).")] = "default",
) -> None:
    """Identify the parameters of MODEL from a record and write a report."""
    settings = Settings(
        method=_method(method), engine=engine, seed=seed, particles=particles, variant="plain" if variant == "plain" else "default"
    )
    if variant not in ("default", "plain"):
        raise UserError(f"variant {variant!r} is not known: choose default or plain")
    file = load_model_file(model)
    measured = _record(file, record, seed)
    directory = out or Path("reports") / f"{file.name}_{method}"
    with _progress() as bar:
        task = bar.add_task("starting", total=1.0)

        def listen(text: str, facts: StageFacts | None) -> None:
            share = facts.tempering_parameter if facts is not None else None
            bar.update(task, description=_line(text, facts), completed=share)

        result = identify_model(
            file.model, measured, settings=settings, name=file.name, assumptions=file.assumptions, listener=listen
        )
        bar.update(task, description="writing the report", completed=1.0)
        _write(result, directory)
    _summarise(result, directory)


@app.command()
def simulate(
    model: ModelArgument,
    record: RecordOption = None,
    out: OutOption = None,
    seed: SeedOption = 1,
    engine: EngineOption = "reference",
) -> None:
    """Write the record that MODEL gives at its `truth` under its `excitation` (or the excitation of --record)."""
    file = load_model_file(model)
    excitation = read_record(record) if record is not None else file.excitation
    if excitation is None or not file.truth:
        raise UserError(f"{model} defines no `truth` or no `excitation`: add them, or give --record for the excitation")
    made = simulate_record(
        file.model, excitation, file.truth, snr_db=file.snr_db, seed=seed, engine=engine_by_name(engine)
    )
    path = (out or Path("reports")) / f"{file.name}.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_record(made, path)
    print(path)


@app.command()
def effects() -> None:
    """List the catalogue of physical effects with their equations."""
    console = Console()
    for facts in catalogue():
        console.print(f"[bold]{facts.name}[/bold]  {facts.summary}  [dim]({facts.source})[/dim]", highlight=False)
        for equation in facts.equations:
            console.print(f"    {equation.text}", highlight=False, markup=False)
        units = ", ".join(f"{p.symbol} [{p.unit or '1'}]" for p in facts.parameters)
        console.print(f"    parameters: {units}", highlight=False, markup=False)
        console.print(f"    leaves in the residual: {facts.leaves_in_the_residual}", highlight=False, markup=False)
        console.print(f"    hard to tell from: {facts.hard_to_tell_from}\n", highlight=False, markup=False)


@app.command()
def engines() -> None:
    """List the engines and whether each can be used here."""
    table = Table("engine", "available", "what it is, or why not")
    for facts in available_engines():
        table.add_row(facts.name, "yes" if facts.available else "no", facts.reason)
    Console().print(table)


def main() -> None:
    """Run the command line; the user's mistakes end in one sentence and exit code 2."""
    try:
        app()
    except UserError as error:
        notes.print(f"[bold red]error:[/bold red] {_plain(str(error))}", soft_wrap=True, highlight=False)
        sys.exit(2)


def _plain(text: str) -> str:
    return text.replace("[", r"\[")


def _method(name: str) -> Method:
    for method in METHODS:
        if name == method:
            return method
    raise UserError(f"method {name!r} is not known: choose one of {', '.join(METHODS)}")


def _record(file: ModelFile, path: Path | None, seed: int) -> Record:
    if path is not None:
        return read_record(path)
    if file.excitation is None or not file.truth:
        raise UserError(f"model {file.name} brings no record of its own: give one with --record FILE")
    return simulate_record(file.model, file.excitation, file.truth, snr_db=file.snr_db, seed=seed)


def _progress() -> Progress:
    return Progress(
        TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn(), console=notes
    )


def _line(text: str, facts: StageFacts | None) -> str:
    if facts is None or not text.startswith("TMCMC"):
        return text
    return (
        f"{text}: stage {facts.stage}, tempering parameter {facts.tempering_parameter:.3g}, "
        f"acceptance {facts.acceptance:.2f}, {facts.n_solves} solves"
    )


def _write(result: Result, directory: Path) -> None:
    directory.mkdir(parents=True, exist_ok=True)
    (directory / "result.json").write_text(json.dumps(result.facts.as_json(), indent=1, allow_nan=False) + "\n")
    result.save(directory / "result.nc")
    write_report(result, directory)


def _summarise(result: Result, directory: Path) -> None:
    facts = result.facts
    table = Table("parameter", "mean", "sd", "90 % interval", "true", "", title=f"{facts.model}, {facts.record}")
    for p in facts.parameters:
        true = "" if p.true is None else f"{p.true:.5g}"
        table.add_row(_plain(p.name), f"{p.mean:.5g}", f"{p.sd:.2g}", f"{p.hdi90[0]:.5g} to {p.hdi90[1]:.5g}", true, p.flag)
    console = Console()
    console.print(table)
    for sentence in (*facts.verdict, *facts.identifiability):
        console.print(sentence, highlight=False, markup=False)
    for road, (value, error) in facts.evidences.items():
        console.print(f"log evidence, {road}: {value:.2f} +- {error:.2f}", highlight=False)
    console.print(f"{facts.n_solves} solves, {facts.elapsed_s:.1f} s, engine {facts.engine}", highlight=False)
    console.print(f"report: {directory / 'report.html'}", highlight=False, soft_wrap=True)
