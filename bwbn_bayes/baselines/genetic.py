"""A genetic algorithm that fits a model to a record: one best point, no posterior.

A thin adapter over pymoo: real-coded, binary tournaments, simulated binary crossover, polynomial mutation, elitism. The
whole population is solved in one call of the engine.

References
----------
.. [1] Y. Zhao et al. 2019, doi:10.3389/fbuil.2018.00080, eqs. 27 and 28, table 1.
.. [2] K. Deb and R. B. Agrawal, "Simulated Binary Crossover for Continuous Search Space", Complex Systems 9, 1995.
.. [3] J. Blank and K. Deb, "pymoo: Multi-Objective Optimization in Python", 2020, doi:10.1109/ACCESS.2020.2990567.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.engines.base import Engine
from bwbn_bayes.errors import UserError, require_installed
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure


@dataclass(frozen=True, kw_only=True)
class GeneticSettings:
    """Options of the search; the first four are the paper's, the others pymoo's defaults.

    Parameters
    ----------
    population : int
        Individuals of a generation.
    elite : int
        Best individuals that pass unchanged into the next generation.
    crossover : float
        Probability that a pair of parents is crossed rather than copied.
    generations : int
        Generations after the first, random one.
    crossover_index, mutation_index : float
        Distribution indices of the crossover and the mutation: the larger, the nearer children stay to their parents.
    windows : tuple of float
        Shares of the record, from its start, that successive equal parts of the generations are judged by; the last is
        1. More than one lets the first storeys' yielding be found before the end of a long record can mislead.

    Raises
    ------
    UserError
        If a number is out of range.
    """

    population: int = 100
    elite: int = 10
    crossover: float = 0.6
    generations: int = 30
    crossover_index: float = 15.0
    mutation_index: float = 20.0
    windows: tuple[float, ...] = (1.0,)

    def __post_init__(self) -> None:
        if self.population < 4 or not 0 <= self.elite < self.population or self.generations < 1:
            raise UserError(
                f"genetic algorithm: population {self.population}, elite {self.elite}, generations {self.generations}: "
                "it needs a population of at least 4, fewer elite than that, and at least one generation"
            )
        if not 0.0 < self.crossover < 1.0:
            raise UserError(f"genetic algorithm: crossover is {self.crossover:g}, it must lie between 0 and 1")
        if not self.windows or self.windows[-1] != 1.0 or not all(0.0 < share <= 1.0 for share in self.windows):
            raise UserError(
                f"genetic algorithm: windows are {self.windows}, they must be shares of the record that end in 1"
            )


@dataclass(frozen=True, kw_only=True)
class Generation:
    """One generation: best and median objective, and the spread of its individuals.

    ``n_solves`` counts this generation's solves. ``spread`` is the root mean square over the parameters of their
    standard deviation in the unit cube: 0.29 for a population drawn from the prior, 0 for one that has collapsed.
    """

    number: int
    best: float
    median: float
    spread: float
    n_solves: int


@dataclass(frozen=True, kw_only=True)
class GeneticFit:
    """Best individual ``(n_parameters,)`` on the unit cube, its objective, and the history of generations."""

    point: Floats
    objective: float
    generations: tuple[Generation, ...]
    n_solves: int


def objective(misfit: Floats, record: Record) -> Floats:
    """Normalised mean square error of eq. 27, summed over the measured channels.

    Parameters
    ----------
    misfit : (n_draws, n_channels) array
        Sum of squared residuals of each channel, in the square of its unit; infinite where the solve failed.
    record : Record
        Gives the number of points N and the variance of each channel.

    Returns
    -------
    (n_draws,) array
        ``sum_c misfit_c / (N variance_c)``: 0 for a perfect fit, about 1 for each channel left unexplained.

    Raises
    ------
    UserError
        If a channel does not vary.

    References
    ----------
    .. [1] Y. Zhao et al. 2019, doi:10.3389/fbuil.2018.00080, eq. 27.
    """
    variances = np.array([np.var(signal) for signal in record.channels.values()])
    if np.any(variances == 0.0):
        still = list(record.channels)[int(np.argmin(variances))]
        raise UserError(f"channel {still} of record {record.name!r} does not vary: drop it or mend the record")
    return np.asarray(np.sum(misfit / (record.n_times * variances), axis=1))


def search(
    model: Structure,
    record: Record,
    engine: Engine,
    rng: np.random.Generator,
    settings: GeneticSettings | None = None,
    progress: Callable[[Generation], None] | None = None,
) -> GeneticFit:
    """Search the priors' ranges (eq. 28) for the point with the smallest objective.

    The individuals live on the unit cube, where every prior is uniform; uniform priors make it the paper's box.

    Parameters
    ----------
    model : Structure
        With priors on the parameters to identify.
    record : Record
        Measured channels under one excitation.
    engine : Engine
        Solves each generation in one call.
    rng : numpy.random.Generator
        Source of randomness.
    settings : GeneticSettings, optional
        The paper's by default.
    progress : callable, optional
        Told of each generation.

    Returns
    -------
    GeneticFit

    Raises
    ------
    UserError
        If pymoo is not installed.
    """
    settings = settings or GeneticSettings()
    mate = _mating(settings, model.space.n_dim)
    points = model.space.sample_unit(rng, settings.population)
    scores = np.full(len(points), np.inf)
    history: list[Generation] = []
    window, n_solves = -1, 0
    for number in range(settings.generations + 1):
        n_kept = settings.elite if number > 0 else 0
        if number > 0:
            points = np.concatenate([points[:n_kept], mate(points, settings.population - settings.elite, rng)])
        due = min(number * len(settings.windows) // settings.generations, len(settings.windows) - 1)
        if due != window:  # another part of the record: the elite is judged anew
            window, n_kept = due, 0
            seen = record.until(settings.windows[window] * record.duration)
        scores = np.concatenate([scores[:n_kept], _evaluate(model, seen, engine, points[n_kept:])])
        n_solves += len(points) - n_kept
        order = np.argsort(scores, kind="stable")
        points, scores = points[order], scores[order]
        history.append(_generation(number, points, scores, len(points) - n_kept))
        if progress is not None:
            progress(history[-1])
    return GeneticFit(point=points[0], objective=float(scores[0]), generations=tuple(history), n_solves=n_solves)


def _evaluate(model: Structure, record: Record, engine: Engine, points: Floats) -> Floats:
    values = model.space.from_unit(points)
    scores = objective(engine.misfit(model, values, record), record)
    return np.where(model.space.admissible(values), scores, np.inf)


def _generation(number: int, points: Floats, scores: Floats, n_solves: int) -> Generation:
    return Generation(
        number=number,
        best=float(scores[0]),
        median=float(np.median(scores)),
        spread=float(np.sqrt(np.mean(np.var(points, axis=0)))),
        n_solves=n_solves,
    )


class _Mate(Protocol):
    """Children ``(n_children, n_dim)`` of a population ``(n, n_dim)`` sorted by objective."""

    def __call__(self, points: Floats, n_children: int, rng: np.random.Generator) -> Floats:
        """Select, cross and mutate."""
        ...


def _mating(settings: GeneticSettings, n_dim: int) -> _Mate:
    require_installed("ga", "method ga")
    # Imported here: an extra of its own.
    from pymoo.core.mating import Mating
    from pymoo.core.population import Population
    from pymoo.core.problem import Problem
    from pymoo.operators.crossover.sbx import SBX
    from pymoo.operators.mutation.pm import PM
    from pymoo.operators.selection.tournament import TournamentSelection

    cube = Problem(n_var=n_dim, n_obj=1, xl=0.0, xu=1.0)
    mating = Mating(
        TournamentSelection(func_comp=_better),
        SBX(prob=settings.crossover, eta=settings.crossover_index),
        PM(eta=settings.mutation_index),
    )

    def mate(points: Floats, n_children: int, rng: np.random.Generator) -> Floats:
        children = mating.do(cube, Population.new(X=points), n_children, random_state=rng)
        return np.asarray(children.get("X"), dtype=np.float64)

    return mate


def _better(_sorted_population: object, pairs: NDArray[np.int64], **_rest: object) -> NDArray[np.int64]:
    """Winners of tournaments ``(n_pairs, 2)`` in a population sorted by objective: the lower index."""
    return np.asarray(np.min(pairs, axis=1, keepdims=True))
