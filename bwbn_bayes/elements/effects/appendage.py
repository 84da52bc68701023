"""A light tuned mass on a floor: a tank, a machine on springs, a parapet."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

import numpy as np
import sympy as sp

from bwbn_bayes.elements.law import FLOOR_ACCELERATION, MASS, AddedState, Definition, Effect, Slots, step, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import HalfNormal, Parameter, Uniform, Value

DISPLACEMENT, VELOCITY = sp.symbols("y_t v_t", real=True)
"""Of the mass relative to its floor. [m], [m/s]"""


@dataclass(frozen=True, kw_only=True)
class Appendage(Effect):
    """A linear oscillator of mass ``mu_t m_i`` on floor i: ``y'' = -2 zeta w y' - w^2 y - a_i``, ``w = 2 pi f_t``.

    The floor feels ``mu_t m_i (2 zeta w y' + w^2 y)``.

    Parameters
    ----------
    mu_t : float, Prior or PerStorey
        Its mass as a share of the floor's.
    f_t : float, Prior or PerStorey
        Its frequency on a fixed floor. [Hz]
    zeta_t : float, Prior or PerStorey
        Its damping ratio.

    References
    ----------
    .. [1] J. P. Den Hartog, "Mechanical Vibrations", 4th ed., 1956, section 3.2.
    """

    mu_t: Value
    f_t: Value
    zeta_t: Value

    name: ClassVar[str] = "appendage"
    title: ClassVar[str] = "tuned mass"
    level: ClassVar[str] = "node"
    summary: ClassVar[str] = "a light tuned mass on a floor"
    source: ClassVar[str] = "Den Hartog 1956, section 3.2"
    residual: ClassVar[str] = "a split peak, a ringing at one frequency"
    confusable: ClassVar[str] = "coloured noise"
    signature: ClassVar[Signature] = Signature(
        measure="detuning: separation of the peaks of mass and floor, tuned to each other",
        plain_name="a ringing at one frequency (a light oscillator)",
        reason="peaks two per cent apart: closer ones no record of a building's length resolves",
        # Den Hartog 1956, section 3.3: tuned frequencies 1 +- sqrt(mu) / 2 for a small share mu.
        size=lambda at: math.sqrt(at["mu_t"]),
        least=0.02,
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            symbol="mu_t", unit="", neutral=0.0, lower=0.0, description="mass as a share of the floor's", source=source
        ),
        Parameter(symbol="f_t", unit="Hz", neutral=1.0, lower=1e-3, description="its own frequency", source=source),
        Parameter(symbol="zeta_t", unit="", neutral=0.05, lower=0.0, description="its damping ratio", source=source),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        omega = step("omega_t")
        spring = 2 * symbol("zeta_t") * omega * VELOCITY + omega**2 * DISPLACEMENT
        states = (
            AddedState(state=DISPLACEMENT, rate=VELOCITY),
            AddedState(state=VELOCITY, rate=-spring - FLOOR_ACCELERATION),
        )
        frequency = Definition(
            caption="circular frequency of the mass on its floor", subject=omega, expression=2 * sp.pi * symbol("f_t")
        )
        return replace(
            slots,
            steps=(*slots.steps, frequency),
            floor_force=slots.floor_force + symbol("mu_t") * MASS * spring,
            floor_states=(*slots.floor_states, *states),
        )


@guides(Appendage)
class AppendageSearch(SearchGuide[Appendage]):
    """How a search looks for a tuned mass."""

    @override
    def priors(self, scales: Scales) -> tuple[Appendage, ...]:
        return (Appendage(mu_t=HalfNormal(0.05), f_t=Uniform(*_band(scales)), zeta_t=Uniform(0.005, 0.2)),)

    @override
    def starts(self, effect: Appendage, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        lowest, highest = _band(scales)
        frequencies = np.geomspace(1.1 * lowest, highest / 1.1, 20)
        return {"mu_t": (0.03,), "f_t": tuple(frequencies.tolist()), "zeta_t": (0.03,)}


def _band(scales: Scales) -> tuple[float, float]:
    """Frequencies [Hz] from well below the building's first to 12 Hz, three samples a period at least."""
    highest = min(12.0, 1.0 / (3.0 * scales.time_step))
    return min(0.5, 0.25 * highest, 0.4 / scales.period), highest
