"""What is kept of a run that is killed: the same answers, of nothing else, whatever else stands in the file."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from full_disk import full_at
from inference_cases import MODELS, recorded, sdof_model

from bwbn_bayes import BoucWen, Result, Settings, ShearBuilding, Uniform, UserError, identify, join_records
from bwbn_bayes.engines import journal
from bwbn_bayes.engines.journal import Journal, forget, has_begun, kept
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.results import Facts

RECORD = recorded(1).until(8.0)
MODEL = ShearBuilding(
    masses=[1.0],
    storey=BoucWen(k=Uniform(20, 60), c=0.2, alpha=0.1, A=1.0, beta=Uniform(0.5, 8.0), gamma=1.0, n=1.5),
)


class KilledError(Exception):
    """Stands for a killed process."""


@contextmanager
def killed_after(n_answers: int) -> Iterator[None]:
    """Raise once so many answers are kept."""
    own, count = Journal._append, iter(range(n_answers))

    def append(self: Journal, *given: object) -> None:
        if next(count, None) is None:
            raise KilledError
        own(self, *given)  # type: ignore[arg-type]

    Journal._append = append  # type: ignore[method-assign]
    try:
        with pytest.raises(KilledError):
            yield
    finally:
        Journal._append = own  # type: ignore[method-assign]


def timeless(facts: Facts) -> Facts:
    return replace(facts, elapsed_s=0.0, stages=tuple(replace(stage, elapsed_s=0.0) for stage in facts.stages))


def assert_same(one: Result, other: Result) -> None:
    """But for times."""
    assert repr(timeless(one.facts)) == repr(timeless(other.facts))
    xr.testing.assert_identical(one.tree, other.tree)


SMC = pytest.param("smc", (9,), marks=pytest.mark.slow)  # PyMC compiles for each of three runs


@pytest.mark.parametrize(("method", "kills"), [("importance", (2, 9)), ("tmcmc", (40,)), SMC, ("ga", (2, 4))])
def test_a_killed_run_goes_on_to_the_same_result(tmp_path: Path, method: str, kills: tuple[int, ...]) -> None:
    """Only TMCMC could go on, and left the stages before out of its history, and their solves out of its count.

    The catalogue of alternatives, whatever the method asked for the same way, is run beside importance sampling.
    """
    from bwbn_bayes.baselines.genetic import GeneticSettings

    settings = Settings(method=method, particles=100, alternatives=method == "importance")
    genetic = GeneticSettings(generations=10)
    whole = identify(MODEL, RECORD, settings=settings, options=genetic if method == "ga" else None)
    settings = replace(settings, checkpoint=tmp_path / "run")
    for n_answers in kills:
        with killed_after(n_answers):
            identify(MODEL, RECORD, settings=settings, options=genetic if method == "ga" else None)
    assert has_begun(tmp_path / "run")
    assert_same(identify(MODEL, RECORD, settings=settings, options=genetic if method == "ga" else None), whole)


def _misfit(path: Path, draws: np.ndarray, model: ShearBuilding = MODEL) -> tuple[np.ndarray, int]:
    """Answer, and draws that were solved for it."""
    counted = []

    class Counting(Lanes):
        def misfit(self, model, draws, record):  # type: ignore[no-untyped-def]
            counted.append(len(draws))
            return super().misfit(model, draws, record)

    with kept(Counting(n_threads=1), path) as engine:
        return engine.misfit(model, draws, RECORD), sum(counted)


@pytest.fixture
def draws() -> np.ndarray:
    return MODEL.space.from_unit(np.random.default_rng(1).random((600, 2)))


def test_answers_are_kept_and_some_solved_again(tmp_path: Path, draws: np.ndarray) -> None:
    expected = Lanes().misfit(MODEL, draws, RECORD)
    for n_solved in (600, 4):
        found, n = _misfit(tmp_path / "run", draws)
        np.testing.assert_array_equal(found, expected)
        assert n == n_solved


def test_answers_about_joined_records_are_kept_block_by_block(tmp_path: Path, draws: np.ndarray) -> None:
    """They were cut to one column for each channel, which ended in a traceback."""
    joined = join_records([RECORD, RECORD.until(6.0)])
    expected = Lanes().misfit(MODEL, draws, joined)
    for _ in range(2):
        with kept(Lanes(n_threads=1), tmp_path / "run") as engine:
            np.testing.assert_array_equal(engine.misfit(MODEL, draws, joined), expected)


def test_a_file_cut_anywhere_gives_the_same_answers(tmp_path: Path, draws: np.ndarray) -> None:
    expected, _ = _misfit(tmp_path / "run", draws)
    path = tmp_path / "run.solves"
    whole = path.read_bytes()
    for end in (0, 7, 20, 25, 90, 300, len(whole) - 1):
        path.write_bytes(whole[:end])
        np.testing.assert_array_equal(_misfit(tmp_path / "run", draws)[0], expected)
        assert path.read_bytes() == whole
    for place in (40, 80, 500):
        damaged = bytearray(whole)
        damaged[place] ^= 1
        path.write_bytes(damaged)
        np.testing.assert_array_equal(_misfit(tmp_path / "run", draws)[0], expected)


def test_another_model_is_given_none_of_them(tmp_path: Path, draws: np.ndarray) -> None:
    _misfit(tmp_path / "run", draws)
    other = replace(MODEL, masses=(1.1,))
    np.testing.assert_array_equal(_misfit(tmp_path / "run", draws, other)[0], Lanes().misfit(other, draws, RECORD))


def test_other_code_is_given_none_of_them(tmp_path: Path, draws: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> None:
    _misfit(tmp_path / "run", draws)
    monkeypatch.setattr(journal, "_code", lambda: "an upgrade in the middle of a run")
    assert _misfit(tmp_path / "run", draws)[1] == len(draws)


def test_answers_that_nobody_solved_are_refused(tmp_path: Path) -> None:
    """A file that is whole, with the right hashes, and wrong: a NaN posterior was "8 of 8 parameters identified"."""
    for wrong in (np.array([np.nan, 1.0]), np.array([1.0]), np.array([[2.0]]), np.array([1, 1])):
        path = tmp_path / "run"
        (tmp_path / "run.solves").unlink(missing_ok=True)
        with Journal.opened(path) as journal:
            journal.kept("misfit", bytes(32), 2, lambda _, wrong=wrong: (wrong,))
        with Journal.opened(path) as journal, pytest.raises(UserError, match=r"delete .*run\.solves to start anew"):
            journal.kept("misfit", bytes(32), 2, lambda some: (np.array([1.0, 1.0])[some],))


def test_another_file_and_a_second_run_are_refused(tmp_path: Path) -> None:
    (tmp_path / "other.solves").write_text("my notes\n")
    with (
        pytest.raises(UserError, match="is no checkpoint of this version: delete it, or"),
        Journal.opened(tmp_path / "other"),
    ):
        pass
    assert (tmp_path / "other.solves").read_text() == "my notes\n"
    with Journal.opened(tmp_path / "run"):  # noqa: SIM117  (the second is tried while the first is open)
        with pytest.raises(UserError, match="another run writes it"), Journal.opened(tmp_path / "run"):
            pass


@pytest.mark.parametrize("n_bytes", [0, 10, 30, 3000, 4800])
def test_a_full_disk_is_one_sentence_and_costs_nothing_that_was_solved(
    tmp_path: Path, draws: np.ndarray, n_bytes: int
) -> None:
    """What could not be written was written again when the file was closed, and that ended in a traceback."""
    expected, _ = _misfit(tmp_path / "whole", draws)
    with full_at(n_bytes), pytest.raises(UserError, match=r"cannot be written \(File too large\)"):
        _misfit(tmp_path / "run", draws)
    whole, left = (tmp_path / "whole.solves").read_bytes(), (tmp_path / "run.solves").read_bytes()
    assert whole.startswith(left)
    assert len(left) == (0 if n_bytes < 20 else 20 if n_bytes < 4800 else 4316)
    np.testing.assert_array_equal(_misfit(tmp_path / "run", draws)[0], expected)
    assert (tmp_path / "run.solves").read_bytes() == whole


def test_what_is_no_plain_file_keeps_nothing(tmp_path: Path, draws: np.ndarray) -> None:
    """A named pipe ended in a traceback; `..` is a directory, not a name."""
    os.mkfifo(tmp_path / "run.solves")
    with pytest.raises(UserError, match="is no plain file"):
        _misfit(tmp_path / "run", draws)
    with pytest.raises(UserError, match="it is a directory"):
        _misfit(tmp_path / "..", draws)


@pytest.mark.parametrize("name", ["ck[1]", "ck*", "ck?", "[!x]k1", "ck 1", "-ck", "ck\x1b"])
def test_a_name_is_no_pattern(tmp_path: Path, draws: np.ndarray, name: str) -> None:
    """``ck[1]`` deleted the arrays of the run ``ck1``, ``ck*`` everybody's."""
    _misfit(tmp_path / "ck1", draws[:16])
    others = (tmp_path / "ck1.solves").read_bytes()
    expected, _ = _misfit(tmp_path / name, draws[:16])
    np.testing.assert_array_equal(_misfit(tmp_path / name, draws[:16])[0], expected)
    forget(tmp_path / name)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"ck1.solves": others}


RUN = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from inference_cases import recorded, sdof_model
from bwbn_bayes import Settings, identify
method, out = sys.argv[2], Path(sys.argv[3])
settings = Settings(method=method, particles=300, checkpoint=out / "run")
identify(sdof_model(), recorded(1), settings=settings).save(out / "part.nc")
(out / "part.nc").rename(out / "result.nc")
"""


@pytest.mark.slow
@pytest.mark.parametrize("method", ["importance", "tmcmc", "smc"])
def test_a_run_killed_at_twenty_random_moments_comes_to_the_same_result(tmp_path: Path, method: str) -> None:
    whole = identify(sdof_model(), recorded(1), settings=Settings(method=method, particles=300))
    command = [sys.executable, "-c", RUN, str(MODELS.parent / "tests" / "inference"), method, str(tmp_path)]
    moments, n_killed = random.Random(1), 0
    while n_killed < 20:
        with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
            time.sleep(moments.uniform(2.0, 30.0))
            n_killed += process.poll() is None
            process.send_signal(signal.SIGKILL)
        if (tmp_path / "result.nc").exists():
            assert_same_as_saved(tmp_path, whole)
            (tmp_path / "run.solves").unlink()
            (tmp_path / "result.nc").unlink()
    subprocess.run(command, check=True)
    assert_same_as_saved(tmp_path, whole)


def assert_same_as_saved(tmp_path: Path, whole: Result) -> None:
    whole.save(tmp_path / "whole.nc")
    assert_same(Result.load(tmp_path / "result.nc"), Result.load(tmp_path / "whole.nc"))
