"""Laplace's approximation of an evidence: the integral over the unit cube of the expansions at the optima."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, ndtri
from scipy.stats import qmc

from bwbn_bayes.inference.identifiability import PRIOR_PRECISION
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.truncated import TruncatedStudent
from bwbn_bayes.parameters import Booleans, Floats

Integers = NDArray[np.int64]

_N_DESIGN = 64
"""Points by which the mass of an expansion in the cube is told, to a few hundredths."""
_AT_A_FACE = 1e-5
"""Distance to a bound within which an optimum presses on it."""
_STEEP = 1e3
"""Standard deviations beyond a bound from which a normal density falls off within it as an exponential one."""
_NONE = np.empty(0, dtype=np.int64)


def laplace_log_evidence(modes: Sequence[Mode], standard: Integers = _NONE) -> float:
    """Laplace's approximation of the log evidence, summed over the modes, for a prior of density one.

    Parameters
    ----------
    modes : sequence of Mode
        Optima.
    standard : (n,) integer array
        Coordinates of normal priors, which are expanded in their standard normals and not in the cube.
    """
    return float(logsumexp([laplace_mass(mode, standard) for mode in modes]))


def laplace_mass(mode: Mode, standard: Integers = _NONE) -> float:
    """Log of the integral of the expansion at an optimum over the unit cube, and over all values of ``standard``."""
    return _in_the_cube(_integrated(_at_rest(mode), standard))


def _at_rest(mode: Mode) -> Mode:
    """Without the slopes that no bound holds up: inside, an optimum has none."""
    return replace(mode, gradient=np.where(_pressing(mode), mode.gradient, 0.0))


def _pressing(mode: Mode) -> Booleans:
    """Coordinates ``(n_dim,)`` in which an optimum presses on a bound."""
    to_the_face = np.where(mode.gradient < 0.0, mode.point, 1.0 - mode.point)
    return np.asarray((to_the_face < _AT_A_FACE) & (mode.gradient != 0.0))


def _integrated(mode: Mode, standard: Integers) -> Mode:
    """The expansion over the other coordinates, these ones integrated out."""
    if not len(standard):
        return mode
    z = ndtri(mode.point[standard])
    slope = np.ones(len(mode.point))
    slope[standard] = np.exp(-0.5 * np.square(z)) / np.sqrt(2.0 * np.pi)  # of the unit coordinate by the normal's
    gradient, information = slope * mode.gradient, slope[:, None] * slope * mode.information
    gradient[standard] -= z
    information[standard, standard] += 1.0
    rest = np.setdiff1d(np.arange(len(slope)), standard)
    inner, cross = information[np.ix_(standard, standard)], information[np.ix_(rest, standard)]
    answers = np.linalg.solve(inner, np.column_stack([gradient[standard], cross.T]))
    gained = gradient[standard] @ answers[:, 0] - np.linalg.slogdet(inner)[1] - z @ z
    return Mode(
        point=mode.point[rest],
        log_likelihood=mode.log_likelihood + 0.5 * float(gained),
        gradient=gradient[rest] - cross @ answers[:, 0],
        information=information[np.ix_(rest, rest)] - cross @ answers[:, 1:],
    )


def _in_the_cube(mode: Mode) -> float:
    """Log of the integral over the unit cube of an expansion, by points drawn from what the cube leaves of it.

    A one-sided effect has its optimum at a bound or presses on it: over all space such an expansion has up to several
    times the mass that the cube holds, and a direction that the record says nothing of has none of its own.
    """
    pressing = _pressing(mode)
    # A fit stops short of a bound that it presses on, and beyond it steep slopes promise what is not there.
    point = np.where(pressing, np.where(mode.gradient < 0.0, 0.0, 1.0), mode.point)
    steepness = np.abs(mode.gradient) / np.sqrt(np.maximum(np.diag(mode.information), PRIOR_PRECISION))
    steep = pressing & (steepness > _STEEP)
    if np.any(steep):  # what falls off at once has no curvature that counts, nor digits in a normal's tail
        rest = np.flatnonzero(~steep)
        edge = mode.log_likelihood - float(np.sum(np.log(np.abs(mode.gradient[steep]))))
        if not len(rest):
            return edge
        inner = mode.information[np.ix_(rest, rest)]
        return _in_the_cube(
            Mode(point=point[rest], log_likelihood=edge, gradient=mode.gradient[rest], information=inner)
        )
    drawn = TruncatedStudent.at(point, mode.gradient, mode.information, flattest=1.0)
    points, log_density = drawn.at_uniforms(_design(len(point)))
    step = points - point
    values, vectors = np.linalg.eigh(mode.information)
    fall = 0.5 * np.square(step @ vectors) @ np.maximum(values, 0.0)
    return mode.log_likelihood + float(logsumexp(step @ mode.gradient - fall - log_density) - np.log(len(step)))


@cache
def _design(n_dim: int) -> Floats:
    """Points ``(n, n_dim)`` that fill a cube evenly, always the same."""
    return np.asarray(qmc.Sobol(n_dim, rng=0).random(_N_DESIGN))
