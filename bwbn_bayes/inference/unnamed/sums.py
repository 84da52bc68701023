"""The evidence of forces beside a model, linear in both, with noise levels and the forces' scale integrated out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from bwbn_bayes.inference.identifiability import PRIOR_PRECISION
from bwbn_bayes.inference.likelihood import IntegratedNoise, Noise
from bwbn_bayes.inference.residuals import noise_floors
from bwbn_bayes.inference.slopes import Slopes
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.blocks import by_block, counts


def half_normal_scales(least: float, n: int) -> tuple[Floats, Floats]:
    """Scales ``(n,)`` over the standard deviation of a half-normal prior, and the prior mass that each stands for."""
    scales = np.geomspace(least, 6.0, n)
    return scales, np.sqrt(2.0 / np.pi) * np.exp(-0.5 * np.square(scales)) * np.gradient(scales)


_RELATIVE_SCALES, _DENSITY = half_normal_scales(1e-2, 97)
"""Scales of the force over which it is integrated."""
_N_TURNS, _SETTLED = 8, 1e-2
"""In which the noise level and the force's scale find each other, and the relative change of the level that ends it."""
_MUCH = 1.5
"""Times the noise's power that a model takes for noise, from which a second start is worth its time."""


class Settled(NamedTuple):
    """A log evidence, but for a constant, and what is expected where most of it comes from.

    Steps of the other parameters ``(n_base,)``, weights of the force ``(n_weights,)``, and its scale over the standard
    deviation of the scale's prior.
    """

    log_evidence: float
    others: Floats
    weights: Floats
    scale: float


@dataclass(frozen=True, kw_only=True)
class Sums:
    """A linear model's products: its slopes, the answers to a force and the residual, with each other, by block.

    Attributes
    ----------
    products : (n_blocks, n, n) array
        Of slopes, then answers, then the residual, over the noise.
    n_base : int
        Slopes among them.
    n_counted : (n_blocks,) array
        Samples of each.
    noise : IntegratedNoise
    level : (n_blocks,) array
        Noise standard deviation over which the products are.
    floor : (n_blocks,) array
        Its model-free estimate.
    present : (n_weights,) array
        Weights of the force about which the model is linear.
    """

    products: Floats
    n_base: int
    n_counted: Floats
    noise: IntegratedNoise
    level: Floats
    floor: Floats
    present: Floats

    @classmethod
    def of(
        cls, slopes: Slopes, noise: Noise, base: Floats, answers: Floats, *, unforced: Floats, present: Floats
    ) -> Sums:
        """Those of a residual, slopes of it by other parameters, and answers to forces.

        Parameters
        ----------
        slopes : Slopes
            With the noise over which all is.
        noise : Noise
            Integrated out.
        base : (n_base, n_channels * n_times) array
            Slopes by parameters that are no weights of the force.
        answers : (n_weights, n_channels, n_times) array
            To each function of the force, times the standard deviation of its weight.
        unforced : (n_channels, n_times) array
            Residual beside the ``present`` force.
        present : (n_weights,) array
            Weights of unit variance, about which all is linear.
        """
        assert isinstance(noise, IntegratedNoise)
        record = slopes.record
        columns = np.concatenate([base.reshape(len(base), *unforced.shape), answers, unforced[None]])
        return cls(
            products=np.array([own @ own.T for own in by_block(record, columns)]),
            n_base=len(base),
            n_counted=counts(record),
            noise=noise,
            level=slopes.noise,
            floor=noise_floors(record),
            present=present,
        )

    @property
    def alone(self) -> float:
        """Log evidence without the force, but for a constant."""
        return self.without(np.ones(len(self.level)))[0]

    def settled(self) -> Settled:
        """What noise levels and scale come to.

        With the force the noise may be smaller: its level and the force's scale are looked for in turns. A model that
        lacks much takes it for noise: they begin at the model-free level too.
        """
        by_itself = np.square(self.level / np.maximum(self.floor, 1e-300))
        starts = (np.ones(len(by_itself)), *([by_itself] if np.any(by_itself > _MUCH) else []))
        return max((self._settled_from(start) for start in starts), key=lambda found: found.log_evidence)

    def at_scale(self, scale: float) -> float:
        """The log evidence at one scale, over the standard deviation of its prior, and at the noise level given."""
        plain, left, _ = self.without(np.ones(len(self.level)))
        return plain + float(self._by_scale(left, np.array([scale]))[0][0])

    def _by_scale(self, left: Floats, scales: Floats) -> tuple[Floats, Floats, Floats]:
        """What weights of each scale add to the log evidence, their expected steps, and the variance of each scale."""
        information, turned = np.linalg.eigh(left[:-1, :-1])
        information, slope, present = np.maximum(information, 0.0), left[:-1, -1] @ turned, self.present @ turned
        # A step from the present weights, since what answers to them whole may be far larger than what is left.
        tied = 1.0 / np.square(scales)[:, None]
        pull, hold = slope - tied * present, information + tied
        added = 0.5 * np.sum(np.square(pull) / hold - tied * np.square(present) - np.log(hold / tied), axis=1)
        return added, (pull / hold) @ turned.T, np.square(scales)

    def _settled_from(self, precision: Floats) -> Settled:
        """From a precision ``(n_blocks,)`` on, over that without the force."""
        n = self.n_base
        best = Settled(-np.inf, np.zeros(n), np.zeros(self.products.shape[1] - n - 1), 1.0)
        for _ in range(_N_TURNS):
            plain, left, taken = self.without(precision)
            by_scale, steps, variance = self._by_scale(left, _RELATIVE_SCALES)
            log_evidence = plain + float(logsumexp(by_scale, b=_DENSITY))
            at = int(np.argmax(by_scale + np.log(_DENSITY)))
            step = steps[at]
            beside = taken[:, -1] - taken[:, :-1] @ step
            if log_evidence > best.log_evidence:
                best = Settled(log_evidence, beside, self.present + step, float(_RELATIVE_SCALES[at]))
            wanted = self._precision(precision, np.concatenate([beside, step]), float(variance[at]))
            if np.all(np.abs(np.log(wanted / precision)) < _SETTLED):
                break
            precision = wanted
        return best

    def without(self, precision: Floats) -> tuple[float, Floats, Floats]:
        """Log evidence without the force, but for a constant; the products with the slopes projected out; what was.

        The last are the slopes' coefficients in the answers and in the residual.
        """
        n, whole = self.n_base, np.tensordot(precision, self.products, axes=1)
        others = whole[:n, :n] + PRIOR_PRECISION * np.eye(n)
        taken = np.linalg.solve(others, whole[:n, n:])
        left = whole[n:, n:] - whole[n:, :n] @ taken
        as_one = self.noise.as_one
        whole_precision = precision / np.square(self.level)
        rate = as_one * np.asarray(self.noise.scale)
        counted = 0.5 * self.n_counted / as_one + self.noise.shape
        of_level = np.sum(counted * np.log(whole_precision) - whole_precision * rate)
        return float(of_level - 0.5 * left[-1, -1] - 0.5 * np.linalg.slogdet(others)[1]), left, taken

    def _precision(self, precision: Floats, expected: Floats, variance: float) -> Floats:
        """The precision that what is left on the average, over weights and the other parameters, deserves."""
        n, whole = self.n_base, np.tensordot(precision, self.products, axes=1)
        prior = np.append(np.full(n, PRIOR_PRECISION), np.full(len(expected) - n, 1.0 / variance))
        spread = np.linalg.inv(whole[:-1, :-1] + np.diag(prior))
        own = np.append(expected, -1.0)
        misfit = np.array([own @ one @ own + np.sum(spread * one[:-1, :-1]) for one in self.products])
        squared = np.square(self.level)
        (deserved,) = self.noise.precision((misfit * squared)[None], self.n_counted, np.empty((1, 0)))
        return np.asarray(squared * deserved)
