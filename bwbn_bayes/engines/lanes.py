"""The default engine: generated numba code that advances sixteen draws at once, threads over blocks of sixteen.

A draw's result depends on its own parameters only: every operation is the same for each lane, a lane that needs no
step takes one of length zero, and unfilled lanes repeat the last draw. Where derivatives of few draws are wanted, a
draw fills several lanes, each with some of its derivatives.
"""

from __future__ import annotations

import math
import os
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.elements.law import StoreyLaw
from bwbn_bayes.engines.base import (
    OBSERVED_KINDS,
    ChannelMap,
    NormalEquations,
    Response,
    Status,
    channel_map,
    check_record,
    masses,
)
from bwbn_bayes.engines.directions import Directions
from bwbn_bayes.engines.lane_kernel import LaneKernel, kernel_path
from bwbn_bayes.engines.lane_source import LANES, LaneLayout, lane_layout, lane_source, summary_source
from bwbn_bayes.engines.observation import Sensors, sensors_of
from bwbn_bayes.engines.scalar import has_programs, programs_of
from bwbn_bayes.engines.step_rules import interval_steps, steps_in_words
from bwbn_bayes.engines.stretches import StartingTerm, Stretch, starting_terms, stretches_of
from bwbn_bayes.parameters import Booleans, Floats
from bwbn_bayes.records.blocks import by_block
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure


def usable_processors() -> int:
    """Processors that this process may use: a container or a scheduler may lend fewer than the machine has."""
    if sys.version_info >= (3, 13):
        return os.process_cpu_count() or 1
    return len(os.sched_getaffinity(0))


@dataclass(frozen=True, kw_only=True)
class Lanes:
    """Runge-Kutta of order 4 on sixteen draws at once.

    Parameters
    ----------
    substeps : int
        Steps between two samples at least; see :func:`~bwbn_bayes.engines.step_rules.interval_steps`.
    resolution : float
        Largest change of a sharp state (the hysteretic displacement at the slip) per step, in widths of the feature;
        0 keeps the steps equal but for turns and events. Each draw refines its own steps.
    cut_at_turns : bool
        Whether steps end where a drift rate changes sign. Without, a solve costs two thirds: enough for a search.
    n_threads : int
        Threads over blocks of sixteen draws.
    single : bool
        Whether to compute with numbers of 32 bits, in half the time: for searches. Rounding then moves responses by
        1e-6 of their root mean square and derivatives by 1e-5, more where the structure amplifies it (near collapse):
        with noise of 3 % a log likelihood by 0.003. Magnitudes must stay between 1e-30 and 1e38, in steep powers
        (``beta`` in 1/m^n) too, or the draw fails. Sums over samples and all that is returned are doubles.
    """

    substeps: int = 1
    resolution: float = 0.0
    cut_at_turns: bool = True
    n_threads: int = usable_processors()
    single: bool = False

    name = "lanes"

    @property
    def scheme(self) -> str:
        """Scheme and accuracy in words."""
        turns = "" if self.cut_at_turns else ", not cut at turns"
        precision = ", single precision" if self.single else ""
        return f"RK4, {steps_in_words(self.substeps, self.resolution)}{turns}, {LANES} lanes{precision}"

    def simulate(
        self, model: Structure, draws: Floats, record: Record, channels: Sequence[str] | None = None
    ) -> Response:
        """Response at the record's times; its measured channels unless others are named."""
        names = tuple(record.channels) if channels is None else tuple(channels)
        values, _ = self._stored(model, draws, record, names, wanted=_nothing(draws))
        return _response(names, values)

    def sensitivities(
        self,
        model: Structure,
        draws: Floats,
        record: Record,
        channels: Sequence[str] | None = None,
        *,
        free: Booleans | None = None,
    ) -> tuple[Response, Floats]:
        """Response and its derivatives ``(n_draws, n_parameters, n_channels, n_times)``; zero for those not free."""
        names = tuple(record.channels) if channels is None else tuple(channels)
        values, slopes = self._stored(model, draws, record, names, wanted=_wanted(model, draws, free))
        return _response(names, values), slopes

    def misfit(self, model: Structure, draws: Floats, record: Record) -> Floats:
        """Sum of squared residuals ``(n_draws, n_blocks)``; infinite where the solve failed."""
        problem = _Problem.build(self, model, record, tuple(record.channels), wanted=_nothing(draws))
        result = np.empty((len(draws), len(record.blocks)))

        def solve(block: _Block) -> None:
            if problem.is_summed_outside:
                values, _ = problem.solve(self, block)
                with np.errstate(over="ignore"):  # a draw that runs away misses by infinity
                    left = by_block(record, record.measured - values)
                    result[block.rows] = np.stack([np.sum(rest**2, axis=1) for rest in left], axis=1)
                return
            sums = [
                outcome.misfit.reshape(-1, LANES)[part.rows].T[: block.n_draws]
                for part, outcome in problem.run(self, block, store=False)
            ]
            result[block.rows] = np.concatenate(sums, axis=1)

        self._over_blocks(problem, model, draws, solve)
        return np.where(np.isfinite(result), result, np.inf)

    def normal_equations(
        self, model: Structure, draws: Floats, record: Record, *, free: Booleans | None = None
    ) -> NormalEquations:
        """Least squares in summary over the measured channels, summed inside the kernel; zero for those not free.

        Sensors that distort stand after the kernel, which knows of no samples that do not count either: then the
        response of one block at a time is stored and summed.
        """
        problem = _Problem.build(self, model, record, tuple(record.channels), wanted=_wanted(model, draws, free))
        n, c, d = len(draws), len(record.blocks), model.space.n_dim
        misfit, gradient, information = np.empty((n, c)), np.empty((n, c, d)), np.empty((n, c, d, d))

        def solve(block: _Block) -> None:
            summed = problem.summed if problem.is_summed_outside else problem.reduced
            misfit[block.rows], gradient[block.rows], information[block.rows] = summed(self, block)

        self._over_blocks(problem, model, draws, solve)
        misfit = np.where(np.isfinite(misfit), misfit, np.inf)
        return NormalEquations(misfit=misfit, gradient=gradient, information=information)

    def of_points(self, model: Structure, record: Record) -> OfPoints | None:
        """Squared residuals and derivatives of one draw at a time, all else prepared.

        None where the kernel's answers are not the channels: sensors distort them, or samples do not count.
        """
        wanted = np.ones((1, model.space.n_dim), dtype=np.bool_)
        problem = _Problem.build(self, model, record, tuple(record.channels), wanted=wanted)
        return None if problem.is_summed_outside else OfPoints(self, model, problem)

    def _stored(
        self, model: Structure, draws: Floats, record: Record, names: tuple[str, ...], *, wanted: Booleans
    ) -> tuple[Floats, Floats]:
        problem = _Problem.build(self, model, record, names, wanted=wanted)
        values = np.empty((len(draws), len(names), record.n_times))
        slopes = np.empty((len(draws), problem.n_parameters, len(names), record.n_times))

        def solve(block: _Block) -> None:
            values[block.rows], slopes[block.rows] = problem.solve(self, block)

        self._over_blocks(problem, model, draws, solve)
        return values, slopes

    def _over_blocks(self, problem: _Problem, model: Structure, draws: Floats, solve: Callable[[_Block], None]) -> None:
        local = model.table.local(np.asarray(draws, dtype=np.float64))
        # A draw with one value that is not finite fails as a whole: in fast code a comparison could hide it.
        local[~np.all(np.isfinite(local), axis=(1, 2))] = np.nan
        n_law = len(model.law.parameters)
        blocks = [_Block.of(local, n_law, problem.directions, start) for start in range(0, len(draws), LANES)]
        if self.n_threads == 1 or len(blocks) == 1:
            for block in blocks:
                solve(block)
        else:
            list(_pool(self.n_threads).map(solve, blocks))


_WORTH_SHARING = 4
"""Directions from which on a draw is worth several lanes."""


@dataclass(frozen=True, kw_only=True)
class _Block:
    """Up to sixteen draws and the lanes they fill: ``n_shares`` each, one after the other.

    Attributes
    ----------
    rows : slice
        The draws.
    whole : Directions
        Of the draws.
    directions : Directions
        Of the sixteen lanes; those left over repeat the last one.
    parameters : (n_links, n_law, LANES) array
    sensor_parameters : (n_draws, n_links, n_sensor_parameters) array
    """

    rows: slice
    n_shares: int
    whole: Directions
    directions: Directions
    parameters: Floats
    sensor_parameters: Floats

    @property
    def n_draws(self) -> int:
        return int(self.rows.stop - self.rows.start)

    @classmethod
    def of(cls, local: Floats, n_law: int, directions: Directions, start: int) -> _Block:
        """The block of draws from ``start``, given the parameters and directions of all draws."""
        n_draws = min(LANES, len(local) - start)
        rows = slice(start, start + n_draws)
        whole = directions.at(np.arange(start, rows.stop))
        n_shares = LANES // n_draws if whole.n >= _WORTH_SHARING else 1
        own = whole.divided(n_shares) if n_shares > 1 else whole
        lanes = np.minimum(np.arange(LANES), n_draws * n_shares - 1)
        return cls(
            rows=rows,
            n_shares=n_shares,
            whole=whole,
            directions=own.at(lanes),
            parameters=np.moveaxis(local[start + lanes // n_shares, :, :n_law], 0, 2),
            sensor_parameters=local[rows, :, n_law:],
        )

    def sources(self, n_parameters: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Where the lanes hold each draw's values, in row 0, and each of its directions; row -1 where nobody's.

        Returns
        -------
        row, lane : (1 + n_directions, n_draws) arrays
        """
        first = np.arange(self.n_draws) * self.n_shares
        own = self.directions.owner[: self.n_draws * self.n_shares]
        held = np.full((self.n_draws, n_parameters + 1, 2), -1, dtype=np.int64)
        lane, direction = np.nonzero(own >= 0)
        held[lane // self.n_shares, own[lane, direction]] = np.stack([1 + direction, lane], axis=1)
        row, lane = np.moveaxis(held[np.arange(self.n_draws), self.whole.owner.T], 2, 0)
        return np.concatenate([0 * first[None], row]), np.concatenate([first[None], lane])


@dataclass(frozen=True, kw_only=True)
class _Outcome:
    misfit: Floats
    gram: Floats
    stored: Floats

    @classmethod
    def empty(cls, c: int, d: int, *, stored: Floats) -> _Outcome:
        """Sums over ``c`` channels in ``d`` directions, still zero."""
        return cls(misfit=np.zeros(c * LANES), gram=np.zeros(c * (d * (d + 3) // 2) * LANES), stored=stored)


_SHARES, _WEIGHTS = np.array([1 / 2, 1 / 2, 1.0]), np.array([1 / 6, 1 / 3, 1 / 3, 1 / 6])
"""Stages of the classical Runge-Kutta scheme."""


@dataclass(frozen=True, kw_only=True)
class _Part:
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
    ) -> _Part:
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
            sensors=sensors_of(model, stretch.record, own),
        )


def _positions(names: tuple[str, ...], some: Iterable[str]) -> NDArray[np.int64]:
    return np.array([names.index(name) for name in some], dtype=np.int64)


@dataclass(frozen=True, kw_only=True)
class _Problem:
    """What every block of one call shares; ``real`` is the type of the kernel's numbers."""

    kernel: LaneKernel
    real: np.dtype[Any]
    layout: LaneLayout
    n_links: int
    parts: tuple[_Part, ...]
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
        cls, engine: Lanes, model: Structure, record: Record, names: tuple[str, ...], *, wanted: Booleans
    ) -> _Problem:
        """The problem of one call; the derivatives ``wanted`` of each draw, ``(n_draws, n_parameters)``."""
        known = _problem_of(_Same(model), _Same(record), names, engine.single)
        n = wanted.shape[1]
        return replace(known, n_parameters=n, directions=Directions.of(known.moved[:n], known.layout.nowhere, wanted))

    @classmethod
    def without_derivatives(cls, model: Structure, record: Record, names: tuple[str, ...], *, single: bool) -> _Problem:
        """All that does not depend on the draws."""
        check_record(model, record)
        driven = model.excitation_kind == "displacement"
        kernel, layout = _kernel_of(model.law, driven, single)
        real = np.dtype(np.float32 if single else np.float64)
        moved = _moved(model, layout)
        return cls(
            kernel=kernel,
            real=real,
            layout=layout,
            n_links=model.n_links,
            parts=tuple(_Part.of(model, stretch, record, names, layout, real) for stretch in stretches_of(record)),
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

    def solve(self, engine: Lanes, block: _Block) -> tuple[Floats, Floats]:
        """Channels ``(n_draws, n_channels, n_times)`` of a block as sensors show them, and their derivatives."""
        owner, c = block.directions.owner, len(self.channels.names)
        n_lanes = block.n_draws * block.n_shares
        lane, direction = np.nonzero(owner[:n_lanes] >= 0)
        values = np.empty((block.n_draws, c, self.record.n_times))
        slopes = np.zeros((block.n_draws, self.n_parameters, c, self.record.n_times))
        for part, outcome in self.run(engine, block, store=True):
            stored = outcome.stored.reshape(-1, 1 + block.directions.n, c, LANES)
            table = np.ascontiguousarray(np.moveaxis(stored, (0, 3), (3, 0))[:n_lanes])
            samples = part.stretch.samples
            values[..., samples] = table[:: block.n_shares, 0]
            slopes[..., samples][lane // block.n_shares, owner[lane, direction]] = table[lane, 1 + direction]
            if part.sensors is not None:
                part.sensors.read(block.sensor_parameters, values[..., samples], slopes[..., samples])
        return values, slopes

    def summed(self, engine: Lanes, block: _Block) -> tuple[Floats, Floats, Floats]:
        """Misfit, gradient and information of a block from its stored response."""
        values, slopes = self.solve(engine, block)
        residuals = by_block(self.record, self.record.measured - values)
        tables = by_block(self.record, slopes)
        return (
            np.stack([np.sum(residual**2, axis=1) for residual in residuals], axis=1),
            np.stack([(own @ rest[..., None])[..., 0] for own, rest in zip(tables, residuals, strict=True)], axis=1),
            np.stack([own @ np.swapaxes(own, 1, 2) for own in tables], axis=1),
        )

    def reduced(self, engine: Lanes, block: _Block) -> tuple[Floats, Floats, Floats]:
        """Misfit, gradient and information of a block, summed by the kernel."""
        found = []
        for part, outcome in self.run(engine, block, store=block.n_shares > 1):
            whole = outcome if block.n_shares == 1 else self.gathered(block, part, outcome.stored)
            found.append(self.unpacked(block, part, whole))
        misfit, gradient, information = (np.concatenate(arrays, axis=1) for arrays in zip(*found, strict=True))
        return misfit, gradient, information

    def unpacked(self, block: _Block, part: _Part, outcome: _Outcome) -> tuple[Floats, Floats, Floats]:
        """Misfit, gradient and information of the channels that a part measures."""
        c, own = len(self.channels.names), block.whole.of_parameters(self.n_parameters)
        gram = np.moveaxis(outcome.gram.reshape(c, -1, LANES)[part.rows], 2, 0)[: block.n_draws]
        triangle = _unpack(gram, own.shape[1])
        square = triangle[..., 1:, 1:]
        left, right = np.tril_indices(own.shape[1])
        square[..., right, left] = square[..., left, right]
        with np.errstate(over="ignore", invalid="ignore"):  # derivatives of a draw that runs away
            return (
                outcome.misfit.reshape(c, LANES)[part.rows].T[: block.n_draws],
                np.einsum("nck,nkp->ncp", triangle[..., 1:, 0], own),
                np.swapaxes(own, 1, 2)[:, None] @ square @ own[:, None],
            )

    def cast(self, numbers: Floats) -> NDArray[Any]:
        """Numbers in the kernel's precision."""
        return numbers.astype(self.real, copy=False)

    def gathered(self, block: _Block, part: _Part, stored: Floats) -> _Outcome:
        """What a run of a block stored, each draw in a lane of its own again, summed as a run sums it."""
        c, d = len(self.channels.names), block.whole.n
        width = (1 + block.directions.n) * c * LANES
        row, lane = block.sources(self.n_parameters)
        source = np.full((1 + d, c, LANES), -1, dtype=np.int64)
        place = (row[:, None] * c + np.arange(c)[:, None]) * LANES + lane[:, None]
        source[:, :, : block.n_draws] = np.where(row[:, None] >= 0, place, -1)
        outcome = _Outcome.empty(c, d, stored=stored)
        value = np.zeros(c * (d + 1) * LANES, dtype=self.real)
        _summarise(self.real == np.float32)(
            c, d, part.measured, stored, width, source.ravel(), outcome.misfit, outcome.gram, value
        )
        return outcome

    def started(self, block: _Block) -> tuple[Floats, Floats]:
        """Rows of a block before its first sample: parameters, masses, and the states that do not start at zero.

        Returns
        -------
        blocks : (n_links + 2, n_rows, LANES) array
        tangents : (n_directions, n_links + 2, n_rows, LANES) array
        """
        n, place, owner = self.n_links, self.layout, block.directions.owner
        blocks = _aligned((n + 2, place.block, LANES), self.real)
        tangents = _aligned((block.directions.n, n + 2, place.tangent_block, LANES), self.real)
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

    def run(self, engine: Lanes, block: _Block, *, store: bool) -> Iterator[tuple[_Part, _Outcome]]:
        """The kernel on one block, part after part."""
        d, n, place = block.directions.n, self.n_links, self.layout
        march = self.kernel.run_with_tangents if d > 0 else self.kernel.run
        seed, column, active = block.directions.arrays(place.own) if d > 0 else _NO_DIRECTIONS
        for part in self.parts:
            stretch, channels = part.stretch, part.channels
            if not stretch.is_carried:
                blocks, tangents = self.started(block)
            times = block.parameters[::-1, self.events] - stretch.begin
            c = len(channels.names)
            stored = np.zeros(len(stretch.inputs) * c * (1 + d) * LANES if store else 1, dtype=self.real)
            outcome = _Outcome.empty(c, 0 if store else d, stored=stored)
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
                self.cast(_SHARES),
                self.cast(_WEIGHTS),
                interval_steps(stretch.inputs[:, 0], engine.substeps, driven=self.driven),
                float(engine.resolution),
                engine.cut_at_turns,
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


class _Same[T]:
    """An object as a key: models and records are never changed, so that what follows from one stays true."""

    def __init__(self, it: T) -> None:
        self.it = it

    def __hash__(self) -> int:
        return id(self.it)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.it is other.it


@lru_cache(maxsize=8)  # each holds the record a second time: as many as a few threads ask about at once
def _problem_of(model: _Same[Structure], record: _Same[Record], names: tuple[str, ...], single: bool) -> _Problem:
    """Samplers ask about one model and record thousands of times: preparing a short one took longer than solving it."""
    return _Problem.without_derivatives(model.it, record.it, names, single=single)


_NO_DIRECTIONS = (np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64), np.empty(0))


class OfPoints:
    """What samplers that go from point to point ask for, of a model under a record; see :meth:`Lanes.of_points`.

    Half of what one draw costs is the preparation, which is the same for every draw.

    Parameters
    ----------
    engine : Lanes
        Its scheme.
    model : Structure
    problem : _Problem
        Of a draw with all its derivatives.
    """

    def __init__(self, engine: Lanes, model: Structure, problem: _Problem) -> None:
        self._engine, self._model, self._problem = engine, model, problem
        self._block = _Block.of(self._local(np.zeros(model.space.n_dim)), self._n_law, problem.directions, 0)
        row, lane = self._block.sources(problem.n_parameters)
        held = row[1:, 0] >= 0
        self._row, self._lane = row[1:, 0][held], lane[1:, 0][held]
        self._whole = self._block.whole.of_parameters(problem.n_parameters)[0][held]

    @property
    def _n_law(self) -> int:
        return len(self._model.law.parameters)

    def _local(self, values: Floats) -> Floats:
        return self._model.table.local(values[None])

    def __call__(self, values: Floats, measured: Floats) -> tuple[Floats, Floats]:
        """Squared residuals ``(n_blocks,)`` and their derivatives ``(n_blocks, n_parameters)``.

        Parameters
        ----------
        values : (n_parameters,) array
            In their own units.
        measured : (n_channels, n_times) array
        """
        local = self._local(values)[0, :, : self._n_law]
        local = local if np.all(np.isfinite(local)) else np.full_like(local, np.nan)
        block = replace(self._block, parameters=np.repeat(local[:, :, None], LANES, axis=2))
        sums, slopes = [], []
        for part, outcome in self._problem.run(self._engine, block, store=True):
            c = len(part.channels.names)
            stored = outcome.stored.reshape(-1, 1 + block.directions.n, c, LANES)
            rest = measured[part.rows, part.stretch.samples].T - stored[:, 0, :, 0]
            with np.errstate(over="ignore", invalid="ignore"):  # a draw that runs away
                sums.append(np.sum(np.square(rest), axis=0))
                every = np.einsum("tc,tkcl->ckl", rest, stored[:, 1:])
                slopes.append(-2.0 * every[:, self._row - 1, self._lane] @ self._whole)
        return np.concatenate(sums), np.concatenate(slopes)


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


def _nothing(draws: Floats) -> Booleans:
    """No derivatives."""
    return np.zeros((len(draws), 0), dtype=np.bool_)


def _wanted(model: Structure, draws: Floats, free: Booleans | None) -> Booleans:
    """Which derivatives to compute: all of them unless some are free."""
    return np.ones((len(draws), model.space.n_dim), dtype=np.bool_) if free is None else free


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

    Last the block of the link that it runs on from, 0 for none.
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
        rows.append((n + 1 - lower, n + 1 - upper, kept, int(upper in pulled), runs_on_from))
        pulled |= {lower, upper} - {number}
    return np.array(rows, dtype=np.int64)


def _response(names: tuple[str, ...], values: Floats) -> Response:
    failed = ~np.all(np.isfinite(values), axis=(1, 2))
    values[failed] = np.nan
    status = np.where(failed, Status.NON_FINITE, Status.OK).astype(np.int64)
    return Response(channels=names, values=values, status=status)


@cache
def _pool(n_threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=n_threads, thread_name_prefix="lanes")


def _kernel_of(law: StoreyLaw, driven: bool, single: bool = False) -> tuple[LaneKernel, LaneLayout]:
    """The compiled kernel of a law and the layout of its rows; made once, whichever threads ask."""
    with _MAKING:
        return _make_kernel(law, driven, single)


@cache
def _make_kernel(law: StoreyLaw, driven: bool, single: bool) -> tuple[LaneKernel, LaneLayout]:
    safe, programs = programs_of(law)
    return LaneKernel("lanes", lane_source(safe, programs, driven=driven, single=single)), lane_layout(safe, programs)


_MAKING = threading.Lock()


@cache
def _summarise(single: bool) -> Callable[..., None]:
    """Sums what a kernel stored."""
    return LaneKernel("sums", summary_source(single=single)).function("summarise")


def is_compiled(law: StoreyLaw, driven: bool, *, single: bool = False) -> bool:
    """Whether the cache holds the law's kernel, or another process has begun to compile it; generates nothing."""
    if not has_programs(law):
        return False
    safe, programs = programs_of(law)
    path = kernel_path("lanes", lane_source(safe, programs, driven=driven, single=single))
    return path is not None and path.exists()


def compile_law(law: StoreyLaw, driven: bool, with_tangents: bool, *, single: bool = False) -> None:
    """Compile a law's kernel into the cache."""
    kernel, _ = _kernel_of(law, driven, single)
    _summarise(single)
    for march in (kernel.run, kernel.run_with_tangents) if with_tangents else (kernel.run,):
        assert march is not None
