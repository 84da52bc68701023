"""The unnamed force at a storey: a polynomial of drift, drift rate, hysteretic displacement and work, in the motion.

Its weights are independent normals, so that it is a Gaussian process in a finite basis; they are identified like an
effect's parameters. Odd terms come first, since a storey does the same in both directions more often than not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self, override

import numpy as np
import sympy as sp
from scipy.linalg import cho_factor, cho_solve

from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.discovery.score import Slopes
from bwbn_bayes.elements.law import DRIFT, DRIFT_RATE, ENERGY, HYSTERETIC_DISPLACEMENT, Effect, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.parameters import Floats, Normal, Parameter, Value
from bwbn_bayes.structures.structure import Structure

_NEAR = 1e-4
"""How far from neutral a weight is moved for its slope, in prior probability."""
_SOURCE = "Kennedy and O'Hagan 2001, doi:10.1111/1467-9868.00294"

POWERS = (
    *((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0)),
    *((3, 0, 0, 0), (2, 1, 0, 0), (2, 0, 1, 0), (1, 2, 0, 0), (1, 1, 1, 0), (1, 0, 2, 0)),
    *((0, 3, 0, 0), (0, 2, 1, 0), (0, 1, 2, 0), (0, 0, 3, 0)),
    *((1, 0, 0, 1), (0, 1, 0, 1), (0, 0, 1, 1), (0, 0, 3, 1)),
    *((2, 0, 0, 0), (0, 0, 2, 0), (0, 2, 0, 0)),
)
"""Of drift, drift rate, hysteretic displacement and work, each over its largest, in every term."""
_STATES = ((DRIFT, "u", "m"), (DRIFT_RATE, "v", "m/s"), (HYSTERETIC_DISPLACEMENT, "z", "m"), (ENERGY, "e", "J"))
_SCALES = tuple(
    Parameter(symbol=f"unnamed_{short}", unit=unit, neutral=1.0, description=f"largest {state.name}", source=_SOURCE)
    for state, short, unit in _STATES
)
_WEIGHTS = tuple(
    Parameter(
        symbol=f"unnamed_{number}", unit="N", neutral=0.0, description="weight of an unnamed force", source=_SOURCE
    )
    for number in range(1, len(POWERS) + 1)
)


@dataclass(frozen=True, kw_only=True)
class UnnamedForce(Effect):
    """``F + sum_j w_j (u / u_0)^a (v / v_0)^b (z / z_0)^c (epsilon / epsilon_0)^d``, with :data:`POWERS`.

    Parameters
    ----------
    weights : tuple of float or Prior
        [N]
    sizes : tuple of float
        Largest drift [m], drift rate [m/s], hysteretic displacement [m] and work [J].
    """

    weights: tuple[Value, ...] = field(default=(0.0,) * len(POWERS))
    sizes: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)

    name: ClassVar[str] = "unnamed_force"
    summary: ClassVar[str] = "a smooth force of the storey's states that no catalogued law is"
    source: ClassVar[str] = _SOURCE
    residual: ClassVar[str] = "whatever a smooth force of the states leaves"
    confusable: ClassVar[str] = "every effect that is smooth"
    parameters: ClassVar[tuple[Parameter, ...]] = (*_WEIGHTS, *_SCALES)

    @property
    @override
    def values(self) -> Mapping[str, Value]:
        return dict(zip((p.symbol for p in self.parameters), (*self.weights, *self.sizes), strict=True))

    @classmethod
    def of(cls, scales: Scales, share: float) -> Self:
        """With priors whose sum is a share of the largest storey force."""
        weight = Normal(0.0, share * scales.force)
        sizes = (scales.drift, scales.drift_rate, scales.hysteretic_displacement, scales.energy)
        return cls(weights=(weight,) * len(POWERS), sizes=sizes)

    @override
    def start_grid(self, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {parameter.symbol: (0.0,) for parameter in _WEIGHTS}

    @override
    def fill(self, slots: Slots) -> Slots:
        ratios = [state / symbol(scale.symbol) for (state, _, _), scale in zip(_STATES, _SCALES, strict=True)]
        terms = (
            symbol(weight.symbol) * sp.Mul(*(ratio**power for ratio, power in zip(ratios, powers, strict=True)))
            for weight, powers in zip(_WEIGHTS, POWERS, strict=True)
        )
        return replace(slots, added_force=slots.added_force + sp.Add(*terms))


def unnamed_hypothesis(base: Structure, storey: int, scales: Scales, share: float) -> Hypothesis:
    """A model with an unnamed force at one storey, its scale a share of the largest force there."""
    return Hypothesis(base=base, effect=UnnamedForce.of(scales, share), storeys=(storey,), scales=scales)


def first_order_gain(posterior: Posterior, hypothesis: Hypothesis, point: Floats) -> float:
    """Log Bayes factor of an unnamed force where what a fit leaves is small, to first order in its weights, in nat.

    Parameters
    ----------
    posterior : Posterior
        Of the model without it.
    hypothesis : Hypothesis
        With it.
    point : (n_dim,) array
        The optimum without it.
    """
    view, names = posterior.with_model(hypothesis.model), hypothesis.amplitudes
    rows = [hypothesis.neutral_points(point, names[0], 0.0)]
    rows += [hypothesis.neutral_points(point, name, _NEAR) for name in names]
    values = view.split(np.concatenate(rows))[0]
    columns = [view.space.names.index(name) for name in names]
    steps = values[1:][np.arange(len(names)), columns] - values[0, columns]
    response = view.engine.simulate(view.model, values, view.record).values
    sds = np.array([view.space.parameters[column].prior.sd for column in columns])
    slopes = (response[1:] - response[0]) * (sds / steps)[:, None, None]
    gradient, information = Slopes.at(posterior, point).projected_together(response[0], slopes)
    factor = cho_factor(np.eye(len(names)) + information, lower=True)
    gain = 0.5 * float(gradient @ cho_solve(factor, gradient))
    return gain - float(np.sum(np.log(np.diag(factor[0]))))


def force_of(parameters: Mapping[str, float], histories: Mapping[str, Floats]) -> Floats:
    """The unnamed force ``(n_times,)`` [N] of a storey's parameters, by symbol, and histories, by kind."""
    kinds = ("drift", "drift_rate", "hysteretic_displacement", "hysteretic_energy")
    ratios = [histories[kind] / parameters[scale.symbol] for kind, scale in zip(kinds, _SCALES, strict=True)]
    terms = (
        parameters[weight.symbol] * np.prod([ratio**power for ratio, power in zip(ratios, powers, strict=True)], axis=0)
        for weight, powers in zip(_WEIGHTS, POWERS, strict=True)
    )
    return np.asarray(sum(terms))
