"""Model files: Python a user copies and edits, run with the user's rights.

A model file defines ``model``, and may define ``excitation`` (a Record), ``truth`` (parameter values), ``snr_db`` (dB) and
``assumptions`` (sentences); with the first two it can make its own record.
"""

from __future__ import annotations

import runpy
import traceback
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from bwbn_bayes.errors import UserError
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure


@dataclass(frozen=True, kw_only=True)
class ModelFile:
    """What a model file says.

    Attributes
    ----------
    name : str
        The file's stem.
    model : Structure
    excitation : Record, optional
        For a synthetic record.
    truth : mapping of str to float
        Parameter values for a synthetic record.
    snr_db : float, optional
        Its signal-to-noise ratio in dB of mean square.
    assumptions : tuple of str
        Sentences for the report.
    """

    name: str
    model: Structure
    excitation: Record | None = None
    truth: Mapping[str, float] = field(default_factory=dict)
    snr_db: float | None = None
    assumptions: tuple[str, ...] = ()


def load_model_file(path: Path) -> ModelFile:
    """Run a model file and take what it defines.

    Raises
    ------
    UserError
        If the file is missing, fails, or does not define ``model``.
    """
    if not path.is_file():
        raise UserError(f"model file {path} does not exist: give the path of a Python file that defines `model`")
    try:
        names = runpy.run_path(str(path), run_name=path.stem)
    except UserError as error:
        raise UserError(f"{path}: {error}") from error
    except Exception as error:
        line = next(
            (f.lineno for f in reversed(traceback.extract_tb(error.__traceback__)) if f.filename == str(path)), None
        )
        line = error.lineno if isinstance(error, SyntaxError) else line
        where = f"{path}, line {line}" if line is not None else f"{path}"
        raise UserError(f"{where}: {type(error).__name__}: {error}") from error
    model = names.get("model")
    if not isinstance(model, Structure):
        raise UserError(f"{path} does not define `model` as a ShearBuilding or a Specimen")
    excitation = names.get("excitation")
    if excitation is not None and not isinstance(excitation, Record):
        raise UserError(f"{path}: `excitation` must be a Record, such as el_centro() returns")
    return ModelFile(
        name=path.stem,
        model=model,
        excitation=excitation,
        truth=dict(names.get("truth", {})),
        snr_db=names.get("snr_db"),
        assumptions=tuple(names.get("assumptions", ())),
    )
