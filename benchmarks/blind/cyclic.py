"""Blind cyclic tests: force against displacement, quasi-static and without time, with model error besides noise.

A specimen of the kind that laboratories test: amplitudes grow and are repeated, the law may wear and pinch, a smooth
force that no law has stands beside it, and what is written was digitised. A twin of it, under another protocol, is held
out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from benchmarks.blind.catalogue_draws import CATALOGUE
from benchmarks.blind.draws import Dice, Draw, Hidden, Place, Reached, at_storey
from benchmarks.blind.more_forms import (
    slip_saturating,
    stiffness_saturating,
    stiffness_with_cycles,
    strength_saturating,
    strength_with_cycles,
)
from benchmarks.blind.path import COARSE, Loop, follow, with_shape
from benchmarks.blind.simulator import Building, Floats
from benchmarks.blind.storey import Storey, ultimate_displacement
from benchmarks.blind.unnamed import unnamed_force
from bwbn_bayes.records import Record

QUIETER_DB = 30.0
"""Better than the trial's ratio, as a load cell's is: at 30 dB, 0.1 % of the force."""
UNNAMED = (0.01, 0.08)
"""Root mean square of the unnamed force over that of the law's: at 30 dB 10 to 80 times the noise, as model error is in
measured tests (10 to 300 times)."""
RAISE_BY, RAISE_BESIDE = 0.4, 0.75
"""Of every size range, from the small end: what model error would hide, alone and beside another effect."""
PARTS = (400.0, 2000.0)
"""Of the peak: a digitiser's steps are the next smaller power of ten."""
TWIN_REACHES = 0.9
"""Of the largest displacement: what the twin's protocol goes to, so that nothing is extrapolated."""
PINCHED = 0.25
"""Force at zero displacement over the half cycle's peak, below which a loop is pinched to the eye: what hides a pinch
shows one, as the columns that are called pinched do (0.05 to 0.2)."""
PINCHES = ("slip_lock", "foliente_pinching")
_EITHER = "under model error the loop says that it is pinched, not by whose law"
MOST_ATTEMPTS = 400

_BOX = np.array([[-2.0, -0.3, -1.5, 0.2, 1.0], [2.0, 0.6, 1.5, 2.5, 6.0]])
"""Ends of the plain law's numbers in a fit; the first and the third are logarithms over the truth."""


def _cubic(here: Place) -> Hidden:
    """In units of the force, which after yield is far below k times the drift."""
    return at_storey(
        "cubic_stiffness", here.storey, {"k3": here.dice.size(0.05, 0.8) * here.at.force / here.at.drift**3}
    )


def _stop(here: Place) -> Hidden:
    stiffness = here.dice.size(0.2, 3.0) * here.at.force / here.at.drift
    return at_storey("gap_impact", here.storey, {"k_g": stiffness, "g": here.dice.anywhere(0.4, 0.7) * here.at.drift})


def _slip(here: Place) -> Hidden:
    values = {
        "delta_s": here.dice.size(0.3, 4.0) * here.at.drift / here.at.energy,
        "sigma": here.dice.anywhere(0.1, 0.4) * here.at.z,
    }
    return replace(at_storey("slip_lock", here.storey, values), accepted=PINCHES, why=_EITHER)


def _slip_saturating(here: Place) -> Hidden:
    """Larger than in a building: the loop is to be pinched to the eye."""
    drawn = slip_saturating(here)
    larger = {"slip_wear": here.dice.size(0.15, 1.0) * here.at.drift, "sigma": here.dice.anywhere(0.1, 0.4) * here.at.z}
    return replace(drawn, storey_values={**drawn.storey_values, **larger})


def _pinch(here: Place) -> Hidden:
    values = {
        "zeta_s": here.dice.size(0.6, 0.98),
        "p": here.dice.anywhere(4.0, 30.0) / here.at.energy,
        "q": here.dice.anywhere(0.0, 0.25) * here.at.z / here.at.z_bound,
        "psi_0": here.dice.anywhere(0.4, 1.0) * here.at.z,
        "delta_psi": here.dice.anywhere(0.0, 0.3) * here.at.z / here.at.energy,
        "lambda_": here.dice.anywhere(0.1, 0.5),
    }
    return replace(at_storey("foliente_pinching", here.storey, values), accepted=PINCHES, why=_EITHER)


_STIFFNESS, _STRENGTH = CATALOGUE["stiffness_degradation"], CATALOGUE["strength_degradation"]

CYCLIC: dict[str, tuple[Draw, ...]] = {
    "nothing": (),
    "nothing, again": (),
    "stiffness": (_STIFFNESS,),
    "strength": (_STRENGTH,),
    "slip": (_slip,),
    "pinch": (_pinch,),
    "asymmetry": (CATALOGUE["asymmetry"],),
    "spring": (_cubic,),
    "stop": (_stop,),
    "play": (CATALOGUE["backlash"],),
    "stiffness, saturating": (stiffness_saturating,),
    "strength, saturating": (strength_saturating,),
    "strength, with cycles": (strength_with_cycles,),
    "slip, saturating": (_slip_saturating,),
    "pinch and strength": (_pinch, _STRENGTH),
    "slip and strength, with cycles": (_slip, strength_with_cycles),
    "stiffness, with cycles": (stiffness_with_cycles,),
    "pinch and strength, saturating": (_pinch, strength_saturating),
    "pinch, stiffness and strength": (_pinch, _STIFFNESS, _STRENGTH),
    "slip, stiffness and strength": (_slip, _STIFFNESS, _STRENGTH),
}
"""What is hidden. Dry friction is left out: without time it is one more hysteretic spring. No two of one specimen wear
by a scale of their own."""


@dataclass(frozen=True, kw_only=True)
class CyclicTest:
    """A drawn test.

    Attributes
    ----------
    record, held_out : Record
        As digitised; the held-out one is a twin under another protocol.
    hidden : tuple of Hidden
    base : Storey
        The law without what is hidden.
    protocol : str
        In words.
    peak_ratio : float
        Largest |z| of the base over its bound.
    noise_sd : float
        [N]
    unnamed_share : float
        Root mean square of the unnamed force over that of the law's.
    held_out_floor : float
        NRMSE of the true law on the held-out record: noise, unnamed force and digits.
    nats : tuple of float
        See :class:`benchmarks.blind.cases.Truth`; what the unnamed force leaves counts as correlated noise.
    """

    record: Record
    held_out: Record
    hidden: tuple[Hidden, ...]
    base: Storey
    protocol: str
    peak_ratio: float
    noise_sd: float
    unnamed_share: float
    held_out_floor: float
    nats: tuple[float, ...]


def cyclic_test(
    rng: np.random.Generator, draws: Sequence[Draw], snr_db: float, name: str, *, judged: bool
) -> CyclicTest:
    """Draw a specimen and test it.

    Parameters
    ----------
    rng : numpy.random.Generator
    draws : sequence of Draw
        What to hide.
    snr_db : float
        That of the other kinds; the force's own is 30 dB better. [dB of mean square]
    name : str
        Of the records.
    judged : bool
        Whether the plain law is fitted to see how much speaks against it.
    """
    specimen = _specimen(rng, draws)
    rms = float(np.sqrt(np.mean(np.square(specimen.loop.force))))
    share = math.exp(rng.uniform(*np.log(UNNAMED)))
    beside = unnamed_force(rng, specimen.loop, share * rms)
    sd = rms * 10.0 ** (-(snr_db + QUIETER_DB) / 20.0)
    parts = rng.uniform(*PARTS, size=2)
    record, held_out = (
        _digitised(loop, loop.force + beside.along(loop) + sd * rng.standard_normal(len(loop.force)), parts, label)
        for loop, label in ((specimen.loop, name), (specimen.twin, f"{name}-held-out"))
    )
    missed = held_out.channels["force"] - specimen.twin.force
    return CyclicTest(
        record=record,
        held_out=held_out,
        hidden=specimen.hidden,
        base=specimen.base,
        protocol=specimen.protocol,
        peak_ratio=specimen.peak_ratio,
        noise_sd=sd,
        unnamed_share=share,
        held_out_floor=float(np.sqrt(np.mean(np.square(missed)) / np.mean(np.square(held_out.channels["force"])))),
        nats=_nats(specimen.base, specimen.hidden, record, rng) if judged else (),
    )


@dataclass(frozen=True, kw_only=True)
class _Specimen:
    """The plain law, what is hidden in it, and the loops of both tests without noise."""

    base: Storey
    hidden: tuple[Hidden, ...]
    loop: Loop
    twin: Loop
    peak_ratio: float
    protocol: str


def _specimen(rng: np.random.Generator, draws: Sequence[Draw]) -> _Specimen:
    for _ in range(MOST_ATTEMPTS):
        base = _base(rng)
        bound = ultimate_displacement(base)
        ductility, n_steps, n_repeats = rng.uniform(3.0, 10.0), int(rng.integers(6, 10)), int(rng.integers(2, 4))
        history = _history(rng, ductility * bound, n_steps, n_repeats)
        other = _history(rng, TWIN_REACHES * ductility * bound, int(rng.integers(5, 8)), n_repeats)
        plain = follow(base, history)
        hidden = _hide(rng, base, history, draws)
        law = _with_all(base, hidden)
        loop, twin = follow(law, history), follow(law, other)
        pinched = zero_force_ratio(loop) < PINCHED or not any(effect.name in PINCHES for effect in hidden)
        if loop.finite and twin.finite and pinched:
            return _Specimen(
                base=base,
                hidden=hidden,
                loop=loop,
                twin=twin,
                peak_ratio=float(np.max(np.abs(plain.hysteretic_displacement)) / bound),
                protocol=f"{n_steps} amplitudes to {ductility:.2g} times yield, {n_repeats} times each",
            )
    raise RuntimeError(f"no specimen that can be solved in {MOST_ATTEMPTS} draws")


def _hide(rng: np.random.Generator, base: Storey, history: Floats, draws: Sequence[Draw]) -> tuple[Hidden, ...]:
    """Draw one effect after the other, each by what the specimen reaches with those before it.

    A pinched loop does less work; what stands beside a pinch is drawn from the upper end, or would not show.
    """
    hidden: tuple[Hidden, ...] = ()
    for draw in draws:
        at = _reached(base, follow(_with_all(base, hidden), history))
        dice = Dice(rng=rng, raise_by=RAISE_BESIDE if hidden else RAISE_BY)
        hidden += (draw(Place(dice=dice, at=at, building=Building(storeys=(base,)), storey=1)),)
    return hidden


def zero_force_ratio(loop: Loop) -> float:
    """Force where the displacement comes back to zero over the half cycle's peak; median over the large half cycles.

    A half cycle lies between two zeros of the displacement, and is large where it passes half of the largest.
    """
    u, force = loop.displacement, loop.force
    least, first, ratios = 0.5 * np.max(np.abs(u)), 0, []
    for i in np.flatnonzero(u[:-1] * u[1:] < 0.0).tolist():
        half = slice(first, i + 1)
        if np.max(np.abs(u[half])) >= least:
            at_zero = force[i] + u[i] / (u[i] - u[i + 1]) * (force[i + 1] - force[i])
            ratios.append(abs(at_zero) / np.max(np.abs(force[half])))
        first = i + 1
    return float(np.median(ratios))


def _base(rng: np.random.Generator) -> Storey:
    """A plain law of a laboratory's size: 1 to 100 MN/m, yield at 2 to 12 mm."""
    numbers = [
        rng.uniform(math.log(1e6), math.log(1e8)),
        rng.uniform(0.0, 0.15),
        rng.uniform(math.log(2e-3), math.log(1.2e-2)),
        rng.uniform(0.4, 1.1),
        rng.uniform(1.0, 3.0),
    ]
    return with_shape(Storey(k=1.0, c=0.0, alpha=0.0, beta=0.5, gamma=0.5, n=1.0), np.array(numbers))


def _history(rng: np.random.Generator, largest: float, n_steps: int, n_repeats: int) -> Floats:
    """Displacement [m] of a protocol of growing amplitudes, from zero and back; points lie unevenly on straight ways.

    The actuator misses its targets by 2 %, and the specimen may be off centre by some per cent.
    """
    growth, centre = rng.uniform(1.25, 1.6), 0.03 * rng.standard_normal()
    targets = [
        side * largest * growth ** (step + 1 - n_steps) * (1.0 + 0.02 * rng.standard_normal()) + centre * largest
        for step in range(n_steps)
        for _ in range(n_repeats)
        for side in (1.0, -1.0)
    ]
    ways, at = [np.zeros(1)], 0.0
    for target in [*targets, 0.0]:
        n = int(rng.integers(20, 50))
        shares = np.append(np.arange(n) + rng.uniform(0.1, 0.9, n), n) / n
        ways.append(at + shares * (target - at))
        at = target
    return np.concatenate(ways)


def _digitised(loop: Loop, force: Floats, parts: Floats, name: str) -> Record:
    """What a digitiser writes: both columns in steps of a part of their peak."""
    steps = [
        10.0 ** math.floor(math.log10(np.max(np.abs(y)) / n))
        for y, n in zip((loop.displacement, force), parts, strict=True)
    ]
    displacement, written = (
        np.round(y / step) * step for y, step in zip((loop.displacement, force), steps, strict=True)
    )
    return Record(
        name=name,
        time_step=1.0,
        excitation=displacement,
        excitation_kind="displacement",
        channels={"force": written},
        has_time=False,
    )


def _reached(base: Storey, loop: Loop) -> Reached:
    """What sizes are drawn by; what needs time is not a number."""
    return Reached(
        drift=float(np.max(np.abs(loop.displacement))),
        rate=math.nan,
        z=float(np.max(np.abs(loop.hysteretic_displacement))),
        z_bound=ultimate_displacement(base),
        force=float(np.max(np.abs(loop.force))),
        energy=float(np.max(loop.energy)),
        path=float(loop.path[-1]),
        acceleration=math.nan,
        base_shear=math.nan,
        strong_from=math.nan,
        strong_until=math.nan,
        omegas=(),
    )


def _with_all(base: Storey, hidden: Sequence[Hidden]) -> Storey:
    building = Building(storeys=(base,))
    for effect in hidden:
        building = effect.inside(building)
    return building.storeys[0]


def _nats(base: Storey, hidden: Sequence[Hidden], record: Record, rng: np.random.Generator) -> tuple[float, ...]:
    """What the plain law's best fit without each effect leaves behind the truth."""
    displacement, force = record.excitation, record.channels["force"]
    left = force - follow(_with_all(base, hidden), displacement).force
    sd, together = float(np.sqrt(np.mean(np.square(left)))), _samples_together(left)

    def without(others: Sequence[Hidden]) -> float:
        law = _with_all(base, others)
        scale = np.array([math.log(base.k), 0.0, math.log(ultimate_displacement(base)), 0.0, 0.0])

        def residual(numbers: Floats) -> Floats:
            found = follow(with_shape(law, numbers + scale), displacement, COARSE).force
            return np.clip(np.nan_to_num((found - force) / sd, nan=1e4), -1e4, 1e4)

        true = np.array([0.0, base.alpha, 0.0, base.beta / (base.beta + base.gamma), base.n])
        spread = np.array([0.3, 0.05, 0.3, 0.2, 0.5])
        lower, upper = _BOX
        starts = [
            np.clip(true + size * spread * rng.standard_normal(5), lower + 1e-3, upper - 1e-3) for size in (0, 1, 1)
        ]
        best = min(
            float(least_squares(residual, s, bounds=(lower, upper), max_nfev=40, ftol=1e-5).cost) for s in starts
        )
        return (best - 0.5 * len(left)) / together

    return tuple(without([other for other in hidden if other is not effect]) for effect in hidden)


def _samples_together(left: Floats) -> float:
    """How many samples of what the truth leaves count as one: its autocorrelation, summed until it is gone."""
    n = len(left)
    found = np.correlate(left, left, "full")[n - 1 :] / float(left @ left)
    gone = int(np.argmax(found <= 0.0)) or n
    return float(1.0 + 2.0 * np.sum(found[1:gone]))
