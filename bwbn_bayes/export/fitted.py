"""A material fitted to the loop of a link whose law OpenSees does not have: BoucWen, BWBN or Pinching4, the nearest.

BoucWen and BWBN are smooth as our loops are, and least squares start from the link's own parameters. Where both miss
much, Pinching4 [1]_ is tried: a piecewise linear envelope of four points, unloading and reloading through a pinched
point, and damage of stiffness, reloading displacement and strength that grows with the work done; its search is global.
All are approximations: the error over the loop is found by OpenSees itself and written beside the material.

References
----------
.. [1] L. N. Lowes, N. Mitra and A. Altoontash, "A Beam-Column Joint Model for Simulating the Earthquake Response of
   Reinforced Concrete Frames", PEER 2003/10, 2004.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution, least_squares, minimize

from bwbn_bayes.errors import UserError
from bwbn_bayes.export.exportable import Link
from bwbn_bayes.export.laws import BOUC_WEN, BWBN, NEWTON_ITERATIONS, NEWTON_TOLERANCE, Material, shape, size_of_z
from bwbn_bayes.parameters import Floats

_Arguments = tuple[float | str, ...]

_MOST_POINTS, _MOST_STEPS = 1500, 10_000
"""Of the path that a fit follows: turning points, and points spread evenly between; and steps along it, however small z
is beside the drift, as a slider's is."""
_NEAR = 0.05
"""Error of a smooth material up to which Pinching4 is not tried."""
_COARSE, _FINE = 0.05, 0.01
"""Step along the path in the size of z: while fitting, and when the error is measured, as the script's own steps."""
_SPRING = ((0.2, 1.5), (-0.2, 0.5), (0.2, 5.0), (0.1, 1.5), (1.0, 5.0))
"""k in the link's, alpha, bound of z in the link's, beta over beta + gamma, n."""
_LOSSES = ((0.0, 5.0), (0.0, 5.0))
"""deltaNu and deltaEta by the largest force times the largest drift."""
_PINCH = ((-0.5, 0.9), (0.0, 0.99), (0.0, 100.0), (0.02, 2.0), (0.0, 3.0), (0.01, 1.0))
"""q, zetas, p by the same work, Shi and deltaShi by z and work, lambda."""
_PINCH_STARTS = ((0.0, 0.5, 2.0, 0.3, 0.1, 0.3), (0.3, 0.7, 30.0, 0.5, 0.1, 0.3), (0.0, 0.8, 0.5, 0.2, 0.1, 0.2))
_LIMIT, _ENERGY = 0.95, 10.0
"""Pinching4: most of a stiffness or strength that damage may take, and gE, which the damage's own sizes scale."""
_PINCHING4 = (
    *((0.02, 0.4), (0.05, 0.5)),  # drift of points 1 and 2, in the largest drift; point 3 is half-way to it
    *((0.05, 0.9), (0.1, 1.1), (0.2, 1.3), (0.3, 1.5)),  # their forces and the fourth's, in the largest force
    *((-0.5, 0.9), (-0.5, 0.9), (-0.5, 0.5)),  # rDisp, rForce, uForce
    *((0.0, 3.0), (0.0, 1.0), (0.0, 3.0)),  # gK2, gD2, gF2: damage by work
    (0.5, 2.0),  # forces to the negative side over those to the positive
)
_PINCHING4_SAYS = "forces [N], drifts [m] of four points to either side, rDisp, rForce, uForce twice, gK, gD, gF, gE"


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A fitted material and the rms of what it misses over the rms of the force, along the whole history."""

    material: Material
    error: float


@dataclass(frozen=True, kw_only=True)
class _Path:
    """A history in small steps from where it begins: ``strains``, of which ``samples`` have a ``force`` to compare."""

    strains: Floats
    samples: np.ndarray[tuple[int], np.dtype[np.int64]]
    force: Floats


def fitted_material(link: Link, force: Floats, rng: np.random.Generator, *, place: str) -> Fit:
    """Fit materials to a loop and take the nearest.

    Parameters
    ----------
    link : Link
        Its drift, and the parameters to start from.
    force : (n_times,) array
        Of the link, less what stands beside the material and the spring's force at the first drift. [N]
    rng : numpy.random.Generator
        Of the search.
    place : str
        What the loop belongs to, for the sentence of an error.

    Raises
    ------
    UserError
        If the loop does not move, or openseespy is not installed.
    """
    if not (np.any(link.drift) and np.any(force)):
        raise UserError(f"{place} does not move under the excitation, so that nothing can be fitted to its loop")
    ops = _opensees(place)
    chosen, step = _thinned(link.drift), size_of_z(link)
    largest = max(_COARSE * step, float(np.sum(np.abs(np.diff(link.drift[chosen])))) / _MOST_STEPS)
    coarse = _in_steps(link.drift[chosen], force[chosen], largest)
    fine = _in_steps(link.drift, force, _FINE * step)
    fits = [Fit(material=one, error=_error(ops, one, fine)) for one in _smooth(ops, link, coarse)]
    if min(fit.error for fit in fits) > _NEAR:
        angular = _pinching4(ops, coarse, rng)
        fits.append(Fit(material=angular, error=_error(ops, angular, fine)))
    return min(fits, key=lambda fit: fit.error)


def _opensees(place: str) -> Any:
    try:
        return import_module("openseespy.opensees")
    except ImportError:
        raise UserError(
            f"{place} follows a law that OpenSees does not have: install openseespy, with which a material is fitted "
            "to its loop"
        ) from None


def _smooth(ops: Any, link: Link, path: _Path) -> tuple[Material, Material]:
    """BoucWen and BWBN that fit best, by least squares from the link's own spring."""
    own, z = shape(link.parameters), size_of_z(link)
    work = float(np.max(np.abs(path.force)) * np.max(np.abs(path.strains)))
    bounding = own["beta"] + own["gamma"]
    ratio = own["beta"] / bounding if bounding > 0.0 else 0.5
    spring = (1.0, own["alpha"], 1.0, ratio, own["n"])
    losses = tuple(own.get(symbol, 0.0) * work for symbol in ("delta_nu", "delta_eta"))
    newton = (NEWTON_TOLERANCE * z, NEWTON_ITERATIONS)

    def first(v: Floats) -> tuple[float, ...]:
        bound = (v[2] * z) ** -v[4]
        return v[1], v[0] * own["k"], v[4], (1.0 - v[3]) * bound, v[3] * bound, 1.0

    def bouc_wen(v: Floats) -> Material:
        arguments = (*first(v), 0.0, v[5] / work, v[6] / work)
        return Material(kind="BoucWen", arguments=(*map(float, arguments), *newton), says=BOUC_WEN)

    def bwbn(v: Floats) -> Material:
        arguments = (*first(v), v[5], v[6], v[7] / work, v[8] * z, v[9] * z / work, v[10])
        return Material(kind="BWBN", arguments=(*map(float, arguments), *newton), says=BWBN)

    return (
        _nearest(ops, path, bouc_wen, (*_SPRING, *_LOSSES), [(*spring, *losses), (*spring, 0.1, 0.1)]),
        _nearest(ops, path, bwbn, (*_SPRING, *_PINCH), [(*spring, *pinch) for pinch in _PINCH_STARTS]),
    )


def _nearest(
    ops: Any,
    path: _Path,
    material: Callable[[Floats], Material],
    bounds: Sequence[tuple[float, float]],
    starts: Sequence[Sequence[float]],
) -> Material:
    """The best of least squares from several starts."""
    lower, upper = np.array(bounds).T
    width = upper - lower

    def residual(share: Floats) -> Floats:
        found = _forces(ops, material(lower + share * width), path)
        return np.asarray((found - path.force) / np.max(np.abs(path.force)))

    shares = [np.clip((np.array(start) - lower) / width, 0.01, 0.99) for start in starts]
    ends = [least_squares(residual, share, bounds=(0.0, 1.0), diff_step=[1e-4], max_nfev=25) for share in shares]
    return material(lower + min(ends, key=lambda end: float(end.cost)).x * width)


def _pinching4(ops: Any, path: _Path, rng: np.random.Generator) -> Material:
    """Pinching4 that fits best, from everywhere."""
    reach, push = float(np.max(np.abs(path.strains))), float(np.max(np.abs(path.force)))

    def material(v: Sequence[float]) -> Material:
        return Material(kind="Pinching4", arguments=_pinching4_arguments(v, reach, push), says=_PINCHING4_SAYS)

    def missed(v: Floats) -> float:
        return float(np.mean(np.square(_forces(ops, material(v.tolist()), path) - path.force))) / push**2

    search = differential_evolution(missed, _PINCHING4, rng=rng, maxiter=30, popsize=8, polish=False, init="sobol")
    best = minimize(missed, search.x, method="Nelder-Mead", bounds=_PINCHING4, options={"maxfev": 600})
    return material(best.x.tolist())


def _pinching4_arguments(v: Sequence[float], reach: float, push: float) -> _Arguments:
    """What follows the tag, from the fitted shares of the largest drift [m] and force [N]."""
    first = v[0]
    second = first + v[1] * (1.0 - first)
    drifts = [reach * share for share in (first, second, 0.5 * (second + 1.0), 1.0)]
    forces = [push * share for share in v[2:6]]
    positive = [one for pair in zip(forces, drifts, strict=True) for one in pair]
    negative = [one for f, d in zip(forces, drifts, strict=True) for one in (-v[12] * f, -d)]
    damage = [one for size in v[9:12] for one in (0.0, size, 1.0, 1.0, _LIMIT)]
    return (*positive, *negative, *v[6:9], *v[6:9], *damage, _ENERGY, "energy")


def _error(ops: Any, material: Material, path: _Path) -> float:
    """Rms of what a material misses over the rms of the force."""
    missed = _forces(ops, material, path) - path.force
    return float(np.sqrt(np.mean(np.square(missed)) / np.mean(np.square(path.force))))


def _forces(ops: Any, material: Material, path: _Path) -> Floats:
    """Force of OpenSees' own material at the samples of a path, far off where it is not finite."""
    ops.wipe()
    ops.uniaxialMaterial(material.kind, 1, *material.arguments)
    ops.testUniaxialMaterial(1)
    found = np.empty(len(path.strains))
    for i, strain in enumerate(path.strains.tolist()):
        ops.setStrain(strain)
        found[i] = ops.getStress()
    ops.wipe()
    return np.nan_to_num(found[path.samples], nan=1e3 * float(np.max(np.abs(path.force))))


def _in_steps(drift: Floats, force: Floats, largest: float) -> _Path:
    """A path in steps of at most ``largest`` [m] from the first drift on, where a material is at rest."""
    corners = np.concatenate([[0.0], drift - drift[0]])
    n_steps = np.maximum(np.ceil(np.abs(np.diff(corners)) / largest).astype(np.int64), 1)
    samples = np.cumsum(n_steps)
    strains = np.interp(np.arange(1, samples[-1] + 1), np.concatenate([[0], samples]), corners)
    return _Path(strains=strains, samples=samples - 1, force=force)


def _thinned(drift: Floats) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Positions of the turning points and of evenly spread ones, all of them on short records."""
    step = np.sign(np.diff(drift))
    turning = np.flatnonzero(step[1:] * step[:-1] < 0.0) + 1
    even = np.linspace(0, len(drift) - 1, min(len(drift), _MOST_POINTS)).astype(np.int64)
    return np.unique(np.concatenate([even, turning]))
