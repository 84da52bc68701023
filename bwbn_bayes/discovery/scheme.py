"""How finely a model is solved in a search: so that no evidence feels the step.

Searches solve coarsely, which is enough for most laws. One that holds fast while a play is crossed, or whose base is
nearly rigid, loses tens of nats by it, and what it then leaves looks like a further effect. So each explanation that
leads is judged at its own optimum and about it, and solved more finely where that matters.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bwbn_bayes.discovery.evidence import LAPLACE_SE
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.accuracy import LADDER, Discretisation, choose_scheme, rung_of
from bwbn_bayes.inference.finely import solve_finely
from bwbn_bayes.inference.likelihood import KnownNoise, Posterior
from bwbn_bayes.inference.modes import N_CANDIDATES
from bwbn_bayes.inference.residuals import noise_floors
from bwbn_bayes.parameters import Floats


def scheme_for_right_model(posterior: Posterior, point: Floats) -> Lanes:
    """The cheapest scheme whose error a right model's likelihood would not feel; what the one as given leaves is more.

    As if it had been measured exactly, with the noise by itself.
    """
    record, engine, (values, _) = posterior.record, posterior.engine, posterior.split(point[None])
    assert isinstance(engine, Lanes)
    exact = LADDER[-1].simulate(posterior.model, values, record).values[0]
    as_if = record.with_channels(dict(zip(record.channels, exact, strict=True)))
    noise = KnownNoise(sd=tuple(noise_floors(record).tolist()))
    return choose_scheme(replace(posterior, record=as_if, noise=noise, journal=None), point, engine)[0]


def finely_solved(one: Explanation) -> Explanation:
    """An explanation under a scheme by which its evidence errs less than by Laplace's approximation, fitted again."""
    engine = one.posterior.engine
    if not isinstance(engine, Lanes):
        return one
    solved = solve_finely(
        one.posterior,
        np.array([mode.point for mode in one.modes[:N_CANDIDATES]]),
        first=rung_of(engine),
        substeps=engine.substeps,
        accepts=_suffices,
        known=one.modes,
        spares=LAPLACE_SE,
    )
    if solved.posterior.engine == engine or not solved.modes:
        return one
    return replace(one, posterior=solved.posterior).with_modes(solved.modes)


def _suffices(facts: Discretisation) -> bool:
    return abs(facts.log_likelihood_shift) < LAPLACE_SE
