"""Random sizes of effects: what is hidden in a blind record, how large, and under which name it is to be found.

Sizes are log-uniform over the ranges stated here, in units of what the base structure reaches under the same ground
motion, so that one range suits every structure. With more noise the small end moves up (:func:`raised`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.blind.simulator import Building, Floats, Motion
from benchmarks.blind.storey import Storey, ultimate_displacement


@dataclass(frozen=True, kw_only=True)
class Reached:
    """What the base structure reaches at one storey.

    Attributes
    ----------
    drift, rate, z, z_bound, force, energy, path, acceleration : float
        Peaks of drift, rate, z (and its bound) and force, final energy, length of the drift's path, rms acceleration.
        [m], [m/s], [m], [m], [N], [J], [m], [m/s^2]
    base_shear : float
        Peak of the force on what the building stands on, a slab like the first floor included. [N]
    strong_from, strong_until : float
        Times by which a tenth and seven tenths of the ground motion's energy have arrived. [s]
    omegas : tuple of float
        Angular frequencies of the undamaged building. [1/s]
    """

    drift: float
    rate: float
    z: float
    z_bound: float
    force: float
    energy: float
    path: float
    acceleration: float
    base_shear: float
    strong_from: float
    strong_until: float
    omegas: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """One effect hidden in a record.

    Attributes
    ----------
    name : str
        Canonical name, or the name of an effect that the catalogue lacks.
    storeys : tuple of int
        Its storey or floor; empty for an effect of the whole building.
    form : str
        Which form of the effect; empty for the catalogue's own.
    accepted : tuple of str
        Names that count as right.
    why : str
        Why they do, where the law is not the catalogue's.
    storey_values, whole_values : mapping of str to float
        What it changes in that storey, or in the whole.
    parameters : mapping of str to float
        True values of the catalogue's symbols, where the parametrisation is the same.
    """

    name: str
    storeys: tuple[int, ...]
    form: str = ""
    accepted: tuple[str, ...] = ()
    why: str = ""
    storey_values: Mapping[str, float] = field(default_factory=dict)
    whole_values: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)

    def inside(self, building: Building) -> Building:
        """The building with this effect in it."""
        storeys = tuple(
            replace(p, **self.storey_values) if number in self.storeys else p
            for number, p in enumerate(building.storeys, start=1)
        )
        return Building(storeys=storeys, whole=replace(building.whole, **self.whole_values))


@dataclass(frozen=True, kw_only=True)
class Dice:
    """Randomness with the range raised for the noise.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of randomness.
    raise_by : float
        The share of a range's logarithmic length, from the small end, that the noise takes away.
    """

    rng: np.random.Generator
    raise_by: float = 0.0

    def size(self, low: float, high: float) -> float:
        """A size, log-uniform over the raised range."""
        start = low * (high / low) ** self.raise_by
        return float(np.exp(self.rng.uniform(np.log(start), np.log(high))))

    def signed(self, low: float, high: float) -> float:
        """A size of either sign."""
        return self.size(low, high) * float(self.rng.choice([-1.0, 1.0]))

    def anywhere(self, low: float, high: float) -> float:
        """A nuisance, uniform over its range whatever the noise."""
        return float(self.rng.uniform(low, high))


def raised(snr_db: float) -> float:
    """Share of the size range that the noise takes away: none at 40 dB and above, six tenths at 10 dB."""
    return float(np.clip((40.0 - snr_db) / 50.0, 0.0, 0.6))


def reached(building: Building, motion: Motion, ground: Floats, time_step: float, storey: int) -> Reached:
    """Measure the base structure's response at a storey (from 1)."""
    i, p = storey - 1, building.storeys[storey - 1]
    z, drift = motion.hysteretic_displacement[i], motion.drift[i]
    force = p.alpha * p.k * drift + (1.0 - p.alpha) * p.k * z + p.c * motion.drift_rate[i]
    share = np.cumsum(np.square(ground)) / np.sum(np.square(ground))
    k = np.array([storey.k for storey in building.storeys])
    matrix = np.diag(k + np.append(k[1:], 0.0)) - np.diag(k[1:], 1) - np.diag(k[1:], -1)
    masses = np.sqrt([storey.mass for storey in building.storeys])
    inertia = [p.mass * total for p, total in zip(building.storeys, motion.measured, strict=True)]
    shear = building.storeys[0].mass * ground + np.sum(inertia, axis=0)
    return Reached(
        drift=float(np.max(np.abs(drift))),
        rate=float(np.max(np.abs(motion.drift_rate[i]))),
        z=float(np.max(np.abs(z))),
        z_bound=ultimate_displacement(p),
        force=float(np.max(np.abs(force))),
        energy=float(np.max(motion.energy[i])),
        path=float(np.sum(np.abs(np.diff(drift)))),
        acceleration=float(np.sqrt(np.mean(np.square(motion.measured[i])))),
        base_shear=float(np.max(np.abs(shear))),
        strong_from=float(time_step * np.searchsorted(share, 0.1)),
        strong_until=float(time_step * np.searchsorted(share, 0.7)),
        omegas=tuple(np.sqrt(np.linalg.eigvalsh(matrix / np.outer(masses, masses))).tolist()),
    )


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where an effect is to be hidden: dice, what the base structure reaches there, the building, the storey."""

    dice: Dice
    at: Reached
    building: Building
    storey: int

    @property
    def own(self) -> Storey:
        """The storey itself."""
        return self.building.storeys[self.storey - 1]


Draw = Callable[[Place], Hidden]


def at_storey(
    name: str, storey: int, values: Mapping[str, float], parameters: Mapping[str, float] | None = None
) -> Hidden:
    """An effect at one storey; its values are the catalogue's parameters unless others are given."""
    return Hidden(
        name=name,
        storeys=(storey,),
        accepted=(name,),
        storey_values=values,
        parameters=dict(values) if parameters is None else parameters,
    )


def in_whole(name: str, values: Mapping[str, float], parameters: Mapping[str, float]) -> Hidden:
    """An effect of the whole building."""
    return Hidden(name=name, storeys=(), accepted=(name,), whole_values=values, parameters=parameters)


def other_form(
    name: str, form: str, storey: int, values: Mapping[str, float], accepted: tuple[str, ...] = ()
) -> Hidden:
    """The same effect by another law: its parameters are not the catalogue's."""
    return Hidden(name=name, storeys=(storey,), form=form, accepted=(name, *accepted), storey_values=values)
