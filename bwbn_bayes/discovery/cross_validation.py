"""How well a fitted model predicts stretches of the training record that it has not seen, and which of two does better.

The record is parted into blocks. What the parameters would be without a block follows to first order from the fit to
all of it (the step that takes the block's residuals and derivatives out of the normal equations); the model is then
solved in full with these parameters and compared with the block. Nothing is fitted again.

References
----------
.. [1] D. M. Allen, "The relationship between variable selection and data augmentation and a method for prediction",
   Technometrics 16(1), 1974, doi:10.1080/00401706.1974.10489157.
.. [2] P. Burman, E. Chow and D. Nolan, "A cross-validatory method for dependent data", Biometrika 81(2), 1994,
   doi:10.1093/biomet/81.2.351.
.. [3] Q. H. Vuong, "Likelihood Ratio Tests for Model Selection and Non-Nested Hypotheses", Econometrica 57(2), 1989,
   doi:10.2307/1912557: two wrong models are told apart by their difference over its error from its scatter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from bwbn_bayes.inference.identifiability import PRIOR_PRECISION
from bwbn_bayes.inference.likelihood import IntegratedNoise, Posterior
from bwbn_bayes.inference.residuals import residual_of
from bwbn_bayes.inference.slopes import Slopes
from bwbn_bayes.parameters import Floats

N_BLOCKS = 16
"""Stretches that are left out in turn: what one solve of the lanes holds, each longer than noise remembers."""
_EDGE = 1e-6
"""Distance from a prior's bound, in prior probability, within which a parameter stays where it is."""


@dataclass(frozen=True, kw_only=True)
class CrossValidation:
    """How well blocks of the training record are predicted by a fit to the others.

    Attributes
    ----------
    of_blocks : tuple of float
        Log density of each block, normal with the noise level that the others show. [nat]
    nrmse : float
        Root mean square over the channels of each one's rms error over its rms.
    """

    of_blocks: tuple[float, ...]
    nrmse: float

    @property
    def log_score(self) -> float:
        """Log density of all blocks, in nat."""
        return sum(self.of_blocks)

    def probability_of_being_better(self, other: CrossValidation) -> float:
        """That this model predicts further stretches better than another, where neither is right.

        Samples are no independent witnesses then. What scatters from block to block says what the sum is worth:
        Student's distribution of the mean difference over its error.
        """
        if not (np.isfinite(self.log_score) and np.isfinite(other.log_score)):
            return float(self.log_score > other.log_score)
        gained = np.subtract(self.of_blocks, other.of_blocks)
        error = float(np.std(gained, ddof=1)) / np.sqrt(len(gained))
        return float(student.cdf(np.mean(gained) / max(error, 1e-300), len(gained) - 1))


def cross_validated(posterior: Posterior, point: Floats) -> CrossValidation:
    """Leave each block out in turn.

    Parameters
    ----------
    posterior : Posterior
        Where its errors are autoregressive, the log score is that of what their past does not tell.
    point : (n_dim,) array
        Its optimum, in the unit cube.

    Returns
    -------
    CrossValidation
        Minus infinity and infinity where the model cannot be solved without a block.
    """
    record, slopes = posterior.record, Slopes.at(posterior, point)
    blocks = np.array_split(np.arange(record.n_counted), N_BLOCKS)
    points = _without_each(slopes, slopes.scaled(residual_of(posterior, point)), point, blocks)
    posterior.solves.add(len(points))
    predicted = posterior.engine.simulate(posterior.model, posterior.split(points)[0], record).values
    with np.errstate(over="ignore", invalid="ignore"):
        error = record.measured - predicted
        squared, scaled = np.square(error[..., record.kept]), np.square(slopes.scaled(error))
    of_blocks, missed = np.zeros(len(blocks)), np.zeros(len(record.channels))
    for number, block in enumerate(blocks):
        inside = np.sum(scaled[number][:, block], axis=1)
        level = (np.sum(scaled[number], axis=1) - inside) / (record.n_counted - len(block))
        density = inside / level + len(block) * np.log(2.0 * np.pi * level * slopes.noise[:, 0] ** 2)
        of_blocks[number] = -0.5 * np.sum(density)
        missed += np.sum(squared[number][:, block], axis=1)
    if not np.all(np.isfinite(of_blocks)):
        return CrossValidation(of_blocks=(-np.inf,) * N_BLOCKS, nrmse=np.inf)
    shares = missed / np.sum(np.square(record.measured[:, record.kept]), axis=1)
    as_one = float(posterior.noise.as_one) if isinstance(posterior.noise, IntegratedNoise) else 1.0
    return CrossValidation(of_blocks=tuple((of_blocks / as_one).tolist()), nrmse=float(np.sqrt(np.mean(shares))))


def _without_each(slopes: Slopes, scaled: Floats, point: Floats, blocks: Sequence[NDArray[np.int64]]) -> Floats:
    """Optima ``(n_blocks, n_dim)`` without each block, to first order and within the priors' bounds."""
    free = (point > _EDGE) & (point < 1.0 - _EDGE)
    together = slopes.base[:, free]
    whole = together.T @ together + PRIOR_PRECISION * np.eye(together.shape[1])
    base = together.reshape(*scaled.shape, -1)
    points = np.tile(point, (len(blocks), 1))
    for number, block in enumerate(blocks):
        own = base[:, block].reshape(-1, base.shape[2])
        step = np.linalg.solve(whole - own.T @ own, own.T @ scaled[:, block].ravel())
        points[number, free] = np.clip(point[free] - step, _EDGE, 1.0 - _EDGE)
    return points
