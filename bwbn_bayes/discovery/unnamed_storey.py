"""The unnamed force at a storey, in the motion: a smooth function of its states, or a change of them with time.

A polynomial of drift, drift rate, hysteretic displacement and work, and each of the first three times Chebyshev
polynomials of time. Weights are independent normals, so that it is a Gaussian process in a finite basis; they are
identified like an effect's parameters. Odd terms come first, since a storey does the same in both directions more often
than not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self, override

import numpy as np
import sympy as sp
from numpy.polynomial.chebyshev import chebval
from scipy.special import logsumexp, ndtri

from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.discovery.evidence import Evidence
from bwbn_bayes.discovery.score import Slopes
from bwbn_bayes.elements.law import (
    DRIFT,
    DRIFT_RATE,
    ENERGY,
    HYSTERETIC_DISPLACEMENT,
    AddedState,
    Effect,
    Slots,
    symbol,
)
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.inference.identifiability import PRIOR_PRECISION
from bwbn_bayes.inference.importance import laplace_log_evidence
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.parameters import Floats, Normal, Parameter, Value
from bwbn_bayes.structures.structure import Structure

_RELATIVE_SCALES = np.geomspace(1e-2, 6.0, 97)
"""Scales of the force over the standard deviation of their half-normal prior, over which it is integrated."""
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
WAVES = (*((0, k) for k in (1, 2, 3, 4)), *((1, k) for k in (1, 2)), *((2, k) for k in (1, 2, 3, 4)))
"""Which of drift, drift rate and hysteretic displacement a term is linear in, and the degree of its factor in time."""
_STATES = ((DRIFT, "u", "m"), (DRIFT_RATE, "v", "m/s"), (HYSTERETIC_DISPLACEMENT, "z", "m"), (ENERGY, "e", "J"))
_CLOCK = symbol("unnamed_clock")
_DURATION = Parameter(
    symbol="unnamed_duration", unit="s", neutral=1.0, lower=1e-9, description="length of the record", source=_SOURCE
)
_SCALES = tuple(
    Parameter(symbol=f"unnamed_{short}", unit=unit, neutral=1.0, description=f"largest {state.name}", source=_SOURCE)
    for state, short, unit in _STATES
)
_WEIGHTS = tuple(
    Parameter(
        symbol=f"unnamed_{number}", unit="N", neutral=0.0, description="weight of an unnamed force", source=_SOURCE
    )
    for number in range(1, len(POWERS) + len(WAVES) + 1)
)


@dataclass(frozen=True, kw_only=True)
class UnnamedForce(Effect):
    """``F + sum_j w_j (u / u_0)^a (v / v_0)^b (z / z_0)^c (epsilon / epsilon_0)^d``, with :data:`POWERS`.

    And ``w_j y T_k(2 t / T - 1)``, y one of the first three ratios and T_k of Chebyshev: :data:`WAVES`.

    Parameters
    ----------
    weights : tuple of float or Prior
        [N]
    sizes : tuple of float
        Largest drift [m], drift rate [m/s], hysteretic displacement [m] and work [J].
    duration : float
        Of the record. [s]
    """

    weights: tuple[Value, ...] = field(default=(0.0,) * len(_WEIGHTS))
    sizes: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    duration: float = 1.0

    name: ClassVar[str] = "unnamed_force"
    summary: ClassVar[str] = "a smooth force of the storey's states that no catalogued law is"
    source: ClassVar[str] = _SOURCE
    residual: ClassVar[str] = "whatever a smooth force of the states leaves"
    confusable: ClassVar[str] = "every effect that is smooth"
    parameters: ClassVar[tuple[Parameter, ...]] = (*_WEIGHTS, *_SCALES, _DURATION)

    @property
    @override
    def values(self) -> Mapping[str, Value]:
        return dict(zip((p.symbol for p in self.parameters), (*self.weights, *self.sizes, self.duration), strict=True))

    @classmethod
    def of(cls, scales: Scales, share: float) -> Self:
        """With priors whose sum is a share of the largest storey force."""
        weight = Normal(0.0, share * scales.force)
        sizes = (scales.drift, scales.drift_rate, scales.hysteretic_displacement, scales.energy)
        return cls(weights=(weight,) * len(_WEIGHTS), sizes=sizes, duration=scales.duration)

    @override
    def start_grid(self, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {parameter.symbol: (0.0,) for parameter in _WEIGHTS}

    @override
    def fill(self, slots: Slots) -> Slots:
        ratios = [state / symbol(scale.symbol) for (state, _, _), scale in zip(_STATES, _SCALES, strict=True)]
        smooth = [sp.Mul(*(ratio**power for ratio, power in zip(ratios, powers, strict=True))) for powers in POWERS]
        waves = [ratios[state] * sp.chebyshevt(k, 2 * _CLOCK - 1) for state, k in WAVES]
        terms = (symbol(weight.symbol) * term for weight, term in zip(_WEIGHTS, (*smooth, *waves), strict=True))
        clock = AddedState(state=_CLOCK, rate=1 / symbol(_DURATION.symbol))
        return replace(slots, added_force=slots.added_force + sp.Add(*terms), added_states=(*slots.added_states, clock))


def unnamed_hypothesis(base: Structure, storey: int, scales: Scales, share: float) -> Hypothesis:
    """A model with an unnamed force at one storey, its scale a share of the largest force there."""
    return Hypothesis(base=base, effect=UnnamedForce.of(scales, share), storeys=(storey,), scales=scales)


def with_scale_integrated(evidence: Evidence, hypothesis: Hypothesis) -> Evidence:
    """The evidence of a fitted unnamed force, its scale integrated out: half-normal of the share it was fitted with.

    Under one scale for good a law that only makes a term of the force larger would be worth what the scale forbids.
    About the optimum the likelihood is taken for normal in the weights, the other parameters projected out, so that the
    evidence of every scale is known at once.

    Parameters
    ----------
    evidence : Evidence
        At an optimum of the likelihood, weights included.
    hypothesis : Hypothesis
        The unnamed force.
    """
    posterior, mode = evidence.posterior, evidence.modes[0]
    columns = np.isin(posterior.space.names, hypothesis.amplitudes)
    weights = ndtri(mode.point[columns])
    slope = np.ones(posterior.n_dim)
    slope[columns] = np.exp(-0.5 * np.square(weights)) / np.sqrt(2.0 * np.pi)
    information = mode.information * np.outer(slope, slope)
    others, between = information[~columns][:, ~columns], information[~columns][:, columns]
    projected = between.T @ np.linalg.solve(others + PRIOR_PRECISION * np.eye(len(others)), between)
    known, turned = np.linalg.eigh(information[columns][:, columns] - projected)
    known = np.maximum(known, 0.0)
    at_neutral = -0.5 * float(known @ np.square(weights @ turned))
    gain = at_neutral + _gain_over_scales(known, known * (weights @ turned))
    log_evidence = laplace_log_evidence([replace(mode, information=others)]) + gain
    return replace(evidence, log_evidence=log_evidence - posterior.space.log_admissible_mass)


def _gain_over_scales(information: Floats, gradient: Floats) -> float:
    """Log Bayes factor of independent weights over none, their scale integrated out, in nat.

    Parameters
    ----------
    information, gradient : (n,) array
        Of the log likelihood at neutral, along directions without products; a weight of one is the prior's
        standard deviation of the scale.
    """
    variance = np.square(_RELATIVE_SCALES)[:, None]
    spread = 1.0 + variance * information
    value = 0.5 * np.sum(variance * np.square(gradient) / spread - np.log(spread), axis=1)
    half_normal = np.sqrt(2.0 / np.pi) * np.exp(-0.5 * np.square(_RELATIVE_SCALES))
    return float(logsumexp(value, b=half_normal * np.gradient(_RELATIVE_SCALES)))


def first_order_gain(posterior: Posterior, hypothesis: Hypothesis, point: Floats) -> float:
    """Log Bayes factor of an unnamed force, its scale integrated out, to first order in its weights, in nat.

    To be believed where what a fit leaves is small.

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
    known, turned = np.linalg.eigh(information)
    return _gain_over_scales(np.maximum(known, 0.0), gradient @ turned)


def force_of(parameters: Mapping[str, float], histories: Mapping[str, Floats]) -> Floats:
    """The unnamed force ``(n_times,)`` [N] of a storey's parameters, by symbol, and histories, by kind."""
    kinds = ("drift", "drift_rate", "hysteretic_displacement", "hysteretic_energy")
    ratios = [histories[kind] / parameters[scale.symbol] for kind, scale in zip(kinds, _SCALES, strict=True)]
    smooth = [np.prod([ratio**power for ratio, power in zip(ratios, powers, strict=True)], axis=0) for powers in POWERS]
    clock = np.linspace(-1.0, 1.0, len(ratios[0]))  # a record is uniform in time
    waves = [ratios[state] * chebval(clock, [0.0] * k + [1.0]) for state, k in WAVES]
    terms = (parameters[weight.symbol] * term for weight, term in zip(_WEIGHTS, (*smooth, *waves), strict=True))
    return np.asarray(sum(terms))
