"""The Silverbox (Wigren and Schoukens 2013), measured: identified with a cubic spring, or found from a linear one.

``python -m benchmarks.silverbox [--samples 2048] [--blind] [--workers 2] [--json FILE]``

An electronic oscillator whose spring hardens, force and displacement in volts. Fits see a part of the official
training slice that begins at rest, after one of its pauses, and a linear oscillator whose mass is known to a factor;
the improved model predicts both official test slices from rest, of which the first 50 samples are not scored. Data are
read from ``../shared/data/silverbox``. Published root mean squares of what is missed, arrow, in mV: linear 13.7, five
parameters 0.96 (Hjalmarsson and Schoukens 2004), PNLSS with 37 parameters 0.26.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.boucwen import straight
from benchmarks.running import Clock
from benchmarks.telling import tell, told
from bwbn_bayes import (
    CubicStiffness,
    Discovery,
    DiscoverySettings,
    Linear,
    MassError,
    Oscillator,
    Record,
    Settings,
    Uniform,
    discover,
    identify,
)
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.structure import Structure

DATA = Path(__file__).parents[2] / "shared" / "data" / "silverbox"
TIME_STEP = 0.0016384
FIRST = 8624
"""Sample of the training slice at which a pause of a tenth of a second ends."""
NOT_SCORED = 50
FEW = 8
"""Parameters of a model that is small beside the published black boxes."""
BARE = Oscillator(
    mass=5e-6,  # V s^2 / V: a unit force moves it by about a volt at rest, and it swings at 70 Hz
    spring=Linear(k=Uniform(0.2, 4.0), c=Uniform(0.0, 2e-3)),
).with_effect(MassError(e_m=Uniform(-0.5, 0.5)))


def slice_of(name: str, first: int = 0, n: int | None = None) -> Record:
    """Part of a file; the force as samples for an engine that joins them by straight lines."""
    force, displacement = np.loadtxt(DATA / f"{name}.csv", delimiter=",", skiprows=3).T
    part = slice(first, None if n is None else first + n)
    return Record(
        name=f"Silverbox, {name}",
        time_step=TIME_STEP,
        excitation=np.zeros(len(force[part])),
        forces={"applied_force_1": straight(force)[part]},
        channels={"displacement_1": displacement[part]},
    )


def missed(model: Structure, point: Floats) -> dict[str, float]:
    """Root mean square [mV] of what each test slice has beyond the prediction."""
    engine, found = Lanes(substeps=8, n_threads=1), {}
    for name in ("test_arrow", "test_multisine"):
        record = slice_of(name)
        left = record.channels["displacement_1"] - engine.simulate(model, point, record).values[0, 0]
        found[name] = 1e3 * float(np.sqrt(np.mean(left[NOT_SCORED:] ** 2)))
    return found


def with_spring(n_samples: int, seed: int) -> dict[str, Any]:
    """Identify the oscillator with a cubic spring; what its posterior means predict."""
    clock = Clock()
    model = BARE.with_effect(CubicStiffness(k3=Uniform(0.0, 10.0)))
    settings = Settings(seed=seed, particles=300, alternatives=False)
    result = identify(model, slice_of("train", FIRST, n_samples), settings=settings)
    means = {name: float(np.mean(result.tree["posterior"][name])) for name in model.space.names}
    return {
        "model": "cubic spring, given",
        "n_parameters": model.space.n_dim,
        "missed_mV": missed(model, model.draws(means)),
        "mean": means,
        "grade": result.facts.grade,
        **clock.as_json(),
    }


def found_from_linear(n_samples: int, seed: int, workers: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Discover, and predict by the improved oscillator, and by the most probable one of few parameters."""
    clock = Clock()
    record = slice_of("train", FIRST, n_samples)
    found = discover(BARE, record, settings=DiscoverySettings(seed=seed, n_workers=workers, particles=1000))
    posterior, improved = found.result.tree["posterior"], found.improved
    means = {name: float(np.mean(posterior[name])) for name in improved.space.names}
    line = {
        "model": "found from a linear oscillator",
        "n_parameters": improved.space.n_dim,
        "missed_mV": missed(improved, improved.draws(means)),
        "mean": means,
        **told(found),
        **clock.as_json(),
    }
    return line, of_few_parameters(found)


def of_few_parameters(found: Discovery) -> dict[str, Any]:
    """Of all explanations with few parameters the most probable, at its best fit."""
    clock = Clock()
    best = next(one for one in found.steps[-1].explanations if not one.has_unnamed and one.model.space.n_dim <= FEW)
    values = best.model.space.from_unit(best.best[None])
    return {
        "model": f"the most probable with at most {FEW} parameters ({best.label})",
        "n_parameters": best.model.space.n_dim,
        "missed_mV": missed(best.model, values),
        **clock.as_json(),
    }


def main() -> None:
    """Discover, predict, print a table, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=2048, help="of the training slice that discovery sees")
    parser.add_argument("--blind", action="store_true", help="also discover from a linear oscillator")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    lines = [with_spring(options.samples, options.seed)]
    if options.blind:
        lines.extend(found_from_linear(options.samples, options.seed, options.workers))
    table = Table("model", "parameters", "arrow [mV]", "multisine [mV]", "time [s]")
    for line in lines:
        table.add_row(
            str(line["model"]),
            str(line["n_parameters"]),
            *(f"{line['missed_mV'][name]:.3g}" for name in ("test_arrow", "test_multisine")),
            f"{line['processor_seconds']:.0f}",
        )
    tell(table, lines, options.json)


if __name__ == "__main__":
    main()
