"""The Bouc-Wen storey: the seven parameters every storey has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import sympy as sp

from bwbn_bayes.elements.law import DRIFT, Addition, Definition, SharpFeature, Slots, off_zero, symbol
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Parameter, Value

_WEN = "Wen 1976; Ismail et al. 2009, doi:10.1007/s11831-009-9031-8"
_NORMALISED = "Ikhouane and Rodellar 2007; doi:10.1002/9780470513200"

SPRING_AND_DASHPOT = (
    Parameter(symbol="k", unit="N/m", neutral=0.0, lower=0.0, description="initial stiffness", source=_WEN),
    Parameter(symbol="c", unit="N s/m", neutral=0.0, lower=0.0, description="viscous damping", source=_WEN),
)
"""What every link has."""

_SPRINGS = (
    *SPRING_AND_DASHPOT,
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
)
_SHAPE = (
    Parameter(symbol="beta", unit="1/m^n", neutral=0.0, description="loop shape", source=_WEN),
    Parameter(symbol="gamma", unit="1/m^n", neutral=0.0, description="loop shape", source=_WEN),
)
_YIELD = (
    Parameter(symbol="u_y", unit="m", neutral=1.0, lower=1e-9, description="yield displacement", source=_NORMALISED),
    Parameter(symbol="rho", unit="", neutral=0.5, lower=0.0, description="beta over beta + gamma", source=_NORMALISED),
)
BOUNDLESS = {"beta": 0, "gamma": 0, "u_y": 10**15, "rho": 1}
"""The shape, in both of its forms, of a hysteretic displacement without a bound: 1e15 m is far beyond any drift."""
_SHARPNESS = (Parameter(symbol="n", unit="", neutral=1.0, lower=1.0, description="sharpness of yield", source=_WEN),)


def _shape_from_yield() -> tuple[Definition, ...]:
    """``beta`` and ``gamma`` that make ``u_y`` the drift at which the initial slope ``A`` meets the bound of z."""
    A, u_y, rho, n = (symbol(name) for name in ("A", "u_y", "rho", "n"))
    bounding = A * (A * u_y) ** -n
    caption = "loop shape, from the yield displacement"
    return (
        Definition(caption=caption, subject=symbol("beta"), expression=rho * bounding),
        Definition(caption=caption, subject=symbol("gamma"), expression=(1 - rho) * bounding),
    )


_SHAPE_FROM_YIELD = _shape_from_yield()


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
    beta, gamma : float, Prior or PerStorey, optional
        Shape of the loop; ``beta + gamma > 0`` bounds the hysteretic displacement. [1/m^n] Their unit depends on n:
        where n is identified, give ``u_y`` and ``rho`` instead.
    u_y : float, Prior or PerStorey, optional
        Yield displacement, at which the initial slope meets the bound of z: ``beta + gamma = A / (A u_y)^n``. [m]
    rho : float, Prior or PerStorey, optional
        Ratio ``beta / (beta + gamma)``: 0.5 where unloading has the initial stiffness, more where it is stiffer
        (``gamma`` is negative above 1); below 0.5 a loop can give back more than it took in.
    n : float, Prior or PerStorey
        Sharpness of yield.
    hardens : bool
        Admit ``beta + gamma < 0``, where the loop hardens and nothing bounds the hysteretic displacement.

    Raises
    ------
    UserError
        If not one of the two pairs, ``beta`` and ``gamma`` or ``u_y`` and ``rho``, is given as a whole and alone.

    References
    ----------
    .. [1] Y.-K. Wen, "Method for Random Vibration of Hysteretic Systems", J. Eng. Mech. Div. 102(2), 1976.
    .. [2] M. Ismail et al., "The Hysteresis Bouc-Wen Model, a Survey", 2009, doi:10.1007/s11831-009-9031-8.
    .. [3] F. Ikhouane and J. Rodellar, "Systems with Hysteresis", 2007, doi:10.1002/9780470513200 (the normalised
       model: its sigma is the ratio ``rho`` here, its rho ``1 / u_y``).
    """

    k: Value
    c: Value = 0.0
    alpha: Value = 0.0
    A: Value = 1.0
    beta: Value | None = None
    gamma: Value | None = None
    u_y: Value | None = None
    rho: Value | None = None
    n: Value = 1.0
    hardens: bool = False

    adds: ClassVar[tuple[Addition, ...]] = ()

    def __post_init__(self) -> None:
        given = [name for name in ("beta", "gamma", "u_y", "rho") if getattr(self, name) is not None]
        if given not in (["beta", "gamma"], ["u_y", "rho"]):
            raise UserError(
                f"BoucWen has {' and '.join(given) or 'no shape of its loop'}: give beta and gamma, or u_y and rho, "
                "one pair of the two"
            )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The seven parameters, ``u_y`` and ``rho`` in the place of ``beta`` and ``gamma`` where those are given."""
        return (*_SPRINGS, *(_SHAPE if self.u_y is None else _YIELD), *_SHARPNESS)

    @property
    def name(self) -> str:
        """What effects call it: some need the bound that a loop which may harden has not."""
        return "hardening_bouc_wen" if self.hardens else "bouc_wen"

    @property
    def constraints(self) -> tuple[sp.Basic, ...]:
        """``beta + gamma >= 0`` bounds the hysteretic displacement; a loop that hardens has no bound."""
        return () if self.hardens else (symbol("beta") + symbol("gamma") >= 0,)

    @property
    def derived(self) -> tuple[Definition, ...]:
        """``beta`` and ``gamma`` in terms of the parameters, where they are not parameters themselves."""
        return () if self.u_y is None else _SHAPE_FROM_YIELD

    @property
    def values(self) -> Mapping[str, Value]:
        """The value (number, prior or PerStorey) of each parameter, by symbol."""
        return {parameter.symbol: getattr(self, parameter.symbol) for parameter in self.parameters}


@dataclass(frozen=True)
class ShortStrides:
    """Steps no longer than the drift within which z settles at its bound, ``1 / (n A ((beta + gamma) / A)^(1/n))``.

    In a building the drift itself moves slowly beside that; a displacement that is imposed may stride far beyond it
    between two samples, where a longer step of a stable scheme runs away.
    """

    parameters: ClassVar[tuple[Parameter, ...]] = ()

    def fill(self, slots: Slots) -> Slots:
        """The slots with this among what is sharp."""
        A, beta, gamma, n = (symbol(name) for name in ("A", "beta", "gamma", "n"))
        settles = n * A * sp.Abs((beta + gamma) / A) ** (1 / n)
        sharp = SharpFeature(state=DRIFT, width=4 / off_zero(settles), everywhere=True)
        return replace(slots, sharp_features=(*slots.sharp_features, sharp))
