"""Where model and measurement disagree: by channel and time, by storey and state, in sentences.

The yardstick is a model-free estimate of the noise, not the misfit. With known masses the storey force itself is
measured, ``V_i = -sum_{j>=i} m_j a_j``, so that a residual force exists at every storey that has sensors above it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.residuals import counted, noise_floors, residual_of
from bwbn_bayes.inference.summary import observe
from bwbn_bayes.parameters import Booleans, Floats
from bwbn_bayes.records.cycles import cycle_numbers, half_cycles
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure

SPECIMEN = "the specimen"
"""The one place in a testing machine, in words."""

N_WINDOWS = 24
N_PLANE = 12
"""Bins of drift and of drift rate."""
NOTEWORTHY = 1.3
"""Residual to noise from which a window is worth a sentence, if noise alone seldom reaches it anywhere."""
_AFTER_A_TURN = 0.1
"""Share of a half cycle's way that is just after its turn, where there is no time to tell it by."""
_CHANCE = 0.01
_LEAST_CONCENTRATION = 1.3


def storey_in_words(model: Structure, number: int) -> str:
    """``storey 2``, or ``the specimen`` in a testing machine."""
    return f"storey {number}" if not model.is_driven else SPECIMEN


@dataclass(frozen=True, kw_only=True)
class Spot:
    """A stretch of time in which a channel's residual stands out.

    Attributes
    ----------
    channel : str
    start_s, end_s : float
        [s]
    cycles : (int, int) or None
        The cycles in which it begins and ends, from 1, of a record that has no time: its seconds mean nothing.
    residual_to_noise : float
        Root mean square of the residual over the noise level.
    sentence : str
    """

    channel: str
    start_s: float
    end_s: float
    residual_to_noise: float
    sentence: str
    cycles: tuple[int, int] | None = None


@dataclass(frozen=True, kw_only=True)
class Row:
    """Residual to noise ``(n_windows,)`` of a storey's force, storeys counted from 0, or of a channel (None)."""

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
    noise : (n_channels,) array
        Model-free noise level. [unit of the channel]
    edges : (n_windows + 1,) array
        Of the time windows. [s]
    by_window : (n_channels, n_windows) array
        Residual to noise.
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
    by_window: Floats
    by_storey: Floats
    by_state: Floats
    by_condition: Mapping[str, Floats]
    spots: tuple[Spot, ...]

    @property
    def residual_to_noise(self) -> Floats:
        """Each channel's residual over its noise level, ``(n_channels,)``."""
        return np.asarray(np.sqrt(np.mean(np.square(self.by_window), axis=1)))

    def rows(self, model: Structure) -> tuple[Row, ...]:
        """Storey forces where they are measured, and the channels that these leave out.

        A storey's force goes by the channel of the floor above it, a specimen's by its own.
        """
        rows = []
        for i, ratios in enumerate(self.by_storey):
            if np.all(np.isfinite(ratios)):
                own = next(name for name in (f"acceleration_{i + 1}", "force") if name in self.channels)
                rows.append(Row(channel=own, place=storey_in_words(model, i + 1), storey=i, ratios=ratios))
        told = {row.channel for row in rows}
        for name, ratios in zip(self.channels, self.by_window, strict=True):
            if name not in told:
                rows.append(Row(channel=name, place=_place(name), storey=None, ratios=ratios))
        return tuple(rows)


def disagreement(posterior: Posterior, point: Floats) -> Disagreement:
    """Compare a fit with its record at a point ``(n_dim,)`` of the unit cube."""
    record = posterior.record
    channels = tuple(record.channels)
    residual = residual_of(posterior, point)
    n_white = counted(record, residual).shape[1]
    residual = residual[:, record.kept]
    noise = noise_floors(record)
    edges = _edges(record.times[record.kept])
    by_window = _windowed(residual / noise[:, None])
    values, _ = posterior.split(point[None])
    rows = {k: h[0] for k, h in observe(posterior.engine, posterior.model, values, record).items()}
    force = np.full((posterior.model.n_links, record.n_counted), np.nan)
    for storey, missing, sd in missing_forces(posterior, residual, noise):
        force[storey - 1] = missing / sd
    by_storey = _windowed(force)
    conditions = _conditions(rows, record)
    by_condition = {name: _concentration(force, mask[:, record.kept]) for name, mask in conditions.items()}
    rows = {kind: history[:, record.kept] for kind, history in rows.items()}
    seen = Disagreement(
        channels=channels,
        noise=noise,
        edges=edges,
        by_window=by_window,
        by_storey=by_storey,
        by_state=_plane(force, rows),
        by_condition=by_condition,
        spots=(),
    )
    return replace(seen, spots=_spots(seen, posterior, n_white // N_WINDOWS))


def missing_forces(posterior: Posterior, residual: Floats, noise: Floats) -> list[tuple[int, Floats, float]]:
    """Storey, measured minus modelled force [N] and its noise level, where the floors above have sensors.

    Parameters
    ----------
    posterior : Posterior
    residual : (n_channels, n_counted) array
        Of its record's channels.
    noise : (n_channels,) array
        Noise level of each.
    """
    model, channels = posterior.model, list(posterior.record.channels)
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


def _conditions(rows: Mapping[str, Floats], record: Record) -> dict[str, Booleans]:
    """States in which missing effects show, ``(n_storeys, n_times)`` each; no rates where there is no time."""
    z, v, u = (np.abs(rows[kind]) for kind in ("hysteretic_displacement", "drift_rate", "drift"))
    energy = rows["hysteretic_energy"]
    last = np.maximum(energy[:, -1:], 1e-300)
    return {
        "at small hysteretic displacement": z < 0.25 * np.max(z, axis=1, keepdims=True),
        "at large drift": u > 0.6 * np.max(u, axis=1, keepdims=True),
        **({"at high drift rate": v > 0.6 * np.max(v, axis=1, keepdims=True)} if record.has_time else {}),
        "just after reversals": (
            _after_reversals(rows["drift_rate"], record.time_step) if record.has_time else _after_turns(rows["drift"])
        ),
        "once much work is done": energy > 0.6 * last,
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
    energy = np.square(force)
    share = np.sum(energy * mask, axis=1) / np.maximum(np.sum(energy, axis=1), 1e-300)
    return np.asarray(share / np.maximum(np.mean(mask, axis=1), 1e-12))


def _plane(force: Floats, rows: Mapping[str, Floats]) -> Floats:
    result = np.full((len(force), N_PLANE, N_PLANE), np.nan)
    for storey, energy in enumerate(np.square(force)):
        place = [_bins(rows[kind][storey]) for kind in ("drift", "drift_rate")]
        count, total = np.zeros((N_PLANE, N_PLANE)), np.zeros((N_PLANE, N_PLANE))
        np.add.at(count, tuple(place), 1.0)
        np.add.at(total, tuple(place), energy)
        with np.errstate(invalid="ignore"):
            result[storey] = np.sqrt(total / np.where(count > 2, count, np.nan))
    return result


def _bins(history: Floats) -> NDArray[np.int64]:
    peak = max(float(np.max(np.abs(history))), 1e-300)
    return np.clip(((history / peak + 1.0) * 0.5 * N_PLANE).astype(np.int64), 0, N_PLANE - 1)


def _spots(seen: Disagreement, posterior: Posterior, n_samples: int) -> tuple[Spot, ...]:
    """Runs of windows, of so many independent samples each, that stand above the noise."""
    rows, record = seen.rows(posterior.model), posterior.record
    largest = max(float(np.max(row.ratios)) for row in rows)
    chance = float(np.sqrt(chi2.isf(_CHANCE / (len(rows) * N_WINDOWS), n_samples) / n_samples))
    spots = []
    for row in rows:
        for first, last in _runs(row.ratios > max(NOTEWORTHY, chance, 0.4 * largest)):
            ratio = float(np.sqrt(np.mean(np.square(row.ratios[first:last]))))
            start, end = float(seen.edges[first]), float(seen.edges[last])
            words = _words(seen.by_condition, row.storey) if row.storey is not None else ""
            cycles = None if record.has_time else _cycles(record, start, end)
            stretch = f"{start:.0f} to {end:.0f} s" if cycles is None else cycles_in_words(*cycles)
            spots.append(
                Spot(
                    channel=row.channel,
                    start_s=start,
                    end_s=end,
                    residual_to_noise=ratio,
                    sentence=f"{row.place}, {stretch}{words}: residual {ratio:.1f} times the noise",
                    cycles=cycles,
                )
            )
    return tuple(sorted(spots, key=lambda spot: -spot.residual_to_noise))


def _cycles(record: Record, start: float, end: float) -> tuple[int, int]:
    """First and last cycle of a stretch of the record between two instants of its made-up time."""
    numbers = cycle_numbers(record.excitation)[(record.times >= start) & (record.times <= end)]
    return int(numbers[0]), int(numbers[-1])


def cycles_in_words(first: int, last: int) -> str:
    """``cycle 7``, or ``cycles 7 to 9``."""
    return f"cycle {first}" if first == last else f"cycles {first} to {last}"


def _edges(times: Floats) -> Floats:
    """Of windows of equally many samples that count, which lie at ``times (n_counted,)`` [s]."""
    places = np.linspace(0.0, len(times) - 1.0, N_WINDOWS + 1)
    return np.asarray(np.interp(places, np.arange(len(times)), times))


def _windowed(scaled: Floats) -> Floats:
    """Root mean square of each row in each window."""
    n = scaled.shape[1]
    window = np.minimum((np.arange(n) * N_WINDOWS) // n, N_WINDOWS - 1)
    squares = np.array([[np.mean(np.square(row[window == w])) for w in range(N_WINDOWS)] for row in scaled])
    return np.asarray(np.sqrt(squares))


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
