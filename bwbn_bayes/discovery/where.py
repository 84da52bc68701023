"""Where model and measurement disagree: by channel and time, by storey and state, in sentences.

The yardstick is a model-free estimate of the noise, not the misfit. With known masses the storey force itself is
measured, ``V_i = -sum_{j>=i} m_j a_j``, so that a residual force exists at every storey that has sensors above it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.residuals import counted, noise_floors, residual_of
from bwbn_bayes.inference.summary import observe
from bwbn_bayes.parameters import Booleans, Floats
from bwbn_bayes.records.blocks import by_part, over_time
from bwbn_bayes.records.cycles import cycle_numbers, half_cycles
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure

N_WINDOWS, _FEWEST_WINDOWS = 24, 4
"""Windows of a record, by their shares of what counts those of several, and of each of these at least."""
N_PLANE = 12
"""Bins of drift and of drift rate."""
NOTEWORTHY = 1.3
"""Residual to noise from which a window is worth a sentence, if noise alone seldom reaches it anywhere."""
_AFTER_A_TURN = 0.1
"""Share of a half cycle's way that is just after its turn, where there is no time to tell it by."""
_CHANCE = 0.01
_LEAST_CONCENTRATION = 1.3


@dataclass(frozen=True, kw_only=True)
class Spot:
    """A stretch of time in which a channel's residual stands out.

    Attributes
    ----------
    channel : str
    start_s, end_s : float
        Since the record began. [s]
    cycles : (int, int) or None
        The cycles in which it begins and ends, from 1, of a record that has no time: its seconds mean nothing.
    residual_to_noise : float
        Root mean square of the residual over the noise level.
    sentence : str
    record : str
        Which of several records it lies in, empty where there is one.
    """

    channel: str
    start_s: float
    end_s: float
    residual_to_noise: float
    sentence: str
    cycles: tuple[int, int] | None = None
    record: str = ""


@dataclass(frozen=True, kw_only=True)
class Row:
    """Residual to noise ``(n_windows,)`` of a storey's force, storeys counted from 0, or of a channel (None).

    NaN where it is not measured.
    """

    channel: str
    place: str
    storey: int | None
    ratios: Floats


@dataclass(frozen=True, kw_only=True)
class Disagreement:
    """The residual of a fit, seen from all sides.

    Attributes
    ----------
    channels : tuple of str
    noise : (n_blocks,) array
        Model-free noise level of each channel of each record. [unit of the channel]
    edges : (n_windows + 1,) array
        Of the time windows, which lie in one record each. [s]
    parts : (n_windows,) array of int
        Position of the record that each window lies in.
    by_window : (n_channels, n_windows) array
        Residual to noise; NaN where a record lacks a channel.
    by_storey : (n_storeys, n_windows) array
        Residual storey force to noise; NaN where a sensor above is missing.
    by_state : (n_storeys, n_plane, n_plane) array
        Residual storey force to noise over drift (rows) and drift rate (columns), each from minus to plus its largest
        magnitude; NaN where the storey never was or its force is not measured.
    by_condition : mapping of str to (n_storeys,) array
        Share of the residual force's energy under a condition over the share of the time spent under it.
    spots : tuple of Spot
        Largest first.
    """

    channels: tuple[str, ...]
    noise: Floats
    edges: Floats
    parts: NDArray[np.int64]
    by_window: Floats
    by_storey: Floats
    by_state: Floats
    by_condition: Mapping[str, Floats]
    spots: tuple[Spot, ...]

    @property
    def residual_to_noise(self) -> Floats:
        """Each channel's residual over its noise level, ``(n_channels,)``."""
        return np.asarray(np.sqrt(np.nanmean(np.square(self.by_window), axis=1)))

    def rows(self, model: Structure) -> tuple[Row, ...]:
        """Storey forces where they are measured, and the channels that these leave out.

        A storey's force goes by the channel of the floor above it, a specimen's by its own.
        """
        rows = []
        measured = dict(zip(self.channels, np.isfinite(self.by_window), strict=True))
        for i, ratios in enumerate(self.by_storey):
            own = next((name for name in (f"acceleration_{i + 1}", "force") if name in self.channels), None)
            # Where a record lacks a sensor above, the channel itself tells more.
            if own is not None and np.all(np.isfinite(ratios[measured[own]])):
                rows.append(Row(channel=own, place=model.link_in_words(i + 1), storey=i, ratios=ratios))
        told = {row.channel for row in rows}
        for name, ratios in zip(self.channels, self.by_window, strict=True):
            if name not in told:
                rows.append(Row(channel=name, place=_place(name), storey=None, ratios=ratios))
        return tuple(rows)


def disagreement(posterior: Posterior, point: Floats) -> Disagreement:
    """Compare a fit with its record at a point ``(n_dim,)`` of the unit cube."""
    record, model = posterior.record, posterior.model
    residual, noise = residual_of(posterior, point), noise_floors(record)
    weight = over_time(record, 1.0 / noise)
    scaled = np.where(weight > 0.0, residual * weight, np.nan)
    force, n_white = np.full((model.n_links, record.n_times), np.nan), np.zeros(len(record.parts))
    for number, (part, own) in zip(_measuring(record), by_part(record, residual), strict=True):
        n_white[number] = counted(part, own).shape[1]
        samples = np.arange(record.n_times)[record.stretches[number]][part.kept]
        for storey, missing, sd in missing_forces(model, tuple(part.channels), own[:, part.kept], noise_floors(part)):
            force[storey - 1, samples] = missing / sd
    values, _ = posterior.split(point[None])
    rows = {k: h[0] for k, h in observe(posterior.engine, model, values, record).items()}
    windows = _windows(record)
    conditions = _conditions(rows, record)
    known = force[:, record.kept]
    seen = Disagreement(
        channels=tuple(record.channels),
        noise=noise,
        edges=_edges(record, windows),
        parts=np.array([part for part, _ in windows]),
        by_window=_windowed(scaled, windows),
        by_storey=_windowed(force, windows),
        by_state=_plane(known, {kind: history[:, record.kept] for kind, history in rows.items()}),
        by_condition={name: _concentration(known, mask[:, record.kept]) for name, mask in conditions.items()},
        spots=(),
    )
    return replace(seen, spots=_spots(seen, posterior, n_white))


def missing_forces(
    model: Structure, channels: Sequence[str], residual: Floats, noise: Floats
) -> list[tuple[int, Floats, float]]:
    """Storey, measured minus modelled force [N] and its noise level, where the floors above have sensors.

    Parameters
    ----------
    model : Structure
    channels : sequence of str
        Of one record.
    residual : (n_channels, n_counted) array
        Of each.
    noise : (n_channels,) array
        Noise level of each.
    """
    if model.is_driven:
        return [(1, residual[i], float(noise[i])) for i, name in enumerate(channels) if name == "force"]
    found: list[tuple[int, Floats, float]] = []
    force, variance = np.zeros(residual.shape[1]), 0.0
    if not model.is_chain:
        return []
    for floor in range(model.n_floors, 0, -1):
        name = f"acceleration_{floor}"
        if name not in channels:
            break
        row, mass = channels.index(name), model.masses[floor - 1]
        force, variance = force - mass * residual[row], variance + (mass * float(noise[row])) ** 2
        found.insert(0, (floor, force, float(np.sqrt(variance))))
    return found


def _measuring(record: Record) -> list[int]:
    """Positions of the parts that measure anything."""
    return [number for number, part in enumerate(record.parts) if part.channels]


def _windows(record: Record) -> list[tuple[int, NDArray[np.int64]]]:
    """Windows of equally many samples that count, each with the part it lies in; what measures nothing is one."""
    found = []
    for number, (part, stretch) in enumerate(zip(record.parts, record.stretches, strict=True)):
        samples = np.arange(record.n_times)[stretch]
        if not part.channels:
            found.append((number, samples))
            continue
        own = samples[part.kept]
        n = max(round(N_WINDOWS * len(own) / record.n_counted), _FEWEST_WINDOWS)
        window = (np.arange(len(own)) * n) // len(own)
        found += [(number, own[window == one]) for one in range(n)]
    return found


def _conditions(rows: Mapping[str, Floats], record: Record) -> dict[str, Booleans]:
    """States in which missing effects show, ``(n_storeys, n_times)`` each; no rates where there is no time."""
    z, v, u = (np.abs(rows[kind]) for kind in ("hysteretic_displacement", "drift_rate", "drift"))
    energy = rows["hysteretic_energy"]
    last = np.max([energy[:, stretch.stop - 1] for _, stretch in record.runs], axis=0)[:, None]
    turned = [
        _after_reversals(rows["drift_rate"][:, stretch], part.time_step)
        if record.has_time
        else _after_turns(rows["drift"][:, stretch])
        for part, stretch in zip(record.parts, record.stretches, strict=True)
    ]
    return {
        "at small hysteretic displacement": z < 0.25 * np.max(z, axis=1, keepdims=True),
        "at large drift": u > 0.6 * np.max(u, axis=1, keepdims=True),
        **({"at high drift rate": v > 0.6 * np.max(v, axis=1, keepdims=True)} if record.has_time else {}),
        "just after reversals": np.concatenate(turned, axis=1),
        "once much work is done": energy > 0.6 * np.maximum(last, 1e-300),
        "in one direction, positive drift": rows["drift"] > 0.15 * np.max(u, axis=1, keepdims=True),
        "in one direction, negative drift": rows["drift"] < -0.15 * np.max(u, axis=1, keepdims=True),
    }


def _after_reversals(drift_rate: Floats, time_step: float) -> Booleans:
    """Within 0.1 s after the drift rate changes sign, away from rest."""
    moving = np.max(np.abs(drift_rate), axis=1, keepdims=True) * 0.02
    turned = np.zeros(drift_rate.shape, dtype=np.bool_)
    turned[:, 1:] = (drift_rate[:, 1:] * drift_rate[:, :-1] < 0.0) & (np.abs(np.diff(drift_rate, axis=1)) > 0.0)
    result = np.zeros_like(turned)
    for lag in range(min(max(1, round(0.1 / time_step)), turned.shape[1])):
        result[:, lag:] |= turned[:, : turned.shape[1] - lag]
    window = min(max(1, round(0.5 / time_step)), turned.shape[1])
    envelope = np.array([np.convolve(row, np.ones(window) / window, mode="same") for row in np.abs(drift_rate)])
    return np.asarray(result & (envelope > moving))


def _after_turns(drift: Floats) -> Booleans:
    """Within a tenth of the way of each half cycle."""
    result = np.zeros(drift.shape, dtype=np.bool_)
    for row, after in zip(drift, result, strict=True):
        for half in half_cycles(row):
            after[half.samples] |= np.abs(row[half.samples] - half.start) < _AFTER_A_TURN * half.travel
    return result


def _concentration(force: Floats, mask: Booleans) -> Floats:
    """Share of a known force's energy under a mask over the share of the time; NaN where it is known nowhere."""
    known = np.isfinite(force)
    energy, n_known = np.where(known, np.square(force), 0.0), np.sum(known, axis=1)
    share = np.sum(energy * mask, axis=1) / np.maximum(np.sum(energy, axis=1), 1e-300)
    of_time = np.sum(mask & known, axis=1) / np.maximum(n_known, 1)
    return np.where(n_known > 0, share / np.maximum(of_time, 1e-12), np.nan)


def _plane(force: Floats, rows: Mapping[str, Floats]) -> Floats:
    result = np.full((len(force), N_PLANE, N_PLANE), np.nan)
    for storey, energy in enumerate(np.square(force)):
        known = np.isfinite(energy)
        place = tuple(_bins(rows[kind][storey])[known] for kind in ("drift", "drift_rate"))
        count, total = np.zeros((N_PLANE, N_PLANE)), np.zeros((N_PLANE, N_PLANE))
        np.add.at(count, place, 1.0)
        np.add.at(total, place, energy[known])
        with np.errstate(invalid="ignore"):
            result[storey] = np.sqrt(total / np.where(count > 2, count, np.nan))
    return result


def _bins(history: Floats) -> NDArray[np.int64]:
    peak = max(float(np.max(np.abs(history))), 1e-300)
    return np.clip(((history / peak + 1.0) * 0.5 * N_PLANE).astype(np.int64), 0, N_PLANE - 1)


def _spots(seen: Disagreement, posterior: Posterior, n_white: Floats) -> tuple[Spot, ...]:
    """Runs of windows that stand above the noise, of which each part has so many independent samples."""
    rows, record = seen.rows(posterior.model), posterior.record
    largest = max(float(np.nanmax(row.ratios)) for row in rows)
    spots = []
    for number in _measuring(record):
        inside = seen.parts == number
        n_samples = n_white[number] // np.count_nonzero(inside)
        chance = float(np.sqrt(chi2.isf(_CHANCE / (len(rows) * len(inside)), n_samples) / n_samples))
        part, begin = record.parts[number], float(record.times[record.stretches[number].start])
        for row in rows:
            stands_out = inside & (row.ratios > max(NOTEWORTHY, chance, 0.4 * largest))
            for first, last in _runs(stands_out):
                ratio = float(np.sqrt(np.mean(np.square(row.ratios[first:last]))))
                start, end = (float(edge) - begin for edge in seen.edges[[first, last]])
                end = min(end, part.duration)
                words = _words(seen.by_condition, row.storey) if row.storey is not None else ""
                cycles = None if record.has_time else _cycles(part, start, end)
                stretch = _seconds_in_words(start, end, seen.edges) if cycles is None else cycles_in_words(*cycles)
                where = f"{row.place}, {stretch}{record.of_part(number)}"
                spots.append(
                    Spot(
                        channel=row.channel,
                        start_s=start,
                        end_s=end,
                        residual_to_noise=ratio,
                        sentence=f"{where}{words}: residual {ratio:.1f} times the noise",
                        cycles=cycles,
                        record=record.part_name(number),
                    )
                )
    return tuple(sorted(spots, key=lambda spot: -spot.residual_to_noise))


def _cycles(record: Record, start: float, end: float) -> tuple[int, int]:
    """First and last cycle of a stretch of the record between two instants of its made-up time."""
    numbers = cycle_numbers(record.excitation)[(record.times >= start) & (record.times <= end)]
    return int(numbers[0]), int(numbers[-1])


def _seconds_in_words(start: float, end: float, edges: Floats) -> str:
    """``3 to 5 s``, to twice the width of the windows between these edges, finer where both ends would be the same."""
    digits = max(0, -int(np.floor(np.log10(2.0 * np.median(np.diff(edges)) + 1e-9))))
    digits += f"{start:.{digits}f}" == f"{end:.{digits}f}"
    return f"{start:.{digits}f} to {end:.{digits}f} s"


def cycles_in_words(first: int, last: int) -> str:
    """``cycle 7``, or ``cycles 7 to 9``."""
    return f"cycle {first}" if first == last else f"cycles {first} to {last}"


def _edges(record: Record, windows: Sequence[tuple[int, NDArray[np.int64]]]) -> Floats:
    """Of the windows, on the time of all records [s]."""
    edges: list[float] = []
    for number in range(len(record.parts)):
        own = [samples for part, samples in windows if part == number]
        times = record.times[np.concatenate(own)]
        places = np.linspace(0.0, len(times) - 1.0, len(own) + 1)
        edges = [*edges[: len(edges) - (number > 0)], *np.interp(places, np.arange(len(times)), times).tolist()]
    return np.array(edges)


def _windowed(scaled: Floats, windows: Sequence[tuple[int, NDArray[np.int64]]]) -> Floats:
    """Root mean square of each row in each window."""
    squares = np.square(scaled)
    return np.array([[np.sqrt(np.mean(row[samples])) for _, samples in windows] for row in squares])


def _place(channel: str) -> str:
    kind, _, number = channel.rpartition("_")
    if kind in ("acceleration", "relative_acceleration", "displacement"):
        return f"floor {number}"
    return f"storey {number}" if kind else channel


def _words(by_condition: Mapping[str, Floats], storey: int) -> str:
    strong = {name: float(share[storey]) for name, share in by_condition.items() if np.isfinite(share[storey])}
    chosen = sorted((n for n in strong if strong[n] > _LEAST_CONCENTRATION), key=lambda n: -strong[n])[:2]
    return f", {' and '.join(chosen)}" if chosen else ""


def _runs(mask: Booleans) -> list[tuple[int, int]]:
    steps = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(steps[::2], steps[1::2], strict=True)]


def unexplained_share(before: Disagreement, after: Disagreement) -> float:
    """What is left of the residual energy beyond the noise."""
    excess = [float(np.sum(np.maximum(np.square(one.residual_to_noise) - 1.0, 0.0))) for one in (before, after)]
    return min(excess[1] / excess[0], 1.0) if excess[0] > 0.0 else 0.0
