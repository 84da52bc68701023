"""One stage of the sampler: resample the weighted cloud, then move it.

:func:`plain_stage` is Ching and Chen's [1]_, with the scale of the seed paper. :func:`waste_free_stage` is Dau and
Chopin's [2]_: few ancestors, long chains, every state of every chain kept; the chains run until they have forgotten
where they began.

References
----------
.. [1] J. Ching and Y.-C. Chen, 2007, doi:10.1061/(ASCE)0733-9399(2007)133:7(816), steps 3 and 4.
.. [2] H. D. Dau and N. Chopin, "Waste-free sequential Monte Carlo", 2022, doi:10.1111/rssb.12475.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from bwbn_bayes.inference.tmcmc import moves, resampling, tempering
from bwbn_bayes.inference.tmcmc.coordinates import PROBIT, Chart, Coordinates
from bwbn_bayes.inference.tmcmc.mixture import (
    fit_gaussian,
    fit_mixture,
    information_penalty,
)
from bwbn_bayes.inference.tmcmc.moves import Guide, Shape, Tuning
from bwbn_bayes.inference.tmcmc.target import Cloud, Floats, Integers, Reference, join

PLAIN_SCALE = 0.2
CHAIN_LENGTH = 16
LONGEST_CHAIN = 256
"""Steps of a chain at most, for each autocorrelation time that is wanted."""
_CHAIN_MULTIPLE = 32
_SPARE = 1.1
"""Length that chains grow to, over what the autocorrelation times measured so far ask for."""


class Lengths(NamedTuple):
    """Wanted length of chains, in autocorrelation times: of the stages between, and of the last one.

    All states count, so that chains keep of an error in where they began one over twice as many.
    """

    between: float
    last: float


ALONE = Lengths(4.0, 8.0)
"""Of a run from the prior whose evidence nothing else tells: an eighth of an error goes from stage to stage."""
DRAWS = Lengths(2.0, 8.0)
"""Of one whose evidence another start tells: a quarter on the road, a sixteenth among the draws."""
CHECK = Lengths(2.0, 2.0)
"""Of that other start, whose draws are not kept."""

Evaluator = Callable[[Floats], tuple[Cloud, int]]
"""Points ``(n, d)`` to an evaluated cloud and the solves spent."""


class Population(NamedTuple):
    """A cloud of equal weights, its points' chains, the independent draws it is worth, what the moves have learnt.

    Of each chain ``(n_chains,)`` the one of the stage before in which it began, and that one's excess of weight. Of the
    plain variant's points ``(n_generations, n)`` the ancestors, as far back as there are several; else of none.
    """

    cloud: Cloud
    families: Integers
    effective_size: float
    tuning: Tuning
    parents: Integers
    inherited: Floats
    ancestry: Integers

    @classmethod
    def of_draws(cls, cloud: Cloud, effective_size: float, tuning: Tuning) -> Population:
        """Independent draws, which have no parents."""
        each = np.arange(len(cloud.points))
        none = np.empty((0, len(each)), dtype=np.int64)
        return cls(cloud, each, effective_size, tuning, each, np.zeros(len(each)), none)

    def thinned(self, n: int) -> Cloud:
        """So many of its points, evenly along its chains."""
        by_chain = np.argsort(self.families, kind="stable")
        return self.cloud.take(by_chain[np.arange(n) * len(by_chain) // n])


class Moved(NamedTuple):
    """What a stage returns: the new population and the facts of how it moved.

    ``correlation_times`` is the length of its chains in their autocorrelation times, NaN where that is not measured;
    ``log_mean_variance`` what its weights add to the variance of the log evidence.
    """

    population: Population
    acceptance: float
    n_solves: int
    correlation_times: float
    label: str
    log_mean_variance: float


class Streams(NamedTuple):
    """The random streams of one stage, one for each step and group, whoever computes them."""

    seed: int
    stage: int

    def at(self, step: int, group: int = 0) -> np.random.Generator:
        """The generator of a step; step 0 resamples."""
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(self.stage, step, group)))


def plain_stage(
    evaluator: Evaluator, population: Population, log_weights: Floats, tempering_parameter: float, streams: Streams
) -> Moved:
    """Resample ``n`` leads by weight, one Metropolis step each; a lead drawn twice steps on from its first step.

    Parameters
    ----------
    evaluator : Evaluator
        Evaluates proposals.
    population : Population
        The cloud of the stage before, ``n`` points.
    log_weights : (n,) array
        Its weights towards this stage.
    tempering_parameter : float
        Of this stage.
    streams : Streams
        Random streams of this stage.

    Returns
    -------
    Moved
        Its effective sample size is that of :func:`~bwbn_bayes.inference.tmcmc.tempering.independent_draws`: one step
        in each stage forgets little, and the weights alone are worth up to fifty times as many.
    """
    cloud, weights = population.cloud, tempering.normalised(log_weights)
    counts = np.bincount(resampling.multinomial(weights, len(weights), streams.at(0)), minlength=len(weights))
    alive = weights > 0.0
    covariance = np.cov(cloud.points[alive], rowvar=False, aweights=weights[alive], ddof=0)
    values, vectors = np.linalg.eigh(np.atleast_2d(covariance))
    factor = PLAIN_SCALE * vectors * np.sqrt(values.clip(min=0.0))
    leads = np.flatnonzero(counts)
    heads, families, accepted, n_solves = cloud.take(leads), np.arange(len(leads)), 0, 0
    collected, labels = [], []
    for turn in range(1, int(counts.max()) + 1):
        still = counts[leads[families]] >= turn
        heads, families = heads.take(np.flatnonzero(still)), families[still]
        rng = streams.at(turn)
        proposal, solves = evaluator(heads.points + rng.standard_normal(heads.points.shape) @ factor.T)
        log_odds = proposal.log_density(tempering_parameter) - heads.log_density(tempering_parameter)
        moved = np.log(rng.random(len(families))) < log_odds
        heads = proposal.where(moved, heads)
        collected.append(heads)
        labels.append(families)
        accepted, n_solves = accepted + int(moved.sum()), n_solves + solves
    joined, own = join(collected), np.concatenate(labels)
    generations = np.vstack([own, population.ancestry[:, leads[own]]])
    ancestry = generations[[len(np.unique(row)) >= tempering.FEWEST_FAMILIES for row in generations]]
    worth = min(tempering.independent_draws(joined.points, ancestry), float(len(leads)))
    parents = population.families[leads]
    excess = tempering.family_excess(log_weights, population.families)
    variance = tempering.log_mean_variance(excess, population.parents, population.inherited)
    moved_population = Population(joined, own, worth, population.tuning, parents, excess[parents], ancestry)
    return Moved(moved_population, accepted / len(weights), n_solves, np.nan, "plain", variance)


def waste_free_stage(
    evaluator: Evaluator,
    population: Population,
    log_weights: Floats,
    tempering_parameter: float,
    streams: Streams,
    n_particles: int,
    lengths: Lengths,
    chart: Chart = PROBIT,
    guide: Reference | None = None,
) -> Moved:
    """Resample a few ancestors and run them as chains until decorrelated; the cloud is every state of every chain.

    The chains grow from 16 steps until they have as many of the longest integrated autocorrelation time (over the
    positions and the log ratio) as wanted, or 256 steps for each of them, which the label then says.

    Parameters
    ----------
    evaluator : Evaluator
        Evaluates proposals.
    population : Population
        The cloud of the stage before, ``n`` points.
    log_weights : (n,) array
        Its weights towards this stage.
    tempering_parameter : float
        Of this stage.
    streams : Streams
        Random streams of this stage.
    n_particles : int
        Smallest size of the new cloud.
    lengths : Lengths
        Of the chains.
    chart : Chart
        Of the cloud's points.
    guide : Reference, optional
        A density near this stage's, from which some moves are drawn; it may be zero where the stage's is not.

    Returns
    -------
    Moved
        Its effective sample size is the number of states over the longest autocorrelation time.
    """
    alive = np.flatnonzero(np.isfinite(log_weights))
    cloud, families = population.cloud.take(alive), population.families[alive]
    weights, tuning = tempering.normalised(log_weights[alive]), population.tuning
    positions = chart.positions(cloud.points)
    order = resampling.order_along_principal_axis(positions, weights)
    n_chains = chain_count(n_particles, positions.shape[1])
    ancestors = order[resampling.systematic(weights[order], n_chains, streams.at(0))]
    worth = population.effective_size / (len(weights) * float(np.sum(weights**2)))
    first, second = _shapes(positions, weights, families, worth, n_particles, streams)
    if guide is not None:
        first, second = (own._replace(guide=Guide(guide, chart, own.coordinates)) for own in (first, second))
    shapes = first, second
    chains = _started(cloud.take(ancestors), positions[ancestors], families[ancestors] % 2, shapes, chart)
    wanted = lengths.last if tempering_parameter == 1.0 else lengths.between
    run = _run(evaluator, chart, chains, shapes, tuning, tempering_parameter, streams, wanted)
    parents = families[ancestors]
    excess = tempering.family_excess(log_weights, population.families)
    variance = tempering.log_mean_variance(excess, population.parents, population.inherited)
    moved = Population(
        join(run.clouds),
        np.tile(np.arange(n_chains), len(run.clouds)),
        n_chains * len(run.clouds) / run.correlation_time,
        moves.retune(tuning, run.tally),
        parents,
        excess[parents],
        population.ancestry[:0],
    )
    length = len(run.clouds) / run.correlation_time
    return Moved(moved, run.tally.acceptance, run.n_solves, length, run.label, variance)


def fewest_particles(n_dim: int) -> int:
    """Particles from which the shape of a cloud in so many dimensions can be told."""
    return 8 * (n_dim + 1)


def chain_count(n_particles: int, n_dim: int) -> int:
    """Number of chains: a multiple of 32, so that batches of 16 lanes fill two threads.

    Never fewer than the shape can be told from. Chains that hardly move are worth their number; moves fitted to too few
    hardly move them, and the next stage's are fitted to no more.
    """
    fewest = max(-(-n_particles // CHAIN_LENGTH), fewest_particles(n_dim))
    return _CHAIN_MULTIPLE * -(-fewest // _CHAIN_MULTIPLE)


class _Chains(NamedTuple):
    cloud: Cloud
    groups: Integers
    positions: Floats
    log_volume: Floats
    log_fit: Floats


def _started(cloud: Cloud, positions: Floats, groups: Integers, shapes: tuple[Shape, Shape], chart: Chart) -> _Chains:
    """Chains at positions, each in the coordinates of its group's shape."""
    mapped, log_volume, log_fit = np.empty_like(positions), np.empty(len(groups)), np.empty(len(groups))
    for group, shape in enumerate(shapes):
        mine = groups == group
        mapped[mine], _ = shape.coordinates.forward(positions[mine])
        _, log_volume[mine] = shape.coordinates.inverse(mapped[mine], chart)
        log_fit[mine] = shape.mixture.log_density(mapped[mine])
    return _Chains(cloud, groups, mapped, log_volume, log_fit)


class _Run(NamedTuple):
    clouds: list[Cloud]
    correlation_time: float
    tally: moves.Tally
    n_solves: int
    label: str


def _run(
    evaluator: Evaluator,
    chart: Chart,
    chains: _Chains,
    shapes: tuple[Shape, Shape],
    tuning: Tuning,
    tempering_parameter: float,
    streams: Streams,
    wanted: float,
) -> _Run:
    """Advance the chains until they are as many autocorrelation times long as wanted, or at the cap.

    They grow to what the times measured so far ask for and a little more, but no more than double: short chains show
    times that are too short.
    """
    longest = int(wanted * LONGEST_CHAIN)
    clouds: list[Cloud] = []
    traces: list[Floats] = []
    tally, n_solves, length = moves.EMPTY_TALLY, 0, CHAIN_LENGTH
    while True:
        for step in range(len(clouds) + 1, length + 1):
            chains, tally, solves = _advance(
                evaluator, chart, chains, shapes, tuning, tally, tempering_parameter, streams, step
            )
            clouds.append(chains.cloud)
            traces.append(np.column_stack([chart.positions(chains.cloud.points), chains.cloud.log_ratio]))
            n_solves += solves
        correlation_time = tempering.integrated_autocorrelation_time(np.stack(traces))
        if wanted * correlation_time <= length:
            return _Run(clouds, correlation_time, tally, n_solves, f"{length} steps")
        if length >= longest:
            label = f"stopped at the cap of {length} steps, {length / correlation_time:.2g} autocorrelation times"
            return _Run(clouds, correlation_time, tally, n_solves, label)
        length = min(2 * length, int(np.ceil(_SPARE * wanted * correlation_time)), longest)


def _shapes(
    positions: Floats, weights: Floats, families: Integers, effective_size: float, n_particles: int, streams: Streams
) -> tuple[Shape, Shape]:
    """Two shapes, each fitted to the half of the families whose descendants it does not move.

    A proposal fitted to the very point that it moves favours that point, a bias that adds up over the stages.
    """
    thinned = np.arange(0, len(weights), max(1, len(weights) // (2 * n_particles)))
    halves = [thinned[families[thinned] % 2 == parity] for parity in (1, 0)]
    if min(len(half) for half in halves) < 2:
        halves = [thinned, thinned]
    shares = [weights[half] / np.sum(weights[half]) for half in halves]
    archives = [
        positions[half][resampling.systematic(share, n_particles, streams.at(0, 1 + own))]
        for own, (half, share) in enumerate(zip(halves, shares, strict=True))
    ]
    worth = max(2.0, 0.5 * effective_size)
    first, second = (_shape(positions[halves[own]], shares[own], archives[own], worth) for own in (0, 1))
    return first, second


def _shape(points: Floats, shares: Floats, archive: Floats, effective_size: float) -> Shape:
    """Coordinates and mixture fitted to weighted positions; straightened only where that clearly pays."""
    n_dim = points.shape[1]
    plain, straightened = Coordinates.probit(n_dim), Coordinates.straightening(archive)
    mapped, log_slope = straightened.forward(points)
    as_it_is, after = fit_gaussian(points, shares), fit_gaussian(mapped, shares)
    gain = shares @ (after.log_density(mapped) + log_slope - as_it_is.log_density(points))
    best = straightened if gain > information_penalty(3 * n_dim, effective_size) else plain
    mixture = fit_mixture(best.forward(points)[0], shares, effective_size)
    return Shape.of(best, mixture, best.forward(archive)[0])


def _advance(
    evaluator: Evaluator,
    chart: Chart,
    chains: _Chains,
    shapes: tuple[Shape, Shape],
    tuning: Tuning,
    tally: moves.Tally,
    tempering_parameter: float,
    streams: Streams,
    step: int,
) -> tuple[_Chains, moves.Tally, int]:
    """One Metropolis-Hastings step of every chain, in one batch of solves."""
    proposed, points = np.empty_like(chains.positions), np.empty_like(chains.positions)
    kinds = np.empty(len(proposed), dtype=np.int64)
    log_odds, log_volume, log_fit, jumps = np.empty((4, len(proposed)))
    for group, shape in enumerate(shapes):
        mine = np.flatnonzero(chains.groups == group)
        start = chains.positions[mine]
        proposal = moves.propose(start, chains.log_fit[mine], shape, tuning, streams.at(step, group))
        proposed[mine], log_fit[mine], kinds[mine] = proposal.positions, proposal.log_fit, proposal.moves
        jumps[mine] = shape.squared_jumps(start, proposal.positions)
        points[mine], log_volume[mine] = shape.coordinates.inverse(proposal.positions, chart)
        log_odds[mine] = proposal.log_asymmetry
    candidate, n_solves = evaluator(points)
    # At the very edge of a cube the volume may be infinite where the density is zero: NaN, which is never accepted.
    with np.errstate(invalid="ignore"):
        log_odds += (
            log_volume
            - chains.log_volume
            + candidate.log_density(tempering_parameter)
            - chains.cloud.log_density(tempering_parameter)
        )
    accepted = np.log(streams.at(step, 2).random(len(proposed))) < log_odds
    moved = _Chains(
        candidate.where(accepted, chains.cloud),
        chains.groups,
        np.where(accepted[:, None], proposed, chains.positions),
        np.where(accepted, log_volume, chains.log_volume),
        np.where(accepted, log_fit, chains.log_fit),
    )
    return moved, tally.add(kinds, accepted.astype(np.float64), jumps), n_solves
