"""A force of no known law that is a function of one state of its storey.

That state is the drift, the drift rate or the hysteretic displacement, and the function one of many scales
(:mod:`~bwbn_bayes.inference.unnamed.hats`), whose size and smoothness are integrated out. Forces such as friction and
pinching change fastest where the state passes through zero: the scale of the state is stretched there, four times at
zero, so that a function that is rough there need not be so everywhere. It is a law like others,
solved by the engine and fitted with the other parameters, first to the beginning of the record: a force that is large
bends the motion, and what follows to first order from a model without it
(:mod:`~bwbn_bayes.inference.unnamed.storey`) is then far from what it does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self, override

import numpy as np
import sympy as sp
from numpy.typing import NDArray
from scipy.special import logsumexp, ndtri

from bwbn_bayes.elements.law import DRIFT, DRIFT_RATE, HYSTERETIC_DISPLACEMENT, Effect, Slots, symbol
from bwbn_bayes.inference.likelihood import Linearisation, Posterior
from bwbn_bayes.inference.modes import Mode, best_of, cloud, distinct, first_window, polish, windows
from bwbn_bayes.inference.slopes import Slopes
from bwbn_bayes.inference.summary import observe
from bwbn_bayes.inference.unnamed.hats import HATS, SMOOTHNESS, SOURCE, smoothed
from bwbn_bayes.inference.unnamed.sums import Sums
from bwbn_bayes.parameters import Booleans, Floats, Normal, Parameter, Value
from bwbn_bayes.structures.parts import PlacedEffect

_STRETCHED = sp.Rational(1, 16)
"""Of the reach, about zero, where the state's scale is stretched."""
_ROOM, _N_REACHED, _TOO_FAR = 1.25, 4, 3.0
"""Reach of the function over the state's largest, first that without the force; how often a fit that goes beyond has
its reach grow, and how many times the largest a reach may be in the end."""
_RIDGE = 1e-6
"""Of the weights' variance, with which a function is told anew over another reach."""
_WIDE = 0.5
"""Scale within which weights are looked for, over the largest force: what is probable is weighed afterwards."""
_N_ITERATIONS, _N_LAST, _N_CANDIDATES, _N_KEPT = 12, 30, 4, 2
"""Steps on a part of the record and on the whole; points from which they go, and fits kept."""
_N_POINTS = 1025
"""At which a function is told anew."""
_REACH, _FEWEST = 50.0, 2
"""How far below the best a state goes on [nat]; after two parts of the record the better half does, these at least."""
_BEHIND = 400.0
"""How far a state may fall below the best law that is known, over a part of the record or all of it [nat]: under white
errors laws have been seen 379 nats below what they contain."""
_FINE = 4
"""Level of the hats from which on a part of the record leaves their weights alone: three quarters of all."""
_N_TURNS, _SAME_SCALE = 5, 0.25
"""In which the fit and the force's scale find each other, and the log ratio of scales that ends it."""
_STATES = {"drift": DRIFT, "drift_rate": DRIFT_RATE, "hysteretic_displacement": HYSTERETIC_DISPLACEMENT}
STATES = tuple(_STATES)
"""What the force may be a function of."""


_WEIGHTS = tuple(
    Parameter(symbol=f"w_{number}", unit="N", neutral=0.0, description="weight of a hat", source=SOURCE)
    for number in range(len(HATS))
)
_PER = {
    "drift": Parameter(symbol="per_u", unit="1/m", neutral=0.0, description="one over the reach", source=SOURCE),
    "drift_rate": Parameter(symbol="per_v", unit="s/m", neutral=0.0, description="one over the reach", source=SOURCE),
    "hysteretic_displacement": Parameter(
        symbol="per_z", unit="1/m", neutral=0.0, description="one over the reach", source=SOURCE
    ),
}


@dataclass(frozen=True, kw_only=True)
class StateFunction(Effect):
    """``F + f(w(x / reach))`` with ``x`` a state of the storey and ``w(x) = x sqrt((1 + h) / (|x| + h))``.

    Parameters
    ----------
    state : str
        One of :data:`STATES`.
    reach : float
        Of the state, on either side of zero. [m] or [m/s]
    scale : float
        Standard deviation of the force at the end of the reach. [N]
    """

    state: str
    reach: float
    scale: float

    name: ClassVar[str] = "state_function"
    summary: ClassVar[str] = "a force of no known law"
    source: ClassVar[str] = SOURCE
    residual: ClassVar[str] = "whatever a force of one state leaves"
    confusable: ClassVar[str] = "every law of that state"
    parameters: ClassVar[tuple[Parameter, ...]] = (*_WEIGHTS, *_PER.values())

    @property
    @override
    def values(self) -> Mapping[str, Value]:
        weights = {p.symbol: Normal(0.0, self.scale * one.sd) for p, one in zip(_WEIGHTS, HATS, strict=True)}
        return {**weights, **{p.symbol: 1.0 / self.reach if at == self.state else 0.0 for at, p in _PER.items()}}

    @override
    def fill(self, slots: Slots) -> Slots:
        over_reach = sum(state * symbol(_PER[at].symbol) for at, state in _STATES.items())
        x = over_reach * sp.sqrt((1 + _STRETCHED) / (sp.Abs(over_reach) + _STRETCHED))
        knots: dict[float, sp.Expr] = {}
        for parameter, hat in zip(_WEIGHTS, HATS, strict=True):
            for at, by in hat.knots:
                knots[at] = knots.get(at, sp.S.Zero) + sp.Rational(by) * symbol(parameter.symbol)
        bent = sum(by * (x - sp.Rational(at)) * sp.Abs(x - sp.Rational(at)) for at, by in knots.items())
        level = sum(symbol(p.symbol) / 2 for p, hat in zip(_WEIGHTS, HATS, strict=True) if hat.level == 0)
        return replace(slots, added_force=slots.added_force + bent + level)

    def force(self, weights: Floats, state: Floats) -> Floats:
        """The force ``(n_times,)`` [N] at a history of its state, of weights ``(n_weights,)`` [N]."""
        over_reach, stretched = state / self.reach, float(_STRETCHED)
        x = over_reach * np.sqrt((1.0 + stretched) / (np.abs(over_reach) + stretched))
        return np.asarray(weights @ np.array([one.over(x) for one in HATS]))


@dataclass(frozen=True, kw_only=True)
class TiedPosterior(Posterior):
    """The posterior of a model with a :class:`StateFunction` whose weights have a narrower prior than their cube has.

    Where the force can take over from a law beside it, which of them does is for the prior to say: fits must know it.

    Parameters
    ----------
    scale : float
        Standard deviation of the coarsest weights' prior over that in which the unit cube is uniform.
    smoothness : float
        Halvings by which that of the others falls from level to level, beyond a Brownian motion's.
    """

    scale: float = 1.0
    smoothness: float = 0.0

    @property
    @override
    def about(self) -> str:
        return f"{super().about}, weights of scale {self.scale!r} and smoothness {self.smoothness!r}"

    @cached_property
    def columns(self) -> NDArray[np.int64]:
        """Where the weights stand among the coordinates."""
        symbols = [p.symbol for p in self.model.space.parameters]
        return np.array([symbols.index(p.symbol) for p in _WEIGHTS])

    @property
    @override
    def standard(self) -> NDArray[np.int64]:
        return self.columns

    @override
    def log_likelihood_of(self, misfit: Floats, points: Floats) -> Floats:
        """With the log ratio of the two priors added."""
        standard = ndtri(points[:, self.columns])
        tie = -0.5 * np.square(standard) @ self._tied - np.sum(np.log(self._narrower))
        return np.asarray(super().log_likelihood_of(misfit, points) + tie)

    @override
    def linearise(self, points: Floats, free: Booleans | None = None) -> Linearisation:
        local, columns = super().linearise(points, free), self.columns
        standard = ndtri(points[:, columns])
        # By the unit coordinate, in which a standard normal's quantile grows by one over its density.
        growth = np.sqrt(2.0 * np.pi) * np.exp(0.5 * np.square(standard)) * (1.0 if free is None else free[:, columns])
        gradient, information = local.gradient.copy(), local.information.copy()
        gradient[:, columns] -= self._tied * standard * growth
        information[:, columns, columns] += self._tied * np.square(growth)
        return replace(local, gradient=gradient, information=information)

    @cached_property
    def _narrower(self) -> Floats:
        """Standard deviation of each weight's prior over that of its cube."""
        return self.scale * smoothed(self.smoothness)

    @cached_property
    def _tied(self) -> Floats:
        return 1.0 / np.square(self._narrower) - 1.0


@dataclass(frozen=True, kw_only=True)
class StateForce:
    """An unnamed force that is a function of one state, fitted beside a model.

    Attributes
    ----------
    gain_over : float
        What integrating scale and smoothness out adds to the log evidence that it has at those of the posterior. [nat]
    storey : int
    effect : StateFunction
    posterior : TiedPosterior
        Of the model with it, at the scale and smoothness that most of its evidence comes from.
    modes : tuple of Mode
        Optima of that, best first.
    weights : (n_weights,) array
        What they are expected to be. [N]
    """

    gain_over: float
    storey: int
    effect: StateFunction
    posterior: TiedPosterior
    modes: tuple[Mode, ...]
    weights: Floats

    @property
    def kind(self) -> str:
        """What it is a function of, in words."""
        return f"of the {self.effect.state.replace('_', ' ')} alone"


def state_forces(
    posterior: Posterior,
    points: Floats,
    share: float,
    rng: np.random.Generator,
    known: tuple[Posterior, Floats] | None = None,
) -> tuple[StateForce, ...]:
    """Forces of one state of a storey beside a model, fitted to more and more of the record while they keep up.

    Only the whole record is asked for the finest functions: most of what a fit costs is derivatives by their weights.

    Parameters
    ----------
    posterior : Posterior
        Of the model.
    points : (n, n_dim) array
        Its fits, the best one first, in the unit cube.
    share : float
        Standard deviation of the scale's half-normal prior, over the largest force of the storey.
    rng : numpy.random.Generator
        Random stream.
    known : tuple of Posterior and (n_dim,) array, optional
        The best law and its fit, with which they keep up, too.
    """
    rows = observe(posterior.engine, posterior.model, posterior.split(points[:1])[0], posterior.record)
    places = [(storey, state) for storey in range(1, posterior.model.n_links + 1) for state in STATES]
    rivals = [_Rival.of(posterior, points, storey, state, rows, share) for storey, state in places]
    ends = windows(posterior.record.duration, first_window(posterior))
    for number, end in enumerate(ends):
        n_iterations = _N_ITERATIONS if end < ends[-1] else _N_LAST
        rivals = [rival for rival in (one.fitted(end, n_iterations, rng) for one in rivals) if rival.modes]
        if not rivals:
            return ()
        rivals.sort(key=lambda rival: -rival.reached)
        if number > 1:
            rivals = rivals[: max(len(rivals) // 2, _FEWEST)]
        least = max(rivals[0].reached - _REACH, _reached(known, end) - _BEHIND)
        rivals = [rival for rival in rivals if rival.reached > least]
    return tuple(rival.weighed(share) for rival in rivals)


def _reached(known: tuple[Posterior, Floats] | None, end: float) -> float:
    """Log likelihood of a law up to a time; minus infinity where none is known."""
    if known is None:
        return -np.inf
    posterior, point = known
    return float(posterior.until(end).log_likelihood(point[None])[0])


@dataclass(frozen=True, kw_only=True)
class _Rival:
    """A model with a force of one state of a storey, on the way to its fit.

    Attributes
    ----------
    storey : int
    effect : StateFunction
    largest : float
        Force of the storey. [N]
    posterior : TiedPosterior
    modes : tuple of Mode
        Of the last window.
    points : (n, n_dim) array
        From which the next is fitted.
    """

    storey: int
    effect: StateFunction
    largest: float
    posterior: TiedPosterior
    points: Floats
    modes: tuple[Mode, ...] = ()

    @classmethod
    def of(
        cls, posterior: Posterior, points: Floats, storey: int, state: str, rows: Mapping[str, Floats], share: float
    ) -> Self:
        """One that does nothing yet, beside a model that moves through ``rows`` by kind of state."""
        largest = float(np.max(np.abs(rows["restoring_force"][0, storey - 1])))
        reach = _ROOM * float(np.max(np.abs(rows[state][0, storey - 1])))
        effect = StateFunction(state=state, reach=reach, scale=_WIDE * largest)
        placed = PlacedEffect(effect=effect, storeys=(storey,))
        base = posterior.model
        view = TiedPosterior(
            model=replace(base, carried=(), effects=(*base.effects, placed)),
            record=posterior.record,
            engine=posterior.engine,
            noise=posterior.noise,
            solves=posterior.solves,
            journal=posterior.journal,
            scale=share / _WIDE,
        )
        start = np.full((len(points), view.space.n_dim), 0.5)
        start[:, [view.space.names.index(name) for name in posterior.space.names]] = points
        return cls(storey=storey, effect=effect, largest=largest, posterior=view, points=start)

    @property
    def reached(self) -> float:
        """Log likelihood of the last window's best fit."""
        return self.modes[0].log_likelihood if self.modes else -np.inf

    def fitted(self, end: float, n_iterations: int, rng: np.random.Generator) -> Self:
        """Fitted to the record up to a time, from the last fits and a cloud around them, as far as the state goes."""
        points, rival = self.points, self
        is_whole = end >= self.posterior.record.duration
        held = None if is_whole else self._fine
        if self.modes:
            view, around = self.posterior.until(end), cloud(self.posterior, self.modes, rng)
            around = np.where(self._fine, points[0], around)
            points = best_of(view, np.concatenate([points, around]), _N_CANDIDATES)
        for _ in range(_N_REACHED):
            view = rival.posterior.until(end)
            modes = distinct(*polish(view, points, n_iterations=n_iterations, held=held, reach=_REACH))
            rival = replace(rival, modes=modes[:_N_KEPT], points=np.array([mode.point for mode in modes[:_N_KEPT]]))
            if not modes:
                break
            largest = rival._largest_state(end)
            if not np.isfinite(largest):  # solved for what is measured, but not for the state: there is no reach
                return replace(rival, modes=())
            if largest <= rival.effect.reach <= (_TOO_FAR * largest if is_whole else np.inf):
                break
            rival = rival._reaching(_ROOM * largest)
            points = rival.points
        return rival

    @property
    def _fine(self) -> Booleans:
        """Coordinates ``(n_dim,)`` that are weights of the finest functions."""
        found = np.zeros(self.posterior.n_dim, dtype=np.bool_)
        found[self.posterior.columns] = [hat.level >= _FINE for hat in HATS]
        return found

    def _largest_state(self, end: float) -> float:
        """Of the best fit up to a time."""
        view = self.posterior.until(end)
        rows = observe(view.engine, view.model, view.split(self.points[:1])[0], view.record)
        return float(np.max(np.abs(rows[self.effect.state][0, self.storey - 1])))

    def _reaching(self, reach: float) -> Self:
        """With the same functions over another reach."""
        effect, old = replace(self.effect, reach=reach), self.posterior
        placed = PlacedEffect(effect=effect, storeys=(self.storey,))
        posterior = replace(old, model=replace(old.model, effects=(*old.model.effects[:-1], placed)))
        state, sd = np.linspace(-reach, reach, _N_POINTS), np.array([hat.sd for hat in HATS])
        basis = sd[:, None] * np.array([effect.force(own, state) for own in np.eye(len(HATS))])
        values = old.split(self.points)[0]
        for own in values:
            wanted = self.effect.force(own[old.columns], state)
            own[old.columns] = sd * np.linalg.solve(basis @ basis.T + _RIDGE * np.eye(len(sd)), basis @ wanted)
        return replace(self, effect=effect, posterior=posterior, points=posterior.space.to_unit(values))

    def weighed(self, share: float) -> StateForce:
        """At the scale and smoothness that most of its evidence comes from, with what integrating over both adds there.

        What gives way to what depends on them: they and the fit are found in turns.
        """
        rival, kept = self, (1.0, 0.0)
        for _ in range(_N_TURNS):
            slopes = Slopes.at(rival.posterior, rival.points[0])
            every = {smoothness: rival._sums(slopes, share, smoothness) for smoothness in SMOOTHNESS}
            found = {smoothness: sums.settled() for smoothness, sums in every.items()}
            smoothness = max(found, key=lambda own: found[own].log_evidence)
            scale = found[smoothness].scale
            if smoothness == kept[1] and abs(np.log(scale / kept[0])) < _SAME_SCALE:
                break
            kept = scale, smoothness
            rival = rival._refitted(replace(rival.posterior, scale=scale * share / _WIDE, smoothness=smoothness))
        whole = logsumexp([own.log_evidence for own in found.values()]) - np.log(len(found))
        return StateForce(
            gain_over=float(whole - every[kept[1]].at_scale(kept[0])),
            storey=rival.storey,
            effect=rival.effect,
            posterior=rival.posterior,
            modes=rival.modes,
            weights=rival._sd(share, smoothness) * found[smoothness].weights,
        )

    def _refitted(self, posterior: TiedPosterior) -> Self:
        modes = distinct(*polish(posterior, self.points, n_iterations=_N_LAST, reach=_REACH))[:_N_KEPT]
        return replace(self, posterior=posterior, modes=modes, points=np.array([mode.point for mode in modes]))

    def _sd(self, share: float, smoothness: float) -> Floats:
        """Of the weights, where the scale is one. [N]."""
        return share * self.largest * np.array([hat.sd for hat in HATS]) * smoothed(smoothness)

    def _sums(self, slopes: Slopes, share: float, smoothness: float) -> Sums:
        """About the best fit, where the slopes are."""
        view = self.posterior
        values, _ = view.split(self.points[:1])
        sd, columns = self._sd(share, smoothness), view.columns
        per_unit = view.model.space.unit_scale(values)[0, columns]
        answers = (slopes.base.T[columns] * (sd / per_unit)[:, None]).reshape(-1, *slopes.residual.shape)
        others = slopes.base.T[np.setdiff1d(np.arange(view.space.n_dim), columns)]
        present = values[0, columns] / sd
        return Sums.of(slopes, view.noise, others, answers, unforced=slopes.residual, present=present)
