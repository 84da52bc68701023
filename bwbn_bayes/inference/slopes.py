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
from bwbn_bayes.inference.scaled import ScaledCorrelation
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.blocks import counts, mean_squares, over_time
from bwbn_bayes.records.record import Record


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
        posterior = posterior.settled(point)
        record, (values, noise_values) = posterior.record, posterior.split(point[None])
        correlation = posterior.noise.correlation
        assert not isinstance(correlation, ScaledCorrelation)
        response, slopes = posterior.engine.sensitivities(posterior.model, values, record)
        left = _whitened(record, correlation, record.measured - response.values)
        misfit = mean_squares(record, left) * counts(record)
        noise = 1.0 / np.sqrt(posterior.noise.precision(misfit, counts(record), noise_values)[0])
        scale = posterior.model.space.unit_scale(values)[0]
        weight = over_time(record, 1.0 / noise)
        base = (_whitened(record, correlation, slopes[0]) * weight).reshape(len(scale), -1).T * scale
        # Where the response is finite its derivatives may still have run away: they say nothing there.
        base = np.nan_to_num(base, posinf=0.0, neginf=0.0)
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

    def projected(self, values: Floats, slope: Floats) -> tuple[float, float]:
        """Slope of the log likelihood and information in one direction, with the present parameters projected out.

        Parameters
        ----------
        values, slope : (n_channels, n_times) array
            Response, and its derivative in that direction.
        """
        gradient, information = self.projected_together(values, slope[None])
        whole = float(np.sum(np.square(self.scaled(slope))))
        # What is left must exceed the rounding of what was taken away.
        if not (np.isfinite(whole) and information[0, 0] >= 1e-9 * whole > 0.0):
            return 0.0, 0.0
        return float(gradient[0]), float(information[0, 0])

    def projected_together(self, values: Floats, slopes: Floats) -> tuple[Floats, Floats]:
        """The same in several directions ``(n, n_channels, n_times)`` at once: ``(n,)`` and ``(n, n)`` arrays."""
        n = len(slopes)
        residual, own = self.scaled(self.record.measured - values).ravel(), self.scaled(slopes).reshape(n, -1)
        if not (np.all(np.isfinite(residual)) and np.all(np.isfinite(own))):  # it cannot be solved there
            return np.zeros(n), np.zeros((n, n))
        weights = cho_solve((self.factor, True), self.base.T @ own.T)
        left = own @ own.T - (own @ self.base) @ weights
        return own @ residual - weights.T @ (self.base.T @ residual), left


def _whitened(record: Record, correlation: Correlation | None, rows: Floats) -> Floats:
    rows = record.where_counted(rows)
    return rows if correlation is None else correlation.whitened(rows)
