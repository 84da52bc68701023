"""Misfit and normal equations from responses, for engines that do not sum them while they solve."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bwbn_bayes.engines.base import NormalEquations, Response
from bwbn_bayes.parameters import Booleans, Floats
from bwbn_bayes.records.blocks import by_block
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
        """Sum of squared residuals ``(n_draws, n_blocks)`` over the measured channels; infinite where it failed."""
        result = np.empty((len(draws), len(record.blocks)))
        for i in range(len(draws)):
            values = self.simulate(model, draws[i : i + 1], record).values[0]
            result[i] = [np.sum(rest**2) for rest in by_block(record, record.measured - values)]
        return np.where(np.isfinite(result), result, np.inf)

    def normal_equations(
        self, model: Structure, draws: Floats, record: Record, *, free: Booleans | None = None
    ) -> NormalEquations:
        """Least squares in summary over the measured channels; NaN slopes where the solve failed."""
        n, c, d = len(draws), len(record.blocks), model.space.n_dim
        misfit, gradient, information = np.empty((n, c)), np.empty((n, c, d)), np.empty((n, c, d, d))
        for i in range(n):
            own = None if free is None else free[i : i + 1]
            response, slopes = self.sensitivities(model, draws[i : i + 1], record, free=own)
            residuals = by_block(record, record.measured - response.values[0])
            for block, (rest, slope) in enumerate(zip(residuals, by_block(record, slopes[0]), strict=True)):
                misfit[i, block] = np.sum(rest**2)
                gradient[i, block] = slope @ rest
                information[i, block] = slope @ slope.T
        misfit = np.where(np.isfinite(misfit), misfit, np.inf)
        return NormalEquations(misfit=misfit, gradient=gradient, information=information)
