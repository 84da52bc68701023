"""A truth from the prior of a model file, and its record by the simulator of the blind trials.

The package's table says which value stands at which storey; physics, integration and noise are the simulator's own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np

from benchmarks.blind.simulator import Building, Floats, respond
from benchmarks.blind.storey import Storey
from bwbn_bayes import Record, Uniform
from bwbn_bayes.structures.model_file import ModelFile
from bwbn_bayes.structures.structure import Structure

STEPS_PER_SAMPLE = 40
_LAW = tuple(item.name for item in fields(Storey))


@dataclass(frozen=True, kw_only=True)
class Condition:
    """Under which a truth is recorded.

    Attributes
    ----------
    snr_db : float
        Signal-to-noise ratio of every channel. [dB]
    shaking : float
        Factor on the model file's ground motion.
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
        """The file's building under these priors."""
        if file.model.is_driven or not file.model.is_chain:
            raise ValueError(f"{file.name} is no chain of storeys: the simulator knows no other structure")
        return file.model.with_values({name: Uniform(*ends) for name, ends in self.priors.items()})


CONDITIONS: Mapping[str, Condition] = {
    "regular": Condition(),
    "n near 1": Condition(priors={"n": (1.0, 1.1)}),
    "weak shaking": Condition(shaking=0.2),
    "one floor": Condition(floors=(1,)),
    "100 samples": Condition(n_samples=100),
    "0 dB": Condition(snr_db=0.0),
    "10 dB": Condition(snr_db=10.0),
    "20 dB": Condition(snr_db=20.0),
    "45 dB": Condition(snr_db=45.0),
    "60 dB": Condition(snr_db=60.0),
    "AR(0.3) noise": Condition(colour=0.3),
}


@dataclass(frozen=True, kw_only=True)
class Replicate:
    """A model, a truth of it, and its record."""

    model: Structure
    truth: Mapping[str, float]
    building: Building
    record: Record


def replicate(file: ModelFile, condition: Condition, seed: int, number: int) -> Replicate:
    """Draw a truth from the prior and record it.

    A truth that the simulator cannot follow is drawn again.
    """
    model = condition.model(file)
    rng = np.random.default_rng([seed, number])
    for _ in range(100):
        values = model.space.from_unit(model.space.sample_unit(rng, 1))[0]
        building = building_of(model, values)
        record = recorded(file, building, condition, rng)
        if record is not None:
            truth = dict(zip(model.space.names, values.tolist(), strict=True))
            return Replicate(model=model, truth=truth, building=building, record=record)
    raise ValueError(f"of a hundred truths of {file.name} none could be recorded")


def building_of(model: Structure, values: Floats) -> Building:
    """The simulator's building with a model's values ``(n_dim,)``, its A taken into the other numbers.

    With ``z = A w`` the law of w has A = 1: ``beta A^(n-1)``, ``gamma A^(n-1)``, ``sigma / A``, and a hysteretic spring
    that is A times as stiff.
    """
    storeys = []
    for mass, local in zip(model.masses, model.table.local(values[None])[0], strict=True):
        own = dict(zip((p.symbol for p in model.parameters), local.tolist(), strict=True))
        a, hysteretic, elastic = own.pop("A"), (1.0 - own["alpha"]) * own["k"], own["alpha"] * own["k"]
        own["k"] = elastic + a * hysteretic
        own["alpha"] = elastic / own["k"]
        own |= {name: own[name] * a ** (own["n"] - 1.0) for name in ("beta", "gamma")}
        if "sigma" in own:
            own["sigma"] /= a
        unknown = sorted(set(own) - set(_LAW))
        if unknown:
            raise ValueError(f"the simulator does not know {', '.join(unknown)}")
        storeys.append(Storey(**own, mass=mass))
    return Building(storeys=tuple(storeys))


def recorded(file: ModelFile, building: Building, condition: Condition, rng: np.random.Generator) -> Record | None:
    """The record of a building, or None where it runs away."""
    if file.excitation is None:
        raise ValueError(f"{file.name} has no excitation")
    ground = condition.shaking * file.excitation.excitation[: condition.n_samples]
    motion = respond(building, ground, file.excitation.time_step, STEPS_PER_SAMPLE)
    if not motion.finite:
        return None
    floors = condition.floors or tuple(range(1, len(building.storeys) + 1))
    channels = {}
    for floor in floors:
        signal = motion.measured[floor - 1]
        sd = np.sqrt(np.mean(np.square(signal))) * 10.0 ** (-condition.snr_db / 20.0)
        channels[f"acceleration_{floor}"] = signal + sd * _noise(len(signal), condition.colour, rng)
    bare = replace(file.excitation, excitation=ground)
    return replace(bare, name="calibration", channels=channels)


def _noise(n: int, colour: float, rng: np.random.Generator) -> Floats:
    """Gaussian noise ``(n,)`` of unit variance, autoregressive of first order."""
    fresh = rng.standard_normal(n)
    noise = np.empty(n)
    noise[0] = fresh[0]
    for i in range(1, n):
        noise[i] = colour * noise[i - 1] + np.sqrt(1.0 - colour**2) * fresh[i]
    return noise
