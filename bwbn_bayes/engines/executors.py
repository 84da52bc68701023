"""Solving on more than this process: batches of draws, or whole fits, go through an executor, here or elsewhere.

A draw's result does not depend on which others share its batch, so a batch may be cut anywhere between blocks of lanes
and sent to whoever is free: the answers are the same bits, however many workers there are, on processors of one kind.
Workers are trusted as this process is: what they are sent is code as well as numbers.
"""

from __future__ import annotations

import hashlib
import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import field, fields, is_dataclass, make_dataclass, replace
from functools import cache, lru_cache, partial
from typing import Any, ClassVar, Protocol, cast

import cloudpickle
import numpy as np

from bwbn_bayes.engines.base import Engine, NormalEquations
from bwbn_bayes.engines.children import end_with_parent
from bwbn_bayes.engines.lane_source import LANES
from bwbn_bayes.errors import UserError, require_installed
from bwbn_bayes.parameters import Booleans, Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure

_PIECES_PER_WORKER = 2
"""Pieces of a batch that each worker gets if it is large enough: a slow or lost one then holds up less."""
_AT_ONCE = 2
"""Pieces that each worker has at a time, one of them waiting: none waits for the network."""
_ATTEMPTS = 5
"""Times that pieces are sent again after a worker died."""

Piece = tuple[Floats, Booleans | None]
"""Draws, and which of their derivatives are wanted."""


class Executor(Protocol):
    """Runs a task on pieces of a problem somewhere."""

    @property
    def n_workers(self) -> int:
        """Pieces that are worked on at once."""
        ...

    def each[P, R](
        self,
        task: Callable[[bytes, P], R],
        problem: bytes,
        pieces: Sequence[P],
        must_stop: Callable[[], bool] = lambda: False,
    ) -> Iterator[R | None]:
        """What a task makes of each piece, in their order, those of a lost worker again.

        Parameters
        ----------
        task : callable
            Of a module, such as :func:`solve`; takes the problem and a piece, and makes no None.
        problem : bytes
            What all pieces have in common.
        pieces : sequence
        must_stop : callable, optional
            Asked before each piece is sent; where it says so, that one and those after it come to None.
        """
        ...


class Processes:
    """Works in processes of this machine, one thread each.

    Parameters
    ----------
    n_workers : int
        How many.
    """

    def __init__(self, n_workers: int) -> None:
        self.n_workers = n_workers
        self._pool = self._started()

    def each[P, R](
        self,
        task: Callable[[bytes, P], R],
        problem: bytes,
        pieces: Sequence[P],
        must_stop: Callable[[], bool] = lambda: False,
    ) -> Iterator[R | None]:
        """Work on pieces; where a process died, its pieces and those that waited go to new ones."""

        def send(piece: P) -> Future[R]:
            return self._pool.submit(task, problem, piece)

        n_done = 0
        for _ in range(_ATTEMPTS):
            try:
                for found in _in_order(send, pieces[n_done:], self.n_workers, must_stop):
                    yield found
                    n_done += 1
                return
            except BrokenProcessPool:
                self.close()
                self._pool = self._started()
        raise UserError(f"--workers {self.n_workers}: workers die again and again; they may lack memory: take fewer")

    def close(self) -> None:
        """End the processes."""
        self._pool.shutdown(cancel_futures=True)

    def _started(self) -> ProcessPoolExecutor:
        # Neither threads nor compiled code survive a fork.
        spawned = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self.n_workers, mp_context=spawned, initializer=end_with_parent)


class Dask:
    """Works on the workers of a Dask scheduler, which sends lost pieces again by itself.

    Parameters
    ----------
    address : str
        Of the scheduler, such as ``tcp://10.0.0.1:8786``.

    Raises
    ------
    UserError
        If Dask is missing, or no scheduler or worker answers.
    """

    def __init__(self, address: str) -> None:
        require_installed("distributed", "--scheduler")
        # Imported here: an extra of its own.
        from distributed import Client

        try:
            self._client = Client(address, timeout="10s", set_as_default=False)
            self._client.wait_for_workers(1, timeout=60)
            self._pool = self._client.get_executor(pure=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise UserError(f"--scheduler {address}: no scheduler with a worker answers there ({error})") from error

    @property
    def n_workers(self) -> int:
        """Threads of all workers there are now."""
        return max(1, int(sum(self._client.nthreads().values())))

    def each[P, R](
        self,
        task: Callable[[bytes, P], R],
        problem: bytes,
        pieces: Sequence[P],
        must_stop: Callable[[], bool] = lambda: False,
    ) -> Iterator[R | None]:
        """Work on pieces on whichever workers there are."""
        # A task of its own, not scattered data: lost with its worker, it is made again.
        name = hashlib.sha256(problem).hexdigest()
        source = self._client.submit(bytes, problem, key=f"bwbn-problem-{name}")
        yield from _in_order(partial(self._pool.submit, task, source), pieces, self.n_workers, must_stop)

    def close(self) -> None:
        """Leave the scheduler."""
        self._client.close()


def _in_order[P, R](
    send: Callable[[P], Future[R]], pieces: Sequence[P], n_workers: int, must_stop: Callable[[], bool]
) -> Iterator[R | None]:
    """What comes of pieces, in their order, however they end; a few are sent at a time."""
    sent: list[Future[R] | None] = []
    running: set[Future[R]] = set()
    for number in range(len(pieces)):
        while True:
            running = {one for one in running if not one.done()}
            while len(sent) < len(pieces) and len(running) < _AT_ONCE * n_workers:
                future = None if must_stop() else send(pieces[len(sent)])
                sent.append(future)
                running |= {future} if future is not None else set()
            own = sent[number]
            if own is None or own.done():
                break
            wait(running, return_when=FIRST_COMPLETED)
        yield None if own is None else own.result()
        sent[number] = None


def solve(problem: bytes, piece: Piece) -> tuple[Floats, ...]:
    """Solve one piece: what a worker runs.

    Parameters
    ----------
    problem : bytes
        Pickled: name of the quantity, engine, model and record.
    piece : Piece

    Returns
    -------
    tuple of arrays
        ``(misfit,)``, or the three of the normal equations.
    """
    quantity, engine, model, record = _unpacked(problem)
    draws, free = piece
    if quantity == "misfit":
        return (engine.misfit(model, draws, record),)
    found = engine.normal_equations(model, draws, record, free=free)
    return found.misfit, found.gradient, found.information


@lru_cache(maxsize=16)
def _unpacked(problem: bytes) -> tuple[str, Engine, Structure, Record]:
    return cast("tuple[str, Engine, Structure, Record]", cloudpickle.loads(problem))


@contextmanager
def opened(workers: int, scheduler: str | None) -> Iterator[Executor | None]:
    """What works beside this process; None where there is neither a scheduler nor a second worker.

    Raises
    ------
    UserError
        If Dask is missing, or no scheduler or worker answers.
    """
    if scheduler is None and workers == 1:
        yield None
        return
    executor = Dask(scheduler) if scheduler is not None else Processes(workers)
    try:
        yield executor
    finally:
        executor.close()


@contextmanager
def spread(engine: Engine, workers: int, scheduler: str | None) -> Iterator[Engine]:
    """An engine whose batches go to workers; the same one where there is neither a scheduler nor a second worker."""
    with opened(workers, scheduler) as executor:
        yield engine if executor is None else spread_over(engine, executor)


def spread_over(engine: Engine, executor: Executor) -> Engine:
    """An engine whose batches go through an executor."""
    own: dict[str, Any] = {one.name: getattr(engine, one.name) for one in fields(cast("Any", engine))}
    return _spread_kind(type(engine))(**own, executor=executor)


@cache
def _spread_kind(kind: type) -> Callable[..., Engine]:
    """An engine's kind, spreading; still of that kind, so that a finer scheme of it spreads too."""
    executor = ("executor", Executor, field(repr=False))
    bases, namespace = (_Spreading, kind), {"own_kind": kind}
    return make_dataclass(
        f"Spread{kind.__name__}", [executor], bases=bases, namespace=namespace, frozen=True, kw_only=True
    )


class _Spreading:
    """What an engine that spreads does beside its own."""

    executor: Executor
    own_kind: ClassVar[type]

    @property
    def n_workers(self) -> int:
        """Of the executor."""
        return self.executor.n_workers

    def misfit(self, model: Structure, draws: Floats, record: Record) -> Floats:
        """As of the engine; few draws, which share lanes, are solved here."""
        if len(draws) <= LANES:
            return self._own().misfit(model, draws, record)
        (found,) = self._run("misfit", model, record, draws, None)
        return found

    def normal_equations(
        self, model: Structure, draws: Floats, record: Record, *, free: Booleans | None = None
    ) -> NormalEquations:
        """As of the engine; few draws, which share lanes, are solved here."""
        if len(draws) <= LANES:
            own = self._own()
            return own.normal_equations(model, draws, record, free=free)
        misfit, gradient, information = self._run("normal equations", model, record, draws, free)
        return NormalEquations(misfit=misfit, gradient=gradient, information=information)

    def _own(self) -> Engine:
        """The engine itself."""
        own = {one.name: getattr(self, one.name) for one in fields(self.own_kind)}
        return cast("Engine", self.own_kind(**own))

    def _run(
        self, quantity: str, model: Structure, record: Record, draws: Floats, free: Booleans | None
    ) -> tuple[Floats, ...]:
        engine: Any = self._own()
        if is_dataclass(engine) and any(one.name == "n_threads" for one in fields(engine)):
            engine = replace(cast("Any", engine), n_threads=1)
        problem = cloudpickle.dumps((quantity, engine, model, record))
        n_blocks = -(-len(draws) // LANES)
        size = LANES * -(-n_blocks // (_PIECES_PER_WORKER * self.n_workers))
        rows = [slice(start, start + size) for start in range(0, len(draws), size)]
        pieces: list[Piece] = [(draws[some], None if free is None else free[some]) for some in rows]
        parts = cast("Iterator[tuple[Floats, ...]]", self.executor.each(solve, problem, pieces))
        return tuple(np.concatenate(arrays) for arrays in zip(*parts, strict=True))
