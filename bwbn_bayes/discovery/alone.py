"""The law that a specimen's answer predicts by: it has to stand without the force of no known law.

Beside that force laws compete for their names. What a law of a measured test leaves is its own error, of which the
force takes up the most, so that beside it a law that leaves less gains little. But the force knows nothing of what
comes after the record. So the best laws are fitted by themselves, too, and the best of these is built upon effect by
effect, as long as its evidence grows: the evidence of a record is the score of predicting each sample from those before
it [1]_. What is found so competes beside the force as well.

References
----------
.. [1] A. P. Dawid, "Present Position and Potential Developments: Some Personal Views: Statistical Theory: The
   Prequential Approach", Journal of the Royal Statistical Society A 147(2), 1984, doi:10.2307/2981683 (cited from
   memory, not consulted).
"""

from __future__ import annotations

from collections.abc import Sequence

from bwbn_bayes.discovery.build import TOGETHER, built_upon, left_out
from bwbn_bayes.discovery.explanation import Explanation, Key
from bwbn_bayes.discovery.pool import Pool
from bwbn_bayes.discovery.run import Run

MOST_EFFECTS = 8
"""Effects of a law that is built by itself, at most."""
MOST_ROUNDS = 8
"""Laws that are built upon, at most."""
MOST_FAILURES = 2
"""Of them, those from which nothing better came, at most."""
N_BESIDE = 4
"""The best laws that compete beside the force, too."""


def build_alone(pool: Pool, run: Run) -> None:
    """Build the best laws by themselves, and let them compete beside the force.

    Where a law leaves noise there is nothing to build: it predicts as it stands.

    Parameters
    ----------
    pool : Pool
        Of a specimen that is searched beside an unnamed force; else nothing is done.
    run : Run
    """
    if not pool.has_force or run.must_stop():
        return
    pool.leave_alone(also=[one for one in pool.searched.values() if {*TOGETHER} <= one.names])
    if pool.alone[0].is_noise:
        return
    run.say("building the law that predicts, without a force of no known law")
    built, failures = set[Key](), 0
    for _ in range(MOST_ROUNDS):
        best = pool.alone[0]
        parent = _next(pool.alone, built)
        if parent is None or failures == MOST_FAILURES or run.must_stop():
            break
        built.add(parent.effects_key)
        pool.add_alone(built_upon(parent, run))
        failures += pool.alone[0] is best
    for _ in range(MOST_EFFECTS):
        best = pool.alone[0]
        pool.add_alone(left_out(best, pool.plain, run))
        if pool.alone[0] is best:
            break
    pool.let_compete(pool.alone[:N_BESIDE])


def _next(laws: Sequence[Explanation], built: set[Key]) -> Explanation | None:
    """The most probable law that was not built upon and has room for an effect."""
    fresh = (one for one in laws if one.effects_key not in built and len(one.added) < MOST_EFFECTS)
    return next(fresh, None)
