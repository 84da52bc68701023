"""``bwbn export``: models and results for other programs."""

from __future__ import annotations

import atexit
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.console import Console

from bwbn_bayes.cli.given import ColumnsOption, ExcitationsOption, SequenceOption, model_file, record_of
from bwbn_bayes.cli.refusal import drop
from bwbn_bayes.errors import UserError

if TYPE_CHECKING:
    from bwbn_bayes.export import Exportable

Point = Literal["mean", "map"]

app = typer.Typer(help="Write a model or a result for another program.")


@app.callback()
def about() -> None:
    """Write a model or a result for another program."""


@app.command()
def opensees(
    source: Annotated[
        Path,
        typer.Argument(
            help="A result.nc, or the directory of a report; or a model file, at its `truth`.", show_default=False
        ),
    ],
    record: ExcitationsOption = None,
    columns: ColumnsOption = None,
    sequence: SequenceOption = False,
    at: Annotated[
        Point | None, typer.Option("--at", help="Point of a result's posterior.", show_default="mean")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="File to write, a new one; MODEL_opensees.py, here, by default.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the fit to a law that OpenSees lacks.")] = 1,
) -> None:
    """Write SOURCE as a script for openseespy: a uniaxialMaterial for each link, masses, ground motion, analysis."""
    from bwbn_bayes.cli.files import require_new, write_new
    from bwbn_bayes.export import script_of

    atexit.register(_without_farewell)
    if not _is_result(source):
        if at is not None:
            raise UserError("--at is a point of a result's posterior: a model is written at its `truth`, leave it out")
        structure = _of_model(source, record or (), columns, in_sequence=sequence)
    elif record or columns or sequence:
        raise UserError(
            "--record, --columns and --sequence belong to a model: a result goes through the excitation that it was "
            "identified from"
        )
    else:
        structure = _of_result(source, at or "mean")
    path = out or Path(f"{Path(structure.name).name}_opensees.py")
    require_new(path)
    script = script_of(structure, seed=seed)
    write_new(script.text, path)
    for note in script.notes:
        Console(stderr=True).print(note, markup=False, highlight=False, soft_wrap=True)
    print(path)


def _without_farewell() -> None:
    """OpenSees, where a fit has loaded it, writes to stderr as the process ends that it ends."""
    if "openseespy.opensees" in sys.modules and sys.stderr is not None:
        sys.stderr.flush()
        drop(sys.stderr)


def _is_result(source: Path) -> bool:
    return source.is_dir() or source.suffix.lower() == ".nc"


def _of_result(source: Path, at: Point) -> Exportable:
    from bwbn_bayes.export import of_result
    from bwbn_bayes.results import Result

    return of_result(Result.load(_result_file(source)), at)


def _result_file(source: Path) -> Path:
    """The file itself, or that of a directory which ``bwbn identify`` or ``bwbn discover`` wrote."""
    if not source.is_dir():
        return source
    discovered = source / "identify" / "result.nc"
    return discovered if discovered.is_file() else source / "result.nc"


def _of_model(source: Path, records: Sequence[Path], columns: str | None, *, in_sequence: bool) -> Exportable:
    from bwbn_bayes.export import of_model

    file = model_file(source, columns, *records)
    excitation = record_of(records, file, in_sequence=in_sequence) or file.excitation or file.record
    if excitation is None:
        raise UserError(f"{source} defines no `excitation`: add one, or give it with --record FILE")
    missing = [name for name in file.model.space.names if name not in file.truth]
    if missing:
        raise UserError(
            f"{source} does not know {', '.join(missing)}: add `truth`, or identify it and export the result.nc"
        )
    return of_model(file.model, excitation, file.truth, name=file.name)
