"""Choosing ancestors in proportion to weight."""

from __future__ import annotations

import numpy as np

from bwbn_bayes.inference.tmcmc.target import Floats, Integers


def multinomial(weights: Floats, n: int, rng: np.random.Generator) -> Integers:
    """Draw ``(n,)`` indices independently, with the probabilities ``weights (m,)``."""
    return _inverse(weights, np.sort(rng.random(n)))


def systematic(weights: Floats, n: int, rng: np.random.Generator) -> Integers:
    """Draw ``(n,)`` indices with one random offset and equal spacing.

    An index of weight ``w`` appears ``floor(n w)`` or ``ceil(n w)`` times, and so does any stretch of neighbouring
    indices taken together: in a cloud ordered by place, each mode keeps its share to within one draw.

    References
    ----------
    .. [1] R. Douc, O. Cappe and E. Moulines, "Comparison of resampling schemes for particle filtering", 2005,
       doi:10.1109/ISPA.2005.195385.
    """
    return _inverse(weights, (np.arange(n) + rng.random()) / n)


def order_along_principal_axis(positions: Floats, weights: Floats) -> Integers:
    """Indices ``(n,)`` that order positions ``(n, d)`` along the widest direction of the weighted cloud."""
    centred = positions - weights @ positions
    _, vectors = np.linalg.eigh(centred.T @ (centred * weights[:, None]))
    order: Integers = np.argsort(centred @ vectors[:, -1], kind="stable")
    return order


def _inverse(weights: Floats, levels: Floats) -> Integers:
    cumulative = np.cumsum(weights)
    # The right side passes over weights of zero; the clip keeps rounding from running past the last that is not.
    indices = np.searchsorted(cumulative, levels * cumulative[-1], side="right")
    return np.asarray(np.minimum(indices, np.flatnonzero(weights)[-1]), dtype=np.int64)
