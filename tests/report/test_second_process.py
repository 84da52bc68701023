"""Figures that a second process draws are those that this one would draw."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
from concurrent.futures import Future
from dataclasses import replace

import pytest

from bwbn_bayes.report.canvas import Drawing
from bwbn_bayes.report.content import gather
from bwbn_bayes.report.figures import draw_all
from bwbn_bayes.report.pieces import POSTERIOR, Content
from bwbn_bayes.report.second_process import SecondProcess, all_drawn, second_process
from bwbn_bayes.results import Result


@pytest.fixture(scope="module")
def content(result: Result) -> Content:
    """A few small figures of a page: posterior, learned, pairs, stages."""
    whole = gather(result)
    few = whole.marginals[:2]
    return replace(whole, traces=(), loops=(), histories=(), period=None, marginals=few, pairs=whole.pairs[:1])


@pytest.fixture(scope="module")
def expected(content: Content) -> tuple[Drawing, ...]:
    drawings = draw_all(content)
    assert [one.name for one in drawings] == ["posterior.png", "learned.png", "pairs.png", "stages.png"]
    return drawings


def test_both_processes_draw_the_same(content: Content, expected: tuple[Drawing, ...]) -> None:
    with second_process(wanted=True) as hand:
        assert hand is not None
        begun = hand.begin(content)
        assert POSTERIOR not in begun
        for future in begun.values():
            future.result()
        assert all_drawn(content, begun) == expected


def test_what_was_not_begun_is_drawn_here(content: Content, expected: tuple[Drawing, ...]) -> None:
    waiting: dict[int, Future[Drawing | None]] = {number: Future() for number in (0, 8)}
    assert all_drawn(content, waiting) == expected
    assert all(future.cancelled() for future in waiting.values())


def test_a_process_that_dies_costs_no_figure(content: Content, expected: tuple[Drawing, ...]) -> None:
    with second_process(wanted=True) as hand:
        assert hand is not None
        begun = hand.begin(content)
        for child in multiprocessing.active_children():
            os.kill(child.pid or 0, signal.SIGKILL)
        assert all_drawn(content, begun) == expected
        assert all_drawn(content, hand.begin(content)) == expected


def test_no_process_where_none_is_wanted() -> None:
    before = multiprocessing.active_children()
    with second_process(wanted=False) as hand:
        assert hand is None
        assert multiprocessing.active_children() == before


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="signals cannot be blocked here")
def test_ctrl_c_is_not_for_the_second_process() -> None:
    """A terminal sends it to both; the one that loads would answer with a traceback."""
    hand = SecondProcess()
    try:
        (child,) = multiprocessing.active_children()
        assert not child.join(0.05)
        os.kill(child.pid or 0, signal.SIGINT)
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, ())
        assert signal.SIGINT not in blocked
        assert hand._pool.submit(os.getpid).result() == child.pid
    finally:
        hand.close()


def test_what_draws_loads_little() -> None:
    """The second process would load for two seconds, not for half a one, what gathers and solves."""
    code = "import sys, bwbn_bayes.report.figures as f; print({'scipy', 'pandas', 'xarray', 'sympy'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
