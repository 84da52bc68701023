"""How far stretches of a record agree that one explanation is better than another.

A difference of log evidence is a sum over the record. Where one of the explanations is right, the sum says it all:
samples are independent witnesses. Where both leave more than noise they are not, and what the sum is worth shows in
its scatter over stretches, as in the test of two wrong models.

References
----------
.. [1] Q. H. Vuong, "Likelihood Ratio Tests for Model Selection and Non-Nested Hypotheses", Econometrica 57(2), 1989,
   doi:10.2307/1912557: the ratio of the sum to its error; blocks in the place of samples, for errors that have a past,
   are ours.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import t as student

from bwbn_bayes.discovery.cross_validation import N_BLOCKS
from bwbn_bayes.discovery.evidence import Evidence
from bwbn_bayes.inference.likelihood import IntegratedNoise
from bwbn_bayes.inference.residuals import residual_of
from bwbn_bayes.parameters import Floats


def probability_of_being_better(one: Evidence, other: Evidence) -> float:
    """That the first explains further stretches better than the second, where neither is right.

    Parameters
    ----------
    one, other : Evidence
        Each under its own account of the errors.

    Returns
    -------
    float
        Student's distribution of the difference of log evidence over its error by the scatter of blocks.
    """
    gained = _of_blocks(one) - _of_blocks(other)
    error = float(np.std(gained, ddof=1)) * np.sqrt(len(gained))
    return float(student.cdf((one.log_evidence - other.log_evidence) / max(error, 1e-300), len(gained) - 1))


def _of_blocks(evidence: Evidence) -> Floats:
    """Log likelihood at the best fit of each of the record's blocks, ``(N_BLOCKS,)``, of whitened errors."""
    posterior, noise = evidence.posterior, evidence.posterior.noise
    residual = residual_of(posterior, evidence.modes[0].point)[:, posterior.record.kept]
    as_one = float(noise.as_one) if isinstance(noise, IntegratedNoise) else 1.0
    if noise.correlation is not None:
        residual = noise.correlation.whitened(residual)
    squared = np.square(residual) / np.mean(np.square(residual), axis=1, keepdims=True)
    level = np.sum(np.log(np.mean(np.square(residual), axis=1)))
    parts = np.array_split(np.arange(residual.shape[1]), N_BLOCKS)
    return np.array([-0.5 * (np.sum(squared[:, part]) + len(part) * level) / as_one for part in parts])
