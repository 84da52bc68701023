"""An error of a sensor that has no name: what a channel shows beyond the motion, as a function of one thing.

That is what the sensor should show, of one that bends or saturates; time, of one that drifts; or time is what its gain
is a function of. The function is one of many scales (:mod:`~bwbn_bayes.inference.unnamed.hats`). Beside the model, the
errors of the channel share these functions with independent normal weights, so that they are integrated out exactly;
size, smoothness and kind are integrated out in sums. What the sensor should show is what the model has it show, at the
optimum beside the very error: both are found in turns.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from bwbn_bayes.inference.correlation import Correlation, SharedFunctions
from bwbn_bayes.inference.likelihood import IntegratedNoise, Posterior
from bwbn_bayes.inference.modes import Mode, distinct, polish
from bwbn_bayes.inference.residuals import residual_of
from bwbn_bayes.inference.unnamed.hats import HATS, SMOOTHNESS, smoothed
from bwbn_bayes.inference.unnamed.sums import half_normal_scales
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.blocks import counts

_OF_SHOWN = "of what the sensor shows"
_ROOM = 1.05
"""Reach of the functions over the largest of what the channel shows."""
_SCALES, _DENSITY = half_normal_scales(1e-3, 61)
"""Of the error over the standard deviation of their half-normal prior, over which it is integrated."""
_N_TURNS, _N_LEVELS, _SETTLED = 8, 6, 0.1
"""In which error and optimum find each other, and the error's scale and the noise level; the gain that ends the former.
[nat]"""
_N_ITERATIONS, _N_KEPT, _REACH = 12, 3, 50.0
"""Steps of an optimum in each turn; optima kept, and how far below the best one may be. [nat]"""


@dataclass(frozen=True, kw_only=True)
class ReadingError:
    """An error of a channel's reading, found beside a model.

    Attributes
    ----------
    channel : str
    kind : str
        What it is a function of, in words.
    shown, error : (n_times,) array
        What the model has the channel show, and the error's expectation. [unit of the channel]
    posterior : Posterior
        Of the model, the error integrated out.
    modes : tuple of Mode
        Optima of that, best first.
    """

    channel: str
    kind: str
    shown: Floats
    error: Floats
    posterior: Posterior
    modes: tuple[Mode, ...]

    @property
    def is_of_shown(self) -> bool:
        """Whether it is a function of what the sensor should show, as it would be in another record."""
        return self.kind == _OF_SHOWN

    def error_at(self, shown: Floats) -> Floats:
        """Such an error where the sensor should show ``(n,)``; beyond all that it had to show, as at the end."""
        order = np.argsort(self.shown, kind="stable")
        return np.interp(shown, self.shown[order], self.error[order])

    def beside(self, posterior: Posterior) -> tuple[Posterior, Floats]:
        """A model's posterior for the record without the error, and the fit ``(n_dim,)`` that goes with it."""
        record = posterior.record
        corrected = {**record.channels, self.channel: record.channels[self.channel] - self.error}
        return replace(posterior, record=record.with_channels(corrected)), self.modes[0].point


def reading_errors(posterior: Posterior, points: Floats, share: float) -> tuple[ReadingError, ...]:
    """Errors of each channel of a record, beside a model.

    Parameters
    ----------
    posterior : Posterior
        Of the model and one record, for white noise whose levels are integrated out.
    points : (n, n_dim) array
        Its fits, the best one first, in the unit cube.
    share : float
        Standard deviation of the prior of the error's size, over the largest that the channel shows.
    """
    return tuple(_in_turns(posterior, points, name, share) for name in posterior.record.channels)


def _in_turns(posterior: Posterior, points: Floats, name: str, share: float) -> ReadingError:
    reached = -np.inf
    for _ in range(_N_TURNS):
        found = _Account.of(posterior, residual_of(posterior, points[0]), name, share)
        noise = replace(posterior.noise, correlation=found.correlation)  # type: ignore[type-var]
        view = posterior.with_noise(noise)
        modes = distinct(*polish(view, points, n_iterations=_N_ITERATIONS, reach=_REACH))[:_N_KEPT]
        points = np.array([mode.point for mode in modes])
        gained, reached = modes[0].log_likelihood - reached, modes[0].log_likelihood
        if gained < _SETTLED:
            break
    residual, row = residual_of(view, points[0]), list(posterior.record.channels).index(name)
    return ReadingError(
        channel=name,
        kind=found.kind,
        shown=posterior.record.measured[row] - residual[row],
        error=found.correlation.shared_part(residual)[row],
        posterior=view,
        modes=modes,
    )


@dataclass(frozen=True, kw_only=True)
class _Account:
    """Of a channel's errors: functions that they share, with what integrating size, smoothness and kind out adds."""

    kind: str
    correlation: Correlation

    @classmethod
    def of(cls, posterior: Posterior, residual: Floats, name: str, share: float) -> _Account:
        """The one that most of the evidence comes from, given a residual ``(n_channels, n_times)``."""
        record, row = posterior.record, list(posterior.record.channels).index(name)
        shown = record.measured[row] - residual[row]
        largest = share * float(np.max(np.abs(shown)))
        every = list(_bases(shown))
        found: list[tuple[float, float, _Account]] = []
        for kind, basis in every:
            whole = np.zeros((*residual.shape, basis.shape[1]))
            whole[row] = record.where_counted(basis.T).T
            shared = SharedFunctions.of(whole.reshape(-1, basis.shape[1]), np.ones(len(residual)))
            scale, own, total = _by_scale(posterior, residual, row, shared, largest)
            correlation = Correlation(shared=shared.times(scale))
            found.append((total, own, cls(kind=kind, correlation=correlation)))
        total, own, best = max(found, key=lambda one: one[0])
        priced = float(logsumexp([one[0] for one in found])) - float(np.log(len(every))) - own
        return replace(best, correlation=replace(best.correlation, log_prior=priced))


def _bases(shown: Floats) -> Iterator[tuple[str, Floats]]:
    """Functions ``(n_times, n_functions)`` of each kind and smoothness, each times its weight's standard deviation.

    With weights of unit variance an error is about as large as one at the end of what it is a function of.
    """
    relative = shown / max(float(np.max(np.abs(shown))), 1e-300)
    of_shown = np.array([hat.over(relative / _ROOM) for hat in HATS]).T
    of_time = np.array([hat.over(np.linspace(0.0, 1.0, len(shown))) for hat in HATS if hat.side > 0]).T
    sides = np.array([hat.side for hat in HATS])
    sd, constant = np.array([hat.sd for hat in HATS]), np.ones((len(shown), 1))
    for smoothness in SMOOTHNESS:
        size = sd * smoothed(smoothness)
        in_time = np.hstack([constant, of_time * size[sides > 0]])
        yield _OF_SHOWN, np.hstack([constant, of_shown * size])
        yield "that changes in time", in_time
        yield "of a gain that changes in time", in_time * relative[:, None]


def _by_scale(
    posterior: Posterior, residual: Floats, row: int, shared: SharedFunctions, largest: float
) -> tuple[float, float, float]:
    """The best scale, over the channel's noise level; the log likelihood at it; and that integrated over all scales.

    ``largest`` is the standard deviation of the half-normal prior of the error's size.
    """
    record, noise = posterior.record, replace(posterior.noise, correlation=None)  # type: ignore[type-var]
    assert isinstance(noise, IntegratedNoise)
    as_one, rate = (float(np.broadcast_to(own, len(residual))[row]) for own in (noise.as_one, noise.scale))
    n_times, answer = counts(record), np.square(residual.ravel() @ shared.functions)
    misfit = np.tile(np.sum(np.square(record.where_counted(residual)), axis=1), (len(_SCALES), 1))
    whole, scales = misfit[:, row].copy(), np.zeros(len(_SCALES))
    for _ in range(_N_LEVELS):  # what the error takes up is no noise, so that its scale over the noise grows
        level = np.sqrt((as_one * rate + 0.5 * misfit[:, row]) / (noise.shape + 0.5 * n_times[row] / as_one))
        scales = _SCALES * largest / level
        variance = np.square(scales)[:, None] * shared.variance
        misfit[:, row] = whole - (variance / (1.0 + variance)) @ answer
    by_scale = noise.log_likelihood(misfit, n_times, np.empty((1, 0))) - 0.5 * np.sum(np.log1p(variance), axis=1)
    best = int(np.argmax(by_scale + np.log(_DENSITY)))
    return float(scales[best]), float(by_scale[best]), float(logsumexp(by_scale, b=_DENSITY))
