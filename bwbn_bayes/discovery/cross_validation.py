"""How well a fitted model predicts stretches of the training record that it has not seen.

The record is parted into blocks, several joined records each by itself. Without each block the model is fitted again,
from its fit to all of the record: the first step takes the block's residuals and derivatives out of the normal
equations, a few more follow the model where it is bent. All are solved beside each other, in the lanes. What the fit to
the others predicts is compared with the block.

References
----------
.. [1] D. M. Allen, "The relationship between variable selection and data augmentation and a method for prediction",
   Technometrics 16(1), 1974, doi:10.1080/00401706.1974.10489157.
.. [2] P. Burman, E. Chow and D. Nolan, "A cross-validatory method for dependent data", Biometrika 81(2), 1994,
   doi:10.1093/biomet/81.2.351.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.inference.likelihood import IntegratedNoise, Posterior
from bwbn_bayes.inference.refits import refitted
from bwbn_bayes.inference.slopes import Slopes
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.blocks import by_block
from bwbn_bayes.records.record import Record

N_BLOCKS = 16
"""Stretches that are left out in turn: what one solve of the lanes holds, each longer than noise remembers."""
_FEWEST = 2
"""Of each of several records."""
_N_STEPS = 4
"""Steps of each fit: the first is exact for a linear model."""
_EDGE = 1e-6
"""Distance from a prior's bound, in prior probability, within which a parameter stays where it is."""


@dataclass(frozen=True, kw_only=True)
class CrossValidation:
    """How well blocks of the training record are predicted by a fit to the others.

    Attributes
    ----------
    log_score : float
        Log density of all blocks, each normal with the noise level that the others show. [nat]
    nrmse : float
        Root mean square over the channels of each one's rms error over its rms.
    """

    log_score: float
    nrmse: float


def cross_validated(posterior: Posterior, point: Floats) -> CrossValidation:
    """Leave each block out in turn.

    Parameters
    ----------
    posterior : Posterior
        Where its errors are autoregressive, the log score is that of what their past does not tell.
    point : (n_dim,) array
        Its optimum, in the unit cube.

    Returns
    -------
    CrossValidation
        Minus infinity and infinity where the model cannot be solved without a block.
    """
    record, slopes = posterior.record, Slopes.at(posterior, point)
    stretches = stretches_of(record)
    counts = np.ones((len(stretches), 1, record.n_times))
    for count, (_, own) in zip(counts, stretches, strict=True):
        count[:, own] = 0.0
    free = (point > _EDGE) & (point < 1.0 - _EDGE)
    predicted = refitted(posterior, slopes, np.tile(point, (len(stretches), 1)), _N_STEPS, counts=counts, free=free)
    with np.errstate(over="ignore", invalid="ignore"):
        error = record.measured - predicted.values
        squared, scaled = np.square(error), np.square(slopes.scaled(error))
    n_blocks = len(record.blocks)
    as_one = posterior.noise.as_one if isinstance(posterior.noise, IntegratedNoise) else np.ones(n_blocks)
    as_one = np.broadcast_to(as_one, n_blocks)
    log_score, missed = 0.0, np.zeros(n_blocks)
    for number, (part, own) in enumerate(stretches):
        for position, block in enumerate(record.blocks):
            if block.part == part:
                inside = float(np.sum(scaled[number, block.channel, own]))
                every = scaled[number, block.channel, block.samples]
                level = (float(np.sum(every)) - inside) / (len(every) - len(own))
                density = inside / level + len(own) * np.log(2.0 * np.pi * level * slopes.noise[position] ** 2)
                log_score -= 0.5 * float(density / as_one[position])
                missed[position] += np.sum(squared[number, block.channel, own])
    if not np.isfinite(log_score):
        return CrossValidation(log_score=-np.inf, nrmse=np.inf)
    shares = missed / [np.sum(np.square(own)) for own in by_block(record, record.measured)]
    return CrossValidation(log_score=log_score, nrmse=float(np.sqrt(np.mean(shares))))


def stretches_of(record: Record) -> list[tuple[int, NDArray[np.int64]]]:
    """Samples that are left out in turn, and the part that they lie in: by its share of what counts, two at least.

    What one leaves of its channels, the others of the same part say the noise level of.
    """
    found = []
    samples = np.arange(record.n_times)
    for number, (part, stretch) in enumerate(zip(record.parts, record.stretches, strict=True)):
        if part.channels:
            own = samples[stretch][part.kept]
            n = max(round(N_BLOCKS * len(own) / record.n_counted), _FEWEST)
            found += [(number, one) for one in np.array_split(own, n)]
    return found
