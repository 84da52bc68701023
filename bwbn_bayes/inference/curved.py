"""A proposal that follows the bends of a posterior of many parameters, none of which is wide.

What a record knows well, say the time that a wave takes up a building, is a curved function of many parameters, each
of which is known well too. Along a straight line in the directions known least the fit then falls by hundreds of nats
within two standard deviations of Laplace's approximation, in many dimensions at once. Held there, the other directions
have their optimum elsewhere: a step or two of least squares away, whose derivatives are those at the mode, so that it
costs plain solves. Through such optima goes a quadratic surface, about which the posterior is all but normal.

References
----------
.. [1] J. M. Bardsley, A. Solonen, H. Haario and M. Laine, "Randomize-Then-Optimize: A Method for Sampling from
   Posterior Distributions in Nonlinear Inverse Problems", SIAM J. Sci. Comput. 36(4), 2014, doi:10.1137/140964023
   (draws that are normal in the residuals, cited from memory, not consulted; here their mean surface alone is followed,
   which leaves the density known in closed form).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.special import gammaln

from bwbn_bayes.engines.lane_source import LANES
from bwbn_bayes.inference.identifiability import PRIOR_PRECISION
from bwbn_bayes.inference.importance import Mixture, Proposal, laplace_mixture
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.slopes import Slopes
from bwbn_bayes.inference.truncated import Bend
from bwbn_bayes.parameters import Floats

_SINGLE, _DOUBLE = 1.5, 1.2
"""Standard deviations at which one direction is held, and each of two."""
_N_STEPS, _THERE, _LOST = 10, 0.02, 0.5
"""Steps at most, their length that ends them, and that of the last beyond which a point is left out. [sd]"""
_EDGE = 1e-6
_WITHIN = 30.0
"""Modes so far below the best have no part. [nat]"""
_FORESEEN = 5.0
"""A mode that a component holds for as likely as it is, to so many nats, needs none of its own."""
_SHARES, _INFLATIONS, _DEGREES = (0.75, 0.15, 0.1), (1.05, 1.6), 8.0
"""Of the component, of a wider Student-t for the tails, and of what the modes alone suggest; factors on variances."""

Gradients = Callable[[Floats], Floats]
"""Of the log likelihood at points ``(n, n_dim)`` of the unit cube, with the residual's derivatives of one of them."""


@dataclass(frozen=True, kw_only=True)
class Curved:
    """Normal, or Student-t, about a quadratic surface over the directions that are known least.

    Attributes
    ----------
    point : (n_dim,) array
        Where it is centred, in the unit cube.
    axes : (n_dim, n_dim) array
        A standard deviation along each direction, in columns, the widest first.
    bend : Bend
        Shift of the later directions by the first ones.
    variance, degrees : float
        Factor on all variances; degrees of freedom, infinite for the normal.
    """

    point: Floats
    axes: Floats
    bend: Bend
    variance: float = 1.0
    degrees: float = np.inf

    @classmethod
    def at(cls, mode: Mode, gradients: Gradients) -> Self | None:
        """About the surface through a mode on which half of the directions, the widest, are followed by the others.

        None where too few of the points that it is read off could be reached.
        """
        values, vectors = np.linalg.eigh(mode.information)
        axes = vectors / np.sqrt(np.maximum(values, PRIOR_PRECISION))
        n_wide = len(axes) // 2
        held = _design(n_wide)
        shift, steps = _followed(mode.point, axes, held, gradients)
        reached = np.isfinite(steps) & (steps < _LOST)
        bend = Bend(n_wide=n_wide, coefficients=np.zeros((n_wide * (n_wide + 3) // 2, len(axes))))
        features = np.column_stack([np.ones(len(held)), bend.features(held)])[reached]
        if len(features) < features.shape[1]:
            return None
        found, *_ = np.linalg.lstsq(features, shift[reached], rcond=1e-8)
        bend.coefficients[:, n_wide:] = found[1:]
        return cls(point=mode.point + axes[:, n_wide:] @ found[0], axes=axes, bend=bend)

    def inflated(self, variance: float, degrees: float = np.inf) -> Self:
        """The same with all variances times a factor, and with other tails."""
        return replace(self, variance=variance * self.variance, degrees=degrees)

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draws ``(n, n_dim)``; some may lie outside the cube."""
        standard = np.sqrt(self.variance) * rng.standard_normal((n, len(self.point)))
        if np.isfinite(self.degrees):
            standard *= np.sqrt(self.degrees / rng.chisquare(self.degrees, n))[:, None]
        return np.asarray(self.point + (standard + self.bend(standard[:, : self.bend.n_wide])) @ self.axes.T)

    def log_density(self, points: Floats) -> Floats:
        """Normalised log density ``(n,)`` over all of space: the bend is a shear and changes no volume."""
        n_dim = len(self.point)
        squared = np.sum(np.square(self.standardised(points)), axis=1) / self.variance
        volume = np.linalg.slogdet(self.axes)[1] + 0.5 * n_dim * np.log(self.variance)
        if np.isinf(self.degrees):
            return np.asarray(-0.5 * squared - 0.5 * n_dim * np.log(2.0 * np.pi) - volume)
        end = 0.5 * (self.degrees + n_dim)
        constant = gammaln(end) - gammaln(0.5 * self.degrees) - 0.5 * n_dim * np.log(self.degrees * np.pi)
        return np.asarray(constant - end * np.log1p(squared / self.degrees) - volume)

    def standardised(self, points: Floats) -> Floats:
        """Deviations ``(n, n_dim)`` from the surface in standard deviations."""
        straight = np.linalg.solve(self.axes, (points - self.point).T).T
        return np.asarray(straight - self.bend(straight[:, : self.bend.n_wide]))

    def foresees(self, mode: Mode, best: Mode) -> bool:
        """Whether a mode is about as far below the best one as it is under this density."""
        below = 0.5 * float(np.sum(np.square(self.standardised(mode.point[None])))) / self.variance
        return below < best.log_likelihood - mode.log_likelihood + _FORESEEN


def curved_mixture(posterior: Posterior, modes: Sequence[Mode]) -> Mixture | None:
    """Curved components at the modes, best first, that those before do not foresee, and what the modes alone suggest.

    None where no surface goes through any.
    """
    found: list[Curved] = []
    near = [mode for mode in modes if mode.log_likelihood > modes[0].log_likelihood - _WITHIN]
    for mode in near:
        if not any(one.foresees(mode, near[0]) for one in found):
            own = Curved.at(mode, gradients_at(posterior, mode.point))
            found += [own] if own is not None else []
    if not found:
        return None
    normal, wider, plain = _SHARES
    tight, wide = _INFLATIONS
    components: list[Proposal] = [one.inflated(tight) for one in found]
    components += [one.inflated(wide, _DEGREES) for one in found]
    weights = [share / len(found) for share in (normal, wider) for _ in found]
    return Mixture(weights=(*weights, plain), components=(*components, laplace_mixture(modes)))


def gradients_at(posterior: Posterior, point: Floats) -> Gradients:
    """By the derivatives at a point ``(n_dim,)``, for the price of plain solves; parameters of the noise stay."""
    slopes = Slopes.at(posterior, point)

    def gradients(points: Floats) -> Floats:
        posterior.solves.add(len(points))
        values, _ = posterior.split(np.clip(points, _EDGE, 1.0 - _EDGE))
        result = np.zeros((len(points), posterior.n_dim))
        # A few at a time: of a long record the responses of all are more than memory holds.
        for first in range(0, len(points), LANES):
            response = posterior.engine.simulate(posterior.model, values[first : first + LANES], posterior.record)
            left = slopes.scaled(slopes.record.measured - response.values).reshape(len(response.values), -1)
            result[first : first + LANES, : slopes.base.shape[1]] = left @ slopes.base
        return result

    return gradients


def _design(n_wide: int) -> Floats:
    """Standard deviations ``(n, n_wide)`` at which the widest directions are held: none, one of either sign, two."""
    unit = np.eye(n_wide)
    pairs = [unit[i] + unit[j] for i in range(n_wide) for j in range(i)]
    return np.array([np.zeros(n_wide), *(_SINGLE * unit), *(-_SINGLE * unit), *(_DOUBLE * pair for pair in pairs)])


def _followed(point: Floats, axes: Floats, held: Floats, gradients: Gradients) -> tuple[Floats, Floats]:
    """Where the later directions have their optimum with the first ones held, and the last step to there.

    Returns
    -------
    shift : (n, n_dim - n_wide) array
        In standard deviations.
    steps : (n,) array
        Largest of the last step; not finite where the model could not be solved.
    """
    n_wide = held.shape[1]
    wide, later = axes[:, :n_wide], axes[:, n_wide:]
    shift, steps = np.zeros((len(held), later.shape[1])), np.full(len(held), np.inf)
    waits = np.arange(len(held))
    for _ in range(_N_STEPS):
        step = gradients(point + held[waits] @ wide.T + shift[waits] @ later.T) @ later
        shift[waits] += step
        steps[waits] = np.max(np.abs(step), axis=1)
        waits = waits[steps[waits] > _THERE]  # what is not finite does not wait
        if len(waits) == 0:
            break
    return shift, steps
