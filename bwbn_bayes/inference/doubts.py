"""What casts doubt on a model that seems to explain its record, short of refusing it.

A wrong model can hide what it lacks in its parameters and leave a residual that passes for noise. Two things still
tell: a residual that noise would rarely leave, and a best fit that the prior holds back. What other mechanism would
explain more is asked of the catalogue in the room above (:mod:`bwbn_bayes.discovery.alternatives`).
"""

from __future__ import annotations

import numpy as np

from bwbn_bayes.inference.identifiability import PRIOR_PRECISION
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode, held_back
from bwbn_bayes.inference.residuals import QUIET_PROBABILITY, heard_rests, steadiness, whiteness_probability
from bwbn_bayes.parameters import Constraint
from bwbn_bayes.results import DOUBTS, Check
from bwbn_bayes.structures.hardening import free_of
from bwbn_bayes.structures.structure import Structure

QUIET, WITHIN = DOUBTS[:2]
LARGEST_GAIN = 4.5
"""Beyond a bound of the prior: three standard deviations, which chance alone gives a right model once in 740. [nat]"""
_AT_A_BOUND = 1e-5


def doubts(posterior: Posterior, mode: Mode) -> tuple[Check, ...]:
    """Whether noise would leave such a residual once in a thousand, and whether the prior has room for the best fit."""
    return _quiet_check(posterior, mode), _within_check(posterior, mode)


def _quiet_check(posterior: Posterior, mode: Mode) -> Check:
    rests = heard_rests(posterior, mode.point).values()
    every = [own for rest in rests for own in (whiteness_probability(rest), steadiness(rest))]
    # That the smallest of so many is as small (Sidak).
    smallest = float(-np.expm1(len(every) * np.log1p(-min(every)))) if every and min(every) < 1.0 else 1.0
    return Check(
        name=QUIET,
        value=smallest,
        limit=QUIET_PROBABILITY,
        passed=smallest > QUIET_PROBABILITY,
        sentence=f"White noise would be as coloured or unsteady as the residual with probability {smallest:.2g}.",
    )


def _within_check(posterior: Posterior, mode: Mode) -> Check:
    """What a step beyond each bound that the best fit presses on would gain, to second order, the rest refitted."""
    at_low, at_high = mode.point < _AT_A_BOUND, mode.point > 1.0 - _AT_A_BOUND
    pressing = (at_low & (mode.gradient < 0.0)) | (at_high & (mode.gradient > 0.0))
    gains = np.zeros(posterior.n_dim)
    free = np.flatnonzero(~pressing)
    inner = mode.information[np.ix_(free, free)] + PRIOR_PRECISION * np.eye(len(free))
    for i in np.flatnonzero(pressing):
        cross = mode.information[free, i]
        left = mode.information[i, i] - cross @ np.linalg.solve(inner, cross)
        gains[i] = mode.gradient[i] ** 2 / (2.0 * max(float(left), PRIOR_PRECISION))
    worst = int(np.argmax(gains))
    parameter, end = posterior.space.parameters[worst], int(at_high[worst])
    gain, where = float(gains[worst]), f"the {('lower', 'upper')[end]} end of the prior of {parameter.name}, "
    where += f"{parameter.prior.support[end]:.4g}"
    joint = held_back(posterior, mode)
    if joint is not None and joint[1] > gain:
        gain, where = joint[1], f"the edge of what {joint[0].text} admits{_remedy(posterior.model, joint[0])}"
    sentence = (
        f"The best fit lies at {where}: beyond it lies a fit better by {gain:.1f} nats, and perhaps the truth."
        if gain > 0.0
        else "The best fit presses on no bound of its prior."
    )
    return Check(name=WITHIN, value=gain, limit=LARGEST_GAIN, passed=gain <= LARGEST_GAIN, sentence=sentence)


def _remedy(model: Structure, condition: Constraint) -> str:
    """How a model is freed of a joint condition, where it can be."""
    return " (hardens=True is without it)" if free_of(model, condition) is not None else ""
