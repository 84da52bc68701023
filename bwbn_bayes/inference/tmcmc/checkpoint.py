"""Saving a run after each stage, so that a run cut short goes on to the same result, bit for bit.

A checkpoint ``NAME`` is a description ``NAME.json`` (stage, history, what must match) and the arrays it names,
``NAME.stage-K.npz``. The description is replaced last and in one operation: a run killed at any moment leaves a
whole checkpoint behind.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, suppress
from dataclasses import asdict
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bwbn_bayes.errors import UNREADABLE_ARRAYS, UserError, writing
from bwbn_bayes.inference.tmcmc.moves import FIRST_TUNING, Tuning
from bwbn_bayes.inference.tmcmc.stages import Population
from bwbn_bayes.inference.tmcmc.target import Cloud
from bwbn_bayes.results import StageFacts


class RunState(NamedTuple):
    """A run between two stages."""

    population: Population
    tempering_parameter: float
    log_evidence: float
    log_evidence_variance: float
    n_solves: int
    facts: tuple[StageFacts, ...]


Identity = Mapping[str, str | int | float]
"""What a checkpoint and the run that resumes it must have in common."""


def save(path: Path, state: RunState, identity: Identity) -> None:
    """Write a checkpoint, replacing the one before.

    Parameters
    ----------
    path : Path
        Name of the checkpoint, without suffix.
    state : RunState
        The run between two stages.
    identity : Identity
        What a resuming run must match.
    """
    before = _named_arrays(path)
    arrays = path.with_name(f"{path.name}.stage-{state.facts[-1].stage}.npz")
    population = state.population
    stream = BytesIO()
    np.savez(
        stream,
        families=population.families,
        shares=population.tuning.shares,
        scales=population.tuning.scales,
        **population.cloud._asdict(),
    )
    description = {
        "identity": dict(identity),
        "arrays": arrays.name,
        "arrays_sha256": hashlib.sha256(stream.getvalue()).hexdigest(),
        "effective_size": population.effective_size,
        "tempering_parameter": state.tempering_parameter,
        "log_evidence": state.log_evidence,
        "log_evidence_variance": state.log_evidence_variance,
        "n_solves": state.n_solves,
        "facts": [asdict(facts) for facts in state.facts],
    }
    with _writing(path):
        _write(arrays, stream.getvalue())
        _write(_description(path), json.dumps(description, indent=1).encode())
        if before is not None and before != arrays:
            before.unlink(missing_ok=True)


def require_place(path: Path) -> None:
    """Try before a long run whether a checkpoint can be kept.

    Raises
    ------
    UserError
        If it cannot.
    """
    if not path.name:
        raise UserError(f"checkpoint {path}: it is a directory, give the name of a file in it, without suffix")
    with writing(f"checkpoint {path}", "choose another place"):
        path.parent.mkdir(parents=True, exist_ok=True)
        probe = path.with_name(f"{path.name}.stage-1000.npz.new")
        probe.write_bytes(bytes(4096))
        probe.unlink()


def has_stages(path: Path) -> bool:
    """Whether a run has been saved under a name."""
    return _description(path).exists()


def load(path: Path, identity: Identity) -> RunState | None:
    """Read a checkpoint; ``None`` where there is none yet.

    Raises
    ------
    UserError
        If it is damaged, or belongs to another run.
    """
    if not _description(path).exists():
        return None
    try:
        description = json.loads(_description(path).read_text())
        found = dict(description["identity"])
        state = _state(path, description)
        other = [key for key, value in identity.items() if found.get(key) != value]
        fault = None if other else next((said for said, holds in _expectations(state, identity) if not holds), None)
    except UNREADABLE_ARRAYS as error:
        what = f"{type(error).__name__}: {error}" if isinstance(error, KeyError) else error
        raise UserError(f"checkpoint {path}: it cannot be read ({what}); delete it to start anew") from error
    if other:
        raise UserError(
            f"checkpoint {path}: it was written with {other[0]} {found.get(other[0])}, this run has "
            f"{identity[other[0]]}; use the same settings to resume, or delete it to start anew"
        )
    if fault is not None:
        raise UserError(f"checkpoint {path}: {fault}, so that no run can have written it; delete it to start anew")
    return state


def _state(path: Path, description: Mapping[str, Any]) -> RunState:
    """The run that a description and its arrays hold, whatever they hold."""
    whole = _arrays(path, description["arrays"]).read_bytes()
    if hashlib.sha256(whole).hexdigest() != description["arrays_sha256"]:
        raise ValueError("its arrays are not those that it was written with")
    with np.load(BytesIO(whole), allow_pickle=False) as arrays:
        cloud = Cloud(*(np.asarray(arrays[name], dtype=np.float64) for name in Cloud._fields))
        tuning = Tuning(arrays["shares"], arrays["scales"])
        population = Population(cloud, arrays["families"], float(description["effective_size"]), tuning)
    return RunState(
        population=population,
        tempering_parameter=float(description["tempering_parameter"]),
        log_evidence=float(description["log_evidence"]),
        log_evidence_variance=float(description["log_evidence_variance"]),
        n_solves=int(description["n_solves"]),
        facts=tuple(StageFacts(**facts) for facts in description["facts"]),
    )


def _expectations(state: RunState, identity: Identity) -> Iterator[tuple[str, bool]]:
    """What holds for every run between two stages; each is judged only where those before it hold."""
    yield "it tells of no stage", len(state.facts) > 0
    last = state.facts[-1]
    yield "its stages are not numbered", [facts.stage for facts in state.facts] == list(range(len(state.facts)))
    road = [facts.tempering_parameter for facts in state.facts]
    rising = road[0] == 0.0 and all(below < above <= 1.0 for below, above in pairwise(road))
    yield "its tempering parameter does not rise from 0 to 1", rising and road[-1] == state.tempering_parameter
    told = (last.n_solves, last.log_evidence) == (state.n_solves, state.log_evidence)
    yield "its solves or its log evidence are not those of its last stage", told
    totals = (state.log_evidence, state.log_evidence_variance, state.population.effective_size, last.elapsed_s)
    yield "one of its totals is not a number", all(np.isfinite(totals)) and min(totals[1:]) >= 0.0
    yield from _expectations_of_arrays(state.population, int(identity["n_particles"]), int(identity["n_dim"]))


def _expectations_of_arrays(population: Population, n_particles: int, n_dim: int) -> Iterator[tuple[str, bool]]:
    cloud, tuning = population.cloud, population.tuning
    n = len(cloud.points)
    yield "its points have another shape", cloud.points.shape == (n, n_dim) and n >= n_particles
    lengths = {column.shape for column in (*cloud[1:], population.families)}
    yield "its arrays differ in length", lengths == {(n,)} and population.families.dtype.kind == "i"
    yield (
        "its moves are not tuned",
        all(
            array.shape == first.shape and np.all(array >= 0.0) and np.all(np.isfinite(array))
            for array, first in zip(tuning, FIRST_TUNING, strict=True)
        ),
    )
    yield "its points lie outside the unit cube", bool(np.all((cloud.points >= 0.0) & (cloud.points <= 1.0)))
    yield "a density is NaN or infinite", not any(np.any(np.isnan(c) | (c == np.inf)) for c in cloud[1:])
    yield "no point has a likelihood", bool(np.any(np.isfinite(cloud.log_ratio)))


def _description(path: Path) -> Path:
    return path.with_name(f"{path.name}.json")


def _arrays(path: Path, name: object) -> Path:
    """The arrays that a description names: of this checkpoint and beside it, or ValueError."""
    if not isinstance(name, str) or not re.fullmatch(re.escape(path.name) + r"\.stage-\d+\.npz", name):
        raise ValueError(f"its arrays are said to be in {name!r}")
    return path.with_name(name)


def _write(path: Path, contents: bytes) -> None:
    """Replace a file by new contents, whole or not at all, even if the machine stops."""
    fresh = path.with_name(f"{path.name}.new")
    try:
        with fresh.open("wb") as file:
            file.write(contents)
            file.flush()
            os.fsync(file.fileno())
        fresh.replace(path)
    except OSError:
        with suppress(OSError):
            fresh.unlink()
        raise


def _writing(path: Path) -> AbstractContextManager[None]:
    return writing(f"checkpoint {path}", "the last stage that was written is kept; make room there")


def _named_arrays(path: Path) -> Path | None:
    """The arrays of the checkpoint as it stands; None where there is none, or none that can be read."""
    try:
        return _arrays(path, json.loads(_description(path).read_text())["arrays"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
