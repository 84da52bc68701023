"""How far a stage of many fits has come, and whether there is time for another."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from bwbn_bayes.discovery.workers import ONE_THREAD, Workers

_EVERY = 2.0
"""Between two messages at least. [s]"""
_SHARE = 0.05
"""Of a stage, between two messages at least: a long stage says no more than a short one."""


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How far a stage is.

    Attributes
    ----------
    n_done, n_all : int
        Hypotheses.
    left_s : float
        What the others will take if they are like those. [s]
    """

    n_done: int
    n_all: int
    left_s: float

    def in_words(self, done: str) -> str:
        """``fitted 12 of 118 hypotheses, about 40 s left``; ``done`` says what was done, ``fitted {} hypotheses``."""
        return f"{done.format(f'{self.n_done} of {self.n_all}')}, about {max(self.left_s, 1.0):.0f} s left"


@dataclass(frozen=True, kw_only=True)
class Pace:
    """Who works, whether there is time, and who is told; by default one thread, all of it, and nobody.

    Parameters
    ----------
    must_stop : callable
        Asked before each item; where it says so, the item is left out.
    tell : callable
        Told how far a stage is, in words and numbers.
    workers : Workers
        Make something of items.
    """

    must_stop: Callable[[], bool] = lambda: False
    tell: Callable[[str, Progress], None] = lambda *_: None
    workers: Workers = ONE_THREAD

    def each[T, R](
        self,
        function: Callable[[T], R],
        items: Sequence[T],
        done: str,
        size: Callable[[T], int] = lambda _: 1,
    ) -> Iterator[tuple[T, R]]:
        """Items with what a function makes of each, in order; without those there was no time for.

        Parameters
        ----------
        function : callable
            As for :meth:`Workers.each`; the workers' timing changes nothing but how many items a limit leaves out.
        items : sequence
        done : str
            What was done, its number in braces: ``fitted {} hypotheses``.
        size : callable
            Hypotheses in an item.
        """
        began = told = time.perf_counter()
        n_all, n_done, n_told = sum(map(size, items)), 0, 0
        for item, made in zip(items, self.workers.each(function, items, self.must_stop), strict=True):
            if made is None:
                continue
            n_done, now = n_done + size(item), time.perf_counter()
            if n_done < n_all and now - told >= _EVERY and n_done - n_told >= _SHARE * n_all:
                left = (now - began) / n_done * (n_all - n_done)
                progress = Progress(n_done=n_done, n_all=n_all, left_s=left)
                self.tell(progress.in_words(done), progress)
                told, n_told = now, n_done
            yield item, made[0]


UNHURRIED = Pace()
"""All the time there is."""
