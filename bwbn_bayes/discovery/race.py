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
from bwbn_bayes.discovery.family import Family, families
from bwbn_bayes.inference.likelihood import Linearisation, Posterior
from bwbn_bayes.inference.modes import Mode, distinct, polish
from bwbn_bayes.parameters import Floats

ROUNDS = ((4, 1.0), (6, 0.5), (25, 0.2))
"""Iterations of each round, and the share of the hypotheses that enter it."""
_LEAST = 8
"""Hypotheses that enter every round, if there are as many."""
_REACH = 50.0
"""Candidates further below the best of their family do not keep it waiting. [nat]"""
_BLOCK = 16
"""Candidates that are solved at the cost of one."""


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
    fits: dict[Hypothesis, Fit] = {}
    kept: Sequence[Hypothesis] = hypotheses
    with ThreadPoolExecutor(max_workers=n_workers) as pool:
        for number, (n_iterations, share) in enumerate(ROUNDS):
            n_kept = min(max(_LEAST, round(share * len(hypotheses))), len(kept))
            kept = kept[:n_kept]
            last = number == len(ROUNDS) - 1

            def further(family: Family, n: int = n_iterations, end: bool = last) -> list[Fit]:
                points = [
                    fits[member].points if member in fits else member.starts(base_points) for member in family.members
                ]
                return _fit_family(present, family, points, n, end)

            for found in pool.map(further, families(kept)):
                fits.update((fit.hypothesis, fit) for fit in found)
            kept = sorted(kept, key=lambda hypothesis: -fits[hypothesis].log_likelihood)
            if progress is not None and kept:
                progress(f"best so far: {kept[0].label}")
    return tuple(sorted(fits.values(), key=lambda fit: -fit.log_likelihood))


def _fit_family(
    present: Posterior, family: Family, points: Sequence[Floats], n_iterations: int, finished: bool
) -> list[Fit]:
    """Fit the members of a family together, each from the best of its starts."""
    view = family.posterior(present)
    chosen, held, owner = [], [], []
    for number, (member, own) in enumerate(zip(family.members, points, strict=True)):
        embedded, fixed = family.embed(member, own)
        value = view.log_likelihood(embedded)
        n_starts = max(_BLOCK // len(family.members), len(own) // 4)
        best = np.argsort(-value, kind="stable")[:n_starts]
        chosen.append(embedded[best])
        held.append(fixed[best])
        owner += [number] * len(best)
    found, local = polish(
        view, np.concatenate(chosen), n_iterations=n_iterations, held=np.concatenate(held), reach=_REACH
    )
    result = []
    for number, member in enumerate(family.members):
        rows = np.flatnonzero(np.array(owner) == number)
        result.append(
            Fit(
                hypothesis=member,
                posterior=present.with_model(member.model),
                points=found[rows][:, family.columns(member)],
                local=family.extract(member, local[rows]),
                finished=finished,
            )
        )
    return result
