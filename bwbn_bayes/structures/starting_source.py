"""The starting model of a record as a commented model file that runs as it is."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from bwbn_bayes.parameters import LogNormal, PerStorey
from bwbn_bayes.records.cycles import half_cycles
from bwbn_bayes.records.record import Record, si_unit
from bwbn_bayes.structures.model_source import ModelWriter, comment, docstring, quoted
from bwbn_bayes.structures.starting_model import starting_model
from bwbn_bayes.structures.structure import Structure

_SHAPE = {
    "alpha": "Stiffness after yield over the initial one; negative where strength falls with displacement.",
    "A": "Redundant: leave it.",
    "rho": "beta / (beta + gamma): unloading has the initial stiffness at 0.5, and near the bound 2 rho times that.",
    "n": "Sharpness of yield: 1 is gradual, 6 almost a corner.",
}
_OF_SPECIMEN = {
    "k": "Initial stiffness, about that of the reversals; two standard deviations are a factor of 7.",
    "c": "Viscous damping, a tenth of the peak force or so at the usual rate; nothing where the record has no time.",
    **_SHAPE,
    "u_y": "Yield displacement, about peak force over stiffness, up to twice the largest displacement.",
}
_OF_BUILDING = {
    "k": "Stiffness of each storey, as of a uniform building with the record's frequency, within a factor of 7.",
    "c": "Damping of each storey, about 3 % in the first mode, within a factor of 7.",
    **_SHAPE,
    "alpha": "Stiffness after yield over the initial one.",
    "u_y": "Yield drift, about half of the largest drift, up to five times that drift: then nothing yields.",
}

UNIT_MASSES = "Floors of 1 kg each: stiffness, damping, forces and energies are per kilogram of a floor."
"""What the starting model of a building takes for granted until its masses are typed."""


class StartingSource(NamedTuple):
    """A model file's text, and what its user is to do before it means what it says."""

    text: str
    to_do: tuple[str, ...]


def starting_source(record: Record, file: Path, columns: str | None = None) -> StartingSource:
    """Write the starting model of a record as a model file.

    Parameters
    ----------
    record : Record
    file : Path
        The record's own file as the model file is to name it: relative to the model file's directory, or absolute.
    columns : str, optional
        The column map that the record was read with.

    Returns
    -------
    StartingSource

    Raises
    ------
    UserError
        If no size can be read off the record (:func:`~bwbn_bayes.structures.starting_model.starting_model`).
    """
    model, writer = starting_model(record), ModelWriter()
    read = writer.function("read_record")
    place = f"Path({quoted(str(file))})" if file.is_absolute() else f"Path(__file__).parent / {quoted(file.as_posix())}"
    is_building = not model.is_driven
    blocks = [
        *([] if columns is None else [f"columns = {quoted(columns)}"]),
        f"record = {read}({place}{'' if columns is None else ', columns'})",
        "",
        *(_masses(model) if not model.is_driven else ()),
        writer.structure(
            model,
            remarks=_OF_BUILDING if is_building else _OF_SPECIMEN,
            written=_per_mass(model) if is_building else None,
        ),
    ]
    text = "\n".join([_told(record, model), "", *writer.header(), "", *blocks, ""])
    return StartingSource(text, _TO_DO if is_building else ())


_TO_DO = ("Type the mass of each floor where the file says so: with 1 kg each, only stiffness per mass can be told.",)


def _masses(model: Structure) -> tuple[str, ...]:
    told = (
        "TYPE THE MASS OF EACH FLOOR HERE, the lowest first, and lengthen the list if floors above the highest sensor "
        "are missing. With 1 kg each only stiffness per mass can be told, and forces and energies are per kilogram."
    )
    ones = ", ".join("1.0" for _ in model.masses)
    return (*comment(told), f"masses = [{ones}]  # kg", "mass = sum(masses) / len(masses)  # kg", "")


def _per_mass(model: Structure) -> Mapping[str, str]:
    """Stiffness and damping in proportion to the masses that will be typed."""
    written = {"masses": "masses"}
    for symbol in ("k", "c"):
        value = model.element.values[symbol]
        if isinstance(value, PerStorey) and isinstance(value.value, LogNormal):
            written[symbol] = f"PerStorey(LogNormal({value.value.median!r} * mass, {value.value.log_sd!r}))"
    return written


def _told(record: Record, model: Structure) -> str:
    """What the record is, and what its columns say."""
    kind = f"a building of {model.n_links} storeys" if not model.is_driven else "a specimen"
    points = (
        f"{record.n_times} points, {record.time_step:g} s apart"
        if record.has_time
        else (f"{record.n_times} points without a time column: nothing that depends on a rate can be told")
    )
    cycles = len(half_cycles(record.excitation)) if record.excitation_kind == "displacement" else 0
    columns = record.columns
    return docstring(
        f"A model to start from: {kind} under the record {record.name}.",
        f"The record has {points}" + (f"; it holds {cycles} half cycles." if cycles else "."),
        *(f"- {name}: from {min(y):.4g} to {max(y):.4g} {si_unit(name)}" for name, y in columns.items()),
        "",
        "Nothing is fitted here: sizes are read off the record, and priors are wide about them. A number is known, a",
        "distribution is identified: put in what you know better. Units: N, m, s, kg, J.",
    )
