"""Predict data that no fit and no selection saw, before and after."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.residuals import noise_floor
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record

N_BLOCKS = 30
N_BOOTSTRAP = 400


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """A model's prediction of a record, against it.

    Attributes
    ----------
    channels : tuple of str
    values : (n_channels, n_times) array
        Predicted, at the best fit. [unit of the channel]
    nrmse : float
        Root mean square over the channels of each one's rms error over its rms.
    nrmse_se : float
        Standard error by a block bootstrap over 30 stretches of time.
    log_density : float
        Log density of the record per sample, the noise level of each channel as in the training record's fit. [nat]
    """

    channels: tuple[str, ...]
    values: Floats
    nrmse: float
    nrmse_se: float
    log_density: float


def predict(posterior: Posterior, point: Floats, record: Record, rng: np.random.Generator) -> Prediction:
    """Predict a record with the parameters at a point ``(n_dim,)`` of the unit cube.

    Raises
    ------
    UserError
        If the record measures nothing.
    """
    channels = tuple(record.channels)
    if not channels:
        raise UserError(f"record {record.name!r} measures nothing: held-out data need a channel such as acceleration_1")
    values, _ = posterior.split(point[None])
    predicted = posterior.engine.simulate(posterior.model, values, record).values[0]
    measured = np.stack(list(record.channels.values()))
    trained = np.sqrt(posterior.misfit(point[None])[0] / posterior.record.n_times)
    level = dict(zip(posterior.record.channels, trained, strict=True))
    sd = np.array([level.get(name, noise_floor(record.channels[name])) for name in channels])
    error = (measured - predicted) ** 2
    mean_square = np.mean(np.square(measured), axis=1)
    blocks = np.array([np.mean(part, axis=1) for part in np.array_split(error, N_BLOCKS, axis=1)]) / mean_square
    resampled = blocks[rng.integers(0, len(blocks), (N_BOOTSTRAP, len(blocks)))]
    return Prediction(
        channels=channels,
        values=predicted,
        nrmse=float(np.sqrt(np.mean(np.mean(error, axis=1) / mean_square))),
        nrmse_se=float(np.std(np.sqrt(np.mean(resampled, axis=(1, 2))))),
        log_density=float(np.mean(-0.5 * error / sd[:, None] ** 2 - np.log(sd)[:, None] - 0.5 * np.log(2.0 * np.pi))),
    )


def floor_of(record: Record) -> float:
    """The same error for a perfect model: the model-free noise level over the rms, over all channels."""
    shares = [(noise_floor(signal) / np.sqrt(np.mean(np.square(signal)))) ** 2 for signal in record.channels.values()]
    return float(np.sqrt(np.mean(shares)))
