"""The wheel in an empty environment: what it takes to install, to import, to ask for help, and to do the main job.

``python -m benchmarks.installation [--python python3.12 python3.13 ...] [--job] [--json FILE]``

Of each interpreter a new environment gets the wheel, which is built from this clone, and what the wheel asks for, by
that environment's own pip, with whatever sources pip is set up for here. Then, from an empty folder: the package is
imported and ``bwbn --help`` printed, several times, of which the least processor time counts, with bytecode (that of
Python by itself is taken off the import's); each part that is not installed is asked for, and must be refused in one
sentence; with ``--job`` the main job runs as somebody does who has no clone, ``bwbn model --example hidden_effect`` and
``bwbn discover hidden_effect.py``, with an empty kernel cache and again with the one that it left.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parents[1]
ROUNDS = 3
ASKED_IMPORT_S, ASKED_HELP_S = 1.0, 1.5
"""Processor time that importing the package and asking for help may take. [s]"""
MISSING: Mapping[str, tuple[str, ...]] = {
    "ga": ("identify", "sdof.py", "--method", "ga"),
    "pymc": ("identify", "sdof.py", "--method", "smc"),
    "nuts": ("identify", "sdof.py", "--method", "nuts", "--sampler", "nutpie"),
    "cvodes": ("identify", "sdof.py", "--engine", "cvodes"),
    "distributed": ("identify", "sdof.py", "--method", "tmcmc", "--scheduler", "tcp://127.0.0.1:9"),
    "obspy": ("identify", "sdof.py", "--record", "record.mseed"),
}
"""What asks for each optional part."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """One command: seconds by the clock and of processor with its children, its exit code, what it said on stderr."""

    seconds: float
    processor_s: float
    code: int
    said: str


@dataclass(frozen=True, kw_only=True)
class Installed:
    """What one interpreter's environment takes.

    Attributes
    ----------
    python : str
        Its version.
    install_s, size_mb : float
        Time of installing the wheel and what it needs, and their size with bytecode. [s, MB]
    start_s, import_s, help_s : float
        Processor time of Python alone, of ``import bwbn_bayes`` beyond it, and of ``bwbn --help`` in all. [s]
    refusals : mapping
        Of each part that is not installed, the sentence that refuses it.
    cold, warm : Run or None
        The main job without and with its kernels.
    """

    python: str
    install_s: float
    size_mb: float
    start_s: float
    import_s: float
    help_s: float
    refusals: Mapping[str, str]
    cold: Run | None
    warm: Run | None


def run(command: Sequence[str | Path], folder: Path, **environment: str) -> Run:
    """Run a command in a folder, without the clone on any path."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
    began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        list(map(str, command)),
        cwd=folder,
        env={**kept, **environment},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Run(seconds=time.perf_counter() - began, processor_s=used, code=done.returncode, said=done.stderr.strip())


def succeeded(done: Run) -> Run:
    """The run, if it ended well."""
    if done.code:
        raise RuntimeError(done.said)
    return done


def least(command: Sequence[str | Path], folder: Path) -> float:
    """Least processor time of some runs, in seconds."""
    succeeded(run(command, folder))  # bytecode of what pip does not compile, and the disk
    return min(succeeded(run(command, folder)).processor_s for _ in range(ROUNDS))


def refused(bwbn: Path, folder: Path) -> dict[str, str]:
    """What is said of each part that is not installed; empty where it is not one sentence."""
    for name in ("sdof", "hidden_effect"):
        succeeded(run([bwbn, "model", "--example", name], folder))
    (folder / "record.mseed").write_bytes(b"000001D " + bytes(120))
    found = {}
    for extra, arguments in MISSING.items():
        command: list[str | Path] = [bwbn, *arguments]
        done = run(command, folder)
        is_sentence = done.code == 2 and done.said.startswith("error: ") and len(done.said.splitlines()) == 1
        found[extra] = done.said if is_sentence else ""
    return found


def measure(python: str, wheel: Path, place: Path, *, job: bool) -> Installed:
    """One interpreter, in an environment of its own."""
    environment, folder = place / "environment", place / "work"
    folder.mkdir(parents=True)
    succeeded(run([python, "-m", "venv", environment], folder))
    own = environment / "bin" / "python"
    installing = succeeded(run([own, "-m", "pip", "install", "--quiet", wheel], folder))
    bwbn = environment / "bin" / "bwbn"
    start = least([own, "-c", "pass"], folder)
    version = subprocess.run([own, "-V"], capture_output=True, text=True, check=True).stdout.strip()
    refusals = refused(bwbn, folder)

    def main_job(number: int) -> Run | None:
        command: list[str | Path] = [bwbn, "discover", "hidden_effect.py", "--out", f"report{number}"]
        return succeeded(run(command, folder, BWBN_CACHE_DIR=str(place / "cache"))) if job else None

    return Installed(
        python=version,
        install_s=installing.seconds,
        size_mb=sum(path.stat().st_size for path in environment.rglob("*") if path.is_file()) / 1e6,
        start_s=start,
        import_s=least([own, "-c", "import bwbn_bayes"], folder) - start,
        help_s=least([bwbn, "--help"], folder),
        refusals=refusals,
        cold=main_job(1),
        warm=main_job(2),
    )


def usable(python: str) -> bool:
    """Whether there is such an interpreter."""
    path = shutil.which(python)
    return path is not None and run([path, "-c", "import ensurepip"], ROOT).code == 0


def report(rows: Sequence[Installed], console: Console) -> None:
    """Print the tables."""
    table = Table("Python", "install [s]", "size [MB]", "import [s]", "--help [s]", "main job, cold [s]", "warm [s]")
    for row in rows:
        jobs = ["" if one is None else f"{one.seconds:.0f} ({one.processor_s:.0f})" for one in (row.cold, row.warm)]
        numbers = (f"{row.install_s:.0f}", f"{row.size_mb:.0f}", f"{row.import_s:.2f}", f"{row.help_s:.2f}")
        table.add_row(row.python, *numbers, *jobs)
    console.print(table)
    console.print("Of import, --help and in brackets processor time.", highlight=False)
    for extra, sentence in rows[0].refusals.items():
        console.print(
            f"{extra}: {sentence or 'not refused in one sentence'}", highlight=False, markup=False, soft_wrap=True
        )


def main() -> None:
    """Measure every interpreter, print tables, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", nargs="+", default=["python3.12", "python3.13", "python3.14"])
    parser.add_argument("--job", action="store_true", help="the main job, too: minutes")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    console = Console(width=110)
    pythons = [python for python in options.python if usable(python)]
    if not pythons:
        sys.exit(f"no interpreter of {', '.join(options.python)} is here: name one with --python")
    rows = []
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        builder = place / "builder"
        succeeded(run([pythons[0], "-m", "venv", builder], place))
        succeeded(run([builder / "bin" / "pip", "wheel", "--quiet", "--no-deps", "-w", place, ROOT], place))
        (wheel,) = place.glob("*.whl")
        for number, python in enumerate(pythons):
            rows.append(measure(python, wheel, place / str(number), job=options.job))
            shutil.rmtree(place / str(number))
    for python in set(options.python) - set(pythons):
        console.print(f"{python} is not on this machine", highlight=False)
    report(rows, console)
    if options.json is not None:
        options.json.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n", encoding="utf-8")
    slow = any(row.import_s > ASKED_IMPORT_S or row.help_s > ASKED_HELP_S for row in rows)
    if slow or any(not sentence for row in rows for sentence in row.refusals.values()):
        sys.exit("slower than asked, or a missing part is not told in one sentence")


if __name__ == "__main__":
    main()
