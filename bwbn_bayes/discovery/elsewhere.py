"""Hypotheses fitted by the workers of an executor, to whom items go and from whom answers come.

What hundreds of items share is not sent with each of them: records once, of the journal what it held when the run
began, of the count of solves nothing. Answers come back to the caller's own ones: what a worker has fitted is kept in
the caller's journal, what it has solved is counted there.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from io import BytesIO
from typing import Any, NamedTuple, cast

import cloudpickle
from threadpoolctl import ThreadpoolController

from bwbn_bayes.engines.executors import Executor
from bwbn_bayes.engines.journal import Carried, Journal
from bwbn_bayes.engines.lanes import ALONE
from bwbn_bayes.inference.likelihood import SolveCount
from bwbn_bayes.records.record import Record


@dataclass(frozen=True)
class Elsewhere:
    """An executor's workers, of one thread each.

    Parameters
    ----------
    executor : Executor
    """

    executor: Executor

    def each[T, R](
        self, function: Callable[[T], R], items: Sequence[T], must_stop: Callable[[], bool] = lambda: False
    ) -> Iterator[tuple[R] | None]:
        """Function and items are pickled, and so is what comes of them."""
        shared: list[_Shared] = []
        pieces = [_packed(item, shared, more=True) for item in items]
        own = _packed(function, shared, more=True)
        problem = cloudpickle.dumps((own, [_sent(one) for one in shared]))
        for item, answer in zip(items, self.executor.each(work, problem, pieces, must_stop), strict=True):
            if answer is None:
                yield None
                continue
            for one, brought in zip(shared, answer.brought, strict=True):
                if isinstance(one, Journal):
                    one.take(cast(bytes, brought))
                elif isinstance(one, SolveCount):
                    one.add(cast(int, brought))
            yield (cast(R, item if answer.made is None else _unpacked(answer.made, shared)),)


_Shared = Record | Journal | SolveCount
_Sent = Record | Carried | None
"""Of a journal what was kept before, of a count nothing."""


class _Answer(NamedTuple):
    """Of a worker."""

    made: bytes | None
    """What the function made, packed; None where that is the very item."""
    brought: list[bytes | int | None]
    """Of each thing that is shared: what the journal took up, how much was solved."""


def work(problem: bytes, piece: bytes) -> _Answer:
    """What a function makes of an item: what a worker runs.

    Parameters
    ----------
    problem : bytes
        Pickled: the function, packed, and what it shares with its items.
    piece : bytes
        The item, packed.
    """
    packed, sent = _opened(problem)
    shared = [_received(one) for one in sent]
    function, item = _unpacked(packed, shared), _unpacked(piece, shared)
    token = ALONE.set(True)
    try:
        with _threads().limit(limits=1, user_api="blas"):
            made = function(item)
    finally:
        ALONE.reset(token)
    brought: list[bytes | int | None] = [
        one.added if isinstance(one, Journal) else one.total if isinstance(one, SolveCount) else None for one in shared
    ]
    return _Answer(None if made is item else _packed(made, shared, more=False), brought)


def _sent(one: _Shared) -> _Sent:
    """What stands for a shared thing on its way."""
    if isinstance(one, Journal):
        return one.carried
    return one if isinstance(one, Record) else None


def _received(one: _Sent) -> _Shared:
    """A worker's own: journal and count begin with each item, so that they tell what it brought."""
    if one is None:
        return SolveCount()
    return one if isinstance(one, Record) else Journal.in_memory(one)


@lru_cache(maxsize=2)
def _opened(problem: bytes) -> tuple[bytes, list[_Sent]]:
    return cast("tuple[bytes, list[_Sent]]", pickle.loads(problem))


@cache
def _threads() -> ThreadpoolController:
    """Finding the libraries takes longer than a short fit."""
    return ThreadpoolController()


class _Pickler(cloudpickle.Pickler):  # type: ignore[misc]  # it has no types
    """Writes numbers in the place of what is shared."""

    def __init__(self, file: BytesIO, shared: list[_Shared], *, more: bool) -> None:
        super().__init__(file)
        self._shared, self._more = shared, more

    def persistent_id(self, obj: object) -> int | None:
        """Where a shared thing stands; None for what is written out."""
        if not isinstance(obj, _Shared):
            return None
        known = next((number for number, one in enumerate(self._shared) if one is obj), None)
        if known is None and self._more:
            self._shared.append(obj)
            return len(self._shared) - 1
        return known


class _Unpickler(pickle.Unpickler):
    """Puts in what is shared."""

    def __init__(self, file: BytesIO, shared: Sequence[_Shared]) -> None:
        super().__init__(file)
        self._shared = shared

    def persistent_load(self, pid: int) -> _Shared:
        """What has this number."""
        return self._shared[pid]


def _packed(one: object, shared: list[_Shared], *, more: bool) -> bytes:
    """Pickled; ``more`` says whether further things may be shared, or are written out."""
    stream = BytesIO()
    _Pickler(stream, shared, more=more).dump(one)
    return stream.getvalue()


def _unpacked(packed: bytes, shared: Sequence[_Shared]) -> Any:
    return _Unpickler(BytesIO(packed), shared).load()
