"""Fits of one model to variants of its record, all beside each other in the lanes: without some samples, with errors.

From the fit to the record itself the first Gauss-Newton step is exact for a linear model; a few more follow it where
it is bent. Fits to records with errors drawn anew spread as the posterior of the parameters does: for a linear model
exactly, and along the bends of a posterior where Laplace's approximation leaves it.

References
----------
.. [1] D. S. Oliver, N. He and A. C. Reynolds, "Conditioning Permeability Fields to Pressure Data", ECMOR V, 1996,
   doi:10.3997/2214-4609.201406884 (randomised maximum likelihood; cited from memory, not consulted).
.. [2] J. M. Bardsley, A. Solonen, H. Haario and M. Laine, "Randomize-Then-Optimize: A Method for Sampling from
   Posterior Distributions in Nonlinear Inverse Problems", SIAM J. Sci. Comput. 36(4), 2014, doi:10.1137/140964023
   (cited from memory, not consulted).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bwbn_bayes.inference.identifiability import PRIOR_PRECISION
from bwbn_bayes.inference.likelihood import Linearisation, Posterior
from bwbn_bayes.inference.modes import steps
from bwbn_bayes.inference.slopes import Slopes
from bwbn_bayes.parameters import Booleans, Floats

_LEAST_DAMPING, _DAMPED = 0.01, 10.0
"""Share of the curvature by which a step is held back after one that fitted worse, and the factor by which it grows."""
_MOST_NUMBERS = 2e7
"""In the derivatives of all fits at a time: memory bounds them in long records."""


class Refits(NamedTuple):
    """Where fits to variants of a record have come to."""

    points: Floats
    """``(n, n_dim)``, in the unit cube."""
    values: Floats
    """Responses there ``(n, n_channels, n_times)``. [unit of the channel]"""


def refitted(
    posterior: Posterior,
    slopes: Slopes,
    points: Floats,
    n_steps: int,
    *,
    counts: Floats | float = 1.0,
    errors: Floats | float = 0.0,
    free: Booleans | None = None,
) -> Refits:
    """Fit a model to each of some variants of its record, from a point each, to the last step that fits better.

    Parameters
    ----------
    posterior : Posterior
        Of the record itself.
    slopes : Slopes
        Of the fit to that: its noise and correlation are those of every fit.
    points : (n, n_dim) array
        Where to start, in the unit cube.
    n_steps : int
        Of each fit.
    counts : (n, 1, n_times) array, optional
        One, or zero for the samples that a variant does without.
    errors : (n, n_channels, n_times) array, optional
        What a variant has beyond the record, as the likelihood sees it: whitened, over the noise.
    free : (n_dim,) boolean array, optional
        Coordinates that may move; those at bounds on which they press stay.
    """
    n = len(points)
    counts = np.broadcast_to(counts, (n, 1, posterior.record.n_times))
    errors = np.broadcast_to(errors, (n, *posterior.record.measured.shape))
    allowed = None if free is None else np.tile(free, (n, 1))
    points = points.copy()
    values, local = _expanded(posterior, slopes, points, counts, errors)
    damping = np.zeros(n)
    for _ in range(n_steps):
        trials = steps(points, local, damping, allowed)
        found, there = _expanded(posterior, slopes, trials, counts, errors)
        better = np.flatnonzero(there.log_likelihood > local.log_likelihood)
        points[better], values[better] = trials[better], found[better]
        local = local.with_rows(better, there[better])
        worse = np.setdiff1d(np.arange(n), better)
        damping /= _DAMPED
        damping[worse] = np.maximum(_DAMPED**2 * damping[worse], _LEAST_DAMPING)
    return Refits(points, values)


def _expanded(
    posterior: Posterior, slopes: Slopes, points: Floats, counts: Floats, errors: Floats
) -> tuple[Floats, Linearisation]:
    """Channels ``(n, n_channels, n_times)`` at points, and the log likelihood of each variant to second order there."""
    record, (n, n_dim) = posterior.record, points.shape
    values = np.empty((n, *record.measured.shape))
    reached, gradient, information = np.empty(n), np.empty((n, n_dim)), np.empty((n, n_dim, n_dim))
    posterior.solves.add(n)
    for some in np.array_split(np.arange(n), min(n, int(np.ceil(n * n_dim * record.measured.size / _MOST_NUMBERS)))):
        own = posterior.split(points[some])[0]
        response, by_value = posterior.engine.sensitivities(posterior.model, own, record)
        values[some] = response.values
        with np.errstate(over="ignore", invalid="ignore"):
            left = (slopes.scaled(record.measured - response.values) + errors[some]) * counts[some]
            left = left.reshape(len(some), -1, 1)
            unit = posterior.space.unit_scale(own)[:, :, None, None]
            base = (slopes.scaled(by_value) * unit * counts[some, None]).reshape(len(some), n_dim, -1)
            reached[some] = -0.5 * np.sum(np.square(left), axis=(1, 2))
            gradient[some] = (base @ left)[:, :, 0]
            information[some] = base @ np.swapaxes(base, 1, 2) + PRIOR_PRECISION * np.eye(n_dim)
    solved = np.isfinite(reached) & np.all(np.isfinite(information), axis=(1, 2))
    failed = ~(solved & np.isfinite(posterior.log_prior(points)))
    reached[failed], gradient[failed], information[failed] = -np.inf, 0.0, np.eye(n_dim)
    return values, Linearisation(log_likelihood=reached, gradient=gradient, information=information)
