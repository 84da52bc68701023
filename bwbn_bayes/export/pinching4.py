"""Pinching4 fitted to the loop of a link whose law OpenSees does not have.

Pinching4 [1]_ is a piecewise linear envelope of four points with unloading and reloading through a pinched point, and
damage of stiffness, reloading displacement and strength that grows with the work done. It is an approximation: its
error over the loop is found by OpenSees itself and written beside it.

References
----------
.. [1] L. N. Lowes, N. Mitra and A. Altoontash, "A Beam-Column Joint Model for Simulating the Earthquake Response of
   Reinforced Concrete Frames", PEER 2003/10, 2004.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution, minimize

from bwbn_bayes.errors import UserError
from bwbn_bayes.export.laws import Material
from bwbn_bayes.parameters import Floats

_MOST_POINTS = 1500
"""Of the path that the fit follows: turning points, and points spread evenly between."""
_GENERATIONS, _POPULATION = 30, 8
_ENERGY = 10.0
"""gE: work at which damage is complete, in that of one push along the envelope; the damage's own sizes scale it."""
_LIMIT = 0.95
"""Most of a stiffness or strength that damage may take."""
_BOUNDS = (
    *((0.02, 0.4), (0.05, 0.5)),  # drift of points 1 and 2, in the largest drift; point 3 is half-way to it
    *((0.05, 0.9), (0.1, 1.1), (0.2, 1.3), (0.3, 1.5)),  # their forces and the fourth's, in the largest force
    *((-0.5, 0.9), (-0.5, 0.9), (-0.5, 0.5)),  # rDisp, rForce, uForce
    *((0.0, 3.0), (0.0, 1.0), (0.0, 3.0)),  # gK2, gD2, gF2: damage by work
    (0.5, 2.0),  # forces to the negative side over those to the positive
)


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A fitted material and the rms of what it misses over the rms of the force, along the whole history."""

    material: Material
    error: float


def fit_pinching4(drift: Floats, force: Floats, rng: np.random.Generator, *, place: str) -> Fit:
    """Fit Pinching4 to a loop.

    Parameters
    ----------
    drift, force : (n_times,) array
        History of the loop, from rest. [m], [N]
    rng : numpy.random.Generator
        Of the search.
    place : str
        What the loop belongs to, for the sentence of an error.

    Returns
    -------
    Fit

    Raises
    ------
    UserError
        If the loop does not move, or openseespy is not installed.
    """
    reach, push = float(np.max(np.abs(drift))), float(np.max(np.abs(force)))
    if not (reach > 0.0 and push > 0.0):
        raise UserError(f"{place} does not move under the excitation, so that nothing can be fitted to its loop")
    ops = _opensees(place)
    path = _thinned(drift)

    def missed(values: Sequence[float] | Floats) -> float:
        found = _forces(ops, _arguments(values, reach, push), drift[path])
        return float(np.mean(np.square(np.nan_to_num(found, nan=1e3 * push) - force[path]))) / push**2

    search = differential_evolution(
        missed, _BOUNDS, rng=rng, maxiter=_GENERATIONS, popsize=_POPULATION, polish=False, init="sobol"
    )
    best = minimize(missed, search.x, method="Nelder-Mead", bounds=_BOUNDS, options={"maxfev": 600})
    arguments = _arguments(best.x, reach, push)
    error = np.sqrt(np.mean(np.square(_forces(ops, arguments, drift) - force)) / np.mean(np.square(force)))
    says = (
        "forces [N] and drifts [m] of four points to either side, rDisp, rForce, uForce to either side, gK, gD, gF, gE"
    )
    return Fit(material=Material(kind="Pinching4", arguments=arguments, says=says), error=float(error))


def _opensees(place: str) -> Any:
    try:
        return import_module("openseespy.opensees")
    except ImportError:
        raise UserError(
            f"{place} follows a law that OpenSees does not have: install openseespy, with which Pinching4 is fitted to "
            "its loop"
        ) from None


def _arguments(values: Sequence[float] | Floats, reach: float, push: float) -> tuple[float | str, ...]:
    """What follows the tag, from the fitted shares of the largest drift [m] and force [N]."""
    v = [float(value) for value in values]
    first = v[0]
    second = first + v[1] * (1.0 - first)
    drifts = [reach * share for share in (first, second, 0.5 * (second + 1.0), 1.0)]
    forces = [push * share for share in v[2:6]]
    positive = [one for pair in zip(forces, drifts, strict=True) for one in pair]
    negative = [one for f, d in zip(forces, drifts, strict=True) for one in (-v[12] * f, -d)]
    stiffness, displacement, strength = v[9:12]
    damage = [one for size in (stiffness, displacement, strength) for one in (0.0, size, 1.0, 1.0, _LIMIT)]
    return (*positive, *negative, *v[6:9], *v[6:9], *damage, _ENERGY, "energy")


def _forces(ops: Any, arguments: tuple[float | str, ...], drift: Floats) -> Floats:
    """Force ``(n,)`` of OpenSees' own Pinching4 along a path ``(n,)`` of drifts."""
    ops.wipe()
    ops.uniaxialMaterial("Pinching4", 1, *arguments)
    ops.testUniaxialMaterial(1)
    found = np.empty(len(drift))
    for i, strain in enumerate(drift.tolist()):
        ops.setStrain(strain)
        found[i] = ops.getStress()
    ops.wipe()
    return found


def _thinned(drift: Floats) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Positions of the turning points and of evenly spread ones, all of them on short records."""
    step = np.sign(np.diff(drift))
    turning = np.flatnonzero(step[1:] * step[:-1] < 0.0) + 1
    even = np.linspace(0, len(drift) - 1, min(len(drift), _MOST_POINTS)).astype(np.int64)
    return np.unique(np.concatenate([even, turning]))
