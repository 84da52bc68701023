"""Predictive intervals of held-out samples that lie among the fitted ones, over all explanations.

A predicted sample is the response of a draw from the posterior and an error, which is one of those that the draw leaves
of the fitted samples: whatever their distribution is, those of samples amid them have the same. Explanations give draws
by their probabilities. Held-out measurements enter only where the share of them inside is counted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.probability import Beliefs
from bwbn_bayes.inference.importance import PARETO_LIMIT, laplace_mixture
from bwbn_bayes.inference.pooled import sample_learning
from bwbn_bayes.inference.tmcmc.resampling import systematic
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record

LEVEL = 0.9
"""Probability of an interval, half of the rest on each side."""
N_DRAWS = 400
"""Of all explanations together."""
_LEAST_EFFECTIVE, _MOST = 100, 30
"""Effective draws wanted of an explanation, and how many times as many draws are worth the trouble."""


@dataclass(frozen=True, kw_only=True)
class PredictiveInterval:
    """Where held-out samples are expected with a probability of 0.9, each by itself.

    Attributes
    ----------
    low, high : (n_channels, n_counted) array
        [unit of the channel]
    coverage : float
        Share of the measured samples inside.
    covered : float
        Share of the draws that stand for the whole posterior of their explanation, by the tail of their weights.
    """

    low: Floats
    high: Floats
    coverage: float
    covered: float = 1.0

    @property
    def in_words(self) -> str:
        """How many of the held-out points lie inside, in a sentence."""
        inside, level = 100.0 * self.coverage, 100.0 * LEVEL
        said = f"Of the held-out points {inside:.0f} % lie inside their {level:.0f} % predictive intervals."
        if self.covered >= 1.0:
            return said
        return f"{said} Of their draws {100.0 * (1.0 - self.covered):.0f} % may leave out a part of the posterior."


def predictive_interval(
    believed: Beliefs, record: Record, counted: NDArray[np.int64], rng: np.random.Generator
) -> PredictiveInterval:
    """Intervals at samples of a cyclic test whose other samples were fitted, and how many measured ones lie inside.

    Parameters
    ----------
    believed : Beliefs
        Explanations of the fitted samples.
    record : Record
        All of it.
    counted : (n_counted,) array
        Samples that were held out.
    rng : numpy.random.Generator
    """
    shares = np.bincount(systematic(believed.probabilities, N_DRAWS, rng), minlength=len(believed.explanations))
    chosen = [(one, n) for one, n in zip(believed.explanations, shares.tolist(), strict=True) if n > 0]
    draws = [_draws(one, n, rng) for one, n in chosen]
    every = zip(chosen, draws, strict=True)
    predicted = np.concatenate([_predicted(one, own.points, counted, rng) for (one, _), own in every])
    covered = sum(len(own.points) for own in draws if own.covers) / N_DRAWS
    solved = predicted[np.all(np.isfinite(predicted), axis=(1, 2))]
    low, high = np.quantile(solved, (0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL), axis=0)
    measured = record.measured[:, counted]
    inside = float(np.mean((measured >= low) & (measured <= high)))
    return PredictiveInterval(low=low, high=high, coverage=inside, covered=covered)


def _predicted(one: Explanation, points: Floats, counted: NDArray[np.int64], rng: np.random.Generator) -> Floats:
    """Draws ``(n, n_channels, n_counted)`` of an explanation's predictions at points ``(n, n_dim)``, with errors."""
    posterior = one.evidence.posterior
    record, values = posterior.record, posterior.split(points)[0]
    response = posterior.engine.simulate(posterior.model, values, record).values
    left = (record.measured - response)[:, :, record.kept]
    chosen = rng.integers(left.shape[2], size=(len(points), 1, len(counted)))
    return np.asarray(response[:, :, counted] + np.take_along_axis(left, chosen, axis=2))


class _Draws(NamedTuple):
    points: Floats
    covers: bool
    """Whether they stand for the whole posterior."""


def _draws(one: Explanation, n: int, rng: np.random.Generator) -> _Draws:
    """Points ``(n, n_dim)`` of the posterior under an explanation's own account of the errors."""
    wanted = max(n, _LEAST_EFFECTIVE)
    proposal = laplace_mixture(one.evidence.modes)
    weighted = sample_learning(one.evidence.posterior, proposal, rng, effective=wanted, most=_MOST * wanted)
    if not np.any(np.isfinite(weighted.log_weights)):
        return _Draws(np.repeat(one.evidence.modes[0].point[None], n, axis=0), False)
    covers = weighted.pareto_k <= PARETO_LIMIT and weighted.effective_sample_size >= wanted
    return _Draws(weighted.resampled(rng, n)[0], covers)
