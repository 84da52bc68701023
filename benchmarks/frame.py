"""A steel frame on a shake table, measured: one run predicted from the other, and a base that slides found by discover.

``python -m benchmarks.frame [--models NAME ...] [--discover RUN ...] [--blind] [--bending] [--workers 2]
[--json FILE]``

Three storeys, quarter scale (University at Buffalo). On a fixed base a small run (``fbgm152s1``) comes before a large
one (``fbgm152s3``): a chain of linear storeys, of Bouc-Wen ones and of Bouc-Wen ones that degrade is identified from
either, and from both in sequence, and predicts both; the error is that of the floors' displacements relative to the
base. ``--discover`` gives ``discover`` a linear chain and either run, or both in sequence, and predicts both with what
it makes of that. On friction pendulums (``fpgm111s1``, ``fpgm111s2``) ``--blind`` gives it the drifts and a linear
chain on a fixed base, and confirms what it finds on the second run. ``--bending`` fits a linear chain to each of the
four runs alone, on its base as it was, without and with storeys that are coupled by bending: one frame has one such
stiffness, and one pair of friction and period.

Data are read from ``../shared/data/shake_table_frame``. Masses are not on file: equal ones of 1 kg stand for them, and
stiffness is per kilogram. Twenty seconds count, from one second before the strong motion. Displacements have arbitrary
zeros: of each run the mean of its first half second is taken for the rest position, but in sequence the second run
begins where the first ended. A run between the two is not on file. What is finished is filed in the JSON, and not run
again by the same commit.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.measured_tests.specimens import nrmse, read_frame
from benchmarks.running import Clock
from benchmarks.telling import gather, tell, told
from bwbn_bayes import (
    BoucWen,
    DiscoverySettings,
    HalfNormal,
    Linear,
    LogNormal,
    PerStorey,
    Record,
    Settings,
    ShearBuilding,
    SlidingBase,
    StiffnessDegradation,
    StoreyCoupling,
    StrengthDegradation,
    Uniform,
    discover,
    identify,
    join_records,
)
from bwbn_bayes.discovery.evidence import Evidence, autoregressive, laplace
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.accuracy import LADDER
from bwbn_bayes.inference.identify import identify_from
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import distinct, find_modes, polish
from bwbn_bayes.parameters import Floats
from bwbn_bayes.results import Result
from bwbn_bayes.structures.structure import Structure

DATA = Path(__file__).parents[2] / "shared" / "data" / "shake_table_frame"
SMALL, LARGE = "fbgm152s1", "fbgm152s3"
SLIDING = ("fpgm111s1", "fpgm111s2")
DURATION = 20.0
BEFORE = 1.0
"""Seconds before one per cent of the ground motion's energy has come."""
AT_REST = 32
"""Samples at the beginning, and of a run before another at its end, that count as rest."""
PAUSE = 20.0
GRAVITY = 9.80665

STIFFNESS = PerStorey(LogNormal(400.0, 1.0))  # N/m per kg: the first mode lies at 1.4 Hz
DAMPING = PerStorey(LogNormal(2.0, 1.5))  # N s/m per kg
LINEAR = ShearBuilding(masses=[1.0, 1.0, 1.0], storey=Linear(k=STIFFNESS, c=DAMPING))
YIELDING = ShearBuilding(
    masses=[1.0, 1.0, 1.0],
    storey=BoucWen(
        k=STIFFNESS,
        c=DAMPING,
        alpha=Uniform(0.0, 0.8),
        u_y=LogNormal(0.02, 1.5),  # m
        rho=Uniform(0.2, 2.5),
        n=Uniform(1.0, 6.0),
    ),
)
DEGRADING = YIELDING.with_effect(StiffnessDegradation(delta_eta=LogNormal(0.1, 2.0))).with_effect(
    StrengthDegradation(delta_nu=LogNormal(0.1, 2.0))
)
SLIDERS = SlidingBase(
    inv_mu=HalfNormal(25.0),
    R_s=LogNormal(1.0, 1.0),  # m
    m_s=Uniform(0.3, 3.0),  # kg
    W_s=4.0 * GRAVITY,
    Y_s=LogNormal(2e-4, 1.5),  # m
    n_s=LogNormal(2.0, 1.0).truncated(1.0, 20.0),
    r_mu=Uniform(0.0, 0.9),
    a_s=LogNormal(30.0, 1.0),  # s/m
)
BENDING = StoreyCoupling(k_bend=HalfNormal(200.0))  # N/m per kg
BOTH = "both in sequence"
MODELS = {"linear": LINEAR, "Bouc-Wen": YIELDING, "Bouc-Wen, degrading": DEGRADING}


def run_of(name: str) -> Record:
    """The part of a run that counts, each displacement measured from where it was at rest."""
    record = read_frame(DATA / f"{name}.csv")
    energy = np.cumsum(np.square(record.excitation))
    strong = int(np.searchsorted(energy, 0.01 * energy[-1])) * record.time_step
    record = record.between(strong - BEFORE, strong - BEFORE + DURATION)
    return record.with_channels({name: y - np.mean(y[:AT_REST]) for name, y in record.channels.items()})


def in_sequence(first: Record, second: Record) -> Record:
    """Both runs, the second from where the first left the floors once they have come to rest."""
    left = {name: float(np.mean(y[-AT_REST:])) for name, y in first.channels.items()}
    moved = second.with_channels({name: y + left[name] for name, y in second.channels.items()})
    pause = Record(name="pause", time_step=first.time_step, excitation=np.zeros(round(PAUSE / first.time_step)))
    return join_records([first, pause, moved], in_sequence=True)


def drifts(record: Record) -> Record:
    """The same run with drifts, which do not ask where the base is."""
    floors = np.stack(list(record.channels.values()))
    drift = np.diff(floors, axis=0, prepend=0.0)
    return record.with_channels({f"drift_{i}": y for i, y in enumerate(drift, start=1)})


def missed(model: Structure, point: Floats, record: Record) -> list[float]:
    """Error [%] of each measured part of a record."""
    predicted = Lanes(substeps=8, n_threads=1).simulate(model, point, record).values[0]
    measured = [where for where, part in zip(record.stretches, record.parts, strict=True) if part.channels]
    return [nrmse(record.measured[:, where], predicted[:, where]) for where in measured]


def records() -> dict[str, Record]:
    """Either run, of a frame that is virgin before it, and both in sequence."""
    runs = {one: run_of(one) for one in (SMALL, LARGE)}
    return {**runs, BOTH: in_sequence(*runs.values())}


def predicted(model: Structure, point: Floats) -> dict[str, float]:
    """Error [%] of either run of a virgin frame, and of the large one after the small one has worn it."""
    runs = records()
    virgin = {name: missed(model, point, runs[name])[0] for name in (SMALL, LARGE)}
    return {**virgin, f"{LARGE} in sequence": missed(model, point, runs[BOTH])[1]}


def fitted(name: str, on: str, seed: int, particles: int) -> dict[str, Any]:
    """Identify one model from one run or both, and predict both."""
    clock, model = Clock(), MODELS[name]
    # No chain leaves noise here, and nothing below reads intervals: transitional MCMC along the ridges of a model that
    # is refused takes four minutes of processor for the first of up to six clouds.
    settings = Settings(seed=seed, particles=particles, alternatives=False, fallback=False)
    result = identify(model, records()[on], settings=settings)
    means = {parameter.name: parameter.mean for parameter in result.facts.parameters}
    return {
        "model": name,
        "fitted_on": on,
        "n_parameters": model.space.n_dim,
        "missed_percent": predicted(model, model.draws(means)),
        "mean": means,
        "grade": result.facts.grade,
        **clock.as_json(),
    }


def discovered(on: str, seed: int, workers: int, particles: int) -> dict[str, Any]:
    """Discover what a linear chain lacks on a fixed base, and predict both runs with the improved one."""
    clock = Clock()
    settings = DiscoverySettings(seed=seed, n_workers=workers, particles=particles)
    found = discover(LINEAR, records()[on], settings=settings)
    improved, means = found.improved, {one.name: one.mean for one in found.result.facts.parameters}
    return {
        "model": "found by `discover`",
        "fitted_on": on,
        "n_parameters": improved.space.n_dim,
        "missed_percent": predicted(improved, improved.draws(means)),
        "mean": means,
        **told(found),
        **clock.as_json(),
    }


def sliding(seed: int, workers: int, particles: int) -> dict[str, Any]:
    """Discover what a linear chain on a fixed base lacks where the frame stands on friction pendulums."""
    clock = Clock()
    training, other = (drifts(run_of(name)) for name in SLIDING)
    settings = DiscoverySettings(seed=seed, n_workers=workers, particles=particles)
    found = discover(LINEAR, training, held_out=other, settings=settings)
    line = {"model": "found from a linear chain on a fixed base", **told(found)}
    if "inv_mu" in found.improved.space.names:
        errors = {
            "white": found.result,
            "autoregressive": coloured(found.improved, found.record, found.result, settings),
        }
        line["sliders"] = {name: sliders(found.improved, result) for name, result in errors.items()}
    return {**line, **clock.as_json()}


def coloured(model: Structure, record: Record, white: Result, settings: DiscoverySettings) -> Result:
    """The posterior under autoregressive errors, from where that under white ones has its mean."""
    means = model.draws({parameter.name: parameter.mean for parameter in white.facts.parameters})
    engine = replace(LADDER[1], n_threads=1)
    posterior = Posterior(model=model, record=record, engine=engine, noise=default_noise(record))
    modes = distinct(*polish(posterior, model.space.to_unit(means), n_iterations=30))
    return drawn(autoregressive(posterior, modes), settings.seed, settings.particles)


def drawn(evidence: Evidence, seed: int, particles: int) -> Result:
    """Draws under the errors that an evidence stands for: what lasts, taken for white, makes intervals too narrow."""
    settings = Settings(seed=seed, particles=particles, fallback=False)
    return identify_from(evidence.posterior, np.array([mode.point for mode in evidence.modes]), settings=settings)


def bent(run: str, seed: int, particles: int) -> dict[str, Any]:
    """Fit a linear chain to the drifts of one run alone, without and with bending; what it misses, what bending gains.

    The gain is that of evidence under autoregressive errors. [nat] On sliders, with their friction and period.
    """
    clock, record = Clock(), drifts(run_of(run))
    plain = LINEAR.with_effect(SLIDERS) if run in SLIDING else LINEAR
    fits, engine = [], replace(LADDER[0], n_threads=1)  # a contact of a tenth of a millimetre asks for its resolution
    for model in (plain, plain.with_effect(BENDING)):
        posterior = Posterior(model=model, record=record, engine=engine, noise=default_noise(record))
        fits.append((model, posterior, find_modes(posterior, np.random.default_rng(seed))))
    before, after = (autoregressive(*fit[1:]) for fit in fits)
    points = [one.space.from_unit(own[0].point[None]) for one, _, own in fits]
    predicted = [engine.simulate(fit[0], at, record).values[0] for fit, at in zip(fits, points, strict=True)]
    line = {
        "run": run,
        "missed_percent": [nrmse(record.measured, one) for one in predicted],
        "k_bend": float(points[1][0, fits[1][0].space.names.index("k_bend")]),
        "gained_nats": after.log_evidence - before.log_evidence,
    }
    if run in SLIDING:
        by_errors = {"white": laplace(*fits[1][1:]), "autoregressive": after}
        line["sliders"] = {name: sliders(fits[1][0], drawn(one, seed, particles)) for name, one in by_errors.items()}
    return {**line, **clock.as_json()}


def sliders(model: Structure, result: Result) -> dict[str, Any]:
    """Friction at speed and near rest, isolated period [s], for the weight that slides; medians with 90 % intervals.

    The effect takes the weight on the sliders for known; here it is that of the floors and of the slab as identified.
    With what the draws are worth.
    """
    weight = next(one.effect for one in model.effects if one.effect.name == "sliding_base").values["W_s"]
    posterior: Any = result.tree["posterior"]
    own = {name: posterior[name].values.ravel() for name in ("m_s", "inv_mu", "R_s", "r_mu")}
    slides = GRAVITY * (sum(model.masses) + own["m_s"])
    friction = weight / own["inv_mu"] / slides
    found = {
        "friction_at_speed": friction,
        "friction_near_rest": friction * (1.0 - own["r_mu"]),
        "period_s": 2.0 * np.pi * np.sqrt(own["R_s"] / weight * slides / GRAVITY),
    }
    quantiles = {name: np.quantile(one, [0.5, 0.05, 0.95]).tolist() for name, one in found.items()}
    return {**quantiles, "effective_draws": result.facts.effective_sample_size}


def main() -> None:
    """Identify, predict, discover, print a table, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", nargs="*", choices=list(MODELS), default=list(MODELS), help="chains to identify")
    parser.add_argument("--discover", nargs="*", choices=[SMALL, LARGE, BOTH], default=[], help="from the linear chain")
    parser.add_argument("--blind", action="store_true", help="also discover what the isolated frame's model lacks")
    parser.add_argument("--bending", action="store_true", help="also tell of each run alone how stiff in bending it is")
    parser.add_argument("--particles", type=int, default=300)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    seed, workers, particles = options.seed, options.workers, options.particles
    jobs: dict[str, Callable[[], dict[str, Any]]] = {
        f"{name}, fitted on {on}": partial(fitted, name, on, seed, particles)
        for name in options.models
        for on in (SMALL, LARGE, BOTH)
    }
    jobs |= {f"discover, {on}": partial(discovered, on, seed, workers, particles) for on in options.discover}
    if options.blind:
        jobs["discover, on sliders"] = partial(sliding, seed, workers, particles)
    if options.bending:
        jobs |= {f"bending, {run}": partial(bent, run, seed, particles) for run in (SMALL, LARGE, *SLIDING)}
    lines = gather({f"{name}; seed {seed}, {particles} particles": job for name, job in jobs.items()}, options.json)
    table = Table("model", "fitted on", "parameters", SMALL, LARGE, f"{LARGE} in sequence", "time [s]")
    for line in (one for one in lines if "fitted_on" in one):
        errors = (f"{error:.1f} %" for error in line["missed_percent"].values())
        table.add_row(
            line["model"], line["fitted_on"], str(line["n_parameters"]), *errors, f"{line['processor_seconds']:.0f}"
        )
    tell(table, lines, options.json)


if __name__ == "__main__":
    main()
