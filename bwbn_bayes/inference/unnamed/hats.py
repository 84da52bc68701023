"""Functions of one variable on many scales, for what may be any continuous function of it.

A function is a sum of triangular hats, coarse and fine, with independent weights whose variance halves from level to
level, a Brownian motion on either side of zero, or falls faster, a smoother process: it may be anything continuous, and
what changes fast costs what it needs. Corners are rounded over the finest spacing, which makes quadratic splines of the
finest hats, so that smooth functions are met closely.

References
----------
.. [1] Z. Ciesielski, "Hölder conditions for realizations of Gaussian processes", Trans. Am. Math. Soc. 99, 1961 (the
   hats of Faber and Schauder and their weights for a Brownian motion).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bwbn_bayes.parameters import Floats

SOURCE = "Ciesielski 1961"
SMOOTHNESS = (0.0, 0.5, 1.0)
"""Beyond a Brownian motion's, over which is integrated: with one half the function changes in proportion to its
variable, up to a logarithm; with one its slope is itself a Brownian motion's, or nearly."""
_N_LEVELS = 5
"""Beyond the coarsest: the finest hats are a thirty-second of the reach wide on either side."""
_ROUNDED = 0.5 ** (_N_LEVELS + 1)
"""Of the reach, over which corners are rounded on either side: half the finest spacing."""


class Hat(NamedTuple):
    """One function of the basis: a triangle with rounded corners, on one side of zero, of a level, about a centre."""

    level: int
    side: int
    centre: float

    @property
    def sd(self) -> float:
        """Of its weight, for a Brownian motion of unit variance at the end of the reach."""
        return float(2.0 ** (-0.5 * (self.level + 1))) if self.level else 1.0

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """Where it would bend, and half by how much; the coarsest stays at one beyond the reach, the others vanish."""
        if self.level == 0:
            return (0.0, 0.5), (float(self.side), -0.5)
        wide = 2.0**-self.level
        places = (self.side * (self.centre + step * wide) for step in (-1.0, 0.0, 1.0))
        return tuple(zip(places, (0.5 / wide, -1.0 / wide, 0.5 / wide), strict=True))

    @property
    def knots(self) -> tuple[tuple[float, float], ...]:
        """Where its second derivative jumps, with factors of ``x |x|`` about there, whose differences round corners."""
        factor = 0.25 / _ROUNDED
        return tuple((at + step * _ROUNDED, -step * factor * by) for at, by in self.corners for step in (1.0, -1.0))

    def over(self, x: Floats) -> Floats:
        """Its value."""
        bent = sum(by * (x - at) * np.abs(x - at) for at, by in self.knots)
        return np.asarray(bent + (0.5 if self.level == 0 else 0.0))


HATS = tuple(
    Hat(level, side, centre)
    for level in range(_N_LEVELS + 1)
    for side in (1, -1)
    for centre in (np.arange(1, 2**level, 2) / 2**level if level else (1.0,))
)
"""The coarsest first, of both sides of zero."""


def smoothed(smoothness: float) -> Floats:
    """Standard deviations of weights ``(n_weights,)`` over those of a Brownian motion."""
    return np.array([2.0 ** (-smoothness * hat.level) for hat in HATS])
