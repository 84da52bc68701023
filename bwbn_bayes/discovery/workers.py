"""Who fits hypotheses: threads of this process, or others (:mod:`~bwbn_bayes.discovery.elsewhere`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol


class Workers(Protocol):
    """Makes something of items, several at a time."""

    def each[T, R](
        self, function: Callable[[T], R], items: Sequence[T], must_stop: Callable[[], bool] = lambda: False
    ) -> Iterator[tuple[R] | None]:
        """What a function makes of each item, in order; None for those left out.

        Parameters
        ----------
        function : callable
            Of a module, or a part of one with arguments; who runs it, and when, changes nothing.
        items : sequence
        must_stop : callable, optional
            Asked before each item; where it says so, the item is left out.
        """
        ...


@dataclass(frozen=True)
class Threads:
    """Of this process.

    Parameters
    ----------
    n_workers : int
        How many.
    """

    n_workers: int

    def each[T, R](
        self, function: Callable[[T], R], items: Sequence[T], must_stop: Callable[[], bool] = lambda: False
    ) -> Iterator[tuple[R] | None]:
        """Most fits fill a block or two of lanes, not the processors."""

        def attempt(item: T) -> tuple[R] | None:
            return None if must_stop() else (function(item),)

        with ThreadPoolExecutor(max_workers=self.n_workers) as pool:
            yield from pool.map(attempt, items)


ONE_THREAD = Threads(1)
