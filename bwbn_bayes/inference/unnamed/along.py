"""The response beside unnamed forces: linear in them about a motion, along which the law is solved in full.

A record pins down how a building moves. What a step in the parameters takes from the forces of its links along that
motion, the unnamed forces have to give back: together they go far along a ridge on which the record is explained as
well as before. A response that is linear in the parameters leaves the ridge where the law bends, and then finds the
truth hundreds of nats below an optimum that is none. Here the links are solved under the motion itself, which no force
changes, and what their forces differ by reaches the sensors as any force does. So the whole ridge is exact, and to
first order in the parameters nothing is changed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bwbn_bayes.engines.base import OBSERVED_KINDS, Engine, Response, Status, channel_map
from bwbn_bayes.inference.unnamed.first_order import FirstOrder
from bwbn_bayes.parameters import Booleans, Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure

_HEAVY = 1e9
"""Times the mass of each node, with which no force of a link moves it by more than rounding."""
_AT_ONCE, _SLOPES_AT_ONCE = 128, 16
"""Draws whose forces are held at a time, and whose slopes are."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Pinned:
    """A building whose nodes follow a motion, whatever its links do.

    Attributes
    ----------
    engine : Engine
        What solves.
    model : Structure
        With masses that no link moves.
    record : Record
        The ground's motion, and forces that pull those masses along; nothing is measured.
    """

    engine: Engine
    model: Structure
    record: Record

    @classmethod
    def along(cls, engine: Engine, model: Structure, record: Record, displacements: Floats) -> Pinned:
        """Nodes that pass through displacements ``(n_nodes, n_times)`` relative to the ground, from rest. [m].

        The second derivative of a cubic spline is straight between samples, as forces from outside are.
        """
        heavy = replace(model, masses=[_HEAVY * mass for mass in model.masses])
        spline = CubicSpline(record.times, displacements, axis=1, bc_type=("clamped", "natural"))
        total = spline(record.times, 2) + record.excitation
        pulls = {
            f"applied_force_{node}": mass * own
            for node, (mass, own) in enumerate(zip(heavy.masses, total, strict=True), 1)
        }
        bare = record.driven_by(record.excitation, pulls).with_channels({})
        return cls(engine=engine, model=heavy, record=bare)

    @property
    def _channels(self) -> tuple[str, ...]:
        return tuple(f"restoring_force_{link}" for link in range(1, self.model.n_links + 1))

    def forces(self, draws: Floats) -> Floats:
        """Of the links ``(n_draws, n_links, n_times)``; not numbers where the law could not be solved. [N]."""
        return self.engine.simulate(self.model, draws, self.record, self._channels).values

    def rates(self, draws: Floats, free: Booleans | None = None) -> tuple[Floats, Floats]:
        """Forces, and their derivatives ``(n_draws, n_parameters, n_links, n_times)``."""
        response, slopes = self.engine.sensitivities(self.model, draws, self.record, self._channels, free=free)
        return response.values, slopes


def can_be_pinned(model: Structure) -> bool:
    """Whether a building begins at rest and all that acts in it are its links and its sensors.

    What acts on a floor would pull along a mass that no link moves.
    """
    of_links = all(placed.effect.level in ("link", "observation") for placed in model.effects)
    return of_links and not model.law.initial


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """What the channels show of forces in links, to first order.

    Attributes
    ----------
    samples : (n_knots,) array
        Of the record, at which answers are known; between them a history is taken as straight.
    n_times : int
    answers : (n_links, n_knots, n_channels, n_times) array
        To a force of one at each of them. [unit of the channel per N]
    at_once : (n_channels, n_links) array
        What a force shows in the moment in which it acts, that is of all faster than the knots. [unit of the channel
        per N]
    """

    samples: NDArray[np.int64]
    n_times: int
    answers: Floats
    at_once: Floats

    @classmethod
    def of(cls, model: Structure, record: Record, samples: NDArray[np.int64], answers: Floats) -> Shown:
        """For the measured channels of a record."""
        return cls(
            samples=samples,
            n_times=record.n_times,
            answers=answers,
            at_once=_shown_at_once(model, tuple(record.channels)),
        )

    def __call__(self, forces: Floats) -> Floats:
        """Channels ``(..., n_channels, n_times)`` of forces ``(..., n_links, n_times)``. [units of the channels]."""
        at_knots = forces[..., self.samples]
        lead, (n_links, n_knots, n_channels, n_times) = forces.shape[:-2], self.answers.shape
        slow = at_knots.reshape(-1, n_links * n_knots) @ self.answers.reshape(n_links * n_knots, -1)
        fast = self.at_once @ (forces - self._straight(at_knots))
        return np.asarray(slow.reshape(*lead, n_channels, n_times) + fast)

    def _straight(self, at_knots: Floats) -> Floats:
        """Histories ``(..., n_times)`` that are straight between knots, and stay as they are after the last."""
        times = np.arange(self.n_times)
        after = np.clip(np.searchsorted(self.samples, times, side="right"), 1, len(self.samples) - 1)
        first, second = self.samples[after - 1], self.samples[after]
        share = np.clip((times - first) / (second - first), 0.0, 1.0)
        return np.asarray((1.0 - share) * at_knots[..., after - 1] + share * at_knots[..., after])


def _shown_at_once(model: Structure, channels: Sequence[str]) -> Floats:
    """What channels show of links' forces at once ``(n_channels, n_links)``: accelerations of the nodes they join."""
    n, known = model.n_links, channel_map(model, channels)
    of_nodes = np.zeros((model.n_floors, n))
    for link, joined in enumerate(model.joints):
        for node, sign in zip(joined, (1.0, -1.0), strict=True):
            if node > 0:
                of_nodes[node - 1, link] += sign / model.masses[node - 1]
    first = OBSERVED_KINDS.index("acceleration") * n
    shown = np.zeros((len(channels), n))
    for channel in range(len(channels)):
        for term in range(known.starts[channel], known.starts[channel + 1]):
            node = known.row[term] - first
            if 0 <= node < model.n_floors:
                shown[channel] += known.coefficient[term] * of_nodes[node]
    return shown


@dataclass(frozen=True, kw_only=True, eq=False)
class AlongMotion(FirstOrder):
    """The measured channels of one model under one record, the links' forces solved along a motion.

    Attributes
    ----------
    pinned : Pinned
        The building on that motion.
    forces : (n_links, n_times) array
        Its links' forces at the point about which all else is linear. [N]
    rates : (n_parameters, n_links, n_times) array
        Their derivatives there.
    shown : Shown
        What channels show of forces.
    """

    pinned: Pinned
    forces: Floats
    rates: Floats
    shown: Shown

    name = "along the motion"

    @classmethod
    def about(cls, linear: FirstOrder, pinned: Pinned, shown: Shown) -> AlongMotion:
        """With what a response to first order leaves out."""
        forces, rates = pinned.rates(linear.values[None])
        return cls(
            values=linear.values,
            response=linear.response,
            slopes=linear.slopes,
            scheme=linear.scheme,
            pinned=pinned,
            forces=forces[0],
            rates=rates[0],
            shown=shown,
        )

    def __repr__(self) -> str:
        """With all its numbers in a hash: what is kept of its answers is kept under this name."""
        digest = hashlib.sha256(b"".join(array.tobytes() for array in (self.forces, self.rates, self.shown.answers)))
        return f"AlongMotion({digest.hexdigest()}, {super().__repr__()})"

    def simulate(
        self, model: Structure, draws: Floats, record: Record, channels: Sequence[str] | None = None
    ) -> Response:
        """The measured channels; it knows of no others."""
        linear = super().simulate(model, draws, record, channels)
        for first in range(0, len(draws), _AT_ONCE):
            some = slice(first, first + _AT_ONCE)
            self._bend(linear, some, draws[some], self.pinned.forces(draws[some]))
        return linear

    def sensitivities(
        self,
        model: Structure,
        draws: Floats,
        record: Record,
        channels: Sequence[str] | None = None,
        *,
        free: Booleans | None = None,
    ) -> tuple[Response, Floats]:
        """Response and derivatives."""
        response = super().simulate(model, draws, record, channels)
        slopes = np.empty((*draws.shape, *self.response.shape))
        for first in range(0, len(draws), _SLOPES_AT_ONCE):
            some = slice(first, first + _SLOPES_AT_ONCE)
            forces, rates = self.pinned.rates(draws[some], None if free is None else free[some])
            self._bend(response, some, draws[some], forces)
            slopes[some] = self.slopes + self.shown(rates - self.rates)
        return response, slopes

    def _bend(self, linear: Response, some: slice, draws: Floats, forces: Floats) -> None:
        """Add to responses of some draws what their links' forces ``(n, n_links, n_times)`` bend."""
        beyond = forces - self.forces - np.tensordot(draws - self.values, self.rates, axes=1)
        linear.values[some] += self.shown(beyond)
        linear.status[some] = np.where(np.all(np.isfinite(forces), axis=(1, 2)), Status.OK, Status.NON_FINITE)
