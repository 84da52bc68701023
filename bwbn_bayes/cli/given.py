"""What several commands are given alike: a model file, records, what their columns stand for, and their order."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from bwbn_bayes.errors import UserError

if TYPE_CHECKING:
    from bwbn_bayes.records.record import Record
    from bwbn_bayes.structures.model_file import ModelFile

ColumnsOption = Annotated[
    str | None,
    typer.Option(
        "--columns",
        metavar="MAP",
        help=escape(
            'What the columns of the record stand for: "ag = ground_acceleration [g], roof = acceleration_3 [g]".'
        ),
        show_default=False,
    ),
]
ExcitationsOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--record", help="Excitation: CSV, PEER AT2, COSMOS ...; several allowed; the model file's by default."
    ),
]
SequenceOption = Annotated[
    bool,
    typer.Option("--sequence", help="The structure comes to each record as the one before left it, not virgin."),
]


def loaded(model: Path, columns: str | None, *records: Path | str | None) -> ModelFile:
    """A model file, or a record's starting model, with the column map that is given for its records."""
    from bwbn_bayes.records.readers import RECORD_SUFFIXES
    from bwbn_bayes.structures.model_file import load_model_file

    if columns is not None and model.suffix.lower() not in RECORD_SUFFIXES and not any(records):
        raise UserError("--columns says what the columns of a record are, and no record is given: add --record FILE")
    return load_model_file(model, columns)


def model_file(model: Path, columns: str | None, *records: Path | str | None) -> ModelFile:
    """A model file, where no record will do: its starting model has no values to be solved at."""
    from bwbn_bayes.records.readers import RECORD_SUFFIXES

    if model.suffix.lower() in RECORD_SUFFIXES:
        raise UserError(
            f"{model} is a record: give a model file, Python that defines `model` and its `truth`; bwbn model writes "
            "one to start from"
        )
    return loaded(model, columns, *records)


def record_of(paths: Sequence[Path], file: ModelFile, *, in_sequence: bool) -> Record | None:
    """The given record, or several of them as one; None where none is given."""
    from bwbn_bayes.records.joined import join_records
    from bwbn_bayes.records.readers import read_record

    if in_sequence and len(paths) < 2:
        raise UserError("--sequence is the order of several records: give --record more than once")
    records = [read_record(path, file.columns) for path in paths]
    return join_records(records, in_sequence=in_sequence) if len(records) > 1 else next(iter(records), None)
