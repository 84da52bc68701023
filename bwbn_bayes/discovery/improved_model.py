"""The improved model as a Python file that a person could have written and ``bwbn identify`` runs as it is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bwbn_bayes.discovery.outcome import Added
from bwbn_bayes.discovery.sentences import probability_in_words
from bwbn_bayes.structures.model_source import ModelWriter, assignment, docstring, quoted
from bwbn_bayes.structures.parts import PlacedEffect
from bwbn_bayes.structures.structure import Structure


def improved_model_source(
    model: Structure,
    added: Sequence[Added] = (),
    *,
    name: str = "model",
    origin: Path | None = None,
    record_files: Sequence[str] = (),
    in_sequence: bool = False,
    assumptions: Sequence[str] = (),
) -> str:
    """Write a model as a model file.

    Parameters
    ----------
    model : Structure
        The improved model.
    added : sequence of Added
        Those of its effects that discovery found; each is told with its posterior.
    name : str
        What the given model is called.
    origin : Path, optional
        The given model's file, from which effects and priors of the user's own are taken.
    record_files : sequence of str
        Names of the record's file beside the model file, or of several records'; without them ``bwbn identify`` asks
        for ``--record``.
    in_sequence : bool
        Whether the structure comes to each of several as the one before left it.
    assumptions : sequence of str
        What the given model takes for granted.

    Returns
    -------
    str
        Python source.

    Raises
    ------
    UserError
        If the model uses a class from outside the package and ``origin`` is not given.
    """
    writer = ModelWriter()
    blocks = [writer.structure(model), *(_placed(writer, one, added) for one in model.effects)]
    if record_files:
        blocks.append(f"\nrecord = {_records(writer, record_files, in_sequence=in_sequence)}")
    if assumptions:
        blocks += ["", assignment("assumptions", assumptions)]
    return "\n".join([_docstring(name, added), "", *writer.header(origin), "", *blocks, ""])


def _records(writer: ModelWriter, files: Sequence[str], *, in_sequence: bool) -> str:
    """The record beside the file, or several as one."""
    each = [f"{writer.function('read_record')}(Path(__file__).with_name({quoted(file)}))" for file in files]
    if len(each) == 1:
        return each[0]
    lines = [f"{writer.function('join_records')}(", "    [", *(f"        {one}," for one in each), "    ],"]
    return "\n".join([*lines, *(["    in_sequence=True,"] if in_sequence else []), ")"])


def _docstring(name: str, added: Sequence[Added]) -> str:
    what = ", ".join(one.title for one in added)
    first = f"{name} with what discovery found missing: {what}." if added else f"{name} as given: nothing was added."
    return docstring(first, "Units: N, m, s, kg, J.")


def _placed(writer: ModelWriter, one: PlacedEffect, added: Sequence[Added]) -> str:
    """One effect; what discovery found with its posterior above it, and rounded priors."""
    found = next((a for a in added if _is(a, one)), None)
    return writer.placed(one) if found is None else writer.placed(one, remarks=_remarks(found), rounded=True)


def _is(added: Added, placed: PlacedEffect) -> bool:
    hypothesis = added.hypothesis
    return hypothesis.effect == placed.effect and hypothesis.storeys == placed.storeys


def _remarks(added: Added) -> tuple[str, ...]:
    units = {p.name: p.unit for p in added.hypothesis.model.space.parameters}
    moments = (
        f"{label} = {mean:.4g} +- {sd:.2g}{f' {units[label]}' if units[label] else ''}"
        for label, (mean, sd) in added.moments.items()
    )
    return (
        f"{added.title}: {added.meaning}.",
        f"Probability {probability_in_words(added.title_probability)}, log Bayes factor {_factor(added)}.",
        f"Posterior: {', '.join(moments)}.",
    )


def _factor(added: Added) -> str:
    return f"{added.log_bayes_factor:.1f} +- {added.log_bayes_factor_se:.1f}"
