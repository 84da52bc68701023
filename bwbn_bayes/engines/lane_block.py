"""Draws that are solved together, and the lanes that they fill."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.engines.directions import Directions
from bwbn_bayes.engines.lane_source import LANES
from bwbn_bayes.parameters import Floats

_WORTH_SHARING = 4
"""Directions from which on a draw is worth several lanes."""


@dataclass(frozen=True, kw_only=True)
class Block:
    """Draws and the lanes they fill: ``n_shares`` each, one after the other.

    Attributes
    ----------
    rows : slice
        The draws.
    whole : Directions
        Of the draws.
    directions : Directions
        Of the lanes; those left over repeat the last one.
    parameters : (n_links, n_law, n_lanes) array
    sensor_parameters : (n_draws, n_links, n_sensor_parameters) array
    """

    rows: slice
    n_shares: int
    whole: Directions
    directions: Directions
    parameters: Floats
    sensor_parameters: Floats

    @property
    def n_draws(self) -> int:
        """How many they are."""
        return int(self.rows.stop - self.rows.start)

    @property
    def n_lanes(self) -> int:
        """How many lanes there are."""
        return int(self.parameters.shape[2])

    @classmethod
    def of(cls, local: Floats, n_law: int, directions: Directions, start: int, n_lanes: int = LANES) -> Block:
        """The block of draws from ``start``, given the parameters and directions of all draws."""
        n_draws = min(n_lanes, len(local) - start)
        rows = slice(start, start + n_draws)
        whole = directions.at(np.arange(start, rows.stop))
        n_shares = n_lanes // n_draws if whole.n >= _WORTH_SHARING else 1
        own = whole.divided(n_shares) if n_shares > 1 else whole
        lanes = np.minimum(np.arange(n_lanes), n_draws * n_shares - 1)
        return cls(
            rows=rows,
            n_shares=n_shares,
            whole=whole,
            directions=own.at(lanes),
            parameters=np.moveaxis(local[start + lanes // n_shares, :, :n_law], 0, 2),
            sensor_parameters=local[rows, :, n_law:],
        )

    def sources(self, n_parameters: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Where the lanes hold each draw's values, in row 0, and each of its directions; row -1 where nobody's.

        Returns
        -------
        row, lane : (1 + n_directions, n_draws) arrays
        """
        first = np.arange(self.n_draws) * self.n_shares
        own = self.directions.owner[: self.n_draws * self.n_shares]
        held = np.full((self.n_draws, n_parameters + 1, 2), -1, dtype=np.int64)
        lane, direction = np.nonzero(own >= 0)
        held[lane // self.n_shares, own[lane, direction]] = np.stack([1 + direction, lane], axis=1)
        row, lane = np.moveaxis(held[np.arange(self.n_draws), self.whole.owner.T], 2, 0)
        return np.concatenate([0 * first[None], row]), np.concatenate([first[None], lane])
