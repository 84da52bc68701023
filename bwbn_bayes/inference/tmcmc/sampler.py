"""Transitional Markov chain Monte Carlo, assembled.

From a cloud of the reference: choose the next tempering parameter, weigh, count the mean weight towards the
evidence, resample, move; until the tempering parameter is one.

References
----------
.. [1] J. Ching and Y.-C. Chen, "Transitional Markov Chain Monte Carlo Method for Bayesian Model Updating, Model Class
   Selection, and Model Averaging", 2007, doi:10.1061/(ASCE)0733-9399(2007)133:7(816).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.tmcmc import tempering
from bwbn_bayes.inference.tmcmc.moves import FIRST_GUIDED, FIRST_TUNING, Tuning
from bwbn_bayes.inference.tmcmc.stages import (
    ALONE,
    Evaluator,
    Lengths,
    Population,
    Streams,
    fewest_particles,
    plain_stage,
    waste_free_stage,
)
from bwbn_bayes.inference.tmcmc.target import (
    Floats,
    PriorReference,
    Reference,
    Target,
    evaluate,
)
from bwbn_bayes.results import StageFacts

Variant = Literal["default", "plain"]
TARGET_VARIATION = {"default": 0.5, "plain": 1.0}
"""Coefficient of variation of the weights that each variant steps to."""
GUIDED_VARIATION = 1.0
"""The same where moves have a guide, by which chains soon forget the fewer ancestors that they then have."""


class RunState(NamedTuple):
    """A run between two stages."""

    population: Population
    tempering_parameter: float
    log_evidence: float
    log_evidence_variance: float
    n_solves: int
    correlation_times: float
    facts: tuple[StageFacts, ...]


@dataclass(frozen=True, kw_only=True)
class TmcmcResult:
    """A posterior cloud and its evidence.

    Attributes
    ----------
    particles : (n_particles, d) array
        Points of the unit cube, of equal weight.
    log_likelihood : (n_particles,) array
        Their log likelihoods.
    log_evidence, log_evidence_se : float
        Log evidence and its standard error. [nat] The error counts what a stage's chains have from the stage before,
        and nothing from further back. That does for the default; the plain variant's clouds stay correlated over many
        stages, and its figure is far too small.
    stages : tuple of StageFacts
        History; solves, log evidence and elapsed time are running totals.
    n_solves : int
        Likelihood evaluations in all.
    correlation_times : float
        Length of the last stage's chains in autocorrelation times; NaN of the plain variant.
    """

    particles: Floats
    log_likelihood: Floats
    log_evidence: float
    log_evidence_se: float
    stages: tuple[StageFacts, ...]
    n_solves: int
    correlation_times: float


def sample(
    target: Target,
    *,
    n_particles: int = 2000,
    rng_seed: int,
    variant: Variant = "default",
    reference: Reference | None = None,
    guide: Callable[[float], Reference] | None = None,
    lengths: Lengths = ALONE,
    progress: Callable[[StageFacts], None] | None = None,
) -> TmcmcResult:
    """Sample a posterior and its evidence.

    Parameters
    ----------
    target : Target
        Prior and likelihood on the unit cube.
    n_particles : int
        Points of the result and smallest size of every stage's cloud.
    rng_seed : int
        The run is a function of it, however many workers solve.
    variant : {"default", "plain"}
        ``default`` moves until decorrelated; ``plain`` is the published algorithm with the scale 0.2, its bias kept.
    reference : Reference, optional
        Where the road starts; the prior if not given.
    guide : callable, optional
        Density near that of a tempering parameter, from which some moves of the default variant are drawn.
    lengths : Lengths
        Of the default variant's chains, in autocorrelation times.
    progress : callable, optional
        Called with the facts of each finished stage.

    Returns
    -------
    TmcmcResult
        Equal-weight points, log evidence with its standard error, history.

    Raises
    ------
    UserError
        If there are too few particles, or no first draw has a finite likelihood.
    """
    require_particles(n_particles, target.n_dim)
    start = reference if reference is not None else PriorReference(target)
    evaluator = partial(evaluate, target, start)
    began = time.perf_counter()
    # Its matrices are small or narrow: threads of the algebra took two thirds of the time to wait for each other.
    with threadpool_limits(limits=1, user_api="blas"):
        tuning = FIRST_TUNING if guide is None else FIRST_GUIDED
        state = _first_state(start, evaluator, n_particles, rng_seed, tuning)
        _announce(state, progress)
        while state.tempering_parameter < 1.0:
            state = _next_state(state, evaluator, n_particles, rng_seed, variant, guide, lengths, began)
            _announce(state, progress)
    return _result(state, n_particles)


def require_particles(n_particles: int, n_dim: int) -> None:
    """Raise :class:`UserError` unless there are enough particles for so many parameters."""
    fewest = fewest_particles(n_dim)
    if n_particles < fewest:
        raise UserError(f"{n_particles} particles for {n_dim} parameters: use at least {fewest}")


def _first_state(
    reference: Reference, evaluator: Evaluator, n_particles: int, rng_seed: int, tuning: Tuning
) -> RunState:
    """Draw and evaluate the reference."""
    began = time.perf_counter()
    cloud, n_solves = evaluator(reference.sample(Streams(rng_seed, 0).at(0), n_particles))
    n_finite = int(np.count_nonzero(np.isfinite(cloud.log_ratio)))
    if n_finite < 2:
        raise UserError(
            f"{n_finite} of {n_particles} draws of the prior (or reference) have a finite likelihood: "
            "narrow the priors to where the model can be solved, or check record and model"
        )
    facts = StageFacts(
        stage=0,
        tempering_parameter=0.0,
        acceptance=1.0,
        effective_sample_size=float(n_finite),
        n_solves=n_solves,
        log_evidence=0.0,
        elapsed_s=time.perf_counter() - began,
        label="draws of the reference",
    )
    population = Population.of_draws(cloud, float(n_finite), tuning)
    return RunState(population, 0.0, 0.0, 0.0, n_solves, np.inf, (facts,))


def _next_state(
    state: RunState,
    evaluator: Evaluator,
    n_particles: int,
    rng_seed: int,
    variant: Variant,
    guide: Callable[[float], Reference] | None,
    lengths: Lengths,
    began: float,
) -> RunState:
    """Temper, weigh, resample, move."""
    population, past = state.population, state.tempering_parameter
    log_ratio = population.cloud.log_ratio
    variation = TARGET_VARIATION[variant] if guide is None else GUIDED_VARIATION
    tempering_parameter = tempering.next_tempering_parameter(log_ratio, past, variation)
    log_weights = (tempering_parameter - past) * log_ratio
    log_evidence = state.log_evidence + tempering.log_mean(log_weights)
    streams = Streams(rng_seed, state.facts[-1].stage + 1)
    if variant == "plain":
        moved = plain_stage(evaluator, population, log_weights, tempering_parameter, streams)
    else:
        moved = waste_free_stage(
            evaluator,
            population,
            log_weights,
            tempering_parameter,
            streams,
            n_particles,
            lengths,
            guide=None if guide is None else guide(tempering_parameter),
        )
    n_solves = state.n_solves + moved.n_solves
    variance = state.log_evidence_variance + moved.log_mean_variance
    facts = StageFacts(
        stage=streams.stage,
        tempering_parameter=tempering_parameter,
        acceptance=moved.acceptance,
        effective_sample_size=moved.population.effective_size,
        n_solves=n_solves,
        log_evidence=log_evidence,
        elapsed_s=time.perf_counter() - began,
        label=moved.label,
    )
    told = (*state.facts, facts)
    return RunState(
        moved.population, tempering_parameter, log_evidence, variance, n_solves, moved.correlation_times, told
    )


def _announce(state: RunState, progress: Callable[[StageFacts], None] | None) -> None:
    if progress is not None:
        progress(state.facts[-1])


def _result(state: RunState, n_particles: int) -> TmcmcResult:
    """Thin the last cloud to the number of particles asked for."""
    cloud = state.population.thinned(n_particles)
    return TmcmcResult(
        particles=cloud.points,
        log_likelihood=cloud.log_likelihood,
        log_evidence=state.log_evidence,
        log_evidence_se=float(np.sqrt(max(state.log_evidence_variance, 0.0))),
        stages=state.facts,
        n_solves=state.n_solves,
        correlation_times=state.correlation_times,
    )
