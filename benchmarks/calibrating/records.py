"""A truth from the prior of a model file, and its record by independent simulators: those of the blind trials.

A test of one specimen is followed by that of :mod:`benchmarks.blind.path`, all else by that of
:mod:`benchmarks.calibrating.frame`, with the same law; noise is drawn here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from benchmarks.blind.path import follow
from benchmarks.blind.simulator import Floats
from benchmarks.calibrating.frame import Frame, accelerations
from benchmarks.calibrating.framing import frame_of, has_more_than_a_storey
from bwbn_bayes import Record, Uniform, join_records
from bwbn_bayes.errors import UserError
from bwbn_bayes.records.record import MIN_TIMES
from bwbn_bayes.structures.model_file import ModelFile
from bwbn_bayes.structures.structure import Structure


@dataclass(frozen=True, kw_only=True)
class Condition:
    """Under which a truth is recorded.

    Attributes
    ----------
    snr_db : float
        Signal-to-noise ratio of every channel, of several records of each. [dB]
    shaking : float
        Factor on what drives the model file's structure.
    n_samples : int, optional
        The first of them alone are recorded.
    floors : tuple of int, optional
        Those with a sensor; all by default.
    colour : float
        Coefficient of the noise as an autoregression of first order.
    priors : mapping of str to tuple of float
        Ends of other uniform priors, of truth and model alike.
    """

    snr_db: float = 30.0
    shaking: float = 1.0
    n_samples: int | None = None
    floors: tuple[int, ...] | None = None
    colour: float = 0.0
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def model(self, file: ModelFile) -> Structure:
        """The file's structure under these priors."""
        values: dict[str, Uniform] = {}
        for symbol, ends in self.priors.items():
            own = [one.name for one in file.model.space.parameters if one.symbol == symbol]
            if not own:
                raise UserError(f"{file.name} identifies no {symbol}: take another condition")
            values |= dict.fromkeys(own, Uniform(*ends))
        return file.model.with_values(values)

    def drive(self, file: ModelFile) -> Record:
        """What moves the structure."""
        if file.excitation is None:
            raise UserError(f"{file.name} has no excitation")
        drive = file.excitation if self.n_samples is None else shortened(file.excitation, self.n_samples)
        forces = {name: self.shaking * force for name, force in drive.forces.items()}
        return drive.driven_by(self.shaking * drive.excitation, forces)


CONDITIONS: Mapping[str, Condition] = {
    "regular": Condition(),
    "n near 1": Condition(priors={"n": (1.0, 1.1)}),
    "weak shaking": Condition(shaking=0.2),
    "one floor": Condition(floors=(1,)),
    "100 samples": Condition(n_samples=100),
    "0 dB": Condition(snr_db=0.0),
    "10 dB": Condition(snr_db=10.0),
    "20 dB": Condition(snr_db=20.0),
    "40 dB": Condition(snr_db=40.0),
    "45 dB": Condition(snr_db=45.0),
    "60 dB": Condition(snr_db=60.0),
    "AR(0.3) noise": Condition(colour=0.3),
}


@dataclass(frozen=True, kw_only=True)
class Replicate:
    """A model, a truth of it, and its record."""

    model: Structure
    truth: Mapping[str, float]
    frame: Frame
    record: Record


def replicate(file: ModelFile, condition: Condition, seed: int, number: int) -> Replicate:
    """Draw a truth from the prior and record it.

    A truth that the simulator cannot follow is drawn again.
    """
    model, drive = condition.model(file), condition.drive(file)
    rng = np.random.default_rng([seed, number])
    for _ in range(100):
        values = model.space.from_unit(model.space.sample_unit(rng, 1))[0]
        frame = frame_of(model, values)
        record = recorded(clean(file, model, frame, drive), drive, condition, rng)
        if record is not None:
            truth = dict(zip(model.space.names, values.tolist(), strict=True))
            return Replicate(model=model, truth=truth, frame=frame, record=record)
    raise UserError(f"of a hundred truths of {file.name} none could be recorded")


def clean(file: ModelFile, model: Structure, frame: Frame, drive: Record) -> dict[str, Floats]:
    """What sensors show without noise, by channel: the floors' accelerations, or a specimen's force."""
    if model.is_driven:
        if drive.time_step != 1.0:
            raise UserError(f"{file.name}: the independent simulator takes a specimen's points one second apart")
        (link,) = frame.links
        if has_more_than_a_storey(link):
            raise UserError(f"{file.name}: the independent simulator follows no specimen whose numbers jump or slide")
        return {"force": np.concatenate([follow(link, drive.excitation[where]).force for _, where in drive.runs])}
    rows: list[Floats] = []
    for run, where in drive.runs:
        steps = {part.time_step for part in run.parts}
        if len(steps) > 1:
            raise UserError(f"{file.name}: the independent simulator takes a sequence of one time step alone")
        forces = np.zeros((len(frame.masses), run.n_times))
        for floor, force in zip(run.forced_floors, run.forces.values(), strict=True):
            forces[floor - 1] += force
        rows.append(accelerations(frame, drive.excitation[where], forces, steps.pop()))
    return {f"acceleration_{floor}": y for floor, y in enumerate(np.concatenate(rows, axis=1), start=1)}


def recorded(
    signals: Mapping[str, Floats], drive: Record, condition: Condition, rng: np.random.Generator
) -> Record | None:
    """What was measured under a drive, with noise; None where the structure runs away."""
    if not all(np.isfinite(y).all() for y in signals.values()):
        return None
    if condition.floors is not None:
        names = [f"acceleration_{floor}" for floor in condition.floors]
        if not set(names) < set(signals):
            raise UserError(f"{', '.join(names)} is all that can be measured, or is not: take another condition")
        signals = {name: signals[name] for name in names}
    noisy = {name: y.copy() for name, y in signals.items()}
    for where in drive.stretches:
        for signal in noisy.values():
            part = signal[where]
            sd = np.sqrt(np.mean(np.square(part))) * 10.0 ** (-condition.snr_db / 20.0)
            part += sd * _noise(len(part), condition.colour, rng)
    return drive.with_channels(noisy)


def shortened(drive: Record, n_samples: int) -> Record:
    """The first samples of what drives."""
    if len(drive.parts) == 1:
        return drive.until((n_samples - 1) * drive.time_step)
    kept = [
        part.until(min(n_samples - where.start, part.n_times) * part.time_step - part.time_step)
        for part, where in zip(drive.parts, drive.stretches, strict=True)
        if n_samples - where.start >= MIN_TIMES
    ]
    return join_records(kept, in_sequence=drive.is_sequence)


def _noise(n: int, colour: float, rng: np.random.Generator) -> Floats:
    """Gaussian noise ``(n,)`` of unit variance, autoregressive of first order."""
    fresh = rng.standard_normal(n)
    noise = np.empty(n)
    noise[0] = fresh[0]
    for i in range(1, n):
        noise[i] = colour * noise[i - 1] + np.sqrt(1.0 - colour**2) * fresh[i]
    return noise
