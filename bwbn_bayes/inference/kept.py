"""Whole fits, kept in the journal of a posterior: where they end, and what they cost.

What a fit asks of the engine, expansions at each of its steps, takes a hundred times the room of what it comes to. A
fit is a function of its posterior, its starts and its options, which are the question.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from bwbn_bayes.engines.journal import N_SOLVED_AGAIN, question_of
from bwbn_bayes.inference.likelihood import Posterior, SolveCount
from bwbn_bayes.parameters import Booleans, Floats

_TOLERANCE = 1e-6
"""Relative, of log likelihoods: the kernels with derivatives and without round differently."""


def kept_fit(
    view: Posterior,
    options: str,
    starts: Floats,
    held: Booleans | None,
    fit: Callable[[Posterior], tuple[Floats, ...]],
) -> tuple[Floats, ...]:
    """What a fit comes to: as it was kept, or fitted and kept; fitted where the posterior has no journal.

    Parameters
    ----------
    view : Posterior
        Target.
    options : str
        The method and all of its options, in words.
    starts : (n, n_dim) array
    held : boolean array, optional
        Coordinates that keep their values.
    fit : callable
        The fit itself; points ``(n, n_dim)``, log likelihoods ``(n,)`` there, and further arrays ``(n, ...)``.
    """
    if view.journal is None:
        return fit(view)

    def solve(_: slice) -> tuple[Floats, ...]:
        own = replace(view, journal=None, solves=SolveCount())
        # In the order in memory that they are read back in: sums depend on it, in their last bits.
        found = map(np.ascontiguousarray, fit(own))
        return (*found, np.full(len(starts), float(own.solves.total)))

    def is_right(answer: tuple[Floats, ...]) -> bool:
        points, reached, *_ = answer
        some = np.argsort(-reached)[:N_SOLVED_AGAIN]
        again = replace(view, journal=None, solves=SolveCount()).log_likelihood(points[some])
        return np.allclose(again, reached[some], rtol=_TOLERANCE, atol=_TOLERANCE)

    asked = [starts] if held is None else [starts, held]
    question = question_of(f"fit, {options}", view.about, *asked)
    *found, n_solves = view.journal.kept("fit", question, len(starts), solve, is_right=is_right)
    view.solves.add(int(n_solves[0]))
    return tuple(found)
