"""Predictive intervals of held-out samples that lie among the fitted ones, over all explanations.

A predicted sample is the response of a draw from the posterior, plus what the force of no known law is expected to be
there given what the fitted samples leave, plus that force's remaining spread and the noise. How far that spread is to
be believed the fitted half cycles tell: each is predicted from the others, and by as much as they miss more than the
spread says, or less, it is stretched [1]_. Explanations give draws by their probabilities. Held-out measurements enter
only where the share of them inside is counted.

References
----------
.. [1] V. Vovk, A. Gammerman and G. Shafer, "Algorithmic Learning in a Random World", 2nd ed., 2022,
   doi:10.1007/978-3-031-06649-8 (cross-conformal prediction, normalised errors; cited from memory, not consulted).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.probability import Beliefs
from bwbn_bayes.inference.correlation import conditioned
from bwbn_bayes.inference.importance import PARETO_LIMIT, laplace_mixture
from bwbn_bayes.inference.pooled import sample_learning
from bwbn_bayes.inference.residuals import residual_of
from bwbn_bayes.inference.tmcmc.resampling import systematic
from bwbn_bayes.inference.unnamed.specimen import unnamed_basis
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.cycles import half_cycles
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
    """Draws ``(n, n_channels, n_counted)`` of what an explanation predicts at points ``(n, n_dim)``, with its noise."""
    posterior = one.evidence.settled
    record, noise = posterior.record, posterior.noise
    values, noise_values = posterior.split(points)
    response = posterior.engine.simulate(posterior.model, values, record).values
    sd = noise.draw_sd(rng, posterior.misfit(points), record.n_counted, noise_values)[:, :, None]
    mean, variance = response[:, :, counted], np.zeros(len(counted))
    correlation = one.evidence.correlation
    if correlation is not None and correlation.shared is not None:
        fitted = np.arange(record.n_times)[record.kept]
        left = (record.measured - response)[:, 0, fitted]
        expected, variance = conditioned(unnamed_basis(record), correlation.shared.scale, fitted, counted, left)
        mean, sd = mean + expected[:, None], sd * _stretched(one)
    return np.asarray(mean + sd * np.sqrt(1.0 + variance) * rng.standard_normal(mean.shape))


def _stretched(one: Explanation) -> float:
    """How much farther the fitted half cycles lie from what the others say of them than the force's spread says.

    Of an interval that holds nine of ten of their samples over one that a normal distribution would have.
    """
    posterior, correlation = one.evidence.settled, one.evidence.correlation
    assert correlation is not None and correlation.shared is not None
    record, point = posterior.record, one.evidence.modes[0].point
    left, basis = residual_of(posterior, point), unnamed_basis(record)
    fitted, every = np.arange(record.n_times)[record.kept], np.arange(record.n_times)
    level = float(np.sqrt(posterior.misfit(point[None])[0, 0] / record.n_counted))
    misses = []
    for cycle in half_cycles(record.excitation):
        own = np.intersect1d(every[cycle.first + 1 : cycle.last + 1], fitted)
        others = np.setdiff1d(fitted, own)
        if own.size and others.size:
            expected, variance = conditioned(basis, correlation.shared.scale, others, own, left[:, others])
            misses.append(np.abs(left[0, own] - expected[0]) / (level * np.sqrt(1.0 + variance)))
    if not misses:
        return 1.0
    return float(np.quantile(np.concatenate(misses), LEVEL) / norm.ppf(0.5 + 0.5 * LEVEL))


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
