"""Parameters of a building and unnamed forces in its storeys together: their joint optimum, and the response there.

What a record pins down is the response, so that parameters and force give way to each other along a ridge: a step in
the parameters goes with what the force then has to be. Both are moved at a time, by a response that knows of this
(:mod:`~bwbn_bayes.inference.unnamed.along`) about where they are, and it is told anew about where they come to.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from bwbn_bayes.inference.correlation import Correlation, SharedFunctions
from bwbn_bayes.inference.identifiability import PRIOR_PRECISION
from bwbn_bayes.inference.likelihood import IntegratedNoise, Linearisation, Posterior
from bwbn_bayes.inference.modes import steps
from bwbn_bayes.inference.unnamed.along import AlongMotion, Pinned, Shown, can_be_pinned
from bwbn_bayes.inference.unnamed.first_order import FirstOrder
from bwbn_bayes.inference.unnamed.pulses import answers, knots_of
from bwbn_bayes.inference.unnamed.storey import Neighbourhood
from bwbn_bayes.parameters import Floats

_N_TURNS, _N_STEPS = 15, 30
"""Turns in which response and functions follow parameters and forces, and steps of the parameters in each."""
_N_DRAWS, _SEED = 64, 1
"""Of the prior, the best of which is another start of each turn, and their stream's seed."""
_SETTLED, _GAIN = 0.5, 0.02
"""Gain of a turn, and of a step, below which nothing moves any more. [nat]"""
_DAMPINGS = np.array([1e-3, 1e-1, 1.0, 10.0, 100.0])
_WAYS = (1.0, 0.5, 0.2, 0.05)
"""Shares of the way to where both should be that are tried: solved in full, a large force is not what was expected."""
_NEGLIGIBLE = 1e-8
_AS_KNOWN = 1e7
"""Shape of an inverse-gamma prior that leaves a variance no room."""
_MOST_NUMBERS = 1e8
"""In the answers to forces at all knots of all links: memory bounds how many knots those of tall buildings have."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Weights:
    """Normal weights of functions ``(n_functions, n)`` given what is left, all over the noise."""

    shown: Floats
    factor: Floats

    @classmethod
    def of(cls, shown: Floats) -> Weights:
        """Of unit variance in the prior."""
        factor, _ = cho_factor(shown @ shown.T + np.eye(len(shown)), lower=True)
        return cls(shown=shown, factor=np.tril(factor))

    def taking(self, left: Floats) -> Floats:
        """Those ``(n_functions,)`` expected to show what is left ``(n,)``."""
        return np.asarray(cho_solve((self.factor, True), self.shown @ left))

    def drawn(self, left: Floats, rng: np.random.Generator) -> Floats:
        """One draw of them."""
        around = rng.standard_normal(len(self.factor))
        return np.asarray(self.taking(left) + solve_triangular(self.factor, around, lower=True, trans=1))

    @cached_property
    def unfollowed(self) -> Floats:
        """Share ``(n,)`` of each sample's noise variance that is left once the functions follow the samples."""
        own = solve_triangular(self.factor, self.shown, lower=True)
        return np.asarray(1.0 + np.sum(own * ((own @ own.T) @ own - 2.0 * own), axis=0))


def sharing(posterior: Posterior, basis: Floats, level: Floats) -> Posterior:
    """The posterior whose errors share functions ``(n_functions, n_channels, n_times)``, each times its weight's sd."""
    record, noise = posterior.record, posterior.noise
    assert isinstance(noise, IntegratedNoise)
    shared = SharedFunctions.of((record.where_counted(basis) / level[:, None]).reshape(len(basis), -1).T, level)
    return posterior.with_noise(replace(noise, correlation=Correlation(shared=shared)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Together:
    """Parameters and forces, and the response about them.

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

    @property
    def values(self) -> Floats:
        """Parameters in their own units ``(n_parameters,)``."""
        return np.asarray(self.posterior.split(self.point[None])[0][0])

    @cached_property
    def answers(self) -> Floats:
        """What the channels show of each function ``(n_all, n_channels, n_times)``."""
        return np.concatenate([self._answers(storey, own) for storey, own in self.functions.items()])

    def _answers(self, storey: int, histories: Floats) -> Floats:
        return answers(self.here.view, self.point, storey, histories, float(self.here.largest[storey - 1]))

    @cached_property
    def given(self) -> Weights:
        """The weights given what is left."""
        return Weights.of(self.scaled(self.answers))

    @cached_property
    def view(self) -> Posterior:
        """The posterior of the parameters about this point, whatever the weights."""
        view = self.here.view
        response, slopes = view.engine.sensitivities(view.model, self.values[None], view.record)
        # Where the force is zero on the whole, as its prior has it.
        unforced = response.values[0] - np.tensordot(self.weights, self.answers, axes=1)
        engine = FirstOrder(values=self.values, response=unforced, slopes=slopes[0], scheme=view.engine.scheme)
        if can_be_pinned(view.model):
            engine = AlongMotion.about(engine, self._pinned, self._shown)
        # A level that is integrated out scales the functions' weights as well: where a force is smoother than its
        # process allows, as forces are, the noise would be found smaller than it is, and all intervals narrower.
        scale = tuple((_AS_KNOWN * np.square(self.level) / self._noise.as_one).tolist())
        known = self.posterior.with_noise(replace(self._noise, shape=_AS_KNOWN, scale=scale))
        return sharing(known.with_engine(engine), self.answers, self.level)

    @property
    def _noise(self) -> IntegratedNoise:
        assert isinstance(self.posterior.noise, IntegratedNoise)
        return self.posterior.noise

    @property
    def _shown(self) -> Shown:
        model, record = self.here.view.model, self.here.view.record
        knots = knots_of(record, model)
        numbers = model.n_links * len(knots.samples) * len(record.channels) * record.n_times
        chosen = np.arange(0, len(knots.samples), int(np.ceil(numbers / _MOST_NUMBERS)))
        ones = np.array([np.interp(knots.times, knots.times[chosen], one) for one in np.eye(len(chosen))])
        of_links = np.stack([self._answers(link, ones) for link in range(1, model.n_links + 1)])
        return Shown.of(model, record, knots.samples[chosen], of_links)

    @property
    def _pinned(self) -> Pinned:
        view = self.here.view
        names = [f"displacement_{node}" for node in range(1, view.model.n_floors + 1)]
        motion = view.engine.simulate(view.model, self.values[None], view.record, names).values[0]
        return Pinned.along(view.engine, view.model, view.record, motion)

    def weights_at(self, point: Floats) -> Floats:
        """Weights ``(n_all,)`` expected beside parameters ``(n_dim,)`` of the unit cube."""
        return self.given.taking(self.scaled(self.posterior.record.measured - self._unforced(point)))

    def _unforced(self, point: Floats) -> Floats:
        view = self.view
        return np.asarray(view.engine.simulate(view.model, view.split(point[None])[0], view.record).values[0])

    def at_its_level(self) -> Together:
        """The same under the noise that parameters and force leave, the model-free level counting as its prior says.

        Of a residual that a linear smoother leaves, the noise's part is known whatever it smooths [1]_: what the
        process would have a force be takes no part, since forces are smoother.

        References
        ----------
        .. [1] A. Buja, T. Hastie and R. Tibshirani, "Linear Smoothers and Additive Models", Annals of Statistics 17(2),
           1989, doi:10.1214/aos/1176347115, section 2.7.
        """
        noise, n_channels = self._noise, len(self.level)
        left = self.scaled(self.posterior.record.measured - self._unforced(self.point))
        left = left - self.weights_at(self.point) @ self.given.shown
        of_channels = left.reshape(n_channels, -1)
        squares = np.sum(np.square(of_channels), axis=1)
        told = np.sum(self.given.unfollowed.reshape(n_channels, -1), axis=1) / noise.as_one
        known = np.asarray(noise.scale) * noise.as_one / np.square(self.level)
        share = (2.0 * known + squares) / (2.0 * noise.shape + told)
        after = replace(self, level=self.level * np.sqrt(share))
        after.__dict__["answers"] = self.answers  # of the same forces about the same point
        return after

    @cached_property
    def worth(self) -> float:
        """Log density of record, weights and parameters, but for a constant; see :meth:`moved`. [nat]."""
        return self._worth(self.point, self.weights)

    def moved(self) -> Together | None:
        """Up the ridge; None where nothing is gained.

        Where parameters and force can stand for each other, the middle of the prior draws, as much as a normal prior of
        its variance would: a corner of the cube is the least likely of all to tell the response about.
        """
        aim = self._climbed()
        both = (aim - self.point, self.weights_at(aim) - self.weights)
        forces_alone = (np.zeros_like(aim), self.weights_at(self.point) - self.weights)
        for steps_to in (both, forces_alone):
            for share in _WAYS:
                point, weights = self.point + share * steps_to[0], self.weights + share * steps_to[1]
                if self._worth(point, weights) > self.worth + _GAIN:
                    return replace(self, point=point, weights=weights)
        return None

    def _climbed(self) -> Floats:
        """The best parameters by :attr:`view` and the pull to the middle, from here or from the best of the prior."""
        draws = self.view.sample_prior(np.random.default_rng(_SEED), _N_DRAWS)
        best = draws[np.argmax(self.view.log_likelihood(draws) + _pull(draws))]
        reached = [self._climbed_from(start) for start in (self.point, best)]
        return max(reached, key=lambda pair: pair[1])[0]

    def _climbed_from(self, point: Floats) -> tuple[Floats, float]:
        view = self.view
        reached = float((view.log_likelihood(point[None]) + _pull(point[None]))[0])
        for _ in range(_N_STEPS):
            local = view.linearise(point[None])
            pulled = Linearisation(
                log_likelihood=local.log_likelihood,
                gradient=local.gradient - PRIOR_PRECISION * (point - 0.5),
                information=local.information + PRIOR_PRECISION * np.eye(len(point)),
            )
            trials = np.concatenate([steps(point[None], pulled, np.array([damping]), None) for damping in _DAMPINGS])
            found = np.where(np.isfinite(view.log_prior(trials)), view.log_likelihood(trials) + _pull(trials), -np.inf)
            best = int(np.argmax(found))
            if not found[best] > reached + _GAIN:
                break
            point, reached = trials[best], float(found[best])
        return point, reached

    def _worth(self, point: Floats, weights: Floats) -> float:
        """Of some parameters and weights, solved in full."""
        if not np.isfinite(self.posterior.log_prior(point[None])[0]):
            return -np.inf
        view = self._at(point, weights).view
        values = view.engine.simulate(view.model, view.split(point[None])[0], view.record).values[0]
        left = self.scaled(view.record.measured - values)
        density = -0.5 * float(left @ left + weights @ weights) + float(_pull(point[None])[0])
        return density if np.isfinite(density) else -np.inf


def _pull(points: Floats) -> Floats:
    """Of a normal prior about the middle of the cube, ``(n,)``."""
    return np.asarray(-0.5 * PRIOR_PRECISION * np.sum(np.square(points - 0.5), axis=1))


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
    found = _with_functions(posterior, point, {}, share, level)
    for _ in range(_N_TURNS):
        after = found.moved()
        if after is None:
            break
        gained = after.worth - found.worth
        found = _with_functions(posterior, after.point, after.forces, share, level)
        if gained < _SETTLED:
            break
    return found.at_its_level()


def _with_functions(
    posterior: Posterior, point: Floats, forces: Mapping[int, Floats], share: float, level: Floats
) -> Together:
    """Parameters and forces, with the functions of the states that they make."""
    here = Neighbourhood(posterior=posterior, point=point, share=share, forces=forces)
    functions = {
        storey: share * here.largest[storey - 1] * here.whole_process_in(storey)
        for storey in range(1, posterior.model.n_links + 1)
    }
    weights = np.concatenate([_weights_of(forces.get(storey), own) for storey, own in functions.items()])
    return Together(posterior=posterior, point=point, functions=functions, weights=weights, level=level)


def _weights_of(force: Floats | None, functions: Floats) -> Floats:
    """Weights whose functions come closest to a force ``(n_knots,)``."""
    if force is None:
        return np.zeros(len(functions))
    products = functions @ functions.T
    ridge = _NEGLIGIBLE * float(np.trace(products)) * np.eye(len(functions))
    return np.asarray(np.linalg.solve(products + ridge, functions @ force))
