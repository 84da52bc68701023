"""Refit every hypothesis: many starts each, the hopeless dropped in rounds, the rest fitted to the end.

A shortlist by score loses the truth, so every hypothesis is fitted; local optima cost thousands of nats, so each starts
from every combination of its grid and of several fits of the present model. Sixteen starts cost what one does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.discovery.family import Family, families
from bwbn_bayes.discovery.known_slopes import suited
from bwbn_bayes.discovery.pace import UNHURRIED, Pace
from bwbn_bayes.inference.likelihood import Linearisation, Posterior
from bwbn_bayes.inference.modes import Mode, distinct, expansion_of, outlook, polish
from bwbn_bayes.inference.residuals import leaves_noise
from bwbn_bayes.inference.slopes import Slopes
from bwbn_bayes.parameters import Booleans, Floats

ROUNDS = ((2, 1.0), (4, 0.4), (25, 0.12))
"""Iterations of each round, and the share of the hypotheses that enter it."""
_LEAST = 8
"""Hypotheses that enter every round, if there are as many."""
_LEADING_FORMS = 8
"""Forms that are tried in every storey alike: those that do best at one storey in the first round."""
_MOST = 8
"""Candidates of one hypothesis that start fits, at most."""
_NEAR = 1e-3
"""Distance from neutral of the starts there, in prior probability."""
_REACH = 50.0
"""Candidates further below the best of their family do not keep it waiting. [nat]"""
FAR = 50.0
"""What must stay so far below an explanation that leaves noise is fitted no further: nobody explains more than all.
[nat]"""
_FEWEST = 5
"""Candidates of a hypothesis that enter each later round, at least."""
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
    """

    hypothesis: Hypothesis
    posterior: Posterior
    points: Floats
    local: Linearisation

    @property
    def log_likelihood(self) -> float:
        """Best so far."""
        return float(np.max(self.local.log_likelihood))

    def best(self, n: int) -> Floats:
        """The best ``n`` of its points, ``(n, n_dim)``."""
        return self.points[np.argsort(-self.local.log_likelihood, kind="stable")[:n]]

    def distinct(self, n: int) -> Floats:
        """The best ``n`` of its points that are not the same, ``(n, n_dim)``; one at least."""
        found = [mode.point for mode in self.modes[:n]]
        return np.array(found) if found else self.best(1)

    @cached_property
    def outlook(self) -> float:
        """Log likelihood that a further step leads to at most, by what is known here."""
        return float(np.max(outlook(self.posterior, self.points, self.local)))

    @cached_property
    def leaves_noise(self) -> bool:
        """Whether the best of its points explains all that was measured, down to noise."""
        return bool(np.isfinite(self.log_likelihood)) and leaves_noise(self.posterior, self.best(1)[0])

    @cached_property
    def modes(self) -> tuple[Mode, ...]:
        """Distinct optima, best first."""
        return distinct(self.points, self.local)


def race(
    present: Posterior,
    hypotheses: Sequence[Hypothesis],
    base_points: Floats,
    *,
    guess: bool = True,
    progress: Callable[[str], None] | None = None,
    pace: Pace = UNHURRIED,
) -> tuple[Fit, ...]:
    """Fit hypotheses, best first.

    An effect in every storey alike joins in the second round, if it is among the leading ones at one storey. Where
    there is no time for all, those that were fitted stand as they are; so do those that can no longer come near one
    that leaves noise, since nobody explains more than all.

    Parameters
    ----------
    present : Posterior
        Of the present model; its engine should use one thread.
    hypotheses : sequence of Hypothesis
        With that model as their base.
    base_points : (n, n_dim) array
        Fits of the present model, in its unit cube: to the whole record and to its beginning.
    guess : bool
        Whether fits start from guessed sizes too; where the residual is noise, the scores' own steps are enough.
    progress : callable, optional
        Told the best hypothesis after each round.
    pace : Pace
        Who fits, whether there is time, and who is told how far it is.
    """
    fits: dict[Hypothesis, Fit] = {}
    at_one_place = {h.symbols for h in hypotheses if len(h.storeys) < 2}
    everywhere: list[Hypothesis] = []
    kept: list[Hypothesis] = []
    for hypothesis in hypotheses:
        joins_later = len(hypothesis.storeys) > 1 and hypothesis.symbols in at_one_place
        (everywhere if joins_later else kept).append(hypothesis)
    fitted_before = [(point, Slopes.at(present, point)) for point in base_points] if guess else []
    leading: list[tuple[str, ...]] = []
    for number, (n_iterations, share) in enumerate(ROUNDS):
        n_kept = min(max(_LEAST, round(share * len(hypotheses))), len(kept))
        joining = [h for h in everywhere if h.symbols in leading] if number == 1 else []
        kept = [*kept[:n_kept], *joining]

        entering = [
            _Entry(family=family, fits=tuple(fits[member] for member in family.members if member in fits))
            for family in families(kept)
        ]
        further = partial(_further, present, base_points[0], fitted_before, n_iterations)
        done = "fitted {} hypotheses" if number == 0 else "refined {} leading hypotheses"
        ended = pace.each(further, entering, done, size=lambda entry: len(entry.family.members))
        fitted = {fit.hypothesis: fit for _, found in ended for fit in found}
        if not fitted:
            break
        fits.update(fitted)
        kept = sorted((h for h in kept if h in fits), key=lambda hypothesis: -fits[hypothesis].log_likelihood)
        leading = list(dict.fromkeys(h.symbols for h in kept))[:_LEADING_FORMS]
        kept = [fit.hypothesis for fit in in_reach([fits[h] for h in kept])]
        if progress is not None and kept:
            progress(f"best so far: {kept[0].label}")
    return tuple(sorted(fits.values(), key=lambda fit: -fit.log_likelihood))


@dataclass(frozen=True, kw_only=True)
class _Entry:
    """A family in a round, with the fits of those of its members that were fitted before."""

    family: Family
    fits: tuple[Fit, ...]


def _further(
    present: Posterior,
    point: Floats,
    known: Sequence[tuple[Floats, Slopes]],
    n_iterations: int,
    entry: _Entry,
) -> list[Fit]:
    """A family fitted by so many iterations: from where its members were, or from starts."""
    family = entry.family
    if len(entry.fits) == len(family.members):
        n_kept = min(max(_BLOCK // len(family.members), _FEWEST), _MOST)
        return _go_on(present, family, entry.fits, n_kept, n_iterations)
    return _fit_family(present, family, _starts(present, family, point, known), n_iterations)


def in_reach(fits: Sequence[Fit]) -> list[Fit]:
    """Of fits, best first, those that may come near the first; all of them, where that one leaves more than noise."""
    if not fits or not fits[0].leaves_noise:
        return list(fits)
    return [fit for fit in fits if fit.outlook > fits[0].log_likelihood - FAR]


def _starts(present: Posterior, family: Family, point: Floats, known: Sequence[tuple[Floats, Slopes]]) -> list[Floats]:
    """Where fits of each member start: where it does next to nothing, since the first step is the score's, and guesses.

    Parameters
    ----------
    point : (n_dim,) array
        The present model's fit.
    known : sequence of ((n_dim,) array, Slopes)
        Fits of it that guesses stand beside; where none are given, nothing is guessed.
    """
    if not known:
        return [member.neutral_points(point, member.amplitudes[0], _NEAR) for member in family.members]
    view = family.posterior(present)
    every = [_first_steps(view, family, *known[0]), *(_guesses(view, family, *one) for one in known)]
    points, reached, owner = (np.concatenate(part) for part in zip(*every, strict=True))
    best = np.argsort(-reached, kind="stable")
    n = min(max(_BLOCK // len(family.members), 1), _MOST)
    return [
        points[best[owner[best] == number][:n]][:, family.columns(member)]
        for number, member in enumerate(family.members)
    ]


def _first_steps(
    view: Posterior, family: Family, point: Floats, slopes: Slopes
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Each member from where it does nothing, over the grid of what vanishes there, by the step that the score says."""
    near = [member.neutral_points(point, member.amplitudes[0], _NEAR) for member in family.members]
    points, _, owner = _together(family, near)
    neutral = [member.neutral_points(point, member.amplitudes[0], 0.0)[:1] for member in family.members]
    names = family.model.space.names
    switches = np.array([names.index(member.amplitudes[0]) for member in family.members])
    beside = switches[owner], _together(family, neutral)[0], owner
    return *suited(view, slopes, family.known, points, beside=beside), owner


def _guesses(
    view: Posterior, family: Family, point: Floats, slopes: Slopes
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Each member's grid beside a fit of the present model.

    A guess stands beside a fit of the rest that does without it, and looks worse than it is: the rest is moved to suit
    each guess, along the slopes that the fit without it has.
    """
    points, _, owner = _together(family, [member.starts(point[None]) for member in family.members])
    if not len(points):  # what is linear in its size needs no guess
        return points, np.empty(0), owner
    return *suited(view, slopes, family.known, points), owner


def _together(family: Family, points: Sequence[Floats]) -> tuple[Floats, Booleans, NDArray[np.int64]]:
    """The members' points among the family's coordinates, which of those are held, and whose each point is."""
    embedded = [family.embed(member, own) for member, own in zip(family.members, points, strict=True)]
    chosen, held = (np.concatenate(part) for part in zip(*embedded, strict=True))
    return chosen, held, np.repeat(np.arange(len(points)), [len(own) for own in points])


def _go_on(present: Posterior, family: Family, fits: Sequence[Fit], n_kept: int, n_iterations: int) -> list[Fit]:
    """Fit the members of a family further, each from the best of its optima, whose expansions are known."""
    best = [fit.modes[:n_kept] for fit in fits]
    local = None
    if all(best):
        known = [
            family.embed_expansion(member, expansion_of(own)) for member, own in zip(family.members, best, strict=True)
        ]
        local = Linearisation.joined(known)
    return _fit_family(present, family, [fit.distinct(n_kept) for fit in fits], n_iterations, local)


def _fit_family(
    present: Posterior,
    family: Family,
    points: Sequence[Floats],
    n_iterations: int,
    local: Linearisation | None = None,
) -> list[Fit]:
    """Fit the members of a family together, each from its own points."""
    view = family.posterior(present)
    chosen, held, owner = _together(family, points)
    found, local = polish(view, chosen, n_iterations=n_iterations, held=held, reach=_REACH, local=local)
    result = []
    for number, member in enumerate(family.members):
        rows = np.flatnonzero(owner == number)
        result.append(
            Fit(
                hypothesis=member,
                posterior=present.with_model(member.model),
                points=found[rows][:, family.columns(member)],
                local=family.extract(member, local[rows]),
            )
        )
    return result
