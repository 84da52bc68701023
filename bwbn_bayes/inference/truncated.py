"""Multivariate Student-t truncated to the unit cube, with an exactly normalised density.

Coordinates are drawn one after another from their truncated conditionals, as in the GHK simulator; the product of those
conditionals is the density, so neither rejection nor a box probability is needed.

References
----------
.. [1] V. A. Hajivassiliou, D. McFadden and P. Ruud, "Simulation of Multivariate Normal Rectangle Probabilities and
   their Derivatives", J. Econometrics 72, 1996, doi:10.1016/0304-4076(94)01716-6.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, log_ndtr, ndtri_exp, stdtr, stdtrit

from bwbn_bayes.inference.identifiability import PRIOR_PRECISION
from bwbn_bayes.parameters import Floats

_TINY = 1e-300
_LOG_ROOT_TWO_PI = 0.5 * float(np.log(2.0 * np.pi))


@dataclass(frozen=True, kw_only=True)
class TruncatedStudent:
    """Sequentially truncated Student-t (normal where ``degrees`` is infinite) on the unit cube.

    Attributes
    ----------
    mean : (n_dim,) array
        Location before truncation, in the order of ``order``; it may lie outside the cube.
    factor : (n_dim, n_dim) array
        Lower Cholesky factor of the scale matrix in that order.
    order : (n_dim,) integer array
        Coordinates in the order in which they are drawn: those nearest to a bound first.
    degrees : float
        Degrees of freedom.
    """

    mean: Floats
    factor: Floats
    order: NDArray[np.int64]
    degrees: float = np.inf

    @classmethod
    def at(
        cls,
        point: Floats,
        gradient: Floats,
        information: Floats,
        *,
        inflation: float = 1.0,
        degrees: float = np.inf,
        flattest: float = PRIOR_PRECISION,
    ) -> Self:
        """Quadratic expansion of a log posterior at a point: mean one Newton step away, scale the inverse information.

        Parameters
        ----------
        point, gradient : (n_dim,) array
            Expansion point in the unit cube and the gradient of the log posterior there.
        information : (n_dim, n_dim) array
            Gauss-Newton information in unit coordinates.
        inflation : float
            Factor on the scale matrix.
        degrees : float
            Degrees of freedom.
        flattest : float
            Least information of a direction: by default directions flatter than the prior get the prior's variance.
        """
        values, vectors = np.linalg.eigh(information)
        # What is flatter than rounding shows as flat as rounding can.
        covariance = (vectors / np.maximum(values, max(flattest, 1e-12 * values[-1]))) @ vectors.T
        mean = point + covariance @ gradient
        return cls.of(mean, inflation * covariance, degrees=degrees)

    @classmethod
    def of(cls, mean: Floats, covariance: Floats, *, degrees: float = np.inf) -> Self:
        """From a location and a scale matrix, in the natural order of the coordinates."""
        sd = np.sqrt(np.diag(covariance))
        order = np.argsort(np.minimum(mean, 1.0 - mean) / sd)
        return cls(
            mean=mean[order], factor=np.linalg.cholesky(covariance[np.ix_(order, order)]), order=order, degrees=degrees
        )

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draws ``(n, n_dim)``."""
        return self.at_uniforms(rng.random((n, len(self.mean))))[0]

    def at_uniforms(self, uniforms: Floats) -> tuple[Floats, Floats]:
        """Draws ``(n, n_dim)`` that uniform numbers of that shape make, and their log density ``(n,)``."""
        ordered, log_density = walk(self.mean, self.factor, self.degrees, uniforms=uniforms)
        points = np.empty_like(ordered)
        points[:, self.order] = ordered
        return points, log_density

    def log_density(self, points: Floats) -> Floats:
        """Normalised log density ``(n,)``; minus infinity outside the cube."""
        inside = np.all((points >= 0.0) & (points <= 1.0), axis=1)
        _, log_density = walk(self.mean, self.factor, self.degrees, points=points[:, self.order])
        return np.where(inside, log_density, -np.inf)


@dataclass(frozen=True, kw_only=True)
class Bend:
    """A quadratic shift of later coordinates by the deviations of the first ``n_wide`` from their means.

    ``coefficients`` is ``(n_features, n_dim)`` over the products ``d_i d_j`` (i <= j) and then ``d_i``; columns of the
    first ``n_wide`` coordinates are zero, so that the map is a shear and densities keep their normalisation.
    """

    n_wide: int
    coefficients: Floats

    def features(self, deviations: Floats) -> Floats:
        """Quadratic and linear features ``(n, n_features)`` of deviations ``(n, n_wide)``."""
        i, j = np.triu_indices(self.n_wide)
        return np.hstack([deviations[:, i] * deviations[:, j], deviations])

    def __call__(self, deviations: Floats) -> Floats:
        """Shift ``(n, n_dim)``."""
        return self.features(deviations) @ self.coefficients


def walk(
    mean: Floats,
    factor: Floats,
    degrees: float,
    *,
    points: Floats | None = None,
    uniforms: Floats | None = None,
    bend: Bend | None = None,
) -> tuple[Floats, Floats]:
    """Visit the coordinates in order; return the points and their log density.

    Parameters
    ----------
    mean : (n_dim,) or (n, n_dim) array
        Location before truncation.
    factor : (n_dim, n_dim) or (n, n_dim, n_dim) array
        Lower Cholesky factor of the scale matrix.
    degrees : float
        Degrees of freedom, infinite for the normal.
    points, uniforms : (n, n_dim) array
        Points to evaluate, or uniform random numbers to turn into points; give one of them.
    bend : Bend, optional
        Curvature of the later coordinates' means.
    """
    given = points if points is not None else uniforms
    if given is None:
        raise ValueError("walk needs points or uniforms")
    n, d = given.shape
    mean, factor = np.broadcast_to(mean, (n, d)), np.broadcast_to(factor, (n, d, d))
    result, standard = np.array(given), np.zeros((n, d))
    log_density, radius = np.zeros(n), np.zeros(n)
    for i in range(d):
        if bend is not None and i == bend.n_wide:
            mean = mean + bend(result[:, :i] - mean[:, :i])
        stretch = np.sqrt((degrees + radius) / (degrees + i)) if np.isfinite(degrees) else np.ones(n)
        centre = mean[:, i] + np.einsum("nj,nj->n", factor[:, i, :i], standard[:, :i])
        width = factor[:, i, i] * stretch
        low, high = -centre / width, (1.0 - centre) / width
        if points is None:
            x = np.clip(_draw(given[:, i], low, high, degrees + i), low, high)
            result[:, i] = np.clip(centre + width * x, 0.0, 1.0)
        else:
            x = (points[:, i] - centre) / width
        log_density += _log_pdf(x, degrees + i) - np.log(width) - _log_mass(low, high, degrees + i)
        standard[:, i] = x * stretch
        radius += standard[:, i] ** 2
    return result, log_density


def _flip(low: Floats, high: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Mirror intervals that lie in the upper tail, where distribution functions lose digits."""
    upper = low > 0.0
    return np.where(upper, -high, low), np.where(upper, -low, high), upper


def _log_cdf(x: Floats, degrees: float) -> Floats:
    """Log distribution function; the normal's without the floor that a probability has 38 standard deviations out."""
    return np.asarray(np.log(np.maximum(stdtr(degrees, x), _TINY)) if np.isfinite(degrees) else log_ndtr(x))


def _log_mass(low: Floats, high: Floats, degrees: float) -> Floats:
    low, high, _ = _flip(low, high)
    top = _log_cdf(high, degrees)
    return top + np.log(np.maximum(-np.expm1(_log_cdf(low, degrees) - top), _TINY))


def _draw(uniform: Floats, low: Floats, high: Floats, degrees: float) -> Floats:
    low, high, upper = _flip(low, high)
    top = _log_cdf(high, degrees)
    share = np.exp(_log_cdf(low, degrees) - top)
    probability = top + np.log(np.maximum(share + uniform * (1.0 - share), _TINY))
    x = np.asarray(stdtrit(degrees, np.exp(probability)) if np.isfinite(degrees) else ndtri_exp(probability))
    return np.where(upper, -x, x)


def _log_pdf(x: Floats, degrees: float) -> Floats:
    """Written out: SciPy's distributions cost more than the rest of a walk where few points are drawn at a time."""
    if np.isinf(degrees):
        return -0.5 * np.square(x) - _LOG_ROOT_TWO_PI
    end = 0.5 * (degrees + 1.0)
    constant = gammaln(end) - gammaln(0.5 * degrees) - 0.5 * np.log(degrees * np.pi)
    return np.asarray(constant - end * np.log1p(np.square(x) / degrees))
