"""Which parameter combinations a record cannot see, in words."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from bwbn_bayes.parameters import Floats

PRIOR_PRECISION = 12.0
"""Of a uniform prior on the unit interval."""
PRIOR_SD = float(np.sqrt(1.0 / PRIOR_PRECISION))
"""Standard deviation of every coordinate of the unit cube under the prior."""

UNSEEN = 0.5
"""A direction is unseen where the data leave more than this share of the prior's standard deviation."""

TAKES_PART = 0.25
"""A parameter takes part in a direction that accounts for more than this share of its posterior variance."""
LEAST_NAMED = 3
"""Parameters named of a direction in which none takes part to that degree: those that take part most."""


def covariance_of(information: Floats) -> Floats:
    """Covariance ``(..., n, n)`` in prior units: the inverse of the data's information and the prior's own.

    Of some of the coordinates only, with their part of the information: while the others are held.
    """
    factor = covariance_factor(information)
    return factor @ np.swapaxes(factor, -1, -2)


def covariance_factor(information: Floats) -> Floats:
    """The covariance's lower Cholesky factor ``(..., n, n)``, from the information and not from its inverse.

    Information that spans many orders of magnitude comes out indefinite by rounding, and so would its inverse; here no
    direction is wider than the prior's.
    """
    scale = np.sqrt(np.maximum(np.einsum("...ii->...i", information), 0.0) + 1.0 / PRIOR_SD**2)
    values, vectors = np.linalg.eigh(information / (scale[..., :, None] * scale[..., None, :]))
    seen = scale[..., :, None] * vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]
    prior = np.broadcast_to(np.eye(seen.shape[-1]) / PRIOR_SD, seen.shape)
    # Rows whose sum of squares is the precision; in reverse order the inverse of their R is the factor, turned about.
    rows = np.concatenate([np.swapaxes(seen, -1, -2), prior], axis=-2)[..., ::-1]
    factor = np.linalg.inv(np.linalg.qr(rows, mode="r"))[..., ::-1, ::-1]
    return np.asarray(np.tril(factor * np.sign(np.einsum("...ii->...i", factor))[..., None, :]))


def unseen_directions(information: Floats) -> list[tuple[float, Floats]]:
    """Directions of the unit cube that the data leave open.

    Parameters
    ----------
    information : (n_dim, n_dim) array
        Fisher information at the fit, in prior units (unit-cube coordinates).

    Returns
    -------
    list of (share, direction)
        Standard deviation that the data alone leave along each direction over the prior's, and the unit vector; widest
        first.
    """
    values, vectors = np.linalg.eigh(information)
    sd = 1.0 / np.sqrt(np.maximum(values, 1e-12))
    found = [(float(s / PRIOR_SD), vectors[:, i]) for i, s in enumerate(sd) if s > UNSEEN * PRIOR_SD]
    return sorted(found, key=lambda pair: -pair[0])


def open_combinations(information: Floats, names: Sequence[str]) -> list[tuple[str, ...]]:
    """Which parameters each direction that the data leave open is made of, widest first.

    A parameter is named where it takes part by its own posterior scale, not the prior's: a well-measured one that moves
    by several of its standard deviations along an open direction shifts by little of a wide prior.

    Parameters
    ----------
    information : (n_dim, n_dim) array
        Fisher information at the fit, in prior units.
    names : sequence of str
        Labels of the parameters.
    """
    found = []
    covariance = covariance_of(information)
    for _, direction in unseen_directions(information):
        share = (direction @ covariance @ direction) * np.square(direction) / np.diag(covariance)
        leading = np.argsort(-share)[:LEAST_NAMED]
        found.append(
            tuple(name for i, name in enumerate(names) if share[i] > TAKES_PART) or tuple(names[i] for i in leading)
        )
    return found


def describe(information: Floats, names: Sequence[str], bound: Collection[str] = ()) -> tuple[str, ...]:
    """Sentences on what the record can and cannot see.

    Parameters
    ----------
    information : (n_dim, n_dim) array
        Fisher information at the fit, in prior units.
    names : sequence of str
        Labels of the parameters.
    bound : collection of str
        Those whose posterior a bound of the prior cuts.
    """
    sentences = []
    for involved in open_combinations(information, names):
        if len(involved) > 1:
            together = f"{', '.join(involved[:-1])} and {involved[-1]}"
            sentences.append(
                f"The record cannot tell {together} apart along one combination: they can change together and leave "
                "the response the same, so read their posteriors jointly, or fix one of them."
            )
        elif involved[0] in bound:
            sentences.append(f"The record says little more of {involved[0]} than at which end of its prior it lies.")
        else:
            sentences.append(f"The record says little about {involved[0]}: its posterior is close to its prior.")
    return tuple(dict.fromkeys(sentences)) or ("The record sees every identified parameter.",)


def flag(points: Floats) -> str:
    """``"unidentified"``, ``"prior-bound"`` or empty, from equal-weight draws ``(n_draws,)`` of one unit coordinate.

    Prior-bound: a bound lies within 1.65 posterior standard deviations of the mean, so that it cuts the posterior.
    Unidentified: the posterior keeps more than 80 % of the prior's standard deviation.
    """
    mean, sd = float(np.mean(points)), float(np.std(points))
    if not sd <= 0.8 * PRIOR_SD:  # nor is a posterior of NaN identified
        return "unidentified"
    return "prior-bound" if min(mean, 1.0 - mean) < 1.65 * sd else ""
