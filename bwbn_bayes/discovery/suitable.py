"""Whether model, record and held-out record can take part in a discovery: told before a long run, not after it."""

from __future__ import annotations

import numpy as np

from bwbn_bayes.engines.base import require_parameters, require_usable
from bwbn_bayes.errors import UserError
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure


def require_suitable(model: Structure, record: Record, held_out: Record | None, name: str) -> None:
    """Refuse what cannot lead to an answer.

    Parameters
    ----------
    model : Structure
    record : Record
        To fit and select with.
    held_out : Record or None
        To predict.
    name : str
        The model's name.

    Raises
    ------
    UserError
        If the model identifies nothing; if a record measures nothing, does not move, belongs to another kind of test or
        to another building; if the held-out record is the training record or shares no channel with it.
    """
    require_parameters(model, name)
    require_usable(model, record)
    if held_out is None:
        return
    require_usable(model, held_out)
    shared = set(record.channels) & set(held_out.channels)
    if not shared:
        raise UserError(
            f"held-out record {held_out.name!r} measures {', '.join(held_out.channels)}, none of which record "
            f"{record.name!r} measures: give one with a channel in common"
        )
    if all(any(_is_same(part, own) for part in record.parts) for own in held_out.parts if own.channels):
        raise UserError(
            f"held-out record {held_out.name!r} is the record that the model is fitted to: give another measurement"
        )


def _is_same(record: Record, other: Record) -> bool:
    """Whether two records are one measurement, in the channels that both have."""
    shared = set(record.channels) & set(other.channels)
    return (
        bool(shared)
        and np.array_equal(record.excitation, other.excitation)
        and all(np.array_equal(record.channels[channel], other.channels[channel]) for channel in shared)
    )
