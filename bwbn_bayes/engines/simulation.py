"""Synthetic records: a model's response at known parameters, with noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bwbn_bayes.engines.base import Engine, Status
from bwbn_bayes.engines.exact import exact_response
from bwbn_bayes.errors import UserError
from bwbn_bayes.records.noise import add_noise
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure


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
        If a parameter is missing or unknown, or the solve fails.
    """
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
