"""The bridge: transitional MCMC from an inflated approximation of the posterior instead of from the prior."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

from bwbn_bayes.inference.importance import Mixture
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.ridge import RidgeProposal, ridge_coordinate
from bwbn_bayes.inference.tmcmc.sampler import TmcmcResult, sample
from bwbn_bayes.inference.transported import Transported
from bwbn_bayes.inference.truncated import TruncatedStudent
from bwbn_bayes.results import StageFacts

INFLATION = 4.0
"""Factor on the variances of the approximation from which it starts at one mode."""
_INFLATION_OF_SEVERAL = 25.0
_FEWEST = 2
_REACH, _MOST = 50.0, 8
"""Modes this close to the best are bridged from, up to so many. [nat]"""


def contributing(modes: Sequence[Mode]) -> tuple[Mode, ...]:
    """The modes from which a bridge starts."""
    return tuple(mode for mode in modes if mode.log_likelihood > modes[0].log_likelihood - _REACH)[:_MOST]


def bridge(
    posterior: Posterior,
    modes: Sequence[Mode],
    *,
    n_particles: int,
    rng_seed: int,
    variant: Literal["default", "plain"] = "default",
    progress: Callable[[StageFacts], None] | None = None,
) -> TmcmcResult:
    """Sample a posterior whose optima are known.

    With one mode the road starts at the inflated ridge and runs in the coordinates that make it uniform, so that
    neither scales nor curvature are left to learn; with several it starts at the inflated mixture of all of them.

    Parameters
    ----------
    posterior : Posterior
        Target.
    modes : sequence of Mode
        Its optima, best first.
    n_particles, rng_seed, variant, progress
        As for :func:`~bwbn_bayes.inference.tmcmc.sampler.sample`.
    """
    kept = contributing(modes)
    # Beside the ridge's own coordinate and the one it is drawn first with, something must be left to bend.
    if len(kept) == 1 and posterior.n_dim > _FEWEST:
        ridge = RidgeProposal.along(posterior, kept[0], ridge_coordinate(kept[0])).inflated(INFLATION)
        target = Transported(target=posterior, transport=ridge.transport)
        return target.back(
            sample(target, n_particles=n_particles, rng_seed=rng_seed, variant=variant, progress=progress)
        )
    wide = Mixture(
        weights=tuple([1.0 / len(kept)] * len(kept)),
        components=tuple(
            TruncatedStudent.at(m.point, m.gradient, m.information, inflation=_INFLATION_OF_SEVERAL) for m in kept
        ),
    )
    return sample(
        posterior, n_particles=n_particles, rng_seed=rng_seed, variant=variant, reference=wide, progress=progress
    )
