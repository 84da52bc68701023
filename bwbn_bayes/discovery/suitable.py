"""Whether model, record and held-out record can take part in a discovery: told before a long run, not after it."""

from __future__ import annotations

import numpy as np

from bwbn_bayes.engines.base import channel_map, require_channels, require_parameters
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
    _require_usable(model, record)
    if held_out is None:
        return
    _require_usable(model, held_out)
    shared = set(record.channels) & set(held_out.channels)
    if not shared:
        raise UserError(
            f"held-out record {held_out.name!r} measures {', '.join(held_out.channels)}, none of which record "
            f"{record.name!r} measures: give one with a channel in common"
        )
    same = np.array_equal(record.excitation, held_out.excitation) and all(
        np.array_equal(record.channels[channel], held_out.channels[channel]) for channel in shared
    )
    if same:
        raise UserError(
            f"held-out record {held_out.name!r} is the record that the model is fitted to: give another measurement"
        )


def _require_usable(model: Structure, record: Record) -> None:
    if record.excitation_kind != model.excitation_kind:
        raise UserError(
            f"record {record.name!r} gives the {record.excitation_kind.replace('_', ' ')}, but the model is driven by "
            f"the {model.excitation_kind.replace('_', ' ')}: use the structure that fits the test"
        )
    require_channels(record)
    channel_map(model, tuple(record.channels))
    if np.ptp(record.excitation) == 0.0:
        raise UserError(f"record {record.name!r} has no excitation: its {record.excitation_kind} never changes")
    still = [channel for channel, signal in record.channels.items() if np.ptp(signal) == 0.0]
    if still:
        raise UserError(f"record {record.name!r}: {', '.join(still)} never changes: leave it out")
