"""Which derivatives each lane carries: few directions, since the cost of a solve grows with their number.

A parameter that nobody wants, or that acts behind the structure (a sensor's), needs no direction; the same parameter of
two storeys needs one where each draw wants but one of the two. Where few draws leave lanes idle, several lanes take the
same draw and share its parameters out between them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.parameters import Booleans, Floats


@dataclass(frozen=True, kw_only=True)
class Directions:
    """Directions of draws or of lanes, one row each.

    Attributes
    ----------
    moved : (n_parameters, n_links) array
        Column of the table of partials that a parameter moves at each link, ``nowhere`` where it does not act.
    nowhere : int
        Column of zeros.
    owner : (n_rows, n_directions) array
        Parameter whose derivative it is, -1 where nobody's.
    """

    moved: NDArray[np.int64]
    nowhere: int
    owner: NDArray[np.int64]

    @property
    def n(self) -> int:
        """Number of directions."""
        return int(self.owner.shape[1])

    @cached_property
    def seed(self) -> NDArray[np.int64]:
        """Column of the table of partials that each direction moves, ``(n_rows, n_directions, n_links)``."""
        nobody = np.full((1, self.moved.shape[1]), self.nowhere, dtype=np.int64)
        return np.concatenate([self.moved, nobody])[self.owner]

    @property
    def active(self) -> Floats:
        """One where a row's direction moves anything at a link, ``(n_rows, n_directions, n_links)``, else zero."""
        return np.asarray(self.seed != self.nowhere, dtype=np.float64)

    def column(self, own: int) -> NDArray[np.int64]:
        """Column ``(n_directions, n_links)`` that all rows move which move anything; ``own`` where they differ."""
        moves = self.seed != self.nowhere
        first = np.max(np.where(moves, self.seed, -1), axis=0, initial=-1)
        same = np.all(~moves | (self.seed == first), axis=0)
        return np.where(np.any(moves, axis=0), np.where(same, first, own), self.nowhere)

    def arrays(self, own: int) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
        """:attr:`seed`, :meth:`column` and :attr:`active` as a kernel takes them, rows last."""
        return np.moveaxis(self.seed, 0, 2).ravel(), self.column(own).ravel(), np.moveaxis(self.active, 0, 2).ravel()

    @classmethod
    def of(cls, moved: NDArray[np.int64], nowhere: int, wanted: Booleans) -> Directions:
        """Directions for the parameters that move ``moved[parameter, storey]`` and that each draw wants.

        Parameters
        ----------
        moved : (n_parameters, n_links) array
            Column of the table of partials, ``nowhere`` where a parameter does not act.
        nowhere : int
            Column of zeros.
        wanted : (n_draws, n_parameters) boolean array
        """
        some = np.flatnonzero(np.any(moved != nowhere, axis=1) & np.any(wanted, axis=0))
        may_share = _may_share(moved[some], nowhere, wanted[:, some])
        groups: list[list[int]] = []
        welcome: list[Booleans] = []  # of each group, who may share a direction with all of it
        for own in range(len(some)):
            number = next((i for i, group in enumerate(welcome) if group[own]), len(groups))
            if number == len(groups):
                groups.append([own])
                welcome.append(may_share[own].copy())
            else:
                groups[number].append(own)
                welcome[number] &= may_share[own]
        owner = np.full((len(wanted), len(groups)), -1, dtype=np.int64)
        for direction, group in enumerate(groups):
            for own in some[group]:
                owner[wanted[:, own], direction] = own
        return cls(moved=moved, nowhere=nowhere, owner=owner)

    def at(self, rows: NDArray[np.int64]) -> Directions:
        """Of some of the rows, in their order."""
        return replace(self, owner=self.owner[rows])

    def divided(self, n_shares: int) -> Directions:
        """Each row as ``n_shares`` rows one after the other, which carry its parameters between them."""
        own = [row[row >= 0] for row in self.owner]
        each = max(-(-len(row) // n_shares) for row in own)
        owner = np.full((len(own), n_shares * each), -1, dtype=np.int64)
        for i, row in enumerate(own):
            owner[i, : len(row)] = row
        return replace(self, owner=owner.reshape(len(own) * n_shares, each))

    def of_parameters(self, n_parameters: int) -> Floats:
        """One where a direction is a parameter's, ``(n_rows, n_directions, n_parameters)``, else zero."""
        return np.equal(self.owner[..., None], np.arange(n_parameters)).astype(np.float64)


def _may_share(moved: NDArray[np.int64], nowhere: int, wanted: Booleans) -> Booleans:
    """Whether no draw wants both of two parameters and both move the same where they act together, ``(n, n)``.

    At every pair at once: with a hundred parameters they are thousands, which took a tenth of a short record's time.
    """
    acts = moved != nowhere
    both_act = acts[:, None] & acts
    other = np.any(both_act & (moved[:, None] != moved), axis=2)
    counts = wanted.astype(np.float64)
    return np.asarray(~other & (counts.T @ counts == 0.0))
