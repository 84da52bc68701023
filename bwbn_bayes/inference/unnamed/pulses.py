"""How a record answers to forces in a storey, whatever their history, to first order.

A short force at one moment changes the response a little. Its answers at many moments, one after the other, are the
columns of a matrix that turns any history of the force into what the sensors show of it: the equation of motion,
linearised about the present fit, with the storey's own law in it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple, override

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from bwbn_bayes.elements.law import AddedState, Effect, Slots, symbol
from bwbn_bayes.inference.accuracy import in_doubles
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.parameters import Floats, Normal, Parameter, Uniform, Value
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.parts import PlacedEffect
from bwbn_bayes.structures.structure import Structure

_MOST_KNOTS, _MOST_PULSES = 500, 4000
"""Moments at which pulses stand in a storey, and pulses in all, at most: they overlap, so that between two moments a
history is a straight line."""
_NEAR = 1e-5
"""A pulse over the storey's largest force."""
_MOST_NUMBERS = 2e7
"""Numbers of a response that are held at a time."""
_SOURCE = "first-order response to a triangular pulse"
_CLOCK = symbol("pulse_clock")
_FORCE, _TIME, _WIDTH = (
    Parameter(symbol=name, unit=unit, neutral=neutral, description=text, source=_SOURCE)
    for name, unit, neutral, text in (
        ("pulse_force", "N", 0.0, "largest force of a pulse"),
        ("pulse_time", "s", 0.0, "moment of a pulse"),
        ("pulse_width", "s", 1.0, "half of a pulse's duration"),
    )
)


@dataclass(frozen=True, kw_only=True)
class Pulse(Effect):
    """``F + pulse_force max(0, 1 - |t - pulse_time| / pulse_width)``.

    Parameters
    ----------
    width : float
        Half of its duration. [s]
    """

    width: float = 1.0

    name: ClassVar[str] = "pulse"
    summary: ClassVar[str] = "a short force at one moment"
    source: ClassVar[str] = _SOURCE
    residual: ClassVar[str] = "an answer to a blow"
    confusable: ClassVar[str] = "nothing"
    parameters: ClassVar[tuple[Parameter, ...]] = (_FORCE, _TIME, _WIDTH)

    @property
    @override
    def values(self) -> Mapping[str, Value]:
        free = {_FORCE.symbol: Normal(0.0, 1.0), _TIME.symbol: Uniform(0.0, 1.0)}
        return {**free, _WIDTH.symbol: self.width}

    @override
    def fill(self, slots: Slots) -> Slots:
        force, time, width = (symbol(p.symbol) for p in self.parameters)
        pulse = force * sp.Max(0, 1 - sp.Abs(_CLOCK - time) / width)
        clock = AddedState(state=_CLOCK, rate=sp.Integer(1))
        return replace(slots, added_force=slots.added_force + pulse, added_states=(*slots.added_states, clock))


class Knots(NamedTuple):
    """Moments at which pulses stand, ``(n_knots,)`` each."""

    samples: NDArray[np.int64]
    """Of the record."""
    times: Floats
    """Since the structure was virgin, or as the model has it at the start. [s]"""
    runs: NDArray[np.int64]
    """Position among :attr:`Record.runs`."""


class _Stretch(NamedTuple):
    """Knots of one record of those that a run joins."""

    run: int
    samples: NDArray[np.int64]
    times: Floats
    width: float


def _stretches(record: Record, model: Structure) -> list[_Stretch]:
    step = int(np.ceil(record.n_times / min(_MOST_KNOTS, _MOST_PULSES // model.n_links)))
    found = []
    for number, (run, place) in enumerate(record.runs):
        for part, stretch in zip(run.parts, run.stretches, strict=True):
            own = np.arange(stretch.start, stretch.stop, step)
            found.append(_Stretch(number, place.start + own, run.times[own], step * part.time_step))
    return found


def knots_of(record: Record, model: Structure) -> Knots:
    """Where pulses stand, from the first sample of each record on; in tall buildings they are fewer in each storey."""
    own = _stretches(record, model)
    return Knots(
        samples=np.concatenate([one.samples for one in own]),
        times=np.concatenate([one.times for one in own]),
        runs=np.concatenate([np.full(len(one.samples), one.run) for one in own]),
    )


def answers(
    posterior: Posterior,
    point: Floats,
    storey: int,
    histories: Floats,
    largest: float,
) -> Floats:
    """What channels show of forces in a storey, to first order.

    Parameters
    ----------
    posterior : Posterior
        Of the present model.
    point : (n_dim,) array
        Its fit, in the unit cube.
    storey : int
        From 1.
    histories : (n_histories, n_knots) array
        Of each force, at :func:`knots_of` the record and model. [N]
    largest : float
        The storey's largest force. [N]

    Returns
    -------
    (n_histories, n_channels, n_times) array
        [units of the channels]
    """
    posterior, record = in_doubles(posterior), posterior.record
    names = list(record.channels)
    result = np.zeros((len(histories), len(names), record.n_times))
    begun = 0
    for stretch in _stretches(record, posterior.model):
        run, place = record.runs[stretch.run]
        own = histories[:, begun : begun + len(stretch.samples)]
        begun += len(stretch.samples)
        if not run.channels:
            continue
        shown, done = result[:, [names.index(name) for name in run.channels], place], 0
        model = with_pulse(posterior.model, storey, stretch.width)
        for rows in _pulses(replace(posterior, record=run), model, point, stretch.times, _NEAR * largest):
            shown += np.tensordot(own[:, done : done + len(rows)], rows, axes=1)
            done += len(rows)
        result[:, [names.index(name) for name in run.channels], place] = shown
    return result


def _pulses(posterior: Posterior, model: Structure, point: Floats, times: Floats, size: float) -> Iterator[Floats]:
    """Answers ``(n, n_channels, n_times)`` to unit pulses at some times, so many at a time."""
    record, base = posterior.record, posterior.model
    (values,), _ = posterior.split(point[None])
    known = dict(zip(base.space.names, values, strict=True))
    rows = np.array([[known.get(name, 0.0) for name in model.space.names]])
    symbols = [p.symbol for p in model.space.parameters]
    force, moment = symbols.index(_FORCE.symbol), symbols.index(_TIME.symbol)
    at_rest = posterior.engine.simulate(model, rows, record).values
    n_at_once = max(int(_MOST_NUMBERS / (len(record.channels) * record.n_times)), 16)
    for first in range(0, len(times), n_at_once):
        some = times[first : first + n_at_once]
        draws = np.repeat(rows, len(some), axis=0)
        draws[:, force], draws[:, moment] = size, some
        yield (posterior.engine.simulate(model, draws, record).values - at_rest) / size


def with_pulse(base: Structure, storey: int, width: float) -> Structure:
    """The model with a pulse in a storey, and nothing else that it does not need: it is solved a thousand times."""
    placed = PlacedEffect(effect=Pulse(width=width), storeys=(storey,))
    return replace(base, carried=(), effects=(*base.effects, placed))
