"""Misfit and normal equations from responses, for engines that do not sum them while they solve."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bwbn_bayes.engines.base import NormalEquations, Response, measured_matrix
from bwbn_bayes.parameters import Booleans, Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure


class Reduction:
    """Base of engines that give ``simulate`` and ``sensitivities``; it brings the other half of the contract.

    Draws are solved one at a time, so that memory does not grow with their number.
    """

    def simulate(
        self, model: Structure, draws: Floats, record: Record, channels: Sequence[str] | None = None
    ) -> Response:
        """See :class:`~bwbn_bayes.engines.base.Engine`."""
        raise NotImplementedError

    def sensitivities(
        self,
        model: Structure,
        draws: Floats,
        record: Record,
        channels: Sequence[str] | None = None,
        *,
        free: Booleans | None = None,
    ) -> tuple[Response, Floats]:
        """See :class:`~bwbn_bayes.engines.base.Engine`."""
        raise NotImplementedError

    def misfit(self, model: Structure, draws: Floats, record: Record) -> Floats:
        """Sum of squared residuals ``(n_draws, n_channels)`` over the measured channels; infinite where it failed."""
        names = tuple(record.channels)
        measured = measured_matrix(record, names)[:, record.kept]
        result = np.empty((len(draws), len(names)))
        for i in range(len(draws)):
            values = self.simulate(model, draws[i : i + 1], record, names).values[0]
            result[i] = np.sum((measured - values[:, record.kept]) ** 2, axis=1)
        return np.where(np.isfinite(result), result, np.inf)

    def normal_equations(
        self, model: Structure, draws: Floats, record: Record, *, free: Booleans | None = None
    ) -> NormalEquations:
        """Least squares in summary over the measured channels; NaN slopes where the solve failed."""
        names = tuple(record.channels)
        measured = measured_matrix(record, names)[:, record.kept]
        n, c, d = len(draws), len(names), model.space.n_dim
        misfit, gradient, information = np.empty((n, c)), np.empty((n, c, d)), np.empty((n, c, d, d))
        for i in range(n):
            own = None if free is None else free[i : i + 1]
            response, slopes = self.sensitivities(model, draws[i : i + 1], record, names, free=own)
            residual, slope = measured - response.values[0][:, record.kept], slopes[0][..., record.kept]
            misfit[i] = np.sum(residual**2, axis=1)
            gradient[i] = np.einsum("dct,ct->cd", slope, residual)
            information[i] = np.einsum("act,bct->cab", slope, slope)
        misfit = np.where(np.isfinite(misfit), misfit, np.inf)
        return NormalEquations(misfit=misfit, gradient=gradient, information=information)
