"""Stages of many fits: in order, as far as there is time, told in numbers."""

from __future__ import annotations

import time
from io import StringIO

import pytest
from rich.console import Console

from bwbn_bayes.cli.console import told
from bwbn_bayes.discovery import pace
from bwbn_bayes.discovery.pace import UNHURRIED, Pace, Progress
from bwbn_bayes.discovery.workers import Threads


@pytest.mark.parametrize("n_workers", [1, 3])
def test_items_come_in_order_whatever_their_threads(n_workers: int) -> None:
    def slow_at_first(n: int) -> int:
        time.sleep(0.005 * (6 - n))
        return n * n

    found = list(Pace(workers=Threads(n_workers)).each(slow_at_first, range(6), "squared {} numbers"))
    assert found == [(n, n * n) for n in range(6)]


def test_what_there_is_no_time_for_is_left_out() -> None:
    begun: list[int] = []

    def begin(n: int) -> None:
        begun.append(n)

    found = Pace(must_stop=lambda: len(begun) == 2).each(begin, range(5), "begun {}")
    assert [n for n, _ in found] == begun == [0, 1]


def test_what_fails_fails_the_stage() -> None:
    with pytest.raises(ZeroDivisionError):
        list(UNHURRIED.each(lambda n: 1 // n, [1, 0], "divided {}"))


def test_how_far_a_stage_is_is_told_now_and_then(monkeypatch: pytest.MonkeyPatch) -> None:
    heard: list[str] = []
    unhurried = Pace(tell=lambda text, _: heard.append(text))
    list(unhurried.each(str, range(100), "fitted {} hypotheses"))
    assert heard == []  # it was done before anybody could wonder
    monkeypatch.setattr(pace, "_EVERY", 0.0)
    list(unhurried.each(str, range(100), "fitted {} hypotheses", size=lambda _: 2))
    assert heard[0] == "fitted 10 of 200 hypotheses, about 1 s left"
    assert len(heard) == 19


def test_a_terminal_shows_it_in_place_and_a_file_line_by_line() -> None:
    far = Progress(n_done=3, n_all=9, left_s=40.2)
    said = far.in_words("fitted {} hypotheses")
    assert said == "fitted 3 of 9 hypotheses, about 40 s left"
    for is_terminal in (True, False):
        console = Console(file=StringIO(), force_terminal=is_terminal, width=100)
        with told(console) as tell:
            tell("fitting 9 hypotheses", None)
            tell(said, far)
        written = console.file.getvalue()  # type: ignore[attr-defined]
        assert " s  fitting 9 hypotheses" in written
        assert (f" s  {said}" in written) is not is_terminal
