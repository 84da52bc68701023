"""Constants of the cost model in ``docs/scaling.md``: a solve's time, and what workers cost.

``python -m benchmarks.scaling [--workers 2] [--json FILE]``

A shear building of some storeys under filtered noise of some samples, an acceleration measured at every floor, solved
on one thread and on processes. ``per_step_ns`` is the time of one draw, storey and sample; the model says that it is a
constant. ``efficiency`` is what so many processes reach of as many times one thread. Only on a quiet machine do these
figures mean anything.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from bwbn_bayes import BoucWen, PerStorey, Record, ShearBuilding, Uniform, filtered_noise
from bwbn_bayes.engines.base import Engine
from bwbn_bayes.engines.executors import spread
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.summary import processor_name
from bwbn_bayes.structures.structure import Structure

ENGINE = Lanes(resolution=0.25, n_threads=1)
CASES = ((1, 1000), (1, 10_000), (1, 100_000), (3, 7500), (10, 7500), (30, 2000))
"""Storeys and samples."""
TIME_STEP, DRAWS, ROUNDS = 0.02, 256, 3


@dataclass(frozen=True, kw_only=True)
class Cost:
    """One size of problem: best of some rounds."""

    storeys: int
    samples: int
    solve_ms: float
    per_step_ns: float
    efficiency: float


def problem(storeys: int, samples: int) -> tuple[Structure, Record]:
    """A building and what it is solved under; the measured signals are zero, which costs the same."""
    storey = BoucWen(k=PerStorey(Uniform(1e4, 3e4)), c=50.0, alpha=0.1, A=1.0, beta=2.0, gamma=1.0, n=1.5)
    ground = filtered_noise(np.random.default_rng(1), (samples - 1) * TIME_STEP, TIME_STEP, rms=1.0)
    channels = {f"acceleration_{floor}": np.zeros(ground.n_times) for floor in range(1, storeys + 1)}
    return ShearBuilding(masses=[10.0] * storeys, storey=storey), ground.with_channels(channels)


def seconds(engine: Engine, model: Structure, record: Record, draws: np.ndarray) -> float:
    """Best time of a batch."""
    times = []
    for _ in range(ROUNDS):
        began = time.perf_counter()
        engine.misfit(model, draws, record)
        times.append(time.perf_counter() - began)
    return min(times)


def main() -> None:
    """Measure, print a table, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    costs = []
    with spread(ENGINE, options.workers, None) as several:
        for storeys, samples in CASES:
            model, record = problem(storeys, samples)
            draws = model.space.from_unit(model.space.sample_unit(np.random.default_rng(2), DRAWS))
            ENGINE.misfit(model, draws[:16], record)  # compiled before it is timed, here and in the workers
            several.misfit(model, draws, record)
            alone, together = (seconds(engine, model, record, draws) for engine in (ENGINE, several))
            costs.append(
                Cost(
                    storeys=storeys,
                    samples=record.n_times,
                    solve_ms=1e3 * alone / DRAWS,
                    per_step_ns=1e9 * alone / (DRAWS * storeys * record.n_times),
                    efficiency=alone / together / options.workers,
                )
            )
    table = Table("storeys", "samples", "a solve [ms]", "a storey and sample [ns]", f"efficiency of {options.workers}")
    for one in costs:
        numbers = (one.solve_ms, one.per_step_ns, one.efficiency)
        table.add_row(str(one.storeys), str(one.samples), *(f"{number:.3g}" for number in numbers))
    Console(width=100).print(table)
    if options.json is not None:
        facts = {"processor": processor_name(), "workers": options.workers, "costs": [asdict(one) for one in costs]}
        options.json.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
