"""The friction pendulum: a slider on a spherical dish, for a building that is isolated from the ground."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

import sympy as sp

from bwbn_bayes.elements.bouc_wen import BOUNDLESS, SPRING_AND_DASHPOT
from bwbn_bayes.elements.law import DRIFT, DRIFT_RATE, Addition, Definition, SharpFeature, Slots, symbol
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Parameter, Value

_SOURCE = "Constantinou et al. 1990"
_DAMPER = SPRING_AND_DASHPOT[1:]
_DISH = (
    Parameter(symbol="W", unit="N", neutral=0.0, lower=0.0, description="weight on the slider", source=_SOURCE),
    Parameter(symbol="R", unit="m", neutral=1.0, lower=1e-6, description="radius of the dish", source=_SOURCE),
    Parameter(symbol="mu_slow", unit="", neutral=1.0, lower=1e-6, description="friction at rest", source=_SOURCE),
    Parameter(symbol="Y", unit="m", neutral=1.0, lower=1e-9, description="drift before it slides", source=_SOURCE),
)
_SPEED = (
    Parameter(symbol="mu_fast", unit="", neutral=1.0, lower=0.0, description="friction at speed", source=_SOURCE),
    Parameter(
        symbol="a_mu", unit="s/m", neutral=0.0, lower=0.0, description="growth of friction with speed", source=_SOURCE
    ),
)
_KNOWN = {"k": 0, "alpha": 0, "A": 1, **BOUNDLESS, "n": 2}


@dataclass(frozen=True)
class _Sliding(Addition):
    """What a dish and its friction make of a Bouc-Wen link; nothing without a weight.

    The elastic spring is ``W / R``, the hysteretic spring ``mu_slow W / Y`` times ``mu / mu_slow``, and z, which is
    bounded by ``Y``, says which share of the friction is mobilised.
    """

    parameters: ClassVar[tuple[Parameter, ...]] = (*_DISH, *_SPEED)

    @override
    def fill(self, slots: Slots) -> Slots:
        weight, radius, slow, drift, fast, growth = (symbol(one.symbol) for one in self.parameters)
        there = sp.sign(weight)
        added = {
            "k": weight / radius + slow * weight / drift,
            "alpha": there / (1 + slow * radius / drift),
            "beta": there / (2 * drift**2),
            "gamma": there / (2 * drift**2),
        }
        increments = dict(slots.increments)
        for name, more in added.items():
            increments[symbol(name)] = increments.get(symbol(name), sp.Integer(0)) + more
        of_speed = 1 + (fast / slow - 1) * (1 - sp.exp(-growth * sp.Abs(DRIFT_RATE)))
        return replace(
            slots,
            increments=increments,
            hysteretic_factor=slots.hysteretic_factor * of_speed,
            # z follows the drift within Y / 2: a step of a stable scheme must be shorter than a few of these.
            sharp_features=(*slots.sharp_features, SharpFeature(state=DRIFT, width=2 * drift, everywhere=True)),
        )


@dataclass(frozen=True, kw_only=True)
class FrictionPendulum:
    """The force ``F = W u / R + mu W z / Y + c v`` with ``dz/dt = (1 - (z / Y)^2 (sgn(z v) + 1) / 2) v``.

    ``mu = mu_fast - (mu_fast - mu_slow) exp(-a_mu |v|)``. The slider moves elastically by about ``Y`` before it
    slides; z is bounded by ``Y``. The weight does not change with the motion.

    Parameters
    ----------
    W : float, Prior or PerStorey
        Weight on the slider; all above it, in a building. [N]
    R : float, Prior or PerStorey
        Effective radius of the dish: the isolated period is ``2 pi sqrt(R / g)``. [m]
    mu_slow : float, Prior or PerStorey
        Coefficient of friction near rest, and at any speed where ``mu_fast`` is left out.
    mu_fast, a_mu : float, Prior or PerStorey, optional
        Coefficient of friction at high speed, and the rate at which it is approached, both or neither. [1], [s/m]
    Y : float, Prior or PerStorey
        Yield displacement of the contact; small beside the drift, and seldom told by a record. [m]
    c : float, Prior or PerStorey
        Viscous damping beside it. [N s/m]

    Raises
    ------
    UserError
        If one of ``mu_fast`` and ``a_mu`` is given without the other.

    References
    ----------
    .. [1] M. Constantinou, A. Mokha and A. Reinhorn, "Teflon Bearings in Base Isolation II: Modeling", J. Struct. Eng.
       116(2), 1990, doi:10.1061/(ASCE)0733-9445(1990)116:2(455) (friction by speed and the hysteretic variable, with
       their exponent 2).
    .. [2] V. Zayas, S. Low and S. Mahin, "A Simple Pendulum Technique for Achieving Seismic Isolation", Earthquake
       Spectra 6(2), 1990, doi:10.1193/1.1585573 (the dish).
    """

    W: Value
    R: Value
    mu_slow: Value
    mu_fast: Value | None = None
    a_mu: Value | None = None
    Y: Value = 0.0005
    c: Value = 0.0

    name: ClassVar[str] = "friction_pendulum"
    constraints: ClassVar[tuple[sp.Basic, ...]] = ()
    adds: ClassVar[tuple[Addition, ...]] = (_Sliding(),)
    derived: ClassVar[tuple[Definition, ...]] = tuple(
        Definition(caption="friction pendulum", subject=symbol(name), expression=sp.Integer(value))
        for name, value in _KNOWN.items()
    )

    def __post_init__(self) -> None:
        if (self.mu_fast is None) != (self.a_mu is None):
            given, missing = ("mu_fast", "a_mu") if self.a_mu is None else ("a_mu", "mu_fast")
            raise UserError(f"FrictionPendulum has {given} without {missing}: give both, or mu_slow alone")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Damping, weight, radius, friction and yield displacement; two more where friction depends on speed."""
        return (*_DAMPER, *_DISH, *(_SPEED if self.mu_fast is not None else ()))

    @property
    def values(self) -> Mapping[str, Value]:
        """The value (number, prior or PerStorey) of each parameter, by symbol."""
        return {parameter.symbol: getattr(self, parameter.symbol) for parameter in self.parameters}
