"""Whether what a fit leaves behind is noise: its level against a model-free estimate, and its whiteness."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.noise import model_free_noise_sd
from bwbn_bayes.results import Check

N_LAGS = 20
LEAST_PROBABILITY = 1e-5
LARGEST_RATIO = 1.25


def whiteness_probability(residual: Floats) -> float:
    """Probability of autocorrelations as large as those of ``residual (n_times,)`` if it were white noise.

    References
    ----------
    .. [1] G. M. Ljung and G. E. P. Box, "On a Measure of Lack of Fit in Time Series Models", Biometrika 65, 1978,
       doi:10.1093/biomet/65.2.297.
    """
    n = len(residual)
    lags = min(N_LAGS, n // 4)
    centred = residual - np.mean(residual)
    power = float(centred @ centred)
    if power == 0.0:
        return 1.0
    correlation = np.array([centred[lag:] @ centred[:-lag] for lag in range(1, lags + 1)]) / power
    statistic = n * (n + 2) * np.sum(np.square(correlation) / (n - np.arange(1, lags + 1)))
    return float(chi2.sf(statistic, lags))


def residual_checks(posterior: Posterior, point: Floats) -> tuple[Check, ...]:
    """Noise level and whiteness of the residual at a point ``(n_dim,)`` of the unit cube, worst channel of each."""
    record = posterior.record
    values, _ = posterior.split(point[None])
    response = posterior.engine.simulate(posterior.model, values, record).values[0]
    posterior.solves.total += 1
    residual = {name: signal - response[i] for i, (name, signal) in enumerate(record.channels.items())}
    ratios = {}
    for name, rest in residual.items():
        # A record without noise has an estimate near zero: no ratio is asked below a thousandth of its rms.
        floor = max(model_free_noise_sd(record.channels[name]), 1e-3 * float(np.std(record.channels[name])))
        ratios[name] = float(np.std(rest)) / floor
    white = {name: whiteness_probability(rest) for name, rest in residual.items()}
    loudest, reddest = max(ratios, key=lambda name: ratios[name]), min(white, key=lambda name: white[name])
    return (
        Check(
            name="residual level",
            value=ratios[loudest],
            limit=LARGEST_RATIO,
            passed=ratios[loudest] < LARGEST_RATIO,
            sentence=f"The residual of {loudest} is {ratios[loudest]:.2f} times its model-free noise level.",
        ),
        Check(
            name="residual whiteness",
            value=white[reddest],
            limit=LEAST_PROBABILITY,
            passed=white[reddest] > LEAST_PROBABILITY,
            sentence=f"White noise is as coloured as the residual of {reddest} with probability {white[reddest]:.2g}.",
        ),
    )
