"""Which derivatives the lanes carry: parameters that no draw wants together share a direction.

The cost of a solve with derivatives grows with the number of directions. A parameter that nobody wants, or that acts
behind the structure (a sensor's), needs none; the same parameter of two storeys needs one where each draw wants but
one of the two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.parameters import Booleans, Floats


@dataclass(frozen=True, kw_only=True)
class Directions:
    """Directions of one call.

    Attributes
    ----------
    seed : (n_directions, n_storeys) array
        Column of the table of partials that each moves at each storey.
    active : (n_draws, n_directions, n_storeys) array
        One where it moves there for the draw, else zero.
    owner : (n_draws, n_directions) array
        Parameter whose derivative it is, -1 where nobody's.
    """

    seed: NDArray[np.int64]
    active: Floats
    owner: NDArray[np.int64]

    @property
    def n(self) -> int:
        """Number of directions."""
        return len(self.seed)

    @classmethod
    def of(cls, moved: NDArray[np.int64], nowhere: int, wanted: Booleans) -> Directions:
        """Directions for the parameters that move ``moved[parameter, storey]`` and that each draw wants.

        Parameters
        ----------
        moved : (n_parameters, n_storeys) array
            Column of the table of partials, ``nowhere`` where a parameter does not act.
        nowhere : int
            Column of zeros.
        wanted : (n_draws, n_parameters) boolean array
        """
        acts = moved != nowhere
        groups: list[list[int]] = []
        for own in np.flatnonzero(np.any(acts, axis=1) & np.any(wanted, axis=0)).tolist():
            for group in groups:
                if all(_may_share(own, other, moved, acts, wanted) for other in group):
                    group.append(own)
                    break
            else:
                groups.append([own])
        seed = np.full((len(groups), moved.shape[1]), nowhere, dtype=np.int64)
        active = np.zeros((len(wanted), *seed.shape))
        owner = np.full((len(wanted), len(groups)), -1, dtype=np.int64)
        for direction, group in enumerate(groups):
            for own in group:
                seed[direction, acts[own]] = moved[own, acts[own]]
                active[:, direction] += np.outer(wanted[:, own], acts[own])
                owner[wanted[:, own], direction] = own
        return cls(seed=seed, active=active, owner=owner)

    def of_parameters(self, rows: slice, n_parameters: int) -> Floats:
        """One where a direction is a parameter's, ``(n_draws, n_directions, n_parameters)``, for some of the draws."""
        return np.equal(self.owner[rows][..., None], np.arange(n_parameters)).astype(np.float64)


NONE = Directions(
    seed=np.zeros((0, 1), dtype=np.int64), active=np.zeros((0, 0, 1)), owner=np.zeros((0, 0), dtype=np.int64)
)
"""No derivatives."""


def _may_share(one: int, other: int, moved: NDArray[np.int64], acts: Booleans, wanted: Booleans) -> bool:
    """Whether no draw wants both, and both move the same where they act together."""
    both = acts[one] & acts[other]
    return not np.any(wanted[:, one] & wanted[:, other]) and bool(np.all(moved[one, both] == moved[other, both]))
