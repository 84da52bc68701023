"""Figures drawn in a second process, while this one writes arrays.

It is started ahead of its work and loads what draws while this one solves, which loads Matplotlib at the end alone.
Threads would not do: Matplotlib and HDF5 both hold the interpreter.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from bwbn_bayes.engines.children import RUNNING
from bwbn_bayes.report.pieces import N_FIGURES, POSTERIOR, Content

if TYPE_CHECKING:
    from bwbn_bayes.report.canvas import Drawing

_SERVE = "from bwbn_bayes.report.second_process import serve; serve()"
_NUMBERS = tuple(number for number in range(N_FIGURES) if number != POSTERIOR)
"""Of the figures that the second process draws, in this order."""


class SecondProcess:
    """A process that draws, by pipes: it ends with them, and so with this one. It is not for Ctrl-C in a terminal."""

    def __init__(self) -> None:
        command = [sys.executable, "-P", "-c", _SERVE]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, process_group=0
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._to, self._from = self._process.stdin, self._process.stdout
        RUNNING.append(self._process)
        self._found: dict[int, Drawing | None] = {}
        self._ended = True
        self._news = threading.Condition()

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    def begin(self, content: Content) -> None:
        """Have figures drawn, one after the other."""
        self._ended = False
        threading.Thread(target=self._exchange, args=(content,), name="figures", daemon=True).start()

    def drawn(self, content: Content) -> dict[int, Drawing | None]:
        """Every figure by its number on the page; what the other process has not come to is drawn here, last first."""
        from bwbn_bayes.report.figures import draw  # with Matplotlib

        here = {POSTERIOR: draw(content, POSTERIOR)}
        while True:
            with self._news:
                missing = [number for number in _NUMBERS if number not in here and number not in self._found]
                # The first of them is what the other process is at.
                if len(missing) == 1 and not self._ended:
                    self._news.wait()
                    continue
            if not missing:
                return {**self._found, **here}
            here[missing[-1]] = draw(content, missing[-1])

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        RUNNING.remove(self._process)
        for pipe in (self._to, self._from):
            with suppress(OSError):  # what was not sent any more
                pipe.close()

    def _exchange(self, content: Content) -> None:
        try:
            pickle.dump(content, self._to)
            self._to.flush()
            for number in _NUMBERS:
                drawing = pickle.load(self._from)  # of a process of our own
                with self._news:
                    self._found[number] = drawing
                    self._news.notify()
        except (OSError, EOFError, ValueError, pickle.UnpicklingError):  # it has died, or was ended
            pass
        finally:
            with self._news:
                self._ended = True
                self._news.notify()


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


def all_drawn(content: Content, hand: SecondProcess | None) -> tuple[Drawing, ...]:
    """Every figure that the content allows, in the page's order, with the help of a process that has begun."""
    from bwbn_bayes.report.figures import draw_all

    if hand is None:
        return draw_all(content)
    found = hand.drawn(content)
    drawings = (found[number] for number in range(N_FIGURES))
    return tuple(drawing for drawing in drawings if drawing is not None)


def serve() -> None:
    """Draw what comes in by stdin, each figure out by stdout: what the second process runs."""
    from bwbn_bayes.report.figures import draw

    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is none of the answers
    content = pickle.load(sys.stdin.buffer)  # of the process that started this one
    for number in _NUMBERS:
        pickle.dump(draw(content, number), out)
        out.flush()
