"""The scale of the hysteretic displacement: z may be measured in any unit of its own, and no force tells which.

With ``z' = s z`` and ``A' = s A``, a storey answers as before if ``alpha k`` and ``(1 - alpha) k / s`` take the places
of the two springs, and every other parameter is multiplied by a power of s: beta and gamma by ``s^(1 - n)``, the width
of a slip by s. The powers are found from the law itself, so that an effect need not declare them.

References
----------
.. [1] F. Ma et al., "Parameter Analysis of the Differential Model of Hysteresis", J. Appl. Mech. 71(3), 2004
   (A is redundant).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import sympy as sp

from bwbn_bayes.elements.law import BENDING_DRIFT, DRIFT, DRIFT_RATE, HYSTERETIC_DISPLACEMENT, StoreyLaw
from bwbn_bayes.parameters import Floats

_SPRINGS = ("k", "alpha", "A")
_N_POINTS = 400
_STEP = 1e-5
_AGREE = 1e-8
_FACTOR = 1.7
"""Scale under which a law must answer as before, once its powers are known."""


class Power(NamedTuple):
    """The power of s, ``constant + of_n * n``, by which a parameter follows the scale of z."""

    constant: int
    of_n: int


def springs_at(alpha: Floats, scale: Floats) -> tuple[Floats, Floats]:
    """``alpha`` and the factor on ``k`` once z is measured in a unit so many times smaller."""
    factor = alpha + (1.0 - alpha) / scale
    return alpha / factor, factor


@lru_cache(maxsize=128)
def powers_of_scale(law: StoreyLaw) -> Mapping[str, Power] | None:
    """How each parameter but k, alpha and A follows the scale of z; None where no change of them undoes it.

    The law is homogeneous of some degree in each parameter (Euler): the degrees solve linear equations at random
    states. They are rounded to whole numbers and tried on a finite change of scale.
    """
    probe = _Probe.of(law)
    others = [name for name in probe.names if name not in _SPRINGS]
    n_states = law.n_storey_states - 1
    slopes = {name: probe.slope([name]) for name in others}
    n = probe.values["n"]
    columns = [slope * power for slope in slopes.values() for power in (np.ones_like(n), n)]
    outputs = probe.outputs()
    for i, state in enumerate(law.states[1 : law.n_storey_states]):
        own = probe.slope([state.name])
        own[2 + i] -= outputs[2 + i]
        columns.append(own)
    known = probe.along_springs()
    known[1] -= outputs[1]
    matrix = np.stack([column.ravel() for column in columns], axis=1)
    if not np.all(np.isfinite(matrix)):
        return None
    size = np.sqrt(np.sum(np.square(matrix), axis=0))
    solution = np.linalg.lstsq(matrix / np.where(size > 0.0, size, 1.0), -known.ravel(), rcond=1e-9)[0]
    whole = np.rint(solution / np.where(size > 0.0, size, 1.0)).astype(np.int64)
    degrees = whole[: len(whole) - n_states].reshape(-1, 2)
    powers = {name: Power(*map(int, pair)) for name, pair in zip(others, degrees, strict=True)}
    weights = (1, *whole[len(whole) - n_states :].tolist())
    return (
        {name: power for name, power in powers.items() if power != (0, 0)} if probe.answers(powers, weights) else None
    )


class _Probe(NamedTuple):
    """A law's force and rates at random states and parameters, ``(n_points,)`` each, by name."""

    law: StoreyLaw
    names: tuple[str, ...]
    values: dict[str, Floats]
    function: Callable[..., list[Floats]]

    @classmethod
    def of(cls, law: StoreyLaw) -> _Probe:
        rng = np.random.default_rng(1904)
        values = {s.name: rng.uniform(0.3, 0.9, _N_POINTS) for s in _inputs(law)}
        for parameter in law.parameters:
            moved = values[parameter.symbol] + max(0.0, parameter.lower if np.isfinite(parameter.lower) else 0.0)
            values[parameter.symbol] = np.clip(moved, parameter.lower, parameter.upper)
        for state in (DRIFT, DRIFT_RATE, HYSTERETIC_DISPLACEMENT):
            values[state.name] *= rng.choice([-1.0, 1.0], _N_POINTS)
        expressions = [law.force, *law.rates[: law.n_storey_states]]
        function = sp.lambdify(_inputs(law), expressions, ["scipy", "numpy"], cse=True)
        return cls(law, tuple(parameter.symbol for parameter in law.parameters), values, function)

    def outputs(self, values: Mapping[str, Floats] | None = None) -> Floats:
        """Force, then rates of the storey's states, ``(n_outputs, n_points)``."""
        values = self.values if values is None else values
        results = self.function(*(values[s.name] for s in _inputs(self.law)))
        with np.errstate(all="ignore"):
            return np.stack([np.broadcast_to(np.asarray(one, dtype=np.float64), _N_POINTS) for one in results])

    def slope(self, names: list[str]) -> Floats:
        """Derivative of the outputs with respect to the logarithm of these inputs together."""
        ends = [
            self.outputs({name: v * (np.exp(h) if name in names else 1.0) for name, v in self.values.items()})
            for h in (_STEP, -_STEP)
        ]
        return (ends[0] - ends[1]) / (2.0 * _STEP)

    def along_springs(self) -> Floats:
        """Derivative of the outputs as z, A and the two springs follow the logarithm of the scale."""
        ends = [self.outputs(self._scaled(np.exp(h))) for h in (_STEP, -_STEP)]
        return (ends[0] - ends[1]) / (2.0 * _STEP)

    def _scaled(self, scale: float) -> dict[str, Floats]:
        values = dict(self.values)
        values["alpha"], factor = springs_at(values["alpha"], np.full(_N_POINTS, scale))
        values["k"] = values["k"] * factor
        for name in ("A", HYSTERETIC_DISPLACEMENT.name):
            values[name] = values[name] * scale
        return values

    def answers(self, powers: Mapping[str, Power], weights: tuple[int, ...]) -> bool:
        """Whether the law answers a finite change of scale as it should, its admissibility conditions included."""
        values = self._scaled(_FACTOR)
        for name, power in powers.items():
            values[name] = values[name] * _FACTOR ** (power.constant + power.of_n * self.values["n"])
        for state, weight in zip(self.law.states[1 : self.law.n_storey_states], weights[1:], strict=True):
            values[state.name] = values[state.name] * _FACTOR**weight
        expected = self.outputs() * _FACTOR ** np.array([[0], *([w] for w in weights)], dtype=np.float64)
        same = np.allclose(self.outputs(values), expected, rtol=_AGREE, atol=0.0)
        conditions = sp.lambdify(self.law.symbols, list(self.law.constraints), ["scipy", "numpy"])
        before, after = (
            [np.broadcast_to(one, _N_POINTS) for one in conditions(*(v[s.name] for s in self.law.symbols))]
            for v in (self.values, values)
        )
        return bool(same and all(np.array_equal(a, b) for a, b in zip(before, after, strict=True)))


def _inputs(law: StoreyLaw) -> tuple[sp.Symbol, ...]:
    indicators = tuple(event.indicator for event in law.events)
    bending = (BENDING_DRIFT,) if law.bends else ()
    return (DRIFT, DRIFT_RATE, *law.states[: law.n_storey_states], *law.symbols, *indicators, *bending)
