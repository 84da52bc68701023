"""Model files: Python a user copies and edits, run with the user's rights.

A model file defines ``model``, and may define ``record`` and ``held_out`` (measured Records), ``excitation`` (a
Record), ``truth`` (parameter values), ``snr_db`` (dB), ``assumptions`` (sentences) and ``columns`` (a column map for
records that the command line names); with ``excitation`` and ``truth`` it can make its own record. A record's file
stands for its starting model.
"""

from __future__ import annotations

import inspect
import math
import re
import runpy
import signal
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType

from bwbn_bayes.errors import UserError
from bwbn_bayes.records.column_map import EXAMPLE, parse_columns
from bwbn_bayes.records.noise import MOST_DECIBELS
from bwbn_bayes.records.readers import RECORD_SUFFIXES, read_record, suffix_in_words
from bwbn_bayes.records.record import Record, one_line
from bwbn_bayes.structures.starting_model import starting_model
from bwbn_bayes.structures.starting_source import UNIT_MASSES
from bwbn_bayes.structures.structure import Structure


@dataclass(frozen=True, kw_only=True)
class ModelFile:
    """What a model file says.

    Attributes
    ----------
    name : str
        The file's stem.
    model : Structure
    record : Record, optional
        What was measured.
    held_out : Record, optional
        A second measurement, to be predicted.
    excitation : Record, optional
        For a synthetic record.
    truth : mapping of str to float
        Parameter values for a synthetic record.
    snr_db : float, optional
        Its signal-to-noise ratio in dB of mean square.
    assumptions : tuple of str
        Sentences for the report.
    columns : str, optional
        What the columns of a record stand for that is given beside the model file.
    is_starting : bool
        Whether the model is the record's starting model.
    """

    name: str
    model: Structure
    record: Record | None = None
    held_out: Record | None = None
    excitation: Record | None = None
    truth: Mapping[str, float] = field(default_factory=dict)
    snr_db: float | None = None
    assumptions: tuple[str, ...] = ()
    columns: str | None = None
    is_starting: bool = False

    def model_for(self, fitted: Record) -> Structure:
        """The model to fit to a part of the file's record: a starting model reads its sizes off that part alone."""
        return starting_model(fitted) if self.is_starting else self.model


def load_model_file(path: Path | str, columns: str | None = None) -> ModelFile:
    """Run a model file and take what it defines, or make the starting model of a record.

    Parameters
    ----------
    path : Path or str
        Python source, which runs with the rights of whoever loads it; or a record.
    columns : str, optional
        A column map (:mod:`~bwbn_bayes.records.column_map`) for the record, or in place of the file's own.

    Returns
    -------
    ModelFile

    Raises
    ------
    UserError
        If the file is missing or of another kind, fails, does not define ``model``, or defines one of the other names
        wrongly.
    """
    path = Path(path)
    if path.suffix.lower() in RECORD_SUFFIXES:
        return _of_record(path, columns)
    _require_python(path)
    with _of_the_user(path):
        names = runpy.run_path(str(path), run_name=path.stem)
    # What stands under these names may be of a class of the user's, too, and fail when it is asked what it is.
    with _of_the_user(path, passing=UserError):
        return _checked(names, columns, path)


def _require_python(path: Path) -> None:
    """Nothing runs but what its name says is Python: data of an unknown suffix may hold anything."""
    if not path.is_file():
        what = "is a directory" if path.is_dir() else "is no plain file" if path.exists() else "does not exist"
        raise UserError(f"model file {path} {what}: give the path of a Python file that defines `model`")
    if path.suffix.lower() != ".py":
        raise UserError(
            f"{path}: {suffix_in_words(path)}: a model file ends in .py, a record in {', '.join(RECORD_SUFFIXES)}; "
            "rename it, or save a table as .csv"
        )


def _checked(names: Mapping[str, object], columns: str | None, path: Path) -> ModelFile:
    model = names.get("model")
    if not isinstance(model, Structure):
        raise UserError(f"{path} does not define `model` as a structure: ShearBuilding, Oscillator or Specimen")
    excitation = names.get("excitation")
    if excitation is not None and not isinstance(excitation, Record):
        raise UserError(f"{path}: `excitation` must be a Record, such as el_centro() returns")
    return ModelFile(
        name=one_line(path.stem),
        model=model,
        record=_measured(names, "record", path),
        held_out=_measured(names, "held_out", path),
        excitation=excitation,
        truth=_truth(names.get("truth"), model, path),
        snr_db=_snr(names.get("snr_db"), path),
        assumptions=_sentences(names.get("assumptions", ()), path),
        columns=_columns(names.get("columns"), path) if columns is None else columns,
    )


def _of_record(path: Path, columns: str | None) -> ModelFile:
    record = read_record(path, columns)
    model = starting_model(record)
    told = ("The model is the record's starting model: sizes read off the record, wide priors about them.",)
    return ModelFile(
        name=one_line(path.stem),
        model=model,
        record=record,
        assumptions=(*told, UNIT_MASSES) if not model.is_driven else told,
        columns=columns,
        is_starting=True,
    )


@contextmanager
def _of_the_user(path: Path, *, passing: type[UserError] | tuple[()] = ()) -> Iterator[None]:
    """While code of a model file may run: whatever it raises is a mistake in it, but for what passes."""
    try:
        yield
    except passing:
        raise
    except BaseException as error:
        # Ctrl-C comes as an exception where Python handles it; the command line does that itself (cli/interruption.py).
        if isinstance(error, KeyboardInterrupt) and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            raise
        frames = reversed(traceback.extract_tb(error.__traceback__))
        line = next((frame.lineno for frame in frames if frame.filename == str(path)), None)
        if isinstance(error, SyntaxError) and error.filename == str(path):
            line = error.lineno
        if passing and line is None:
            raise  # a mistake of ours
        where = f"{path}, line {line}" if line is not None else f"{path}"
        said = (str(error),) if isinstance(error, UserError) else (type(error).__name__, _words(error))
        what = _unknown_keyword(error, path) or ": ".join(filter(None, said))
        raise UserError(f"{where}: {what}") from error


def _words(error: BaseException) -> str:
    """What an exception says; its class is the user's, too, and may fail to say it."""
    try:
        return str(error)
    except Exception:
        return "its text cannot be read"


_UNKNOWN_KEYWORD = re.compile(r"([\w.]+?)(?:\.__init__)?\(\) got an unexpected keyword argument '(\w+)'")


def _unknown_keyword(error: BaseException, path: Path) -> str:
    """A keyword that what the file calls does not know, and those that it does; empty for any other mistake."""
    match = _UNKNOWN_KEYWORD.match(_words(error)) if type(error) is TypeError else None
    if match is None:
        return ""
    name, keyword = match.groups()
    frames = (frame for frame, _ in traceback.walk_tb(error.__traceback__))
    own = next((frame.f_globals for frame in frames if frame.f_code.co_filename == str(path)), {})
    modules = (getattr(one, name, None) for one in own.values() if isinstance(one, ModuleType))
    called = next(filter(callable, (own.get(name), *modules)), None)
    known = f": it knows {', '.join(inspect.signature(called).parameters)}" if callable(called) else ""
    return f"{name} does not know {keyword}{known}"


def _measured(names: Mapping[str, object], name: str, path: Path) -> Record | None:
    record = names.get(name)
    if record is None:
        return None
    if not isinstance(record, Record):
        raise UserError(f"{path}: `{name}` must be a Record, such as read_record(...) returns")
    if not record.channels:
        raise UserError(
            f"{path}: `{name}` measures nothing: give it at least one channel, or call it `excitation` if it is only a "
            "ground motion"
        )
    return record


def _truth(values: object, model: Structure, path: Path) -> dict[str, float]:
    if values is None:
        return {}
    if not isinstance(values, Mapping) or not all(isinstance(value, (int, float)) for value in values.values()):
        raise UserError(f'{path}: `truth` must give a number for each identified parameter, as in {{"k[1]": 20.0}}')
    try:
        model.draws(values)
    except UserError as error:
        raise UserError(f"{path}, `truth`: {error}") from error
    return dict(values)


def _snr(value: object, path: Path) -> float | None:
    if value is None:
        return None
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        if abs(value) <= MOST_DECIBELS or value == math.inf:
            return float(value)
        value = f"{value:.3g}" if isinstance(value, float) else "beyond all bounds"
    raise UserError(
        f"{path}: `snr_db` is {value!r}, it must be a number of dB within {MOST_DECIBELS:g} of zero, or left out for "
        "no noise"
    )


def _sentences(value: object, path: Path) -> tuple[str, ...]:
    if isinstance(value, (list, tuple)) and all(isinstance(sentence, str) for sentence in value):
        return tuple(value)
    raise UserError(f"{path}: `assumptions` must be a list of sentences")


def _columns(value: object, path: Path) -> str | None:
    if value is None:
        return None
    if not isinstance(value, str):
        raise UserError(f"{path}: `columns` must be a column map in quotes, such as {EXAMPLE}")
    try:
        parse_columns(value)
    except UserError as error:
        raise UserError(f"{path}, `columns`: {error}") from None
    return value
