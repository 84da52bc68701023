"""Results as files: what was saved is loaded again, and nothing else passes for one."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
import xarray as xr

from bwbn_bayes import Result, UserError
from bwbn_bayes.results import Check, Equation, Facts, ParameterFacts, StageFacts

FACTS = Facts(
    method="importance", model="sdof", record="r", engine="lanes", seed=1, log_evidence=-3.0, log_evidence_se=0.1,
    parameters=(
        ParameterFacts(name="k", symbol="k", unit="N/m", prior="", mean=1.0, sd=0.1, hdi90=(0.9, 1.1), true=None),
        ParameterFacts(name="c", symbol="c", unit="", prior="", mean=1.0, sd=0.1, hdi90=(0.9, 1.1), true=1.0),
    ),
    nrmse={"acceleration_1": 0.03}, noise_sd={}, n_solves=10, n_stages=1, elapsed_s=2.0, effective_sample_size=9.5,
    storeys=1, verdict=("one", "two"), checks=(Check(name="k", value=0.1, limit=0.7, passed=True, sentence="s"),),
    stages=(StageFacts(stage=0, tempering_parameter=0.0, acceptance=1.0, effective_sample_size=1.0, n_solves=1,
                       log_evidence=0.0, elapsed_s=1.0),),
    equations=(Equation(caption="c", mathml="<math/>"),), evidences={"importance": (-3.0, 0.1)},
    restoring_force={"1": {"nrmse": 0.1}}, discretisation={"scheme": "RK4", "nrmse": None},
)  # fmt: skip


def _stored(facts: object, path: Path) -> Path:
    xr.DataTree(xr.Dataset({"x": ("time", [1.0])}, attrs={"facts": facts})).to_netcdf(path, engine="h5netcdf")
    return path


def test_what_was_saved_is_loaded_again(tmp_path: Path) -> None:
    Result(tree=xr.DataTree(xr.Dataset({"x": ("time", [1.0])})), facts=FACTS).save(tmp_path / "result.nc")
    loaded = Result.load(tmp_path / "result.nc")
    assert loaded.facts == FACTS
    assert loaded.tree["x"].item() == 1.0


FOREIGN: dict[str, Any] = {
    "of another program": {"title": "mine"},
    "a list": [],
    "a number": 3,
    "a word": "facts",
    "nothing": None,
    "parameters of words": {"parameters": ["k"]},
    "parameters of a number": {"parameters": 3},
    "a parameter too short": {"parameters": [{"name": "k"}]},
    "an interval too long": {"parameters": [asdict(FACTS.parameters[0]) | {"hdi90": [1, 2, 3]}]},
    "a mean of words": {"parameters": [asdict(FACTS.parameters[0]) | {"mean": "one"}]},
    "a field too many": {"colour": "red"},
    "evidences of words": {"evidences": {"importance": "high"}},
    "a seed of words": {"seed": "one"},
    "a verdict of numbers": {"verdict": [1, 2]},
    "a verdict of one word": {"verdict": "fine"},
    "nrmse of lists": {"nrmse": []},
    "passed of words": {"checks": [asdict(FACTS.checks[0]) | {"passed": "yes"}]},
}


@pytest.mark.parametrize("foreign", FOREIGN.values(), ids=FOREIGN)
def test_facts_of_another_kind_are_no_result(foreign: object, tmp_path: Path) -> None:
    """They ended in a TypeError from the middle of the package, or passed and ended so in the report."""
    known = isinstance(foreign, dict) and "title" not in foreign
    facts = json.dumps(asdict(FACTS) | foreign if known else foreign)
    path = _stored(facts, tmp_path / "result.nc")
    with pytest.raises(UserError, match="is no saved result"):
        Result.load(path)


def test_facts_that_are_no_text_are_no_result(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="is no saved result"):
        Result.load(_stored(3, tmp_path / "result.nc"))


def test_what_is_no_plain_file_is_no_result(tmp_path: Path) -> None:
    """A named pipe was waited for without end."""
    path = tmp_path / "result.nc"
    os.mkfifo(path)
    handle = os.open(path, os.O_RDWR | os.O_NONBLOCK)  # where it were opened, something would come
    os.write(handle, b"x")
    with pytest.raises(UserError, match="is no saved result") as refused:
        Result.load(path)
    os.close(handle)
    assert "no plain file" in str(refused.value.__cause__)


def test_a_result_that_finds_no_room_is_told_of_once(tmp_path: Path) -> None:
    """Python told of a buffer on stderr when the interpreter ended."""
    done = subprocess.run(
        [sys.executable, "-c", NO_ROOM, str(tmp_path / "result.nc")], capture_output=True, text=True, check=True
    )
    assert (done.stdout, done.stderr) == ("[Errno 27] File too large\n", "")


FULL = """
import sys
from pathlib import Path
from bwbn_bayes import UserError, sine, write_record
record = sine(amplitude=1.0, frequency_hz=1.0, duration=100.0, time_step=0.01)
try:
    write_record(record, Path(sys.argv[1]))
except UserError as error:
    print(error)
"""


NO_ROOM = """
import resource, sys
import xarray as xr
from bwbn_bayes import Result
from bwbn_bayes.results import Facts
facts = Facts(
    method="", model="", record="", engine="", seed=1, parameters=(), log_evidence=0.0, log_evidence_se=0.0, nrmse={},
    noise_sd={}, n_solves=0, n_stages=0, elapsed_s=0.0, effective_sample_size=0.0, storeys=1,
)
resource.setrlimit(resource.RLIMIT_FSIZE, (100, resource.RLIM_INFINITY))
try:
    Result(tree=xr.DataTree(xr.Dataset({"x": ("time", [1.0] * 5000)})), facts=facts).save(sys.argv[1])
except OSError as error:
    kept = error  # as a chain of exceptions keeps it, traceback and all, until the process ends
    print(error)
"""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_is_told_of_once(tmp_path: Path) -> None:
    """HDF5 told of it in pages, and again when the interpreter ended."""
    path = tmp_path / "full.nc"
    path.symlink_to("/dev/full")
    done = subprocess.run([sys.executable, "-c", FULL, str(path)], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == (f"{path}: the file cannot be written (No space left on device)\n", "")
    result = Result(tree=xr.DataTree(xr.Dataset({"x": ("time", [1.0] * 5000)})), facts=FACTS)
    with pytest.raises(OSError, match="No space left on device"):
        result.save(path)
