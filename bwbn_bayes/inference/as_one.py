"""How many samples count as one, where what a law leaves of them hangs together.

Samples of noise are independent witnesses. Those of a law's own error are not: many of them show the same error. A
likelihood that takes them for independent is steeper than they bear out, by the variance of its slopes over what it
takes that variance to be. Divided by the mean of this over all directions in which the law can move, it gains by a
direction in which there is nothing as much as a likelihood of independent samples gains by it: the magnitude adjustment
of composite likelihoods [1]_, [2]_.

References
----------
.. [1] F. Pauli, W. Racugno and L. Ventura, "Bayesian composite marginal likelihoods", Statistica Sinica 21, 2011,
   pages 149-164 (cited from memory, not consulted).
.. [2] M. Ribatet, D. Cooley and A. C. Davison, "Bayesian inference from composite likelihoods, with an application to
   spatial extremes", Statistica Sinica 22, 2012, doi:10.5705/ss.2009.248 (cited from memory, not consulted).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import matmul_toeplitz
from scipy.signal import correlate

from bwbn_bayes.inference.likelihood import IntegratedNoise, Posterior
from bwbn_bayes.inference.slopes import Slopes
from bwbn_bayes.parameters import Floats

_INDEPENDENT = 1e-8
"""Of the largest singular value: a direction below it is one that others make up."""


def counted_as_one(noise: IntegratedNoise, posterior: Posterior, point: Floats) -> IntegratedNoise:
    """The same noise, whose samples count by what a fit leaves; no more of them than they did.

    Parameters
    ----------
    noise : IntegratedNoise
        White, or behind a filter.
    posterior, point
        As for :func:`samples_as_one`.
    """
    as_one = np.maximum(noise.as_one, samples_as_one(posterior, point))
    return replace(noise, correlation_samples=tuple(as_one.tolist()))


def samples_as_one(posterior: Posterior, point: Floats) -> Floats:
    """Samples of each block that count as one, ``(n_blocks,)``, by what a fit leaves; one at least.

    Parameters
    ----------
    posterior : Posterior
        Its errors white.
    point : (n_dim,) array
        Its optimum, in the unit cube.
    """
    slopes, record = Slopes.at(posterior, point), posterior.record
    directions = slopes.base.reshape(*record.measured.shape, -1)
    return np.array(
        [
            variance_ratio(slopes.residual[block.channel, block.samples], directions[block.channel, block.samples])
            for block in record.blocks
        ]
    )


def variance_ratio(residual: Floats, directions: Floats) -> float:
    """Variance of the likelihood's slopes over what it is for independent errors, in the mean over directions.

    Autocorrelations count up to the lag at which they vanish first: beyond, they are those of few stretches.

    Parameters
    ----------
    residual : (n_times,) array
    directions : (n_times, n) array
        Derivatives of a response.
    """
    over, sizes, _ = np.linalg.svd(directions, full_matrices=False)
    over = over[:, sizes > _INDEPENDENT * sizes[0]]
    power = correlate(residual, residual)[len(residual) - 1 :]
    if not power[0] > 0.0 or not over.size:
        return 1.0
    vanished = np.flatnonzero(power <= 0.0)
    correlation = power / power[0]
    correlation[vanished[0] if vanished.size else len(power) :] = 0.0
    ratio: float = np.sum(over * matmul_toeplitz(correlation, over)) / over.shape[1]
    return max(ratio, 1.0)
