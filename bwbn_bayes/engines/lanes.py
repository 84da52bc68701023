"""The default engine: generated machine code that advances sixteen draws at once, threads over blocks of sixteen.

A draw's result depends on its own parameters only: every operation is the same for each lane, a lane that needs no
step takes one of length zero, and unfilled lanes repeat the last draw. Where derivatives of few draws are wanted, a
draw fills several lanes, each with some of its derivatives.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache

import numpy as np

from bwbn_bayes.engines.base import NormalEquations, Response, Status
from bwbn_bayes.engines.lane_block import Block
from bwbn_bayes.engines.lane_points import OfPoints
from bwbn_bayes.engines.lane_problem import Outcome, Part, Problem
from bwbn_bayes.engines.lane_source import LANES
from bwbn_bayes.engines.step_rules import steps_in_words
from bwbn_bayes.parameters import Booleans, Floats
from bwbn_bayes.records.blocks import by_block
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure

ALONE: ContextVar[bool] = ContextVar("ALONE", default=False)
"""Whether it is solved on one thread, whatever an engine says: by a worker among others."""


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
        Largest change of a sharp state (the hysteretic displacement at the slip, a drift that is imposed) per step, in
        widths of the feature; 0 keeps the steps equal but for turns and events. Each draw refines its own steps.
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
        return f"RK4, {steps_in_words(self.substeps, self.resolution)}{turns}, {self._at_once}{precision}"

    @property
    def _at_once(self) -> str:
        return f"{LANES} lanes"

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
        problem = Problem.build(model, record, tuple(record.channels), wanted=_nothing(draws), single=self.single)
        result = np.empty((len(draws), len(record.blocks)))

        def solve(block: Block) -> None:
            if problem.is_summed_outside:
                values, _ = problem.solve(self, block)
                with np.errstate(over="ignore"):  # a draw that runs away misses by infinity
                    left = by_block(record, record.measured - values)
                    result[block.rows] = np.stack([np.sum(rest**2, axis=1) for rest in left], axis=1)
                return
            sums = [
                outcome.misfit.reshape(-1, block.n_lanes)[part.rows].T[: block.n_draws]
                for part, outcome in self.march(problem, block, store=False)
            ]
            result[block.rows] = np.concatenate(sums, axis=1)

        self._over_blocks(problem, model, draws, solve, store=problem.is_summed_outside)
        return np.where(np.isfinite(result), result, np.inf)

    def normal_equations(
        self, model: Structure, draws: Floats, record: Record, *, free: Booleans | None = None
    ) -> NormalEquations:
        """Least squares in summary over the measured channels, summed inside the kernel; zero for those not free.

        Sensors that distort stand after the kernel, which knows of no samples that do not count either: then the
        response of one block at a time is stored and summed.
        """
        problem = Problem.build(
            model, record, tuple(record.channels), wanted=_wanted(model, draws, free), single=self.single
        )
        n, c, d = len(draws), len(record.blocks), model.space.n_dim
        misfit, gradient, information = np.empty((n, c)), np.empty((n, c, d)), np.empty((n, c, d, d))

        def solve(block: Block) -> None:
            summed = problem.summed if problem.is_summed_outside else problem.reduced
            misfit[block.rows], gradient[block.rows], information[block.rows] = summed(self, block)

        self._over_blocks(problem, model, draws, solve, store=problem.is_summed_outside)
        misfit = np.where(np.isfinite(misfit), misfit, np.inf)
        return NormalEquations(misfit=misfit, gradient=gradient, information=information)

    def of_points(self, model: Structure, record: Record) -> OfPoints | None:
        """Squared residuals and derivatives of few draws at a time, all else prepared.

        None where the kernel's answers are not the channels: sensors distort them, or samples do not count.
        """
        wanted = np.ones((1, model.space.n_dim), dtype=np.bool_)
        problem = Problem.build(model, record, tuple(record.channels), wanted=wanted, single=self.single)
        return None if problem.is_summed_outside else OfPoints(self, model, problem)

    def _stored(
        self, model: Structure, draws: Floats, record: Record, names: tuple[str, ...], *, wanted: Booleans
    ) -> tuple[Floats, Floats]:
        problem = Problem.build(model, record, names, wanted=wanted, single=self.single)
        values = np.empty((len(draws), len(names), record.n_times))
        slopes = np.empty((len(draws), problem.n_parameters, len(names), record.n_times))

        def solve(block: Block) -> None:
            values[block.rows], slopes[block.rows] = problem.solve(self, block)

        self._over_blocks(problem, model, draws, solve, store=True)
        return values, slopes

    def march(self, problem: Problem, block: Block, *, store: bool) -> Iterator[tuple[Part, Outcome]]:
        """What comes of a block of draws, part after part; responses where they are to be stored, else their sums."""
        return problem.run(self, block, store=store)

    def lanes_for(self, problem: Problem, n_draws: int, *, store: bool) -> int:
        """How many of so many draws are solved at once."""
        return LANES

    def _over_blocks(
        self, problem: Problem, model: Structure, draws: Floats, solve: Callable[[Block], None], *, store: bool
    ) -> None:
        local = model.table.local(np.asarray(draws, dtype=np.float64))
        # A draw with one value that is not finite fails as a whole: in fast code a comparison could hide it.
        local[~np.all(np.isfinite(local), axis=(1, 2))] = np.nan
        n_law = len(model.law.parameters)
        n_lanes = self.lanes_for(problem, len(draws), store=store)
        starts = range(0, len(draws), n_lanes)
        blocks = [Block.of(local, n_law, problem.directions, start, n_lanes) for start in starts]
        if self.n_threads == 1 or len(blocks) == 1 or ALONE.get():
            for block in blocks:
                solve(block)
        else:
            list(_pool(self.n_threads).map(solve, blocks))


def _nothing(draws: Floats) -> Booleans:
    """No derivatives."""
    return np.zeros((len(draws), 0), dtype=np.bool_)


def _wanted(model: Structure, draws: Floats, free: Booleans | None) -> Booleans:
    """Which derivatives to compute: all of them unless some are free."""
    return np.ones((len(draws), model.space.n_dim), dtype=np.bool_) if free is None else free


def _response(names: tuple[str, ...], values: Floats) -> Response:
    failed = ~np.all(np.isfinite(values), axis=(1, 2))
    values[failed] = np.nan
    status = np.where(failed, Status.NON_FINITE, Status.OK).astype(np.int64)
    return Response(channels=names, values=values, status=status)


@cache
def _pool(n_threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=n_threads, thread_name_prefix="lanes")
