"""The unnamed force of a specimen: what its force has beyond a law, of where it is, how it came there, and when.

Half of its variance is a smooth function of displacement, of the way since the last turn (the force of an
elastic-plastic spring, continuous where a direction jumps) and of the path covered: the law that is missing. The other
half is a function of the path alone that forgets itself within a quarter of the largest displacement: what no law of
few parameters holds. Both follow from the displacement history, without a model.

References
----------
.. [1] A. Solin and S. Sarkka, "Hilbert space methods for reduced-rank Gaussian process regression", Statistics and
   Computing 30, 2020, doi:10.1007/s11222-019-09886-w.
.. [2] M. C. Kennedy and A. O'Hagan, "Bayesian calibration of computer models", J. R. Statist. Soc. B 63(3), 2001,
   doi:10.1111/1467-9868.00294.
"""

from __future__ import annotations

import numpy as np

from bwbn_bayes.inference.correlation import SharedFunctions
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.cycles import path_of
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.starting_model import initial_stiffness

_BEYOND = 1.5
"""Half length of the interval of the basis over that of the data: the process does not vanish at the data's ends."""
_SIZES = (8, 3, 5)
"""Functions of displacement, of the way since the last turn and of path."""
_LENGTHS = (0.35, 0.8, 0.5)
"""Correlation lengths of the three, each of which runs from -1 to 1."""
_FORGOTTEN = 0.25
"""Of the largest displacement: path within which a departure that no law has is forgotten."""
_MOST_KNOTS = 600
_SCALES = 2.0 ** np.arange(-3.0, 9.0, 0.25)
"""Of the force, over the noise level: from an eighth of it to some hundred times as much."""


def unnamed_basis(record: Record) -> Floats:
    """Functions ``(n_times, n_functions)`` of a cyclic test, each times the standard deviation of its weight.

    Their sum has unit variance on the average over the test.
    """
    displacement = record.excitation
    peak = float(np.max(np.abs(displacement)))
    yielding = float(np.max(np.abs(record.channels["force"]))) / initial_stiffness(record)
    path = path_of(displacement)
    axes = (displacement / peak, _play(displacement / yielding), 2.0 * path / path[-1] - 1.0)
    law = np.ones((record.n_times, 1))
    for place, n, length in zip(axes, _SIZES, _LENGTHS, strict=True):
        law = (law[:, :, None] * _functions(place, n, length)[:, None, :]).reshape(record.n_times, -1)
    n_knots = min(max(int(np.ceil(path[-1] / (_FORGOTTEN * peak))), 2), _MOST_KNOTS)
    knots = np.linspace(0.0, path[-1], n_knots + 1)
    fleeting = np.maximum(1.0 - np.abs(path[:, None] - knots) / knots[1], 0.0)
    halves = [part / np.sqrt(2.0 * np.mean(np.sum(np.square(part), axis=1))) for part in (law, fleeting)]
    return np.hstack(halves)


def fitted_basis(record: Record) -> Floats:
    """The same with zeros at samples that do not count: of them the likelihood knows nothing."""
    basis = unnamed_basis(record)
    return basis if record.counted is None else basis * record.counted[:, None]


def expected_force(record: Record, residual: Floats) -> Floats:
    """What of a residual ``(n_times,)`` is expected to be the unnamed force, at its most probable scale.

    Parameters
    ----------
    record : Record
        A cyclic test.
    residual : (n_times,) array
        What a law leaves of its force; zero at samples that do not count.

    Returns
    -------
    (n_times,) array
        [N]
    """
    shared = SharedFunctions.of(fitted_basis(record))
    weights, variance = residual @ shared.functions, np.square(_SCALES)[:, None] * shared.variance
    taken = variance / (1.0 + variance)
    left = residual @ residual - taken @ np.square(weights)
    log_likelihood = -0.5 * (record.n_counted * np.log(left) + np.sum(np.log1p(variance), axis=1))
    return np.asarray(shared.functions @ (taken[np.argmax(log_likelihood)] * weights))


def _functions(place: Floats, n: int, length: float) -> Floats:
    """Eigenfunctions ``(n_times, n)`` on the interval, times the root of a Gaussian kernel's spectral density."""
    frequency = 0.5 * np.pi * np.arange(1, n + 1) / _BEYOND
    density = np.sqrt(2.0 * np.pi) * length * np.exp(-0.5 * np.square(length * frequency))
    return np.asarray(np.sin(frequency * (place[:, None] + _BEYOND)) * np.sqrt(density / _BEYOND))


def _play(displacement: Floats) -> Floats:
    """Force of an elastic-plastic spring over its strength ``(n_times,)``, from displacements over its yield's."""
    result = np.zeros(len(displacement))
    for i, step in enumerate(np.diff(displacement)):
        result[i + 1] = min(max(result[i] + step, -1.0), 1.0)
    return result
