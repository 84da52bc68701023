"""The bridge: transitional MCMC from an inflated approximation of the posterior instead of from the prior."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Literal

import numpy as np

from bwbn_bayes.inference.importance import Mixture
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.nested_laplace import NestedLaplace
from bwbn_bayes.inference.sheet_nodes import first_nodes
from bwbn_bayes.inference.tmcmc.sampler import TmcmcResult, sample
from bwbn_bayes.inference.transported import Transported
from bwbn_bayes.inference.truncated import TruncatedStudent
from bwbn_bayes.results import StageFacts

INFLATION = 2.0
"""Factor on the variances of the approximation from which it starts at one mode."""
_INFLATION_OF_SEVERAL = 25.0
_FEWEST = 2
_ON_THE_SHEET = 3.0
"""Standardised distance from the sheet's surface up to which a mode counts as lying on it."""
_REACH, _MOST = 50.0, 8
"""Modes this close to the best are bridged from, up to so many. [nat]"""


def contributing(modes: Sequence[Mode]) -> tuple[Mode, ...]:
    """The modes from which a bridge starts."""
    return tuple(mode for mode in modes if mode.log_likelihood > modes[0].log_likelihood - _REACH)[:_MOST]


def bridge(
    posterior: Posterior,
    modes: Sequence[Mode],
    *,
    nested: NestedLaplace | None = None,
    n_particles: int,
    rng_seed: int,
    variant: Literal["default", "plain"] = "default",
    progress: Callable[[StageFacts], None] | None = None,
) -> TmcmcResult:
    """Sample a posterior whose optima are known.

    Where all of them lie on one sheet the road starts at the inflated sheet and runs in the coordinates that make it
    uniform, so that neither scales nor curvature are left to learn; else at the inflated mixture of all of them.

    Parameters
    ----------
    posterior : Posterior
        Target.
    modes : sequence of Mode
        Its optima, best first.
    nested : NestedLaplace, optional
        The sheet, where it is known already.
    n_particles, rng_seed, variant, progress
        As for :func:`~bwbn_bayes.inference.tmcmc.sampler.sample`.
    """
    run = partial(sample, n_particles=n_particles, rng_seed=rng_seed, variant=variant, progress=progress)
    kept = contributing(modes)
    # Beside a wide coordinate and the one that is drawn first with it, something must be left to bend.
    if posterior.n_dim > _FEWEST:
        if nested is None:
            nested = NestedLaplace.laid(posterior, first_nodes(posterior, kept))
        if np.all(nested.distance(np.array([mode.point for mode in kept])) < _ON_THE_SHEET):
            target = Transported(target=posterior, transport=nested.inflated(INFLATION).transport)
            return target.back(run(target))
    return run(posterior, reference=wide_mixture(modes, _INFLATION_OF_SEVERAL))


def wide_mixture(modes: Sequence[Mode], inflation: float) -> Mixture:
    """Normals at the modes from which a bridge starts, in equal shares, their variances inflated."""
    kept = contributing(modes)
    return Mixture(
        weights=tuple([1.0 / len(kept)] * len(kept)),
        components=tuple(TruncatedStudent.at(m.point, m.gradient, m.information, inflation=inflation) for m in kept),
    )
