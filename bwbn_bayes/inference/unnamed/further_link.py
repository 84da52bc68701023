"""A link that a building lacks: a spring and a dashpot between two nodes that no storey joins.

Braces past a floor are such links, and so is bending at one floor: the energy of two storeys' difference of drift is
that of the storeys themselves, twice, less that of a link past the floor between them, whose stiffness may therefore be
negative. To first order a force that other storeys move (:mod:`~bwbn_bayes.inference.unnamed.storey`) is of this kind;
as a link it may be large.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from typing import ClassVar, NamedTuple

import numpy as np
from scipy.stats import norm

from bwbn_bayes.elements.linear import Linear
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode, distinct, first_window, polish, windows
from bwbn_bayes.inference.summary import observe
from bwbn_bayes.parameters import Floats, Normal, Parameter
from bwbn_bayes.structures.structure import Structure

_WIDE = 0.5
"""Standard deviation of the link's stiffness and damping, over the largest force of a storey by drift and its rate."""
_STARTS = (-1.0, -0.25, 0.25, 1.0)
"""Stiffnesses from which fits start, over that standard deviation."""
_MOST_STOREYS_SPANNED, _MOST_LINKS = 3, 24
"""Storeys that a link goes past at most, and links that are tried: nobody builds longer ones."""
_N_ITERATIONS, _N_KEPT, _REACH = 12, 6, 50.0
"""Steps on each part of the record; fits that go on to the next, and how far below the best. [nat]"""


class Span(NamedTuple):
    """The nodes that a link joins, 0 the ground."""

    lower: int
    upper: int

    @property
    def in_words(self) -> str:
        """``the ground and floor 2``."""
        return f"{f'floor {self.lower}' if self.lower else 'the ground'} and floor {self.upper}"


@dataclass(frozen=True, kw_only=True)
class Tie(Linear):
    """``F = k u + c v`` of either sign."""

    name: ClassVar[str] = "tie"
    parameters: ClassVar[tuple[Parameter, ...]] = tuple(replace(one, lower=-np.inf) for one in Linear.parameters)


@dataclass(frozen=True, kw_only=True)
class FurtherLink:
    """A link between two nodes, fitted beside a model.

    Attributes
    ----------
    span : Span
    posterior : Posterior
        Of the model with it.
    modes : tuple of Mode
        Optima of that, best first.
    """

    span: Span
    posterior: Posterior
    modes: tuple[Mode, ...]


def spans(model: Structure) -> tuple[Span, ...]:
    """Pairs of nodes that no link of a building joins, the nearest first."""
    joined = {frozenset(pair) for pair in model.joints}
    pairs = (Span(*pair) for pair in combinations(range(model.n_floors + 1), 2))
    free = [one for one in pairs if frozenset(one) not in joined and one.upper - one.lower <= _MOST_STOREYS_SPANNED]
    return tuple(sorted(free, key=lambda one: one.upper - one.lower)[:_MOST_LINKS])


def further_links(posterior: Posterior, points: Floats) -> tuple[FurtherLink, ...]:
    """Links between nodes that none joins, each fitted beside a model to more and more of a record.

    Parameters
    ----------
    posterior : Posterior
        Of the model.
    points : (n, n_dim) array
        Its fits, the best one first, in the unit cube.
    """
    values = posterior.split(points[:1])[0]
    rows = {kind: own[0] for kind, own in observe(posterior.engine, posterior.model, values, posterior.record).items()}
    largest = {kind: float(np.max(np.abs(rows[kind]))) for kind in ("restoring_force", "drift", "drift_rate")}
    tie = Tie(
        k=Normal(0.0, _WIDE * largest["restoring_force"] / largest["drift"]),
        c=Normal(0.0, _WIDE * largest["restoring_force"] / largest["drift_rate"]),
    )
    found = (_fitted(posterior, points, tie, span) for span in spans(posterior.model))
    return tuple(one for one in found if one.modes)


def _fitted(posterior: Posterior, points: Floats, tie: Tie, span: Span) -> FurtherLink:
    view = posterior.with_model(posterior.model.with_link(tie, joins=span))
    places = [(one.symbol, one.storeys) for one in view.space.parameters]  # labels change with the number of links
    own = [places.index((one.symbol, one.storeys)) for one in posterior.space.parameters]
    stiffness = places.index(("k", (view.model.n_links,)))
    starts = np.full((len(_STARTS), len(points), view.space.n_dim), 0.5)
    starts[:, :, own] = points
    starts[:, :, stiffness] = np.asarray(norm.cdf(_STARTS))[:, None]
    fits: Floats = starts.reshape(-1, view.space.n_dim)
    modes: tuple[Mode, ...] = ()
    for end in windows(posterior.record.duration, first_window(posterior)):
        modes = distinct(*polish(view.until(end), fits, n_iterations=_N_ITERATIONS, reach=_REACH))[:_N_KEPT]
        if not modes:
            break
        fits = np.array([mode.point for mode in modes])
    return FurtherLink(span=span, posterior=view, modes=modes)
