"""What a graphics card brings: the engine ``cuda`` beside ``lanes`` on all processors of the same machine.

``python -m benchmarks.gpu [--model models/three_storey_el_centro.py] [--particles 50000] [--methods importance tmcmc]
[--engines cuda lanes] [--json FILE]``

Agreement: of draws of the prior, and of draws around the truth, the largest difference of a response over its channel's
root mean square, the largest relative difference of a log likelihood, and how many draws one engine alone solves.
Speed: one ``misfit`` of so many draws, the lesser of two times by the clock, in the scheme that ``identify`` chooses
there. Runs: ``identify`` with so many particles, once all code is compiled; of its time, what went to finding the mode
and what to misfits, which are what the card solves. Each line is printed, and written as JSON, as soon as it is known.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from rich.console import Console

from benchmarks.running import commit
from bwbn_bayes import Settings, identify
from bwbn_bayes.engines.cuda import Cuda
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.simulation import simulate
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.summary import processor_name
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.model_file import load_model_file
from bwbn_bayes.structures.structure import Structure

ENGINES = {"lanes": Lanes, "cuda": Cuda}
SCHEMES: tuple[dict[str, Any], ...] = ({"resolution": 0.5, "cut_at_turns": False}, {"resolution": 0.5})
"""The coarsest of ``identify``, which it chooses for the building under El Centro; and the next."""
SIZES = (32, 512, 3136, 50_000)
"""Of 3,136 chains TMCMC with 50,000 particles asks at once."""
N_COMPARED, SPREAD, ROUNDS = 1024, 0.01, 2
"""Draws around the truth spread by this share of each prior's width."""


@dataclass
class Told:
    """Lines that are printed and filed as they come."""

    path: Path | None
    lines: list[dict[str, Any]] = field(default_factory=list)
    console: Console = field(default_factory=lambda: Console(width=160))

    def tell(self, **line: Any) -> None:
        """One more line."""
        self.lines.append(line)
        words = (f"{key} {value:.4g}" if isinstance(value, float) else f"{key} {value}" for key, value in line.items())
        self.console.print(", ".join(words), highlight=False, markup=False)
        if self.path is not None:
            facts = {"commit": commit(), "processor": processor_name(), "card": Cuda().card.name, "lines": self.lines}
            self.path.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")


def populations(model: Structure, truth: Floats) -> dict[str, Floats]:
    """Draws ``(50,000, n_parameters)`` of the prior, and around the truth."""
    rng, d = np.random.default_rng(1), model.space.n_dim
    prior = model.space.from_unit(model.space.sample_unit(rng, SIZES[-1]))
    low, high = model.space.from_unit(np.array([[1e-9], [1.0 - 1e-9]]) * np.ones(d))
    around = truth + SPREAD * (high - low) * rng.normal(size=prior.shape)
    return {"prior": prior, "around the truth": np.clip(around, low, high)}


def agreement(model: Structure, draws: Floats, record: Record, scheme: dict[str, Any]) -> dict[str, Any]:
    """How far the two engines differ."""
    lanes, cuda = (kind(**scheme).simulate(model, draws, record) for kind in (Lanes, Cuda))
    both = (lanes.status == 0) & (cuda.status == 0)
    rms = np.sqrt(np.mean(lanes.values[both] ** 2, axis=2, keepdims=True))
    apart = np.abs(cuda.values[both] - lanes.values[both]) / rms
    posterior = Posterior(model=model, record=record, engine=Lanes(), noise=default_noise(record))
    points = np.full((int(np.sum(both)), model.space.n_dim), 0.5)
    one, other = (
        posterior.log_likelihood_of(kind(**scheme).misfit(model, draws, record)[both], points) for kind in (Lanes, Cuda)
    )
    return {
        "draws": len(draws),
        "solved by one alone": int(np.sum(lanes.status != cuda.status)),
        "response": float(np.max(apart)),
        "of 99 % of the draws": float(np.quantile(np.max(apart, axis=(1, 2)), 0.99)),
        "log likelihood": float(np.max(np.abs(other / one - 1.0))),
        "log likelihood [nat]": float(np.max(np.abs(other - one))),
    }


def least(solve: Callable[[], object]) -> float:
    """The least of some times, in seconds."""
    solve()
    times = []
    for _ in range(ROUNDS):
        began = time.perf_counter()
        solve()
        times.append(time.perf_counter() - began)
    return min(times)


@contextmanager
def watched(kind: type[Lanes]) -> Iterator[list[tuple[int, float]]]:
    """Draws and seconds of every misfit that an engine of a kind is asked for."""
    calls: list[tuple[int, float]] = []
    asked = Lanes.misfit

    def misfit(self: Lanes, model: Structure, draws: Floats, record: Record) -> Floats:
        began = time.perf_counter()
        found = asked(self, model, draws, record)
        if isinstance(self, kind):
            calls.append((len(draws), time.perf_counter() - began))
        return found

    with patch.object(Lanes, "misfit", misfit):
        yield calls


def run(model: Structure, record: Record, settings: Settings) -> dict[str, Any]:
    """One identification, by the clock."""
    began, steps = time.perf_counter(), list[tuple[str, float]]()

    def listen(text: str, _: object) -> None:
        steps.append((text, time.perf_counter() - began))
        print(f"{steps[-1][1]:.1f} s: {text}", flush=True)

    with watched(ENGINES[settings.engine]) as calls:
        result = identify(model, record, settings=settings, listener=listen)
    seconds = time.perf_counter() - began
    sampling = next((at for text, at in steps if "sampling" in text), seconds)
    return {
        "seconds": seconds,
        "of it to the mode": sampling,
        "of it misfits": sum(own for _, own in calls),
        "misfits": sum(n for n, _ in calls),
        "calls": len(calls),
        "passed": all(check.passed for check in result.facts.checks),
        "sampled by": result.facts.method,
        "last said at": dict(steps),
    }


def main() -> None:
    """Compare, time, identify."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path, default=Path("models/three_storey_el_centro.py"))
    parser.add_argument("--particles", type=int, default=50_000)
    parser.add_argument("--methods", nargs="*", choices=["importance", "tmcmc"], default=["importance", "tmcmc"])
    parser.add_argument("--engines", nargs="*", choices=list(ENGINES), default=["cuda"], help="that identify")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    told, file = Told(options.json), load_model_file(options.model)
    model, excitation = file.model, file.excitation
    assert excitation is not None
    record = simulate(model, excitation, file.truth, snr_db=file.snr_db)
    drawn = populations(model, model.draws(file.truth)[0])
    for scheme in SCHEMES:
        for name, draws in drawn.items():
            told.tell(compared=name, **scheme, **agreement(model, draws[:N_COMPARED], record, scheme))
    for name, draws in drawn.items():
        for n in SIZES:
            for engine, kind in ENGINES.items():
                solving = kind(**SCHEMES[0])
                seconds = least(partial(solving.misfit, model, draws[:n], record))
                told.tell(timed=name, draws=n, engine=engine, seconds=seconds, per_second=n / seconds)
    few = drawn["prior"][:64]
    for name in options.engines:
        for single in (False, True):  # so that nothing is compiled later
            solving = replace(ENGINES[name](), single=single)
            solving.misfit(model, few, record)
            solving.normal_equations(model, few, record)
        for method in options.methods:
            settings = Settings(method=method, engine=name, particles=options.particles, alternatives=False)
            told.tell(method=method, engine=name, particles=options.particles, **run(model, record, settings))


if __name__ == "__main__":
    main()
