"""Hypotheses fitted by threads, by other processes and on a cluster: the same bits, whoever fits and whoever dies."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cloudpickle
import numpy as np
import pytest
from serial_executor import Serial
from threadpoolctl import threadpool_limits

from bwbn_bayes.cli import main
from bwbn_bayes.discovery import unnamed, workflow
from bwbn_bayes.discovery.candidates import Hypothesis, hypotheses, scales_of
from bwbn_bayes.discovery.elsewhere import Elsewhere
from bwbn_bayes.discovery.evidence import laplace
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.pace import Pace
from bwbn_bayes.discovery.race import Fit, race
from bwbn_bayes.discovery.run import DiscoverySettings
from bwbn_bayes.discovery.score import scores
from bwbn_bayes.discovery.second_look import searched
from bwbn_bayes.discovery.workers import Threads, Workers
from bwbn_bayes.discovery.workflow import discover
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import CubicStiffness, QuadraticDamping, SensorGain
from bwbn_bayes.engines.executors import Dask, Processes
from bwbn_bayes.engines.journal import Journal
from bwbn_bayes.engines.lanes import ALONE, Lanes
from bwbn_bayes.engines.simulation import simulate
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference import modes
from bwbn_bayes.inference.likelihood import Posterior, SolveCount, default_noise
from bwbn_bayes.inference.modes import distinct, polish
from bwbn_bayes.parameters import Floats, Uniform
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.records.readers import read_record
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.model_file import load_model_file
from bwbn_bayes.structures.shear_building import ShearBuilding

MODEL = ShearBuilding(
    masses=[2.0],
    storey=BoucWen(k=Uniform(20, 120), c=Uniform(0.01, 2), alpha=Uniform(0.01, 0.5), beta=12.0, gamma=2.0, n=1.3),
)
TRUTH = {"k": 60.0, "c": 0.4, "alpha": 0.15}
EFFECTS = (CubicStiffness, QuadraticDamping, SensorGain)
BY_VALUE = Elsewhere(Serial())
"""Everything is pickled and comes back, but in this process."""


@pytest.fixture(scope="module")
def record() -> Record:
    hidden = MODEL.with_effect(CubicStiffness(k3=900.0))
    return simulate(hidden, el_centro("chopra", duration=8.0), TRUTH, snr_db=30.0, seed=1)


@pytest.fixture
def present(record: Record) -> Posterior:
    engine = Lanes(resolution=0.5, cut_at_turns=False, n_threads=2)
    return Posterior(model=MODEL, record=record, engine=engine, noise=default_noise(record))


@pytest.fixture
def base_points(present: Posterior) -> Floats:
    return polish(replace(present, solves=SolveCount()), np.full((1, 3), 0.4), n_iterations=30)[0]


def every(present: Posterior, base_points: Floats) -> tuple[Hypothesis, ...]:
    view = replace(present, solves=SolveCount())
    return hypotheses(MODEL, scales_of(view, base_points[0]), measured=("acceleration_1",), effects=EFFECTS)


def fitted(present: Posterior, base_points: Floats, workers: Workers) -> tuple[Fit, ...]:
    pace = Pace(workers=workers)
    fits = race(present, every(present, base_points), base_points, pace=pace)
    return searched(fits, np.random.default_rng(3), n_threads=2, pace=pace)


def test_what_travels_comes_to_the_same_bits_and_is_counted_here(present: Posterior, base_points: Floats) -> None:
    there = replace(present, solves=SolveCount())
    own, others = fitted(present, base_points, Threads(2)), fitted(there, base_points, BY_VALUE)
    assert [fit.hypothesis for fit in own] == [fit.hypothesis for fit in others]
    for one, other in zip(own, others, strict=True):
        np.testing.assert_array_equal(one.points, other.points)
        np.testing.assert_array_equal(one.local.information, other.local.information)
        assert (other.posterior.record is there.record, other.posterior.solves is there.solves) == (True, True)
        assert other.posterior.engine == one.posterior.engine
    assert there.solves.total == present.solves.total > 0


def test_scores_travel_too(present: Posterior, base_points: Floats) -> None:
    wanted = every(present, base_points)
    own = scores(present, wanted, base_points[0])
    assert scores(present, wanted, base_points[0], workers=BY_VALUE) == own


def _is_alone(_: int) -> bool:
    return ALONE.get()


def test_a_worker_solves_on_one_thread() -> None:
    assert list(BY_VALUE.each(_is_alone, [1])) == [(True,)]
    assert list(Threads(1).each(_is_alone, [1])) == [(False,)]


def _unchanged_if_even(item: list[int]) -> list[int]:
    return item if item[0] % 2 == 0 else [*item]


def test_an_item_that_a_function_hands_back_is_that_item() -> None:
    """An explanation that was solved finely enough comes back as it is."""
    items = [[2], [3]]
    (even,), (odd,) = [found for found in BY_VALUE.each(_unchanged_if_even, items) if found is not None]
    assert (even is items[0], odd is items[1], odd) == (True, False, [3])


def test_what_there_is_no_time_for_is_not_sent() -> None:
    asked = iter([False, False, True, True])
    assert list(BY_VALUE.each(str, range(4), lambda: next(asked))) == [("0",), ("1",), None, None]


def _questions(path: Path) -> set[bytes]:
    with Journal.opened(path) as journal:
        return {*journal._places}


def test_what_workers_fit_is_kept_here_and_not_fitted_again(
    present: Posterior, base_points: Floats, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whichever of threads and workers went before, with as many solves as without a journal."""
    n_fits, climb = iter(range(10**6)), modes._climb

    def counted(*arguments: Any, **options: Any) -> Any:
        next(n_fits)
        return climb(*arguments, **options)

    plain = fitted(present, base_points, Threads(1))
    monkeypatch.setattr(modes, "_climb", counted)
    for first, second in ((BY_VALUE, Threads(1)), (Threads(1), BY_VALUE)):
        path = tmp_path / type(first).__name__
        for number, workers in enumerate((first, second, first)):
            before = next(n_fits)
            with Journal.opened(path) as journal:
                view = replace(present, journal=journal, solves=SolveCount())
                found = fitted(view, base_points, workers)
            assert view.solves.total == present.solves.total
            assert (next(n_fits) - before > 1) is (number == 0)
            for one, other in zip(plain, found, strict=True):
                np.testing.assert_array_equal(one.points, other.points)
    assert _questions(tmp_path / "Elsewhere") == _questions(tmp_path / "Threads")


def _squared_after_a_kill(folder: Path, n: int) -> int:
    """Whoever first comes to 5 is killed there."""
    if n == 5 and not (folder / "killed").exists():
        (folder / "killed").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return n * n


def _refused(n: int) -> int:
    raise UserError(f"{n} is no mass")


@pytest.fixture(scope="module")
def two_processes() -> Iterator[Processes]:
    """They are sent this module's functions, which they could not import."""
    this = sys.modules[__name__]
    cloudpickle.register_pickle_by_value(this)
    executor = Processes(2)
    yield executor
    executor.close()
    cloudpickle.unregister_pickle_by_value(this)


def test_pieces_of_a_process_that_was_killed_go_to_another(two_processes: Processes, tmp_path: Path) -> None:
    found = list(Elsewhere(two_processes).each(partial(_squared_after_a_kill, tmp_path), range(12)))
    assert found == [(n * n,) for n in range(12)]
    assert (tmp_path / "killed").exists()


def test_a_few_pieces_are_with_the_workers_when_time_is_up(two_processes: Processes) -> None:
    """Two with each: what was sent comes back, in its order."""
    asked = iter(range(10**6))
    found = list(Elsewhere(two_processes).each(str, range(30), lambda: next(asked) >= 9))
    assert found == [*((str(n),) for n in range(9)), *[None] * 21]


def test_a_mistake_that_a_worker_meets_is_told_here(two_processes: Processes) -> None:
    with pytest.raises(UserError, match="3 is no mass"):
        list(Elsewhere(two_processes).each(_refused, [3]))


def timeless(found: Any) -> Any:
    """Without seconds."""
    if isinstance(found, dict):
        return {key: timeless(value) for key, value in found.items() if key != "elapsed_s"}
    return [timeless(value) for value in found] if isinstance(found, list) else found


@pytest.fixture(scope="module")
def few(inputs: Path) -> Callable[..., Any]:
    """What a discovery of two effects tells of the hidden cubic stiffness."""

    def discovered(**options: Any) -> Any:
        settings = DiscoverySettings(effects=(CubicStiffness, SensorGain), particles=300, **options)
        file = load_model_file(inputs / "one_storey.py")
        found = discover(file.model, read_record(inputs / "record.csv"), settings=settings)
        return timeless(json.loads(json.dumps(found.as_json()))), found.result.facts.n_solves

    return discovered


@pytest.fixture(scope="module")
def in_threads(few: Callable[..., Any]) -> Any:
    return few(n_workers=2)


def _killing_at_the_third_stage(monkeypatch: pytest.MonkeyPatch, kind: type, victim: Callable[[Any], int]) -> list[int]:
    """Kill a worker while a stage is under way; who was killed."""
    killed: list[int] = []
    stages, each = iter(range(10**6)), kind.each  # type: ignore[attr-defined]

    def each_but_one(self: Any, *arguments: Any, **options: Any) -> Iterator[Any]:
        number = next(stages)
        for found in each(self, *arguments, **options):
            if number == 2 and not killed:
                killed.append(victim(self))
                os.kill(killed[0], signal.SIGKILL)
            yield found

    monkeypatch.setattr(kind, "each", each_but_one)
    return killed


@pytest.mark.slow
@pytest.mark.parametrize("is_killed", [False, True], ids=["quiet", "killed"])
def test_a_discovery_in_two_processes_is_that_of_threads(
    few: Callable[..., Any], in_threads: Any, is_killed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    killed = [0]
    if is_killed:
        killed = _killing_at_the_third_stage(monkeypatch, Processes, lambda own: next(iter(own._pool._processes)))
    assert few(workers=2) == in_threads
    assert len(killed) == 1


distributed = pytest.mark.skipif(find_spec("distributed") is None, reason="the extra [distributed] is not installed")


@distributed
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # what the cluster says when a worker is killed is its own
def test_a_discovery_on_a_cluster_that_loses_a_worker_is_that_of_threads(
    few: Callable[..., Any], in_threads: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        assert few(scheduler=cluster.scheduler_address) == in_threads
        victim = next(iter(cluster.workers.values())).process.pid
        killed = _killing_at_the_third_stage(monkeypatch, Dask, lambda _: victim)
        assert few(scheduler=cluster.scheduler_address) == in_threads
    assert killed == [victim]


class KilledError(Exception):
    """Stands for a killed process."""


@pytest.mark.slow
def test_a_search_in_processes_that_was_killed_goes_on(
    few: Callable[..., Any], in_threads: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In processes or threads: what workers fitted is in the checkpoint of this process."""
    taken, take = iter(range(10**6)), Journal.take

    def take_some(self: Journal, added: bytes) -> None:
        take(self, added)
        if next(taken) == 5:
            raise KilledError

    monkeypatch.setattr(Journal, "take", take_some)
    with pytest.raises(KilledError):
        few(workers=2, checkpoint=tmp_path / "run")
    monkeypatch.undo()
    assert len(_questions(tmp_path / "run")) > 5
    for options in ({"workers": 2}, {"n_workers": 2}):
        assert few(checkpoint=tmp_path / "run", **options) == in_threads


@distributed
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_an_address_without_a_scheduler_is_the_user_s_mistake(
    inputs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--record", str(inputs / "record.csv"), "--out", str(tmp_path), "--scheduler", "tcp://127.0.0.1:9")
    with pytest.raises(SystemExit) as leaving:
        main(["discover", str(inputs / "one_storey.py"), *options])
    said = capsys.readouterr().err.splitlines()[-1]
    assert leaving.value.code == 2
    assert "--scheduler tcp://127.0.0.1:9: no scheduler with a worker answers there" in said


def test_the_command_hands_its_workers_on(inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[DiscoverySettings] = []

    def stop(*_: Any, settings: DiscoverySettings, **__: Any) -> None:
        asked.append(settings)
        raise UserError("enough")

    monkeypatch.setattr(workflow, "discover", stop)
    files = [str(inputs / "one_storey.py"), "--record", str(inputs / "record.csv"), "--out", str(tmp_path)]
    with pytest.raises(SystemExit):
        main(["discover", *files, "--workers", "3"])
    assert (asked[0].workers, asked[0].scheduler) == (3, None)


def test_there_is_one_worker_at_least() -> None:
    with pytest.raises(UserError, match="workers is 0, it must be a whole number from 1 on"):
        DiscoverySettings(workers=0)


@pytest.mark.slow
def test_what_has_no_name_travels_too() -> None:
    """Each kind beside the model as given, under linear algebra on one thread, as a search has it."""
    model = replace(MODEL, masses=(2.0, 1.0), links=(replace(MODEL.links[0], joins=((0, 1), (1, 2))),))
    clean = simulate(model, el_centro("chopra", duration=6.0), TRUTH, snr_db=30.0, seed=1)
    view = Posterior(model=model, record=clean, engine=Lanes(n_threads=1), noise=default_noise(clean))
    found = distinct(*polish(view, model.space.to_unit(model.draws(TRUTH)), n_iterations=10))
    given = Explanation(added=(), posterior=view, modes=found, evidence=laplace(view, found))
    for kind in unnamed._KINDS:
        found_by: list[list[Explanation]] = []
        for workers in (Threads(1), BY_VALUE):
            asked = unnamed._Asked(given, 0.0, np.random.default_rng(1), n_threads=1, known=given)
            with threadpool_limits(limits=1, user_api="blas"):
                found_by += [made[0] for made in workers.each(kind, [asked]) if made is not None]
        own, other = found_by
        assert [one.label for one in other] == [one.label for one in own]
        assert [one.evidence.log_evidence for one in other] == [one.evidence.log_evidence for one in own]
        assert [type(one.estimate) for one in other] == [type(one.estimate) for one in own] != []
