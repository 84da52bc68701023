"""File size and peak memory of an identification against the number of samples of its record.

``python -m benchmarks.result_size [--samples 1000 10000 100000 1000000] [--json FILE]``

A single-storey building under filtered noise, one acceleration measured, three parameters identified by importance
sampling. Each length runs in a process of its own, whose peak memory the operating system tells; the same process
saves the result, loads it again and renders its page. The record is made by the default engine: sizes do not depend on
what stands in it.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from bwbn_bayes import (
    BoucWen,
    Result,
    Settings,
    ShearBuilding,
    Uniform,
    filtered_noise,
    identify,
    simulate,
    write_report,
)
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.summary import processor_name

MODEL = ShearBuilding(
    masses=[1.0],
    storey=BoucWen(k=Uniform(10, 40), c=Uniform(0.05, 0.5), alpha=0.1, A=1.0, beta=Uniform(0.5, 4.0), gamma=1.0, n=1.5),
)
TRUTH = {"k": 20.0, "c": 0.2, "beta": 2.0}
TIME_STEP, PARTICLES = 0.02, 500


@dataclass(frozen=True, kw_only=True)
class Size:
    """One length of record.

    Attributes
    ----------
    n_samples : int
    file_mb : float
        Of ``result.nc``. [MB]
    identified_mb, peak_mb : float
        Peak memory of the process after the identification, and after result and page were written and read. [MB]
    loaded_mb : float
        Memory that the arrays of the loaded result take. [MB]
    n_solves : int
    identify_s, report_s : float
        Time of the identification, and of saving, loading and rendering. [s]
    """

    n_samples: int
    file_mb: float
    identified_mb: float
    peak_mb: float
    loaded_mb: float
    n_solves: int
    identify_s: float
    report_s: float


def measure(n_samples: int) -> Size:
    """Identify a record of so many samples, save, load and render; for a process of its own."""
    ground = filtered_noise(np.random.default_rng(1), (n_samples - 1) * TIME_STEP, TIME_STEP, rms=1.0)
    record = replace(simulate(MODEL, ground, TRUTH, snr_db=30.0, seed=1, engine=Lanes()), truth={})
    began = time.perf_counter()
    result = identify(MODEL, record, settings=Settings(seed=1, particles=PARTICLES))
    identified, finished = _peak_mb(), time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "result.nc"
        result.save(path)
        size = path.stat().st_size / 1e6
        del result
        loaded = Result.load(path)
        write_report(loaded, Path(name))
        return Size(
            n_samples=record.n_times,
            file_mb=size,
            identified_mb=identified,
            peak_mb=_peak_mb(),
            loaded_mb=sum(node.to_dataset(inherit=False).nbytes for node in loaded.tree.subtree) / 1e6,
            n_solves=loaded.facts.n_solves,
            identify_s=finished - began,
            report_s=time.perf_counter() - finished,
        )


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


def main() -> None:
    """Measure every length in a process of its own, print a table, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, nargs="+", default=[10**3, 10**4, 10**5, 10**6])
    parser.add_argument("--json", type=Path)
    parser.add_argument("--one", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one is not None:
        print(json.dumps(asdict(measure(options.one))))
        return
    sizes = []
    for n_samples in options.samples:
        command = [sys.executable, "-m", "benchmarks.result_size", "--one", str(n_samples)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        sizes.append(Size(**json.loads(done.stdout.splitlines()[-1])))
    table = Table(
        "samples", "file [MB]", "peak, identified [MB]", "peak, all [MB]", "loaded [MB]", "solves", "time [s]"
    )
    for one in sizes:
        numbers = (one.file_mb, one.identified_mb, one.peak_mb, one.loaded_mb, one.n_solves, one.identify_s)
        table.add_row(str(one.n_samples), *(f"{number:.5g}" for number in numbers))
    Console(width=120).print(table)
    if options.json is not None:
        facts = {"processor": processor_name(), "sizes": [asdict(one) for one in sizes]}
        options.json.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
