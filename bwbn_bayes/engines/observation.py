"""What accelerometers show: a gain, an offset and a lag, applied to solved responses and their derivatives.

A floor's accelerometer shows ``gain a(t - lag) + bias``. Channels ``acceleration_i`` are what it shows,
``relative_acceleration_i`` the same less the recorded ground acceleration; other channels come from other instruments.
Nothing of this is in the kernels: a model without such effects, or with all of them known and neutral, pays nothing.

Between samples the response is interpolated by a polynomial through twelve samples around it: right to 6e-5 of the
amplitude up to 8 Hz at 50 samples a second. In the last five samples the twelve end with the record: 5e-3 there. Before
the record the response is zero, as the building starts at rest. Derivatives in the lag are those of the interpolant.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from bwbn_bayes.elements.law import SensorLaw, symbol
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure

N_NODES = 12
"""Samples that one interpolated value is made of."""

_BEFORE = N_NODES // 2
_MIDDLE = (N_NODES - 1) / 2.0


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """The accelerometers behind some of the channels of one model.

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
    ground : (n_times,) array
        Recorded ground acceleration. [m/s^2]
    """

    law: SensorLaw
    index: NDArray[np.int64]
    places: tuple[tuple[int, int, bool], ...]
    time_step: float
    ground: Floats

    def read(self, local: Floats, values: Floats, slopes: Floats) -> None:
        """Replace true accelerations by what the sensors show, in place.

        Parameters
        ----------
        local : (n_draws, n_storeys, n_sensor_parameters) array
            Parameters of each draw's sensors.
        values : (n_draws, n_channels, n_times) array
            Channels. [SI]
        slopes : (n_draws, n_parameters, n_channels, n_times) array
            Their derivatives; no parameters where they are not wanted.
        """
        functions = _functions(self.law)
        for channel, floor, is_relative in self.places:
            offset = self.ground if is_relative else 0.0
            for draw in range(len(values)):
                settings, moves = (f(*local[draw, floor]) for f in functions)
                gain, bias, lag = settings
                rows = np.vstack([values[draw, channel] + offset, slopes[draw, :, channel]])
                is_late = lag != 0.0 or (len(rows) > 1 and any(moves[2::3]))
                late, rate = delayed(rows, lag / self.time_step) if is_late else (rows, 0.0)
                values[draw, channel] = gain * late[0] + bias - offset
                slopes[draw, :, channel] = gain * late[1:]
                for own, parameter in enumerate(self.index[floor]):
                    if parameter >= 0 and len(slopes[draw]):
                        of_gain, of_bias, of_lag = moves[3 * own : 3 * own + 3]
                        slopes[draw, parameter, channel] += (
                            of_gain * late[0] + of_bias + gain * of_lag / self.time_step * rate
                        )


def sensors_of(model: Structure, record: Record, names: Sequence[str]) -> Sensors | None:
    """The sensors of a model behind the named channels; None where all are known to be neutral.

    Parameters
    ----------
    model : Structure
        A building; the sensors' parameters are the last columns of its table.
    record : Record
        Time step and excitation.
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
    if not places:
        return None
    return Sensors(
        law=law,
        index=table.index[:, n_law:],
        places=tuple(places),
        time_step=record.time_step,
        ground=np.asarray(record.excitation, dtype=np.float64),
    )


def delayed(rows: Floats, lag: float) -> tuple[Floats, Floats]:
    """Signals read later than they happened.

    Parameters
    ----------
    rows : (n_rows, n_times) array
        Signals at the samples, zero before them.
    lag : float
        In samples, not negative.

    Returns
    -------
    late : (n_rows, n_times) array
        ``rows`` at ``t - lag``.
    rate : (n_times,) array
        Derivative of the first row of ``late`` with respect to the lag, per sample.
    """
    n_times = rows.shape[1]
    if lag == 0.0 and len(rows) > 1:
        return rows, delayed(rows[:1], lag)[1]
    late, rate = np.zeros_like(rows), np.zeros(n_times)
    if not np.isfinite(lag):
        return np.full_like(rows, np.nan), np.full(n_times, np.nan)
    if lag >= n_times + N_NODES:
        return late, rate
    whole = int(np.floor(lag))
    n_padded = whole + N_NODES
    padded = np.hstack([np.zeros((len(rows), n_padded)), rows])
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
