"""A Bouc-Wen spring in the place of a linear one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self, override

import sympy as sp

from bwbn_bayes.elements.law import Effect, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import HalfNormal, LogNormal, Normal, Parameter, Value


@dataclass(frozen=True, kw_only=True)
class Hysteresis(Effect):
    """A share ``r_h`` of a linear spring yields: ``alpha = 1 - r_h``, ``beta = beta_h / u_h^n_h`` and so on.

    The link becomes a Bouc-Wen link, on which effects of degradation and pinching can act. A loop with
    ``beta_h + gamma_h < 0`` hardens; nothing then bounds its hysteretic displacement.

    Parameters
    ----------
    r_h : float, Prior or PerStorey
        Share of the initial stiffness that the hysteretic spring has, ``1 - alpha``.
    beta_h, gamma_h : float, Prior or PerStorey
        Shape of the loop, ``beta u_h^n`` and ``gamma u_h^n``.
    n_h : float, Prior or PerStorey
        Sharpness of yield.
    u_h : float
        The drift that the shape is measured at, known. [m]

    References
    ----------
    .. [1] Y.-K. Wen, "Method for Random Vibration of Hysteretic Systems", J. Eng. Mech. Div. 102(2), 1976.
    """

    r_h: Value
    beta_h: Value
    gamma_h: Value
    n_h: Value
    u_h: Value

    elements: ClassVar[tuple[str, ...]] = ("linear",)
    makes: ClassVar[str] = "bouc_wen"
    name: ClassVar[str] = "hysteresis"
    title: ClassVar[str] = "hysteresis (a Bouc-Wen spring)"
    summary: ClassVar[str] = "part of a linear spring yields: the force depends on the way to a drift"
    source: ClassVar[str] = "Wen 1976"
    residual: ClassVar[str] = "loops whose width does not depend on the rate"
    confusable: ClassVar[str] = "coulomb_friction, c, cubic_stiffness"
    signature: ClassVar[Signature] = Signature(
        measure="work of the hysteretic spring over that of the peak force along the whole way",
        plain_name="a small share of the stiffness that yields (Bouc and Wen's law)",
        reason="a thousandth: no structure's loop is narrower and still told from its viscous damping",
        size=lambda at: at.energy / (at.peak("restoring_force") * max(at.travel, 1e-300)),
        least=0.001,
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            symbol="r_h",
            unit="",
            neutral=0.0,
            lower=0.0,
            upper=2.0,
            description="share of the stiffness that yields",
            source=source,
        ),
        Parameter(symbol="beta_h", unit="", neutral=0.0, description="loop shape at a known drift", source=source),
        Parameter(symbol="gamma_h", unit="", neutral=0.0, description="loop shape at a known drift", source=source),
        Parameter(symbol="n_h", unit="", neutral=1.0, lower=1.0, description="sharpness of yield", source=source),
        Parameter(symbol="u_h", unit="m", neutral=1.0, lower=1e-12, description="that drift, known", source=source),
    )

    @classmethod
    @override
    def default_prior(cls, scales: Scales) -> tuple[Self, ...]:
        return (
            cls(
                r_h=HalfNormal(0.5).truncated(0.0, 1.0),
                beta_h=Normal(1.0, 2.0),
                gamma_h=Normal(0.0, 2.0),
                n_h=LogNormal(1.3, 0.3).truncated(1.0, 4.0),
                u_h=scales.drift,
            ),
        )

    @override
    def start_grid(self, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {"r_h": (0.3, 0.8), "beta_h": (0.5, 2.0), "gamma_h": (-1.0, 0.5), "n_h": (1.05, 1.8)}

    @override
    def fill(self, slots: Slots) -> Slots:
        share, n, drift = symbol("r_h"), symbol("n_h"), symbol("u_h")
        shape = {name: symbol(f"{name}_h") * drift**-n for name in ("beta", "gamma")}
        added = {"alpha": -share, **shape, "n": n - 1}
        increments = dict(slots.increments)
        for name, change in added.items():
            base = symbol(name)
            increments[base] = increments.get(base, sp.Integer(0)) + change
        return replace(slots, increments=increments)
