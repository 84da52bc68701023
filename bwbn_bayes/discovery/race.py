"""Refit every hypothesis: many starts each, the hopeless dropped in rounds, the rest fitted to the end.

A shortlist by score loses the truth, so every hypothesis is fitted; local optima cost thousands of nats, so each starts
from every combination of its grid and of several fits of the present model. Sixteen starts cost what one does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.inference.likelihood import Linearisation, Posterior
from bwbn_bayes.inference.modes import Mode, distinct, polish
from bwbn_bayes.parameters import Floats

N_STARTS = 16
ROUNDS = ((6, 1.0), (10, 0.4), (25, 0.2))
"""Iterations of each round, and the share of the hypotheses that enter it."""
_LEAST = 8
"""Hypotheses that enter every round, if there are as many."""


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A fitted hypothesis.

    Attributes
    ----------
    hypothesis : Hypothesis
    posterior : Posterior
        Of its model.
    points : (n, n_dim) array
        Optima so far, in the unit cube.
    local : Linearisation
        There.
    finished : bool
        Whether it was fitted to the end.
    """

    hypothesis: Hypothesis
    posterior: Posterior
    points: Floats
    local: Linearisation
    finished: bool = False

    @property
    def log_likelihood(self) -> float:
        """Best so far."""
        return float(np.max(self.local.log_likelihood))

    @property
    def modes(self) -> tuple[Mode, ...]:
        """Distinct optima, best first."""
        return distinct(self.points, self.local)


def race(
    present: Posterior,
    hypotheses: Sequence[Hypothesis],
    base_points: Floats,
    *,
    n_workers: int,
    progress: Callable[[str], None] | None = None,
) -> tuple[Fit, ...]:
    """Fit hypotheses, best first.

    Parameters
    ----------
    present : Posterior
        Of the present model; its engine should use one thread.
    hypotheses : sequence of Hypothesis
        With that model as their base.
    base_points : (n, n_dim) array
        Fits of the present model, in its unit cube: to the whole record and to its beginning.
    n_workers : int
        Hypotheses fitted at once.
    progress : callable, optional
        Told the best hypothesis after each round.
    """

    def begin(hypothesis: Hypothesis) -> Fit:
        view = present.with_model(hypothesis.model)
        return _further(view, hypothesis, _best_starts(view, hypothesis.starts(base_points)), ROUNDS[0][0])

    with ThreadPoolExecutor(max_workers=n_workers) as pool:
        fits = sorted(pool.map(begin, hypotheses), key=lambda fit: -fit.log_likelihood)
        for n_iterations, share in ROUNDS[1:]:
            _tell(progress, fits)
            n_kept = min(max(_LEAST, round(share * len(hypotheses))), len(fits))
            last = (n_iterations, share) == ROUNDS[-1]
            kept = pool.map(lambda fit, n=n_iterations, end=last: _again(fit, n, end), fits[:n_kept])
            fits = sorted([*kept, *fits[n_kept:]], key=lambda fit: -fit.log_likelihood)
    _tell(progress, fits)
    return tuple(fits)


def _best_starts(view: Posterior, points: Floats) -> Floats:
    value = view.log_likelihood(points)
    return points[np.argsort(-value, kind="stable")[:N_STARTS]]


def _again(fit: Fit, n_iterations: int, finished: bool) -> Fit:
    return _further(fit.posterior, fit.hypothesis, fit.points, n_iterations, finished)


def _further(view: Posterior, hypothesis: Hypothesis, points: Floats, n_iterations: int, finished: bool = False) -> Fit:
    points, local = polish(view, points, n_iterations=n_iterations, reach=50.0)
    return Fit(hypothesis=hypothesis, posterior=view, points=points, local=local, finished=finished)


def _tell(progress: Callable[[str], None] | None, fits: Sequence[Fit]) -> None:
    if progress is not None and fits:
        progress(f"best so far: {fits[0].hypothesis.label}")
