"""Explanations of a building beside a force of no known law: to first order, and as a function of one state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bwbn_bayes.discovery.evidence import autoregressive, autoregressive_bound, laplace
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.pool import Pool
from bwbn_bayes.discovery.run import Run, all_but, on_one_thread, on_threads
from bwbn_bayes.inference.unnamed import N_KINDS, UNNAMED_SCALE
from bwbn_bayes.inference.unnamed.state_function import StateForce, state_forces
from bwbn_bayes.inference.unnamed.storey import unnamed_forces

_N_UNNAMED = 8
"""Explanations that are weighed to first order at most, beside those that have less than the best."""


def weigh_to_first_order(pool: Pool, run: Run, reach: float) -> None:
    """The best explanations, those so many nats behind, what has less, and the model as given, beside such a force.

    Parameters
    ----------
    pool : Pool
        Takes what is found.
    run : Run
    reach : float
        How far behind the best an explanation is asked. [nat]
    """
    best = pool.laws_alone
    most = best.log_joint[0]
    near = [one for one, log in zip(best.explanations, best.log_joint, strict=True) if log > most - reach]
    wanted = {one.effects_key: one for one in near[:_N_UNNAMED]}
    wanted |= {key: one for key, one in pool.plain.items() if key < best.best.effects_key}
    run.say(f"weighing {len(wanted)} explanations beside a force of no known law")
    behind = dict(zip((one.effects_key for one in best.explanations), most - best.log_joint, strict=True))
    asked = [(one, float(behind[key]), run) for key, one in wanted.items()]
    tell = "weighed {} explanations with a force of no known law"
    for _, found in run.pace.each(_to_first_order, asked, run.settings.n_workers, tell):
        for one in found:
            pool.add_unnamed(one)


def _to_first_order(asked: tuple[Explanation, float, Run]) -> list[Explanation]:
    """An explanation with an unnamed force in each storey, and in all; so many nats behind the best without one."""
    one, behind, run = asked
    posterior, best = on_one_thread(one.evidence.posterior), one.evidence.modes[0].point
    found = unnamed_forces(posterior, best, UNNAMED_SCALE, all_but(one.added, run), matters=behind)
    evidence = one.evidence
    return [
        replace(
            one,
            unnamed=place,
            estimate=own,
            evidence=replace(evidence, log_evidence=evidence.log_evidence + own.gain, method="Laplace"),
        )
        for place, own in found.items()
    ]


def follow(pool: Pool, run: Run) -> None:
    """Fit forces of one state beside the best laws, the model as given, and what lacks one effect of the best."""
    whole = pool.laws_alone.best.effects_key
    keys = dict.fromkeys([frozenset(), whole, *(whole - {one} for one in whole)])
    wanted = [key for key in keys if key in pool.plain and key not in pool.followed]
    streams = run.rng.spawn(len(wanted))
    asked = [(pool.plain[key], own, run) for key, own in zip(wanted, streams, strict=True)]
    if not asked or run.must_stop():
        return
    run.say(f"fitting forces of one state beside {len(asked)} explanations")
    tell = "fitted forces of one state beside {} explanations"
    for (one, *_), found in run.pace.each(_with_state_forces, asked, run.settings.n_workers, tell):
        pool.followed.add(one.effects_key)
        for own in found:
            pool.add_unnamed(own)


def _with_state_forces(asked: tuple[Explanation, np.random.Generator, Run]) -> list[Explanation]:
    """An explanation with a force of one state of a storey."""
    one, rng, run = asked
    found = state_forces(on_one_thread(one.posterior), one.points, UNNAMED_SCALE, rng)
    return [_of_state(one, force, run) for force in found]


def _of_state(one: Explanation, force: StateForce, run: Run) -> Explanation:
    """With a force of one state, under white errors or autoregressive ones, as is more probable."""
    posterior = on_threads(force.posterior, run.settings.n_workers)
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
