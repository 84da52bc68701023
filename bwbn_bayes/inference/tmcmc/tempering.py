"""How far to go next along the road, and what each step says about the evidence.

The step is chosen so that the coefficient of variation of the weights meets a target (Ching and Chen's rule; a
coefficient ``c`` is an effective sample size of ``n / (1 + c^2)``). A record of 9,000 points makes the first step
smaller than 1e-7, so the search runs on the logarithm of the step, to a relative tolerance, and has no floor.
"""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp

from bwbn_bayes.inference.tmcmc.target import Floats, Integers

_BISECTIONS = 60
_LOG_SMALLEST_STEP = -700.0
FEWEST_FAMILIES = 10
"""Families whose sums tell a variance to within half of it."""


def coefficient_of_variation(log_weights: Floats) -> float:
    """Coefficient of variation of weights given by their logarithms ``(n,)``; points of zero weight are left out."""
    finite = log_weights[np.isfinite(log_weights)]
    weights: Floats = np.exp(finite - finite.max())
    return float(np.std(weights)) / float(np.mean(weights))


def next_tempering_parameter(log_ratio: Floats, tempering_parameter: float, target_variation: float) -> float:
    """Find the next tempering parameter at which the weights reach a coefficient of variation.

    Parameters
    ----------
    log_ratio : (n,) array
        Log of prior times likelihood over reference. Entries of minus infinity (failed solves) do not count: their
        weight is zero at any step, so no step could mend it.
    tempering_parameter : float
        The present one, in [0, 1).
    target_variation : float
        Coefficient of variation to reach.

    Returns
    -------
    float
        In (tempering_parameter, 1].

    References
    ----------
    .. [1] J. Ching and Y.-C. Chen, 2007, doi:10.1061/(ASCE)0733-9399(2007)133:7(816), step 2.
    """
    finite = log_ratio[np.isfinite(log_ratio)]
    rest = 1.0 - tempering_parameter
    if coefficient_of_variation(rest * finite) <= target_variation:
        return 1.0
    low, high = _LOG_SMALLEST_STEP, np.log(rest)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if coefficient_of_variation(np.exp(middle) * finite) <= target_variation:
            low = middle
        else:
            high = middle
    return min(1.0, tempering_parameter + float(np.exp(low)))


def log_mean(log_weights: Floats) -> float:
    """Log of the mean of weights given by their logarithms ``(n,)``: one stage's factor of the evidence."""
    return float(logsumexp(log_weights) - np.log(len(log_weights)))


def normalised(log_weights: Floats) -> Floats:
    """Weights ``(n,)`` that sum to one."""
    weights: Floats = np.exp(log_weights - logsumexp(log_weights))
    return weights


def family_excess(log_weights: Floats, families: Integers) -> Floats:
    """What each family ``(n_families,)`` holds of the weights ``(n,)``, over an equal share for each of its points."""
    weights = normalised(log_weights)
    return np.bincount(families, weights - 1.0 / len(weights))


def log_mean_variance(excess: Floats, parents: Integers, inherited: Floats) -> float:
    """Variance that a stage adds to the log evidence, whose points depend on each other within families (chains).

    Families of one parent, a chain of the stage before, began near each other: the variance of sums over parents is
    that of :func:`log_mean`. And they began where their parent was, so that a stage's error goes with that of the stage
    before: twice the covariance of the two. What comes from further back is left out; chains of two autocorrelation
    times keep a quarter of an error, so that of the standard error 6 % are missing, of four times 2 %.

    Parameters
    ----------
    excess : (n_families,) array
        Of :func:`family_excess`.
    parents : (n_families,) array
        Label of each family's parent, from 0.
    inherited : (n_families,) array
        Excess of each family's parent in the stage before.

    Returns
    -------
    float
        Squared standard error. [nat^2]

    References
    ----------
    .. [1] H. D. Dau and N. Chopin, "Waste-free sequential Monte Carlo", 2022, doi:10.1111/rssb.12475, section 3.
    .. [2] J. Olsson and R. Douc, "Numerically stable online estimation of variance in particle filters", 2019,
       doi:10.3150/18-BEJ1028: ancestors of a few stages back, since those of the first are soon one.
    """
    n_parents = len(np.unique(parents))
    own = float(np.sum(np.bincount(parents, excess) ** 2)) * n_parents / max(n_parents - 1, 1)
    return own + 2.0 * float(excess @ inherited)


def independent_draws(points: Floats, ancestry: Integers) -> float:
    """Independent draws whose mean is known as well as that of points ``(n, d)``, the fewest over the coordinates.

    Points are independent where they have no ancestor in common. The squared sums over the families of one generation
    hold all covariances that came about since, the duplicates of resampling among them. Those of an older one hold
    more, until it has so few families that they tell no variance: the generation that leaves fewest draws counts.

    Parameters
    ----------
    points : (n, d) array
        Of equal weight.
    ancestry : (n_generations, n) array
        Label of each point's ancestor in each generation, from 0, each of several families.

    Returns
    -------
    float
        From 1 to n.

    References
    ----------
    .. [1] A. Lee and N. Whiteley, "Variance estimation in the particle filter", 2018, doi:10.1093/biomet/asy028.
    .. [2] J. Olsson and R. Douc, 2019, doi:10.3150/18-BEJ1028: generations that are not too old.
    """
    centred = (points - np.mean(points, axis=0)).T
    total, fewest = np.mean(np.square(centred), axis=1), float(len(points))
    if not np.all(total > 0.0):
        return 1.0
    for labels in ancestry:
        n_families = np.count_nonzero(np.bincount(labels))
        sums = np.array([np.bincount(labels, own) for own in centred]) / len(points)
        variance = np.sum(np.square(sums), axis=1) * n_families / (n_families - 1)
        fewest = min(fewest, 1.0 / float(np.max(variance / total)))
    return max(fewest, 1.0)


def integrated_autocorrelation_time(traces: Floats) -> float:
    """Integrated autocorrelation time of chains that start in their stationary law, the largest over quantities.

    The variance of the chain means is compared with that of independent draws, which needs many chains, not long
    ones. The estimate cannot exceed the length of the chains.

    Parameters
    ----------
    traces : (n_steps, n_chains, n_quantities) array
        What to watch.

    Returns
    -------
    float
        In steps, at least 1.
    """
    n_steps = traces.shape[0]
    total = np.var(traces, axis=(0, 1))
    between = np.var(np.mean(traces, axis=0), axis=0, ddof=1)
    moving = total > 0.0
    times = np.where(moving, n_steps * between / np.where(moving, total, 1.0), n_steps)
    longest: Floats = np.max(times)
    return min(max(float(longest), 1.0), float(n_steps))
