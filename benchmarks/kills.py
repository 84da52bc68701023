"""Runs that are killed at random moments, and whether they come to the result of one that nobody disturbed.

``python -m benchmarks.kills [--jobs importance tmcmc ...] [--kills 20] [--seed 1] [--json FILE]``

Each job is a command on a small case. It runs once undisturbed; then again and again, killed (SIGKILL) at moments
drawn evenly over the time that the first run took, and going on where it was killed. One that finishes before its
moment is compared and begins anew, so that as many kills are counted as were asked for. Every finished result must be
that of the first run, bit for bit but for times. What a killed run has started must end with it.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from bwbn_bayes import BoucWen, Result, ShearBuilding, simulate, sine, write_record

MODEL = """from bwbn_bayes import BoucWen, ShearBuilding, Uniform, sine

model = ShearBuilding(masses=[1.0], storey=BoucWen(
    k=Uniform(20, 60), c=Uniform(0.01, 1), alpha=0.1, A=1.0, beta=Uniform(0.5, 8), gamma=1.0, n=1.5))
excitation = sine(amplitude=1.0, frequency_hz=1.0, duration=8.0, time_step=0.02)
"""
TRUTH = BoucWen(k=40.0, c=0.2, alpha=0.1, A=1.0, beta=2.0, gamma=1.0, n=1.5)
BWBN = "from bwbn_bayes.cli import main\nif __name__ == '__main__':\n    main()\n"
REPRODUCE = """import sys
from pathlib import Path
from bwbn_bayes.reproduction.cases import Case
from bwbn_bayes.reproduction.options import Options
from bwbn_bayes.reproduction.workflow import reproduce
options = Options(quick=True, generations=10, particles=100, sine_duration=20.0, el_centro_version="chopra")
cases = [Case(method=method, group=1, snr=snr, excitation="ElCentro") for method, snr in (("IPV", "30"), ("GA", "inf"))]
reproduce(Path(sys.argv[1]), options=options, cases=cases)
"""
DISCOVER = """import sys
from pathlib import Path
from bwbn_bayes import read_record
from bwbn_bayes.cli.files import write_discovery_files, write_unfinished
from bwbn_bayes.discovery.run import DiscoverySettings
from bwbn_bayes.discovery.unfinished import Unfinished
from bwbn_bayes.discovery.workflow import discover
from bwbn_bayes.elements.effects import CubicStiffness, QuadraticDamping, SensorGain
from bwbn_bayes.structures.model_file import load_model_file
model, record, out = map(Path, sys.argv[1:])
effects = (CubicStiffness, QuadraticDamping, SensorGain)
settings = DiscoverySettings(effects=effects, particles=300, checkpoint=out / ".unfinished")
hear = lambda _, facts: write_unfinished(facts, out) if isinstance(facts, Unfinished) else None
found = discover(load_model_file(model).model, read_record(record), settings=settings, listener=hear)
write_discovery_files(found, out, model)
"""
_TOOK = ("elapsed_s", "median_s", "worst_s")
"""How names of times end; those of a standard error end in ``_se``."""
_GRACE = 10.0
"""Time that children have to end in after their parent was killed. [s]"""


@dataclass(frozen=True, kw_only=True)
class Job:
    """A command that can be killed.

    Attributes
    ----------
    script : str
        File that Python runs, or ``-m`` and a module.
    arguments : tuple of str
        ``OUT`` stands for the directory that it writes to.
    digest : callable
        Of that directory: everything that must be the same.
    """

    script: str
    arguments: tuple[str, ...]
    digest: Callable[[Path], str]

    def command(self, out: Path) -> list[str]:
        """What is run."""
        words = self.script.split(maxsplit=1) if self.script.startswith("-m") else [self.script]
        return [sys.executable, *words, *(word.replace("OUT", str(out)) for word in self.arguments)]


@dataclass(frozen=True, kw_only=True)
class Killed:
    """What became of a job: kills, finished runs that were compared, those that came to something else, orphans."""

    job: str
    seconds: float
    kills: int
    compared: int
    differed: int
    orphans: int


def timeless(found: Any) -> Any:
    """Without seconds that it took."""
    if isinstance(found, dict):
        return {key: timeless(value) for key, value in found.items() if not key.endswith(_TOOK)}
    return [timeless(value) for value in found] if isinstance(found, list) else found


def of_result(path: Path) -> str:
    """Hash of a saved result's arrays and facts."""
    result = Result.load(path)
    facts = replace(
        result.facts, elapsed_s=0.0, stages=tuple(replace(stage, elapsed_s=0.0) for stage in result.facts.stages)
    )
    digest = hashlib.sha256(repr(facts).encode())
    for node in result.tree.subtree:
        for name, array in sorted(node.variables.items()):
            digest.update(f"{node.path} {name} {array.shape} {array.dtype}".encode())
            digest.update(np.ascontiguousarray(array.values).tobytes())
    return digest.hexdigest()


def of_json(path: Path) -> str:
    """A JSON file without its times."""
    return repr(timeless(json.loads(path.read_text(encoding="utf-8"))))


def of_discovery(out: Path) -> str:
    """All that a discovery says."""
    improved = (out / "improved_model.py").read_text(encoding="utf-8").replace(str(out), "OUT")
    return of_json(out / "discovery.json") + improved + of_result(out / "identify" / "result.nc")


def of_batch(out: Path) -> str:
    """Every record's result, and the table."""
    return of_json(out / "batch.json") + "".join(map(of_result, sorted(out.glob("*/result.nc"))))


def of_reproduction(out: Path) -> str:
    """Every case."""
    return "".join(map(of_json, sorted(out.glob("cases/*/*.json"))))


def jobs(place: Path) -> dict[str, Job]:
    """What is killed, by name; with its inputs in a directory."""
    (place / "bwbn.py").write_text(BWBN, encoding="utf-8")
    (place / "reproduce.py").write_text(REPRODUCE, encoding="utf-8")
    (place / "discover.py").write_text(DISCOVER, encoding="utf-8")
    (place / "model.py").write_text(MODEL, encoding="utf-8")
    (place / "records").mkdir()
    for number in (1, 2):
        ground = sine(amplitude=float(number), frequency_hz=1.0, duration=6.0, time_step=0.02)
        building = ShearBuilding(masses=[1.0], storey=TRUTH)
        record = simulate(building, ground, {}, channels=["acceleration_1"], snr_db=30.0, seed=number)
        write_record(replace(record, truth={}), place / "records" / f"r{number}.csv")
    bwbn, model, record_file = str(place / "bwbn.py"), str(place / "model.py"), str(place / "records" / "r2.csv")
    given = (model, "--record", record_file, "--out", "OUT")

    def identified(*options: str) -> Job:
        arguments = ("identify", *given, "--checkpoint", "OUT/run", "--no-alternatives", *options)
        return Job(script=bwbn, arguments=arguments, digest=lambda out: of_result(out / "result.nc"))

    benchmark = ("--model", model, "--cases", "2", "--checkpoint", "OUT/cases.jsonl", "--json", "OUT/table.json")
    return {
        "importance": identified("--particles", "2000"),
        "tmcmc": identified("--method", "tmcmc", "--particles", "500"),
        "tmcmc, 2 workers": identified("--method", "tmcmc", "--particles", "500", "--workers", "2"),
        "smc": identified("--method", "smc", "--particles", "300"),
        "ga": identified("--method", "ga", "--particles", "300"),
        # As the command does, with three effects of the catalogue, to be quick.
        "discover": Job(script=str(place / "discover.py"), arguments=(model, record_file, "OUT"), digest=of_discovery),
        "reproduce": Job(script=str(place / "reproduce.py"), arguments=("OUT",), digest=of_reproduction),
        "benchmark": Job(
            script="-m benchmarks.importance", arguments=benchmark, digest=lambda out: of_json(out / "table.json")
        ),
        "batch": Job(
            script=bwbn,
            arguments=("batch", str(place / "records"), "--model", model, "--particles", "500", "--out", "OUT"),
            digest=of_batch,
        ),
    }


def children_of(process: int) -> set[int]:
    """Processes that one has started and whose end it would have waited for."""
    found: set[int] = set()
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(path.read_text().rpartition(")")[2].split()[1])
        except OSError:  # it has ended meanwhile
            continue
        if parent == process:
            found |= {int(path.parent.name)} | children_of(int(path.parent.name))
    return found


def living(processes: set[int]) -> set[int]:
    """Those that have not ended."""
    found = set()
    for process in processes:
        try:
            if Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z":
                found.add(process)
        except OSError:
            continue
    return found


def ended(processes: set[int]) -> int:
    """How many still live after a while."""
    deadline = time.monotonic() + _GRACE
    while living(processes) and time.monotonic() < deadline:
        time.sleep(0.1)
    return len(living(processes))


def run(job: Job, out: Path, moment: float | None) -> tuple[bool, int]:
    """Run a job, and kill it at a moment if it still runs then; whether it was killed, and orphans."""
    out.mkdir(parents=True, exist_ok=True)
    with subprocess.Popen(job.command(out), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        try:
            _, said = process.communicate(timeout=moment)
        except subprocess.TimeoutExpired:
            children = children_of(process.pid)
            process.kill()
            return True, ended(children)
    if process.returncode:
        raise RuntimeError(f"{' '.join(job.command(out))} ended with exit code {process.returncode}: {said}")
    return False, 0


def measure(name: str, job: Job, place: Path, n_kills: int, rng: random.Random) -> Killed:
    """Kill a job so many times."""
    began = time.perf_counter()
    run(job, place / "whole", None)
    seconds = time.perf_counter() - began
    expected = job.digest(place / "whole")
    out, kills, compared, differed, orphans = place / "killed", 0, 0, 0, 0
    while True:
        moment = rng.uniform(0.0, seconds) if kills < n_kills else None
        killed, left = run(job, out, moment)
        kills, orphans = kills + killed, orphans + left
        if not killed:
            compared, differed = compared + 1, differed + (job.digest(out) != expected)
            if kills == n_kills:
                return Killed(
                    job=name, seconds=seconds, kills=kills, compared=compared, differed=differed, orphans=orphans
                )
            shutil.rmtree(out)


def report(rows: list[Killed], path: Path | None, console: Console) -> None:
    """Print the table, write JSON."""
    table = Table("job", "undisturbed [s]", "kills", "finished and compared", "differed", "children left")
    for row in rows:
        numbers = (row.kills, row.compared, row.differed, row.orphans)
        table.add_row(row.job, f"{row.seconds:.1f}", *map(str, numbers))
    console.print(table)
    if path is not None:
        path.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n", encoding="utf-8")


def main() -> None:
    """Kill every job, print a table, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--jobs", nargs="+", help="all of them by default")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    console = Console(width=110)
    with tempfile.TemporaryDirectory() as name:
        every: Mapping[str, Job] = jobs(Path(name))
        rows = []
        for number, kind in enumerate(options.jobs or every):
            rng = random.Random(options.seed + number)
            rows.append(measure(kind, every[kind], Path(name) / f"job {number}", options.kills, rng))
            console.print(rows[-1], highlight=False)
        report(rows, options.json, console)
    if any(row.differed or row.orphans for row in rows):
        sys.exit("a killed run came to another result, or left a child")


if __name__ == "__main__":
    main()
