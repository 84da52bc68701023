"""A measured or simulated record: what drives, the channels measured under it, and what is known about them.

Everything is in SI units, on a uniform time base that starts at zero. Floors and storeys count from 1.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bwbn_bayes.errors import UserError, require_kind
from bwbn_bayes.parameters import Booleans, Floats
from bwbn_bayes.records.cycles import turning_points

ExcitationKind = Literal["ground_acceleration", "displacement"]

MIN_TIMES = 8
"""Points of any record, one that only drives too."""
MIN_SAMPLES = 32
"""Points that tell the noise of a channel: fewer are nothing to identify from."""
LEAST_POINTS = f"at least {MIN_TIMES} are needed, {MIN_SAMPLES} to identify from"
LEAST_TIME_STEP, MOST_TIME_STEP = 1e-9, 1e6
"""Beyond what any instrument samples, and short of where squares of rates leave the range of doubles. [s]"""

RESERVED_KEYS = ("name", "time_step")
"""Comment keys of the CSV format that provenance may not use; ``true ...`` and ``noise_sd ...`` are reserved too."""

CHANNEL_NAMES = "acceleration_i, relative_acceleration_i, displacement_i, drift_i, force_i (i from 1 to 999)"
COLUMN_NAMES = (
    f"time, ground_acceleration, applied_force_i, {CHANNEL_NAMES}, or displacement and force for a cyclic test"
)

_NUMBERED = re.compile(r"(acceleration|relative_acceleration|displacement|drift|force)_([1-9][0-9]{0,2})", re.ASCII)

_SI_UNITS = {
    "time": "s",
    "ground_acceleration": "m/s^2",
    "acceleration": "m/s^2",
    "relative_acceleration": "m/s^2",
    "displacement": "m",
    "drift": "m",
    "force": "N",
    "applied_force": "N",
}


_APPLIED = re.compile(r"applied_force_([1-9][0-9]{0,2})", re.ASCII)


def is_input(column: str) -> bool:
    """Whether a column is a force from outside, ``applied_force_i`` on floor i, which drives and is not measured."""
    return _APPLIED.fullmatch(column) is not None


def quantity_of(column: str) -> str | None:
    """Physical quantity a column name stands for, e.g. ``drift`` for ``drift_2``; None where the name is unknown."""
    numbered = _NUMBERED.fullmatch(column)
    if numbered:
        return numbered.group(1)
    if is_input(column):
        return "applied_force"
    return column if column in ("time", "ground_acceleration", "displacement", "force") else None


def si_unit(column: str) -> str:
    """SI unit of a column: ``m/s^2``, ``m``, ``N`` or ``s``.

    Raises
    ------
    UserError
        If the name is unknown.
    """
    quantity = quantity_of(column)
    if quantity is None:
        raise UserError(f"channel {column} is not known: use {CHANNEL_NAMES}, or force for a cyclic test")
    return _SI_UNITS[quantity]


class Block(NamedTuple):
    """Samples whose noise has one level: a channel, or of several joined records each record's own."""

    label: str
    """The channel's name; with the record's where there are several."""
    part: int
    """Position among :attr:`Record.parts`."""
    channel: int
    """Row of :attr:`Record.measured`."""
    samples: slice | NDArray[np.int64]
    """Index along time of those that count."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """One excitation and the channels measured under it.

    Arrays are copied on entry and read-only; mappings are read-only. Names, labels and provenance are kept as single
    lines of text (white space becomes one space; what cannot be printed is replaced). Compare with :meth:`equals`.

    Parameters
    ----------
    name : str
        What the record is called in reports.
    time_step : float
        Time between samples. [s]
    excitation : (n_times,) array
        Ground acceleration [m/s^2], or the imposed displacement of a cyclic test [m].
    excitation_kind : {"ground_acceleration", "displacement"}
        Base-excited building, or displacement-driven cyclic test.
    forces : mapping of str to (n_times,) array
        Forces from outside by name, ``applied_force_i`` on floor i. [N] A record may have them beside a ground
        acceleration, or one of zeros.
    channels : mapping of str to (n_times,) array
        Measured channels in order. Building: ``acceleration_i`` (total, what an accelerometer on floor i shows) and
        ``relative_acceleration_i`` [m/s^2], ``displacement_i`` (relative to the ground) and ``drift_i`` (relative to
        the floor below) [m], ``force_i`` [N]. Cyclic test: ``force`` [N].
    provenance : mapping of str to str
        Where the record comes from: label to text.
    truth : mapping of str to float
        True parameter values by label (``"k[1]"``), where known. [SI]
    noise_sd : mapping of str to float
        True standard deviation of the noise per channel, where known. [unit of the channel]
    has_time : bool
        Whether ``time_step`` was measured. A cyclic test without a time column is a path: its points are taken one
        after the other, and nothing that depends on a rate can be told from it.
    counted : (n_times,) boolean array, optional
        Samples at which the channels were measured; all of them where left out. Elsewhere the channels hold zeros,
        whatever was given, so that nobody can read what is held out; the excitation is known throughout.

    Raises
    ------
    UserError
        If a number is not finite, lengths differ, ``time_step`` is not positive, there are fewer than 8 points, a
        channel or label is not understood, a ground motion has no time, or fewer than 8 points count.
    """

    name: str
    time_step: float
    excitation: Floats
    excitation_kind: ExcitationKind = "ground_acceleration"
    channels: Mapping[str, Floats] = field(default_factory=dict)
    forces: Mapping[str, Floats] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)
    truth: Mapping[str, float] = field(default_factory=dict)
    noise_sd: Mapping[str, float] = field(default_factory=dict)
    has_time: bool = True
    counted: Booleans | None = None

    def __post_init__(self) -> None:
        labels = {_label(k): one_line(v) for k, v in self.provenance.items()}
        counted = _mask(self.counted, np.size(self.excitation))
        channels = {key: _frozen_array(value, key, counted) for key, value in self.channels.items()}
        frozen = {
            "name": one_line(self.name),
            "time_step": float(self.time_step),
            "excitation": _frozen_array(self.excitation, self.excitation_kind),
            "channels": MappingProxyType(channels),
            "forces": MappingProxyType({key: _frozen_array(value, key) for key, value in self.forces.items()}),
            "counted": counted,
            "provenance": MappingProxyType({**self._told_of_time, **labels}),
            "truth": MappingProxyType({_label(k): float(v) for k, v in self.truth.items()}),
            "noise_sd": MappingProxyType({k: float(v) for k, v in self.noise_sd.items()}),
        }
        for key, value in frozen.items():
            object.__setattr__(self, key, value)
        self._check_time_base()
        self._check_channels()
        self._check_forces()
        self._check_labels()

    def _check_time_base(self) -> None:
        if self.excitation_kind not in ("ground_acceleration", "displacement"):
            raise UserError(
                f"excitation_kind is {self.excitation_kind!r}: it must be 'ground_acceleration' or 'displacement'"
            )
        if self.n_times < MIN_TIMES:
            raise UserError(f"the record has {self.n_times} points: {LEAST_POINTS}")
        if not (self.time_step > 0.0 and np.isfinite(self.time_step * self.n_times)):
            raise UserError(f"time_step is {self.time_step:g} s: it must be a positive number")
        if self.excitation_kind == "ground_acceleration" and not self.has_time:
            raise UserError("a ground acceleration without time moves nothing: has_time must be true")
        if not LEAST_TIME_STEP <= self.time_step <= MOST_TIME_STEP:
            raise UserError(
                f"time_step is {self.time_step:g} s: it must lie between {LEAST_TIME_STEP:g} and {MOST_TIME_STEP:g} s"
            )

    def _check_channels(self) -> None:
        for channel, values in self.channels.items():
            if self.excitation_kind == "displacement":
                if channel != "force":
                    raise UserError(f"channel {channel} does not belong to a cyclic test: its only channel is force")
            elif not _NUMBERED.fullmatch(channel):
                raise UserError(f"channel {channel} is not known: use {CHANNEL_NAMES}")
            if len(values) != self.n_times:
                raise UserError(
                    f"channel {channel} has {len(values)} points but the excitation {self.n_times}: they must be equal"
                )

    def _check_forces(self) -> None:
        for name, values in self.forces.items():
            if not is_input(name):
                raise UserError(f"{name} is no force from outside: write applied_force_i, i the floor that it acts on")
            if self.excitation_kind == "displacement":
                raise UserError(f"{name} does not belong to a cyclic test: its displacement is given")
            if len(values) != self.n_times:
                raise UserError(
                    f"{name} has {len(values)} points but the excitation {self.n_times}: they must be equal"
                )

    def _check_labels(self) -> None:
        for key in self.provenance:
            if key in RESERVED_KEYS or key.startswith(("true ", "noise_sd ")):
                raise UserError(f"provenance key {key!r} is reserved: use another word")
        for label, value in self.truth.items():
            if not np.isfinite(value):
                raise UserError(f"the true value of {label} is {value}: it must be a finite number")
        for channel, value in self.noise_sd.items():
            if channel not in self.channels:
                raise UserError(
                    f"noise_sd names {channel}, which the record does not have: remove it or add the channel"
                )
            if not (np.isfinite(value) and value >= 0.0):
                raise UserError(f"noise_sd of {channel} is {value}: it must be zero or a positive number")

    @property
    def _told_of_time(self) -> dict[str, str]:
        told = f"no time column: the points are a path, taken {self.time_step:g} s apart"
        return {} if self.has_time else {"time_base": told}

    @property
    def n_times(self) -> int:
        """Number of samples."""
        return len(self.excitation)

    @cached_property
    def kept(self) -> slice | NDArray[np.int64]:
        """Index of the samples that count, along time."""
        return slice(None) if self.counted is None else np.flatnonzero(self.counted)

    def where_counted(self, rows: Floats, otherwise: float = 0.0) -> Floats:
        """Rows ``(..., n_times)``, with another value where samples do not count."""
        return rows if self.counted is None else np.where(self.counted, rows, otherwise)

    @property
    def n_counted(self) -> int:
        """Number of samples that count."""
        return self.n_times if self.counted is None else int(np.count_nonzero(self.counted))

    @property
    def parts(self) -> tuple[Record, ...]:
        """The records that it joins, see :func:`~bwbn_bayes.records.joined.join_records`; itself where it is one."""
        return (self,)

    @property
    def is_sequence(self) -> bool:
        """Whether each part begins in the state in which the one before it ended."""
        return False

    @property
    def runs(self) -> tuple[tuple[Record, slice], ...]:
        """What the structure goes through in one go, and where it stands along time.

        A sequence of joined records is one; of records that each find it virgin each is one.
        """
        if self.is_sequence:
            return ((self, slice(0, self.n_times)),)
        return tuple(zip(self.parts, self.stretches, strict=True))

    def part_at(self, sample: int) -> int:
        """Position of the part that holds a sample."""
        return next(i for i, stretch in enumerate(self.stretches) if sample < stretch.stop)

    def part_name(self, number: int) -> str:
        """What one of several parts is called; nothing where there is one."""
        return ""

    def of_part(self, number: int) -> str:
        """The same behind what is said of it: `` of first``."""
        name = self.part_name(number)
        return f" of {name}" if name else ""

    @cached_property
    def stretches(self) -> tuple[slice, ...]:
        """Samples of each part, along time."""
        ends = np.cumsum([0, *(part.n_times for part in self.parts)]).tolist()
        return tuple(slice(*pair) for pair in pairwise(ends))

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """Each channel of each part."""
        return tuple(Block(name, 0, row, self.kept) for row, name in enumerate(self.channels))

    @property
    def columns(self) -> dict[str, Floats]:
        """What drives and the channels by name, ``(n_times,)`` each, for files and tables.

        Raises
        ------
        UserError
            If some samples do not count, see :func:`require_whole`.
        """
        require_whole(self)
        return {**self.drivers, **self.channels}

    @property
    def drivers(self) -> dict[str, Floats]:
        """What drives, by name: the excitation, unless forces do and the ground stays still, then the forces."""
        still = bool(self.forces) and not np.any(self.excitation)
        return {**({} if still else {self.excitation_kind: self.excitation}), **self.forces}

    @property
    def forced_floors(self) -> tuple[int, ...]:
        """Floors (from 1) that forces act on, in the order of ``forces``."""
        return tuple(int(name.rpartition("_")[2]) for name in self.forces)

    @cached_property
    def measured(self) -> Floats:
        """Measured channels ``(n_channels, n_times)`` in their order, read-only."""
        rows = np.array(list(self.channels.values()), dtype=np.float64).reshape(len(self.channels), self.n_times)
        rows.flags.writeable = False
        return rows

    @cached_property
    def times(self) -> Floats:
        """Sample times ``(n_times,)`` [s] from zero, read-only."""
        times = self.time_step * np.arange(self.n_times, dtype=np.float64)
        times.flags.writeable = False
        return times

    @property
    def duration(self) -> float:
        """Time of the last sample [s]."""
        return (self.n_times - 1) * self.time_step

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 of the data: time step, kind and values of the excitation, names and values of the channels.

        Which samples count enters where not all do, and that there is no time where there is none. The record's name,
        provenance, truth and noise level do not enter: the same data give the same hash.
        """
        digest = hashlib.sha256()
        header = [repr(self.time_step), str(self.n_times), self.excitation_kind, *self.forces, *self.channels]
        header += [] if self.has_time else ["no time"]
        digest.update("\n".join(header).encode())
        for values in (self.excitation, *self.forces.values(), *self.channels.values()):
            digest.update(np.ascontiguousarray(values, dtype="<f8").tobytes())
        if self.counted is not None:
            digest.update(np.packbits(self.counted).tobytes())
        return digest.hexdigest()

    @property
    def floors(self) -> tuple[int, ...]:
        """Floors with a (total) acceleration channel, in increasing order."""
        found = (_NUMBERED.fullmatch(channel) for channel in self.channels)
        return tuple(sorted(int(match.group(2)) for match in found if match and match.group(1) == "acceleration"))

    def equals(self, other: Record) -> bool:
        """Whether two records agree in every number, name and label, order of the channels included."""
        own, others = self._plain_fields(), other._plain_fields()
        arrays, of_other = (
            [one.excitation, np.arange(one.n_times)[one.kept], *one.forces.values(), *one.channels.values()]
            for one in (self, other)
        )
        arrays_agree = all(np.array_equal(mine, theirs) for mine, theirs in zip(arrays, of_other, strict=False))
        for plain in (own, others):
            del plain["excitation"], plain["forces"], plain["channels"], plain["counted"]
        named_alike = [*self.forces, *self.channels] == [*other.forces, *other.channels]
        return bool(arrays_agree and named_alike and own == others)

    def until(self, time: float) -> Record:
        """The first part of the record, up to and including ``time`` [s]."""
        return self.between(0.0, time)

    def every(self, step: int) -> Record:
        """The record with every so-manieth point, from the first on; without time those where it turns, too.

        Points of a path need not lie evenly, and between them it is straight: a peak that is left out is cut off.
        """
        if step == 1:
            return self
        kept, told = np.arange(0, self.n_times, step), f"one in {step}"
        if not self.has_time:
            kept, told = (
                np.union1d(kept, turning_points(self.excitation)).astype(np.int64),
                f"{told}, and where it turns",
            )
        return replace(
            self,
            time_step=step * self.time_step,
            excitation=self.excitation[kept],
            forces={key: values[kept] for key, values in self.forces.items()},
            channels={key: values[kept] for key, values in self.channels.items()},
            counted=None if self.counted is None else self.counted[kept],
            provenance={**self.provenance, "points kept": told},
        )

    def between(self, start: float, end: float) -> Record:
        """The part from ``start`` to ``end`` [s], both included, with its time counted from zero again.

        Raises
        ------
        UserError
            If the part reaches outside the record or holds fewer than 8 points.
        """
        slack = 1e-6 * self.time_step
        if not (-slack <= start < end <= self.duration + slack):
            raise UserError(
                f"the part from {start:g} to {end:g} s is not inside the record {self.name} (0 to {self.duration:g} s)"
            )
        first = int(np.ceil((start - slack) / self.time_step))
        last = int(np.floor((end + slack) / self.time_step))
        if first == 0 and last == self.n_times - 1:
            return self
        earlier = self.provenance.get("part")
        points = f"points {first + 1} to {last + 1}"
        part = f"{first * self.time_step:g} to {last * self.time_step:g} s" if self.has_time else points
        return replace(
            self,
            excitation=self.excitation[first : last + 1],
            forces={key: values[first : last + 1] for key, values in self.forces.items()},
            channels={key: values[first : last + 1] for key, values in self.channels.items()},
            counted=None if self.counted is None else self.counted[first : last + 1],
            provenance={**self.provenance, "part": f"{part} of ({earlier})" if earlier else part},
        )

    def with_channels(
        self,
        channels: Mapping[str, Floats],
        *,
        noise_sd: Mapping[str, float] | None = None,
        truth: Mapping[str, float] | None = None,
    ) -> Record:
        """The same excitation with other channels.

        Parameters
        ----------
        channels : mapping of str to (n_times,) array
            They take the place of the present ones. [SI]
        noise_sd : mapping of str to float, optional
            True noise standard deviations of the new channels; unknown where left out.
        truth : mapping of str to float, optional
            True parameter values; those of this record where left out.
        """
        return replace(
            self,
            channels=channels,
            noise_sd={} if noise_sd is None else noise_sd,
            truth=self.truth if truth is None else truth,
        )

    def driven_by(self, excitation: Floats, forces: Mapping[str, Floats]) -> Record:
        """The same under another excitation ``(n_times,)`` and other forces from outside, by name; channels stay."""
        return replace(self, excitation=excitation, forces=forces)

    def select(self, channel_names: Sequence[str]) -> Record:
        """The same record with these channels only, in the given order.

        Raises
        ------
        UserError
            If a channel is not in the record.
        """
        for channel in channel_names:
            if channel not in self.channels:
                present = ", ".join(self.channels) or "none"
                raise UserError(f"record {self.name} has no channel {channel}: it has {present}")
        return replace(
            self,
            channels={channel: self.channels[channel] for channel in channel_names},
            noise_sd={channel: sd for channel, sd in self.noise_sd.items() if channel in channel_names},
        )

    def storey_forces(self, masses: Sequence[float] | Floats, *, lowest_storey: int = 1) -> Floats:
        """Measured storey forces ``V_i = sum_{j>=i} (f_j - m_j a_j)``, viscous force included.

        Equilibrium of the floors above storey i; no model of the storeys enters.

        Parameters
        ----------
        masses : (n_floors,) array
            Floor masses, lowest floor first. [kg]
        lowest_storey : int
            Leave out the storeys below this one: their floors then need no sensor.

        Returns
        -------
        (n_floors - lowest_storey + 1, n_times) array
            Storey forces from the lowest storey up. [N]

        Raises
        ------
        UserError
            If a floor at or above ``lowest_storey`` has no acceleration channel.
        """
        mass = np.asarray(masses, dtype=np.float64)
        if mass.ndim != 1 or not 1 <= lowest_storey <= len(mass):
            raise UserError(
                f"lowest_storey is {lowest_storey} for {mass.size} floor masses: it must be one of the storeys"
            )
        missing = [floor for floor in range(lowest_storey, len(mass) + 1) if floor not in self.floors]
        if missing:
            raise UserError(
                f"the force of storey {lowest_storey} needs acceleration_{missing[-1]}, which record {self.name} does "
                "not have: every floor above a storey needs a sensor"
            )
        floors = range(lowest_storey, len(mass) + 1)
        inertia = np.stack([mass[floor - 1] * self.channels[f"acceleration_{floor}"] for floor in floors])
        for floor in set(floors) & set(self.forced_floors):
            inertia[floor - lowest_storey] -= self.forces[f"applied_force_{floor}"]
        return -np.cumsum(inertia[::-1], axis=0)[::-1]

    def _plain_fields(self) -> dict[str, object]:
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        return {key: dict(value) if isinstance(value, MappingProxyType) else value for key, value in values.items()}

    def __reduce__(self) -> tuple[object, ...]:
        # A MappingProxyType does not pickle; records travel to worker processes.
        return _rebuilt, (self._plain_fields(),)


def _rebuilt(plain_fields: Mapping[str, object]) -> Record:
    return Record(**plain_fields)  # type: ignore[arg-type]


def require_record(given: object, name: str = "record") -> None:
    """Raise :class:`UserError` unless what is given as ``name`` is a record."""
    advice = "give a Record, which read_record makes of a file and join_records of several records"
    require_kind(name, given, Record, advice)


def require_measured(record: Record) -> None:
    """Raise :class:`UserError` unless a record has a channel."""
    if record.channels:
        return
    if record.excitation_kind == "displacement":
        raise UserError(
            f"record {record.name!r} has no force beside its displacement: add the column force, or name the one that "
            'is it with --columns "displacement, LABEL = force [kN]"'
        )
    raise UserError(
        f"record {record.name!r} measures nothing: add a channel such as acceleration_1, or name the column that is "
        'one with --columns "LABEL = acceleration_1 [g]"'
    )


def require_whole(record: Record) -> None:
    """Raise :class:`UserError` unless it is one record, every sample of which counts; files know no others, say."""
    require_single(record, "what is asked for knows of one:")
    if record.counted is not None:
        left_out = record.n_times - record.n_counted
        raise UserError(f"{left_out} samples of record {record.name!r} do not count: give the whole record instead")


def require_single(record: Record, why: str) -> None:
    """Raise :class:`UserError` unless a record is one and no joined ones; ``why`` says who knows of no others."""
    if len(record.parts) > 1:
        raise UserError(f"{record.name!r} joins {len(record.parts)} records, and {why} give one of them")


def _mask(counted: Booleans | None, n_times: int) -> Booleans | None:
    """A read-only copy; None where every sample counts."""
    if counted is None:
        return None
    mask = np.array(counted, dtype=np.bool_)
    if mask.shape != (n_times,):
        raise UserError(f"counted has shape {mask.shape} where the excitation has {n_times} points: give one for each")
    if np.all(mask):
        return None
    if np.count_nonzero(mask) < MIN_TIMES:
        raise UserError(f"{np.count_nonzero(mask)} points of the record count: at least {MIN_TIMES} are needed")
    mask.flags.writeable = False
    return mask


def _frozen_array(values: ArrayLike, column: str, counted: Booleans | None = None) -> Floats:
    array = np.array(values, dtype=np.float64)
    if array.ndim != 1:
        raise UserError(f"{column} has {array.ndim} dimensions: it must be a list of numbers, one for each time")
    if counted is not None and array.shape == counted.shape:
        array[~counted] = 0.0
    bad = np.flatnonzero(~np.isfinite(array))
    if bad.size:
        raise UserError(f"{column} is {array[bad[0]]} at point {bad[0] + 1}: every value must be a finite number")
    array.flags.writeable = False
    return array


def one_line(text: str) -> str:
    """Text as one line that a terminal only shows: what cannot be printed, an ESC say, is replaced."""
    line = " ".join(str(text).split())
    return "".join(each if each.isprintable() else "\N{REPLACEMENT CHARACTER}" for each in line)


def _label(text: str) -> str:
    label = one_line(text)
    if not label or ":" in label:
        raise UserError(f"the label {text!r} is empty or holds a colon: use a plain word")
    return label
