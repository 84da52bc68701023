"""How every competitor is fitted: differential evolution on a thinned record, then least squares, one seed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.optimize import differential_evolution, least_squares

from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.cycles import turning_points

MOST_POINTS, MOST_POLISHED = 500, 8000
"""To which a record is thinned for the evolution and for the last polish; it is judged on all its points."""
_TURN = 0.005
"""Of the largest displacement: smaller returns are no turning points that a thinned record must keep."""
_HOPELESS = 30.0
"""A residual in place of one that is not finite or larger; an rms error of 100 % has residuals of norm one."""

Residuals = Callable[[Floats], Floats]


class Competitor(Protocol):
    """A law of force against displacement whose parameters are coordinates of the unit cube."""

    @property
    def name(self) -> str:
        """What it is filed under."""

    @property
    def symbols(self) -> tuple[str, ...]:
        """Its parameters."""

    def parameters(self, point: Floats) -> Floats:
        """Physical parameters ``(n_parameters,)`` at a point of the unit cube."""

    def force(self, parameters: Floats, displacement: Floats) -> Floats:
        """Force [N] along a displacement history [m], both ``(n_times,)``, from rest; not finite where it fails."""


@dataclass(frozen=True, kw_only=True)
class Budget:
    """What a fit may spend.

    Attributes
    ----------
    members : int
        Of the population.
    generations : int
        After the first.
    rounds : int
        Evolutions, each from a population of its own: one alone ends in any of several valleys.
    polished : int
        Members of each last generation, the best, that least squares polish.
    steps : int
        Of each polish at most.
    seed : int
    """

    members: int
    generations: int
    rounds: int = 1
    polished: int = 4
    steps: int = 25
    seed: int = 1


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """The best point of the unit cube ``(n_parameters,)`` and how many times the law was run."""

    point: Floats
    n_runs: int


def thinned(displacement: Floats, force: Floats, most: int = MOST_POINTS) -> tuple[np.ndarray, Floats]:
    """Choose points that tell a loop about as well as all do.

    Points are spread evenly over three thirds of one measure: path of the displacement, path of the force, number of
    the sample. Turning points are kept besides, so that the path stays what it was.

    Parameters
    ----------
    displacement, force : (n_times,) array
        [m], [N]
    most : int
        A record with no more points is left as it is.

    Returns
    -------
    index : (n_kept,) array of int
        Increasing, the first and last sample among them.
    weight : (n_kept,) array
        How many samples each stands for.
    """
    n = len(displacement)
    if n <= most:
        return np.arange(n), np.ones(n)
    paths = [np.concatenate([[0.0], np.cumsum(np.abs(np.diff(values)))]) for values in (displacement, force)]
    measure = sum((path / path[-1] for path in (*paths, np.arange(n))), np.zeros(n))
    turns = turning_points(displacement, _TURN * float(np.max(np.abs(displacement))))
    spread = np.searchsorted(measure, np.linspace(0.0, measure[-1], max(most - len(turns), 2)))
    index = np.unique(np.concatenate([[0, n - 1], turns, np.minimum(spread, n - 1)]).astype(np.int64))
    nearest = np.searchsorted(0.5 * (index[1:] + index[:-1]), np.arange(n))
    return index, np.bincount(nearest, minlength=len(index)).astype(np.float64)


def fit_force(competitor: Competitor, displacement: Floats, force: Floats, budget: Budget) -> Fitted:
    """Fit a competitor to a cyclic test: evolution on a few hundred points, the last polish on many more.

    Parameters
    ----------
    competitor : Competitor
    displacement, force : (n_times,) array
        The part that may be seen. [m], [N]
    budget : Budget
    """
    few, many = (_misfit(competitor, displacement, force, most) for most in (MOST_POINTS, MOST_POLISHED))
    return minimised(few, len(competitor.symbols), budget, last=many)


def minimised(residuals: Residuals, n_parameters: int, budget: Budget, *, last: Residuals | None = None) -> Fitted:
    """Minimise the sum of squares over the unit cube: differential evolution, then bounded least squares.

    Parameters
    ----------
    residuals : callable
        Of a point ``(n_parameters,)``; scaled so that the signal's sum of squares is one.
    n_parameters : int
    budget : Budget
    last : callable, optional
        Residuals on which the best of each round is polished once more, and which then judge.
    """
    counted = _Counted(residuals)

    def share(point: Floats) -> float:
        return float(np.sum(np.square(counted(point))))

    final = counted if last is None else _Counted(last)
    ends = []
    for rng in np.random.default_rng(budget.seed).spawn(budget.rounds):
        evolved = differential_evolution(
            share,
            [(0.0, 1.0)] * n_parameters,
            maxiter=budget.generations,
            popsize=-(-budget.members // n_parameters),
            tol=0.0,
            recombination=0.9,
            polish=False,
            rng=rng,
        )
        leading = evolved.population[np.argsort(evolved.population_energies)[: budget.polished]]
        best = min((_polished(counted, point, budget.steps) for point in leading), key=lambda end: end[1])
        ends.append(best if last is None else _polished(final, best[0], budget.steps))
    n_runs = counted.n_runs + (0 if last is None else final.n_runs)
    return Fitted(point=min(ends, key=lambda end: end[1])[0], n_runs=n_runs)


class _Counted:
    """Residuals that are always finite, and how often they were asked for."""

    def __init__(self, residuals: Residuals) -> None:
        self.residuals = residuals
        self.n_runs = 0

    def __call__(self, point: Floats) -> Floats:
        self.n_runs += 1
        with np.errstate(over="ignore", invalid="ignore"):
            found = self.residuals(np.clip(point, 0.0, 1.0))
        return np.clip(np.nan_to_num(found, nan=_HOPELESS, posinf=_HOPELESS, neginf=-_HOPELESS), -_HOPELESS, _HOPELESS)


def _polished(residuals: Residuals, start: Floats, steps: int) -> tuple[Floats, float]:
    """The point after least squares, or the start where that is no worse, and its sum of squares."""
    # Laws with kinks: a step of 1e-4 of each range sees over those of the solution itself.
    found = least_squares(
        residuals,
        np.clip(start, 1e-6, 1.0 - 1e-6),
        bounds=(0.0, 1.0),
        diff_step=np.full(len(start), 1e-4),
        max_nfev=steps,
    )
    before, after = float(np.sum(np.square(residuals(start)))), 2.0 * float(found.cost)
    return (np.asarray(found.x), after) if after < before else (start, before)


def _misfit(competitor: Competitor, displacement: Floats, force: Floats, most: int) -> Residuals:
    """Residuals at a point of the unit cube, ``(n_kept,)``; the sum of squares is a share of the signal's."""
    index, weight = thinned(displacement, force, most)
    path, target = displacement[index], force[index]
    scale = np.sqrt(weight / (weight @ np.square(target)))
    return lambda point: scale * (competitor.force(competitor.parameters(point), path) - target)
