"""The scheme under which a PyMC model solves: by the rule of :func:`~bwbn_bayes.inference.identify.identify`."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bwbn_bayes.engines.base import Engine
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.accuracy import LADDER, Discretisation, Judge, coarsest_stable
from bwbn_bayes.inference.finely import solve_finely
from bwbn_bayes.inference.likelihood import Noise, Posterior
from bwbn_bayes.inference.modes import distinct, find_modes, polish
from bwbn_bayes.inference.pymc.forward import ForwardProblem
from bwbn_bayes.inference.unnamed.beside import beside
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure

_SEED = 1


def fine_enough(
    model: Structure, records: Sequence[Record], noises: Sequence[Noise], engine: Engine, *, fixed: bool
) -> tuple[Engine, list[Discretisation | None]]:
    """The engine with the finest of the schemes that the records ask for, and what each would do with its own.

    Parameters
    ----------
    model : Structure
        With priors.
    records, noises : sequences of Record and of Noise
        One noise for each record.
    engine : Engine
        One that is not of lanes has a tolerance of its own and is returned as it is.
    fixed : bool
        Whether the caller has chosen the scheme.
    """
    if fixed or not isinstance(engine, Lanes):
        return engine, [None] * len(records)
    schemes, facts = zip(*(_chosen(model, *pair, engine) for pair in zip(records, noises, strict=True)), strict=True)
    ladder = [replace(rung, n_threads=engine.n_threads) for rung in LADDER]
    return max(schemes, key=ladder.index), list(facts)


def beside_model(model: Structure, record: Record, noise: Noise, engine: Engine) -> tuple[Engine, Noise]:
    """What solves a model with an unnamed force beside it, and noise that holds the force."""
    posterior = Posterior(model=model, record=record, engine=engine, noise=noise)
    coarse = coarsest_stable(posterior)
    points = np.array([mode.point for mode in find_modes(coarse, np.random.default_rng(_SEED))])
    view = beside(posterior, distinct(*polish(posterior, points, n_iterations=20))).posterior
    return view.engine, view.noise


def require_fine_enough(problem: ForwardProblem, noise: Noise, draw: Floats) -> None:
    """Warn where a scheme moves the posterior at a draw (model, then noise) by half its standard deviation or more."""
    if not isinstance(problem.engine, Lanes):
        return
    posterior = Posterior(model=problem.model, record=problem.record, engine=problem.engine, noise=noise)
    finest = replace(LADDER[-1], n_threads=problem.engine.n_threads)
    facts = Judge.at(posterior, posterior.space.to_unit(draw[None])[0], finest)(problem.engine)
    if not facts.acceptable:
        warnings.warn(
            f"the scheme ({facts.scheme}) moves the posterior by {facts.joint_shift_sd:.2g} sd and the "
            f'log likelihood by {abs(facts.log_likelihood_shift):.2g}: leave the choice to to_pymc with engine="lanes"',
            stacklevel=3,
        )


def _chosen(model: Structure, record: Record, noise: Noise, engine: Lanes) -> tuple[Lanes, Discretisation]:
    coarse = coarsest_stable(Posterior(model=model, record=record, engine=engine, noise=noise))
    points = np.array([mode.point for mode in find_modes(coarse, np.random.default_rng(_SEED))])
    solved = solve_finely(coarse, points)
    assert isinstance(solved.posterior.engine, Lanes)
    assert solved.discretisation is not None
    return solved.posterior.engine, solved.discretisation
