"""What a race can miss: a size beyond what its prior expects, a time or width between two starts, a fit far from all.

They come of a model that lacks an effect: its fit is bent, so that sizes taken from it are too small and starts near it
too far from the truth; and of grids that are no finer than a first look can pay for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass, replace
from functools import partial

import numpy as np

from bwbn_bayes.discovery.known_slopes import suited
from bwbn_bayes.discovery.pace import UNHURRIED, Pace
from bwbn_bayes.discovery.race import Fit, in_reach, race
from bwbn_bayes.discovery.run import on_threads
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import climb, find_modes, polish
from bwbn_bayes.inference.slopes import Slopes
from bwbn_bayes.parameters import Floats, HalfNormal, Normal, Prior

_LEADING, _SEARCHED = 6, 3
"""Forms of effects that are looked at again, and from draws of their whole priors, each at its best place, the first
at every place."""
_LENDING = 3
"""Forms of effects that lend the rest of their model, at its optimum, to other forms of theirs."""
_BEYOND = 1e-2
"""Prior probability beyond a size so far out that the prior, not the record, may hold it there."""
_WIDER, _MOST_TIMES = 4.0, 3
"""Factor by which such a prior is widened, and how often at most."""
_N_SCANNED = 32
"""Values of a time, a width or a gap that are tried over its whole prior."""
_N_POINTS = 8
_REACH = 50.0
"""Candidates further below the best do not keep it waiting. [nat]"""
_N_STARTS, _N_FIRST = 1024, 64
"""Draws of a whole prior, and how many of the best are fitted to the first window: with a quarter of them a hidden
pinch was found in seven searches of ten only."""
_STEP = 1e-3
"""By which a size is moved to see its slope, in prior probability."""
_SPARSE = 4
"""An effect with so many parameters has a grid too coarse to start from where the model is bent."""


def widened(fits: Sequence[Fit], *, n_threads: int, pace: Pace = UNHURRIED) -> tuple[Fit, ...]:
    """Fits again, best first, the leading ones under wider priors where their sizes lie in a prior's far tail.

    So are they at every other place: a size held back there may be why another place leads.

    Parameters
    ----------
    fits : sequence of Fit
        Best first, at least one.
    n_threads : int
        Threads for the solves.
    pace : Pace
        Those that there is no time for stay as they are.
    """
    everywhere = [fit for form in _leading_forms(fits) for fit in form]
    return _again(fits, everywhere, partial(_widened, n_threads=n_threads), pace)


def rescanned(fits: Sequence[Fit], *, n_threads: int, pace: Pace = UNHURRIED) -> tuple[Fit, ...]:
    """Fits again, best first, the leading ones after a finer look along what does not switch the effect on.

    Parameters
    ----------
    fits : sequence of Fit
        Best first.
    n_threads : int
        Threads for the solves.
    pace : Pace
        Those that there is no time for stay as they are.
    """
    return _again(fits, leading(in_reach(fits)), partial(_rescanned, n_threads=n_threads), pace)


def crossed(present: Posterior, fits: Sequence[Fit], *, pace: Pace = UNHURRIED) -> tuple[Fit, ...]:
    """Fits again, best first, after the leading ones have lent the rest of their model to other forms of their effects.

    A form's starts stand beside a fit without the effect, which is bent by the lack of it; where another form of the
    effect stands at the same place, the rest of the model is bent less. Once one leaves noise there is nothing to mend.

    Parameters
    ----------
    present : Posterior
        Of the model without the effects; its engine should use one thread.
    fits : sequence of Fit
        Best first.
    pace : Pace
        Those that there is no time for stay as they are.
    """
    found = {fit.hypothesis: fit for fit in fits}
    if fits and fits[0].leaves_noise:
        return tuple(fits)
    for lender in leading(fits, _LENDING):
        own = lender.hypothesis
        others = [h for h in found if (h.name, h.storeys) == (own.name, own.storeys) and h.symbols != own.symbols]
        names = lender.posterior.space.names
        shared = [names.index(name) for name in present.space.names]
        for fit in race(present, others, lender.distinct(1)[:, shared], pace=pace) if others else ():
            if fit.log_likelihood > found[fit.hypothesis].log_likelihood:
                found[fit.hypothesis] = fit
    return tuple(sorted(found.values(), key=lambda fit: -fit.log_likelihood))


def searched(
    fits: Sequence[Fit],
    rng: np.random.Generator,
    *,
    n_threads: int,
    pace: Pace = UNHURRIED,
    leading_too: bool = True,
) -> tuple[Fit, ...]:
    """Fits again, best first, the leading ones from draws of their whole priors on growing windows.

    So are those of effects with many parameters at every place: the race may have led none of them anywhere.

    Parameters
    ----------
    fits : sequence of Fit
        Best first.
    rng : numpy.random.Generator
        Random stream.
    n_threads : int
        Threads for the solves.
    pace : Pace
        Those that there is no time for stay as they are.
    leading_too : bool
        Whether leading ones of few parameters are searched so, too: their grids are fine where a model is bent little.
    """
    many = [fit for fit in fits if len(fit.hypothesis.symbols) >= _SPARSE and len(fit.hypothesis.storeys) < 2]
    return _again(
        fits,
        (*(leading(fits, _SEARCHED) if leading_too else ()), *many),
        partial(_searched, n_threads=n_threads),
        pace,
        rng,
    )


def _again(
    fits: Sequence[Fit],
    wanted: Sequence[Fit],
    look: Callable[[Fit, np.random.Generator], Fit],
    pace: Pace,
    rng: np.random.Generator | None = None,
) -> tuple[Fit, ...]:
    """Fits, best first, after another look at some of them, once at each, with a random stream of its own."""
    once = list({id(fit): fit for fit in wanted}.values())
    streams = (rng or np.random.default_rng(0)).spawn(len(once))
    pairs = list(zip(once, streams, strict=True))
    found = pace.each(partial(_looked, look), pairs, "looked again at {} leading hypotheses")
    seen = {id(fit): new for (fit, _), new in found}
    return tuple(sorted((seen.get(id(fit), fit) for fit in fits), key=lambda fit: -fit.log_likelihood))


def _looked(look: Callable[[Fit, np.random.Generator], Fit], pair: tuple[Fit, np.random.Generator]) -> Fit:
    return look(*pair)


def leading(fits: Sequence[Fit], n_forms: int | None = None) -> tuple[Fit, ...]:
    """The best fit of each of the leading forms, and of the first of them the fits at every place."""
    first, *others = _leading_forms(fits)[:n_forms]
    return (*first, *(other[0] for other in others))


def _leading_forms(fits: Sequence[Fit]) -> list[list[Fit]]:
    """The fits of each of the leading forms, best first."""
    forms: dict[tuple[str, ...], list[Fit]] = {}
    for fit in fits:
        forms.setdefault(fit.hypothesis.symbols, []).append(fit)
    return list(forms.values())[:_LEADING]


def _beyond(fit: Fit) -> tuple[str, ...]:
    """Symbols of the sizes that lie in the far tail of their normal prior."""
    space = fit.posterior.space
    point = fit.best(1)[0]
    return tuple(
        p.symbol
        for p, u in zip(space.parameters, point, strict=True)
        if p.name in fit.hypothesis.amplitudes
        and isinstance(p.prior, (Normal, HalfNormal))
        and (u > 1.0 - _BEYOND or (u < _BEYOND and isinstance(p.prior, Normal)))
    )


def _widened(fit: Fit, _rng: np.random.Generator, *, n_threads: int) -> Fit:
    for _ in range(_MOST_TIMES):
        symbols = _beyond(fit)
        if not symbols:
            break
        hypothesis = replace(fit.hypothesis, effect=_with_wider_priors(fit.hypothesis.effect, symbols))
        posterior = fit.posterior.with_model(hypothesis.model)
        points = posterior.space.to_unit(fit.posterior.space.from_unit(fit.best(_N_POINTS)))
        fit = _fitted(replace(fit, hypothesis=hypothesis, posterior=posterior), points, n_threads)
    return fit


def _rescanned(fit: Fit, _rng: np.random.Generator, *, n_threads: int) -> Fit:
    space, hypothesis = fit.posterior.space, fit.hypothesis
    scanned = [space.names.index(name) for name in hypothesis.brought if name not in hypothesis.amplitudes]
    if not scanned:
        return fit
    view, best = on_threads(fit.posterior, n_threads), fit.best(1)[0]
    slopes, switch = Slopes.at(view, best), space.names.index(hypothesis.amplitudes[0])
    found = []
    for column in scanned:
        points = np.tile(best, (_N_SCANNED, 1))
        points[:, column] = (np.arange(_N_SCANNED) + 0.5) / _N_SCANNED
        points = points[np.isfinite(space.log_prior_unit(points))]
        if not len(points):  # what the priors admit together lies between two of the values
            continue
        beside = points.copy()
        beside[:, switch] += _STEP if best[switch] < 0.5 else -_STEP
        others = np.delete(np.arange(space.n_dim), [column, switch])
        each = np.arange(len(points))
        points, reached = suited(
            view, slopes.by(others), others, points, beside=(np.full(len(points), switch), beside, each)
        )
        found.append(points[np.argsort(-reached, kind="stable")[: _N_POINTS // 2]])
    if not found:
        return fit
    points, _ = climb(view, np.concatenate(found), n_iterations=3, reach=_REACH)
    return _fitted(fit, np.concatenate([fit.distinct(_N_POINTS // 2), points]), n_threads)


def _searched(fit: Fit, rng: np.random.Generator, *, n_threads: int) -> Fit:
    view = on_threads(fit.posterior, n_threads)
    try:
        modes = find_modes(view, rng, n_starts=_N_STARTS, n_first=_N_FIRST, n_kept=_N_POINTS, reach=_REACH)
    except UserError:  # no draw of its prior can be solved: what the race found stays
        return fit
    found = [mode.point for mode in modes]
    return _fitted(fit, np.concatenate([np.array(found), fit.distinct(_N_POINTS // 2)]), n_threads)


def _fitted(fit: Fit, points: Floats, n_threads: int) -> Fit:
    found, local = polish(on_threads(fit.posterior, n_threads), points, n_iterations=25, reach=_REACH)
    return replace(fit, points=found, local=local)


def _with_wider_priors(effect: Effect, symbols: Sequence[str]) -> Effect:
    """The effect with wider priors on the sizes with these symbols."""
    if not is_dataclass(effect):
        raise TypeError(f"{effect} is no dataclass")
    wanted = [effect.values[symbol] for symbol in symbols]
    own = {field.name: getattr(effect, field.name) for field in fields(effect)}
    return replace(effect, **{n: _wider(v) for n, v in own.items() if any(v is prior for prior in wanted)})


def _wider(prior: Prior) -> Prior:
    if not isinstance(prior, (Normal, HalfNormal)):
        raise TypeError(f"{prior} has no scale to widen")
    return replace(prior, scale=_WIDER * prior.scale)
