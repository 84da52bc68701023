"""A model with A free has one parameter too many: along it the posterior is known without a single solve.

A change of z's unit (:mod:`bwbn_bayes.elements.scaling`) moves A, k, alpha, beta, gamma, the width of a slip along an
orbit and leaves the response as it is. So all that a record can see lies on a section, A held at one value, whose
prior is that of the whole orbit; a draw of the section is spread along its orbit by the prior alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import NamedTuple, override

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.elements.scaling import Power, powers_of_scale, springs_at
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.panels import Panels, resolve
from bwbn_bayes.parameters import Floats, ParameterSpace, Prior, Uniform
from bwbn_bayes.structures.structure import Structure

_TAIL = 1e-9
"""Probability left out at either end of a prior without bounds."""
_MARKS = np.array([_TAIL, 0.5, 1.0 - _TAIL])
"""Probabilities of a prior between which its density has no second peak."""


class _Entry(NamedTuple):
    """Where a row of the table has a parameter from: its column among the identified ones, or -1 and its value."""

    column: int
    known: float

    def of(self, values: Floats) -> Floats:
        """Its values ``(n, 1)`` from all identified values ``(n, n_parameters)``."""
        return values[:, self.column, None] if self.column >= 0 else np.full((len(values), 1), self.known)


@dataclass(frozen=True, kw_only=True)
class _Follower:
    """An identified parameter that follows the scale, and what the way it follows depends on."""

    column: int
    symbol: str
    power: Power
    alpha: _Entry
    n: _Entry

    def moved(self, values: Floats, log_scale: Floats) -> tuple[Floats, Floats]:
        """Its values at other scales, and the log of their derivative by the value before, ``(n, n_scales)`` each."""
        own = values[:, self.column, None]
        if self.symbol in ("k", "alpha"):
            alpha, factor = springs_at(self.alpha.of(values), np.exp(log_scale))
            if self.symbol == "k":
                return own * factor, np.log(factor)
            return alpha, -log_scale - 2.0 * np.log(factor)
        exponent = self.power.constant + self.power.of_n * self.n.of(values)
        return own * np.exp(exponent * log_scale), exponent * log_scale

    def meets(self, values: Floats, ends: Floats) -> Floats:
        """Log scale ``(n,)`` at which it comes to a value ``(n,)``; not a number where it never does."""
        own, alpha = values[:, self.column], self.alpha.of(values)[:, 0]
        with np.errstate(all="ignore"):
            if self.symbol == "k":
                return np.asarray(np.log((1.0 - alpha) / (ends / own - alpha)))
            if self.symbol == "alpha":
                return np.asarray(np.log(ends / (1.0 - ends) * (1.0 - own) / own))
            return np.asarray(np.log(ends / own) / (self.power.constant + self.power.of_n * self.n.of(values)[:, 0]))


@dataclass(frozen=True, kw_only=True)
class Orbit:
    """All parameters that leave the response of some storeys as it is, one A and what follows it.

    Values ``(n, n_parameters)`` are those of a model with A identified, in its parameters' own units.
    """

    space: ParameterSpace
    a: int
    origin: float
    followers: tuple[_Follower, ...]

    @property
    def ends(self) -> tuple[float, float]:
        """Log scales between which A's prior lies."""
        low, high = _ends(self.space.parameters[self.a].prior)
        return float(np.log(low / self.origin)), float(np.log(high / self.origin))

    def moved(self, values: Floats, log_scale: Floats) -> Floats:
        """Values at another scale ``(n,)`` each."""
        result = values.copy()
        result[:, self.a] = values[:, self.a] * np.exp(log_scale)
        for follower in self.followers:
            result[:, follower.column] = follower.moved(values, log_scale[:, None])[0][:, 0]
        return result

    def to_origin(self, values: Floats) -> Floats:
        """The values of the same orbit where A has its value of the section."""
        return self.moved(values, np.log(self.origin / values[:, self.a]))

    def span(self, values: Floats) -> tuple[Floats, Floats]:
        """Log scales ``(n,)`` between which every prior has room; the first is not below the second where none has."""
        ends = np.broadcast_to(self.ends, (len(values), 2))
        low, high = ends.T.copy()
        for follower in self.followers:
            bounds = self.space.parameters[follower.column].prior.support
            at_ends = follower.moved(values, ends)[0]
            outside = np.where(at_ends < bounds[0], -1, np.where(at_ends > bounds[1], 1, 0))
            met = [follower.meets(values, np.where(outside[:, i] < 0, *bounds)) for i in (0, 1)]
            low = np.maximum(low, np.where(outside[:, 0] == 0, low, met[0]))
            high = np.minimum(high, np.where(outside[:, 1] == 0, high, met[1]))
            never = (outside[:, 0] == outside[:, 1]) & (outside[:, 0] != 0)
            low, high = np.where(never, 0.0, low), np.where(never, 0.0, high)
        return low, high

    def log_density(self, values: Floats, log_scale: Floats) -> Floats:
        """Log prior density ``(n, n_scales)`` of A and what follows it, by the log scale and the section's values."""
        a = self.origin * np.exp(log_scale)
        total = self.space.parameters[self.a].prior.log_density(a) + np.log(a)
        for follower in self.followers:
            moved, log_slope = follower.moved(values, log_scale)
            total = total + self.space.parameters[follower.column].prior.log_density(moved) + log_slope
        return np.asarray(total)

    def log_marginal(self, values: Floats) -> Floats:
        """Log prior density ``(n,)`` of the section's values of what follows A, integrated along the orbit."""
        return self._panels(values).log_integral

    def spread(self, values: Floats, rng: np.random.Generator) -> Floats:
        """One draw along the orbit of each of the section's values, by the prior; where it has no mass, the value."""
        drawn = self._panels(values).draw(partial(self._log_density_at, values), rng)
        return self.moved(values, np.where(np.isfinite(drawn), drawn, 0.0))

    def _panels(self, values: Floats) -> Panels:
        """Panels along the orbits, between marks where some prior has its mass."""
        low, high = self.span(values)
        marks = np.clip(np.stack([low, *self._marks(values), high], axis=1), low[:, None], high[:, None])
        return resolve(partial(self._log_density_at, values), np.sort(np.where(low < high, marks.T, 0.0).T, axis=1))

    def _log_density_at(self, values: Floats, rows: NDArray[np.int64], log_scale: Floats) -> Floats:
        return self.log_density(values[rows], log_scale)

    def _marks(self, values: Floats) -> list[Floats]:
        """Log scales ``(n,)`` at which a parameter comes to the middle or the ends of its prior.

        A uniform prior needs none: where it ends, the orbit does.
        """
        prior = self.space.parameters[self.a].prior
        own = [] if isinstance(prior, Uniform) else np.log(prior.quantile(_MARKS) / self.origin).tolist()
        marks = [np.full(len(values), mark) for mark in own]
        for follower in self.followers:
            prior = self.space.parameters[follower.column].prior
            for end in () if isinstance(prior, Uniform) else prior.quantile(_MARKS):
                met = follower.meets(values, np.full(len(values), end))
                marks.append(np.where(np.isfinite(met), met, 0.0))
        return marks


@dataclass(frozen=True, kw_only=True)
class Section(Posterior):
    """What a record can see of a posterior with A free: ``model`` holds A and has room for every orbit.

    Attributes
    ----------
    full : Posterior
        The posterior with A free.
    orbits : tuple of Orbit
        One for each A.
    """

    full: Posterior
    orbits: tuple[Orbit, ...]

    @property
    def sentence(self) -> str:
        """What was done, for the report."""
        names = self.full.model.space.names
        together = "; ".join(", ".join([names[o.a], *(names[f.column] for f in o.followers)]) for o in self.orbits)
        return (
            f"z has a scale that nothing measured depends on: {together} can change together and leave the response "
            "exactly as it is. Along that scale the posterior is the prior's; it was integrated, not sampled."
        )

    def to_section(self, points: Floats) -> Floats:
        """The section's points on the orbits of points ``(n, n_dim + n_orbits)`` of the cube of the full posterior."""
        values = self.full.space.from_unit(points)
        for orbit in self.orbits:
            values = orbit.to_origin(values)
        return self.space.to_unit(np.delete(values, [orbit.a for orbit in self.orbits], axis=1))

    def spread(self, points: Floats, rng: np.random.Generator) -> Floats:
        """Draws of the full posterior, in its unit cube, from draws ``(n, n_dim)`` of the section."""
        values = self._values(points)
        for orbit in self.orbits:
            values = orbit.spread(values, rng)
        return self.full.space.to_unit(values)

    @override
    def log_prior(self, points: Floats) -> Floats:
        result = super().log_prior(points)
        inside = np.isfinite(result)
        values = self._values(points[inside])
        density = np.full(len(values), -self.full.space.log_admissible_mass)
        own = dict(zip(self.space.names, self.space.parameters, strict=True))
        for orbit in self.orbits:
            density += orbit.log_marginal(values)
            for follower in orbit.followers:
                name = self.full.space.names[follower.column]
                density -= own[name].prior.log_density(values[:, follower.column])
        result[inside] = density
        return result

    @override
    def sample_prior(self, rng: np.random.Generator, n: int) -> Floats:
        return self.to_section(self.full.sample_prior(rng, n))

    def _values(self, points: Floats) -> Floats:
        """Values of the full model's parameters, A where the section holds it, ``(n, n_dim + n_orbits)``."""
        values = np.empty((len(points), self.full.n_dim))
        held = [orbit.a for orbit in self.orbits]
        values[:, np.setdiff1d(np.arange(self.full.n_dim), held)] = self.space.from_unit(points)
        values[:, held] = [orbit.origin for orbit in self.orbits]
        return values


def section_of(posterior: Posterior) -> Section | None:
    """The section of a posterior with A free; None where A is known or something known fixes the scale of z."""
    model = posterior.model
    orbits = tuple(
        orbit
        for column, parameter in enumerate(model.space.parameters)
        if parameter.symbol == "A" and (orbit := _orbit(model, column)) is not None
    )
    if not orbits:
        return None
    changed: dict[str, float | Prior] = {model.space.names[orbit.a]: orbit.origin for orbit in orbits}
    for orbit in orbits:
        changed |= _with_room(orbit)
    return Section(
        model=model.with_values(changed),
        record=posterior.record,
        engine=posterior.engine,
        noise=posterior.noise,
        solves=posterior.solves,
        full=posterior,
        orbits=orbits,
    )


def _orbit(model: Structure, a: int) -> Orbit | None:
    """The orbit along one A: every parameter of its storeys that follows it is identified, and for them alone."""
    powers = powers_of_scale(model.law)
    if powers is None:
        return None
    symbols = [parameter.symbol for parameter in model.parameters]
    rows = np.flatnonzero(model.table.index[:, symbols.index("A")] == a).tolist()

    def entry(row: int, name: str) -> _Entry:
        column = symbols.index(name)
        return _Entry(int(model.table.index[row, column]), float(model.table.fixed[row, column]))

    followers: dict[int, _Follower] = {}
    for name, power in {"k": Power(0, 0), "alpha": Power(0, 0), **powers}.items():
        for row in rows:
            own = entry(row, name)
            if own.column < 0 and (own.known == 0.0 or not _acts(model, name, row + 1)):
                continue
            follower = _Follower(
                column=own.column, symbol=name, power=power, alpha=entry(row, "alpha"), n=entry(row, "n")
            )
            everywhere = np.flatnonzero(model.table.index[:, symbols.index(name)] == own.column)
            if own.column < 0 or not set(everywhere) <= set(rows):
                return None
            if followers.setdefault(own.column, follower) != follower:
                return None
    space = model.space
    if any(space.parameters[f.column].prior.support[0] < 0.0 for f in followers.values() if f.symbol == "alpha"):
        return None
    origin = float(space.parameters[a].prior.quantile(0.5))
    return Orbit(space=space, a=a, origin=origin, followers=tuple(followers.values()))


def _acts(model: Structure, name: str, storey: int) -> bool:
    """Whether a parameter belongs to the storey itself or to an effect that acts on it."""
    placed = (p for p in model.effects if storey in p.storeys or not p.storeys)
    own = (*model.element.parameters, *(parameter for one in placed for parameter in one.effect.parameters))
    return any(parameter.symbol == name for parameter in own)


def _with_room(orbit: Orbit) -> dict[str, float | Prior]:
    """Uniform priors that hold what follows A, wherever on its orbit: extremes lie at corners, each being monotone."""
    parameters = orbit.space.parameters
    result: dict[str, float | Prior] = {}
    for follower in orbit.followers:
        concerned = sorted({follower.column, follower.alpha.column, follower.n.column} - {-1})
        corners = np.array(list(product(*(_ends(parameters[c].prior) for c in concerned), orbit.ends)))
        values = np.zeros((len(corners), len(parameters)))
        values[:, concerned] = corners[:, :-1]
        moved = follower.moved(values, -corners[:, -1:])[0]
        result[orbit.space.names[follower.column]] = Uniform(float(np.min(moved)), float(np.max(moved)))
    return result


def _ends(prior: Prior) -> tuple[float, float]:
    """Its support, or where all but a billionth of it lies."""
    low, high = prior.support
    if not np.isfinite(low):
        low = float(prior.quantile(_TAIL))
    return low, high if np.isfinite(high) else float(prior.quantile(1.0 - _TAIL))
