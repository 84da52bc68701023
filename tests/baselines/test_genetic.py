"""The genetic algorithm: its objective by hand, an optimum it must find, its history, one call per generation."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from bwbn_bayes import BoucWen, GeneticSettings, Record, ShearBuilding, Uniform, UserError, simulate, sine
from bwbn_bayes.baselines.genetic import objective, search
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.structure import Structure

TRUTH = {"k": 40.0, "c": 0.6}


@pytest.fixture(scope="module")
def building() -> ShearBuilding:
    """A linear storey: beta and gamma so small that it never yields."""
    storey = BoucWen(k=Uniform(20, 60), c=Uniform(0.01, 2), alpha=0.5, A=1.0, beta=1e-6, gamma=0.0, n=1.0)
    return ShearBuilding(masses=[1.0], storey=storey)


@pytest.fixture(scope="module")
def record(building: ShearBuilding) -> Record:
    return simulate(building, sine(1.0, 0.9, 15.0, 0.02), TRUTH)


@dataclass
class Counting:
    """An engine that remembers how many draws each call solved."""

    calls: list[int] = field(default_factory=list)
    engine: Lanes = field(default_factory=Lanes)

    def misfit(self, model: Structure, draws: Floats, record: Record) -> Floats:
        self.calls.append(len(draws))
        return self.engine.misfit(model, draws, record)


def test_objective_by_hand() -> None:
    """Eq. 27: residuals of 1 in each of 8 points over a variance of 4 give 1/4; a second channel adds its own share."""
    first, second = np.array([2.0, -2.0] * 4), np.array([3.0, 5.0] * 4)
    record = Record(
        name="r", time_step=0.1, excitation=np.ones(8), channels={"acceleration_1": first, "acceleration_2": second}
    )
    misfit = np.array([[8.0, 0.0], [8.0, 2.0], [np.inf, 0.0]])
    assert objective(misfit, record) == pytest.approx([0.25, 0.25 + 2.0 / 8.0 / 1.0, np.inf])


def test_a_still_channel_is_refused() -> None:
    record = Record(name="r", time_step=0.1, excitation=np.ones(8), channels={"acceleration_1": np.full(8, 2.0)})
    with pytest.raises(UserError, match="does not vary"):
        objective(np.ones((1, 1)), record)


def test_it_finds_the_optimum_of_one_storey(building: ShearBuilding, record: Record) -> None:
    """The record is free of noise, so that the truth is the optimum, with objective zero."""
    engine = Counting()
    fit = search(building, record, engine, np.random.default_rng(1))  # type: ignore[arg-type]
    values = building.space.from_unit(fit.point[None])[0]
    assert values == pytest.approx([40.0, 0.6], rel=0.02)
    assert fit.objective < 1e-3
    assert engine.calls == [100] + 30 * [90]
    assert fit.n_solves == sum(engine.calls)


def test_the_elite_never_gets_worse_and_the_population_contracts(building: ShearBuilding, record: Record) -> None:
    settings = GeneticSettings(population=40, elite=4, generations=12)
    fit = search(building, record, Lanes(), np.random.default_rng(2), settings)
    best = [generation.best for generation in fit.generations]
    assert [generation.number for generation in fit.generations] == list(range(13))
    assert np.all(np.diff(best) <= 0.0)
    assert fit.generations[0].spread == pytest.approx(np.sqrt(1.0 / 12.0), rel=0.2)
    assert fit.generations[-1].spread < 0.5 * fit.generations[0].spread
    assert all(generation.median >= generation.best for generation in fit.generations)


def test_a_run_is_a_function_of_its_generator(building: ShearBuilding, record: Record) -> None:
    settings = GeneticSettings(population=20, elite=2, generations=3)
    first, again, other = (search(building, record, Lanes(), np.random.default_rng(s), settings) for s in (3, 3, 4))
    np.testing.assert_array_equal(first.point, again.point)
    assert not np.array_equal(first.point, other.point)


def test_growing_windows_end_on_the_whole_record(building: ShearBuilding, record: Record) -> None:
    """The last score is the objective on the whole record, recomputed here from the engine's misfit."""
    settings = GeneticSettings(population=40, elite=4, generations=12, windows=(0.3, 1.0))
    fit = search(building, record, Lanes(), np.random.default_rng(2), settings)
    misfit = Lanes().misfit(building, building.space.from_unit(fit.point[None]), record)
    assert fit.objective == pytest.approx(objective(misfit, record)[0], rel=1e-12)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"population": 2}, "population"),
        ({"elite": 100}, "elite"),
        ({"generations": 0}, "generations"),
        ({"crossover": 1.5}, "crossover"),
        ({"windows": (0.5,)}, "windows"),
    ],
)
def test_bad_settings_are_named(options: dict[str, object], word: str) -> None:
    with pytest.raises(UserError, match=word):
        GeneticSettings(**options)  # type: ignore[arg-type]
