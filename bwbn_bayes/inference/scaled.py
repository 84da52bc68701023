"""Errors of one channel that share functions, under each of some scales of these at once.

What a law leaves is put into the functions once; its squares under any scale are then a weighted sum of theirs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bwbn_bayes.inference.correlation import Correlation, SharedFunctions
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record

PER_OCTAVE = 8
"""Scales in a factor of two: of some hundred functions that a record determines, each fits twice as far."""
SCALES = 2.0 ** (np.arange(-3 * PER_OCTAVE, 9 * PER_OCTAVE + 1) / PER_OCTAVE)
"""Of the force, over the noise level: from an eighth of it to five hundred times as much."""


@dataclass(frozen=True, kw_only=True)
class ScaledEquations:
    """Least squares under each of some scales: what :class:`~bwbn_bayes.engines.base.NormalEquations` is of one.

    Attributes
    ----------
    misfit : (n_draws, n_scales) array
        Squared residuals, whitened.
    products : (n_draws, 1 + n_parameters, 1 + n_parameters) array
        Of residual and derivatives with each other, not whitened.
    weights : (n_draws, 1 + n_parameters, n_functions) array
        Residual and derivatives in the functions.
    taken : (n_scales, n_functions) array
        Share of each function's squares that is the force's.
    """

    misfit: Floats
    products: Floats
    weights: Floats
    taken: Floats

    def weighted(self, weight: Floats) -> tuple[Floats, Floats]:
        """``J^T r`` and ``J^T J`` summed over scales with weights ``(n_draws, n_scales)``; zero where not finite."""
        with np.errstate(over="ignore", invalid="ignore"):  # a draw that runs away
            over = self.weights * (weight @ self.taken)[:, None]
            both = np.sum(weight, axis=1)[:, None, None] * self.products - over @ np.swapaxes(self.weights, 1, 2)
        both = np.nan_to_num(both, posinf=0.0, neginf=0.0)
        return both[:, 1:, 0], both[:, 1:, 1:]


@dataclass(frozen=True, kw_only=True, eq=False)
class ScaledCorrelation:
    """Correlation of one channel's errors under each of some scales of what they share."""

    shared: SharedFunctions
    """Of unit scale."""

    @property
    def arrays(self) -> tuple[Floats, ...]:
        """All that it is made of, in numbers."""
        return Correlation(shared=self.shared).arrays

    @property
    def _taken(self) -> Floats:
        variance = np.square(SCALES)[:, None] * self.shared.variance
        return np.asarray(variance / (1.0 + variance))

    @property
    def log_volumes(self) -> Floats:
        """Minus half the log determinant of each correlation matrix, ``(n_scales,)``."""
        return np.asarray(-0.5 * np.sum(np.log1p(np.square(SCALES)[:, None] * self.shared.variance), axis=1))

    def until(self, record: Record) -> ScaledCorrelation:
        """That of the first samples, which are a record's."""
        return replace(self, shared=self.shared.until(record.n_times))

    def squares(self, residual: Floats) -> Floats:
        """Sums ``(n, n_scales)`` of squared whitened residuals ``(n, 1, n_times)``."""
        rows = residual[:, 0]
        return np.asarray(np.sum(np.square(rows), axis=1)[:, None] - np.square(self._weights(rows)) @ self._taken.T)

    def equations(self, rows: Floats) -> ScaledEquations:
        """Of residual and derivatives ``(n, 1 + n_parameters, 1, n_times)``."""
        own, taken = rows[:, :, 0], self._taken
        weights, products = self._weights(own), np.matmul(own, np.swapaxes(own, 1, 2))
        misfit = products[:, 0, 0][:, None] - np.square(weights[:, 0]) @ taken.T
        return ScaledEquations(misfit=misfit, products=products, weights=weights, taken=taken)

    def _weights(self, rows: Floats) -> Floats:
        """Rows ``(..., n_times)`` in the functions; one product of matrices."""
        functions = self.shared.functions
        return np.asarray((rows.reshape(-1, rows.shape[-1]) @ functions).reshape(*rows.shape[:-1], functions.shape[1]))
