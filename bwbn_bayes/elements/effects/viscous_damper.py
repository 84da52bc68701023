"""A damper beside the storey whose force grows more slowly than the drift rate, as those built into buildings do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

import sympy as sp

from bwbn_bayes.elements.damping import SOURCE, added_damping, of_power, power_parameters
from bwbn_bayes.elements.law import DRIFT_RATE, Effect, SharpFeature, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import HalfNormal, LogNormal, Parameter, Value

_TURN = 500
"""Times smaller than ``v_v`` is the rate below which the force is linear: the power's slope at zero has no end."""
_STEEP = 50
"""Times smaller than ``v_v`` is the rate below which it is steep: ten times that at which it becomes linear."""


@dataclass(frozen=True, kw_only=True)
class ViscousDamper(Effect):
    """The force ``F_v sgn v (|v|/v_v)^p_v`` with a power below one; ``C = F_v/v_v^p_v``.

    Where it is steep, ``|v|/v_v`` is the root of its square and that of 1/500.

    Parameters
    ----------
    F_v : float, Prior or PerStorey
        Force at the drift rate ``v_v``. [N]
    p_v : float, Prior or PerStorey
        Power of the drift rate.
    v_v : float
        Drift rate at which the force is measured. [m/s]

    References
    ----------
    .. [1] T. T. Soong and M. C. Constantinou (eds.), "Passive and Active Structural Vibration Control in Civil
       Engineering", Springer, 1994 (fluid dampers, ``C |v|^a sgn v``). Book cited from memory, not consulted.
    """

    F_v: Value
    p_v: Value
    v_v: Value

    name: ClassVar[str] = "viscous_damper"
    title: ClassVar[str] = "nonlinear viscous damper"
    summary: ClassVar[str] = "a damper whose force grows with a power of the drift rate below one"
    source: ClassVar[str] = SOURCE
    residual: ClassVar[str] = "a force in phase with the drift rate, flatter than its sine"
    confusable: ClassVar[str] = "c and coulomb_friction"
    signature: ClassVar[Signature] = added_damping("a power law", of_power("F_v", "p_v", "v_v"))
    parameters: ClassVar[tuple[Parameter, ...]] = power_parameters("F_v", "p_v", "v_v", neutral=1.0, lower=0.1)

    @override
    def fill(self, slots: Slots) -> Slots:
        force, power, largest = (symbol(s) for s in ("F_v", "p_v", "v_v"))
        share = DRIFT_RATE / largest
        bent = share * (share**2 + sp.Rational(1, _TURN**2)) ** ((power - 1) / 2)
        return replace(
            slots,
            added_force=slots.added_force + force * bent,
            sharp_features=(*slots.sharp_features, SharpFeature(state=DRIFT_RATE, width=largest / _STEEP)),
        )


@guides(ViscousDamper)
class ViscousDamperSearch(SearchGuide[ViscousDamper]):
    """How a search looks for a nonlinear viscous damper."""

    @override
    def priors(self, scales: Scales) -> tuple[ViscousDamper, ...]:
        # With less than a quarter it is dry friction; with more than .85 hardly another than the storey's own damping.
        power = LogNormal(0.5, 0.35).truncated(0.25, 0.85)
        return (ViscousDamper(F_v=HalfNormal(0.5 * scales.force), p_v=power, v_v=scales.drift_rate),)

    @override
    def starts(self, effect: ViscousDamper, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {"F_v": (0.03 * scales.force, 0.2 * scales.force), "p_v": (0.35, 0.7)}
