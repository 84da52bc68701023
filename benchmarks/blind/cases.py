"""Blind cases: a structure, what is hidden in it, a ground motion, noise; a pure function of seed, kind and index."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Literal

import numpy as np

from benchmarks.blind.base_fit import BOUC_WEN, LINEAR, Plain, nats_against
from benchmarks.blind.catalogue_draws import CATALOGUE
from benchmarks.blind.cyclic import CYCLIC, cyclic_test
from benchmarks.blind.draws import Dice, Draw, Hidden, Place, raised, reached
from benchmarks.blind.later_draws import LATER, OF_LINEAR
from benchmarks.blind.more_forms import MORE_FORMS
from benchmarks.blind.other_draws import FORMS, OUTSIDE
from benchmarks.blind.simulator import Building, Floats, Motion, respond
from benchmarks.blind.storey import ultimate_displacement
from bwbn_bayes.records import Envelope, Record, el_centro, filtered_noise

Kind = Literal["catalogue", "none", "forms", "outside", "pairs", "more_forms", "cyclic", "later"]

KINDS: tuple[Kind, ...] = ("catalogue", "none", "forms", "outside", "pairs", "more_forms", "cyclic", "later")
"""A kind's number enters its seeds: new ones come last, and tables that have been drawn from do not grow."""

DETECTABLE_NATS = 40.0

SEVERE_RATIO = 0.85
"""Peak |z| over its bound beyond which a case counts as severe; every other case is."""

LINEAR_DRIFT = 0.5
"""Drift [m] of a storey of a linear building that a motion is scaled by, in the place of the bound of z: such a bound
lies in the middle of the others' priors."""

STARTING_MODEL = "starting model"
"""Given for a cyclic test: what its own columns say."""

_COARSE = 4
_MAX_ATTEMPTS = 200


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What a blind case hides, kept apart from its records.

    Attributes
    ----------
    kind : str
        Column of the trial.
    seed, index : int
        Which case.
    snr_db : float
        Signal-to-noise ratio. [dB of mean square]
    effects : tuple of Hidden
        What is hidden; empty where nothing is.
    base : mapping of str to float
        Base parameters by label.
    severe : bool
        Whether the peak of |z| passes 0.85 of its bound.
    peak_ratio : float
        Largest |z| over its bound (of the base parameters, where these yield), over the storeys.
    excitation : str
        Ground motion of the training record, or the protocol of a cyclic test.
    noise : str
        Kind of noise.
    noise_sd : tuple of float
        Per floor [m/s^2], or of a specimen's force [N].
    held_out_floor : float
        NRMSE of a perfect model on the held-out record: root mean square over the floors of the noise's rms over the
        measured rms; of a specimen, the unnamed force and the digits included.
    nats : tuple of float
        What the fit without each effect leaves behind the truth: one number for a single effect (all of it), one for
        each of a pair (the other kept as it is). [nat]
    unnamed_share : float
        Root mean square of the force that no law has over that of the law's.
    """

    kind: Kind
    seed: int
    index: int
    snr_db: float
    effects: tuple[Hidden, ...]
    base: dict[str, float]
    severe: bool
    peak_ratio: float
    excitation: str
    noise: str
    noise_sd: tuple[float, ...]
    held_out_floor: float
    nats: tuple[float, ...]
    unnamed_share: float = 0.0

    @property
    def detectable(self) -> bool:
        """Whether every hidden effect leaves more than 40 nats."""
        return all(value > DETECTABLE_NATS for value in self.nats)

    def as_json(self) -> dict[str, object]:
        """Plain values, with the verdict on detectability."""
        return {**asdict(self), "detectable": self.detectable}


@dataclass(frozen=True, kw_only=True)
class Case:
    """A training record, a record of the same structure under another motion or protocol, and the truth.

    ``given`` is the model that discovery starts from: a model file's name, or :data:`STARTING_MODEL`.
    """

    name: str
    record: Record
    held_out: Record
    truth: Truth
    given: str


@dataclass(frozen=True, kw_only=True)
class Setting:
    """What the cases of one trial have in common.

    Attributes
    ----------
    n_storeys : int
        Floors of 1 kg each.
    duration : float or None
        Length of both ground motions; all 31 s of El Centro where None. [s]
    raise_by : float
        Share of every size range, from the small end, taken away beside what the noise takes.
    judged : bool
        Whether the base model is fitted to each record to see how much speaks against it.
    """

    n_storeys: int = 3
    duration: float | None = None
    raise_by: float = 0.0
    judged: bool = True


THREE_STOREYS = Setting()


def make_case(kind: Kind, seed: int, index: int, snr_db: float, setting: Setting = THREE_STOREYS) -> Case:
    """Draw one blind case.

    Parameters
    ----------
    kind : {"catalogue", "none", "forms", "outside", "pairs", "more_forms", "cyclic", "later"}
        What is hidden: a catalogued effect, nothing, another form of one, an effect the catalogue lacks, two effects,
        another form out of another table, an effect that joined the catalogue later; or a cyclic test
        (:mod:`benchmarks.blind.cyclic`).
    seed, index : int
        Choose everything else; consecutive indices walk through all effects of the kind, and every other case is
        severe (a cyclic test always is).
    snr_db : float
        Signal-to-noise ratio. [dB of mean square]
    setting : Setting
        Size of the building and of the record; of no account in a cyclic test, but for ``judged``.
    """
    if kind == "cyclic":
        return _cyclic(seed, index, snr_db, setting)
    rng = np.random.default_rng([seed, KINDS.index(kind), index])
    severe = bool(index % 2)
    draws = _draws(kind, seed, index)
    plain = LINEAR if OF_LINEAR & set(draws) else BOUC_WEN
    for _ in range(_MAX_ATTEMPTS):
        drawn = _structure(rng, plain, draws, severe, snr_db, setting)
        if drawn is not None:
            break
    else:
        raise RuntimeError(f"no admissible structure in {_MAX_ATTEMPTS} draws for {kind} case {index}, seed {seed}")
    base, numbers, hidden, motions, responses, ratio = drawn
    correlated = kind == "none" and (index // 2) % 4 == 3
    records, noises = [], []
    for motion, clean, label in zip(motions, responses, ("", "-held-out"), strict=True):
        noise = _noise(rng, clean, snr_db, correlated)
        channels = {f"acceleration_{i + 1}": clean[i] + noise[i] for i in range(setting.n_storeys)}
        records.append(
            Record(
                name=f"case-{index:04d}{label}",
                time_step=motion.time_step,
                excitation=motion.excitation,
                channels=channels,
            )
        )
        noises.append(noise)
    truth = Truth(
        kind=kind,
        seed=seed,
        index=index,
        snr_db=snr_db,
        effects=hidden,
        base=plain.labelled(numbers),
        severe=severe,
        peak_ratio=ratio,
        excitation=motions[0].name,
        noise="AR(1)" if correlated else "white",
        noise_sd=tuple(np.std(noises[0], axis=1).tolist()),
        held_out_floor=_floor(records[1], noises[1]),
        nats=_nats(plain, base, numbers, hidden, records[0], noises[0], rng) if setting.judged else (),
    )
    return Case(name=f"case-{index:04d}", record=records[0], held_out=records[1], truth=truth, given=plain.model)


def _draws(kind: Kind, seed: int, index: int) -> list[Draw]:
    """What is hidden in a case: every run of as many cases as there are effects holds each once, in random order."""
    if kind == "none":
        return []
    if kind == "pairs":
        chosen = np.random.default_rng([seed, 99, index]).choice(len(CATALOGUE), 2, replace=False)
        return [list(CATALOGUE.values())[int(i)] for i in chosen]
    tables = {"catalogue": CATALOGUE, "forms": FORMS, "outside": OUTSIDE, "more_forms": MORE_FORMS, "later": LATER}
    every = list(CYCLIC.values()) if kind == "cyclic" else [(draw,) for draw in tables[kind].values()]
    turn, position = divmod(index, len(every))
    order = np.random.default_rng([seed, 98, KINDS.index(kind), turn]).permutation(len(every))
    return list(every[int(order[position])])


def _cyclic(seed: int, index: int, snr_db: float, setting: Setting) -> Case:
    rng = np.random.default_rng([seed, KINDS.index("cyclic"), index])
    name = f"case-{index:04d}"
    test = cyclic_test(rng, _draws("cyclic", seed, index), snr_db, name, judged=setting.judged)
    base = test.base
    truth = Truth(
        kind="cyclic",
        seed=seed,
        index=index,
        snr_db=snr_db,
        effects=test.hidden,
        base={"k": base.k, "alpha": base.alpha, "beta": base.beta, "gamma": base.gamma, "n": base.n},
        severe=test.peak_ratio > SEVERE_RATIO,
        peak_ratio=test.peak_ratio,
        excitation=test.protocol,
        noise="white, beside an unnamed force",
        noise_sd=(test.noise_sd,),
        held_out_floor=test.held_out_floor,
        nats=test.nats,
        unnamed_share=test.unnamed_share,
    )
    return Case(name=name, record=test.record, held_out=test.held_out, truth=truth, given=STARTING_MODEL)


Drawn = tuple[Building, Floats, tuple[Hidden, ...], list[Record], list[Floats], float]
"""Base structure and its numbers, what is hidden, ground motions, responses without noise, peak of |z|."""


def _structure(
    rng: np.random.Generator, plain: Plain, draws: Sequence[Draw], severe: bool, snr_db: float, setting: Setting
) -> Drawn | None:
    """One attempt; None where the structure is not admissible or misses its severity."""
    lower, upper = plain.box(setting.n_storeys)
    numbers = lower + (0.2 + 0.6 * rng.random(len(lower))) * (upper - lower)
    base = plain.building(numbers)
    if not plain.is_linear and base.storeys[0].beta + base.storeys[0].gamma < 0.5:
        return None
    target = rng.uniform(0.88, 0.98) if severe else rng.uniform(0.35, 0.8)
    shapes = _ground_motions(rng, setting.duration)
    scaled = [_scaled(base, shape, target) for shape in shapes]
    motion = respond(base, scaled[0].excitation, scaled[0].time_step, _COARSE)
    if np.min(motion.energy) < -0.02 * np.max(motion.energy):
        return None  # a loop that gives energy back
    dice = Dice(rng=rng, raise_by=raised(snr_db) + setting.raise_by)
    places = rng.permutation(setting.n_storeys)[: max(len(draws), 1)] + 1
    hidden = []
    for draw, place in zip(draws, places.tolist(), strict=False):
        at = reached(base, motion, scaled[0].excitation, scaled[0].time_step, place)
        hidden.append(draw(Place(dice=dice, at=at, building=base, storey=place)))
    building = _with_all(base, hidden)
    responses = [respond(building, g.excitation, g.time_step) for g in scaled]
    ratio = _peak_ratio(building if plain.is_linear else base, responses[0].hysteretic_displacement)
    if not all(response.finite for response in responses) or (ratio > SEVERE_RATIO) != severe:
        return None
    clean = [response.measured for response in responses]
    return base, numbers, tuple(hidden), scaled, clean, ratio


def _ground_motions(rng: np.random.Generator, duration: float | None) -> list[Record]:
    """El Centro and filtered noise of the same length, in random order."""
    measured = el_centro("chopra", duration=duration)
    made = filtered_noise(
        rng,
        measured.duration,
        measured.time_step,
        peak=1.0,
        ground_frequency_hz=float(rng.uniform(1.5, 3.5)),
        envelope=Envelope(),
    )
    return [measured, made] if rng.random() < 0.5 else [made, measured]


def _scaled(base: Building, shape: Record, target: float) -> Record:
    """The motion scaled until the base structure's peak |z| is about ``target`` of its bound.

    Of one that does not yield it is the drift, of :data:`LINEAR_DRIFT`.
    """
    low, high = np.log(1e-2), np.log(1e2)
    for _ in range(12):
        middle = 0.5 * (low + high)
        motion = respond(base, np.exp(middle) * shape.excitation, shape.time_step, _COARSE)
        enough = not motion.finite or _reach(base, motion) > target
        low, high = (low, middle) if enough else (middle, high)
    # Scales are rounded so that the file reads as a person would have written it.
    scale = float(f"{np.exp(0.5 * (low + high)):.4g}")
    return replace(shape, excitation=scale * shape.excitation)


def _reach(base: Building, motion: Motion) -> float:
    ratio = _peak_ratio(base, motion.hysteretic_displacement)
    return ratio if ratio > 0.0 else float(np.max(np.abs(motion.drift))) / LINEAR_DRIFT


def _peak_ratio(base: Building, z: Floats) -> float:
    bounds = np.array([ultimate_displacement(p) for p in base.storeys])
    return float(np.max(np.max(np.abs(z), axis=1) / bounds))


def _with_all(base: Building, hidden: Sequence[Hidden]) -> Building:
    building = base
    for effect in hidden:
        building = effect.inside(building)
    return building


def _noise(rng: np.random.Generator, clean: Floats, snr_db: float, correlated: bool) -> Floats:
    """Noise ``(n_floors, n_times)`` at the given ratio: white, or AR(1) of the same variance."""
    sd = np.sqrt(np.mean(np.square(clean), axis=1, keepdims=True) * 10.0 ** (-snr_db / 10.0))
    white = rng.standard_normal(clean.shape)
    if not correlated:
        return np.asarray(sd * white)
    memory = rng.uniform(0.3, 0.8)
    noise = white.copy()
    for j in range(1, clean.shape[1]):
        noise[:, j] = memory * noise[:, j - 1] + np.sqrt(1.0 - memory**2) * white[:, j]
    return np.asarray(sd * noise)


def _floor(record: Record, noise: Floats) -> float:
    measured = np.stack(list(record.channels.values()))
    return float(np.sqrt(np.mean(np.mean(np.square(noise), axis=1) / np.mean(np.square(measured), axis=1))))


def _nats(
    plain: Plain,
    base: Building,
    numbers: Floats,
    hidden: Sequence[Hidden],
    record: Record,
    noise: Floats,
    rng: np.random.Generator,
) -> tuple[float, ...]:
    measured = np.stack(list(record.channels.values()))

    def without(others: Sequence[Hidden]) -> float:
        set_by_effects = {(storey, name) for h in others for storey in h.storeys for name in h.storey_values}
        return nats_against(
            plain,
            _with_all(base, others),
            numbers,
            measured,
            noise,
            record.excitation,
            record.time_step,
            rng=rng,
            kept=lambda storey, name: (storey, name) in set_by_effects,
        )

    return tuple(without([other for other in hidden if other is not effect]) for effect in hidden)
