"""The bridge: transitional MCMC from an inflated approximation of the posterior instead of from the prior."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from bwbn_bayes.inference.importance import Mixture
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.nested_laplace import NestedLaplace, Sheet
from bwbn_bayes.inference.sheet_nodes import has_wide
from bwbn_bayes.inference.tmcmc.sampler import TmcmcResult, sample
from bwbn_bayes.inference.tmcmc.stages import DRAWS
from bwbn_bayes.inference.tmcmc.target import Reference
from bwbn_bayes.inference.truncated import TruncatedStudent
from bwbn_bayes.results import StageFacts

_INFLATION = 2.0
"""Factor on the variances of the approximation from which it starts at one mode."""
_INFLATION_OF_SEVERAL = 25.0
_WIDER = 1.1
"""Variances of approximations that moves are drawn from, over those of the approximation."""
_FEWEST = 2
_ON_THE_SHEET = 3.0
"""Standardised distance from the sheet's surface up to which a mode counts as lying on it."""
_REACH, _MOST = 50.0, 8
"""Modes this close to the best are bridged from, up to so many. [nat]"""


def contributing(modes: Sequence[Mode]) -> tuple[Mode, ...]:
    """The modes from which a bridge starts."""
    return tuple(mode for mode in modes if mode.log_likelihood > modes[0].log_likelihood - _REACH)[:_MOST]


def sheet_through(
    posterior: Posterior, modes: Sequence[Mode], rng: np.random.Generator, nested: NestedLaplace | None = None
) -> NestedLaplace | None:
    """The sheet on which all modes lie that a bridge starts from, refined until its draws weigh alike.

    None where they do not, where nothing is left to bend beside a wide coordinate, or where none is wide.

    Parameters
    ----------
    posterior : Posterior
        Target.
    modes : sequence of Mode
        Its optima, best first.
    rng : numpy.random.Generator
        Random stream.
    nested : NestedLaplace, optional
        A sheet that was laid already.
    """
    kept = contributing(modes)
    if nested is None:
        # Beside a wide coordinate and the one that is drawn first with it, something must be left to bend.
        if posterior.n_dim <= _FEWEST or not has_wide(modes[0].information):
            return None
        nested = Sheet(posterior, kept, rng).lay()
    lie_on_it = nested.distance(np.array([mode.point for mode in kept])) < _ON_THE_SHEET
    return nested if np.all(lie_on_it) else None


def bridge(
    posterior: Posterior,
    modes: Sequence[Mode],
    sheet: NestedLaplace | None,
    *,
    n_particles: int,
    rng_seed: int,
    variant: Literal["default", "plain"] = "default",
    progress: Callable[[StageFacts], None] | None = None,
) -> TmcmcResult:
    """Sample a posterior whose optima are known.

    The road starts at the inflated mixture of the optima and, where all of them lie on one, the sheet through them,
    which follows bends; moves are drawn from the same, less and less inflated.

    Parameters
    ----------
    posterior : Posterior
        Target.
    modes : sequence of Mode
        Its optima, best first.
    sheet : NestedLaplace or None
        See :func:`sheet_through`.
    n_particles, rng_seed, variant, progress
        As for :func:`~bwbn_bayes.inference.tmcmc.sampler.sample`.
    """
    inflation = _INFLATION_OF_SEVERAL if sheet is None else _INFLATION
    return sample(
        posterior,
        n_particles=n_particles,
        rng_seed=rng_seed,
        variant=variant,
        reference=_about(modes, sheet, inflation),
        guide=guide_between(modes, sheet, inflation),
        lengths=DRAWS,
        progress=progress,
    )


def guide_between(modes: Sequence[Mode], sheet: NestedLaplace | None, inflation: float) -> Callable[[float], Reference]:
    """Approximations of a posterior on the road to it from the inflated mixture of its modes, for moves to draw from.

    A normal distribution to the power ``t`` times the same with inflated variances to the power ``1 - t`` is one again.

    Parameters
    ----------
    modes : sequence of Mode
        Its optima, best first.
    sheet : NestedLaplace or None
        See :func:`sheet_through`.
    inflation : float
        Of the variances where the road starts.
    """

    def at(tempering_parameter: float) -> Reference:
        return _about(modes, sheet, _WIDER / ((1.0 - tempering_parameter) / inflation + tempering_parameter))

    return at


def _about(modes: Sequence[Mode], sheet: NestedLaplace | None, inflation: float) -> Mixture:
    """The mixture at the modes, and the sheet through them where there is one, their variances inflated."""
    wide = wide_mixture(modes, inflation)
    return wide if sheet is None else Mixture(weights=(0.5, 0.5), components=(wide, sheet.inflated(inflation)))


def wide_mixture(modes: Sequence[Mode], inflation: float) -> Mixture:
    """Normals at the modes from which a bridge starts, in equal shares, their variances inflated."""
    kept = contributing(modes)
    return Mixture(
        weights=tuple([1.0 / len(kept)] * len(kept)),
        components=tuple(TruncatedStudent.at(m.point, m.gradient, m.information, inflation=inflation) for m in kept),
    )
