"""A spring beside the storey whose force grows with the cube of the drift."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self, override

from bwbn_bayes.elements.law import DRIFT, Effect, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import Normal, Parameter, Value


@dataclass(frozen=True, kw_only=True)
class CubicStiffness(Effect):
    """The force ``k3 u^3``: hardening where ``k3 > 0``, softening where ``k3 < 0``.

    Parameters
    ----------
    k3 : float, Prior or PerStorey
        Cubic stiffness. [N/m^3]

    References
    ----------
    .. [1] G. Duffing, "Erzwungene Schwingungen bei veränderlicher Eigenfrequenz", Vieweg, 1918 (the cubic spring).
    """

    k3: Value

    name: ClassVar[str] = "cubic_stiffness"
    summary: ClassVar[str] = "a spring that hardens or softens with drift"
    source: ClassVar[str] = "Duffing 1918"
    residual: ClassVar[str] = "a third harmonic in phase with the drift"
    confusable: ClassVar[str] = "gap_impact, n"
    signature: ClassVar[Signature] = Signature(
        measure="stiffening at the largest drift",
        plain_name="the curvature of the force over drift (Duffing's law)",
        reason="half a per cent of the storey's stiffness at the largest drift: less is within what any test repeats",
        size=lambda at: at["k3"] * at.peak("drift") ** 2 / at.scales.stiffness,
        least=0.005,
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(symbol="k3", unit="N/m^3", neutral=0.0, description="cubic stiffness", source=source),
    )

    @classmethod
    @override
    def default_prior(cls, scales: Scales) -> tuple[Self, ...]:
        return (cls(k3=Normal(0.0, 0.5 * scales.force / scales.drift**3)),)

    @override
    def start_grid(self, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        start = 0.1 * scales.force / scales.drift**3
        return {"k3": (-start, start)}

    @override
    def fill(self, slots: Slots) -> Slots:
        return replace(slots, added_force=slots.added_force + symbol("k3") * DRIFT**3)
