"""Saving a run after each stage, so that a run cut short goes on to the same result, bit for bit.

A checkpoint ``NAME`` is a description ``NAME.json`` (stage, history, what must match) and the arrays it names,
``NAME.stage-K.npz``. The description is replaced last and in one operation: a run killed at any moment leaves a
whole checkpoint behind.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np

from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.tmcmc.moves import Tuning
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
    path.parent.mkdir(parents=True, exist_ok=True)
    before = _named_arrays(path)
    arrays = path.with_name(f"{path.name}.stage-{state.facts[-1].stage}.npz")
    population = state.population
    with arrays.open("wb") as stream:
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
        "effective_size": population.effective_size,
        "tempering_parameter": state.tempering_parameter,
        "log_evidence": state.log_evidence,
        "log_evidence_variance": state.log_evidence_variance,
        "n_solves": state.n_solves,
        "facts": [asdict(facts) for facts in state.facts],
    }
    fresh = _description(path).with_suffix(".json.new")
    fresh.write_text(json.dumps(description, indent=1))
    fresh.replace(_description(path))
    if before is not None and before != arrays:
        before.unlink(missing_ok=True)


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
        with _arrays(path, description["arrays"]).open("rb") as stream, np.load(stream) as arrays:
            cloud = Cloud(*(arrays[name] for name in Cloud._fields))
            tuning = Tuning(arrays["shares"], arrays["scales"])
            population = Population(cloud, arrays["families"], description["effective_size"], tuning)
        found = description["identity"]
        state = RunState(
            population=population,
            tempering_parameter=description["tempering_parameter"],
            log_evidence=description["log_evidence"],
            log_evidence_variance=description["log_evidence_variance"],
            n_solves=description["n_solves"],
            facts=tuple(StageFacts(**facts) for facts in description["facts"]),
        )
    except (OSError, ValueError, KeyError, TypeError, BadZipFile) as error:
        raise UserError(f"checkpoint {path}: it cannot be read ({error}); delete it to start anew") from error
    for key, value in identity.items():
        if found.get(key) != value:
            raise UserError(
                f"checkpoint {path}: it was written with {key} {found.get(key)}, this run has {value}; "
                "use the same settings to resume, or delete it to start anew"
            )
    return state


def _description(path: Path) -> Path:
    return path.with_name(f"{path.name}.json")


def _arrays(path: Path, name: object) -> Path:
    """The arrays that a description names: of this checkpoint and beside it, or ValueError."""
    if not isinstance(name, str) or not re.fullmatch(re.escape(path.name) + r"\.stage-\d+\.npz", name):
        raise ValueError(f"its arrays are said to be in {name!r}")
    return path.with_name(name)


def _named_arrays(path: Path) -> Path | None:
    """The arrays of the checkpoint as it stands; None where there is none, or none that can be read."""
    try:
        return _arrays(path, json.loads(_description(path).read_text())["arrays"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
