"""Figures drawn in a second process, while this one writes arrays.

It is started ahead of its work and loads what draws while this one solves, which loads Matplotlib at the end alone.
Threads would not do: Matplotlib and HDF5 both hold the interpreter.
"""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import TYPE_CHECKING

from bwbn_bayes.engines.children import end_with_parent
from bwbn_bayes.report.pieces import N_FIGURES, POSTERIOR, Content

if TYPE_CHECKING:
    from bwbn_bayes.report.canvas import Drawing

_CONTENT: list[Content] = []
"""What the second process draws: sent once, not with each figure."""


class SecondProcess:
    """A process that draws."""

    def __init__(self) -> None:
        spawned = multiprocessing.get_context("spawn")
        self._pool = ProcessPoolExecutor(1, mp_context=spawned, initializer=end_with_parent)
        # Ctrl-C is for this process, which ends the other: that one, while it loads, would answer with a traceback.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self._pool.submit(_load)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def begin(self, content: Content) -> dict[int, Future[Drawing | None]]:
        """Have figures drawn, by their numbers on the page, one after the other; none where the process has died."""
        try:
            self._pool.submit(_keep, content)
            numbers = (number for number in range(N_FIGURES) if number != POSTERIOR)
            return {number: self._pool.submit(_draw_kept, number) for number in numbers}
        except BrokenProcessPool:
            return {}

    def close(self) -> None:
        """End the process."""
        self._pool.shutdown(cancel_futures=True)


@contextmanager
def second_process(*, wanted: bool) -> Iterator[SecondProcess | None]:
    """A process that draws, meanwhile, if one is wanted."""
    if not wanted:
        yield None
        return
    hand = SecondProcess()
    try:
        yield hand
    finally:
        hand.close()


def all_drawn(content: Content, begun: dict[int, Future[Drawing | None]]) -> tuple[Drawing, ...]:
    """Every figure that the content allows, in the page's order: what the other process has not begun is drawn here.

    Parameters
    ----------
    content : Content
    begun : mapping of int to Future
        What :meth:`SecondProcess.begin` has sent.
    """
    from bwbn_bayes.report.figures import draw  # with Matplotlib

    here = [number for number in reversed(range(N_FIGURES)) if number not in begun]
    found = {number: draw(content, number) for number in here}
    for number, future in reversed(begun.items()):
        if future.cancel():
            found[number] = draw(content, number)
    for number in begun.keys() - found.keys():
        try:
            found[number] = begun[number].result()
        except BrokenProcessPool:
            found[number] = draw(content, number)
    drawings = (found[number] for number in range(N_FIGURES))
    return tuple(drawing for drawing in drawings if drawing is not None)


def _load() -> None:
    import bwbn_bayes.report.figures  # noqa: F401


def _keep(content: Content) -> None:
    _CONTENT[:] = [content]


def _draw_kept(number: int) -> Drawing | None:
    from bwbn_bayes.report.figures import draw

    return draw(_CONTENT[0], number)
