"""The derivatives of a response as the likelihood sees them: whitened, over the noise, in the unit cube."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve

from bwbn_bayes.inference.correlation import Correlation
from bwbn_bayes.inference.identifiability import PRIOR_PRECISION
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.blocks import counts, mean_squares, over_time
from bwbn_bayes.records.record import Record

_AT_ONCE = 32
"""Directions that are projected together: one product of matrices, and little memory in long records."""


@dataclass(frozen=True, kw_only=True)
class Slopes:
    """The response's derivatives by the present model's parameters, in posterior units.

    Rows over time hold zeros where nothing counts.

    Attributes
    ----------
    record : Record
        What was measured.
    noise : (n_blocks,) array
        Noise standard deviation of each channel of each record. [units of the channels]
    base : (n_channels * n_times, n_dim) array
        Derivatives in unit coordinates, whitened, over the noise.
    residual : (n_channels, n_times) array
        What the response leaves of the measurement, whitened, over the noise.
    correlation : Correlation, optional
        Of the errors.
    """

    record: Record
    noise: Floats
    base: Floats
    residual: Floats
    correlation: Correlation | None = None

    @classmethod
    def at(cls, posterior: Posterior, point: Floats) -> Slopes:
        """At a point ``(n_dim,)`` of the unit cube."""
        record, (values, noise_values) = posterior.record, posterior.split(point[None])
        correlation = posterior.noise.correlation
        response, slopes = posterior.engine.sensitivities(posterior.model, values, record)
        left = _whitened(record, correlation, record.measured - response.values)
        misfit = mean_squares(record, left) * counts(record)
        noise = 1.0 / np.sqrt(posterior.noise.precision(misfit, counts(record), noise_values)[0])
        scale = posterior.model.space.unit_scale(values)[0]
        weight = over_time(record, 1.0 / noise)
        base = (_whitened(record, correlation, slopes[0]) * weight).reshape(len(scale), -1).T * scale
        # Where the response is finite derivatives may still have run away: of a parameter whose did they say nothing.
        base = np.where(np.all(np.isfinite(base), axis=0), base, 0.0)
        return cls(record=record, noise=noise, base=base, residual=left[0] * weight, correlation=correlation)

    @cached_property
    def _weight(self) -> Floats:
        """One over the noise where a channel counts, ``(n_channels, n_times)``."""
        return over_time(self.record, 1.0 / self.noise)

    def scaled(self, rows: Floats) -> Floats:
        """Rows ``(..., n_channels, n_times)`` as the likelihood sees them: whitened, over the noise."""
        return _whitened(self.record, self.correlation, rows) * self._weight

    def by(self, columns: NDArray[np.int64]) -> Slopes:
        """By some of the parameters."""
        return replace(self, base=self.base[:, columns])

    @cached_property
    def factor(self) -> Floats:
        """Lower triangular factor of their information, with the prior's; not of the product, which rounding spoils."""
        prior = np.sqrt(PRIOR_PRECISION) * np.eye(self.base.shape[1])
        return np.asarray(np.linalg.qr(np.concatenate([self.base, prior]), mode="r").T)

    def projected(self, values: Floats, slopes: Floats) -> Floats:
        """Slope of the log likelihood and information in each of some directions by itself, ``(n, 2)``.

        The present parameters are projected out; zeros where nothing is left, or the model cannot be solved.

        Parameters
        ----------
        values, slopes : (n, n_channels, n_times) array
            Responses, and their derivatives, each in its direction.
        """
        result = np.zeros((len(slopes), 2))
        for some in np.array_split(np.arange(len(slopes)), -(-len(slopes) // _AT_ONCE)):
            with np.errstate(over="ignore", invalid="ignore"):
                residual = self.scaled(self.record.measured - values[some]).reshape(len(some), -1)
                own = self.scaled(slopes[some]).reshape(len(some), -1)
                whole = np.sum(np.square(own), axis=1)
                solved = np.isfinite(whole) & np.all(np.isfinite(residual), axis=1)
            own, residual, whole = own[solved], residual[solved], whole[solved]
            over = own @ self.base
            weights = cho_solve((self.factor, True), over.T).T
            left = whole - np.sum(over * weights, axis=1)
            gradient = np.sum(own * residual, axis=1) - np.sum((residual @ self.base) * weights, axis=1)
            # What is left must exceed the rounding of what was taken away.
            there = (left >= 1e-9 * whole) & (whole > 0.0)
            result[some[solved][there]] = np.stack([gradient, left], axis=1)[there]
        return result


def _whitened(record: Record, correlation: Correlation | None, rows: Floats) -> Floats:
    rows = record.where_counted(rows)
    return rows if correlation is None else correlation.whitened(rows)
