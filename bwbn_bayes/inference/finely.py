"""The scheme under which a posterior is solved: fine enough at its optimum, and about it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.accuracy import LADDER, Discretisation, choose_scheme, left_out, rung_of
from bwbn_bayes.inference.importance import laplace_mixture, least_likely
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import N_CANDIDATES, Mode, distinct, polish
from bwbn_bayes.parameters import Booleans, Floats

_N_ITERATIONS, _REACH = 20, 50.0
"""Steps to the optima under a scheme, and how far below the best they do not keep it waiting. [nat]"""
_SEED, _N_NEAR = 1, 64
"""Draws about the modes at which a scheme is held against a finer one."""


class Solved(NamedTuple):
    """A posterior under the scheme chosen, its modes, and what the scheme does to it; None where none was chosen."""

    posterior: Posterior
    modes: tuple[Mode, ...]
    discretisation: Discretisation | None


def solve_finely(
    posterior: Posterior,
    points: Floats,
    *,
    first: int = 0,
    substeps: int = 1,
    accepts: Callable[[Discretisation], bool] = lambda facts: facts.acceptable,
    known: tuple[Mode, ...] = (),
    spares: float = 0.0,
) -> Solved:
    """Choose the scheme at the first point and polish all of them under it; finer, where it leaves out what is near.

    Parameters
    ----------
    posterior : Posterior
        An engine that is not of lanes has a tolerance of its own and stays.
    points : (n, n_dim) array
        Optima of a coarse search, the best first.
    first, substeps, accepts
        As of :func:`~bwbn_bayes.inference.accuracy.choose_scheme`.
    known : tuple of Mode
        Those under the posterior's own scheme, where it may stay.
    spares : float
        Log evidence that a scheme may leave out. [nat]
    """
    view, discretisation, engine, rung = posterior, None, posterior.engine, first
    while True:
        if isinstance(engine, Lanes):
            scheme, discretisation = choose_scheme(
                posterior, points[0], engine, first=rung, substeps=substeps, accepts=accepts
            )
            view, rung = posterior.with_engine(scheme), rung_of(scheme, rung) + 1
        stays = bool(known) and view.engine == engine
        modes = known if stays else distinct(*polish(view, points, n_iterations=_N_ITERATIONS, reach=_REACH))
        if discretisation is None or rung == len(LADDER) or not modes:
            break
        near, log_density = _near(view, modes)
        found, exact = left_out(view, near, least_likely(modes[0]))
        if _lost(view.log_prior(near) + exact - log_density, found) <= spares:
            break
        points = np.concatenate([[mode.point for mode in modes], near[found]])[:N_CANDIDATES]
    return Solved(view, modes, discretisation)


def _near(posterior: Posterior, modes: tuple[Mode, ...]) -> tuple[Floats, Floats]:
    """Draws ``(n, n_dim)`` of the approximation at the modes inside the prior, and their log density ``(n,)``."""
    proposal = laplace_mixture(modes)
    draws = proposal.sample(np.random.default_rng(_SEED), _N_NEAR)
    draws = draws[np.isfinite(posterior.log_prior(draws))]
    return draws, proposal.log_density(draws)


def _lost(log_weights: Floats, left: Booleans) -> float:
    """Log evidence [nat] that is lost with some of the weighted draws ``(n,)``."""
    if not np.any(left):
        return 0.0
    if np.all(left):
        return np.inf
    return float(logsumexp(log_weights) - logsumexp(log_weights[~left]))
