"""Functions that ask for one value after another, their questions answered together.

A sampler asks for a density deep inside its own code. Each of several runs in a thread of its own until it asks; once
all that go on have asked, one call answers them. Only one thread runs at a time while the others wait: what they share
needs no locks, and what comes of them does not depend on how threads are scheduled.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from queue import SimpleQueue

import numpy as np

from bwbn_bayes.parameters import Floats

Ask = Callable[[Floats], tuple[float, Floats]]
"""A value and its gradient ``(n_dim,)`` at one point ``(n_dim,)``."""


class _Stopped(BaseException):
    """Ends a function that waits for an answer: no error, so that nothing on its way handles it."""


class _Task[T]:
    """A function in a thread, which runs only while :meth:`go_on` waits for it.

    Attributes
    ----------
    question : (n_dim,) array or None
        What is asked; none where the function has ended.
    """

    question: Floats | None
    result: T

    def __init__(self, function: Callable[[Ask], T]) -> None:
        self._function = function
        self._error: BaseException | None = None
        self._answers: SimpleQueue[tuple[float, Floats] | None] = SimpleQueue()
        self._turns: SimpleQueue[None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="lockstep", daemon=True)

    def start(self) -> None:
        """Run until it asks or ends."""
        self._thread.start()
        self._wait()

    def go_on(self, value: float, gradient: Floats) -> None:
        """Answer, and run until it asks again or ends."""
        self._answers.put((value, gradient))
        self._wait()

    def stop(self) -> None:
        """End it where it waits, or will wait, for an answer."""
        self._answers.put(None)
        if self._thread.ident is not None:
            self._thread.join()

    def _wait(self) -> None:
        self._turns.get()
        if self._error is not None:
            raise self._error

    def _ask(self, point: Floats) -> tuple[float, Floats]:
        self.question = point
        self._turns.put(None)
        answer = self._answers.get()
        if answer is None:
            raise _Stopped
        return answer

    def _run(self) -> None:
        try:
            self.result = self._function(self._ask)
        except BaseException as error:
            self._error = error
        self.question = None
        self._turns.put(None)


def in_lockstep[T](
    functions: Sequence[Callable[[Ask], T]], answer: Callable[[Floats], tuple[Floats, Floats]]
) -> list[T]:
    """Run functions side by side, and return what they return.

    Parameters
    ----------
    functions : sequence of callable
        Each takes what it is to call for the value and the gradient at a point.
    answer : callable
        Values ``(n,)`` and gradients ``(n, n_dim)`` at points ``(n, n_dim)``, those of the functions that go on in
        their order. It is called from the caller's own thread.

    Raises
    ------
    BaseException
        What a function or the answer raises; the other functions are ended.
    """
    tasks = [_Task(function) for function in functions]
    try:
        for task in tasks:
            task.start()
        while asking := [(task, task.question) for task in tasks if task.question is not None]:
            values, gradients = answer(np.stack([point for _, point in asking]))
            for (task, _), value, gradient in zip(asking, values, gradients, strict=True):
                task.go_on(float(value), gradient)
    finally:
        for task in tasks:
            task.stop()
    return [task.result for task in tasks]
