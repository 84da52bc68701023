"""Projected scores: what a small amount of an effect could explain that the present model's parameters cannot.

At its neutral value an effect's amplitude a has a slope; with the slopes of the present model's parameters projected
out, its score is ``g^2 / (2 I)`` nats, maximised over a grid of what vanishes at neutral (a width, a time, a gap). The
score orders the work and gives the detection limits. It does not exclude a hypothesis while the residual is not noise.

References
----------
.. [1] R. B. Davies, "Hypothesis testing when a nuisance parameter is present only under the alternative", Biometrika
   74(1), 1987, doi:10.1093/biomet/74.1.33.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.discovery.family import Family, families
from bwbn_bayes.inference.likelihood import Linearisation, Posterior
from bwbn_bayes.parameters import Floats

_NEAR = 1e-3
"""Distance from neutral at which a one-sided amplitude's slope is taken, in prior probability."""
_PRIOR_PRECISION = 12.0


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
    """

    nats: float
    amplitude: str
    unit: str
    smallest: float

    def detectable(self, nats: float) -> float:
        """Amplitude that would gain the given number of nats."""
        return float(self.smallest * np.sqrt(nats))


def scores(
    posterior: Posterior, hypotheses: Sequence[Hypothesis], point: Floats, *, n_workers: int
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
    n_workers : int
        Families scored at once.
    """
    with ThreadPoolExecutor(max_workers=n_workers) as pool:
        found = pool.map(lambda family: _score_family(posterior, family, point), families(hypotheses))
        by_hypothesis = {hypothesis: one for part in found for hypothesis, one in part}
    return tuple(by_hypothesis[hypothesis] for hypothesis in hypotheses)


def _score_family(posterior: Posterior, family: Family, point: Floats) -> list[tuple[Hypothesis, Score]]:
    view = family.posterior(posterior)
    asked = [(member, amplitude) for member in family.members for amplitude in member.amplitudes]
    points = [member.neutral_points(point, amplitude, _NEAR) for member, amplitude in asked]
    embedded = [family.embed(member, own)[0] for (member, _), own in zip(asked, points, strict=True)]
    local = view.linearise(np.concatenate(embedded))
    first = 0
    best: dict[Hypothesis, Score] = {}
    for (member, amplitude), own in zip(asked, points, strict=True):
        rows = np.arange(first, first + len(own))
        first += len(own)
        one = _best(member, amplitude, own, family.extract(member, local[rows]))
        if member not in best or one.nats > best[member].nats:
            best[member] = one
    return list(best.items())


def _best(member: Hypothesis, amplitude: str, points: Floats, local: Linearisation) -> Score:
    """The best score of one amplitude over the grid of nuisances."""
    space = member.model.space
    column = space.names.index(amplitude)
    base = np.array([space.names.index(name) for name in member.base.space.names])
    parameter = space.parameters[column]
    scale = space.unit_scale(space.from_unit(points))[:, column]
    one_sided = parameter.prior.support[0] >= member.neutral(amplitude)
    nats, smallest = 0.0, np.inf
    for gradient, information, unit in zip(local.gradient, local.information, scale, strict=True):
        slope, left = _projected(gradient, information, base, column)
        if left <= 0.0:
            continue
        smallest = min(smallest, float(unit * np.sqrt(2.0 / left)))
        if slope > 0.0 or not one_sided:
            nats = max(nats, slope**2 / (2.0 * left))
    return Score(nats=nats, amplitude=amplitude, unit=parameter.unit, smallest=smallest)


def _projected(gradient: Floats, information: Floats, base: NDArray[np.int64], column: int) -> tuple[float, float]:
    """Slope and information of one coordinate with the base coordinates projected out."""
    own = information[np.ix_(base, base)] + _PRIOR_PRECISION * np.eye(len(base))
    weights = np.linalg.solve(own, information[base, column])
    left = float(information[column, column] - weights @ information[base, column])
    # What is left must exceed the rounding of what was taken away.
    if left < 1e-9 * float(information[column, column]):
        return 0.0, 0.0
    return float(gradient[column] - weights @ gradient[base]), left
