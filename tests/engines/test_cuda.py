"""The engine on a graphics card: everywhere on an emulated one, its code as far as it can be read, and on a card."""

from __future__ import annotations

import ctypes
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from emulated_card import EmulatedCard, EmulatedCuda
from engine_cases import FREE, building, record_of

from bwbn_bayes.cli import main
from bwbn_bayes.engines import cuda_driver
from bwbn_bayes.engines.available import engine, engines
from bwbn_bayes.engines.cuda import Cuda
from bwbn_bayes.engines.cuda_driver import Card, CudaError, first_card
from bwbn_bayes.engines.cuda_source import ENTRY, SELDOM, thread_source
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.scalar import programs_of
from bwbn_bayes.engines.thread_compiler import thread_code
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Floats, PerStorey, Uniform, Value
from bwbn_bayes.records.joined import join_records
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.structure import Structure


def has_card() -> bool:
    try:
        first_card()
    except UserError:
        return False
    return True


HAS_CARD = has_card()
needs_card = pytest.mark.skipif(not HAS_CARD, reason="this machine has no graphics card of NVIDIA's")

VALUES: dict[str, Value] = {
    **FREE,
    "sigma": Uniform(0.01, 0.1),
    "jump": Uniform(0.5, 2),
    "time": PerStorey([Uniform(0.5, 1.5), Uniform(0.7, 1.9)]),
}


def case(n_draws: int) -> tuple[ShearBuilding, Floats]:
    model = building(2, VALUES)
    return model, model.space.from_unit(np.random.default_rng(1).uniform(size=(n_draws, model.space.n_dim)))


@pytest.mark.parametrize("resolution", [0.0, 0.5])
@pytest.mark.parametrize("cut_at_turns", [False, True])
@pytest.mark.parametrize("single", [False, True])
def test_one_lane_gives_the_bits_of_sixteen(resolution: float, cut_at_turns: bool, single: bool) -> None:
    model, draws = case(37)
    record = record_of(model, 2.0)
    settings: dict[str, Any] = {"resolution": resolution, "cut_at_turns": cut_at_turns, "single": single}
    lanes, cuda = Lanes(**settings), EmulatedCuda(**settings)
    names = ["acceleration_2", "drift_1", "relative_acceleration_1"]
    np.testing.assert_array_equal(
        cuda.simulate(model, draws, record, names).values, lanes.simulate(model, draws, record, names).values
    )
    np.testing.assert_array_equal(cuda.misfit(model, draws, record), lanes.misfit(model, draws, record))


def test_damage_is_carried_from_record_to_record() -> None:
    model, draws = case(5)
    record = join_records([record_of(model, 1.0), record_of(model, 1.2)], in_sequence=True)
    np.testing.assert_array_equal(EmulatedCuda().misfit(model, draws, record), Lanes().misfit(model, draws, record))


def test_a_population_is_cut_by_the_cards_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    model, draws = case(50)
    record, small = record_of(model, 0.5), EmulatedCard(free_bytes=2**18)
    monkeypatch.setattr(EmulatedCuda, "card", small)
    np.testing.assert_array_equal(EmulatedCuda().misfit(model, draws, record), Lanes().misfit(model, draws, record))
    assert len(small.calls) > 1
    assert len(set(small.calls)) == 1
    assert len(draws) <= sum(small.calls) < len(draws) + len(small.calls)


def test_no_draws_are_no_misfits() -> None:
    model, _ = case(0)
    assert EmulatedCuda().misfit(model, np.zeros((0, model.space.n_dim)), record_of(model, 0.5)).shape == (0, 2)


def test_derivatives_are_the_lanes_own() -> None:
    model, draws = case(3)
    record = record_of(model, 0.5)
    cuda, lanes = (one.normal_equations(model, draws, record) for one in (EmulatedCuda(), Lanes()))
    np.testing.assert_array_equal(cuda.information, lanes.information)


def test_a_model_without_parameters_has_sums_of_squares() -> None:
    """Of more draws than one, which fill no sixteen lanes, they could not be reshaped."""
    model = building(2)
    draws, record = np.zeros((5, 0)), record_of(model, 0.5)
    cuda, lanes = (one.normal_equations(model, draws, record) for one in (EmulatedCuda(), Lanes()))
    np.testing.assert_array_equal(cuda.misfit, lanes.misfit)
    assert cuda.information.shape == lanes.information.shape


@pytest.mark.parametrize("refused", ["room", "call", "read"])
def test_what_a_card_refuses_in_the_middle_of_a_run_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch, refused: str
) -> None:
    """Memory that another process had taken meanwhile ended a run in a traceback."""

    def refuse(*_: object) -> None:
        raise CudaError("cuMemAlloc_v2: out of memory")

    model, draws = case(5)
    card = EmulatedCard()
    monkeypatch.setattr(EmulatedCuda, "card", card)
    monkeypatch.setattr(card, refused, refuse)
    sentence = r"solves no further \(cuMemAlloc_v2: out of memory\): .*, or take --engine lanes$"
    with pytest.raises(UserError, match=sentence):
        EmulatedCuda().misfit(model, draws, record_of(model, 0.5))


def code_of(model: Structure) -> str:
    safe, programs = programs_of(model.law)
    source = thread_source(safe, programs, driven=False, single=False, n_links=model.n_links, n_channels=1, n_inputs=1)
    fixed = {"n_links": model.n_links, "shares": np.array([0.5, 0.5, 1.0])}
    return thread_code(source, ENTRY, fixed, SELDOM)


def test_the_code_of_a_card_needs_nothing_from_outside() -> None:
    """What a card lacks (a library's exponential, say) would be an unknown name to its driver."""
    text = code_of(building(2))
    assert re.search(r"\.visible \.entry on_threads\(", text)
    assert ".extern" not in text
    assert "fma.rn.f64" in text
    assert "rcp.approx.ftz.f64" in text
    assert not re.search(r"div\.|\.f32", text)


@pytest.mark.parametrize("n_storeys", [1, 4, 5, 40])
def test_what_a_solve_always_calls_stands_where_it_is_called(n_storeys: int) -> None:
    """With four storeys the march was a function: the card looked up where each of its numbers is before it read it."""
    assert set(re.findall(r"\.func (\w+)\(", code_of(building(n_storeys)))) <= set(SELDOM)


def test_loops_over_many_links_are_not_written_out() -> None:
    few, some, many = (len(code_of(building(n))) for n in (2, 4, 40))
    assert some > 1.2 * few
    assert many < some


def library(refused: str) -> Any:
    """A driver that refuses one call."""

    def text(_: int, place: Any) -> int:
        place._obj.value = b"no CUDA-capable device is detected"
        return 0

    calls = {name: lambda *_: 0 for name in ("cuInit", "cuDeviceGet", "cuDevicePrimaryCtxRetain", "cuDeviceGetName")}
    return SimpleNamespace(**{**calls, refused: lambda *_: 100}, cuGetErrorString=text)


def test_a_driver_without_a_card_is_told() -> None:
    with pytest.raises(CudaError, match="cuInit: no CUDA-capable device is detected"):
        Card(library("cuInit"))


@pytest.mark.parametrize("own", [(6, 1), (7, 2)])
def test_a_card_that_is_too_old_is_told_before_it_solves(own: tuple[int, int]) -> None:
    """Its driver would refuse the code, once all else is done."""
    asked: list[int] = []

    def attribute(place: Any, which: int, _: object) -> int:
        asked.append(which)
        place._obj.value = dict(zip((75, 76), own, strict=True))[which]
        return 0

    driver = library("cuDevicePrimaryCtxRetain")
    driver.cuDeviceGetAttribute = attribute
    with pytest.raises(CudaError, match=rf"has compute capability {own[0]}\.{own[1]}, 7\.5 is needed"):
        Card(driver)
    assert asked == [75, 76]


def test_each_reason_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cuda_driver, "_NAMES", ("libthere_is_no_such_thing.so",))
    first_card.cache_clear()
    with pytest.raises(UserError, match="needs a graphics card of NVIDIA's with its driver, and finds no driver here"):
        engine("cuda")
    monkeypatch.setattr(ctypes, "CDLL", lambda _: library("cuDeviceGet"))
    first_card.cache_clear()
    with pytest.raises(UserError, match=r"no card that it can use \(cuDeviceGet: no CUDA-capable device"):
        engine("cuda")
    (facts,) = (one for one in engines() if one.name == "cuda")
    assert not facts.available
    monkeypatch.undo()
    first_card.cache_clear()


@pytest.mark.skipif(HAS_CARD, reason="this machine has a graphics card of NVIDIA's")
def test_the_command_line_says_why_there_is_no_card(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = Path(__file__).parents[2] / "models" / "sdof.py"
    with pytest.raises(SystemExit) as leaving:
        main(["simulate", str(model), "--engine", "cuda", "--out", str(tmp_path)])
    assert leaving.value.code == 2
    (sentence,) = [line for line in capsys.readouterr().err.splitlines() if "graphics card" in line]
    assert "Traceback" not in sentence


@needs_card
@pytest.mark.parametrize("n_storeys", [2, 10])
def test_a_card_comes_to_what_the_lanes_come_to(n_storeys: int) -> None:
    model = building(n_storeys, {**FREE, "sigma": Uniform(0.01, 0.1), "jump": Uniform(0.5, 2)})
    draws = model.space.from_unit(np.random.default_rng(1).uniform(size=(100, model.space.n_dim)))
    record = record_of(model, 4.0)
    for resolution in (0.0, 0.5):
        cuda, lanes = (one(resolution=resolution) for one in (Cuda, Lanes))
        values, expected = (one.simulate(model, draws, record).values for one in (cuda, lanes))
        scale = np.sqrt(np.mean(expected**2, axis=2, keepdims=True))
        assert np.max(np.abs(values - expected) / scale) < 1e-9
        np.testing.assert_allclose(cuda.misfit(model, draws, record), lanes.misfit(model, draws, record), rtol=1e-9)
        np.testing.assert_array_equal(cuda.simulate(model, draws[::-1], record).values[::-1], values)
