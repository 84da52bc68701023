"""Where a prediction runs away: from there on its error is a number that says nothing."""

from __future__ import annotations

import numpy as np

from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.cycles import cycle_numbers
from bwbn_bayes.records.record import Record

RUNAWAY = 3.0
"""Error over the signal, rms, from which a prediction is said to run away instead of being numbered."""
_STRETCH = 30
"""The running error is the mean over such a part of the samples that count."""
_ENOUGH = 1e6
"""Errors beyond so many times the signal count as that: sums of larger ones overflow."""


def runaway_sample(measured: Floats, predicted: Floats) -> int | None:
    """First sample at which the running error of any channel leaves three times its signal; None where none does.

    Parameters
    ----------
    measured, predicted : (n_channels, n_counted) array
        [unit of the channel]

    Returns
    -------
    int or None
        The running error is the mean magnitude over the samples that follow, a thirtieth of all.
    """
    signal = np.sqrt(np.mean(np.square(measured), axis=1, keepdims=True))
    with np.errstate(over="ignore"):
        error = np.abs(predicted - measured) / np.maximum(signal, 1e-300)
    error = np.minimum(np.nan_to_num(error, nan=_ENOUGH, posinf=_ENOUGH), _ENOUGH)
    width = max(error.shape[1] // _STRETCH, 1)
    sums = np.cumsum(np.concatenate([np.zeros((len(error), 1)), error], axis=1), axis=1)
    beyond = np.flatnonzero(np.any(sums[:, width:] - sums[:, :-width] > RUNAWAY * width, axis=0))
    return int(beyond[0]) if beyond.size else None


def moment_in_words(record: Record, sample: int) -> str:
    """``t = 12.3 s`` in a building's record, ``cycle 9`` in a specimen's: where a sample of it lies, and in which part.

    Of a specimen it is the last cycle that was whole by then.
    """
    number = record.part_at(sample)
    part, place = record.parts[number], sample - record.stretches[number].start
    if part.excitation_kind == "displacement":
        moment = f"cycle {max(int(cycle_numbers(part.excitation)[place]) - 1, 0)}"
    else:
        moment = f"t = {part.times[place]:.3g} s"
    return f"{moment}{record.of_part(number)}"
