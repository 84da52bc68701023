"""What accelerometers show: a gain, an offset and a lag, applied to solved responses and their derivatives.

A floor's accelerometer shows ``gain a(t - lag) + bias``. Channels ``acceleration_i`` are what it shows,
``relative_acceleration_i`` the same less the recorded ground acceleration; other channels come from other instruments.
Nothing of this is in the kernels: a model without such effects, or with all of them known and neutral, pays nothing.

Between samples the response is interpolated by a polynomial through twelve samples around it: right to 6e-5 of the
amplitude up to 8 Hz at 50 samples a second. In the last five samples the twelve end with the record: 5e-3 there.
Derivatives in the lag are those of the interpolant.

What a late sensor shows first happened before its record began. In a sequence that is how the record before it ended,
interpolated by cubic splines where its time step is another. Before the first record a building at rest shows nothing;
one that starts in another state came to it in a way that nobody knows, and its first value is held.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import sympy as sp
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from bwbn_bayes.elements.law import SensorLaw, symbol
from bwbn_bayes.engines.stretches import Stretch
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure

N_NODES = 12
"""Samples that one interpolated value is made of."""

_BEFORE = N_NODES // 2
_MIDDLE = (N_NODES - 1) / 2.0
_AROUND = 12
"""Samples to either side of those that a spline interpolates: its ends are felt less than 1e-6 as far away."""


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """The accelerometers behind some of the channels of one model, on one stretch of a record.

    Attributes
    ----------
    law : SensorLaw
        Gain, bias and lag as expressions of the parameters.
    index : (n_storeys, n_sensor_parameters) integer array
        Position of each among the identified parameters, -1 where the value is known.
    places : tuple of (int, int, bool)
        Channel, floor (from 0) and whether the recorded ground acceleration is taken off, of each channel concerned.
    time_step : float
        Between samples. [s]
    samples : slice
        Those of the stretch, in the whole record.
    times : (n_known,) array
        Of these and of those before them that led to their state, from the first of these. [s]
    ground : (n_known,) array
        Recorded ground acceleration then. [m/s^2]
    holds : bool
        Whether the first value of all is held before it; zero otherwise.
    """

    law: SensorLaw
    index: NDArray[np.int64]
    places: tuple[tuple[int, int, bool], ...]
    time_step: float
    samples: slice
    times: Floats
    ground: Floats
    holds: bool

    def read(self, local: Floats, values: Floats, slopes: Floats) -> None:
        """Replace true accelerations of the stretch by what the sensors show, in place.

        Parameters
        ----------
        local : (n_draws, n_storeys, n_sensor_parameters) array
            Parameters of each draw's sensors.
        values : (n_draws, n_channels, n_times) array
            Channels of the whole record, still true before the stretch. [SI]
        slopes : (n_draws, n_parameters, n_channels, n_times) array
            Their derivatives; no parameters where they are not wanted.
        """
        here, known = self.samples, slice(self.samples.stop - len(self.times), self.samples.stop)
        functions = _functions(self.law)
        for channel, floor, is_relative in self.places:
            offset = self.ground if is_relative else np.zeros_like(self.ground)
            for draw in range(len(values)):
                settings, moves = (f(*local[draw, floor]) for f in functions)
                gain, bias, lag = settings
                rows = np.vstack([values[draw, channel, known] + offset, slopes[draw, :, channel, known]])
                is_late = lag != 0.0 or (len(rows) > 1 and any(moves[2::3]))
                late, rate = self._late(rows, lag / self.time_step) if is_late else (rows[:, self._n_earlier :], 0.0)
                values[draw, channel, here] = gain * late[0] + bias - offset[self._n_earlier :]
                slopes[draw, :, channel, here] = gain * late[1:]
                for number, parameter in enumerate(self.index[floor]):
                    if parameter >= 0 and len(slopes[draw]):
                        of_gain, of_bias, of_lag = moves[3 * number : 3 * number + 3]
                        slopes[draw, parameter, channel, here] += (
                            of_gain * late[0] + of_bias + gain * of_lag / self.time_step * rate
                        )

    @property
    def _n_earlier(self) -> int:
        return len(self.times) - int(self.samples.stop - self.samples.start)

    def _late(self, rows: Floats, lag: float) -> tuple[Floats, Floats]:
        """What :func:`delayed` makes of the stretch's samples, from all known ``(n_rows, n_known)``."""
        reach = -self.times[0] / self.time_step + 1e-6  # whole but for rounding where no time step is another
        n_earlier = int(min(lag + N_NODES, reach)) if np.isfinite(lag) else 0
        own = rows[:, self._n_earlier :]
        if n_earlier:
            earlier = -self.time_step * np.arange(n_earlier, 0, -1)
            first = max(int(np.searchsorted(self.times, earlier[0])) - _AROUND, 0)
            near = slice(first, self._n_earlier + _AROUND)
            spline = make_interp_spline(self.times[near], rows[:, near], axis=1, check_finite=False)
            own = np.hstack([spline(earlier), own])
        late, rate = delayed(own, lag, holds=self.holds)
        return late[:, n_earlier:], rate[n_earlier:]


def read_all(sensors: Sequence[Sensors | None], local: Floats, values: Floats, slopes: Floats) -> None:
    """:meth:`Sensors.read` of all stretches, the last first: a late sensor shows what truly happened before.

    Parameters
    ----------
    sensors : sequence of Sensors or None
        Of each stretch, one after the other; None where they are neutral.
    local, values, slopes
        Of all of them.
    """
    for own in reversed(sensors):
        if own is not None:
            own.read(local, values, slopes)


def sensors_of(model: Structure, record: Record, stretch: Stretch, names: Sequence[str]) -> Sensors | None:
    """The sensors of a model behind the named channels; None where all are known to be neutral.

    Parameters
    ----------
    model : Structure
        A building; the sensors' parameters are the last columns of its table.
    record : Record
        The whole of it.
    stretch : Stretch
        Of it, of which something is asked.
    names : sequence of str
        Channels asked for.
    """
    law, table, n_law = model.sensors, model.table, len(model.law.parameters)
    neutral = np.array([p.neutral for p in law.parameters])
    acts = np.any((table.index[:, n_law:] >= 0) | (table.fixed[:, n_law:] != neutral), axis=1)
    places = []
    for channel, name in enumerate(names):
        match = re.fullmatch(r"(relative_)?acceleration_(\d+)", name)
        if match is not None and acts[int(match[2]) - 1]:
            places.append((channel, int(match[2]) - 1, match[1] is not None))
    if not places or stretch.samples is None:
        return None
    # Records of a sequence lead to each other from the first on; others begin anew.
    known = slice(0 if record.is_sequence else stretch.samples.start, stretch.samples.stop)
    return Sensors(
        law=law,
        index=table.index[:, n_law:],
        places=tuple(places),
        time_step=stretch.time_step,
        samples=stretch.samples,
        times=record.times[known] - record.times[stretch.samples.start],
        ground=np.asarray(record.excitation[known], dtype=np.float64),
        holds=bool(model.law.initial),
    )


def delayed(rows: Floats, lag: float, *, holds: bool = False) -> tuple[Floats, Floats]:
    """Signals read later than they happened.

    Parameters
    ----------
    rows : (n_rows, n_times) array
        Signals at the samples.
    lag : float
        In samples, not negative.
    holds : bool
        Whether they had their first values before the samples; zero otherwise.

    Returns
    -------
    late : (n_rows, n_times) array
        ``rows`` at ``t - lag``.
    rate : (n_times,) array
        Derivative of the first row of ``late`` with respect to the lag, per sample.
    """
    n_times = rows.shape[1]
    if lag == 0.0 and len(rows) > 1:
        return rows, delayed(rows[:1], lag, holds=holds)[1]
    if not np.isfinite(lag):
        return np.full_like(rows, np.nan), np.full(n_times, np.nan)
    before = rows[:, :1] if holds else np.zeros((len(rows), 1))
    late, rate = np.zeros_like(rows), np.zeros(n_times)
    if lag >= n_times + N_NODES:
        return late + before, rate
    whole = int(np.floor(lag))
    n_padded = whole + N_NODES
    padded = np.hstack([np.repeat(before, n_padded, axis=1), rows])
    first = n_padded - whole - _BEFORE
    n_central = int(np.clip(n_times - _BEFORE + 1 + whole, 0, n_times))
    weights, slopes = _weights(float(_BEFORE - (lag - whole)))
    for node in range(N_NODES):
        window = padded[:, first + node : first + node + n_central]
        late[:, :n_central] += weights[node] * window
        rate[:n_central] -= slopes[node] * window[0]
    for sample in range(n_central, n_times):
        weights, slopes = _weights(float(sample - lag - (n_times - N_NODES)))
        late[:, sample] = padded[:, -N_NODES:] @ weights
        rate[sample] = -(padded[0, -N_NODES:] @ slopes)
    return late, rate


def _weights(position: float) -> tuple[Floats, Floats]:
    """Weights of the twelve samples at a position counted from the first, and their derivatives in it."""
    x = (position - _MIDDLE) ** np.arange(N_NODES)
    slope = np.arange(1, N_NODES) * x[:-1]
    return _BASIS @ x, _BASIS[:, 1:] @ slope


def _lagrange_basis() -> Floats:
    """Coefficients, lowest first, of the polynomials that are one at one node and zero at the others."""
    nodes = np.arange(N_NODES) - _MIDDLE
    rows = []
    for i, node in enumerate(nodes):
        others = np.delete(nodes, i)
        rows.append(np.poly(others)[::-1] / np.prod(node - others))
    return np.array(rows)


_BASIS = _lagrange_basis()


@cache
def _functions(law: SensorLaw) -> tuple[Callable[..., Sequence[float]], Callable[..., Sequence[float]]]:
    """Gain, bias and lag as functions of the parameters; their derivatives, parameter by parameter."""
    symbols = [symbol(parameter.symbol) for parameter in law.parameters]
    outputs = (law.gain, law.bias, law.lag)
    return (
        sp.lambdify(symbols, outputs),
        sp.lambdify(symbols, [sp.diff(output, s) for s in symbols for output in outputs]),
    )
