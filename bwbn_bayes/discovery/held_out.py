"""Data that no fit and no selection sees: what is held out, and how well a model predicts it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.discovery.runaway import RUNAWAY, moment_in_words, runaway_sample
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.residuals import noise_floors
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.cycles import half_cycles, repeated_samples, repeats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure

N_BLOCKS = 30
"""Stretches of a whole record for the bootstrap."""
N_BOOTSTRAP = 400
EARLIEST, LATEST = 0.5, 0.85
"""Shares of a record between which it is parted."""
LEAST_PEAK = 0.6
"""Of the whole record's peak, what each part must reach."""
LEAST_REPEATS, LEAST_FITTED = 2, 4
"""Half cycles that must be there to hold out, and to fit."""

Indices = NDArray[np.int64]
_ALL = slice(None)


@dataclass(frozen=True, kw_only=True)
class HeldOut:
    """Held-out data: a record of its own, or the end or the repeat cycles of the record whose other samples are fitted.

    Parameters
    ----------
    record : Record
        The model is run over all of it, from rest.
    after_s : float
        What was measured up to then does not count; zero where all of it counts. [s]
    repeats : bool
        Whether nothing counts but the half cycles that repeat an amplitude.
    """

    record: Record
    after_s: float = 0.0
    repeats: bool = False

    @cached_property
    def counted(self) -> Indices:
        """Indices of the samples that count, in order."""
        if self.repeats:
            return np.flatnonzero(repeated_samples(self.record.excitation))
        return np.arange(self.first, self.record.n_times)

    @property
    def first(self) -> int:
        """Index of the first sample that counts."""
        return 0 if self.after_s == 0.0 else int(np.floor(self.after_s / self.record.time_step + 1e-6)) + 1

    @property
    def label(self) -> str:
        """What reports call it."""
        if self.repeats:
            return "held-out repeat cycles"
        if self.after_s == 0.0:
            return "held-out record"
        instant = f"{self.after_s:.3g} s" if self.record.has_time else moment_in_words(self.record, self.first)
        return f"held-out end, after {instant}"


def set_apart(
    model: Structure, record: Record, held_out: Record | Literal["end", "repeats"] | None
) -> tuple[Record, HeldOut | None]:
    """Part what is fitted from what is held out.

    Parameters
    ----------
    model : Structure
        Tells the masses.
    record : Record
        The measurement.
    held_out : Record, "end", "repeats" or None
        Another measurement, the end of this one or its repeat cycles, or nothing.

    Returns
    -------
    record : Record
        To fit and select with.
    held_out : HeldOut or None

    Raises
    ------
    UserError
        If ``held_out`` is another word, or the record has no end or no repeat cycles to hold out.
    """
    if isinstance(held_out, Record):
        return record, HeldOut(record=held_out)
    if held_out is None:
        return record, None
    if held_out == "repeats":
        apart = repeat_cycles(record)
        return replace(record, counted=~repeated_samples(record.excitation)), apart
    if held_out != "end":
        raise UserError(
            f"held_out is {held_out!r}: give a Record, such as read_record(...) returns, or 'end' or 'repeats'"
        )
    time = parting_time(model, record)
    return record.until(time), HeldOut(record=record, after_s=time)


def repeat_cycles(record: Record) -> HeldOut:
    """The half cycles of a cyclic test that repeat an amplitude, see :func:`~bwbn_bayes.records.cycles.repeats`.

    An amplitude is repeated where the next half cycle of one direction comes within 10 % of the first of its row,
    above it or below: loading protocols step by 25 % and more, and machines do not hit an amplitude exactly.

    Raises
    ------
    UserError
        If the record is no cyclic test, repeats nothing, or does nothing but repeat.
    """
    if record.excitation_kind != "displacement":
        raise UserError(
            f"record {record.name!r} is a ground motion, which repeats no cycles: hold out its end with "
            "--held-out end, or another measurement with --held-out FILE"
        )
    counts = repeats(half_cycles(record.excitation))
    n_repeats = sum(count > 0 for count in counts)
    if n_repeats < LEAST_REPEATS or len(counts) - n_repeats < LEAST_FITTED:
        raise UserError(
            f"record {record.name!r} has no repeat cycles to hold out: {n_repeats} of its {len(counts)} half cycles "
            f"repeat an amplitude, at least {LEAST_REPEATS} must and {LEAST_FITTED} must not; hold out its end with "
            "--held-out end"
        )
    return HeldOut(record=record, repeats=True)


def parting_time(model: Structure, record: Record) -> float:
    """Time [s] that parts a record so that both parts move strongly; its sample belongs to the first.

    The latest between 50 and 85 % of the record at which both parts reach 0.6 of the whole's peak in both directions,
    measured from the mean. A storey's force hardly grows once it yields, so that a part that comes this near to the
    peak force yields if the record does; both directions ask it for a whole reversal, not for one spike. The latest
    leaves the most to learn from. The signal is the base shear where every floor's acceleration is measured, as its
    masses are known; else, and for a specimen's force, every channel must pass. No model enters, so that the choice
    favours none.

    Raises
    ------
    UserError
        If there is no such time.
    """
    signals = _strong_signals(model, record)
    peaks = np.array([_weaker_peak(signal) for signal in signals.values()])
    earliest, latest = int(np.ceil(EARLIEST * (record.n_times - 1))), int(LATEST * (record.n_times - 1))
    weakest = np.min(peaks, axis=0)[earliest : latest + 1]
    strong = np.flatnonzero(weakest >= LEAST_PEAK)
    if not strong.size:
        best = int(np.argmax(weakest))
        name = list(signals)[int(np.argmin(peaks[:, earliest + best]))]
        share = max(int(100.0 * weakest[best]), 0)
        raise UserError(
            f"record {record.name!r} has no end to hold out: wherever it is parted between "
            f"{record.times[earliest]:.3g} and {record.times[latest]:.3g} s, one part reaches at most {share} % of "
            f"the peak of {name}, less than {100.0 * LEAST_PEAK:.0f} %; hold out another measurement with "
            "--held-out FILE"
        )
    return float(record.times[earliest + strong[-1]])


def _strong_signals(model: Structure, record: Record) -> dict[str, Floats]:
    """By name, the signals ``(n_times,)`` that tell how strongly a record moves."""
    if not model.is_driven and len(record.floors) == model.n_floors:
        return {"base shear": record.storey_forces(model.masses)[0]}
    return dict(record.channels)


def _weaker_peak(signal: Floats) -> Floats:
    """The weaker part's peak over the whole's, ``(n_times - 1,)``, parted after each sample but the last.

    From the mean, in the direction in which that is smaller.
    """
    both = np.outer([1.0, -1.0], signal - np.mean(signal))
    before = np.maximum.accumulate(both, axis=1)[:, :-1]
    after = np.maximum.accumulate(both[:, ::-1], axis=1)[:, ::-1][:, 1:]
    return np.asarray(np.min(np.minimum(before, after) / np.max(both, axis=1, keepdims=True), axis=0))


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """A model's prediction of a record, against it, where it counts.

    Attributes
    ----------
    channels : tuple of str
    values : (n_channels, n_counted) array
        Predicted, at the best fit. [unit of the channel]
    nrmse : float
        Root mean square over the channels of each one's rms error over its rms.
    nrmse_se : float
        Standard error by a block bootstrap over stretches of a thirtieth of the record.
    log_density : float
        Log density per sample, the noise level of each channel as in the training record's fit. [nat]
    runs_away_after : str
        The cycle or the time after which it has nothing to do with the record, in words; empty where it stays near.
    """

    channels: tuple[str, ...]
    values: Floats
    nrmse: float
    nrmse_se: float
    log_density: float
    runs_away_after: str = ""

    @property
    def error_in_words(self) -> str:
        """``12.3 %``, or ``the prediction runs away after cycle 9``."""
        if self.runs_away_after:
            return f"the prediction runs away after {self.runs_away_after}"
        return f"{100.0 * self.nrmse:.1f} %"


def predict(
    posterior: Posterior,
    point: Floats,
    record: Record,
    rng: np.random.Generator,
    *,
    counted: slice | Indices = _ALL,
) -> Prediction:
    """Predict a record with the parameters at a point ``(n_dim,)`` of the unit cube.

    The model runs from rest through the whole record and is compared at the samples that count.

    Raises
    ------
    UserError
        If the record measures nothing.
    """
    channels = tuple(record.channels)
    if not channels:
        raise UserError(f"record {record.name!r} measures nothing: held-out data need a channel such as acceleration_1")
    values, _ = posterior.split(point[None])
    predicted = posterior.engine.simulate(posterior.model, values, record).values[0][:, counted]
    measured = record.measured[:, counted]
    trained = np.sqrt(posterior.misfit(point[None])[0] / posterior.record.n_counted)
    level = dict(zip(posterior.record.channels, trained, strict=True))
    sd = np.array([level.get(name, floor) for name, floor in zip(channels, noise_floors(record), strict=True)])
    error = (measured - predicted) ** 2
    mean_square = np.mean(np.square(measured), axis=1)
    n_counted = error.shape[1]
    n_blocks = min(max(2, round(N_BLOCKS * n_counted / record.n_times)), n_counted)
    blocks = np.array([np.mean(part, axis=1) for part in np.array_split(error, n_blocks, axis=1)]) / mean_square
    resampled = blocks[rng.integers(0, len(blocks), (N_BOOTSTRAP, len(blocks)))]
    nrmse = float(np.sqrt(np.mean(np.mean(error, axis=1) / mean_square)))
    lost = runaway_sample(measured, predicted) if not nrmse < RUNAWAY else None
    return Prediction(
        channels=channels,
        values=predicted,
        nrmse=nrmse,
        runs_away_after="" if lost is None else moment_in_words(record, int(np.arange(record.n_times)[counted][lost])),
        nrmse_se=float(np.std(np.sqrt(np.mean(resampled, axis=(1, 2))))),
        log_density=float(np.mean(-0.5 * error / sd[:, None] ** 2 - np.log(sd)[:, None] - 0.5 * np.log(2.0 * np.pi))),
    )


def floor_of(record: Record, *, counted: slice | Indices = _ALL) -> float:
    """The same error for a perfect model: each channel's model-free noise level over its rms where it counts."""
    mean_square = np.mean(np.square(record.measured[:, counted]), axis=1)
    return float(np.sqrt(np.mean(np.square(noise_floors(record)) / mean_square)))
