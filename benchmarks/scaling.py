"""The cost model of ``docs/scaling.md``: a solve's time at ten sizes, and what workers cost.

``python -m benchmarks.scaling [--workers 2] [--particles 20000] [--json FILE]``

A shear building of some storeys under filtered noise of some samples, an acceleration measured at every floor. The
model says that a solve takes ``samples * storeys * (cut + steps * step + storeys * turn)``: steps end where a storey
turns, and the more storeys there are the more often one does, for all lanes that share a block. Three times are fitted
at five sizes, and foretell ten others. ``efficiency`` is what so many processes reach of as many times one thread, for
a batch of so many draws: by the clock, which means something on a quiet machine alone, and by processor time, one
thread's over that of the workers' slowest and of the process that hands out and gathers, which cannot overlap with it.
What that process takes of each draw bounds how many workers it can feed.

Times are processor times, the least of some rounds.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from bwbn_bayes import BoucWen, PerStorey, Record, ShearBuilding, Uniform, filtered_noise
from bwbn_bayes.engines.executors import Processes, spread_over
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.summary import processor_name
from bwbn_bayes.structures.structure import Structure

TIME_STEP, ROUNDS = 0.02, 5


@dataclass(frozen=True, kw_only=True)
class Size:
    """Storeys, samples, draws and steps a sample."""

    storeys: int
    samples: int
    draws: int
    steps: int = 1

    @property
    def counts(self) -> tuple[int, int, int]:
        """How often each of the model's three times is taken in a solve."""
        cut = self.samples * self.storeys
        return cut, cut * self.steps, cut * self.storeys


FITTED = tuple(
    Size(storeys=s, samples=n, draws=p, steps=r)
    for s, n, p, r in ((1, 4000, 128, 1), (1, 2000, 256, 4), (3, 2000, 128, 4), (4, 2000, 64, 1), (12, 1000, 64, 2))
)
FORETOLD = tuple(
    Size(storeys=s, samples=n, draws=p, steps=r)
    for s, n, p, r in (
        *((1, 1000, 512, 1), (1, 10_000, 64, 2), (1, 100_000, 16, 1), (2, 5000, 128, 1), (3, 7500, 64, 1)),
        *((3, 1000, 1024, 2), (5, 3000, 64, 4), (10, 2000, 64, 1), (10, 1000, 128, 2), (20, 1000, 64, 1)),
    )
)


@dataclass(frozen=True, kw_only=True)
class Cost:
    """One size of problem: processor time of a solve, as measured and as foretold."""

    size: Size
    measured_ms: float
    foretold_ms: float

    @property
    def error(self) -> float:
        """Foretold over measured, less one."""
        return self.foretold_ms / self.measured_ms - 1.0


@dataclass(frozen=True, kw_only=True)
class Efficiency:
    """Of workers, by the clock and by processor time; seconds of the batch on one thread, handing out of one draw."""

    workers: int
    draws: int
    alone_s: float
    by_clock: float
    by_processor: float
    handing_us: float


def problem(storeys: int, samples: int) -> tuple[Structure, Record]:
    """A building and what it is solved under; the measured signals are zero, which costs the same."""
    storey = BoucWen(k=PerStorey(Uniform(1e4, 3e4)), c=50.0, alpha=0.1, A=1.0, beta=2.0, gamma=1.0, n=1.5)
    ground = filtered_noise(np.random.default_rng(1), (samples - 1) * TIME_STEP, TIME_STEP, rms=1.0)
    channels = {f"acceleration_{floor}": np.zeros(ground.n_times) for floor in range(1, storeys + 1)}
    return ShearBuilding(masses=[10.0] * storeys, storey=storey), ground.with_channels(channels)


def draws_of(model: Structure, n: int) -> np.ndarray:
    """Of its prior, ``(n, n_parameters)``."""
    return model.space.from_unit(model.space.sample_unit(np.random.default_rng(2), n))


def seconds(sizes: Sequence[Size]) -> list[float]:
    """Processor time of a batch of each size; rounds go through all sizes, so that a busy minute spoils none."""
    runs: list[Callable[[], object]] = []
    for size in sizes:
        model, record = problem(size.storeys, size.samples)
        engine, draws = Lanes(substeps=size.steps, n_threads=1), draws_of(model, size.draws)
        engine.misfit(model, draws[:16], record)  # compiled before it is timed
        runs.append(lambda e=engine, m=model, d=draws, r=record: e.misfit(m, d, r))  # type: ignore[misc]
    found = [np.inf] * len(sizes)
    for _ in range(ROUNDS):
        for i, run in enumerate(runs):
            began = time.process_time()
            run()
            found[i] = min(found[i], time.process_time() - began)
    return found


def costs() -> tuple[tuple[float, ...], list[Cost]]:
    """The model's times ``cut, step, turn`` [s], fitted, and what they foretell."""
    batches = seconds((*FITTED, *FORETOLD))
    solve = {size: batch / size.draws for size, batch in zip((*FITTED, *FORETOLD), batches, strict=True)}
    # Least squares of relative errors.
    rows = np.array([np.array(size.counts) / solve[size] for size in FITTED])
    times = np.linalg.lstsq(rows, np.ones(len(rows)))[0]
    return tuple(times.tolist()), [
        Cost(size=size, measured_ms=1e3 * solve[size], foretold_ms=1e3 * float(np.dot(size.counts, times)))
        for size in FORETOLD
    ]


def processor_time(process: int) -> float:
    """What a process has taken so far. [s]."""
    words = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def efficiency(n_workers: int, n_draws: int) -> Efficiency:
    """Of processes on one batch of three storeys and 1,000 samples; best of some rounds."""
    model, record = problem(3, 1000)
    engine, draws = Lanes(n_threads=1), draws_of(model, n_draws)
    executor = Processes(n_workers)
    try:
        several = spread_over(engine, executor)
        for one in (engine, several):
            one.misfit(model, draws[: 64 * n_workers], record)  # compiled and loaded before it is timed
        workers = list(executor._pool._processes)
        clock, processor, handing = [], [], []
        for _ in range(ROUNDS):
            alone = (time.perf_counter(), time.process_time())
            engine.misfit(model, draws, record)
            began, before = (time.perf_counter(), time.process_time()), [processor_time(pid) for pid in workers]
            several.misfit(model, draws, record)
            ended, after = (time.perf_counter(), time.process_time()), [processor_time(pid) for pid in workers]
            slowest = max(now - then for then, now in zip(before, after, strict=True))
            clock.append((began[0] - alone[0], ended[0] - began[0]))
            handing.append(ended[1] - began[1])
            processor.append((began[1] - alone[1], slowest + handing[-1]))
    finally:
        executor.close()
    by_clock, by_processor = (
        min(alone for alone, _ in times) / (n_workers * min(together for _, together in times))
        for times in (clock, processor)
    )
    return Efficiency(
        workers=n_workers,
        draws=n_draws,
        alone_s=min(alone for alone, _ in processor),
        by_clock=by_clock,
        by_processor=by_processor,
        handing_us=1e6 * min(handing) / n_draws,
    )


def main() -> None:
    """Measure, print tables, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--particles", type=int, default=20_000)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    console = Console(width=100)
    times, found = costs()
    table = Table("storeys", "samples", "draws", "steps", "a solve [ms]", "foretold [ms]", "error")
    for one in found:
        sizes = (one.size.storeys, one.size.samples, one.size.draws, one.size.steps)
        told = (f"{one.measured_ms:.3g}", f"{one.foretold_ms:.3g}", f"{100.0 * one.error:+.0f} %")
        table.add_row(*map(str, sizes), *told)
    fitted = {f"{name}_ns": round(1e9 * one, 1) for name, one in zip(("cut", "step", "turn"), times, strict=True)}
    console.print(", ".join(f"{name.removesuffix('_ns')} {one} ns" for name, one in fitted.items()), highlight=False)
    console.print(table)
    spread = efficiency(options.workers, options.particles)
    console.print(
        f"{spread.workers} workers, {spread.draws} draws, {spread.alone_s:.2f} s on one thread: efficiency "
        f"{spread.by_clock:.2f} by the clock, {spread.by_processor:.2f} by processor time; handing out and gathering "
        f"{spread.handing_us:.2g} us a draw",
        highlight=False,
    )
    console.print(f"load of the machine meanwhile {os.getloadavg()[0]:.1f}", highlight=False)
    if options.json is not None:
        facts = {
            "processor": processor_name(),
            "load": os.getloadavg(),
            **fitted,
            "costs": [asdict(one) | {"error": one.error} for one in found],
            "efficiency": asdict(spread),
        }
        options.json.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
