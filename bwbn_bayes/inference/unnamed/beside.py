"""The posterior of a model with an unnamed force beside it: what samplers see, and the responses of its draws.

The size of the force is believed, not fitted: what the parameters take up of a force leaves no trace by which its size
could be told [1]_, and a size fitted to the rest comes out too small. It has the variance of the prior that
``discover`` has for it. Of a building the response is linear in the force about the joint optimum of parameters and
force (:mod:`~bwbn_bayes.inference.unnamed.together`), and the law is solved in full along the motion that the building
has there (:mod:`~bwbn_bayes.inference.unnamed.along`). Of a specimen nothing is linear, since its force adds to the
law's.

References
----------
.. [1] M. C. Kennedy and A. O'Hagan, "Bayesian calibration of computer models", J. R. Statist. Soc. B 63(3), 2001,
   doi:10.1111/1467-9868.00294.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bwbn_bayes.engines.base import Engine, NormalEquations, Response
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.likelihood import IntegratedNoise, Noise, Posterior, SolveCount
from bwbn_bayes.inference.modes import N_CANDIDATES, Mode, best_of, distinct, polish
from bwbn_bayes.inference.unnamed import UNNAMED_SCALE
from bwbn_bayes.inference.unnamed.specimen import fitted_basis, unnamed_basis
from bwbn_bayes.inference.unnamed.storey import over_time, pulled
from bwbn_bayes.inference.unnamed.together import Weights, sharing, together
from bwbn_bayes.parameters import Booleans, Floats
from bwbn_bayes.records.record import Record, require_single
from bwbn_bayes.structures.structure import Structure

BELIEVED = UNNAMED_SCALE
"""Standard deviation of the force over the largest force of its storey: the root mean square of a scale that is
half-normal, since the record does not tell the scale and what stands for all of them has the variance of all."""

_N_STARTS, _SEED = 256, 1
"""Draws of the prior, the best of which join the search for optima beside a force, and their stream's seed."""
_N_CORRECTIONS = 2
"""Of a draw's force, so that the solved response is the one that was sampled."""

Forces = Mapping[int, Floats]
"""By storey, over time ``(n_times,)``. [N]"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Beside:
    """A posterior that knows of an unnamed force.

    Attributes
    ----------
    posterior : Posterior
        What samplers see: the force is integrated out.
    modes : tuple of Mode
        Its optima, best first.
    drawn : callable
        The force that goes with parameters ``(n_dim,)`` of the unit cube, drawn given them and the record.
    """

    posterior: Posterior
    modes: tuple[Mode, ...]
    drawn: Callable[[Floats, np.random.Generator], Forces]

    @property
    def sentence(self) -> str:
        """What was assumed, for the report."""
        of = "the specimen" if self.posterior.model.is_driven else "every storey"
        linear = "" if self.posterior.model.is_driven else " To the force the response is taken as linear."
        return (
            f"In {of} a force of no known law may act beside the model, a Gaussian process whose standard deviation is "
            f"{100.0 * BELIEVED:.2g} % of the largest force there. All intervals know of it.{linear}"
        )


def require_room_for_force(record: Record, noise: Noise | None) -> None:
    """Raise :class:`UserError` where no unnamed force can stand beside a model."""
    require_single(record, "an unnamed force is known of one:")
    if noise is not None and not (isinstance(noise, IntegratedNoise) and noise.correlation is None):
        raise UserError("an unnamed force needs noise levels that are integrated out, of white noise: leave noise out")


def beside(posterior: Posterior, modes: Sequence[Mode]) -> Beside:
    """The posterior with an unnamed force.

    Parameters
    ----------
    posterior : Posterior
        Of the model alone, at its final scheme, under integrated white noise.
    modes : sequence of Mode
        Its optima, best first.
    """
    own = replace(posterior, solves=SolveCount())
    return _beside_specimen(own, modes) if posterior.model.is_driven else _beside_building(own, modes[0])


def _level(noise: Noise) -> Floats:
    """Model-free noise of each channel ``(n_channels,)``, so many times as large as samples count as one."""
    assert isinstance(noise, IntegratedNoise)
    return np.asarray(np.sqrt(np.asarray(noise.scale) / noise.shape * noise.as_one))


def _beside_building(posterior: Posterior, mode: Mode) -> Beside:
    level = _level(posterior.noise)
    found = together(posterior, mode.point, BELIEVED, level)
    view, given = found.view, found.given
    model, record = posterior.model, posterior.record

    def over_samples(weights: Floats) -> Forces:
        return {storey: over_time(force, record, model) for storey, force in found.forces_of(weights).items()}

    def drawn(point: Floats, rng: np.random.Generator) -> Forces:
        # The record pins down the response: what the solved one differs by from the linear one, the force makes good.
        values = view.split(point[None])[0]
        expected = view.engine.simulate(model, values, record).values[0]
        weights = given.drawn(found.scaled(record.measured - expected), rng)
        expected = expected + np.tensordot(weights, found.answers, axes=1)
        for _ in range(_N_CORRECTIONS):
            driven = pulled(record, model, over_samples(weights))
            shown = posterior.engine.simulate(model, values, driven).values[0]
            if np.all(np.isfinite(shown)):
                weights = weights + given.taking(found.scaled(expected - shown))
        return over_samples(weights)

    starts = view.sample_prior(np.random.default_rng(_SEED), _N_STARTS)
    starts = np.concatenate([found.point[None], best_of(view, starts, N_CANDIDATES - 1)])
    return Beside(posterior=view, modes=_optima(view, starts), drawn=drawn)


def _beside_specimen(posterior: Posterior, modes: Sequence[Mode]) -> Beside:
    level, record = _level(posterior.noise), posterior.record
    size = BELIEVED * float(np.max(np.abs(record.channels["force"])))
    view = sharing(posterior, size * fitted_basis(record).T[:, None], level)
    basis = size * unnamed_basis(record).T
    given = Weights.of(basis[:, record.kept] / level)

    def drawn(point: Floats, rng: np.random.Generator) -> Forces:
        response = view.engine.simulate(view.model, view.split(point[None])[0], record).values[0, 0]
        left = (record.channels["force"] - response)[record.kept] / level[0]
        return {1: given.drawn(left, rng) @ basis}

    return Beside(posterior=view, modes=_optima(view, np.array([mode.point for mode in modes])), drawn=drawn)


def _optima(view: Posterior, points: Floats) -> tuple[Mode, ...]:
    return distinct(*polish(view, points, n_iterations=20))


@dataclass(frozen=True, kw_only=True, eq=False)
class Accompanied:
    """Responses of draws, each with a force of its own beside the model.

    The force is a function of the draw: its random numbers come from a stream that the draw's own numbers begin.

    Parameters
    ----------
    engine : Engine
        What solves.
    beside : Beside
        What forces are drawn from.
    point_of : callable
        From a draw's values ``(n_parameters,)`` to the unit cube of that posterior.
    """

    engine: Engine
    beside: Beside
    point_of: Callable[[Floats], Floats]

    @property
    def name(self) -> str:
        """Of the engine that solves."""
        return self.engine.name

    @property
    def scheme(self) -> str:
        """Of the engine that solves."""
        return self.engine.scheme

    def simulate(
        self, model: Structure, draws: Floats, record: Record, channels: Sequence[str] | None = None
    ) -> Response:
        """Each draw under its own force; a storey's force is the law's and that beside it."""
        parts = [self._solved(model, np.ascontiguousarray(own), record, channels) for own in draws]
        return replace(
            parts[0],
            values=np.concatenate([part.values for part in parts]),
            status=np.concatenate([part.status for part in parts]),
        )

    def _solved(self, model: Structure, own: Floats, record: Record, channels: Sequence[str] | None) -> Response:
        forces = self.beside.drawn(self.point_of(own), np.random.default_rng(np.frombuffer(own, dtype=np.uint32)))
        driven = record if model.is_driven else pulled(record, model, forces)
        response = self.engine.simulate(model, own[None], driven, channels)
        for storey, force in forces.items():
            of_storey = {f"restoring_force_{storey}", *(["force"] if model.is_driven else [])}
            for row, name in enumerate(response.channels):
                if name in of_storey:
                    response.values[0, row] += force
        return response

    def sensitivities(
        self,
        model: Structure,
        draws: Floats,
        record: Record,
        channels: Sequence[str] | None = None,
        *,
        free: Booleans | None = None,
    ) -> tuple[Response, Floats]:
        """Not asked for: it shows what was sampled."""
        raise TypeError("responses with a force drawn beside them have no derivatives")

    def misfit(self, model: Structure, draws: Floats, record: Record) -> Floats:
        """Not asked for."""
        raise TypeError("responses with a force drawn beside them have no misfit")

    def normal_equations(
        self, model: Structure, draws: Floats, record: Record, *, free: Booleans | None = None
    ) -> NormalEquations:
        """Not asked for."""
        raise TypeError("responses with a force drawn beside them have no derivatives")
