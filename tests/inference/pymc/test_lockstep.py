"""Functions that ask for values, against what they get when they ask by themselves."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest
from pymc_cases import still_running, within_time

from bwbn_bayes.inference.pymc.lockstep import Ask, in_lockstep
from bwbn_bayes.parameters import Floats


def squares(points: Floats) -> tuple[Floats, Floats]:
    """Of points, and twice the points."""
    return np.sum(np.square(points), axis=1), 2.0 * points


def asking(*points: float) -> Callable[[Ask], list[float]]:
    """Squares and derivatives at some points, one asked for after the other."""

    def function(ask: Ask) -> list[float]:
        answers = [ask(np.array([point])) for point in points]
        return [part for value, gradient in answers for part in (value, gradient[0])]

    return function


def test_those_that_go_on_are_answered_together() -> None:
    asked: list[list[float]] = []

    def answer(points: Floats) -> tuple[Floats, Floats]:
        asked.append(points[:, 0].tolist())
        return squares(points)

    functions = [asking(1.0), asking(), asking(2.0, 3.0, 4.0), asking(5.0, 6.0)]
    found = within_time(lambda: in_lockstep(functions, answer))
    assert found == [[1.0, 2.0], [], [4.0, 4.0, 9.0, 6.0, 16.0, 8.0], [25.0, 10.0, 36.0, 12.0]]
    assert asked == [[1.0, 2.0, 5.0], [3.0, 6.0], [4.0]]
    assert not still_running()


def test_one_runs_at_a_time() -> None:
    running: list[int] = []

    def function(ask: Ask) -> int:
        most = 0
        for _ in range(5):
            running.append(1)
            time.sleep(0.002)
            most = max(most, len(running))
            running.pop()
            ask(np.zeros(1))
        return most

    assert within_time(lambda: in_lockstep([function] * 4, squares)) == [1] * 4


@pytest.mark.parametrize("failing", [0, 1, 2])
@pytest.mark.parametrize("after", [0, 3])
def test_an_error_in_one_ends_all(failing: int, after: int) -> None:
    """At the first turn some have not begun, and are not to begin."""
    error = ArithmeticError("of one")

    def fails(ask: Ask) -> list[float]:
        asking(*range(after))(ask)
        raise error

    functions = [asking(*range(1000))] * 3
    functions[failing] = fails
    with pytest.raises(ArithmeticError) as raised:
        within_time(lambda: in_lockstep(functions, squares))
    assert raised.value is error
    assert not still_running()


@pytest.mark.parametrize("error", [ArithmeticError("of the answer"), KeyboardInterrupt()])
def test_an_error_in_the_answer_ends_all_that_wait_for_it(error: BaseException) -> None:
    """A function that handles every error does not keep the others from ending."""
    handled: list[Exception] = []

    def answer(points: Floats) -> tuple[Floats, Floats]:
        if points[0, 0] == 2.0:
            raise error
        return squares(points)

    def handles(ask: Ask) -> list[float]:
        try:
            return asking(*range(1000))(ask)
        except Exception as caught:
            handled.append(caught)
            raise

    with pytest.raises(type(error)) as raised:
        within_time(lambda: in_lockstep([handles, asking(*range(1000))], answer))
    assert raised.value is error
    assert not handled
    assert not still_running()
