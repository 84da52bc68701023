"""Data that no fit and no selection sees: what is held out, and how well a model predicts it."""

from __future__ import annotations

from collections.abc import Iterator
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
from bwbn_bayes.records.blocks import counts
from bwbn_bayes.records.cycles import half_cycles, repeated_samples, repeats
from bwbn_bayes.records.joined import join_records
from bwbn_bayes.records.record import MIN_SAMPLES, Record, require_measured, require_single
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
    def is_of_fitted(self) -> bool:
        """Whether its other samples are those that are fitted."""
        return self.repeats or self.after_s > 0.0

    @property
    def first(self) -> int:
        """Index of the first sample that counts."""
        slack = 1e-6 * self.record.time_step
        return 0 if self.after_s == 0.0 else int(np.searchsorted(self.record.times, self.after_s + slack, side="right"))

    @property
    def label(self) -> str:
        """What reports call it."""
        if self.repeats:
            return "held-out repeat cycles"
        if self.after_s == 0.0:
            return "held-out record"
        if len(self.record.parts) > 1:
            return f"held-out end, {self.record.part_name(self.record.part_at(self.first))}"
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
        Another measurement, the end of this one or its repeat cycles, or nothing. The end of several joined records is
        the last of them.

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
    if held_out == "end" and len(record.parts) > 1:
        return _without_last(record)
    if held_out == "repeats":
        require_single(record, "repeat cycles are held out of one:")
        try:
            apart = repeat_cycles(record)
        except UserError as error:
            raise UserError(f"{error}{_or_the_end(model, record)}") from None
        return replace(record, counted=~repeated_samples(record.excitation)), apart
    if held_out != "end":
        raise UserError(
            f"held_out is {held_out!r}: give a Record, such as read_record(...) returns, or 'end' or 'repeats'"
        )
    time = parting_time(model, record)
    return record.until(time), HeldOut(record=record, after_s=time)


def _or_the_end(model: Structure, record: Record) -> str:
    """Advice beside another measurement; none where the record has no end to hold out either."""
    try:
        parting_time(model, record)
    except UserError:
        return ""
    return ", or the end of this one with --held-out end"


def _without_last(record: Record) -> tuple[Record, HeldOut]:
    """Several records without the last one that measures anything, which follows them where they are a sequence."""
    last = max(number for number, part in enumerate(record.parts) if part.channels)
    before = record.parts[:last]
    if not any(part.channels for part in before):
        raise UserError(f"{record.name!r} has no end to hold out: one record alone measures anything")
    kept = join_records(before, in_sequence=record.is_sequence) if len(before) > 1 else before[0]
    if not record.is_sequence:
        return kept, HeldOut(record=record.parts[last])
    whole = join_records(record.parts[: last + 1], in_sequence=True)
    return kept, HeldOut(record=whole, after_s=float(whole.times[whole.stretches[last].start - 1]))


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
            f"record {record.name!r} is a ground motion, which repeats no cycles: hold out another "
            "measurement with --held-out FILE"
        )
    counts = repeats(half_cycles(record.excitation))
    n_repeats = sum(count > 0 for count in counts)
    if n_repeats < LEAST_REPEATS or len(counts) - n_repeats < LEAST_FITTED:
        raise UserError(
            f"record {record.name!r} has no repeat cycles to hold out: {n_repeats} of its {len(counts)} half cycles "
            f"repeat an amplitude, at least {LEAST_REPEATS} must and {LEAST_FITTED} must not; hold out another "
            "measurement with --held-out FILE"
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
    earliest = max(int(np.ceil(EARLIEST * (record.n_times - 1))), MIN_SAMPLES - 1)
    latest = int(LATEST * (record.n_times - 1))
    if earliest > latest:
        raise UserError(
            f"record {record.name!r} has no end to hold out: of its {record.n_times} points at least {MIN_SAMPLES} "
            "must be left to fit; hold out another measurement with --held-out FILE"
        )
    weakest = np.min(peaks, axis=0)[earliest : latest + 1]
    strong = np.flatnonzero(weakest >= LEAST_PEAK)
    if not strong.size:
        best = int(np.argmax(weakest))
        name = list(signals)[int(np.argmin(peaks[:, earliest + best]))]
        share = max(int(100.0 * weakest[best]), 0)
        between = f"points {earliest + 1} and {latest + 1}"
        if record.has_time:
            between = f"{record.times[earliest]:.3g} and {record.times[latest]:.3g} s"
        raise UserError(
            f"record {record.name!r} has no end to hold out: wherever it is parted between {between}, one part reaches "
            f"at most {share} % of the peak of {name}, less than {100.0 * LEAST_PEAK:.0f} %; hold out another "
            "measurement with --held-out FILE"
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
    require_measured(record)
    channels = tuple(record.channels)
    values, _ = posterior.split(point[None])
    predicted = posterior.engine.simulate(posterior.model, values, record).values[0]
    shares: list[Floats] = []
    resampled: list[Floats] = []
    log_density: list[Floats] = []
    lost = ""
    for rows, samples, sd in _by_part(record, counted, _levels(posterior, point, record)):
        measured, own = record.measured[np.ix_(rows, samples)], predicted[np.ix_(rows, samples)]
        error, mean_square = np.square(measured - own), np.mean(np.square(measured), axis=1)
        n_stretches = min(max(2, round(N_BLOCKS * len(samples) / record.n_times)), len(samples))
        stretches = np.array([np.mean(one, axis=1) for one in np.array_split(error, n_stretches, axis=1)]) / mean_square
        resampled.append(np.mean(stretches[rng.integers(0, n_stretches, (N_BOOTSTRAP, n_stretches))], axis=1))
        shares.append(np.mean(error, axis=1) / mean_square)
        per_sample = -0.5 * error / sd[:, None] ** 2 - np.log(sd)[:, None] - 0.5 * np.log(2.0 * np.pi)
        log_density.append(per_sample.ravel())
        away = runaway_sample(measured, own) if not np.sqrt(np.mean(shares[-1])) < RUNAWAY else None
        lost = lost or ("" if away is None else moment_in_words(record, int(samples[away])))
    return Prediction(
        channels=channels,
        values=predicted[:, counted],
        nrmse=float(np.sqrt(np.mean(np.concatenate(shares)))),
        runs_away_after=lost,
        nrmse_se=float(np.std(np.sqrt(np.mean(np.concatenate(resampled, axis=1), axis=1)))),
        log_density=float(np.mean(np.concatenate(log_density))),
    )


def _levels(posterior: Posterior, point: Floats, record: Record) -> Floats:
    """Noise level of each block ``(n_blocks,)``: the channel's in the fit, else that of the block by itself."""
    trained, misfit = posterior.record, posterior.misfit(point[None])[0]
    level: dict[int, float] = {}
    for row in {block.channel for block in trained.blocks}:
        own = np.array([block.channel == row for block in trained.blocks])
        level[row] = float(np.sqrt(np.sum(misfit[own]) / np.sum(counts(trained)[own])))
    by_name = {name: level[row] for row, name in enumerate(trained.channels)}
    names = list(record.channels)
    floors = zip(record.blocks, noise_floors(record).tolist(), strict=True)
    return np.array([by_name.get(names[block.channel], floor) for block, floor in floors])


def _by_part(
    record: Record, counted: slice | Indices, of_blocks: Floats
) -> Iterator[tuple[list[int], Indices, Floats]]:
    """Of each part with samples that are asked for: its rows, those samples, and what belongs to each row."""
    every = np.arange(record.n_times)
    asked = np.zeros(record.n_times, dtype=np.bool_)
    asked[counted] = True
    for number in range(len(record.parts)):
        own = [position for position, block in enumerate(record.blocks) if block.part == number]
        if not own:
            continue
        samples = every[record.blocks[own[0]].samples]
        samples = samples[asked[samples]]
        if samples.size:
            yield [record.blocks[position].channel for position in own], samples, of_blocks[own]


def floor_of(record: Record, *, counted: slice | Indices = _ALL) -> float:
    """The same error for a perfect model: each channel's model-free noise level over its rms where it counts."""
    shares = [
        np.square(floor) / np.mean(np.square(record.measured[np.ix_(rows, samples)]), axis=1)
        for rows, samples, floor in _by_part(record, counted, noise_floors(record))
    ]
    return float(np.sqrt(np.mean(np.concatenate(shares))))
