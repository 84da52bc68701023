"""Ctrl-C as a user presses it, and what a run that was killed leaves."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from bwbn_bayes.cli.files import replacing, writable

SDOF = Path(__file__).parents[1] / "models" / "sdof.py"
# A shell that runs the tests in the background has SIGINT ignored, and so would its children.
MAIN = (
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from bwbn_bayes.cli import main; main()"
)
IN_THE_CHAINS = """
import sys
from bwbn_bayes.inference.pymc.coordinates import NormalCoordinates

asked, own = [], NormalCoordinates.log_density

def log_density(self, x):
    asked.append(1)
    if len(asked) == 100:
        print("in the chains", file=sys.stderr, flush=True)
    return own(self, x)

NormalCoordinates.log_density = log_density
"""
COMPILING = """
import threading, time
from bwbn_bayes import discovery
from bwbn_bayes.engines import precompile
from bwbn_bayes.engines.children import RUNNING
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import SlipLock
from bwbn_bayes.structures.shear_building import ShearBuilding

def compile_and_wait(*_, **__):
    building = ShearBuilding(masses=[1.0], storey=BoucWen(k=10.0, beta=1.0, gamma=1.0))
    precompile.precompile({building.with_effect(SlipLock(delta_s=0.02, sigma=0.05)).law: True}, driven=False)
    print(RUNNING[0].pid, flush=True)
    while True:
        try:
            time.sleep(60.0)
        except KeyboardInterrupt:
            pass

import bwbn_bayes.discovery.workflow as workflow
workflow.discover = compile_and_wait
"""


@contextmanager
def _started(code: str, *options: object, **environment: str) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [sys.executable, "-u", "-c", code, *map(str, options)],
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    with process:
        try:
            yield process
        finally:
            process.kill()


def _interrupted(process: subprocess.Popen[str]) -> tuple[float, str]:
    """Seconds from the signal to the end, and what was said meanwhile."""
    began = time.monotonic()
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60.0)
    return time.monotonic() - began, said


@pytest.mark.parametrize(
    ("method", "step"), [("tmcmc", "TMCMC, bridge"), ("nuts", "in the chains"), ("importance", "finding")]
)
def test_ctrl_c_ends_a_run_at_once_in_one_sentence(tmp_path: Path, method: str, step: str) -> None:
    """It was silent and took up to 24 s; NUTS ended in a hundred lines of traceback: PyMC catches it in the chains."""
    code = IN_THE_CHAINS + MAIN if method == "nuts" else MAIN
    options = ("--method", method, "--out", tmp_path / "out", "--checkpoint", tmp_path / "ck", "--particles", 5000)
    with _started(code, "identify", SDOF, *options) as process:
        assert process.stderr is not None
        while not process.stderr.readline().startswith(step):
            assert process.poll() is None
        took, said = _interrupted(process)
    *_, last = said.splitlines()
    reached = "nothing was solved, checkpoint" if method == "importance" else "what was solved is in checkpoint"
    assert last.startswith(f"stopped: {reached} {tmp_path / 'ck'}")
    assert "Traceback" not in said
    assert process.returncode == 130
    assert took < 2.0
    assert not (tmp_path / "out").exists()


PRESSED_AT_ONCE = """
import os, signal, sys, time

class Press:
    def find_spec(self, name, path=None, target=None):
        if name == "typer":
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(10.0)

sys.meta_path.insert(0, Press())
"""


def test_ctrl_c_before_the_commands_are_loaded_is_one_word() -> None:
    """In the first third of a second it ended in a traceback of imports."""
    with _started(PRESSED_AT_ONCE + MAIN, "--help") as process:
        _, said = process.communicate(timeout=60.0)
    assert (said, process.returncode) == ("stopped\n", 130)


def test_ctrl_c_says_how_a_search_goes_on(tmp_path: Path) -> None:
    """It wrote nothing and began again."""
    out = tmp_path / "out"
    with _started(MAIN, "discover", SDOF, "--out", out) as process:
        assert process.stderr is not None
        while "hypotheses" not in process.stderr.readline():  # the model as given is fitted
            assert process.poll() is None
        took, said = _interrupted(process)
    assert said.splitlines()[-1] == (
        f"stopped: what was fitted is kept in {out}, and the same command with --resume goes on from there"
    )
    assert "Traceback" not in said
    assert (process.returncode, took < 2.0) == (130, True)
    assert [path.name for path in out.iterdir()] == [".unfinished.solves"]


def test_ctrl_c_leaves_no_child_and_asks_no_library(tmp_path: Path) -> None:
    """`precompile` went on compiling; what catches KeyboardInterrupt for its own ends does not get it."""
    options = ("discover", SDOF, "--out", tmp_path / "out")
    with _started(COMPILING + MAIN, *options, BWBN_CACHE_DIR=str(tmp_path / "cache")) as process:
        assert process.stdout is not None
        child = int(process.stdout.readline())
        assert _alive(child)
        took, said = _interrupted(process)
    assert said.splitlines()[-1] == f"stopped: nothing was written to {tmp_path / 'out'}"
    assert (process.returncode, took < 2.0) == (130, True)
    deadline = time.monotonic() + 2.0
    while _alive(child) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not _alive(child)


WORKERS = """
import os, time
from bwbn_bayes.engines.executors import Processes
executor = Processes(2)
print(*{executor._pool.submit(os.getpid).result() for _ in range(8)}, flush=True)
time.sleep(60.0)
"""
RECORD_OF_A_BATCH = """
import multiprocessing, sys
from bwbn_bayes.cli.batch import _in_process
arguments = ("identify", sys.argv[1], "--method", "tmcmc", "--particles", "1000000", "--out", sys.argv[2])
process = multiprocessing.get_context("spawn").Process(target=_in_process, args=(arguments, sys.argv[2] + ".txt"))
process.start()
print(process.pid, flush=True)
process.join()
"""


@pytest.mark.parametrize("code", [WORKERS, RECORD_OF_A_BATCH], ids=["workers", "batch"])
def test_a_kill_leaves_no_child(tmp_path: Path, code: str) -> None:
    """Workers waited for ever; a record of a batch went on, and the batch that went on found its checkpoint taken."""
    with _started(code, SDOF, tmp_path / "out") as process:
        assert process.stdout is not None
        children = [int(word) for word in process.stdout.readline().split()]
        assert children
        process.kill()
        process.wait()
    deadline = time.monotonic() + 30.0
    while any(map(_alive, children)):
        assert time.monotonic() < deadline, "a child lives on"
        time.sleep(0.1)


def _alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().split()[2] != "Z"
    except OSError:
        return False


HALF = """
import sys, time
from pathlib import Path
from bwbn_bayes.cli.files import replacing
with replacing(Path(sys.argv[1])) as fresh:
    (fresh / "report.html").write_text("half")
    print("half", flush=True)
    time.sleep(60.0)
"""


def test_what_a_killed_run_left_is_swept_by_the_next(tmp_path: Path) -> None:
    """`.partial-*` stayed for ever; what another run still writes, or somebody else called so, stays."""
    (tmp_path / ".partial-of a friend").mkdir()
    with _started(HALF, tmp_path) as process:
        assert process.stdout is not None
        process.stdout.readline()
        (left,) = tmp_path.glob(".partial-????????")
        writable(tmp_path)
        assert left.exists()
        process.kill()
        process.wait()
    assert left.exists()
    with replacing(tmp_path) as fresh:
        (fresh / "report.html").write_text("whole")
    assert {path.name for path in tmp_path.iterdir()} == {"report.html", ".partial-of a friend"}
    assert (tmp_path / "report.html").read_text() == "whole"
