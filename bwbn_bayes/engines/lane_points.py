"""One draw at a time on the lane engine, as samplers ask that go from point to point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bwbn_bayes.engines.lane_block import Block
from bwbn_bayes.engines.lane_problem import Problem, Stepping
from bwbn_bayes.engines.lane_source import LANES
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.structure import Structure


class OfPoints:
    """What samplers that go from point to point ask for, of a model under a record; see :meth:`Lanes.of_points`.

    Half of what one draw costs is the preparation, which is the same for every draw.

    Parameters
    ----------
    engine : Stepping
        Its scheme.
    model : Structure
    problem : Problem
        Of a draw with all its derivatives.
    """

    def __init__(self, engine: Stepping, model: Structure, problem: Problem) -> None:
        self._engine, self._model, self._problem = engine, model, problem
        self._block = Block.of(self._local(np.zeros(model.space.n_dim)), self._n_law, problem.directions, 0)
        row, lane = self._block.sources(problem.n_parameters)
        held = row[1:, 0] >= 0
        self._row, self._lane = row[1:, 0][held], lane[1:, 0][held]
        self._whole = self._block.whole.of_parameters(problem.n_parameters)[0][held]

    @property
    def _n_law(self) -> int:
        return len(self._model.law.parameters)

    def _local(self, values: Floats) -> Floats:
        return self._model.table.local(values[None])

    def __call__(self, values: Floats, measured: Floats) -> tuple[Floats, Floats]:
        """Squared residuals ``(n_blocks,)`` and their derivatives ``(n_blocks, n_parameters)``.

        Parameters
        ----------
        values : (n_parameters,) array
            In their own units.
        measured : (n_channels, n_times) array
        """
        local = self._local(values)[0, :, : self._n_law]
        local = local if np.all(np.isfinite(local)) else np.full_like(local, np.nan)
        block = replace(self._block, parameters=np.repeat(local[:, :, None], LANES, axis=2))
        sums, slopes = [], []
        for part, outcome in self._problem.run(self._engine, block, store=True):
            c = len(part.channels.names)
            stored = outcome.stored.reshape(-1, 1 + block.directions.n, c, LANES)
            rest = measured[part.rows, part.stretch.samples].T - stored[:, 0, :, 0]
            with np.errstate(over="ignore", invalid="ignore"):  # a draw that runs away
                sums.append(np.sum(np.square(rest), axis=0))
                every = np.einsum("tc,tkcl->ckl", rest, stored[:, 1:])
                slopes.append(-2.0 * every[:, self._row - 1, self._lane] @ self._whole)
        return np.concatenate(sums), np.concatenate(slopes)
