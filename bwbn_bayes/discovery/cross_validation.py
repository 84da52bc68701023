"""How well a fitted model predicts stretches of the training record that it has not seen.

The record is parted into blocks, several joined records each by itself. Without each block the model is fitted again,
from its fit to all of the record: the first step takes the block's residuals and derivatives out of the normal
equations, a few more follow the model where it is bent. All are solved beside each other, in the lanes. What the fit to
the others predicts is compared with the block.

A cyclic test drives its specimen further with every cycle, and what is wanted of a law is what comes next: a block amid
known cycles says little of that. There, each block of the second half is predicted by a fit to what came before it. The
score is of the whole record then: the first half as it is fitted, the second as it is predicted, each with a level of
errors of its own. No law of a measured test predicts as well as it fits; by the level that its fit shows, the one that
fits worst would predict best.

References
----------
.. [1] D. M. Allen, "The relationship between variable selection and data augmentation and a method for prediction",
   Technometrics 16(1), 1974, doi:10.1080/00401706.1974.10489157.
.. [2] P. Burman, E. Chow and D. Nolan, "A cross-validatory method for dependent data", Biometrika 81(2), 1994,
   doi:10.1093/biomet/81.2.351.
.. [3] P.-C. Bürkner, J. Gabry and A. Vehtari, "Approximate leave-future-out cross-validation for Bayesian time series
   models", Journal of Statistical Computation and Simulation 90(14), 2020, doi:10.1080/00949655.2020.1783262 (cited
   from memory, not consulted).
.. [4] L. Breiman, J. Friedman, R. Olshen and C. Stone, "Classification and Regression Trees", 1984, section 3.4.3 (the
   rule of one standard error; cited from memory, not consulted).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.inference.likelihood import IntegratedNoise, Posterior
from bwbn_bayes.inference.refits import refitted
from bwbn_bayes.inference.slopes import Slopes
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record

N_BLOCKS = 16
"""Stretches that are left out in turn: what one solve of the lanes holds, each longer than noise remembers."""
_FEWEST = 2
"""Of each of several records."""
_N_STEPS, _N_AHEAD = 4, 8
"""Steps of each fit, and where much is left out: the first is exact for a linear model."""
_EDGE = 1e-6
"""Distance from a prior's bound, in prior probability, within which a parameter stays where it is."""


@dataclass(frozen=True, kw_only=True)
class CrossValidation:
    """How well blocks of the training record are predicted by fits to the others, or to those before them.

    Attributes
    ----------
    log_scores : tuple of float
        Log density of each stretch, normal with the noise level that the others show; where later ones are asked, of
        these with one level, and of what comes before them with another. [nat]
    nrmse : float
        Root mean square over the channels of each one's rms error over its rms.
    """

    log_scores: tuple[float, ...]
    nrmse: float

    @property
    def log_score(self) -> float:
        """Of all stretches, in nat."""
        return float(np.sum(self.log_scores))

    def is_better_than(self, other: CrossValidation) -> bool:
        """Whether it scores higher by more than the error of the difference, by its scatter over stretches [4]_."""
        if not np.isfinite(self.log_score) or not np.isfinite(other.log_score):
            return self.log_score > other.log_score
        gained = np.subtract(self.log_scores, other.log_scores)
        return bool(np.sum(gained) > np.std(gained, ddof=1) * np.sqrt(len(gained)))


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
    ahead = record.excitation_kind == "displacement"
    asked = _later(record) if ahead else stretches_of(record)
    known = np.array([_known(record, own, ahead=ahead) for _, own in asked])
    free = (point > _EDGE) & (point < 1.0 - _EDGE)
    starts, n_steps = np.tile(point, (len(asked), 1)), _N_AHEAD if ahead else _N_STEPS
    predicted = refitted(posterior, slopes, starts, n_steps, counts=known[:, None].astype(np.float64), free=free)
    with np.errstate(over="ignore", invalid="ignore"):
        error = record.measured - predicted.values
        squared, scaled = np.square(error), np.square(slopes.scaled(error))
    n_blocks = len(record.blocks)
    as_one = posterior.noise.as_one if isinstance(posterior.noise, IntegratedNoise) else np.ones(n_blocks)
    as_one = np.broadcast_to(as_one, n_blocks)
    scores: list[float] = []
    missed, measured = np.zeros(n_blocks), np.zeros(n_blocks)
    for position, block in enumerate(record.blocks):
        every = np.arange(record.n_times)[block.samples]
        own = [(number, stretch) for number, (part, stretch) in enumerate(asked) if part == block.part]
        wrong = [scaled[number, block.channel, stretch] for number, stretch in own]
        fitted = [scaled[number, block.channel, every[known[number, every]]] for number, _ in own]
        levels = [float(np.mean(one)) for one in fitted]
        if ahead and own:
            levels = [levels[0]] * len(own) + [float(np.mean(np.concatenate(wrong)))] * len(own)
            wrong = [*np.array_split(fitted[0], len(own)), *wrong]
        for one, level in zip(wrong, levels, strict=True):
            density = np.sum(one) / level + len(one) * np.log(2.0 * np.pi * level * slopes.noise[position] ** 2)
            scores.append(-0.5 * float(density / as_one[position]))
        for number, stretch in own:
            missed[position] += np.sum(squared[number, block.channel, stretch])
            measured[position] += np.sum(np.square(record.measured[block.channel, stretch]))
    if not np.all(np.isfinite(scores)):
        return CrossValidation(log_scores=(-np.inf,), nrmse=np.inf)
    shares = missed[measured > 0.0] / measured[measured > 0.0]
    return CrossValidation(log_scores=tuple(scores), nrmse=float(np.sqrt(np.mean(shares))))


def _later(record: Record) -> list[tuple[int, NDArray[np.int64]]]:
    """The second half of each part's stretches."""
    every, found = stretches_of(record), []
    for part in range(len(record.parts)):
        own = [stretch for stretch in every if stretch[0] == part]
        found += own[len(own) // 2 :]
    return found


def _known(record: Record, left_out: NDArray[np.int64], *, ahead: bool) -> NDArray[np.bool_]:
    """Samples ``(n_times,)`` that a stretch is predicted from: all others, or those before it and other runs."""
    known = np.ones(record.n_times, dtype=np.bool_)
    known[left_out] = False
    if ahead:
        (end,) = (run.stop for _, run in record.runs if run.start <= left_out[0] < run.stop)
        known[left_out[0] : end] = False
    return known


def stretches_of(record: Record) -> list[tuple[int, NDArray[np.int64]]]:
    """Samples that are left out in turn, and the part that they lie in: by its share of what counts, two at least.

    What one leaves of its channels, the others of the same part say the noise level of.
    """
    found = []
    samples = np.arange(record.n_times)
    for number, (part, stretch) in enumerate(zip(record.parts, record.stretches, strict=True)):
        if part.channels:
            own = samples[stretch][part.kept]
            n = max(round(N_BLOCKS * len(own) / record.n_counted), _FEWEST)
            found += [(number, one) for one in np.array_split(own, n)]
    return found
