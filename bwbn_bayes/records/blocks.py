"""Sums and values by block: a channel of one record, whose noise has one level (:class:`~.record.Block`)."""

from __future__ import annotations

import numpy as np

from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record


def labels(record: Record) -> tuple[str, ...]:
    """What each block is called."""
    return tuple(block.label for block in record.blocks)


def counts(record: Record) -> Floats:
    """Samples of each block that count, ``(n_blocks,)``."""
    return np.array([len(np.arange(record.n_times)[block.samples]) for block in record.blocks], dtype=np.float64)


def by_block(record: Record, rows: Floats) -> list[Floats]:
    """What counts of rows ``(..., n_channels, n_times)``, each block's ``(..., n_counted)``."""
    return [rows[..., block.channel, block.samples] for block in record.blocks]


def by_part(record: Record, rows: Floats) -> list[tuple[Record, Floats]]:
    """Each record that measures anything, with its own channels and times of rows ``(n_channels, n_times)``."""
    names = list(record.channels)
    return [
        (part, rows[[names.index(name) for name in part.channels], stretch])
        for part, stretch in zip(record.parts, record.stretches, strict=True)
        if part.channels
    ]


def measured_or_nan(record: Record) -> Floats:
    """Measured channels ``(n_channels, n_times)``, not a number where none was measured or a sample does not count."""
    rows = np.full((len(record.channels), record.n_times), np.nan)
    for block in record.blocks:
        rows[block.channel, block.samples] = record.measured[block.channel, block.samples]
    return rows


def mean_squares(record: Record, rows: Floats) -> Floats:
    """Mean square of rows ``(..., n_channels, n_times)`` over each block, ``(..., n_blocks)``."""
    return np.stack([np.mean(np.square(own), axis=-1) for own in by_block(record, rows)], axis=-1)


def over_time(record: Record, values: Floats) -> Floats:
    """Values of blocks ``(..., n_blocks)`` at their samples, ``(..., n_channels, n_times)``; zero where none counts."""
    result = np.zeros((*values.shape[:-1], len(record.channels), record.n_times))
    for position, block in enumerate(record.blocks):
        result[..., block.channel, block.samples] = values[..., position, None]
    return result
