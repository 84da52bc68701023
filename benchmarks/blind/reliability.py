"""Are probabilities kept? Of what is said with 0.9, nine of ten should be so."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.columns import Proportion
from benchmarks.blind.scoring import Claim

N_BINS = 10
LEAST_STATED = 0.1
"""Below it a name is not taken for stated: some twenty names of every case lie near zero and would hide every error."""
N_BOOTSTRAP = 1000


def reliability(cases: Sequence[Sequence[Claim]]) -> dict[str, Any]:
    """Reliability of the probabilities of names, in ten bins of equal width.

    Standard errors are from a bootstrap over cases, since the names of one case hang together. Beside each expected
    calibration error stands what perfect probabilities would give with as many statements: it is never zero.

    Parameters
    ----------
    cases : sequence of sequence of (float, bool)
        For each case the probabilities stated and whether they came true.

    Returns
    -------
    dict
        ``bins``; ``expected_calibration_error`` over statements of 0.1 and more, ``..._of_all`` over all; each with
        ``value``, ``se``, ``if_calibrated`` and ``statements`` (value None where there are none).
    """
    rng = np.random.default_rng(2026)
    given = [np.array(case, dtype=np.float64).reshape(-1, 2) for case in cases]
    every = np.concatenate(given) if given else np.zeros((0, 2))
    picks = [rng.integers(len(given), size=len(given)) for _ in range(N_BOOTSTRAP)] if given else []
    again = [np.concatenate([given[i] for i in pick]) for pick in picks]
    tables = np.array([_table(claims) for claims in again]).reshape(len(again), N_BINS, 3)
    return {
        "cases": len(given),
        "bins": _bins(every, tables),
        "expected_calibration_error": _error(every, again, rng, LEAST_STATED),
        "expected_calibration_error_of_all": _error(every, again, rng, 0.0),
    }


def _table(claims: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of each bin: number of statements, sum of their probabilities, number that came true ``(N_BINS, 3)``."""
    p, came_true = claims.T
    which = np.minimum((p * N_BINS).astype(int), N_BINS - 1)
    return np.stack([np.bincount(which, weights, N_BINS) for weights in (np.ones_like(p), p, came_true)], axis=1)


def _bins(every: NDArray[np.float64], tables: NDArray[np.float64]) -> list[dict[str, Any]]:
    bins = []
    for b, (n, total, hits) in enumerate(_table(every)):
        proportion = Proportion(what="", count=int(hits), total=int(n))
        filled = tables[tables[:, b, 0] > 0.0, b]
        bins.append(
            {
                "from": b / N_BINS,
                "to": (b + 1) / N_BINS,
                "statements": int(n),
                "mean_probability": total / n if n else None,
                "share": hits / n if n else None,
                "share_se": float(np.std(filled[:, 2] / filled[:, 0])) if n else None,
                "interval95": list(proportion.interval),
            }
        )
    return bins


def _error(
    every: NDArray[np.float64], again: Sequence[NDArray[np.float64]], rng: np.random.Generator, least: float
) -> dict[str, Any]:
    claims = every[every[:, 0] >= least]
    if len(claims) == 0:
        return {"value": None, "se": None, "if_calibrated": None, "statements": 0}
    perfect = [
        _calibration_error(np.stack([claims[:, 0], rng.random(len(claims)) < claims[:, 0]], axis=1))
        for _ in range(N_BOOTSTRAP)
    ]
    resampled = [_calibration_error(kept) for one in again if len(kept := one[one[:, 0] >= least])]
    return {
        "value": _calibration_error(claims),
        "se": float(np.std(resampled)),
        "if_calibrated": float(np.mean(perfect)),
        "statements": len(claims),
    }


def _calibration_error(claims: NDArray[np.float64]) -> float:
    """Mean over the statements of |mean probability - share that came true| of their bin."""
    _, total, hits = _table(claims).T
    return float(np.sum(np.abs(total - hits)) / len(claims))
