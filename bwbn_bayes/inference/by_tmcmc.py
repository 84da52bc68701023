"""The posterior by transitional MCMC from two starts that do not know of each other.

The first start is the inflated approximation at the modes, the second a mixture of the prior and of wide components at
the modes: what the first leaves out has density there. Where both come to the same evidence, means and spreads, their
chains were long enough, and the particles are worth enough, the sampler has forgotten where it began; if not, more
particles are sent out, unless the model leaves more than noise anyway.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple, override

import numpy as np

from bwbn_bayes.inference.accuracy import LADDER, on_rung
from bwbn_bayes.inference.bridge import bridge, guide_between, sheet_through, wide_mixture
from bwbn_bayes.inference.history import History
from bwbn_bayes.inference.identify import Sampling
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.method import Task
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.nested_laplace import NestedLaplace
from bwbn_bayes.inference.sampled import Given, Sampled
from bwbn_bayes.inference.settings import Settings
from bwbn_bayes.inference.summary import Draws
from bwbn_bayes.inference.tmcmc.sampler import TmcmcResult, require_particles, sample
from bwbn_bayes.inference.tmcmc.stages import CHECK, DRAWS, fewest_particles
from bwbn_bayes.inference.tmcmc.target import DefensiveMixture, Reference
from bwbn_bayes.results import Check

FIRST, SECOND = "tmcmc (bridge)", "tmcmc (second start)"
_SHARE_OF_SECOND = 8
"""The second start has this fraction of the particles: it is there to be compared with."""
_PRIOR_SHARE, _INFLATION = 0.2, 9.0
_N_ATTEMPTS = 3
"""Each with twice the particles of the one before; one alone where the model leaves more than noise: what is refused
need not be known to a hundredth of its spread."""
_LEAST_WORTH = 200.0
"""Independent draws that a cloud must be worth: a mean is then known to 7 % of the posterior's sd."""
_LEAST_KURTOSIS = 1.8
"""Of a uniform distribution; two equal lumps have 1, and their spread no error."""
_NATS, _ERRORS = 0.5, 4.0
"""Evidences agree within half a nat, which changes no conclusion, or within so many of their standard errors."""


class _Starts(NamedTuple):
    first: TmcmcResult
    second: TmcmcResult

    @property
    def checks(self) -> tuple[Check, ...]:
        return (
            *_mixing_checks(self.first),
            _evidence_check(*self),
            _means_check(*self),
            _spreads_check(*self),
        )


class ByTmcmc(Sampling):
    """Transitional MCMC from two starts."""

    along_orbits = True

    @override
    def refuse(self, task: Task) -> None:
        super().refuse(task)
        require_particles(task.settings.particles, task.model.space.n_dim)

    @override
    def sample(self, given: Given) -> Sampled:
        return two_starts(given)


def two_starts(given: Given, nested: NestedLaplace | None = None) -> Sampled:
    """Sample by transitional MCMC from two starts, with more particles until they agree.

    Parameters
    ----------
    given : Given
        Particles are those of the first attempt; the published variant is compared with itself from the prior. Every
        attempt and start has seeds of its own.
    nested : NestedLaplace, optional
        The sheet through the modes, where it is known already.
    """
    n_attempts = _N_ATTEMPTS if given.explains else 1
    sheet = sheet_through(given.target, given.modes, given.rng, nested)
    for attempt, stream in enumerate(given.seeds.spawn(n_attempts)):
        starts = _attempt(
            given.target,
            given.modes,
            sheet,
            given.settings.particles << attempt,
            given.settings,
            stream,
            given.history,
        )
        if all(check.passed for check in starts.checks) or attempt + 1 == n_attempts:
            break
        given.history.say("the two starts do not agree, or their particles are worth too little: sending out more")
    evidences = {
        FIRST: (starts.first.log_evidence, starts.first.log_evidence_se),
        SECOND: (starts.second.log_evidence, starts.second.log_evidence_se),
    }
    return Sampled("tmcmc", Draws.of_cloud(starts.first), evidences, starts.checks)


def _attempt(
    target: Posterior,
    modes: Sequence[Mode],
    sheet: NestedLaplace | None,
    n_particles: int,
    settings: Settings,
    stream: np.random.SeedSequence,
    history: History,
) -> _Starts:
    one, other = stream.generate_state(2)
    history.say("sampling by transitional MCMC from the inflated approximation at the mode")
    first = bridge(
        target,
        modes,
        sheet,
        n_particles=n_particles,
        rng_seed=int(one),
        variant=settings.variant,
        progress=partial(history.tell_stage, "bridge"),
    )
    fewer = max(n_particles // _SHARE_OF_SECOND, fewest_particles(target.n_dim))
    run = partial(
        sample,
        n_particles=fewer,
        rng_seed=int(other),
        variant=settings.variant,
        progress=partial(history.tell_stage, "second start"),
    )
    if settings.variant == "plain":
        history.say("sampling by transitional MCMC from the prior")
        return _Starts(first, run(target.with_engine(on_rung(target.engine, LADDER[0]))))
    history.say("sampling by transitional MCMC from a start of its own")
    start = DefensiveMixture(prior_share=_PRIOR_SHARE, target=target, component=wide_mixture(modes, _INFLATION))
    near = guide_between(modes, sheet, _INFLATION)

    def guide(tempering_parameter: float) -> Reference:
        """With the prior, where the early road lies as well: moves fitted to both do not lead from one to the other."""
        share = _PRIOR_SHARE * (1.0 - tempering_parameter)
        own = near(tempering_parameter)
        return DefensiveMixture(prior_share=share, target=target, component=own) if share else own

    return _Starts(first, run(target, reference=start, guide=guide, lengths=CHECK))


def _worth(cloud: TmcmcResult) -> float:
    return min(cloud.stages[-1].effective_sample_size, float(len(cloud.particles)))


def _mixing_checks(cloud: TmcmcResult) -> tuple[Check, ...]:
    """Of the start whose states are the draws; the plain variant knows by ancestry what they are worth, no lengths."""
    length, worth = cloud.correlation_times, _worth(cloud)
    wanted = min(_LEAST_WORTH, 0.5 * len(cloud.particles))
    independent = Check(
        name="independent particles",
        value=worth,
        limit=wanted,
        passed=worth >= wanted,
        sentence=f"The {len(cloud.particles)} particles are worth {worth:.0f} independent ones.",
    )
    if np.isnan(length):
        return (independent,)
    long_enough = Check(
        name="length of chains",
        value=length,
        limit=DRAWS.last,
        passed=length >= DRAWS.last,
        sentence=f"Its chains are {length:.1f} autocorrelation times long at the end, {DRAWS.last:g} are wanted.",
    )
    return (independent, long_enough)


def _evidence_check(first: TmcmcResult, second: TmcmcResult) -> Check:
    gap = abs(first.log_evidence - second.log_evidence)
    limit = max(_NATS, _ERRORS * float(np.hypot(first.log_evidence_se, second.log_evidence_se)))
    return Check(
        name="starts agree on the evidence",
        value=gap,
        limit=limit,
        passed=gap <= limit,
        sentence=f"Two independent starts put the log evidence {gap:.2f} nats apart, of {limit:.2f} at most.",
    )


def _means_check(first: TmcmcResult, second: TmcmcResult) -> Check:
    sd = np.maximum(np.std(first.particles, axis=0), 1e-300)
    gap = float(np.max(np.abs(np.mean(first.particles, axis=0) - np.mean(second.particles, axis=0)) / sd))
    limit = _ERRORS * float(np.sqrt(1.0 / _worth(first) + 1.0 / _worth(second)))
    return Check(
        name="starts agree on the means",
        value=gap,
        limit=limit,
        passed=gap <= limit,
        sentence=f"Their means lie up to {gap:.2f} posterior standard deviations apart, {limit:.2f} at most by chance.",
    )


def _spreads_check(first: TmcmcResult, second: TmcmcResult) -> Check:
    """By the log of the standard deviation: of n independent draws its variance is (kurtosis - 1) / 4 n."""
    centred = first.particles - np.mean(first.particles, axis=0)
    variance = np.maximum(np.mean(np.square(centred), axis=0), 1e-300)
    kurtosis = np.maximum(np.mean(centred**4, axis=0) / np.square(variance), _LEAST_KURTOSIS)
    error = np.sqrt(0.25 * (kurtosis - 1.0) * (1.0 / _worth(first) + 1.0 / _worth(second)))
    gap = np.abs(np.log(np.maximum(np.std(second.particles, axis=0), 1e-150)) - 0.5 * np.log(variance))
    worst = int(np.argmax(gap / error))
    return Check(
        name="starts agree on the spreads",
        value=float(gap[worst] / error[worst]),
        limit=_ERRORS,
        passed=bool(gap[worst] <= _ERRORS * error[worst]),
        sentence=f"Their standard deviations differ by up to {100.0 * np.expm1(gap[worst]):.0f} %, "
        f"{100.0 * np.expm1(_ERRORS * error[worst]):.0f} % at most by chance.",
    )
