"""A spring beside the storey whose force grows with the cube of the drift."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

import sympy as sp

from bwbn_bayes.elements.law import DRIFT, Effect, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import LogNormal, Normal, Parameter, Value


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
        reason="half a per cent of the stiffness at the largest drift: less is within what any test repeats",
        size=lambda at: at["k3"] * at.peak("drift") ** 2 / at.scales.stiffness,
        least=0.005,
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(symbol="k3", unit="N/m^3", neutral=0.0, description="cubic stiffness", source=source),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        return replace(slots, added_force=slots.added_force + symbol("k3") * DRIFT**3)


@guides(CubicStiffness)
class CubicStiffnessSearch(SearchGuide[CubicStiffness]):
    """How a search looks for cubic stiffness."""

    @override
    def priors(self, scales: Scales) -> tuple[CubicStiffness, ...]:
        return (CubicStiffness(k3=Normal(0.0, 0.5 * scales.force / scales.drift**3)),)

    @override
    def starts(self, effect: CubicStiffness, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        start = 0.1 * scales.force / scales.drift**3
        return {"k3": (-start, start)}

    @override
    def free_shapes(self, scales: Scales) -> tuple[Effect, ...]:
        return PowerSpringSearch().priors(scales)


@dataclass(frozen=True, kw_only=True)
class PowerSpring(Effect):
    """Cubic stiffness in a free shape: ``F_h (|u|/u_h)^(p_h - 1) u/u_h``; with power three ``k3 = F_h/u_h^3``.

    Parameters
    ----------
    F_h : float, Prior or PerStorey
        Force at the drift ``u_h``. [N]
    p_h : float, Prior or PerStorey
        Power of the drift.
    u_h : float
        Drift at which the force is measured. [m]

    References
    ----------
    .. [1] G. Duffing 1918 (power three); another power is our generalisation.
    """

    F_h: Value
    p_h: Value
    u_h: Value

    name: ClassVar[str] = CubicStiffness.name
    summary: ClassVar[str] = CubicStiffness.summary
    source: ClassVar[str] = CubicStiffness.source
    residual: ClassVar[str] = CubicStiffness.residual
    confusable: ClassVar[str] = CubicStiffness.confusable
    form: ClassVar[str] = "free shape"
    signature: ClassVar[Signature] = replace(
        CubicStiffness.signature,
        size=lambda at: (
            at["F_h"] * (at.peak("drift") / at["u_h"]) ** at["p_h"] / at.peak("drift") / at.scales.stiffness
        ),
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(symbol="F_h", unit="N", neutral=0.0, description="spring's force at a known drift", source=source),
        Parameter(symbol="p_h", unit="", neutral=3.0, lower=1.0, description="power of the drift", source=source),
        Parameter(symbol="u_h", unit="m", neutral=1.0, lower=1e-12, description="that drift, known", source=source),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        force, power, largest = (symbol(s) for s in ("F_h", "p_h", "u_h"))
        bent = (sp.Abs(DRIFT) / largest) ** (power - 1) * DRIFT / largest
        return replace(slots, added_force=slots.added_force + force * bent)


@guides(PowerSpring)
class PowerSpringSearch(SearchGuide[PowerSpring]):
    """How a search looks for another power of the drift."""

    @override
    def priors(self, scales: Scales) -> tuple[PowerSpring, ...]:
        power = LogNormal(3.0, 0.4).truncated(1.3, 6.0)
        return (PowerSpring(F_h=Normal(0.0, 0.5 * scales.force), p_h=power, u_h=scales.drift),)

    @override
    def starts(self, effect: PowerSpring, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {"F_h": (-0.1 * scales.force, 0.1 * scales.force), "p_h": (2.0, 3.0, 4.5)}
