"""Simulation-based calibration: draw a truth from the prior, data from the truth, a posterior from the data.

If the sampler is right the rank of the truth among the posterior draws is uniform, for every parameter and for the log
likelihood. The ranks of parameters alone cannot fault a sampler that returns the prior; the log likelihood's can.

References
----------
.. [1] S. Talts et al., "Validating Bayesian Inference Algorithms with Simulation-Based Calibration", 2018,
   arXiv:1804.06788.
.. [2] M. Modrak et al., "Simulation-Based Calibration Checking for Bayesian Computation: The Choice of Test Quantities
   Shapes Sensitivity", 2023, doi:10.1214/23-BA1404.
.. [3] T. Sailynoja, P.-C. Buerkner and A. Vehtari, "Graphical test for discrete uniformity and its applications in
   goodness-of-fit evaluation and multiple sample comparison", 2022, doi:10.1007/s11222-022-10090-6.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Floats = NDArray[np.float64]


class Verdict(NamedTuple):
    """Outcome of a calibration test over all quantities at once."""

    passed: bool
    smallest_p: Floats
    """Per quantity: the smallest two-sided pointwise p of the ECDF against its band's centre, ``(n_quantities,)``."""
    limit: float
    """Pointwise level at which the band covers all points of all quantities with the wanted probability."""


def normalised_rank(truth: Floats, draws: Floats, rng: np.random.Generator) -> Floats:
    """Rank of each true quantity ``(q,)`` among draws ``(n, q)``, ties broken at random, scaled to (0, 1)."""
    below, equal = np.sum(draws < truth, axis=0), np.sum(draws == truth, axis=0)
    return np.asarray((below + rng.random(len(truth)) * (equal + 1)) / (len(draws) + 1))


def calibration_verdict(ranks: Floats, level: float = 0.01, n_simulations: int = 2000) -> Verdict:
    """Test whether the ranks ``(n_replicates, n_quantities)`` are uniform by simultaneous ECDF bands.

    Parameters
    ----------
    ranks : (n_replicates, n_quantities) array
        Normalised ranks.
    level : float
        Probability that a right sampler fails, over all quantities together (Bonferroni between them).
    n_simulations : int
        Uniform samples that calibrate the band.
    """
    n_replicates, n_quantities = ranks.shape
    rng = np.random.default_rng(20220101)
    null = np.sort([_smallest_pointwise_p(rng.random(n_replicates)) for _ in range(n_simulations)])
    limit = float(np.quantile(null, level / n_quantities))
    smallest = np.array([_smallest_pointwise_p(column) for column in ranks.T])
    return Verdict(bool(np.all(smallest >= limit)), smallest, limit)


def _smallest_pointwise_p(ranks: Floats) -> float:
    grid = np.linspace(0.0, 1.0, 41)[1:-1]
    counts = np.searchsorted(np.sort(ranks), grid, side="right")
    law = stats.binom(len(ranks), grid)
    return float(2.0 * np.min(np.minimum(law.cdf(counts), law.sf(counts - 1))))
