"""The same bits from one process, from several and from a cluster, also where a worker dies meanwhile."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from inference_cases import recorded, sdof_model
from serial_executor import Serial

from bwbn_bayes import Settings, UserError, identify
from bwbn_bayes.engines.executors import Dask, Executor, Processes, spread_over
from bwbn_bayes.engines.journal import has_begun, kept
from bwbn_bayes.engines.lanes import Lanes

MODEL, RECORD = sdof_model(), recorded(1)
ENGINE = Lanes(substeps=1, resolution=0.25)
DRAWS = MODEL.space.from_unit(MODEL.space.sample_unit(np.random.default_rng(1), 150))


class Counting:
    """Tells how many pieces of which size were asked for."""

    n_workers = 3

    def __init__(self) -> None:
        self.sizes: list[int] = []

    def each(
        self, task: Callable[[bytes, Any], Any], problem: bytes, pieces: Sequence[Any], *given: Callable[[], bool]
    ) -> Iterator[Any]:
        self.sizes += [len(draws) for draws, _ in pieces]
        return Serial().each(task, problem, pieces, *given)


def assert_same_bits(executor: Executor) -> None:
    spread = spread_over(ENGINE, executor)
    np.testing.assert_array_equal(spread.misfit(MODEL, DRAWS, RECORD), ENGINE.misfit(MODEL, DRAWS, RECORD))
    found, own = (engine.normal_equations(MODEL, DRAWS[:40], RECORD) for engine in (spread, ENGINE))
    np.testing.assert_array_equal(found.information, own.information)
    np.testing.assert_array_equal(found.gradient, own.gradient)


def test_pieces_are_blocks_of_lanes_for_every_worker() -> None:
    counting = Counting()
    assert_same_bits(counting)
    assert counting.sizes[:5] == [32, 32, 32, 32, 22]
    assert spread_over(ENGINE, counting).misfit(MODEL, DRAWS[:0], RECORD).shape == (0, 1)


def test_what_fills_one_block_is_not_sent() -> None:
    """A stage of TMCMC moves few chains at a time: on a cluster each step waited for the network."""
    counting = Counting()
    found = spread_over(ENGINE, counting).misfit(MODEL, DRAWS[:16], RECORD)
    np.testing.assert_array_equal(found, ENGINE.misfit(MODEL, DRAWS[:16], RECORD))
    assert counting.sizes == []


def test_what_is_kept_and_spread_is_both(tmp_path: Path) -> None:
    counting, expected = Counting(), ENGINE.misfit(MODEL, DRAWS, RECORD)
    for _ in range(2):  # the few that are solved again before the file is believed are solved here
        with kept(spread_over(ENGINE, counting), tmp_path / "run") as engine:
            np.testing.assert_array_equal(engine.misfit(MODEL, DRAWS, RECORD), expected)
        assert len(counting.sizes) == 5
    with kept(ENGINE, tmp_path / "run") as engine:  # and goes on in one process
        np.testing.assert_array_equal(engine.misfit(MODEL, DRAWS, RECORD), expected)
    assert has_begun(tmp_path / "run")
    assert (tmp_path / "run.solves").stat().st_size < 2 * 8 * len(DRAWS)


def _killing(pid: int) -> threading.Timer:
    timer = threading.Timer(0.05, os.kill, (pid, signal.SIGKILL))
    timer.start()
    return timer


@pytest.mark.slow
def test_processes_give_the_same_bits_and_outlive_one_of_them() -> None:
    executor = Processes(2)
    try:
        assert_same_bits(executor)
        process = next(iter(executor._pool._processes.values()))
        _killing(process.pid)
        draws = np.tile(DRAWS, (10, 1))
        found = spread_over(ENGINE, executor).misfit(MODEL, draws, RECORD)
        np.testing.assert_array_equal(found, ENGINE.misfit(MODEL, draws, RECORD))
    finally:
        executor.close()


@pytest.mark.slow
def test_tmcmc_on_two_processes_is_that_of_one() -> None:
    own, spread = (identify(MODEL, RECORD, settings=Settings(method="tmcmc", particles=100, workers=n)) for n in (1, 2))
    np.testing.assert_array_equal(own.tree["posterior"]["k"], spread.tree["posterior"]["k"])
    assert own.facts.log_evidence == spread.facts.log_evidence
    assert own.facts.n_solves == spread.facts.n_solves


distributed = pytest.mark.skipif(find_spec("distributed") is None, reason="the extra [distributed] is not installed")


@distributed
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # what the cluster says when a worker is killed is its own
def test_a_cluster_gives_the_same_bits_and_outlives_a_worker() -> None:
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        executor = Dask(cluster.scheduler_address)
        assert executor.n_workers == 2
        assert_same_bits(executor)
        victim = next(iter(cluster.workers.values()))
        _killing(victim.process.pid)
        draws = np.tile(DRAWS, (10, 1))
        found = spread_over(ENGINE, executor).misfit(MODEL, draws, RECORD)
        np.testing.assert_array_equal(found, ENGINE.misfit(MODEL, draws, RECORD))
        while executor.n_workers < 2:  # its nanny starts another
            time.sleep(0.1)
        executor.close()


@distributed
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_run_on_a_cluster_that_loses_a_worker_is_that_of_one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    from distributed import LocalCluster

    settings = Settings(particles=1000, alternatives=False)
    alone = identify(MODEL, RECORD, settings=settings)
    calls, each = iter(range(10**6)), Dask.each
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        victim = next(iter(cluster.workers.values())).process.pid

        def solve_and_kill(self: Dask, *given: Any) -> Iterator[Any]:
            if next(calls) == 5:
                _killing(victim)
            return each(self, *given)

        monkeypatch.setattr(Dask, "each", solve_and_kill)
        spread = identify(MODEL, RECORD, settings=replace(settings, scheduler=cluster.scheduler_address))
    assert next(calls) > 10
    assert not Path(f"/proc/{victim}").exists()
    xr.testing.assert_identical(alone.tree["posterior"].to_dataset(), spread.tree["posterior"].to_dataset())
    assert (alone.facts.log_evidence, alone.facts.n_solves) == (spread.facts.log_evidence, spread.facts.n_solves)


def test_an_address_without_a_scheduler_is_the_user_s_mistake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(
        UserError, match="--scheduler needs distributed, which is not installed: add the extra distributed"
    ):
        Dask("tcp://127.0.0.1:1")
