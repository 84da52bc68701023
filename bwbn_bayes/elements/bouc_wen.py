"""The Bouc-Wen storey: the seven parameters every storey has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import sympy as sp

from bwbn_bayes.elements.law import symbol
from bwbn_bayes.parameters import Parameter, Value

_WEN = "Wen 1976; Ismail et al. 2009, doi:10.1007/s11831-009-9031-8"


@dataclass(frozen=True, kw_only=True)
class BoucWen:
    """Bouc-Wen storey: ``F = alpha k u + (1 - alpha) k z + c v``, ``dz/dt = (A - |z|^n (beta sgn(z v) + gamma)) v``.

    Parameters
    ----------
    k : float, Prior or PerStorey
        Initial stiffness. [N/m]
    c : float, Prior or PerStorey
        Viscous damping coefficient. [N s/m]
    alpha : float, Prior or PerStorey
        Ratio of post-yield to initial stiffness.
    A : float, Prior or PerStorey
        Initial rate of the hysteretic displacement; redundant with the scale of z, so 1 unless a comparison asks
        otherwise (Ma et al., J. Appl. Mech. 71(3), 2004).
    beta, gamma : float, Prior or PerStorey
        Shape of the loop; ``beta + gamma > 0`` bounds the hysteretic displacement. [1/m^n]
    n : float, Prior or PerStorey
        Sharpness of yield.

    References
    ----------
    .. [1] Y.-K. Wen, "Method for Random Vibration of Hysteretic Systems", J. Eng. Mech. Div. 102(2), 1976.
    .. [2] M. Ismail et al., "The Hysteresis Bouc-Wen Model, a Survey", 2009, doi:10.1007/s11831-009-9031-8.
    """

    k: Value
    c: Value = 0.0
    alpha: Value = 0.0
    A: Value = 1.0
    beta: Value
    gamma: Value
    n: Value = 1.0

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(symbol="k", unit="N/m", neutral=0.0, lower=0.0, description="initial stiffness", source=_WEN),
        Parameter(symbol="c", unit="N s/m", neutral=0.0, lower=0.0, description="viscous damping", source=_WEN),
        Parameter(
            symbol="alpha",
            unit="",
            neutral=0.0,
            lower=-1.0,
            upper=1.0,
            description="post-yield to initial stiffness",
            source=_WEN,
        ),
        Parameter(symbol="A", unit="", neutral=1.0, lower=1e-6, description="initial rate of z", source=_WEN),
        Parameter(symbol="beta", unit="1/m^n", neutral=0.0, description="loop shape", source=_WEN),
        Parameter(symbol="gamma", unit="1/m^n", neutral=0.0, description="loop shape", source=_WEN),
        Parameter(symbol="n", unit="", neutral=1.0, lower=1.0, description="sharpness of yield", source=_WEN),
    )
    constraints: ClassVar[tuple[sp.Basic, ...]] = (symbol("beta") + symbol("gamma") >= 0,)

    @property
    def values(self) -> Mapping[str, Value]:
        """The value (number, prior or PerStorey) of each parameter, by symbol."""
        return {parameter.symbol: getattr(self, parameter.symbol) for parameter in self.parameters}
