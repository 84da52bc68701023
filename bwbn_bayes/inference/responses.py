"""Responses of posterior draws in summary: mean and quantiles of every history, and a few draws of them whole.

A hundred whole histories of every kind are two kilobytes a sample and storey, which no long record can afford. They are
solved a few kinds and a few draws at a time, so that memory too grows by a small constant with each sample.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bwbn_bayes.engines.base import Engine
from bwbn_bayes.engines.exact import observable
from bwbn_bayes.engines.lane_source import LANES
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.quantities import Landmark, landmarks, storey_parameters
from bwbn_bayes.structures.structure import Structure

Singles = NDArray[np.float32]

N_DRAWS = 100
"""Draws whose responses are solved for bands, figures and quantities."""
STATISTICS = ("mean", "lower", "upper")
BAND = (0.05, 0.95)
"""Quantiles that the last two statistics are."""
_MOST_WHOLE, _FEWEST_WHOLE = 25, 2
_WHOLE_NUMBERS = 10_000_000
"""Numbers kept in whole histories, for as many draws between these as that allows: 40 MB."""
_HELD = 50_000_000
"""Numbers held at once to take quantiles of: 200 MB."""
_SOLVED = 4_000_000
"""Numbers that one call of the engine is asked for, if sixteen draws do not need more: 32 MB."""
_SORTED = 2_000_000
"""Numbers sorted at once."""


class Responses(NamedTuple):
    """Histories of some draws, by kind; floors, storeys or channels are places.

    Attributes
    ----------
    draws : (n,) array
        Their positions among all draws.
    values : (n, n_parameters) array
        Identified parameters.
    whole : (m,) array
        Positions of those that are kept whole.
    bands, histories : mapping of str to (3, n_places, n_times) and (m, n_places, n_times) array
        Of every kind that can be observed, without noise: :data:`STATISTICS` over the draws; whole ones.
    predicted_bands : (3, n_channels, n_times) array
        Of the measured channels, noise included.
    signals : (n_channels, n_times) array
        Mean of the measured channels, without noise.
    landmarks : mapping
        Of every draw: what engineering quantities are made of.
    """

    draws: NDArray[np.int64]
    values: Floats
    whole: NDArray[np.int64]
    bands: Mapping[str, Singles]
    histories: Mapping[str, Singles]
    predicted_bands: Singles
    signals: Floats
    landmarks: Mapping[str, Landmark]


def evenly(n: int, most: int) -> NDArray[np.int64]:
    """At most so many positions, spread evenly over ``n``."""
    return np.linspace(0, n - 1, min(most, n)).astype(np.int64)


def batches(n_draws: int, numbers: int) -> Iterator[slice]:
    """Draws to solve in one call, for each of which so many numbers are stored."""
    size = max(1, _SOLVED // (numbers * LANES)) * LANES
    return (slice(start, min(start + size, n_draws)) for start in range(0, n_draws, size))


def summarised(
    engine: Engine,
    model: Structure,
    record: Record,
    draws: NDArray[np.int64],
    values: Floats,
    noise_sd: Floats,
    rng: np.random.Generator,
) -> Responses:
    """Solve draws and keep of their histories what a result keeps.

    Parameters
    ----------
    engine, model, record : Engine, Structure, Record
    draws : (n,) array
        Positions of the draws among all.
    values : (n, n_parameters) array
        Identified parameters.
    noise_sd : (n, n_blocks) array
        Noise scales of the measured channels, of each record.
    rng : numpy.random.Generator
        For the noise of predictions.
    """
    kinds, measured = observable(model), tuple(record.channels)
    names = tuple(dict.fromkeys([*(name for names in kinds.values() for name in names), *measured]))
    most = _WHOLE_NUMBERS // (len(names) * record.n_times)
    kept = evenly(len(draws), min(max(most, _FEWEST_WHOLE), _MOST_WHOLE))
    noise = {
        name: (
            tuple((record.stretches[b.part], noise_sd[:, i]) for i, b in enumerate(record.blocks) if b.channel == row),
            rng.spawn(1)[0],
        )
        for row, name in enumerate(measured)
    }
    found = _Found(kept=kept, noise=noise, parameters=storey_parameters(model, values))
    at_once = max(1, _HELD // (len(draws) * record.n_times))
    for first in range(0, len(names), at_once):
        _solve(engine, model, record, values, names[first : first + at_once], found)
    return Responses(
        draws=draws,
        values=values,
        whole=draws[kept],
        bands={kind: np.stack([found.bands[name] for name in own], axis=1) for kind, own in kinds.items()},
        histories={kind: np.stack([found.whole[name] for name in own], axis=1) for kind, own in kinds.items()},
        predicted_bands=np.stack([found.noisy_bands[name] for name in measured], axis=1),
        signals=np.stack([found.means[name] for name in measured]),
        landmarks=_landmarks(kinds, found),
    )


@dataclass(frozen=True, kw_only=True)
class _Found:
    """What is kept so far, by channel; ``noise`` holds each measured channel's scales where it has them, and stream.

    ``parameters`` are every link's, of all draws.
    """

    kept: NDArray[np.int64]
    parameters: xr.Dataset
    noise: Mapping[str, tuple[tuple[tuple[slice, Floats], ...], np.random.Generator]]
    means: dict[str, Floats] = field(default_factory=dict)
    bands: dict[str, Singles] = field(default_factory=dict)
    whole: dict[str, Singles] = field(default_factory=dict)
    noisy_bands: dict[str, Singles] = field(default_factory=dict)
    landmarks: dict[str, dict[str, Landmark]] = field(default_factory=dict)


def _solve(
    engine: Engine, model: Structure, record: Record, values: Floats, names: Sequence[str], found: _Found
) -> None:
    """Solve all draws for some channels, and reduce each."""
    held = np.empty((len(names), len(values), record.n_times), dtype=np.float32)
    total = np.zeros((len(names), record.n_times))
    begins = [run.start for _, run in record.runs]
    for rows in batches(len(values), len(names) * record.n_times):
        solved = np.moveaxis(engine.simulate(model, values[rows], record, names).values, 1, 0)
        total += np.sum(solved, axis=1)
        held[:, rows] = solved
        del solved  # before the next is made: sixteen draws of a long record are as large as all that is kept
    for name, history, mean in zip(names, held, total / len(values), strict=True):
        found.means[name] = mean
        found.bands[name] = _band(history, mean)
        found.whole[name] = history[found.kept]
        kind, _, place = name.rpartition("_")
        own = found.parameters.isel(storey=[int(place) - 1]) if kind == "drift" else found.parameters
        found.landmarks[name] = landmarks(kind, history[:, None], record.times, model.law, own, begins)
        if name in found.noise:
            scales, rng = found.noise[name]
            for number, one in enumerate(history):  # in place: nobody reads it without noise any more
                drawn = rng.standard_normal(record.n_times, dtype=np.float32)
                for samples, sd in scales:
                    one[samples] += sd[number] * drawn[samples]
            found.noisy_bands[name] = _band(history, mean)


def _band(history: Singles, mean: Floats) -> Singles:
    """Statistics ``(3, n_times)`` of a history ``(n_draws, n_times)`` whose mean is known to more digits."""
    band = np.empty((len(STATISTICS), len(mean)), dtype=np.float32)
    band[0] = mean
    size = max(1, _SORTED // len(history))
    for start in range(0, len(mean), size):
        some = slice(start, start + size)
        band[1:, some] = np.quantile(history[:, some], BAND, axis=0)
    return band


def _landmarks(kinds: Mapping[str, Sequence[str]], found: _Found) -> dict[str, Landmark]:
    """Landmarks of all storeys side by side."""
    joined: dict[str, Landmark] = {}
    for names in kinds.values():
        for variable, (dims, _) in found.landmarks[names[0]].items():
            parts = [found.landmarks[name][variable][1] for name in names]
            joined[variable] = (dims, cast("Singles", np.concatenate(parts, axis=1)))
    return joined
