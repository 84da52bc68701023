"""What one call of the lane engine solves: draws in blocks of lanes, a record in parts, the kernel on each."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.elements.law import StoreyLaw
from bwbn_bayes.engines.base import OBSERVED_KINDS, ChannelMap, channel_map, check_record, masses
from bwbn_bayes.engines.directions import Directions
from bwbn_bayes.engines.kernel import Kernel
from bwbn_bayes.engines.lane_block import Block
from bwbn_bayes.engines.lane_laws import kernel_of, summarise
from bwbn_bayes.engines.lane_source import LANES, LaneLayout
from bwbn_bayes.engines.observation import Sensors, read_all, sensors_of
from bwbn_bayes.engines.step_rules import interval_steps
from bwbn_bayes.engines.stretches import StartingTerm, Stretch, starting_terms, stretches_of
from bwbn_bayes.parameters import Booleans, Floats
from bwbn_bayes.records.blocks import by_block
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure


class Stepping(Protocol):
    """What an engine says of its steps, and how it takes them; see :class:`~bwbn_bayes.engines.lanes.Lanes`."""

    @property
    def substeps(self) -> int:
        """Steps between two samples at least."""
        ...

    @property
    def resolution(self) -> float:
        """Largest change of a sharp state per step, in widths of the feature."""
        ...

    @property
    def cut_at_turns(self) -> bool:
        """Whether steps end where a drift rate changes sign."""
        ...

    def march(self, problem: Problem, block: Block, *, store: bool) -> Iterator[tuple[Part, Outcome]]:
        """What comes of a block of draws, part after part."""
        ...


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a kernel sums and stores: squared residuals, products of residuals and derivatives, responses."""

    misfit: Floats
    gram: Floats
    stored: Floats

    @classmethod
    def empty(cls, c: int, d: int, *, stored: Floats) -> Outcome:
        """Sums over ``c`` channels in ``d`` directions, still zero."""
        return cls(misfit=np.zeros(c * LANES), gram=np.zeros(c * (d * (d + 3) // 2) * LANES), stored=stored)


SHARES, WEIGHTS = np.array([1 / 2, 1 / 2, 1.0]), np.array([1 / 6, 1 / 3, 1 / 3, 1 / 6])
"""Stages of the classical Runge-Kutta scheme."""


@dataclass(frozen=True, kw_only=True)
class Part:
    """A stretch as the kernel takes it.

    Attributes
    ----------
    stretch : Stretch
    joints, forced : integer arrays
        See :func:`_joints`; blocks of the forced floors.
    channels : ChannelMap
        What is asked for; nothing of the step between two records.
    seen_blocks, seen_rows : (n_terms,) integer arrays
        Where the kernel finds each term of the channels.
    measured : (n_channels, n_times) array
    rows : slice or integer array
        Those of the channels that its record measures.
    sensors : Sensors or None
    """

    stretch: Stretch
    joints: NDArray[np.int64]
    forced: NDArray[np.int64]
    channels: ChannelMap
    seen_blocks: NDArray[np.int64]
    seen_rows: NDArray[np.int64]
    measured: Floats
    rows: slice | NDArray[np.int64]
    sensors: Sensors | None

    @classmethod
    def of(
        cls,
        model: Structure,
        stretch: Stretch,
        record: Record,
        names: tuple[str, ...],
        layout: LaneLayout,
        real: np.dtype[Any],
    ) -> Part:
        """A stretch of a record, of which the named channels are asked for; what is measured in a kernel's numbers."""
        own = names if stretch.samples is not None else ()
        channels = channel_map(model, own)
        kind, link = np.divmod(channels.row, model.n_links)
        # The base stands one block below the links.
        below = kind == len(OBSERVED_KINDS)
        measures = own == tuple(record.channels) and stretch.samples is not None
        rows = slice(None) if len(record.parts) == 1 else _positions(tuple(record.channels), stretch.record.channels)
        return cls(
            stretch=stretch,
            joints=_joints(model, stretch.forced_floors),
            forced=model.n_links + 1 - np.array(stretch.forced_floors, dtype=np.int64),
            channels=channels,
            seen_blocks=model.n_links - link + below,
            seen_rows=layout.observed(kind),
            measured=np.array(record.measured[:, stretch.samples], dtype=real, order="C")  # in rows, and its own
            if measures
            else np.zeros((len(own), len(stretch.inputs)), dtype=real),
            rows=rows,
            sensors=sensors_of(model, record, stretch, own),
        )


def _positions(names: tuple[str, ...], some: Iterable[str]) -> NDArray[np.int64]:
    return np.array([names.index(name) for name in some], dtype=np.int64)


@dataclass(frozen=True, kw_only=True)
class Problem:
    """What every block of one call shares; ``real`` is the type of the kernel's numbers."""

    law: StoreyLaw
    kernel: Kernel
    real: np.dtype[Any]
    layout: LaneLayout
    n_links: int
    parts: tuple[Part, ...]
    n_parameters: int
    directions: Directions
    driven: bool
    inverse_masses: Floats
    channels: ChannelMap
    record: Record
    start: tuple[StartingTerm, ...]
    index: NDArray[np.int64]
    events: NDArray[np.int64]
    moved: NDArray[np.int64]

    @property
    def is_summed_outside(self) -> bool:
        """Whether stored responses are summed: the kernel knows of every sample alike, and of no sensors."""
        has_sensors = any(part.sensors is not None for part in self.parts)
        return has_sensors or not all(isinstance(block.samples, slice) for block in self.record.blocks)

    @classmethod
    def build(
        cls, model: Structure, record: Record, names: tuple[str, ...], *, wanted: Booleans, single: bool
    ) -> Problem:
        """The problem of one call; the derivatives ``wanted`` of each draw, ``(n_draws, n_parameters)``."""
        known = problem_of(Same(model), Same(record), names, single)
        n = wanted.shape[1]
        return replace(known, n_parameters=n, directions=Directions.of(known.moved[:n], known.layout.nowhere, wanted))

    @classmethod
    def without_derivatives(cls, model: Structure, record: Record, names: tuple[str, ...], *, single: bool) -> Problem:
        """All that does not depend on the draws."""
        check_record(model, record)
        driven = model.excitation_kind == "displacement"
        kernel, layout = kernel_of(model.law, driven, single)
        real = np.dtype(np.float32 if single else np.float64)
        moved = _moved(model, layout)
        return cls(
            law=model.law,
            kernel=kernel,
            real=real,
            layout=layout,
            n_links=model.n_links,
            parts=tuple(Part.of(model, stretch, record, names, layout, real) for stretch in stretches_of(record)),
            n_parameters=0,
            directions=Directions.of(moved[:0], layout.nowhere, np.zeros((0, 0), dtype=np.bool_)),
            driven=driven,
            inverse_masses=1.0 / masses(model),
            channels=channel_map(model, names),
            record=record,
            start=starting_terms(model),
            index=model.table.index,
            events=np.array(model.law.event_parameters, dtype=np.int64),
            moved=moved,
        )

    def solve(self, stepping: Stepping, block: Block) -> tuple[Floats, Floats]:
        """Channels ``(n_draws, n_channels, n_times)`` of a block as sensors show them, and their derivatives."""
        owner, c = block.directions.owner, len(self.channels.names)
        n_lanes = block.n_draws * block.n_shares
        lane, direction = np.nonzero(owner[:n_lanes] >= 0)
        values = np.empty((block.n_draws, c, self.record.n_times))
        slopes = np.zeros((block.n_draws, self.n_parameters, c, self.record.n_times))
        for part, outcome in stepping.march(self, block, store=True):
            stored = outcome.stored.reshape(-1, 1 + block.directions.n, c, block.n_lanes)
            table = np.ascontiguousarray(np.moveaxis(stored, (0, 3), (3, 0))[:n_lanes])
            samples = part.stretch.samples
            values[..., samples] = table[:: block.n_shares, 0]
            slopes[..., samples][lane // block.n_shares, owner[lane, direction]] = table[lane, 1 + direction]
        read_all([part.sensors for part in self.parts], block.sensor_parameters, values, slopes)
        return values, slopes

    def summed(self, stepping: Stepping, block: Block) -> tuple[Floats, Floats, Floats]:
        """Misfit, gradient and information of a block from its stored response."""
        values, slopes = self.solve(stepping, block)
        residuals = by_block(self.record, self.record.measured - values)
        tables = by_block(self.record, slopes)
        with np.errstate(over="ignore", invalid="ignore"):  # a draw that runs away misses by infinity
            return (
                np.stack([np.sum(residual**2, axis=1) for residual in residuals], axis=1),
                np.stack(
                    [(own @ rest[..., None])[..., 0] for own, rest in zip(tables, residuals, strict=True)], axis=1
                ),
                np.stack([own @ np.swapaxes(own, 1, 2) for own in tables], axis=1),
            )

    def reduced(self, stepping: Stepping, block: Block) -> tuple[Floats, Floats, Floats]:
        """Misfit, gradient and information of a block, summed by the kernel."""
        found = []
        for part, outcome in stepping.march(self, block, store=block.n_shares > 1):
            whole = outcome if block.n_shares == 1 else self.gathered(block, part, outcome.stored)
            found.append(self.unpacked(block, part, whole))
        misfit, gradient, information = (np.concatenate(arrays, axis=1) for arrays in zip(*found, strict=True))
        return misfit, gradient, information

    def unpacked(self, block: Block, part: Part, outcome: Outcome) -> tuple[Floats, Floats, Floats]:
        """Misfit, gradient and information of the channels that a part measures."""
        c, own = len(self.channels.names), block.whole.of_parameters(self.n_parameters)
        gram = np.moveaxis(outcome.gram.reshape(c, -1, block.n_lanes)[part.rows], 2, 0)[: block.n_draws]
        triangle = _unpack(gram, own.shape[1])
        square = triangle[..., 1:, 1:]
        left, right = np.tril_indices(own.shape[1])
        square[..., right, left] = square[..., left, right]
        with np.errstate(over="ignore", invalid="ignore"):  # derivatives of a draw that runs away
            return (
                outcome.misfit.reshape(c, block.n_lanes)[part.rows].T[: block.n_draws],
                np.einsum("nck,nkp->ncp", triangle[..., 1:, 0], own),
                np.swapaxes(own, 1, 2)[:, None] @ square @ own[:, None],
            )

    def cast(self, numbers: Floats) -> NDArray[Any]:
        """Numbers in the kernel's precision."""
        return numbers.astype(self.real, copy=False)

    def gathered(self, block: Block, part: Part, stored: Floats) -> Outcome:
        """What a run of a block stored, each draw by itself again, summed as a run sums it."""
        c, d = len(self.channels.names), block.whole.n
        width, n_parts = (1 + block.directions.n) * c * LANES, d // LANES + 1
        row, lane = (found.T[:, None] for found in block.sources(self.n_parameters))
        place = (row * c + np.arange(c)[:, None]) * LANES + lane
        source = np.full((block.n_draws, c, n_parts * LANES), -1, dtype=np.int64)
        source[:, :, : d + 1] = np.where(row >= 0, place, -1)
        gram = np.zeros((block.n_draws, c, d + 1, n_parts * LANES))
        value, sums = _aligned((n_parts * LANES,), self.real), summarise(self.real == np.float32)
        for own, found in zip(source, gram, strict=True):
            sums(c, d, n_parts, part.measured, stored, width, own.ravel(), found.ravel(), value)
        outcome = Outcome.empty(c, d, stored=stored)
        packed = np.moveaxis(gram[:, :, *np.tril_indices(d + 1)], 0, 2)
        outcome.misfit.reshape(c, LANES)[:, : block.n_draws] = packed[:, 0]
        outcome.gram.reshape(c, -1, LANES)[..., : block.n_draws] = packed[:, 1:]
        return outcome

    def started(self, block: Block) -> tuple[Floats, Floats]:
        """Rows of a block before its first sample: parameters, masses, and the states that do not start at zero.

        Returns
        -------
        blocks : (n_links + 2, n_rows, n_lanes) array
        tangents : (n_directions, n_links + 2, n_rows, n_lanes) array
        """
        n, place, owner = self.n_links, self.layout, block.directions.owner
        blocks = _aligned((n + 2, place.block, block.n_lanes), self.real)
        tangents = _aligned((block.directions.n, n + 2, place.tangent_block, block.n_lanes), self.real)
        links = blocks[n:0:-1]
        with np.errstate(over="ignore"):  # a draw out of range fails
            links[:, place.parameters : place.parameters + block.parameters.shape[1]] = block.parameters
        links[:, place.inverse_mass] = self.inverse_masses[:, None]
        for term in self.start:
            # The sum of a scheme's stages is the state at the end of the step before.
            row = 2 * place.n_states + term.row
            links[term.link, row] += term.factor * block.parameters[term.source, term.column]
            parameter = self.index[term.source, term.column]
            if parameter >= 0:
                tangents[:, n - term.link, row] += term.factor * (parameter == owner.T)
        return blocks, tangents

    def times(self, block: Block, stretch: Stretch) -> Floats:
        """When events happen since a stretch began [s], ``(n_links, n_events, n_lanes)``, links from the last."""
        return np.asarray(block.parameters[::-1, self.events] - stretch.begin)

    def steps(self, stepping: Stepping, stretch: Stretch) -> NDArray[np.int64]:
        """Steps of each interval of a stretch, ``(n_times,)``, before any refinement."""
        return interval_steps(stretch.inputs[:, 0], stepping.substeps, driven=self.driven)

    def run(self, stepping: Stepping, block: Block, *, store: bool) -> Iterator[tuple[Part, Outcome]]:
        """The kernel on one block, part after part."""
        d, n, place = block.directions.n, self.n_links, self.layout
        march = self.kernel.run_with_tangents if d > 0 else self.kernel.run
        seed, column, active = block.directions.arrays(place.own) if d > 0 else _NO_DIRECTIONS
        for part in self.parts:
            stretch, channels = part.stretch, part.channels
            if not stretch.is_carried:
                blocks, tangents = self.started(block)
            times = self.times(block, stretch)
            c = len(channels.names)
            stored = np.zeros(len(stretch.inputs) * c * (1 + d) * LANES if store else 1, dtype=self.real)
            outcome = Outcome.empty(c, 0 if store else d, stored=stored)
            march(
                n,
                d,
                stretch.time_step,
                times.ravel(),
                self.cast(stretch.inputs),
                part.joints,
                part.forced,
                blocks.ravel(),
                tangents.ravel(),
                seed,
                column,
                self.cast(active),
                self.cast(SHARES),
                self.cast(WEIGHTS),
                self.steps(stepping, stretch),
                float(stepping.resolution),
                stepping.cut_at_turns,
                channels.starts,
                part.seen_blocks,
                part.seen_rows,
                self.cast(channels.coefficient),
                self.cast(channels.ground),
                part.measured,
                outcome.misfit,
                outcome.gram,
                store,
                outcome.stored,
                *_room(c, d, stretch.inputs.shape[1], self.real),
            )
            if stretch.samples is not None:
                yield part, outcome


class Same[T]:
    """An object as a key: models and records are never changed, so that what follows from one stays true."""

    def __init__(self, it: T) -> None:
        self.it = it

    def __hash__(self) -> int:
        return id(self.it)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same) and self.it is other.it


@lru_cache(maxsize=8)  # each holds the record a second time: as many as a few threads ask about at once
def problem_of(model: Same[Structure], record: Same[Record], names: tuple[str, ...], single: bool) -> Problem:
    """Samplers ask about one model and record thousands of times: preparing a short one took longer than solving it."""
    return Problem.without_derivatives(model.it, record.it, names, single=single)


_NO_DIRECTIONS = (np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64), np.empty(0))


def _aligned(shape: tuple[int, ...], real: np.dtype[Any]) -> NDArray[Any]:
    """Zeros that begin where a cache line does: vectors that lie across two cost a sixth of a solve."""
    n, line = math.prod(shape), _LINE // real.itemsize
    room = np.zeros(n + line, dtype=real)
    first = -(room.__array_interface__["data"][0] // room.itemsize) % line
    return room[first : first + n].reshape(shape)


def _room(n_channels: int, n_directions: int, n_inputs: int, real: np.dtype[Any]) -> tuple[NDArray[Any], ...]:
    """Where a run keeps the channels at a sample, what drives it, and the steps of each lane."""
    sizes = (n_channels * (n_directions + 1) * LANES, n_inputs * LANES, 4 * LANES + n_inputs)
    return tuple(_aligned((size,), real) for size in sizes)


_LINE = 64
"""Bytes of a cache line, and of a vector of 512 bits."""


def _unpack(gram: Floats, d: int) -> Floats:
    """Lower triangle rows 1 to d of the products of (residual, slopes), packed row by row, as a square."""
    square = np.zeros((*gram.shape[:-1], d + 1, d + 1))
    position = 0
    for a in range(1, d + 1):
        square[..., a, : a + 1] = gram[..., position : position + a + 1]
        position += a + 1
    return square


def _moved(model: Structure, place: LaneLayout) -> NDArray[np.int64]:
    """Column of the table of partials that each parameter moves, at each link from the last down."""
    first = 2 + len(model.law.states)
    moved = np.full((model.space.n_dim, model.n_links), place.nowhere, dtype=np.int64)
    for link, row in enumerate(model.table.index):
        for column, parameter in enumerate(row[: len(model.law.parameters)]):
            if parameter >= 0:
                moved[parameter, model.n_links - 1 - link] = first + column
    return moved


def _joints(model: Structure, forced_floors: tuple[int, ...]) -> NDArray[np.int64]:
    """Blocks of the nodes that each link joins, in the order of the sweep, and whether each was pulled at before.

    Then the block of the link that it runs on from, 0 for none; last whether nothing acts on it but its element.
    """
    n, pulled = model.n_links, set(forced_floors)
    others = [end for number, pair in enumerate(model.joints, 1) for end in pair if end != number]
    pulls = Counter([*others, *forced_floors])
    rows = []
    for number in range(n, 0, -1):
        lower, upper = model.joints[number - 1]
        alone = lower == number - 1 and pulls[lower] == 1
        below = model.runs_on_from[number - 1]
        runs_on_from = n + 1 - below if below else 0
        kept = -1 if alone else int(lower in pulled)
        bare = int(model.bare[number - 1])
        rows.append((n + 1 - lower, n + 1 - upper, kept, int(upper in pulled), runs_on_from, bare))
        pulled |= {lower, upper} - {number}
    return np.array(rows, dtype=np.int64)
