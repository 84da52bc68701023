"""A model to start from where there is none: sizes are read off the record, priors are wide around them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import welch

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Floats, HalfNormal, LogNormal, PerStorey, Prior, Uniform
from bwbn_bayes.records.cycles import half_cycles
from bwbn_bayes.records.directions import require_one_direction
from bwbn_bayes.records.noise import require_long_enough
from bwbn_bayes.records.record import Record, require_measured, require_record
from bwbn_bayes.records.sizes import LEAST_LENGTH, require_sizes
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen
from bwbn_bayes.structures.structure import Structure, masses_of

STIFFNESS_LOG_SD = 1.0
"""Of k around what the record shows: a factor of 7 to either side is two of it. Best fits of 28 measured cyclic tests
lie within 1.1 of them; of a law without degradation, which answers with a softer spring, down to 1.6 below."""
YIELD_LOG_SD = 1.5
"""Of u_y around the peak force over the stiffness: with a gradual yield, at n = 1, it is up to four times as much."""
ALPHA = Uniform(-0.3, 0.6)
"""Strength that falls with displacement makes it negative, to -0.17 in those fits."""
RHO = Uniform(0.2, 2.5)
"""Near the bound of z unloading is ``2 rho`` times as stiff as the first loading: 0.4 to 5 times."""
ALPHA_OF_BUILDING = Uniform(0.0, 0.6)
"""A building that softens below zero falls."""
DAMPING_SHARE = 0.1
"""Of a specimen's peak force, what damping reaches at the test's usual rate."""
DAMPING_RATIO = 0.03
"""Of a building's first mode, about which damping is log-normal: 0.4 to 20 % are two standard deviations."""
DAMPING_LOG_SD = 1.0
MOST_YIELD = 5.0
"""Of a building's yield drift over its largest drift: then nothing yields."""
N = Uniform(1.0, 6.0)
"""Beyond 6 the corner of a loop is sharper than a record tells."""
DIGITS = 3
"""Significant digits: they are sizes, not measurements."""

_FIRST_PART = 0.3
"""Share of a half cycle's force over which its stiffness is taken: after a reversal, before yield and any pinch."""
_STIFFEST = 0.9
"""Quantile of those stiffnesses: the initial one, but for the few that noise makes too stiff."""

_SEGMENTS, _LEAST_SEGMENT = 4, 256
"""Segments that a record is cut into, but for the overlap, and the least samples of one."""
_LEAST_GROUND = 0.01
"""Of the largest power of the ground, below which a frequency counts as this strong."""


def starting_model(record: Record, masses: Sequence[float] | None = None) -> Structure:
    """Structure of the record's kind with Bouc-Wen storeys and wide priors of the record's own sizes.

    A cyclic test gives a :class:`Specimen`, a ground motion a :class:`ShearBuilding` with as many storeys as the
    highest measured floor. Nothing is fitted: peaks, a stiffness and a frequency are read off.

    Parameters
    ----------
    record : Record
        With at least one channel that moves.
    masses : sequence of float, optional
        Floor masses of a building, lowest first; 1 kg each where left out, and k and c are then per kilogram. [kg]

    Returns
    -------
    Structure
        Without effects.

    Raises
    ------
    UserError
        If the record measures nothing, is too short, is driven by forces or nothing in it moves, its numbers are too
        large or too small to be a structure's, a specimen's force is counted against its displacement, or masses are
        given for one.
    """
    require_record(record)
    require_measured(record)
    require_sizes(record)
    for part in record.parts:
        if part.channels:
            require_long_enough(part)
    if record.forces:
        raise UserError(
            f"record {record.name!r} is driven by {', '.join(record.forces)}: stiffness is read off ground motions "
            "alone; write a model file, for one mass an Oscillator"
        )
    still = [
        name for name, y in [(record.excitation_kind, record.excitation), *record.channels.items()] if not np.ptp(y)
    ]
    if still:
        raise UserError(
            f"record {record.name!r}: {still[0]} never changes, so that no size can be read off it: mend the column, "
            "or say with --columns which one it is"
        )
    if record.excitation_kind == "displacement":
        if masses is not None:
            raise UserError("masses belong to a building: a cyclic test has none")
        for part in record.parts:
            require_one_direction(part)
        return _specimen(record)
    return _building(record, masses)


def initial_stiffness(record: Record) -> float:
    """Initial stiffness of a cyclic test, in N/m, without a model.

    Each half cycle has a secant from its reversal to where the force has changed by 30 % of what it changes in all;
    the initial stiffness is their 90 % quantile. Repeated points, standstill and noise well below a tenth of a half
    cycle's force do not matter. Samples that do not count are left out.
    """
    displacement, force = record.excitation, record.channels["force"]
    every = np.arange(record.n_times)[record.kept]
    secants = []
    cycles = [(stretch.start, cycle) for run, stretch in record.runs for cycle in half_cycles(run.excitation)]
    for start, cycle in cycles:
        own = every[(every >= start + cycle.first) & (every <= start + cycle.last)]
        if not len(own):
            continue
        u, f = displacement[own], force[own]
        reached = int(np.argmax(np.abs(f - f[0]) >= _FIRST_PART * np.ptp(f)))
        if (u[reached] - u[0]) * (f[reached] - f[0]) > 0.0:
            secants.append((f[reached] - f[0]) / (u[reached] - u[0]))
    whole = np.ptp(force) / np.ptp(displacement)
    return float(np.quantile(secants, _STIFFEST)) if secants else float(whole)


def first_frequency(record: Record) -> float:
    """Frequency of a building's first mode in motion, in Hz, without a model.

    It is where the spectrum of the highest channel is largest over the square root of the ground's: over the ground's
    itself noise wins where the ground hardly moves, alone the ground's own frequencies do. In 108 simulated records of
    one to six storeys, first modes from 0.3 to 9 Hz, elastic or yielding under motions that would take them to two or
    six times the yield drift, it lay between 0.58 and 1.11 of the elastic frequency, nine of ten between 0.8 and 1.03.
    Of joined records the longest that measures is taken.
    """
    record = _longest(record)
    name, motion = _highest(record)
    # The force on a mass goes with its total acceleration; so do drifts and displacements, which are forces over k.
    motion = motion + record.excitation if name.startswith("relative") else motion
    per_segment = min(record.n_times, max(_LEAST_SEGMENT, record.n_times // _SEGMENTS))
    frequency, ground = welch(record.excitation, 1.0 / record.time_step, nperseg=per_segment)
    _, power = welch(motion, 1.0 / record.time_step, nperseg=per_segment)
    over_ground = power / np.sqrt(ground + _LEAST_GROUND * np.max(ground))
    return float(frequency[1:][np.argmax(over_ground[1:])])


def _specimen(record: Record) -> Structure:
    force = record.channels["force"][record.kept]
    travel, peak = (float(np.max(np.abs(y))) for y in (record.excitation, force))
    stiffness = initial_stiffness(record)
    damping: float | Prior = 0.0
    if record.has_time:
        part = _longest(record)
        rate = float(np.sqrt(np.mean(np.square(np.diff(part.excitation))))) / part.time_step
        damping = HalfNormal(_rounded(DAMPING_SHARE * peak / rate))
    return Specimen(
        storey=BoucWen(
            k=LogNormal(_rounded(stiffness), STIFFNESS_LOG_SD),
            c=damping,
            alpha=ALPHA,
            u_y=LogNormal(_rounded(peak / stiffness), YIELD_LOG_SD).truncated(
                _rounded(travel / 500.0), _rounded(2.0 * travel)
            ),
            rho=RHO,
            n=N,
        )
    )


def _building(record: Record, masses: Sequence[float] | None) -> Structure:
    n_storeys = max(map(_place, record.channels))
    masses = (1.0,) * n_storeys if masses is None else masses_of(masses)
    omega = 2.0 * np.pi * first_frequency(record)
    # First mode of a uniform building: omega = 2 sqrt(k/m) sin(pi / (4 n + 2)).
    stiffness = float(np.mean(masses)) * (0.5 * omega / np.sin(0.5 * np.pi / (2 * n_storeys + 1))) ** 2
    drift = _largest_drift(record, omega, stiffness)
    if MOST_YIELD * drift <= LEAST_LENGTH:
        raise UserError(
            f"record {record.name!r}: {_highest(record)[0]} tells of drifts up to {drift:.3g} m: mend its unit or its "
            "values"
        )
    return ShearBuilding(
        masses=masses,
        storey=BoucWen(
            k=PerStorey(LogNormal(_rounded(stiffness), STIFFNESS_LOG_SD)),
            c=PerStorey(LogNormal(_rounded(2.0 * DAMPING_RATIO * stiffness / omega), DAMPING_LOG_SD)),
            alpha=ALPHA_OF_BUILDING,
            u_y=LogNormal(_rounded(0.5 * drift), YIELD_LOG_SD).truncated(
                _rounded(drift / 200.0), _rounded(MOST_YIELD * drift)
            ),
            rho=RHO,
            n=N,
        ),
    )


def _longest(record: Record) -> Record:
    """The part that measures for the longest time."""
    return max((part for part in record.parts if part.channels), key=lambda part: part.duration)


def _highest(record: Record) -> tuple[str, Floats]:
    """Name and values of the channel of the highest place, drifts and displacements before accelerations."""
    kinds = ("force", "acceleration", "relative_acceleration", "displacement", "drift")
    name = max(record.channels, key=lambda one: (_place(one), kinds.index(one.rsplit("_", 1)[0])))
    return name, record.channels[name]


def _place(channel: str) -> int:
    return int(channel.rsplit("_", 1)[1])


def _largest_drift(record: Record, omega: float, stiffness: float) -> float:
    """Largest drift of the first storey [m] by the highest channel, in the first mode of a uniform building."""
    name, _ = _highest(record)
    # Where another record lacks the channel, the joined one has zeros.
    shown = [part for part in record.parts if name in part.channels]
    grounds = [part.excitation if name.startswith("acceleration") else 0.0 for part in shown]
    moved = [(part.channels[name] - ground)[part.kept] for part, ground in zip(shown, grounds, strict=True)]
    largest = max(float(np.max(np.abs(motion))) for motion in moved)
    if name.startswith("force"):
        return largest / stiffness
    if name.startswith("drift"):
        return largest
    floor = _place(name)
    of_first = np.sin(np.pi / (2 * floor + 1)) / np.sin(floor * np.pi / (2 * floor + 1))
    return float(of_first * largest / (omega**2 if "acceleration" in name else 1.0))


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
