"""Explanations of a building beside what has no name: an error of a sensor, a link, or a force in a storey."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from bwbn_bayes.discovery.evidence import autoregressive, autoregressive_bound, laplace
from bwbn_bayes.discovery.explanation import Explanation, Key
from bwbn_bayes.discovery.pool import Pool
from bwbn_bayes.discovery.probability import Beliefs
from bwbn_bayes.discovery.run import Run, on_one_thread, on_threads
from bwbn_bayes.inference.likelihood import IntegratedNoise, Posterior
from bwbn_bayes.inference.unnamed import N_KINDS, UNNAMED_SCALE
from bwbn_bayes.inference.unnamed.further_link import further_links
from bwbn_bayes.inference.unnamed.reading import ReadingError, reading_errors
from bwbn_bayes.inference.unnamed.state_function import StateForce, state_forces
from bwbn_bayes.inference.unnamed.storey import unnamed_forces
from bwbn_bayes.records.blocks import counts

_LEAST_LEFT = 0.1
"""Of the record's noise, by its model-free estimate, which may be too large: what leaves less knows the noise."""
_N_UNNAMED = 8
"""Explanations that are weighed to first order at most, beside those that have less than the best."""


class _Asked(NamedTuple):
    """What is asked of an explanation."""

    one: Explanation
    behind: float
    """How far it is behind the best. [nat]"""
    rng: np.random.Generator
    """Of its own."""
    n_threads: int
    """For solves of what is found."""
    known: Explanation
    """The best laws."""


def follow(pool: Pool, run: Run) -> None:
    """Look beside the best laws, the model as given, and what lacks an effect of the best, for what has no name.

    Errors of sensors and links between floors cost least, then forces to first order, then those of one state; of each,
    beside the model as given first.
    """
    whole = pool.laws.best.effects_key
    keys = dict.fromkeys([whole, *(whole - {one} for one in sorted(whole)), *_rivals(pool.laws)])
    for kind in _KINDS:
        if kind is not _with_reading_errors or len(pool.laws.best.posterior.record.parts) == 1:
            _ask(kind, [frozenset()], pool, run)
            _ask(kind, keys, pool, run)


def weigh_to_first_order(pool: Pool, run: Run, reach: float) -> None:
    """The best explanations, those so many nats behind, what has less or lacks a name of the best, beside a force.

    Parameters
    ----------
    pool : Pool
        Takes what is found.
    run : Run
    reach : float
        How far behind the best an explanation is asked. [nat]
    """
    best = pool.laws
    most = best.log_joint[0]
    near = [one for one, log in zip(best.explanations, best.log_joint, strict=True) if log > most - reach]
    wanted = [
        *(one.effects_key for one in near[:_N_UNNAMED]),
        *(key for key in pool.plain if key < near[0].effects_key),
        *_rivals(best),
    ]
    _ask(_to_first_order, wanted, pool, run)


def _rivals(laws: Beliefs) -> list[Key]:
    """For each name of the best laws the best ones without it: a name may be had only for want of a force beside them.

    They may have another form of one of the best's effects, whose error the name stands in for.
    """
    best = laws.best
    without = (next((one for one in laws.explanations if name not in one.names), None) for name in sorted(best.names))
    return [one.effects_key for one in without if one is not None]


def _ask(kind: Callable[[_Asked], list[Explanation]], keys: Iterable[Key], pool: Pool, run: Run) -> None:
    """Take in explanations with something unnamed of a kind, of which each is asked once.

    Where the model as given with something unnamed is the best and leaves noise, nothing speaks for another.
    """
    if (most := pool.compared.best).has_unnamed and not most.added and most.is_noise:
        return
    what, best = _KINDS[kind], pool.laws
    behind = dict(zip((one.effects_key for one in best.explanations), best.log_joint[0] - best.log_joint, strict=True))
    wanted = [key for key in dict.fromkeys(keys) if key in pool.plain and (key, what) not in pool.asked]
    if not wanted or run.must_stop():
        return
    streams = run.rng.spawn(len(wanted))
    asked = [
        _Asked(
            pool.plain[key],
            float(behind[key]),
            own,
            run.settings.n_workers,
            best.best,
        )
        for key, own in zip(wanted, streams, strict=True)
    ]
    run.say(f"fitting {what} beside {len(asked)} explanations")
    for (one, *_), found in run.pace.each(kind, asked, f"fitted {what} beside {{}} explanations"):
        pool.asked.add((one.effects_key, what))
        for own in found:
            pool.add_unnamed(own)


def _with_reading_errors(asked: _Asked) -> list[Explanation]:
    """An explanation with an error of no known kind in each channel."""
    one = asked.one
    found = reading_errors(on_one_thread(one.posterior), one.points, UNNAMED_SCALE)
    return [_with_reading_error(one, own, asked.n_threads) for own in found]


def _with_reading_error(one: Explanation, found: ReadingError, n_threads: int) -> Explanation:
    evidence = laplace(on_threads(found.posterior, n_threads), found.modes)
    return replace(one, unnamed=found.channel, estimate=found, evidence=evidence)


def _with_further_links(asked: _Asked) -> list[Explanation]:
    """An explanation with a link between each two floors that none joins, as likely beforehand as a force's kinds."""
    one = asked.one
    found: list[Explanation] = []
    for link in further_links(on_one_thread(one.posterior), one.points):
        posterior = on_threads(link.posterior, asked.n_threads)
        own, modes = laplace(posterior, link.modes), link.modes
        evidence = replace(own, log_evidence=own.log_evidence - float(np.log(N_KINDS)))
        found.append(
            replace(one, posterior=posterior, modes=modes, unnamed=link.span, estimate=link, evidence=evidence)
        )
    return found


def _to_first_order(asked: _Asked) -> list[Explanation]:
    """An explanation with an unnamed force in each storey, and in all.

    Not with one that would explain more than all that was measured: to first order, about a response that runs away
    from its neighbours, a force does anything.
    """
    one = asked.one
    # Few explanations are asked, so that the last would keep one thread busy: the threads share blocks of lanes.
    posterior, best = on_threads(one.evidence.posterior, asked.n_threads), one.evidence.modes[0].point
    found = unnamed_forces(posterior, best, UNNAMED_SCALE, matters=asked.behind)
    evidence = one.evidence
    most = _at_most(posterior)
    return [
        replace(
            one,
            unnamed=place,
            estimate=own,
            evidence=replace(evidence, log_evidence=evidence.log_evidence + own.gain, method="Laplace"),
        )
        for place, own in found.items()
        if evidence.log_evidence + own.gain < most
    ]


def _at_most(posterior: Posterior) -> float:
    """Log likelihood of a model that leaves a share of the record's noise that no right one would."""
    noise, n_times = posterior.noise, counts(posterior.record)
    if not isinstance(noise, IntegratedNoise):
        return np.inf
    left = _LEAST_LEFT**2 * np.asarray(noise.scale) * n_times
    return float(noise.log_likelihood(left[None], n_times, np.empty((1, 0)))[0])


def _with_state_forces(asked: _Asked) -> list[Explanation]:
    """An explanation with a force of one state of a storey."""
    one, known = asked.one, (on_one_thread(asked.known.posterior), asked.known.best)
    found = state_forces(on_one_thread(one.posterior), one.points, UNNAMED_SCALE, asked.rng, known)
    return [_of_state(one, force, asked.n_threads) for force in found]


def _of_state(one: Explanation, force: StateForce, n_threads: int) -> Explanation:
    """With a force of one state, under white errors or autoregressive ones, as is more probable."""
    posterior = on_threads(force.posterior, n_threads)
    found = laplace(posterior, force.modes)
    # One of many kinds of such a force, of unknown scale and smoothness.
    weighed = found.log_evidence + force.gain_over - float(np.log(N_KINDS))
    evidence = replace(found, log_evidence=weighed)
    if posterior.record.has_time and autoregressive_bound(posterior, force.modes) > 0.0:
        coloured = autoregressive(posterior, force.modes)
        gained = coloured.log_evidence - found.log_evidence
        if gained > 0.0:
            evidence = replace(coloured, log_evidence=evidence.log_evidence + gained)
    return replace(
        one, posterior=posterior, modes=force.modes, unnamed=(force.storey,), estimate=force, evidence=evidence
    )


_KINDS: dict[Callable[[_Asked], list[Explanation]], str] = {
    _with_reading_errors: "errors of sensors",
    _with_further_links: "further links",
    _to_first_order: "forces of no known law",
    _with_state_forces: "forces of one state",
}
"""What is looked for beside laws, the cheapest first, in words."""
