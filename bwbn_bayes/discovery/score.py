"""Projected scores: what a small amount of an effect could explain that the present model's parameters cannot.

At its neutral value an effect's amplitude has a slope, taken by moving it a little: under the one law of every effect
a derivative costs as much as ten solves. With the slopes of the present model's parameters projected out, the score is
``g^2 / (2 I)`` nats, maximised over a grid of what vanishes at neutral (a width, a time, a gap). The score orders the
work and gives the detection limits. It does not exclude a hypothesis while the residual is not noise.

References
----------
.. [1] R. B. Davies, "Hypothesis testing when a nuisance parameter is present only under the alternative", Biometrika
   74(1), 1987, doi:10.1093/biomet/74.1.33.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.discovery.family import Family, families
from bwbn_bayes.discovery.workers import ONE_THREAD, Workers
from bwbn_bayes.inference.accuracy import in_doubles
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.slopes import Slopes
from bwbn_bayes.parameters import Floats

_NEAR = 1e-4
"""How far from neutral an amplitude is moved, in prior probability."""


@dataclass(frozen=True, kw_only=True)
class Score:
    """What a hypothesis could explain to first order, at its best over the grid of nuisances.

    Attributes
    ----------
    nats : float
        Expected gain in log likelihood, one-sided where the amplitude is.
    amplitude : str
        The parameter that switches the effect on.
    unit : str
        Its unit.
    smallest : float
        The amplitude whose expected gain is one nat, in its own unit; infinite where the record cannot show it.
    size : float
        How far from neutral the amplitude gains that, in its own unit; zero where it gains nothing.
    """

    nats: float
    amplitude: str
    unit: str
    smallest: float
    size: float

    def named_from(self, log_odds: float, prior_sd: float) -> float:
        """Amplitude at which the log Bayes factor of a normal prior about neutral reaches a number of nats.

        Parameters
        ----------
        log_odds : float
            To reach. [nat]
        prior_sd : float
            Of the amplitude, in its unit.
        """
        if not np.isfinite(self.smallest):
            return np.inf
        ratio = 2.0 * (prior_sd / self.smallest) ** 2
        return float(self.smallest * np.sqrt((1.0 + 1.0 / ratio) * (log_odds + 0.5 * np.log1p(ratio))))


def scores(
    posterior: Posterior, hypotheses: Sequence[Hypothesis], point: Floats, *, workers: Workers = ONE_THREAD
) -> tuple[Score, ...]:
    """Score hypotheses at a point ``(n_dim,)`` of the unit cube of the present model.

    Parameters
    ----------
    posterior : Posterior
        Of the present model; its engine should use one thread.
    hypotheses : sequence of Hypothesis
        With that model as their base.
    point : (n_dim,) array
        The present model's optimum.
    workers : Workers
        Score families.
    """
    posterior = in_doubles(posterior)
    present = Slopes.at(posterior, point)
    score, every = partial(_score_family, posterior, point, present), families(hypotheses)
    found = (made[0] for made in workers.each(score, every) if made is not None)
    members = (member for family in every for member in family.members)
    by_hypothesis = dict(zip(members, (one for part in found for one in part), strict=True))
    return tuple(by_hypothesis[hypothesis] for hypothesis in hypotheses)


def _score_family(posterior: Posterior, point: Floats, present: Slopes, family: Family) -> list[Score]:
    """Of each member of a family."""
    view = family.posterior(posterior)
    asked = [(member, amplitude) for member in family.members for amplitude in member.amplitudes]
    best: dict[Hypothesis, Score] = {}
    grids = [[member.neutral_points(point, amplitude, near) for near in (0.0, _NEAR)] for member, amplitude in asked]
    owner = np.repeat(np.arange(len(asked)), [len(neutral) for neutral, _ in grids])
    columns = np.array([family.model.space.names.index(amplitude) for _, amplitude in asked])[owner]
    at_neutral, moved = (
        view.split(np.concatenate([family.embed(m, own)[0] for (m, _), own in zip(asked, side, strict=True)]))[0]
        for side in zip(*grids, strict=True)
    )
    step = (moved - at_neutral)[np.arange(len(columns)), columns]
    response = view.engine.simulate(view.model, np.concatenate([at_neutral, moved]), view.record).values
    neutral, beyond = np.split(response, 2)
    slopes = (beyond - neutral) / step[:, None, None]
    projected = present.projected(neutral, slopes)
    for number, (member, amplitude) in enumerate(asked):
        one = _best(member, amplitude, projected[owner == number])
        if member not in best or one.nats > best[member].nats:
            best[member] = one
    return [best[member] for member in family.members]


def _best(member: Hypothesis, amplitude: str, projected: Floats) -> Score:
    """The best score of one amplitude over the grid of nuisances."""
    space = member.model.space
    parameter = space.parameters[space.names.index(amplitude)]
    one_sided = parameter.prior.support[0] >= member.neutral(amplitude)
    slope, left = projected[projected[:, 1] > 0.0].T
    if len(left) == 0:
        return Score(nats=0.0, amplitude=amplitude, unit=parameter.unit, smallest=np.inf, size=0.0)
    size = np.where((slope > 0.0) | (not one_sided), slope / left, 0.0)
    gain = 0.5 * left * size**2
    best = np.argmax(gain)
    return Score(
        nats=float(gain[best]),
        amplitude=amplitude,
        unit=parameter.unit,
        smallest=float(np.sqrt(2.0 / np.max(left))),
        size=float(size[best]),
    )
