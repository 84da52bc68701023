"""The Bouc-Wen benchmark (Noel and Schoukens 2016): identified with its structure given, then found from a linear one.

``python -m benchmarks.boucwen [--blind] [--json FILE]``

Estimation data are made as the benchmark's page asks, by an integrator of this file's own: a random-phase multisine
from 5 to 150 Hz, 50 N rms, 5 periods of 8,192 samples at 750 Hz, from rest, noise of 8e-3 mm rms on the displacement.
The model is fitted to them alone and predicts both official test files of ``../shared/data``. ``rmse`` is that of the
posterior mean's prediction in the unit of the displacement. Published with the same files, by models that are not given
the structure: 7.53e-6 m (multisine); the true parameters leave 2.3e-7 and 2.55e-6 m.

Engines take inputs as straight between samples, the benchmark's are band-limited: each line of the spectrum is raised
by what the straight pieces would take from it (``sinc^-2``), so that their sum at the natural frequency is right.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import numpy as np
from rich.table import Table

from benchmarks.running import Clock
from benchmarks.telling import tell, told
from bwbn_bayes import (
    BoucWen,
    DiscoverySettings,
    Linear,
    LogNormal,
    Normal,
    Oscillator,
    Record,
    Settings,
    Uniform,
    as_force,
    discover,
    identify,
    multisine,
    read_record,
)
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.doubts import doubts
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import distinct, polish
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.structure import Structure

DATA = Path(__file__).parents[2] / "shared" / "data" / "boucwen_benchmark"
MASS, TRUTH = 2.0, {"k": 1e5, "c": 10.0, "alpha": 0.5, "beta": 800.0, "gamma": -1100.0}
RATE_HZ, FINER, PERIOD, N_PERIODS = 750.0, 20, 8192, 5
NOISE = 8e-6
"""[m]"""
REPEATS = 6
"""Periods of the test multisine until the response repeats."""

GIVEN = Oscillator(
    mass=MASS,
    spring=BoucWen(
        k=LogNormal(8e4, 0.5),
        c=Uniform(0.0, 50.0),
        alpha=Uniform(0.0, 1.0),
        beta=Normal(0.0, 2000.0),
        gamma=Normal(0.0, 2000.0),
        n=1.0,
        hardens=True,
    ),
)
BARE = Oscillator(mass=MASS, spring=Linear(k=LogNormal(8e4, 0.5), c=Uniform(0.0, 200.0)))


@numba.njit  # type: ignore[untyped-decorator]
def solved(force: Floats, step: float) -> Floats:
    """Displacement of the benchmark's own equations at every instant of a finely sampled force, by RK4 from rest."""
    m, c, k, a, b, g, d = 2.0, 10.0, 5e4, 5e4, 1e3, 0.8, -1.1
    found = np.zeros(len(force) // 2)
    y, v, z = 0.0, 0.0, 0.0
    for i in range(len(found)):
        found[i] = y
        dy, dv, dz = 0.0, 0.0, 0.0
        ty, tv, tz = y, v, z
        for stage in range(4):
            u = force[min(2 * i + (stage + 1) // 2, len(force) - 1)]
            ry = tv
            rv = (u - c * tv - k * ty - tz) / m
            rz = a * tv - b * (g * abs(tv) * tz + d * tv * abs(tz))
            weight = 1.0 / 6.0 if stage in (0, 3) else 1.0 / 3.0
            dy, dv, dz = dy + weight * ry, dv + weight * rv, dz + weight * rz
            share = 0.5 if stage < 2 else 1.0
            ty, tv, tz = y + share * step * ry, v + share * step * rv, z + share * step * rz
        y, v, z = y + step * dy, v + step * dv, z + step * dz
    return found


def straight(signal: Floats, n_after: int = 0) -> Floats:
    """A band-limited signal, followed by so many zeros, as samples for an engine that joins them by straight lines."""
    padded = np.concatenate([signal, np.zeros(n_after)])
    spectrum = np.fft.rfft(padded) / np.sinc(np.fft.rfftfreq(len(padded))) ** 2
    return np.fft.irfft(spectrum, len(padded))[: len(signal)]


def estimation(n_periods: int, seed: int) -> Record:
    """Data to fit, under the engine's input."""
    rng = np.random.default_rng(seed)
    period = multisine(rng, (5.0, 150.0), PERIOD, 1.0 / RATE_HZ, rms=50.0).excitation
    spectrum, factor = np.fft.rfft(period), 2 * FINER
    finer = np.fft.irfft(spectrum, factor * PERIOD) * factor
    clean = solved(np.tile(finer, n_periods), 1.0 / (FINER * RATE_HZ))[::FINER]
    record = multisine(rng, (5.0, 150.0), PERIOD, 1.0 / RATE_HZ, rms=50.0, n_periods=n_periods)
    record = as_force(replace(record, excitation=np.tile(straight(period), n_periods)))
    return record.with_channels({"displacement_1": clean + NOISE * rng.standard_normal(len(clean))})


def tests() -> dict[str, tuple[Record, int]]:
    """The official test files, and from which sample on each is scored."""
    found = {}
    for name, n_after, repeats in (("multisine", 0, REPEATS), ("sinesweep", PERIOD, 1)):
        record = read_record(DATA / f"test_{name}.csv")
        force, measured = straight(record.forces["applied_force_1"], n_after), record.channels["displacement_1"]
        record = replace(
            record,
            excitation=np.zeros(repeats * record.n_times),
            forces={"applied_force_1": np.tile(force, repeats)},
            channels={"displacement_1": np.tile(measured, repeats)},
        )
        found[name] = record, (repeats - 1) * len(measured)
    return found


def errors(model: Structure, point: Floats) -> dict[str, float]:
    """RMSE [m] of both test files at identified parameters ``(1, n_parameters)``."""
    engine, found = Lanes(substeps=8, n_threads=1), {}
    for name, (record, first) in tests().items():
        predicted = engine.simulate(model, point, record).values[0, 0]
        missed = predicted[first:] - record.channels["displacement_1"][first:]
        found[name] = float(np.sqrt(np.mean(missed**2)))
    return found


def without_hardening(seed: int) -> str:
    """What is said of the best fit next to the truth, on 1,024 samples, where priors exclude loops that harden."""
    spring = GIVEN.links[0].element
    assert isinstance(spring, BoucWen)
    model, record = (
        Oscillator(mass=MASS, spring=replace(spring, hardens=False)),
        estimation(1, seed).until(1024 / RATE_HZ),
    )
    engine = Lanes(substeps=4, n_threads=1)
    posterior = Posterior(model=model, record=record, engine=engine, noise=default_noise(record))
    nearest = {**TRUTH, "gamma": -0.99 * TRUTH["beta"]}
    start = model.space.to_unit(model.draws(nearest))
    (_, within) = doubts(posterior, distinct(*polish(posterior, start, n_iterations=30))[0])
    return within.sentence


def with_structure(seed: int) -> dict[str, Any]:
    """Identify the Bouc-Wen oscillator; are the true values in their 99 % intervals, and what do the means predict."""
    clock = Clock()
    result = identify(GIVEN, estimation(N_PERIODS, seed), settings=Settings(seed=seed, particles=2000))
    posterior = result.tree["posterior"]
    draws = {name: np.ravel(posterior[name]) for name in TRUTH}
    inside = {
        name: bool(np.quantile(values, 0.005) <= TRUTH[name] <= np.quantile(values, 0.995))
        for name, values in draws.items()
    }
    means = {name: float(np.mean(values)) for name, values in draws.items()}
    return {
        "model": "Bouc-Wen, given",
        "n_parameters": GIVEN.space.n_dim,
        "rmse_m": errors(GIVEN, GIVEN.draws(means)),
        "mean": means,
        "inside_99": inside,
        "without_hardening": without_hardening(seed),
        **clock.as_json(),
    }


def blind(seed: int, n_periods: int, workers: int) -> dict[str, Any]:
    """Discover what a linear oscillator lacks, and what the improved model predicts."""
    clock = Clock()
    settings = DiscoverySettings(seed=seed, n_workers=workers, most_rounds=2, particles=1000)
    found = discover(BARE, estimation(n_periods, seed), settings=settings)
    posterior, improved = found.result.tree["posterior"], found.improved
    means = {name: float(np.mean(posterior[name])) for name in improved.space.names}
    return {
        "model": "found from a linear oscillator",
        "n_parameters": improved.space.n_dim,
        **told(found),
        "rmse_m": errors(improved, improved.draws(means)),
        "mean": means,
        **clock.as_json(),
    }


def main() -> None:
    """Identify, predict, print a table, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--blind", action="store_true", help="also discover from a linear oscillator")
    parser.add_argument("--periods", type=int, default=1, help="periods that the blind search sees")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    lines = [with_structure(options.seed)]
    if options.blind:
        lines.append(blind(options.seed, options.periods, options.workers))
    table = Table("model", "multisine [m]", "sine sweep [m]", "time [s]")
    for line in lines:
        rmse = line["rmse_m"]
        table.add_row(
            str(line["model"]),
            *(f"{rmse[name]:.3g}" for name in ("multisine", "sinesweep")),
            f"{line['processor_seconds']:.0f}",
        )
    tell(table, lines, options.json)


if __name__ == "__main__":
    main()
