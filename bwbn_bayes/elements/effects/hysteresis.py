"""A Bouc-Wen spring in the place of a linear one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

import numpy as np
import sympy as sp

from bwbn_bayes.elements.law import Effect, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import HalfNormal, LogNormal, Parameter, Uniform, Value


@dataclass(frozen=True, kw_only=True)
class Hysteresis(Effect):
    """A share ``r_h`` of a linear spring yields: ``alpha = 1 - r_h``, ``beta = beta_h / x_h^n_h`` and so on.

    The link becomes a Bouc-Wen link, on which effects of degradation and pinching can act. A loop with
    ``beta_h + gamma_h < 0`` hardens; nothing then bounds its hysteretic displacement.

    Parameters
    ----------
    r_h : float, Prior or PerStorey
        Share of the initial stiffness that the hysteretic spring has, ``1 - alpha``.
    beta_h, gamma_h : float, Prior or PerStorey
        Shape of the loop, ``beta x_h^n`` and ``gamma x_h^n``.
    n_h : float, Prior or PerStorey
        Sharpness of yield.
    x_h : float
        The drift that the shape is measured at, known. [m]

    References
    ----------
    .. [1] Y.-K. Wen, "Method for Random Vibration of Hysteretic Systems", J. Eng. Mech. Div. 102(2), 1976.
    """

    r_h: Value
    beta_h: Value
    gamma_h: Value
    n_h: Value
    x_h: Value

    elements: ClassVar[tuple[str, ...]] = ("linear",)
    makes: ClassVar[str] = "hardening_bouc_wen"
    name: ClassVar[str] = "hysteresis"
    title: ClassVar[str] = "hysteresis (a Bouc-Wen spring)"
    summary: ClassVar[str] = "part of a linear spring yields: the force depends on the way to a drift"
    source: ClassVar[str] = "Wen 1976"
    residual: ClassVar[str] = "loops whose width does not depend on the rate"
    confusable: ClassVar[str] = "coulomb_friction, c, cubic_stiffness"
    signature: ClassVar[Signature] = Signature(
        measure="damping ratio that the loop is worth at the largest drift",
        plain_name="a small share of the stiffness that yields (Bouc and Wen's law)",
        reason="a thousandth of critical damping: no structure's own is known better",
        size=lambda at: _equivalent_damping(
            at["r_h"], at["beta_h"] * (at.peak("drift") / at["x_h"]) ** at["n_h"], at["n_h"]
        ),
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
        Parameter(symbol="x_h", unit="m", neutral=1.0, lower=1e-12, description="that drift, known", source=source),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        share, n, drift = symbol("r_h"), symbol("n_h"), symbol("x_h")
        shape = {name: symbol(f"{name}_h") * drift**-n for name in ("beta", "gamma")}
        added = {"alpha": -share, **shape, "n": n - 1}
        increments = dict(slots.increments)
        for name, change in added.items():
            base = symbol(name)
            increments[base] = increments.get(base, sp.Integer(0)) + change
        return replace(slots, increments=increments)


@guides(Hysteresis)
class HysteresisSearch(SearchGuide[Hysteresis]):
    """How a search looks for a spring that yields."""

    @override
    def priors(self, scales: Scales) -> tuple[Hysteresis, ...]:
        return (
            Hysteresis(
                r_h=HalfNormal(0.5).truncated(0.0, 1.0),
                # What opens no loop at the largest drift is an elastic spring that bends, by gamma alone.
                beta_h=LogNormal(1.0, 1.0).truncated(0.01, 20.0),
                gamma_h=Uniform(-5.0, 5.0),
                n_h=LogNormal(1.3, 0.3).truncated(1.0, 4.0),
                x_h=scales.drift,
            ),
        )

    @override
    def starts(self, effect: Hysteresis, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {"r_h": (0.3, 0.8), "beta_h": (0.5, 2.0), "gamma_h": (-1.0, 0.5), "n_h": (1.2,)}


def _equivalent_damping(share: float, bend: float, n: float) -> float:
    """Energy that a cycle loses over 4 pi times that of the spring, ``bend`` being ``beta U^n`` at the amplitude U.

    To first order the loop encloses ``4 k r_h beta U^(n + 2) / (n + 2)``; where it yields, at most ``4 k r_h U^2``.
    """
    return 2.0 / np.pi * share * bend / (n + 2.0 + abs(bend))
