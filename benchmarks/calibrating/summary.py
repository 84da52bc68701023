"""What many replicates say together: coverage with its interval, uniformity of ranks, methods, runtimes, grades."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from benchmarks.calibrating.outcome import Outcome
from bwbn_bayes import UserError

FAR = 3.0
"""A wrong model misleads where a parameter lies so many posterior standard deviations from its truth."""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """Of one model under one condition.

    Attributes
    ----------
    n_replicates : int
    coverage, coverage_low, coverage_high : float
        Of 90 % intervals, over all parameters and identified replicates; 95 % interval from resampled replicates, since
        the parameters of one record are not independent.
    rms_z : float
        Of posterior mean less truth in posterior standard deviations; one where the posterior is right and normal.
    rank_p : float
        Smallest Kolmogorov-Smirnov probability of any quantity's ranks, times the number of quantities.
    rank_quantity : str
        Whose it is.
    methods : dict
        Method that ran, and how often.
    grades : dict
        What the results say of the model, and how often.
    held : dict
        How many 90 % intervals of each parameter hold their truth.
    median_s, worst_s : float
        Of the processor, all threads together. [s]
    """

    n_replicates: int
    coverage: float
    coverage_low: float
    coverage_high: float
    rms_z: float
    rank_p: float
    rank_quantity: str
    methods: dict[str, int]
    grades: dict[str, int]
    held: dict[str, int]
    median_s: float
    worst_s: float


def calibration(outcomes: Sequence[Outcome]) -> Calibration:
    """Sum up replicates of a right model; those that were not identified count in methods, grades and seconds."""
    identified = [one for one in outcomes if one.covered]
    if not identified:
        raise UserError(f"of {len(outcomes)} truths none was identified: there is nothing to sum up")
    shares = np.array([np.mean(list(one.covered.values())) for one in identified])
    rng = np.random.default_rng(0)
    resampled = np.mean(shares[rng.integers(len(shares), size=(2000, len(shares)))], axis=1)
    z = np.array([value for one in outcomes for value in one.z.values()])
    ranks = {name: [one.ranks[name] for one in identified if name in one.ranks] for name in identified[0].ranks}
    p = {name: float(stats.kstest(values, "uniform").pvalue) for name, values in ranks.items()}
    worst = min(p, key=lambda name: p[name])
    seconds = [one.processor_s for one in outcomes]
    low, high = np.quantile(resampled, [0.025, 0.975]).tolist()
    return Calibration(
        n_replicates=len(outcomes),
        coverage=float(np.mean(shares)),
        coverage_low=low,
        coverage_high=high,
        rms_z=float(np.sqrt(np.mean(np.square(z)))),
        rank_p=min(1.0, p[worst] * len(p)),
        rank_quantity=worst,
        methods=dict(Counter(one.method for one in outcomes)),
        grades=dict(Counter(one.grade for one in outcomes)),
        held=dict(Counter(name for one in outcomes for name, inside in one.covered.items() if inside)),
        median_s=float(np.median(seconds)),
        worst_s=float(np.max(seconds)),
    )


@dataclass(frozen=True, kw_only=True)
class Wrong:
    """Of one kind of wrong model: how many mislead, and what is said of those and of the others."""

    n: int
    n_misleading: int
    misleading_refused: int
    misleading_doubtful: int
    others_refused_or_doubtful: int
    largest_z: float


def wrong(outcomes: Sequence[Outcome]) -> Wrong:
    """Sum up records that the model cannot have made."""
    largest = [max((abs(z) for z in one.z.values()), default=0.0) for one in outcomes]
    pairs = list(zip(outcomes, largest, strict=True))
    misleading = [one.grade for one, z in pairs if z > FAR]
    return Wrong(
        n=len(outcomes),
        n_misleading=len(misleading),
        misleading_refused=misleading.count("refused"),
        misleading_doubtful=misleading.count("doubtful"),
        others_refused_or_doubtful=sum(one.grade != "explains" for one, z in pairs if z <= FAR),
        largest_z=max(largest),
    )
