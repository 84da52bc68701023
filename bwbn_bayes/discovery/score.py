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

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.inference.likelihood import Posterior
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


def score(posterior: Posterior, hypothesis: Hypothesis, point: Floats) -> Score:
    """Score a hypothesis at a point ``(n_dim,)`` of the unit cube of the present model.

    Parameters
    ----------
    posterior : Posterior
        Of the present model.
    hypothesis : Hypothesis
        With that model as its base.
    point : (n_dim,) array
        The present model's optimum.
    """
    view = posterior.with_model(hypothesis.model)
    amplitudes = hypothesis.amplitudes
    best = Score(nats=0.0, amplitude=amplitudes[0], unit="", smallest=np.inf)
    names = view.space.names
    for amplitude in amplitudes:
        column = names.index(amplitude)
        points = hypothesis.neutral_points(point, amplitude, _NEAR)
        local = view.linearise(points)
        parameter = view.space.parameters[column]
        scale = view.space.unit_scale(view.space.from_unit(points))[:, column]
        one_sided = parameter.prior.support[0] >= hypothesis.neutral(amplitude)
        base = np.array([names.index(name) for name in hypothesis.base.space.names])
        for i in range(len(points)):
            slope, information = _projected(local.gradient[i], local.information[i], base, column)
            if information <= 0.0:
                continue
            nats = 0.0 if one_sided and slope < 0.0 else slope**2 / (2.0 * information)
            smallest = float(scale[i] * np.sqrt(2.0 / information))
            best = Score(
                nats=max(float(nats), best.nats),
                amplitude=amplitude if smallest < best.smallest else best.amplitude,
                unit=parameter.unit if smallest < best.smallest else best.unit,
                smallest=min(smallest, best.smallest),
            )
    return best


def _projected(gradient: Floats, information: Floats, base: NDArray[np.int64], column: int) -> tuple[float, float]:
    """Slope and information of one coordinate with the base coordinates projected out."""
    own = information[np.ix_(base, base)] + _PRIOR_PRECISION * np.eye(len(base))
    weights = np.linalg.solve(own, information[base, column])
    left = float(information[column, column] - weights @ information[base, column])
    # What is left must exceed the rounding of what was taken away.
    if left < 1e-9 * float(information[column, column]):
        return 0.0, 0.0
    return float(gradient[column] - weights @ gradient[base]), left
