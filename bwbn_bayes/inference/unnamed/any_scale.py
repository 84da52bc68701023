"""White errors beside a force of known functions whose scale is not known: it is integrated out of the likelihood.

The scale of a specimen's unnamed force has a half-normal prior. Given what a law leaves, the likelihood at each of many
scales costs next to nothing once the residual stands in the force's functions: sums over a grid of them are smooth in
the law's parameters, so that an optimum, a step towards it and its curvature are those of the likelihood that decides.

References
----------
.. [1] M. C. Kennedy and A. O'Hagan, "Bayesian calibration of computer models", J. R. Statist. Soc. B 63(3), 2001,
   doi:10.1111/1467-9868.00294.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import logsumexp, softmax

from bwbn_bayes.inference.correlation import Correlation
from bwbn_bayes.inference.likelihood import IntegratedNoise, Posterior
from bwbn_bayes.inference.scaled import PER_OCTAVE, SCALES, ScaledCorrelation
from bwbn_bayes.parameters import Floats, FreeParameter
from bwbn_bayes.records.record import Record

_BEYOND = 1e100
"""Scale over that of the prior, beyond which one is as impossible as another."""


@dataclass(frozen=True, kw_only=True)
class NoiseBesideForce:
    """Noise of one channel beside a force: its variance and the force's scale are integrated out.

    Blocks are scales: the likelihood is a sum over them.

    Parameters
    ----------
    white : IntegratedNoise
        Of what the force does not explain.
    correlation : ScaledCorrelation
        The force's functions.
    largest : float
        Standard deviation of the half-normal prior of the force's scale. [unit of the channel]
    """

    white: IntegratedNoise
    correlation: ScaledCorrelation = field(repr=False)
    largest: float

    @property
    def n_blocks(self) -> int:
        return len(SCALES)

    @property
    def parameters(self) -> tuple[FreeParameter, ...]:
        return ()

    def until(self, record: Record) -> NoiseBesideForce:
        return replace(self, correlation=self.correlation.until(record))

    def log_likelihood(self, misfit: Floats, n_times: float | Floats, values: Floats) -> Floats:
        return np.asarray(logsumexp(self._joint(misfit, n_times), axis=1))

    def precision(self, misfit: Floats, n_times: float | Floats, values: Floats) -> Floats:
        of_each = self.white.precision(misfit, self._counted(n_times), values)
        share = np.square(SCALES / self.largest) * self._variance(misfit, n_times)
        prior = (share - 1.0) / (2.0 * self.white.as_one * np.asarray(self.white.scale) + misfit)
        return np.asarray(softmax(self._joint(misfit, n_times), axis=1) * (of_each + prior))

    def most(self, promised: Floats, n_times: float | Floats) -> Floats:
        return self.white.most(promised, self._counted(n_times))

    def draw_sd(self, rng: np.random.Generator, misfit: Floats, n_times: float | Floats, values: Floats) -> Floats:
        chances = softmax(self._joint(misfit, n_times), axis=1)
        chosen = np.sum(np.cumsum(chances, axis=1) < rng.random(len(misfit))[:, None], axis=1)
        own = misfit[np.arange(len(misfit)), np.minimum(chosen, len(SCALES) - 1)]
        return self.white.draw_sd(rng, own[:, None], self._counted(n_times), values)

    def settled(self, misfit: Floats, n_times: float | Floats) -> IntegratedNoise:
        """At the most probable scale, given squared residuals ``(1, n_scales)``."""
        best = int(np.argmax(self._joint(misfit, n_times)[0]))
        log_prior = float(self._log_prior(misfit, n_times)[0, best])
        shared = self.correlation.shared.times(float(SCALES[best]))
        return replace(self.white, correlation=Correlation(shared=shared, log_prior=log_prior))

    def describe(self) -> str:
        return f"{self.white.describe()} So is the scale of a force of no known law, half-normal of {self.largest:.3g}."

    def _joint(self, misfit: Floats, n_times: float | Floats) -> Floats:
        """Log likelihood and prior of each scale, ``(n_draws, n_scales)``."""
        nothing = np.empty((misfit.size, 0))
        own = self.white.log_likelihood(misfit.reshape(-1, 1), self._counted(n_times), nothing).reshape(misfit.shape)
        return np.asarray(own + self.correlation.log_volumes + self._log_prior(misfit, n_times))

    def _log_prior(self, misfit: Floats, n_times: float | Floats) -> Floats:
        """Prior mass that each scale stands for; the level is the one expected there."""
        # A draw that ran away leaves infinite squares.
        share = np.minimum(SCALES / self.largest * np.sqrt(self._variance(misfit, n_times)), _BEYOND)
        return np.asarray(0.5 * np.log(2.0 / np.pi) + np.log(share * np.log(2.0) / PER_OCTAVE) - 0.5 * np.square(share))

    def _variance(self, misfit: Floats, n_times: float | Floats) -> Floats:
        as_one = self.white.as_one
        rate = np.asarray(self.white.scale) + 0.5 * misfit / as_one
        return np.asarray(rate / (self.white.shape + 0.5 * self._counted(n_times) / as_one))

    @staticmethod
    def _counted(n_times: float | Floats) -> float:
        """Samples of the one channel, which all scales see."""
        return float(np.ravel(n_times)[0])


def without_force(posterior: Posterior) -> Posterior:
    """The posterior without a force beside its law."""
    noise = posterior.noise
    return posterior.with_noise(noise.white) if isinstance(noise, NoiseBesideForce) else posterior
