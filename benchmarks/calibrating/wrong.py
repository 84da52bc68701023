"""Records that the model cannot have made: an effect that it lacks, coloured noise, a prior that excludes the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.blind.simulator import Building, Floats, respond
from benchmarks.calibrating.framing import building_of
from benchmarks.calibrating.records import Condition, Replicate, recorded, replicate
from bwbn_bayes import Record, Uniform
from bwbn_bayes.errors import UserError
from bwbn_bayes.structures.model_file import ModelFile

STEPS_PER_SAMPLE = 40
LAG, COLOUR = 0.005, 0.3
"""Of a late sensor [s]; coefficient of coloured noise."""


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """What a storey reaches: peaks of drift [m], rate [m/s], z [m], force [N]; energy [J]; its k [N/m]."""

    drift: float
    rate: float
    z: float
    force: float
    energy: float
    stiffness: float

    @classmethod
    def of(cls, building: Building, drive: Record, storey: int = 1) -> Sizes:
        """Of a storey, from 1, of a building under a ground motion."""
        motion = respond(building, drive.excitation, drive.time_step, STEPS_PER_SAMPLE)
        i = storey - 1
        p = building.storeys[i]
        spring = p.alpha * p.k * motion.drift[i] + (1.0 - p.alpha) * p.k * motion.hysteretic_displacement[i]
        peaks = (motion.drift[i], motion.drift_rate[i], motion.hysteretic_displacement[i], spring)
        drift, rate, z, force = (float(np.max(np.abs(history))) for history in peaks)
        return cls(drift=drift, rate=rate, z=z, force=force, energy=float(motion.energy[i, -1]), stiffness=p.k)


def _size(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


EFFECTS: Mapping[str, Callable[[Sizes, np.random.Generator], Mapping[str, float]]] = {
    "hidden slip": lambda at, rng: {"delta_s": _size(rng, 0.02, 0.1) * at.drift / at.energy, "sigma": 0.3 * at.z},
    "sensor 5 ms late": lambda _at, _rng: {"lag": LAG},
    "cubic stiffness": lambda at, rng: {"k3": _size(rng, 0.03, 0.2) * at.stiffness / at.drift**2},
    "light friction": lambda at, rng: {"F_c": _size(rng, 0.01, 0.05) * at.force, "v0": 0.05 * at.rate},
}
"""What each changes in the first storey, in sizes that the plain building reaches."""
FORCES: Mapping[str, Callable[[Sizes, np.random.Generator], Mapping[str, float]]] = {
    **{name: effect for name, effect in EFFECTS.items() if not name.startswith("sensor")},
    "quadratic damping": lambda at, rng: {"c2": _size(rng, 0.02, 0.1) * at.force / at.rate**2},
    "Maxwell branch": lambda at, rng: {"k_m": _size(rng, 0.03, 0.2) * at.stiffness, "tau": _size(rng, 0.05, 0.5)},
    "backlash": lambda at, rng: {"b": _size(rng, 0.02, 0.1) * at.drift},
    "sudden damage": lambda at, rng: {"k_jump": -_size(rng, 0.03, 0.2) * at.stiffness, "k_time": rng.uniform(2.0, 8.0)},
    "pinch": lambda at, rng: {"pinch": _size(rng, 0.1, 0.5), "pinch_width": 0.3 * at.z},
}
"""What acts in a storey, sensors apart."""
KINDS = (*EFFECTS, "AR(0.3) noise", "prior excludes c")


def wrong_replicate(file: ModelFile, kind: str, snr_db: float, seed: int, number: int) -> Replicate:
    """A truth of the file's prior, recorded with what the model knows nothing of; ``truth`` is that of the model's own.

    Parameters
    ----------
    file : ModelFile
        Of a ShearBuilding whose damping is one number, ``c``.
    kind : str
        One of :data:`KINDS`.
    snr_db : float
        Signal-to-noise ratio. [dB]
    seed, number : int
        Choose truth, size and noise.
    """
    condition = Condition(snr_db=snr_db, colour=COLOUR if kind == "AR(0.3) noise" else 0.0)
    plain = replicate(file, condition, seed, number)
    if kind == "AR(0.3) noise":
        return plain
    if kind == "prior excludes c":
        if "c" not in plain.truth:
            raise UserError(f"{file.name} has no one damping c, which a prior could exclude")
        c = plain.truth["c"]
        prior = Uniform(0.01, 0.7 * c) if c > 0.3 else Uniform(1.3 * c + 0.05, 1.5)
        return replace(plain, model=plain.model.with_values({"c": prior}))
    rng = np.random.default_rng([seed, number, 1])
    building, drive = _shaken(plain, condition.drive(file))
    first, *above = building.storeys
    changed = replace(first, **EFFECTS[kind](Sizes.of(building, drive), rng))
    record = recorded(_clean(replace(building, storeys=(changed, *above)), drive), drive, condition, rng)
    if record is None:
        raise UserError(f"{kind}, number {number}: the record cannot be made")
    return replace(plain, record=record)


def force_replicate(file: ModelFile, snr_db: float, seed: int, number: int) -> tuple[str, Replicate]:
    """A truth of the file's prior with one of :data:`FORCES` in a storey, each at random; its name, and the record.

    What the simulator cannot follow is drawn again.
    """
    condition = Condition(snr_db=snr_db)
    plain = replicate(file, condition, seed, number)
    rng = np.random.default_rng([seed, number, 2])
    building, drive = _shaken(plain, condition.drive(file))
    for _ in range(100):
        kind, storey = str(rng.choice(list(FORCES))), int(rng.integers(len(building.storeys))) + 1
        storeys = list(building.storeys)
        changed = FORCES[kind](Sizes.of(building, drive, storey), rng)
        storeys[storey - 1] = replace(storeys[storey - 1], **changed)
        record = recorded(_clean(replace(building, storeys=tuple(storeys)), drive), drive, condition, rng)
        if record is not None:
            return f"{kind}, storey {storey}", replace(plain, record=record)
    raise UserError(f"number {number} of {file.name}: no force in it can be recorded")


def _shaken(plain: Replicate, drive: Record) -> tuple[Building, Record]:
    """A replicate's building and what shakes it."""
    building = building_of(plain.model, plain.frame)
    if len(drive.runs) > 1 or drive.forces or len({part.time_step for part in drive.parts}) > 1:
        raise UserError("wrong models are drawn under one ground motion alone, without forces on floors")
    return building, drive


def _clean(building: Building, drive: Record) -> dict[str, Floats]:
    """What the floors' sensors show without noise, by channel."""
    measured = respond(building, drive.excitation, drive.time_step, STEPS_PER_SAMPLE).measured
    return {f"acceleration_{floor}": y for floor, y in enumerate(measured, start=1)}
