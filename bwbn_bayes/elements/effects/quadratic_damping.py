"""A damper beside the storey whose force grows with the square of the drift rate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

import sympy as sp

from bwbn_bayes.elements.damping import SOURCE, added_damping, equivalent, of_power, power_parameters
from bwbn_bayes.elements.law import DRIFT_RATE, Effect, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import HalfNormal, LogNormal, Parameter, Value


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
    source: ClassVar[str] = SOURCE
    residual: ClassVar[str] = "a third harmonic in phase with the drift rate"
    confusable: ClassVar[str] = "c and coulomb_friction at one amplitude"
    signature: ClassVar[Signature] = added_damping(
        "a quadratic law", lambda at: at.damping_ratio(at["c2"] * equivalent(at.histories["drift_rate"], 2.0))
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            symbol="c2", unit="N s^2/m^2", neutral=0.0, lower=0.0, description="quadratic damping", source=source
        ),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        return replace(slots, added_force=slots.added_force + symbol("c2") * DRIFT_RATE * sp.Abs(DRIFT_RATE))


@guides(QuadraticDamping)
class QuadraticDampingSearch(SearchGuide[QuadraticDamping]):
    """How a search looks for quadratic damping."""

    @override
    def priors(self, scales: Scales) -> tuple[QuadraticDamping, ...]:
        return (QuadraticDamping(c2=HalfNormal(0.5 * scales.force / scales.drift_rate**2)),)

    @override
    def starts(self, effect: QuadraticDamping, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {"c2": tuple(share * scales.force / scales.drift_rate**2 for share in (0.03, 0.2))}

    @override
    def free_shapes(self, scales: Scales) -> tuple[Effect, ...]:
        return PowerDamperSearch().priors(scales)


@dataclass(frozen=True, kw_only=True)
class PowerDamper(Effect):
    """Quadratic damping in a free shape: ``F_q (|v|/v_q)^(p_q - 1) v/v_q``; with power two ``c2 = F_q/v_q^2``.

    Parameters
    ----------
    F_q : float, Prior or PerStorey
        Force at the drift rate ``v_q``. [N]
    p_q : float, Prior or PerStorey
        Power of the drift rate.
    v_q : float
        Drift rate at which the force is measured. [m/s]

    References
    ----------
    .. [1] T. T. Soong and M. C. Constantinou (eds.) 1994 (orifice dampers, ``C |v|^a sgn v``).
    """

    F_q: Value
    p_q: Value
    v_q: Value

    name: ClassVar[str] = QuadraticDamping.name
    summary: ClassVar[str] = QuadraticDamping.summary
    source: ClassVar[str] = QuadraticDamping.source
    residual: ClassVar[str] = QuadraticDamping.residual
    confusable: ClassVar[str] = QuadraticDamping.confusable
    form: ClassVar[str] = "free shape"
    signature: ClassVar[Signature] = added_damping("a quadratic law", of_power("F_q", "p_q", "v_q"))
    parameters: ClassVar[tuple[Parameter, ...]] = power_parameters("F_q", "p_q", "v_q", neutral=2.0, lower=1.0)

    @override
    def fill(self, slots: Slots) -> Slots:
        force, power, largest = (symbol(s) for s in ("F_q", "p_q", "v_q"))
        bent = (sp.Abs(DRIFT_RATE) / largest) ** (power - 1) * DRIFT_RATE / largest
        return replace(slots, added_force=slots.added_force + force * bent)


@guides(PowerDamper)
class PowerDamperSearch(SearchGuide[PowerDamper]):
    """How a search looks for another power of the drift rate."""

    @override
    def priors(self, scales: Scales) -> tuple[PowerDamper, ...]:
        power = LogNormal(2.0, 0.35).truncated(1.2, 4.0)
        return (PowerDamper(F_q=HalfNormal(0.5 * scales.force), p_q=power, v_q=scales.drift_rate),)

    @override
    def starts(self, effect: PowerDamper, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {"F_q": (0.03 * scales.force, 0.2 * scales.force), "p_q": (1.5, 2.0, 3.0)}
