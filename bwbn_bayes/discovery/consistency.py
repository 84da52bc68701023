"""How far stretches of a record agree that one explanation is better than another.

A difference of log evidence is a sum over the record. Where one of the explanations is right, the sum says it all:
samples are independent witnesses. Where both leave more than noise they are not, and what the sum is worth shows in
its scatter over stretches, as in the test of two wrong models.

References
----------
.. [1] Q. H. Vuong, "Likelihood Ratio Tests for Model Selection and Non-Nested Hypotheses", Econometrica 57(2), 1989,
   doi:10.2307/1912557: the ratio of the sum to its error; stretches in the place of samples, for errors that have a
   past, are ours.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import t as student

from bwbn_bayes.discovery.cross_validation import stretches_of
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
        Student's distribution of the difference of log evidence over its error by the scatter of stretches.
    """
    gained = of_stretches(one) - of_stretches(other)
    error = float(np.std(gained, ddof=1)) * np.sqrt(len(gained))
    return float(student.cdf((one.log_evidence - other.log_evidence) / max(error, 1e-300), len(gained) - 1))


def of_stretches(evidence: Evidence) -> Floats:
    """Log likelihood at the best fit of each stretch of the record ``(n_stretches,)``, each channel of one level."""
    posterior, record, correlation = evidence.posterior, evidence.posterior.record, evidence.correlation
    residual = residual_of(posterior, evidence.modes[0].point)
    white = residual if correlation is None else correlation.whitened(residual)
    volumes = np.zeros(white.shape)
    if correlation is not None and correlation.shared is not None:
        volumes += correlation.shared.log_volumes.reshape(white.shape)
    noise = posterior.noise
    as_one = np.broadcast_to(noise.as_one if isinstance(noise, IntegratedNoise) else 1.0, len(record.blocks))
    stretches = stretches_of(record)
    found = np.zeros(len(stretches))
    for block, counts in zip(record.blocks, as_one.tolist(), strict=True):
        squared = np.square(white[block.channel])
        level = float(np.mean(squared[block.samples]))
        density = -0.5 * (squared / level + np.log(2.0 * np.pi * level)) / counts + volumes[block.channel]
        found += [float(np.sum(density[own])) if part == block.part else 0.0 for part, own in stretches]
    return found
