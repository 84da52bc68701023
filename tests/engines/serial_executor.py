"""Work in this process, for what is asked of every executor."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Serial:
    """Works in this process, on one piece after the other."""

    n_workers = 1

    def each[P, R](
        self,
        task: Callable[[bytes, P], R],
        problem: bytes,
        pieces: Sequence[P],
        must_stop: Callable[[], bool] = lambda: False,
    ) -> Iterator[R | None]:
        """One piece when it is asked for."""
        for piece in pieces:
            yield None if must_stop() else task(problem, piece)
