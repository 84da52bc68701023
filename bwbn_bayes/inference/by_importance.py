"""The posterior by importance sampling, which checks itself."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import override

import numpy as np

from bwbn_bayes.inference.by_tmcmc import two_starts
from bwbn_bayes.inference.curved import curved_mixture
from bwbn_bayes.inference.history import History
from bwbn_bayes.inference.identify import Sampling
from bwbn_bayes.inference.importance import (
    PARETO_CLEAR,
    PARETO_LIMIT,
    Proposal,
    WeightedDraws,
    laplace_mixture,
    least_likely,
    log_targets,
    sample_importance,
)
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.nested_laplace import NestedLaplace, Sheet
from bwbn_bayes.inference.pooled import FittedMixture, Pool
from bwbn_bayes.inference.sampled import Given, Sampled
from bwbn_bayes.inference.sheet_nodes import has_wide
from bwbn_bayes.inference.summary import Draws
from bwbn_bayes.inference.tmcmc.stages import fewest_particles
from bwbn_bayes.results import Check

_PILOT = 800
_LEAST_EFFICIENCY = 0.5
"""Share of effective draws with which a proposal is drawn from on; below it a better one is fitted."""
_LEAST_CURVED = 0.2
"""The same of one that follows bends in many directions, which a fit does not."""
_PILOT_LIMIT = 0.5
_LEAST_EFFECTIVE = 2000
"""Weighed draws are worth so many at least, whatever was asked for: from fewer, Pareto's k can miss a heavy tail."""
_MOST_HALVINGS = 20
"""How often a draw is brought half as near to the fit."""
_BATCH = 4000
_FALLBACK_SHARE, _FEWEST_PARTICLES = 10, 200
"""Where TMCMC takes over, it starts with this fraction of the draws asked for: each costs it some hundred solves."""
_MOST_DRAWS, _MOST_ALONE, _MOST_AFAR, _MOST_EACH = 60_000, 20_000, 6_000, 4
"""Draws at most; where nothing takes over, so that a run ends; and where, besides, none of them came near the fit; and
for each effective one that is asked for, however many these are."""


class ByImportance(Sampling):
    """Importance sampling, and transitional MCMC where the weights' tail is too heavy."""

    along_orbits = True

    @override
    def sample(self, given: Given) -> Sampled:
        settings, rng, history = given.settings, given.rng, given.history
        # Where nothing takes over, the bent posterior of a model that leaves more than noise is worth fits alone.
        follows = settings.fallback or given.explains
        most = max(_MOST_DRAWS if settings.fallback else _MOST_ALONE, _MOST_EACH * settings.particles)
        weighted, nested = weighted_draws(
            given.target, given.modes, rng, settings.particles, history, follows=follows, most=most
        )
        checks = (_pareto_check(weighted), _size_check(weighted.effective_sample_size, settings.particles))
        evidences = {"importance": (weighted.log_evidence, weighted.log_evidence_se)}
        if weighted.pareto_k <= PARETO_LIMIT or (not settings.fallback and _reaches(weighted, given.modes[0])):
            return Sampled("importance", Draws.of_weighted(weighted, rng, settings.particles), evidences, checks)
        if not settings.fallback:
            history.say("no draw comes near the fit: taking those of the normal approximation back towards it")
            return Sampled("importance", _taken_back(given, weighted), evidences, checks)
        history.say("the proposal does not cover the posterior: falling back to TMCMC")
        fewest = max(_FEWEST_PARTICLES, fewest_particles(given.target.n_dim))
        fewer = replace(settings, particles=max(fewest, settings.particles // _FALLBACK_SHARE))
        second = two_starts(given._replace(settings=fewer), nested)
        return second._replace(evidences={**evidences, **second.evidences}, checks=(*checks, *second.checks))


def _reaches(weighted: WeightedDraws, mode: Mode) -> bool:
    """Whether some draw is as likely as draws of a posterior are."""
    return bool(np.isfinite(weighted.pareto_k) and np.max(weighted.log_likelihood) >= least_likely(mode))


def _taken_back(given: Given, weighted: WeightedDraws) -> Draws:
    """Draws of the normal approximation at the best fit, each so far from it that the record is as likely as it should.

    Where the posterior is bent they spread less than it does. They are said to be worth what ``weighted`` ones are.
    """
    mode = given.modes[0]
    steps = laplace_mixture((mode,)).sample(given.rng, given.settings.particles) - mode.point
    least = mode.log_likelihood - 0.5 * np.einsum("ni,ij,nj->n", steps, mode.information, steps)
    points, value = mode.point + steps, np.full(len(steps), mode.log_likelihood)
    far = np.arange(len(steps))
    for _ in range(_MOST_HALVINGS):
        value[far], log_target = log_targets(given.target, points[far])
        far = far[~(np.isfinite(log_target) & (value[far] >= least[far]))]
        if not len(far):
            break
        points[far] = mode.point + 0.5 * (points[far] - mode.point)
    else:
        points[far], value[far] = mode.point, mode.log_likelihood
    taken = replace(
        weighted, points=points, log_likelihood=value, log_weights=np.full(len(points), -np.log(len(points)))
    )
    draws = Draws.of_weighted(taken, given.rng, given.settings.particles)
    return replace(draws, effective_sample_size=weighted.effective_sample_size)


def weighted_draws(
    posterior: Posterior,
    modes: tuple[Mode, ...],
    rng: np.random.Generator,
    effective: int,
    history: History,
    *,
    follows: bool,
    most: int,
) -> tuple[WeightedDraws, NestedLaplace | None]:
    """From the modes, or along a surface through them where they alone cover the posterior badly; then from fits.

    A sheet takes out a few wide coordinates. Where none is wide, as with a sensor on each of thirty storeys, the
    posterior bends a little in every one of them: a sheet takes minutes to lay and helps nothing, and a fit to draws
    takes tens of thousands of them to learn so many dimensions.
    """
    sheet, effective = Sheet(posterior, modes, rng), max(effective, _LEAST_EFFECTIVE)
    afar = most if follows else _MOST_AFAR
    follows = follows and posterior.n_dim > 1
    pilot = sample_importance(posterior, sheet.proposal, rng, effective=_PILOT, most=_PILOT)
    poor = pilot.effective_sample_size < _LEAST_EFFICIENCY * len(pilot.points) or pilot.pareto_k > _PILOT_LIMIT
    curved = None
    if poor and follows and has_wide(modes[0].information):
        history.say("the posterior is bent: laying a sheet through it")
        sheet.lay()
    elif poor and follows:
        history.say("the posterior is bent in many directions: following them")
        curved = curved_mixture(posterior, modes)
    history.say("sampling the posterior by importance")
    tell = partial(history.tell_draws, posterior, effective)
    pool, short = Pool.empty(posterior.n_dim), float(effective)
    proposal: Proposal = curved or sheet.proposal
    least = _LEAST_EFFICIENCY if curved is None else _LEAST_CURVED
    while True:
        # A sheet's draws are learnt from once they are a quarter more, as far as so many are wanted.
        batch = max(_BATCH, min(int(1.1 * short), len(pool.points) // 4))
        n = batch if sheet.nested is not None else int(1.1 * short) if follows else _PILOT
        n = min(n, most - len(pool.points))
        pool = pool.drawn(posterior, proposal, rng, n // 16 * 16 + 16)
        found = pool.weighted
        reached, efficiency = found.effective_sample_size, found.effective_sample_size / len(pool.points)
        tell(reached, len(pool.points))
        short = (effective - reached) / max(efficiency, 0.05)
        if (reached >= effective and found.pareto_k <= PARETO_CLEAR) or len(pool.points) >= most:
            return found, sheet.nested
        if len(pool.points) >= afar and not _reaches(found, modes[0]):
            return found, sheet.nested
        if posterior.n_dim > 1 and (efficiency < least or found.pareto_k > PARETO_CLEAR):
            proposal = FittedMixture.to(found) or proposal
        elif reached >= effective:
            return found, sheet.nested
        short = max(short, _PILOT)


def _pareto_check(weighted: WeightedDraws) -> Check:
    return Check(
        name="Pareto k",
        value=weighted.pareto_k,
        limit=PARETO_LIMIT,
        passed=weighted.pareto_k <= PARETO_LIMIT,
        sentence=f"The tail of the importance weights has Pareto shape {weighted.pareto_k:.2f}.",
    )


def _size_check(reached: float, wanted: float) -> Check:
    return Check(
        name="effective draws",
        value=reached,
        limit=wanted,
        passed=reached >= wanted,
        sentence=f"The weighted draws are worth {reached:.0f} independent ones.",
    )
