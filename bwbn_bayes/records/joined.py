"""Several records of one structure as one: virgin each time, or in sequence.

A joined record has one time base, on which the records stand one after the other, and it keeps the records apart where
that matters: an engine solves each with its own time step, and the noise of each has a level of its own
(:attr:`~bwbn_bayes.records.record.Record.blocks`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import override

import numpy as np

from bwbn_bayes.errors import UserError, whole_number
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import MIN_TIMES, Block, Record, require_record


@dataclass(frozen=True, kw_only=True, eq=False)
class JoinedRecord(Record):
    """Records one after the other; made by :func:`join_records`.

    Inherited arrays hold all of them end to end. A channel that one of them lacks is zero there and does not count;
    ``time_step`` is the shortest.

    Parameters
    ----------
    members : tuple of Record
    is_sequence : bool
        Whether each begins in the state in which the one before it ended.
    """

    members: tuple[Record, ...] = ()
    is_sequence: bool = False

    @property
    @override
    def parts(self) -> tuple[Record, ...]:
        return self.members

    @cached_property
    @override
    def times(self) -> Floats:
        """Sample times [s]: each record begins one of its time steps after the end of the one before."""
        times, end = [], -self.members[0].time_step
        for member in self.members:
            times.append(end + member.time_step + member.times)
            end = times[-1][-1]
        joined = np.concatenate(times)
        joined.flags.writeable = False
        return joined

    @property
    @override
    def duration(self) -> float:
        return float(self.times[-1])

    @property
    @override
    def n_counted(self) -> int:
        return sum(member.n_counted for member in self.members if member.channels)

    @override
    def part_name(self, number: int) -> str:
        names = [member.name for member in self.members]
        if len(names) == 1:
            return ""
        return names[number] if len(set(names)) == len(names) else f"record {number + 1}"

    @cached_property
    @override
    def blocks(self) -> tuple[Block, ...]:
        rows = list(self.channels)
        whole = np.arange(self.n_times)
        return tuple(
            Block(
                label=f"{channel}{self.of_part(part)}",
                part=part,
                channel=rows.index(channel),
                samples=stretch if member.counted is None else whole[stretch][member.kept],
            )
            for part, (member, stretch) in enumerate(zip(self.members, self.stretches, strict=True))
            for channel in member.channels
        )

    @cached_property
    @override
    def content_hash(self) -> str:
        words = [str(self.is_sequence), *(member.content_hash for member in self.members)]
        return hashlib.sha256("\n".join(words).encode()).hexdigest()

    @property
    @override
    def floors(self) -> tuple[int, ...]:
        """Floors with an acceleration channel in every record that measures anything."""
        measured = [set(member.floors) for member in self.members if member.channels]
        return tuple(sorted(set.intersection(*measured))) if measured else ()

    @override
    def equals(self, other: Record) -> bool:
        return (
            len(self.parts) == len(other.parts)
            and self.is_sequence == other.is_sequence
            and all(mine.equals(theirs) for mine, theirs in zip(self.parts, other.parts, strict=True))
        )

    @override
    def between(self, start: float, end: float) -> Record:
        if start != 0.0:
            raise UserError(f"{self.name!r} joins {len(self.members)} records: only its beginning can be cut out")
        kept = []
        for member, stretch in zip(self.members, self.stretches, strict=True):
            left = min(end - float(self.times[stretch.start]), member.duration)
            if left > (MIN_TIMES - 0.5) * member.time_step:
                kept.append(member.until(left))
        if not any(member.channels for member in kept):
            raise UserError(f"the part up to {end:g} s of {self.name!r} measures nothing")
        return self._of(kept)

    @override
    def every(self, step: int) -> Record:
        return self.with_each(lambda member: member.every(step))

    @override
    def select(self, channel_names: Sequence[str]) -> Record:
        super().select(channel_names)  # refuses what no record has
        return self._of([m.select([name for name in channel_names if name in m.channels]) for m in self.members])

    @override
    def with_channels(
        self,
        channels: Mapping[str, Floats],
        *,
        noise_sd: Mapping[str, float] | None = None,
        truth: Mapping[str, float] | None = None,
    ) -> Record:
        def own(member: Record, stretch: slice) -> Record:
            rows = {name: np.asarray(values)[stretch] for name, values in channels.items()}
            # What stands where a record does not measure, stays out of it.
            measured = {name: row for name, row in rows.items() if name in member.channels or name not in self.channels}
            known = {name: sd for name, sd in (noise_sd or {}).items() if name in measured}
            return member.with_channels(measured, noise_sd=known, truth=truth)

        return self._of(list(map(own, self.members, self.stretches)))

    @override
    def driven_by(self, excitation: Floats, forces: Mapping[str, Floats]) -> Record:
        return self._of(
            [
                member.driven_by(excitation[stretch], {name: force[stretch] for name, force in forces.items()})
                for member, stretch in zip(self.members, self.stretches, strict=True)
            ]
        )

    def with_each(self, change: Callable[[Record], Record]) -> Record:
        """The same with every record changed."""
        return self._of([change(member) for member in self.members])

    def _of(self, members: Sequence[Record]) -> Record:
        return join_records(members, in_sequence=self.is_sequence)

    @override
    def __reduce__(self) -> tuple[object, ...]:
        return _rebuilt, (self.members, self.is_sequence)


def _rebuilt(members: tuple[Record, ...], is_sequence: bool) -> JoinedRecord:
    return join_records(members, in_sequence=is_sequence)


def join_records(records: Sequence[Record], *, in_sequence: bool = False) -> JoinedRecord:
    """Join records of one structure, to be identified together.

    A record without channels drives the structure and tells nothing of it: a pause (zeros), or periods before the one
    that was measured.

    Parameters
    ----------
    records : sequence of Record
        Each with a time step and channels of its own.
    in_sequence : bool
        Whether the structure comes to each in the state in which the one before left it, displacements, damage and
        all: the excitation then goes on in a straight line from the last sample of one to the first of the next, one
        time step of the next later. Otherwise it is virgin each time.

    Returns
    -------
    JoinedRecord

    Raises
    ------
    UserError
        If there is none, one of them is none or joined already, or they are driven in different ways.
    """
    members = tuple(records)
    if not members:
        raise UserError("join_records was given no record: give at least one")
    for number, member in enumerate(members, 1):
        require_record(member, f"record {number}")
    if any(isinstance(member, JoinedRecord) for member in members):
        raise UserError("join_records joins single records: give those that a joined one was made of")
    for word, values in (
        ("driven by", [member.excitation_kind for member in members]),
        ("with", ["a time base" if member.has_time else "no time" for member in members]),
    ):
        if len(set(values)) > 1:
            first = next(i for i, value in enumerate(values) if value != values[0])
            raise UserError(
                f"records {members[0].name!r} and {members[first].name!r} cannot be joined: the one is {word} "
                f"{values[0]}, the other {word} {values[first]}"
            )
    channels = tuple(dict.fromkeys(name for member in members for name in member.channels))
    forces = tuple(dict.fromkeys(name for member in members for name in member.forces))

    def end_to_end(rows: Sequence[Mapping[str, Floats]], name: str) -> Floats:
        return np.concatenate(
            [row.get(name, np.zeros(member.n_times)) for row, member in zip(rows, members, strict=True)]
        )

    counted = np.concatenate(
        [np.full(m.n_times, bool(m.channels or not channels)) if m.counted is None else m.counted for m in members]
    )
    truth = {label: value for member in members for label, value in member.truth.items()}
    agree = all(member.truth.get(label, value) == value for member in members for label, value in truth.items())
    return JoinedRecord(
        name=(", then " if in_sequence else " and ").join(m.name for m in members if m.channels or not channels),
        time_step=min(member.time_step for member in members),
        excitation=np.concatenate([member.excitation for member in members]),
        excitation_kind=members[0].excitation_kind,
        channels={name: end_to_end([m.channels for m in members], name) for name in channels},
        forces={name: end_to_end([m.forces for m in members], name) for name in forces},
        provenance={
            f"{key}, record {number}": text
            for number, member in enumerate(members, 1)
            for key, text in member.provenance.items()
        },
        truth=truth if agree else {},
        has_time=members[0].has_time,
        counted=counted,
        members=members,
        is_sequence=in_sequence,
    )


def periodic(record: Record, *, periods: int) -> JoinedRecord:
    """A record of one period of a steady vibration, after so many periods that only drive.

    Parameters
    ----------
    record : Record
        One period: its first sample follows its last.
    periods : int
        Before the one that was measured; as many as the structure needs to forget its start.

    Raises
    ------
    UserError
        If ``periods`` is no whole number from 1 on.
    """
    require_record(record)
    periods = whole_number("periods", periods, 1)
    before = replace(record, channels={}, noise_sd={}, counted=None)
    return join_records([*[before] * periods, record], in_sequence=True)
