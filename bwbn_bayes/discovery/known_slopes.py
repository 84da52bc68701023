"""Points moved by one step along slopes that are known from elsewhere: a first look for the price of plain solves.

Derivatives cost ten times a solve. Those of the parameters that a model has already change little while an effect is
tried beside them, so that one set of them serves every candidate; the size of the effect has a slope of its own at
each, taken by moving it a little.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.inference.least_squares import squares_of
from bwbn_bayes.inference.likelihood import Linearisation, Posterior
from bwbn_bayes.inference.modes import steps
from bwbn_bayes.inference.slopes import Slopes
from bwbn_bayes.parameters import Floats

_DAMPINGS = (1e-4, 1.0)
"""Of the step; the better one is taken."""


def suited(
    view: Posterior,
    slopes: Slopes,
    columns: NDArray[np.int64],
    points: Floats,
    *,
    beside: tuple[NDArray[np.int64], Floats, NDArray[np.int64]] | None = None,
) -> tuple[Floats, Floats]:
    """Points moved to where known slopes lead, if that is better, and their log likelihoods.

    Parameters
    ----------
    view : Posterior
        Target.
    slopes : Slopes
        Of the coordinates in ``columns``, near the points.
    columns : (n_slopes,) array
    points : (n, n_dim) array
        In the unit cube.
    beside : ((n,) array, (m, n_dim) array, (n,) array), optional
        One more coordinate of each point, points at which it has another value, and which of those belongs to each.

    Returns
    -------
    points : (n, n_dim) array
    log_likelihood : (n,) array
        There.
    """
    n, rows = len(points), np.arange(len(points))
    others = points[:0] if beside is None else beside[1]
    response = view.engine.simulate(view.model, view.split(np.concatenate([points, others]))[0], view.record).values
    residual = slopes.scaled(slopes.record.measured - response[:n])
    left = np.nan_to_num(residual.reshape(n, -1), posinf=0.0, neginf=0.0)
    gradient, information = np.zeros(points.shape), np.zeros((n, points.shape[1], points.shape[1]))
    gradient[:, columns] = left @ slopes.base
    information[np.ix_(rows, columns, columns)] = slopes.base.T @ slopes.base
    free = np.zeros(points.shape, dtype=np.bool_)
    free[:, columns] = True
    if beside is not None:
        switch, _, of_each = beside
        rise = slopes.scaled(response[:n] - response[n + of_each]).reshape(n, -1)
        own = rise / (points[rows, switch] - others[of_each, switch])[:, None]
        own = np.nan_to_num(own, posinf=0.0, neginf=0.0)
        gradient[rows, switch] = np.sum(own * left, axis=1)
        across = own @ slopes.base
        information[rows[:, None], switch[:, None], columns] = across
        information[rows[:, None], columns, switch[:, None]] = across
        information[rows, switch, switch] = np.sum(np.square(own), axis=1)
        free[rows, switch] = True
    reached = view.log_likelihood_of(squares_of(view.record, response[:n], view.noise.correlation), points)
    local = Linearisation(log_likelihood=reached, gradient=gradient, information=information)
    trials = np.stack([points, *(steps(points, local, np.full(n, damping), free) for damping in _DAMPINGS)], axis=1)
    tried = trials[:, 1:].reshape(-1, points.shape[1])
    value = np.where(np.isfinite(view.log_prior(tried)), view.log_likelihood(tried), -np.inf)
    value = np.column_stack([reached, value.reshape(n, -1)])
    best = np.argmax(value, axis=1)
    return trials[rows, best], value[rows, best]
