"""Checkpoints as files: nothing of anybody else's is touched, nothing damaged or forged is taken for a run."""

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from evidence_oracles import gaussian_in_box

from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.identifiability import flag
from bwbn_bayes.inference.tmcmc import sample
from bwbn_bayes.results import StageFacts

ORACLE = gaussian_in_box(np.array([0.3, 0.6]), np.array([0.02, 0.05]))


@pytest.mark.parametrize(("name", "other"), [("ck[1]", "ck1"), ("ck*", "ck_else"), ("ck?", "ck9")])
def test_a_checkpoint_deletes_its_own_arrays_alone(tmp_path: Path, name: str, other: str) -> None:
    """A name with brackets or a star was taken for a pattern: `ck*` deleted the arrays of every other run."""
    sample(ORACLE, n_particles=300, rng_seed=1, checkpoint=tmp_path / other)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    sample(ORACLE, n_particles=300, rng_seed=2, checkpoint=tmp_path / name)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.name in before} == before
    assert len([path for path in tmp_path.iterdir() if path.suffix == ".npz"]) == 2


def test_a_checkpoint_whose_arrays_lie_elsewhere_is_refused(tmp_path: Path) -> None:
    """The name in the description is data from a file: it must not lead out of the checkpoint's own place."""
    sample(ORACLE, n_particles=300, rng_seed=1, checkpoint=tmp_path / "run")
    description = json.loads((tmp_path / "run.json").read_text())
    (tmp_path / "run.json").write_text(json.dumps({**description, "arrays": "../run.stage-1.npz"}))
    with pytest.raises(UserError, match="its arrays are said to be in"):
        sample(ORACLE, n_particles=300, rng_seed=1, checkpoint=tmp_path / "run")


Edit = Callable[[dict[str, Any]], object]


def _edited(directory: Path, edit: Edit) -> None:
    """A checkpoint, facts and arrays alike, that is well-formed, with the right hash, and wrong."""
    description = json.loads((directory / "run.json").read_text())
    path = directory / description["arrays"]
    with np.load(path) as stored:
        names = stored.files
        contents = {**description, **stored}
    edit(contents)
    np.savez(path, allow_pickle=False, **{name: contents.pop(name) for name in names})
    contents["arrays_sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()
    (directory / "run.json").write_text(json.dumps(contents))


def _cut(arrays: dict[str, Any], *names: str) -> None:
    for name in names:
        arrays[name] = arrays[name][:100]


COLUMNS = ("points", "log_reference", "log_ratio", "log_likelihood", "families")
WRONG: dict[str, tuple[Edit, str]] = {
    "NaN points": (lambda c: c["points"].fill(np.nan), "outside the unit cube"),
    "NaN likelihoods": (lambda c: c["log_likelihood"].fill(np.nan), "NaN or infinite"),
    "one NaN": (lambda c: c["log_ratio"].__setitem__(7, np.nan), "NaN or infinite"),
    "infinite": (lambda c: c["log_ratio"].__setitem__(7, np.inf), "NaN or infinite"),
    "nothing reachable": (lambda c: c["log_ratio"].fill(-np.inf), "no point has a likelihood"),
    "tempering 5": (lambda c: c.update(tempering_parameter=5), "does not rise"),
    "tempering 1 of half a run": (lambda c: c.update(tempering_parameter=1.0), "does not rise"),
    "tempering NaN": (lambda c: c.update(tempering_parameter=float("nan")), "does not rise"),
    "tempering of words": (lambda c: c.update(tempering_parameter="half"), "cannot be read"),
    "no stages": (lambda c: c.update(facts=[]), "tells of no stage"),
    "stages twice": (lambda c: c.update(facts=c["facts"] * 2), "not numbered"),
    "stages of another kind": (lambda c: c.update(facts=[{"stage": 0}]), "cannot be read"),
    "stages of words": (lambda c: c["facts"][1].update(tempering_parameter="half"), "cannot be read"),
    "evidence NaN": (lambda c: c.update(log_evidence=float("nan")), "not those of its last stage"),
    "variance below zero": (lambda c: c.update(log_evidence_variance=-1.0), "not a number"),
    "worth NaN": (lambda c: c.update(effective_size=float("nan")), "not a number"),
    "solves of another run": (lambda c: c.update(n_solves=3), "not those of its last stage"),
    "one array cut short": (lambda c: _cut(c, "log_ratio"), "differ in length"),
    "all arrays cut short": (lambda c: _cut(c, *COLUMNS), "another shape"),
    "another dimension": (lambda c: c.update(points=c["points"][:, :1]), "another shape"),
    "families of fractions": (lambda c: c.update(families=c["families"] + 0.5), "differ in length"),
    "no tuning": (lambda c: c.update(shares=c["shares"][:0]), "not tuned"),
    "text for numbers": (lambda c: c.update(points=np.array(["a", "b"])), "cannot be read"),
    "no identity": (lambda c: c.pop("identity"), "cannot be read"),
    "identity of words": (lambda c: c.update(identity="mine"), "cannot be read"),
    "other densities": (lambda c: c["log_ratio"].__iadd__(1.0), "not those of this model"),
}


@pytest.fixture(scope="module")
def half_a_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("half")

    def stop(facts: StageFacts) -> None:
        if facts.stage == 2:
            raise InterruptedError

    with pytest.raises(InterruptedError):
        sample(ORACLE, n_particles=300, rng_seed=1, checkpoint=directory / "run", progress=stop)
    return directory


@pytest.mark.parametrize(("edit", "sentence"), WRONG.values(), ids=WRONG)
def test_a_well_formed_checkpoint_that_no_run_can_have_written_is_refused(
    half_a_run: Path, tmp_path: Path, edit: Edit, sentence: str
) -> None:
    """NaN arrays, a tempering parameter of 5 or no stages were continued, to "8 of 8 parameters are identified"."""
    shutil.copytree(half_a_run, tmp_path, dirs_exist_ok=True)
    _edited(tmp_path, edit)
    with pytest.raises(UserError, match=sentence) as refused:
        sample(ORACLE, n_particles=300, rng_seed=1, checkpoint=tmp_path / "run")
    assert str(tmp_path / "run") in str(refused.value)


def test_the_check_takes_what_a_run_wrote(half_a_run: Path, tmp_path: Path) -> None:
    shutil.copytree(half_a_run, tmp_path, dirs_exist_ok=True)
    _edited(tmp_path, lambda _: None)
    resumed = sample(ORACLE, n_particles=300, rng_seed=1, checkpoint=tmp_path / "run")
    np.testing.assert_array_equal(resumed.particles, sample(ORACLE, n_particles=300, rng_seed=1).particles)


def test_arrays_of_another_moment_are_refused(half_a_run: Path, tmp_path: Path) -> None:
    """Whole, finite and of the right shape, but not those that the description was written with."""
    shutil.copytree(half_a_run, tmp_path, dirs_exist_ok=True)
    (path,) = tmp_path.glob("*.npz")
    with np.load(path) as stored:
        arrays = dict(stored)
    arrays["points"] = arrays["points"][::-1]
    np.savez(path, allow_pickle=False, **arrays)
    with pytest.raises(UserError, match="not those that it was written with"):
        sample(ORACLE, n_particles=300, rng_seed=1, checkpoint=tmp_path / "run")


@pytest.mark.parametrize("text", ["", "[]", "3", "{}", "\x00", "[" * 100_000, '{"arrays": []}', '{"identity": 1}'])
def test_a_description_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "run.json").write_text(text)
    with pytest.raises(UserError, match="cannot be read"):
        sample(ORACLE, n_particles=300, rng_seed=1, checkpoint=tmp_path / "run")


def test_a_posterior_of_nan_is_not_identified() -> None:
    """Comparisons with NaN are false, and so it passed for identified."""
    assert flag(np.full(100, np.nan)) == "unidentified"


def test_a_full_disk_ends_in_one_sentence_and_keeps_the_last_good_stage(
    half_a_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It ended in a traceback."""
    shutil.copytree(half_a_run, tmp_path, dirs_exist_ok=True)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("os.fsync", full)
        with pytest.raises(UserError, match=r"cannot be written \(No space left on device\): the last stage"):
            sample(ORACLE, n_particles=300, rng_seed=1, checkpoint=tmp_path / "run")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    resumed = sample(ORACLE, n_particles=300, rng_seed=1, checkpoint=tmp_path / "run")
    np.testing.assert_array_equal(resumed.particles, sample(ORACLE, n_particles=300, rng_seed=1).particles)
