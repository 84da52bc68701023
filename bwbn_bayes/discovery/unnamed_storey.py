"""The unnamed force of a building: in a storey, or in all of them, a smooth force of its states that no law is.

A Gaussian process over histories of force. Two forces at two moments are alike where the storey's states are: its
hysteretic displacement and direction, its drift, its drift rate, and the work done by then; further parts are linear in
these states with factors that change in time, and in the drifts of the other storeys. What the sensors show of it
follows to first order (:mod:`~bwbn_bayes.discovery.pulses`), so that its evidence is a closed form: no law is compiled
for it and nothing is fitted, whatever functions it is made of. One part forgets itself within a quarter of a cycle:
what no law of few parameters holds. The scale of the whole is integrated out.

References
----------
.. [1] M. C. Kennedy and A. O'Hagan, "Bayesian calibration of computer models", J. R. Statist. Soc. B 63(3), 2001,
   doi:10.1111/1467-9868.00294.
.. [2] C. E. Rasmussen and C. K. I. Williams, "Gaussian Processes for Machine Learning", MIT Press, 2006, ch. 2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from bwbn_bayes.discovery.pulses import answers, knots_of
from bwbn_bayes.discovery.score import Slopes
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.inference.identifiability import PRIOR_PRECISION
from bwbn_bayes.inference.likelihood import IntegratedNoise, Posterior
from bwbn_bayes.inference.residuals import noise_floors
from bwbn_bayes.inference.summary import observe
from bwbn_bayes.parameters import Floats

_RELATIVE_SCALES = np.geomspace(1e-2, 6.0, 97)
"""Scales of the force over the standard deviation of their half-normal prior, over which it is integrated."""
_DENSITY = np.sqrt(2.0 / np.pi) * np.exp(-0.5 * np.square(_RELATIVE_SCALES)) * np.gradient(_RELATIVE_SCALES)
_LENGTHS = (0.5, 0.15)
"""Over which a force of the states changes, each over its largest; of hysteretic displacement also within a pinch."""
_OF_WORK, _OF_TIME = 1.0, 0.3
"""Of the work done, and of the record's duration, over which it changes."""
_TURNED = 0.1
"""Of the largest drift rate: where a direction has turned."""
_FORGOTTEN, _SOON = 0.5, 0.02
"""Path, of the largest drift, and time, of the duration, within which a departure that no law has is forgotten."""
_MOST_FUNCTIONS, _NEGLIGIBLE = 120, 1e-4
"""Eigenfunctions of the process that are kept, and the variance below which one is not, over the largest."""
_N_TURNS, _SETTLED = 8, 1e-2
"""In which the noise level and the force's scale find each other, and the relative change of the level that ends it."""
_MUCH = 1.5
"""Times the noise's power that a model takes for noise, from which a second start is worth its time."""
_KINDS = ("drift", "drift_rate", "hysteretic_displacement", "hysteretic_energy")


@dataclass(frozen=True, kw_only=True)
class Process:
    """Functions of which a storey's force is a sum with independent normal weights.

    Attributes
    ----------
    histories : (n_functions, n_knots) array
        Each times the standard deviation of its weight. [N]
    answers : (n_functions, n_channels, n_counted) array
        What the sensors show of them, whitened, over the noise.
    """

    histories: Floats
    answers: Floats


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """An unnamed force, given what a model leaves.

    Attributes
    ----------
    gain : float
        Log Bayes factor of the model with it over that without. [nat]
    forces : mapping of int to (n_knots,) array
        Its expectation at each of its storeys, at :func:`~bwbn_bayes.discovery.pulses.knots_of` the record. [N]
    """

    gain: float
    forces: Mapping[int, Floats]


def unnamed_forces(
    posterior: Posterior, point: Floats, share: float, carried: tuple[Effect, ...] = ()
) -> dict[tuple[int, ...], Estimate]:
    """Unnamed forces beside a model: in each of its storeys, and in all of them.

    Parameters
    ----------
    posterior : Posterior
        Of the model, under its own account of the errors.
    point : (n_dim,) array
        Its fit, in the unit cube.
    share : float
        Standard deviation of the scale's half-normal prior, over the largest force of each storey.
    carried : tuple of Effect
        Others that share the compiled law.
    """
    record, slopes = posterior.record, Slopes.at(posterior, point)
    values, _ = posterior.split(point[None])
    rows = observe(posterior.engine, posterior.model, values, record)
    states = {kind: rows[kind][0][:, knots_of(record)] for kind in _KINDS}
    predicted = posterior.engine.simulate(posterior.model, values, record).values[0]
    processes = {}
    for storey in range(1, posterior.model.n_links + 1):
        largest = float(np.max(np.abs(rows["restoring_force"][0, storey - 1])))
        histories = share * largest * functions(states, storey - 1)
        shown = answers(posterior, point, storey, histories, largest, carried)
        processes[storey] = Process(histories=histories, answers=slopes.scaled(shown))
    residual = slopes.scaled(record.measured - predicted)
    return {
        place: _estimate(posterior, slopes, residual, {storey: processes[storey] for storey in place})
        for place in places_of(posterior.model.n_links)
    }


def places_of(n_storeys: int) -> tuple[tuple[int, ...], ...]:
    """Where an unnamed force may act: in one storey, or in all."""
    every = tuple(range(1, n_storeys + 1))
    return (*((storey,) for storey in every), *([every] if n_storeys > 1 else []))


def functions(states: Mapping[str, Floats], place: int) -> Floats:
    """Functions ``(n_functions, n_knots)`` of a force whose variance is one on the average over the record.

    Parameters
    ----------
    states : mapping of str to (n_storeys, n_knots) array
        Histories by kind.
    place : int
        Of the storey among them.
    """
    every = {kind: own / np.maximum(np.max(np.abs(own), axis=1, keepdims=True), 1e-300) for kind, own in states.items()}
    drift, rate, z, work = (every[kind][place] for kind in _KINDS)
    time = np.linspace(0.0, 1.0, len(drift))
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(drift)))])
    (long, short), worn = _LENGTHS, _alike(work, _OF_WORK)
    turned = _alike(np.tanh(rate / _TURNED), 1.0) * worn
    linear = sum(np.outer(own, own) for own in (drift, rate, z))
    others = [own for kind in _KINDS[:2] for i, own in enumerate(every[kind]) if i != place]
    parts = [
        *(_alike(z, length) * turned for length in (long, short)),
        *(_alike(own, long) * worn for own in (drift, rate)),
        linear * _alike(time, _OF_TIME),
        *([np.transpose(others) @ np.array(others)] if others else []),
        np.exp(-np.abs(path[:, None] - path) / _FORGOTTEN) * _alike(time, _SOON),
    ]
    covariance = sum(part / max(float(np.mean(np.diag(part))), 1e-300) for part in parts) / len(parts)
    variance, turned_to = np.linalg.eigh(covariance)
    kept = np.flatnonzero(variance > _NEGLIGIBLE * variance[-1])[-_MOST_FUNCTIONS:]
    return np.asarray((turned_to[:, kept] * np.sqrt(variance[kept])).T)


def _alike(state: Floats, length: float) -> Floats:
    """Squared exponential covariance ``(n, n)`` over a state ``(n,)``."""
    return np.asarray(np.exp(-0.5 * np.square((state[:, None] - state) / length)))


def _estimate(posterior: Posterior, slopes: Slopes, residual: Floats, processes: Mapping[int, Process]) -> Estimate:
    """Of forces that are independent of each other, of one scale."""
    noise, (n_channels, n_counted) = posterior.noise, residual.shape
    assert isinstance(noise, IntegratedNoise)
    base = slopes.base.T.reshape(-1, n_channels, n_counted)
    columns = np.concatenate([base, *(own.answers for own in processes.values()), residual[None]])
    products = np.array([own @ own.T for own in np.moveaxis(columns, 1, 0)])
    level = slopes.noise[:, 0]
    sums = Sums(products=products, n_base=len(base), n_counted=n_counted, noise=noise, level=level)
    # A model that lacks much takes it for noise: begin there, and where the noise is by itself.
    by_itself = np.square(level / np.maximum(noise_floors(posterior.record), 1e-300))
    starts = [np.ones(n_channels), *([by_itself] if np.any(by_itself > _MUCH) else [])]
    gain, weights = max((sums.settled(start) for start in starts), key=lambda pair: pair[0])
    ends = np.cumsum([len(own.histories) for own in processes.values()])[:-1]
    own_weights = np.split(weights, ends)
    return Estimate(
        gain=gain,
        forces={at: own @ one.histories for (at, one), own in zip(processes.items(), own_weights, strict=True)},
    )


@dataclass(frozen=True, kw_only=True)
class Sums:
    """A linear model's products: its slopes, the answers to a force and the residual, with each other, by channel.

    Attributes
    ----------
    products : (n_channels, n, n) array
        Of slopes, then answers, then the residual, over the noise.
    n_base : int
        Slopes among them.
    n_counted : int
        Samples of each channel.
    noise : IntegratedNoise
    level : (n_channels,) array
        Noise standard deviation of the model without the force, over which the products are.
    """

    products: Floats
    n_base: int
    n_counted: int
    noise: IntegratedNoise
    level: Floats

    def settled(self, precision: Floats) -> tuple[float, Floats]:
        """The log Bayes factor of the force, and what its weights are expected to be.

        With the force the noise may be smaller: its level and the force's scale are looked for in turns.

        Parameters
        ----------
        precision : (n_channels,) array
            Where that begins, over that without the force.
        """
        as_without = np.ones(len(precision))
        alone, _ = self._without(as_without)
        best, weights = -np.inf, np.zeros(self.products.shape[1] - self.n_base - 1)
        for _ in range(_N_TURNS):
            plain, left = self._without(precision)
            information, turned = np.linalg.eigh(left[:-1, :-1])
            information, slope = np.maximum(information, 0.0), left[:-1, -1] @ turned
            variance = np.square(_RELATIVE_SCALES)[:, None]
            spread = 1.0 + variance * information
            by_scale = 0.5 * np.sum(variance * np.square(slope) / spread - np.log(spread), axis=1)
            gain = plain - alone + float(logsumexp(by_scale, b=_DENSITY))
            at = int(np.argmax(by_scale + np.log(_DENSITY)))
            mean = turned @ (variance[at, 0] * slope / spread[at])
            if gain > best:
                best, weights = gain, mean
            wanted = self._precision(precision, mean, float(variance[at, 0]))
            if np.all(np.abs(np.log(wanted / precision)) < _SETTLED):
                break
            precision = wanted
        return best, weights

    def _without(self, precision: Floats) -> tuple[float, Floats]:
        """Log evidence without the force, but for a constant, and the products with the slopes projected out."""
        n, whole = self.n_base, np.tensordot(precision, self.products, axes=1)
        others = whole[:n, :n] + PRIOR_PRECISION * np.eye(n)
        left = whole[n:, n:] - whole[n:, :n] @ np.linalg.solve(others, whole[:n, n:])
        as_one = self.noise.correlation_samples
        rate = as_one * np.asarray(self.noise.scale) / np.square(self.level)
        of_level = np.sum((0.5 * self.n_counted / as_one + self.noise.shape) * np.log(precision) - precision * rate)
        return float(of_level - 0.5 * left[-1, -1] - 0.5 * np.linalg.slogdet(others)[1]), left

    def _precision(self, precision: Floats, weights: Floats, variance: float) -> Floats:
        """The precision that what is left on the average, over weights and the other parameters, deserves."""
        n, whole = self.n_base, np.tensordot(precision, self.products, axes=1)
        prior = np.append(np.full(n, PRIOR_PRECISION), np.full(len(weights), 1.0 / variance))
        spread = np.linalg.inv(whole[:-1, :-1] + np.diag(prior))
        others = np.linalg.solve(whole[:n, :n] + PRIOR_PRECISION * np.eye(n), whole[:n, -1] - whole[:n, n:-1] @ weights)
        own = np.concatenate([others, weights, [-1.0]])
        misfit = np.array([own @ one @ own + np.sum(spread * one[:-1, :-1]) for one in self.products])
        squared = np.square(self.level)
        (deserved,) = self.noise.precision((misfit * squared)[None], self.n_counted, np.empty((1, 0)))
        return np.asarray(squared * deserved)
