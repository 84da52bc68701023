"""Figures that a second process draws are those that this one would draw."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from bwbn_bayes.engines.children import RUNNING
from bwbn_bayes.report.canvas import Drawing
from bwbn_bayes.report.content import gather
from bwbn_bayes.report.figures import draw_all
from bwbn_bayes.report.pieces import POSTERIOR, Content
from bwbn_bayes.report.second_process import all_drawn, second_process
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
        hand.begin(content)
        assert all_drawn(content, hand) == expected


def test_what_the_other_has_drawn_is_not_drawn_again(content: Content, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = []
    monkeypatch.setattr("bwbn_bayes.report.figures.draw", lambda _, number: drawn.append(number))
    with second_process(wanted=True) as hand:
        assert hand is not None
        hand.begin(content)
        while not hand._ended:
            time.sleep(0.02)
        found = hand.drawn(content)
    assert drawn == [POSTERIOR]
    assert [one.name for one in found.values() if one is not None] == ["learned.png", "pairs.png", "stages.png"]


def test_a_process_that_dies_costs_no_figure(content: Content, expected: tuple[Drawing, ...]) -> None:
    with second_process(wanted=True) as hand:
        assert hand is not None
        os.kill(hand.pid, signal.SIGKILL)
        hand.begin(content)
        assert all_drawn(content, hand) == expected


def test_no_process_where_none_is_wanted(content: Content, expected: tuple[Drawing, ...]) -> None:
    before = [*RUNNING]
    with second_process(wanted=False) as hand:
        assert before == RUNNING
        assert all_drawn(content, hand) == expected


def test_ctrl_c_in_a_terminal_is_not_for_the_second_process() -> None:
    """It goes to a whole group; a process that loads would answer with a traceback. The first one ends the second."""
    with second_process(wanted=True) as hand:
        assert hand is not None
        assert os.getpgid(hand.pid) == hand.pid != os.getpgrp()
        assert hand._process in RUNNING
    assert hand._process not in RUNNING
    assert hand._process.returncode == -signal.SIGKILL


def test_it_ends_with_the_first_process_however_that_ends() -> None:
    code = (
        "import time; from bwbn_bayes.report.second_process import SecondProcess\n"
        "print(SecondProcess().pid, flush=True); time.sleep(60)"
    )
    first = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    with first:
        assert first.stdout is not None
        second = int(first.stdout.readline())
        first.kill()
    until = time.monotonic() + 30.0
    while _runs(second):
        assert time.monotonic() < until
        time.sleep(0.05)


def _runs(pid: int) -> bool:
    """Whether a process is there, and no remains of one that nobody has asked after."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_what_draws_loads_little() -> None:
    """The second process would load for two seconds, not for half a one, what gathers and solves."""
    code = "import sys, bwbn_bayes.report.figures as f; print({'scipy', 'pandas', 'xarray', 'sympy'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
