"""Parameters of a building and unnamed forces in its storeys together: their joint optimum, and slopes there.

What a record pins down is the response, so that parameters and force give way to each other along a ridge: a step in
the parameters goes with what the force then has to be. Both are moved, and the response is made linear about both anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from bwbn_bayes.inference.identifiability import PRIOR_PRECISION
from bwbn_bayes.inference.likelihood import Linearisation, Posterior
from bwbn_bayes.inference.modes import steps
from bwbn_bayes.inference.unnamed.pulses import answers
from bwbn_bayes.inference.unnamed.storey import ANY_KIND, Neighbourhood
from bwbn_bayes.parameters import Floats

_N_TURNS, _N_STEPS = 3, 10
"""Turns in which the force's functions follow the states, and steps of each."""
_SETTLED, _GAIN = 0.02, 0.02
"""Change of the unit cube's coordinates, and gain [nat], below which nothing moves any more."""
_DAMPINGS = np.array([1e-3, 1e-1, 1.0, 10.0, 100.0])
_SHORTER = (0.5, 0.2)
"""Shares of a whole step of both that are tried beside damped ones."""
_NEGLIGIBLE = 1e-8


@dataclass(frozen=True, kw_only=True, eq=False)
class Together:
    """Parameters and forces, and the response linear about them.

    Attributes
    ----------
    posterior : Posterior
        Of the model alone.
    point : (n_dim,) array
        Parameters, in the unit cube.
    functions : mapping of int to (n_functions, n_knots) array
        By storey: histories of the force, each times the standard deviation of its weight. [N]
    weights : (n_all,) array
        Of all of them, storey after storey; of unit variance in the prior.
    level : (n_channels,) array
        Noise standard deviations. [units of the channels]
    """

    posterior: Posterior
    point: Floats
    functions: Mapping[int, Floats]
    weights: Floats
    level: Floats

    @property
    def forces(self) -> dict[int, Floats]:
        """Of each storey ``(n_knots,)``. [N]."""
        return self.forces_of(self.weights)

    def forces_of(self, weights: Floats) -> dict[int, Floats]:
        """Forces by storey of some weights ``(n_all,)``. [N]."""
        ends = np.cumsum([len(own) for own in self.functions.values()])[:-1]
        pairs = zip(self.functions.items(), np.split(weights, ends), strict=True)
        return {storey: own @ histories for (storey, histories), own in pairs}

    @cached_property
    def here(self) -> Neighbourhood:
        """The response with the forces acting."""
        return self._at(self.point, self.weights)

    def _at(self, point: Floats, weights: Floats) -> Neighbourhood:
        return Neighbourhood(posterior=self.posterior, point=point, share=1.0, forces=self.forces_of(weights))

    def scaled(self, rows: Floats) -> Floats:
        """Rows ``(..., n_channels, n_times)`` over the noise, ``(..., n_channels * n_counted)``."""
        kept = rows[..., self.posterior.record.kept] / self.level[:, None]
        return np.asarray(kept.reshape(*rows.shape[:-2], -1))

    @cached_property
    def response(self) -> tuple[Floats, Floats]:
        """Measured channels and their derivatives by the parameters in their own units."""
        view = self.here.view
        response, slopes = view.engine.sensitivities(view.model, self.values[None], view.record)
        return response.values[0], slopes[0]

    @property
    def values(self) -> Floats:
        """Parameters in their own units ``(n_parameters,)``."""
        return np.asarray(self.posterior.split(self.point[None])[0][0])

    @cached_property
    def answers(self) -> Floats:
        """What the channels show of each function ``(n_all, n_channels, n_times)``."""
        view, here = self.here.view, self.here
        return np.concatenate(
            [
                answers(view, self.point, storey, own, float(here.largest[storey - 1]), ())
                for storey, own in self.functions.items()
            ]
        )

    @cached_property
    def _left(self) -> Floats:
        return self.scaled(self.posterior.record.measured - self.response[0])

    @cached_property
    def log_density(self) -> float:
        """Of record and weights given the parameters, but for a constant. [nat]."""
        return self._density(self._left, self.weights)

    def _density(self, left: Floats, weights: Floats) -> float:
        density = -0.5 * float(left @ left + weights @ weights)
        return density if np.isfinite(density) else -np.inf

    @cached_property
    def shown(self) -> Floats:
        """The same over the noise, ``(n_all, n_channels * n_counted)``."""
        return self.scaled(self.answers)

    @cached_property
    def _factor(self) -> tuple[Floats, bool]:
        factor, lower = cho_factor(self.shown @ self.shown.T + np.eye(len(self.weights)))
        return factor, bool(lower)

    @cached_property
    def _taken(self) -> Floats:
        """By how much the expected weights fall with each parameter, ``(n_all, n_dim)``."""
        return np.asarray(cho_solve(self._factor, self.shown @ self._slopes.T))

    @cached_property
    def _slopes(self) -> Floats:
        scale = self.posterior.model.space.unit_scale(self.values[None])[0]
        return np.asarray(self.scaled(self.response[1]) * scale[:, None])

    @cached_property
    def _settled(self) -> Floats:
        """Weights expected at the point."""
        return np.asarray(self.weights + cho_solve(self._factor, self.shown @ self._left - self.weights))

    @cached_property
    def local(self) -> Linearisation:
        """Slope and information of the parameters, the weights integrated out."""
        uncertain = self.shown @ self._left - self.weights
        return Linearisation(
            log_likelihood=np.array([self.log_density]),
            gradient=(self._slopes @ self._left - uncertain @ self._taken)[None],
            information=(self._slopes @ self._slopes.T - (self.shown @ self._slopes.T).T @ self._taken)[None],
        )

    def weights_at(self, point: Floats) -> Floats:
        """Weights expected beside parameters ``(n_dim,)`` of the unit cube, to first order."""
        return np.asarray(self._settled - self._taken @ (point - self.point))

    def moved(self) -> Together | None:
        """A step up the ridge; None where none gains anything.

        Where parameters and force can stand for each other, the middle of the prior draws, as much as a normal prior of
        its variance would: at a corner of the cube the response would be linear about the least likely of all.
        """
        local = self.local
        pull = Linearisation(
            log_likelihood=local.log_likelihood,
            gradient=local.gradient - PRIOR_PRECISION * (self.point - 0.5),
            information=local.information + PRIOR_PRECISION * np.eye(len(self.point)),
        )
        aims = [steps(self.point[None], pull, np.array([damping]), None)[0] for damping in _DAMPINGS]
        trials = [(aim, self.weights_at(aim)) for aim in aims]
        for share in _SHORTER:
            way = [share * (new - old) for new, old in zip(trials[0], (self.point, self.weights), strict=True)]
            trials.append((self.point + way[0], self.weights + way[1]))
        found = [(self._worth(*trial), trial) for trial in trials]
        best, (point, weights) = max(found, key=lambda pair: pair[0])
        if not best > self.log_density + self._pull(self.point) + _GAIN:
            return None
        return replace(self, point=point, weights=weights)

    def _pull(self, point: Floats) -> float:
        return -0.5 * PRIOR_PRECISION * float(np.sum(np.square(point - 0.5)))

    def _worth(self, point: Floats, weights: Floats) -> float:
        """What the optimum is of, at some parameters and weights, solved in full."""
        if not np.isfinite(self.posterior.log_prior(point[None])[0]):
            return -np.inf
        view = self._at(point, weights).view
        values = view.engine.simulate(view.model, view.split(point[None])[0], view.record).values[0]
        left = self.scaled(view.record.measured - values)
        return self._density(left, weights) + self._pull(point)


def together(posterior: Posterior, point: Floats, share: float, level: Floats) -> Together:
    """The joint optimum of a model's parameters and of forces of any kind in all storeys.

    Parameters
    ----------
    posterior : Posterior
        Of the model alone.
    point : (n_dim,) array
        Its optimum, in the unit cube.
    share : float
        Standard deviation of the force of each storey over its largest.
    level : (n_channels,) array
        Noise standard deviations. [units of the channels]
    """
    forces: dict[int, Floats] = {}
    for turn in range(_N_TURNS):
        here = Neighbourhood(posterior=posterior, point=point, share=share, forces=forces)
        functions = {
            storey: share * here.largest[storey - 1] * here.functions_in(storey)[ANY_KIND]
            for storey in range(1, posterior.model.n_links + 1)
        }
        weights = [_weights_of(forces.get(storey), own) for storey, own in functions.items()]
        found = Together(
            posterior=posterior, point=point, functions=functions, weights=np.concatenate(weights), level=level
        )
        for _ in range(_N_STEPS):
            after = found.moved()
            if after is None:
                break
            found = after
        step = float(np.max(np.abs(found.point - point)))
        point, forces = found.point, found.forces
        if turn > 0 and step < _SETTLED:
            break
    return found


def _weights_of(force: Floats | None, functions: Floats) -> Floats:
    """Weights whose functions come closest to a force ``(n_knots,)``."""
    if force is None:
        return np.zeros(len(functions))
    products = functions @ functions.T
    ridge = _NEGLIGIBLE * float(np.trace(products)) * np.eye(len(functions))
    return np.asarray(np.linalg.solve(products + ridge, functions @ force))
