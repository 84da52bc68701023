"""Checkpoints as files: nothing of anybody else's is touched, nothing damaged or forged is taken for a run."""

import json
from pathlib import Path

import numpy as np
import pytest
from evidence_oracles import gaussian_in_box

from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.tmcmc import sample

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
