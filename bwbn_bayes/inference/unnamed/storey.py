"""The unnamed force of a building: in a storey, or in all of them, a smooth force of its states that no law is.

A Gaussian process over histories of force, of one of four kinds. Of the storey's own states: two forces at two moments
are alike where hysteretic displacement and direction, drift, drift rate and the work done by then are. Linear in these
states, with factors that change in time. Linear in the drifts of the other storeys. Or all of this, with a part that
forgets itself within a quarter of a cycle: what no law of few parameters holds. What the sensors show of a force
follows to first order (:mod:`~bwbn_bayes.inference.unnamed.pulses`), so that its evidence is a closed form: nothing is
fitted for it, whatever functions it is made of. The scale is integrated out, and so is the
kind.

References
----------
.. [1] M. C. Kennedy and A. O'Hagan, "Bayesian calibration of computer models", J. R. Statist. Soc. B 63(3), 2001,
   doi:10.1111/1467-9868.00294.
.. [2] C. E. Rasmussen and C. K. I. Williams, "Gaussian Processes for Machine Learning", MIT Press, 2006, ch. 2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import eigh
from scipy.special import logsumexp

from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.slopes import Slopes
from bwbn_bayes.inference.summary import observe
from bwbn_bayes.inference.unnamed import N_KINDS
from bwbn_bayes.inference.unnamed.pulses import Knots, answers, knots_of
from bwbn_bayes.inference.unnamed.sums import Sums
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.cycles import path_of
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure

_LENGTHS = (0.5, 0.15)
"""Over which a force of the states changes, each over its largest; of hysteretic displacement also within a pinch."""
_OF_WORK, _OF_TIME = 1.0, (0.3, 0.1)
"""Of the work done, and of the record's duration, over which it changes: as slowly as damage, or within few cycles."""
_TURNED = 0.1
"""Of the largest drift rate: where a direction has turned."""
_FORGOTTEN, _SOON = 0.5, 0.02
"""Path, of the largest drift, and time, of the duration, within which a departure that no law has is forgotten."""
_MOST_FUNCTIONS, _FEWEST_FUNCTIONS, _NEGLIGIBLE = 120, 6, 1e-4
"""Eigenfunctions of a process that are kept, and the variance below which one is not, over the largest."""
_ROUNDING = 1e-10
"""The same of a process of which nothing is left out."""
_MOST_NUMBERS = 2e7
"""In the answers to the functions of all storeys, which tall buildings and long records share: memory bounds them."""
_SETTLED = 1e-2
"""Relative change of the gain below which a force is followed no further."""
_SMALL, _INEXACT = 20.0, 0.1
"""Gain up to which the first order is enough [nat], and by what share it may be wrong of a larger one."""
_N_FOLLOWED, _WAYS = 4, (1.0, 0.5, 0.2)
"""Turns in which a force is followed, and shares of the way to it that are tried."""
_EDGE = 1e-3
"""Of the unit cube, that parameters keep from its sides."""
ANY_KIND = "of no simple kind"
"""Of a force: all that the others are, and a part that no law holds."""
_KINDS = ("drift", "drift_rate", "hysteretic_displacement", "hysteretic_energy")


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """An unnamed force, given what a model leaves.

    Attributes
    ----------
    gain : float
        Log Bayes factor of the model with it over that without. [nat]
    kind : str
        What it is a function of, in words.
    forces : mapping of int to (n_knots,) array
        Its expectation in each of its storeys, at :func:`~bwbn_bayes.inference.unnamed.pulses.knots_of` the record. [N]
    point : (n_dim,) array
        The model's parameters beside it, in the unit cube.
    """

    gain: float
    kind: str
    forces: Mapping[int, Floats]
    point: Floats

    def beside(self, posterior: Posterior) -> tuple[Posterior, Floats]:
        """A model's posterior with the forces acting, and the parameters ``(n_dim,)`` that go with them."""
        return acting(posterior, self.forces), self.point


def unnamed_forces(
    posterior: Posterior, point: Floats, share: float, *, matters: float = 0.0
) -> dict[tuple[int, ...], Estimate]:
    """Unnamed forces beside a model: in each of its storeys, and in all of them.

    The one that gains most is followed where it leads, if it is not small and could matter: the response is made
    linear again about what is expected of parameters and force.

    Parameters
    ----------
    posterior : Posterior
        Of the model, under its own account of the errors.
    point : (n_dim,) array
        Its fit, in the unit cube.
    share : float
        Standard deviation of the scale's half-normal prior, over the largest force of each storey.
    matters : float
        Gain from which the model with it is as good as others. [nat]
    """
    start = Neighbourhood(posterior=posterior, point=point, share=share)
    found = {place: start.estimate(place, start.alone) for place in places_of(posterior.model.n_links)}
    best = max(found, key=lambda place: found[place].gain)
    if found[best].gain > max(_SMALL, (1.0 - _INEXACT) * matters):
        found[best] = _followed(start, found[best], best)
    return found


def _followed(start: Neighbourhood, found: Estimate, place: tuple[int, ...]) -> Estimate:
    """The estimate about what it expects itself, in turns; by a part of the way where the whole way fits no better."""
    here = start
    for _ in range(_N_FOLLOWED):
        ways = (here.towards(found, share) for share in _WAYS)
        there = next((one for one in ways if one.log_likelihood > here.log_likelihood), None)
        if there is None:
            break
        here, before, found = there, found, there.estimate(place, start.alone)
        if abs(found.gain - before.gain) < _SETTLED * before.gain:
            break
    return found


def places_of(n_storeys: int) -> tuple[tuple[int, ...], ...]:
    """Where an unnamed force may act: in one storey, or in all."""
    every = tuple(range(1, n_storeys + 1))
    return (*((storey,) for storey in every), *([every] if n_storeys > 1 else []))


def over_time(force: Floats, record: Record, model: Structure) -> Floats:
    """A force's history at every sample ``(n_times,)``, from that at knots."""
    knots = knots_of(record, model)
    of_runs = [
        np.interp(run.times, knots.times[knots.runs == number], force[knots.runs == number])
        for number, (run, _) in enumerate(record.runs)
    ]
    return np.concatenate(of_runs)


def pulled(record: Record, model: Structure, forces: Mapping[int, Floats]) -> Record:
    """The record with forces of storeys ``(n_times,)`` acting on the floors that these join."""
    on_floors = dict(record.forces)
    for storey, pull in forces.items():
        for floor, own in zip(model.joints[storey - 1], (pull, -pull), strict=True):
            if floor > 0:
                name = f"applied_force_{floor}"
                on_floors[name] = on_floors.get(name, np.zeros(record.n_times)) + own
    return record.driven_by(record.excitation, on_floors)


def acting(posterior: Posterior, forces: Mapping[int, Floats]) -> Posterior:
    """The posterior with forces of storeys ``(n_knots,)`` acting on the floors that these join."""
    record, model = posterior.record, posterior.model
    histories = {storey: over_time(force, record, model) for storey, force in forces.items()}
    return replace(posterior, record=pulled(record, model, histories))


def functions(states: Mapping[str, Floats], knots: Knots, place: int, most: int = _MOST_FUNCTIONS) -> dict[str, Floats]:
    """Functions ``(n_functions, n_knots)`` of a force of each kind, whose variance is one on the average over time.

    Where several records find the structure virgin, a force of its states is the same function in all of them; what
    changes in time or is forgotten is not.

    Parameters
    ----------
    states : mapping of str to (n_storeys, n_knots) array
        Histories by kind of state.
    knots : Knots
        Where they stand in time.
    place : int
        Of the storey among them.
    most : int
        Functions of each kind.
    """
    kinds = _covariances(states, knots, place)
    return {kind: _eigenfunctions(parts, most) for kind, parts in kinds.items() if parts}


def whole_process(states: Mapping[str, Floats], knots: Knots, place: int, most: int) -> Floats:
    """All functions ``(n_functions, n_knots)`` of a force of any kind, up to so many; see :func:`functions`.

    What 120 of them leave out is two per cent of its variance, a force as large as noise at 30 dB, and jumps as of a
    play are not among them: parameters would have to make up for it.
    """
    return _eigenfunctions(_covariances(states, knots, place)[ANY_KIND], most, _ROUNDING)


def _covariances(states: Mapping[str, Floats], knots: Knots, place: int) -> dict[str, list[Floats]]:
    """Covariances ``(n_knots, n_knots)`` of the parts of each kind of force."""
    every = {kind: own / np.maximum(np.max(np.abs(own), axis=1, keepdims=True), 1e-300) for kind, own in states.items()}
    drift, rate, z, work = (every[kind][place] for kind in _KINDS)
    time = knots.times / np.max(knots.times)
    in_one_run = np.equal.outer(knots.runs, knots.runs)
    path = path_of(drift)
    (long, short), worn = _LENGTHS, _alike(work, _OF_WORK)
    turned = _alike(np.tanh(rate / _TURNED), 1.0) * worn
    of_states = [
        *(_alike(z, length) * turned for length in (long, short)),
        *(_alike(own, long) * worn for own in (drift, rate)),
    ]
    in_time = sum(np.outer(own, own) for own in (drift, rate, z)) * in_one_run
    in_time *= np.mean([_alike(time, length) for length in _OF_TIME], axis=0)
    others = [own for kind in _KINDS[:2] for i, own in enumerate(every[kind]) if i != place]
    of_others = [np.transpose(others) @ np.array(others)] if others else []
    fleeting = np.exp(-np.abs(path[:, None] - path) / _FORGOTTEN) * _alike(time, _SOON) * in_one_run
    return {
        "of the storey's own states": of_states,
        "that changes in time": [in_time],
        "of the other storeys' motion": of_others,
        ANY_KIND: [*of_states, in_time, *of_others, fleeting],
    }


def _eigenfunctions(parts: Sequence[Floats], most: int, negligible: float = _NEGLIGIBLE) -> Floats:
    """Of the covariance ``(n_knots, n_knots)`` in which each part has the same share of the variance."""
    covariance = np.mean([part / max(float(np.mean(np.diag(part))), 1e-300) for part in parts], axis=0)
    n = len(covariance)
    if most < n:
        variance, turned = eigh(covariance, subset_by_index=[n - most, n - 1], driver="evr")
    else:  # a third of the time where all of them are wanted
        variance, turned = eigh(covariance, driver="evd")
    kept = np.flatnonzero(variance > negligible * variance[-1])
    return np.asarray((turned[:, kept] * np.sqrt(np.maximum(variance[kept], 0.0))).T)


def _alike(state: Floats, length: float) -> Floats:
    """Squared exponential covariance ``(n, n)`` over a state ``(n,)``."""
    return np.asarray(np.exp(-0.5 * np.square((state[:, None] - state) / length)))


@dataclass(frozen=True, kw_only=True)
class Neighbourhood:
    """The response of a model and of forces beside it, linear about some of both.

    Parameters
    ----------
    posterior : Posterior
        Of the model.
    point : (n_dim,) array
        Its parameters, in the unit cube.
    forces : mapping of int to (n_knots,) array
        By storey. [N]
    share : float
        Standard deviation of the scale's half-normal prior, over the largest force of each storey.
    """

    posterior: Posterior
    point: Floats
    share: float
    forces: Mapping[int, Floats] = field(default_factory=dict)

    @cached_property
    def view(self) -> Posterior:
        """The posterior with the forces acting."""
        return acting(self.posterior, self.forces)

    @cached_property
    def log_likelihood(self) -> float:
        """Of the parameters and the forces."""
        return float(self.view.log_likelihood(self.point[None])[0])

    @cached_property
    def rows(self) -> dict[str, Floats]:
        """Histories ``(n_storeys, n_times)`` by kind."""
        values, _ = self.view.split(self.point[None])
        rows = observe(self.view.engine, self.view.model, values, self.view.record)
        return {kind: own[0] for kind, own in rows.items()}

    @cached_property
    def slopes(self) -> Slopes:
        """By the parameters."""
        return Slopes.at(self.view, self.point)

    @property
    def most_functions(self) -> int:
        """Of each kind in each storey, that memory has room for."""
        return min(self._room, _MOST_FUNCTIONS)

    @property
    def _room(self) -> int:
        record, model = self.view.record, self.view.model
        shared = _MOST_NUMBERS / (model.n_links * len(record.channels) * record.n_times)
        return max(int(shared), _FEWEST_FUNCTIONS)

    @cached_property
    def largest(self) -> Floats:
        """Of the force in each storey [N], ``(n_storeys,)``."""
        return np.asarray(np.max(np.abs(self.rows["restoring_force"]), axis=1))

    def functions_in(self, storey: int) -> dict[str, Floats]:
        """Those of :func:`functions` at the present states, ``(n_functions, n_knots)`` by kind."""
        return functions(*self._at_knots, storey - 1, self.most_functions)

    def whole_process_in(self, storey: int) -> Floats:
        """That of :func:`whole_process` at the present states, ``(n_functions, n_knots)``."""
        return whole_process(*self._at_knots, storey - 1, self._room)

    @cached_property
    def _at_knots(self) -> tuple[dict[str, Floats], Knots]:
        """Histories of the present states, and where in time they are told."""
        knots = knots_of(self.view.record, self.view.model)
        return {kind: self.rows[kind][:, knots.samples] for kind in _KINDS}, knots

    @cached_property
    def _processes(self) -> dict[str, dict[int, tuple[Floats, Floats]]]:
        """By kind and storey: histories of the force, each times its weight's sd; answers to them and to the force."""
        found: dict[str, dict[int, tuple[Floats, Floats]]] = {}
        for storey in self.forces or range(1, self.view.model.n_links + 1):
            largest = float(self.largest[storey - 1])
            own = {kind: self.share * largest * one for kind, one in self.functions_in(storey).items()}
            n_knots = next(iter(own.values())).shape[1]
            histories = np.vstack([*own.values(), self.forces.get(storey, np.zeros(n_knots))])
            shown = self.slopes.scaled(answers(self.view, self.point, storey, histories, largest))
            *answered, to_present = np.split(shown, np.cumsum([len(one) for one in own.values()]))
            for (kind, one), answer in zip(own.items(), answered, strict=True):
                found.setdefault(kind, {})[storey] = one, np.concatenate([answer, to_present])
        return found

    @cached_property
    def alone(self) -> float:
        """Log evidence of the model without a force, but for a constant."""
        return self._sums([]).alone

    def _sums(self, answered: Sequence[Floats]) -> Sums:
        residual = self.slopes.residual
        answers = np.concatenate([residual[:0].reshape(0, *residual.shape), *(own[:-1] for own in answered)])
        unforced = residual + sum(own[-1] for own in answered)
        noise, base = self.view.noise, self.slopes.base.T
        return Sums.of(self.slopes, noise, base, answers, unforced=unforced, present=np.zeros(len(answers)))

    def estimate(self, place: tuple[int, ...], alone: float) -> Estimate:
        """Of forces in some storeys, independent of each other and of one scale; their kind is integrated out.

        Parameters
        ----------
        place : tuple of int
            The storeys, all of those that have a force here.
        alone : float
            Log evidence of the model without a force.
        """
        every = [
            self._of_kind(kind, {storey: own[storey] for storey in place}, alone)
            for kind, own in self._processes.items()
        ]
        gain = float(logsumexp([one.gain for one in every]) - np.log(N_KINDS))
        return replace(max(every, key=lambda one: one.gain), gain=gain)

    def _of_kind(self, kind: str, processes: Mapping[int, tuple[Floats, Floats]], alone: float) -> Estimate:
        sums = self._sums([answered for _, answered in processes.values()])
        log_evidence, step, weights, _ = sums.settled()
        ends = np.cumsum([len(histories) for histories, _ in processes.values()])[:-1]
        return Estimate(
            gain=log_evidence - alone,
            kind=kind,
            forces={
                storey: own @ histories
                for (storey, (histories, _)), own in zip(processes.items(), np.split(weights, ends), strict=True)
            },
            point=np.clip(self.point + step, _EDGE, 1.0 - _EDGE),
        )

    def towards(self, found: Estimate, share: float) -> Neighbourhood:
        """About what lies a share of the way to an estimate."""
        return replace(
            self,
            point=self.point + share * (found.point - self.point),
            forces={at: (1.0 - share) * self.forces.get(at, 0.0) + share * own for at, own in found.forces.items()},
        )
