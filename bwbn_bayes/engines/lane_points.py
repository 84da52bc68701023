"""Few draws at a time on the lane engine, as samplers ask that go from point to point."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.engines.lane_block import Block
from bwbn_bayes.engines.lane_problem import Problem, Stepping
from bwbn_bayes.engines.lane_source import LANES
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.structure import Structure


@dataclass(frozen=True, kw_only=True)
class _Places:
    """Lanes of so many draws, and where they hold what is asked for.

    Attributes
    ----------
    block : Block
        The parameters are not yet in it.
    draw : (n_lanes,) integer array
        That each lane solves.
    first : (n_draws,) integer array
        A lane of each draw.
    row, lane : (n_directions, n_draws) integer arrays
        Of each derivative.
    """

    block: Block
    draw: NDArray[np.int64]
    first: NDArray[np.int64]
    row: NDArray[np.int64]
    lane: NDArray[np.int64]

    @classmethod
    def of(cls, model: Structure, problem: Problem, n_draws: int) -> Self:
        """For the derivatives of a problem of one draw."""
        local = model.table.local(np.zeros((n_draws, model.space.n_dim)))
        directions = problem.directions.at(np.zeros(n_draws, dtype=np.int64))
        block = Block.of(local, len(model.law.parameters), directions, 0)
        row, lane = block.sources(problem.n_parameters)
        draw = np.minimum(np.arange(LANES) // block.n_shares, n_draws - 1)
        return cls(block=block, draw=draw, first=lane[0], row=row[1:] - 1, lane=lane[1:])


class OfPoints:
    """What samplers that go from point to point ask for, of a model under a record; see :meth:`Lanes.of_points`.

    Half of what one draw costs is the preparation, which is the same for every draw. What comes of a draw does not
    depend on those beside it, to the last bit.

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
        self._places = cache(lambda n_draws: _Places.of(model, problem, n_draws))

    def __call__(self, values: Floats, measured: Floats) -> tuple[Floats, Floats]:
        """Squared residuals ``(n_draws, n_blocks)`` and their derivatives ``(n_draws, n_blocks, n_parameters)``.

        Parameters
        ----------
        values : (n_draws, n_parameters) array
            In their own units; no more draws than there are lanes.
        measured : (n_channels, n_times) array
        """
        n_draws, places = len(values), self._places(len(values))
        local = self._model.table.local(values)[:, :, : len(self._model.law.parameters)]
        local[~np.all(np.isfinite(local), axis=(1, 2))] = np.nan
        block = replace(places.block, parameters=np.moveaxis(local[places.draw], 0, 2))
        sums, slopes = [], []
        for part, outcome in self._problem.run(self._engine, block, store=True):
            c = len(part.channels.names)
            stored = outcome.stored.reshape(-1, 1 + block.directions.n, c, LANES)[:, :, part.rows]
            rest = measured[part.rows, part.stretch.samples].T[..., None] - stored[:, 0]
            own = np.zeros((n_draws, stored.shape[2], self._problem.n_parameters))
            with np.errstate(over="ignore", invalid="ignore"):  # a draw that runs away
                sums.append(np.sum(np.square(rest), axis=0)[:, places.first].T)
                every = -2.0 * np.einsum("tcl,tkcl->klc", rest, stored[:, 1:])
                own[..., block.whole.owner[0]] = np.moveaxis(every[places.row, places.lane], 0, 2)
            slopes.append(own)
        return np.concatenate(sums, axis=1), np.concatenate(slopes, axis=1)
