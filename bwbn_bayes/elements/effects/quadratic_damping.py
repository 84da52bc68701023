"""A damper beside the storey whose force grows with the square of the drift rate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self, override

import numpy as np
import sympy as sp

from bwbn_bayes.elements.law import DRIFT_RATE, Effect, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import Floats, HalfNormal, Parameter, Value


@dataclass(frozen=True, kw_only=True)
class QuadraticDamping(Effect):
    """The force ``c2 v |v|``, as of an orifice or of drag.

    Parameters
    ----------
    c2 : float, Prior or PerStorey
        Quadratic damping. [N s^2/m^2]

    References
    ----------
    .. [1] T. T. Soong and M. C. Constantinou (eds.), "Passive and Active Structural Vibration Control in Civil
       Engineering", Springer, 1994 (orifice dampers, ``C |v|^a sgn v``; here a = 2). Book cited from memory, not
       consulted.
    """

    c2: Value

    name: ClassVar[str] = "quadratic_damping"
    summary: ClassVar[str] = "a damper that grows with the square of the drift rate"
    source: ClassVar[str] = "Soong and Constantinou 1994"
    residual: ClassVar[str] = "a third harmonic in phase with the drift rate"
    confusable: ClassVar[str] = "c and coulomb_friction at one amplitude"
    signature: ClassVar[Signature] = Signature(
        measure="damping ratio added at the first mode",
        plain_name="the shape of the force over drift rate (a quadratic law)",
        reason="a thousandth of critical damping: no building's own is known better",
        size=lambda at: at.damping_ratio(_equivalent(at["c2"], at.histories["drift_rate"])),
        least=0.001,
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            symbol="c2", unit="N s^2/m^2", neutral=0.0, lower=0.0, description="quadratic damping", source=source
        ),
    )

    @classmethod
    @override
    def default_prior(cls, scales: Scales) -> tuple[Self, ...]:
        return (cls(c2=HalfNormal(0.5 * scales.force / scales.drift_rate**2)),)

    @override
    def start_grid(self, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {"c2": tuple(share * scales.force / scales.drift_rate**2 for share in (0.03, 0.2))}

    @override
    def fill(self, slots: Slots) -> Slots:
        return replace(slots, added_force=slots.added_force + symbol("c2") * DRIFT_RATE * sp.Abs(DRIFT_RATE))


def _equivalent(c2: float, rate: Floats) -> float:
    """Viscous coefficient [N s/m] that dissipates as much along a history ``(n_times,)`` of the drift rate [m/s]."""
    return float(c2 * np.sum(np.abs(rate) ** 3) / max(float(np.sum(np.square(rate))), 1e-300))
