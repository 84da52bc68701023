"""A tall building: how long it takes to identify a stiffness for each of its storeys, and how far off they are.

``python -m benchmarks.tall [--storeys 30] [--floors 1 10 20 30] [--alternatives] [--json FILE]``

Floors of 1 kg on Bouc-Wen storeys, 9,000 N/m at the ground and less above, under twenty seconds of El Centro 1940 at
50 Hz, by the reference engine, with noise at 30 dB. Priors reach from 2,000 to 20,000 N/m; damping and ``beta``, alike
in all storeys, are identified too. ``squared_distance`` is the truth's from the posterior mean in the posterior's
covariance: about as many as there are parameters where the posterior is right.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.running import Clock
from benchmarks.telling import tell
from bwbn_bayes import BoucWen, PerStorey, Settings, ShearBuilding, Uniform, el_centro, identify, simulate
from bwbn_bayes.structures.structure import Structure

ALIKE = {"c": 8.0, "beta": 60.0}


def building(n_storeys: int) -> tuple[Structure, dict[str, float]]:
    """The model and the true values of its parameters."""
    storey = BoucWen(
        k=PerStorey(Uniform(2000.0, 20000.0)),
        c=Uniform(1.0, 20.0),
        alpha=0.1,
        A=1.0,
        beta=Uniform(1.0, 200.0),
        gamma=5.0,
        n=1.2,
    )
    model = ShearBuilding(masses=[1.0] * n_storeys, storey=storey)
    return model, {**{f"k[{i}]": 9150.0 - 150.0 * i for i in range(1, n_storeys + 1)}, **ALIKE}


def identified(n_storeys: int, floors: Sequence[int], seed: int, *, alternatives: bool) -> dict[str, Any]:
    """Identify the building from sensors on some floors; the catalogue may be asked what else explains the record."""
    model, truth = building(n_storeys)
    channels = [f"acceleration_{floor}" for floor in floors]
    record = simulate(model, el_centro("chopra", duration=20.0), truth, channels=channels, snr_db=30.0, seed=seed)
    clock = Clock()
    result = identify(model, record, settings=Settings(particles=500, seed=seed, alternatives=alternatives))
    spent, found = clock.as_json(), {one.name: one for one in result.facts.parameters}
    posterior = result.tree["posterior"]
    stiffness = np.asarray(posterior["k"].values).reshape(-1, n_storeys).T
    draws = np.concatenate([stiffness, [np.ravel(posterior[name]) for name in ALIKE]])
    off = np.array([found[name].mean - value for name, value in truth.items()])
    return {
        "storeys": n_storeys,
        "floors": list(floors),
        "n_parameters": len(truth),
        "alternatives": alternatives,
        "method": result.facts.method,
        "failed_checks": [check.name for check in result.facts.checks if not check.passed],
        "z": {name: (found[name].mean - value) / found[name].sd for name, value in truth.items()},
        "sd": {name: found[name].sd for name in truth},
        "squared_distance": float(off @ np.linalg.solve(np.cov(draws), off)),
        **spent,
    }


def main() -> None:
    """Identify, print a table, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--storeys", type=int, default=30)
    parser.add_argument("--floors", type=int, nargs="*", help="with a sensor; all by default")
    parser.add_argument(
        "--alternatives", action="store_true", help="ask the catalogue, too: every effect at every place"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    floors = options.floors or range(1, options.storeys + 1)
    line = identified(options.storeys, floors, options.seed, alternatives=options.alternatives)
    table = Table("storeys", "sensors", "parameters", "rms z", "squared distance", "failed", "processor [s]")
    table.add_row(
        str(line["storeys"]),
        str(len(line["floors"])),
        str(line["n_parameters"]),
        f"{np.sqrt(np.mean(np.square(list(line['z'].values())))):.2f}",
        f"{line['squared_distance']:.1f}",
        ", ".join(line["failed_checks"]) or "none",
        f"{line['processor_seconds']:.0f}",
    )
    tell(table, [line], options.json)


if __name__ == "__main__":
    main()
