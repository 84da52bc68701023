"""A model's response at known parameters: synthetic records with noise, and when a steady vibration repeats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from bwbn_bayes.engines.base import Engine, Status
from bwbn_bayes.engines.exact import exact_response
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.errors import UserError, whole_number
from bwbn_bayes.records.noise import add_noise
from bwbn_bayes.records.record import Record, require_record, require_whole
from bwbn_bayes.structures.structure import Structure, require_structure


def simulate(
    model: Structure,
    excitation: Record,
    truth: Mapping[str, float],
    *,
    channels: Sequence[str] | None = None,
    snr_db: float | None = None,
    seed: int = 1,
    engine: Engine | None = None,
) -> Record:
    """Record a model's response at known parameters.

    Parameters
    ----------
    model : Structure
        The structure.
    excitation : Record
        Ground motion or displacement history; its channels are ignored.
    truth : mapping of str to float
        Value of every identified parameter by label, e.g. ``{"k[1]": 20.0}``, in its own unit.
    channels : sequence of str, optional
        What is measured; every floor's total acceleration, or a specimen's force, by default.
    snr_db : float, optional
        Signal-to-noise ratio of each channel in dB of mean square; no noise where left out.
    seed : int
        Of the noise.
    engine : Engine, optional
        The reference engine by default: a record should not come from the engine that will fit it.

    Returns
    -------
    Record
        With the truth and the noise's standard deviations kept beside the channels.

    Raises
    ------
    UserError
        If a parameter is missing or unknown, an argument is of another kind, or the solve fails.
    """
    require_structure(model)
    require_record(excitation, "excitation")
    seed = whole_number("seed", seed, 0)
    if isinstance(channels, str):
        raise UserError(f"channels is {channels!r}: give a list of names, such as [{channels!r}]")
    if channels is None:
        floors = range(1, model.n_floors + 1)
        driven = model.excitation_kind == "displacement"
        channels = ["force"] if driven else [f"acceleration_{floor}" for floor in floors]
    draws = model.draws(truth)
    if engine is None:
        response = exact_response(model, draws, excitation, channels)
    else:
        response = engine.simulate(model, draws, excitation, channels)
    if response.status[0] != Status.OK:
        reason = Status(response.status[0]).name.lower()
        raise UserError(f"the model cannot be solved at the given parameters ({reason})")
    clean = excitation.with_channels(dict(zip(channels, response.values[0], strict=True)), truth=dict(truth))
    return add_noise(clean, snr_db, np.random.default_rng(seed))


_FEWEST, _MOST = 8, 1024
"""Periods that are solved first, and at most."""


def periods_until_repeated(
    model: Structure, record: Record, values: Mapping[str, float], *, within: float = 1e-4, engine: Engine | None = None
) -> int:
    """How many periods of a steady vibration the response takes to repeat, for :func:`~bwbn_bayes.periodic`.

    Periods are solved one after the other, twice as many each time, until the first half of them holds one from which
    on the drifts are those of the last.

    Parameters
    ----------
    model : Structure
        The structure.
    record : Record
        One period: its first sample follows its last. Its channels are ignored.
    values : mapping of str to float
        Value of every identified parameter by label, in its own unit.
    within : float
        Root mean square of a difference over that of the last period's drifts, all links together.
    engine : Engine, optional
        The lanes by default.

    Raises
    ------
    UserError
        If a parameter is missing or unknown, ``within`` is no positive number, the solve fails, or the response does
        not repeat within 1,024 periods, as that of a structure which degrades.
    """
    require_structure(model)
    require_record(record)
    require_whole(record)
    if not 0.0 < within < np.inf:
        raise UserError(f"within is {within}, it must be a positive number, such as 1e-4")
    drifts = [f"drift_{link}" for link in range(1, model.n_links + 1)]
    draws, n_periods = model.draws(values), _FEWEST
    while n_periods <= _MOST:
        tiled = replace(
            record,
            excitation=np.tile(record.excitation, n_periods),
            forces={name: np.tile(force, n_periods) for name, force in record.forces.items()},
            channels={},
            noise_sd={},
            counted=None,
        )
        response = (engine or Lanes()).simulate(model, draws, tiled, drifts)
        if response.status[0] != Status.OK:
            reason = Status(response.status[0]).name.lower()
            raise UserError(f"the model cannot be solved at the given values ({reason})")
        by_period = np.moveaxis(response.values[0].reshape(model.n_links, n_periods, -1), 1, 0)
        differs = np.linalg.norm(by_period - by_period[-1], axis=(1, 2)) > within * np.linalg.norm(by_period[-1])
        last = int(np.flatnonzero(differs)[-1]) if np.any(differs) else -1
        if last + 1 <= n_periods // 2:
            return max(last + 1, 1)
        n_periods *= 2
    raise UserError(
        f"the response does not repeat within {_MOST} periods: does the structure degrade, or is `within` too small?"
    )
