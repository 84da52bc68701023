"""What is solved in one go: a record, or the step from one record of a sequence to the next; and from which state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.elements.law import DRIFT, DRIFT_RATE, FLOOR_VELOCITY
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """Samples of one time step.

    Attributes
    ----------
    record : Record
        What is measured there.
    samples : slice or None
        Where it stands in the whole record; None for the step between two records, of which nothing is asked.
    time_step : float
        [s]
    inputs : (n_times, 1 + n_forces) array
        What drives: the excitation, then the force on each forced floor. [SI]
    forced_floors : tuple of int
        Floors that these act on.
    is_carried : bool
        Whether it begins in the state in which the stretch before it ended.
    begin : float
        Time of its first sample since the start of the first stretch that leads to it. [s]
    """

    record: Record
    samples: slice | None
    time_step: float
    inputs: Floats
    forced_floors: tuple[int, ...]
    is_carried: bool
    begin: float


def stretches_of(record: Record) -> tuple[Stretch, ...]:
    """The stretches of a record, one after the other."""
    found: list[Stretch] = []
    before, begin = None, 0.0
    for part, samples in zip(record.parts, record.stretches, strict=True):
        if before is not None and record.is_sequence:
            found.append(_between(before, part, begin))
            begin += part.time_step
        else:
            begin = 0.0
        found.append(
            Stretch(
                record=part,
                samples=samples,
                time_step=part.time_step,
                inputs=np.stack([part.excitation, *part.forces.values()], axis=1),
                forced_floors=part.forced_floors,
                is_carried=bool(found) and record.is_sequence,
                begin=begin,
            )
        )
        before, begin = part, begin + part.duration
    return tuple(found)


def _between(before: Record, after: Record, begin: float) -> Stretch:
    """From the last sample of one record to the first of the next, in a straight line."""
    names = tuple(dict.fromkeys([*before.forces, *after.forces]))
    ends = [
        [part.excitation[at], *(part.forces[name][at] if name in part.forces else 0.0 for name in names)]
        for part, at in ((before, -1), (after, 0))
    ]
    return Stretch(
        record=after,
        samples=None,
        time_step=after.time_step,
        inputs=np.array(ends),
        forced_floors=tuple(int(name.rpartition("_")[2]) for name in names),
        is_carried=True,
        begin=begin,
    )


class StartingTerm(NamedTuple):
    """One term of the states before the first sample: ``state[link, row] += factor * parameter[source, column]``.

    Links and the link that a parameter is of count from 0; rows are drift, drift rate and the law's states.
    """

    link: int
    row: int
    source: int
    column: int
    factor: float


def starting_terms(model: Structure) -> tuple[StartingTerm, ...]:
    """The states before the first sample in terms of the model's parameters; none where it starts from rest.

    A link that carries no node starts with what the displacements of its ends leave it.
    """
    law = model.law
    rows = [DRIFT, DRIFT_RATE, *law.states]
    below = [model.links_below(node) for node in range(model.n_floors + 1)]
    terms: list[StartingTerm] = []
    for state, parameter in law.initial:
        row, column = rows.index(state), law.symbols.index(parameter)
        is_of_nodes = state in (DRIFT, DRIFT_RATE)
        terms += [StartingTerm(i, row, i, column, 1.0) for i in range(model.n_floors if is_of_nodes else model.n_links)]
        if not is_of_nodes:
            continue
        for link in range(model.n_floors, 0 if model.is_driven else model.n_links):
            lower, upper = model.joints[link]
            terms += [StartingTerm(link, row, one - 1, column, 1.0) for one in below[upper]]
            terms += [StartingTerm(link, row, one - 1, column, -1.0) for one in below[lower]]
        if state == DRIFT_RATE and FLOOR_VELOCITY in law.states:
            velocity = rows.index(FLOOR_VELOCITY)
            for floor in range(model.n_floors):
                terms += [StartingTerm(floor, velocity, one - 1, column, 1.0) for one in below[floor + 1]]
    return tuple(terms)


def event_columns(model: Structure) -> NDArray[np.int64]:
    """Columns of the law's parameters that are times of events, which count from the start."""
    return np.array(sorted(set(model.law.event_parameters)), dtype=np.int64)
