"""The building stands on a base that can move: soil or bearings, in sway."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

import numpy as np
import sympy as sp

from bwbn_bayes.elements.law import (
    FIRST_FORCE,
    GROUND_ACCELERATION,
    AddedState,
    Definition,
    Effect,
    Slots,
    step,
    symbol,
)
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import Floats, HalfNormal, Parameter, Uniform, Value

DISPLACEMENT, VELOCITY = sp.symbols("x_b v_b", real=True)
"""Of the base relative to the ground. [m], [m/s]"""

HIGHEST_FREQUENCY = sp.Integer(100)
"""Circular frequency that the base alone does not exceed: stiffer ones get inertia in its place. [rad/s]"""


@dataclass(frozen=True, kw_only=True)
class BaseFlexibility(Effect):
    """A base of mass ``m_b`` on a spring and a damper, ``m_b (x_b'' + a_g) = F_1 - x_b / compliance - c_b x_b'``.

    The ground ``a_g`` is the free field, and the base sways only. Floors and the first drift feel the base's
    acceleration; channels named relative stay relative to the ground. A base alone faster than 100 rad/s would ask
    explicit schemes for tiny steps. So below ``f_c = 1 / (m_b 100^2)`` the spring follows the compliance, the inertia
    stays that of ``f_c``: exact from ``f_c`` on, and exactly rigid at zero.

    Parameters
    ----------
    compliance : float or Prior
        Displacement of the base per unit of force; 0 is rigid. [m/N]
    m_b : float or Prior
        Mass of the base. [kg]
    c_b : float or Prior
        Viscous damping between base and ground. [N s/m]

    References
    ----------
    .. [1] A. S. Veletsos and J. W. Meek, "Dynamic Behaviour of Building-Foundation Systems", Earthq. Eng. Struct. Dyn.
       3(2), 1974, doi:10.1002/eqe.4290030203.
    """

    compliance: Value
    m_b: Value
    c_b: Value

    name: ClassVar[str] = "base_flexibility"
    title: ClassVar[str] = "base flexibility"
    level: ClassVar[str] = "structure"
    summary: ClassVar[str] = "the building stands on a base that sways"
    source: ClassVar[str] = "Veletsos and Meek 1974"
    residual: ClassVar[str] = "all floors shift"
    confusable: ClassVar[str] = "k of storey 1, stiffness_degradation"
    signature: ClassVar[Signature] = Signature(
        measure="lengthening of the first period by the base",
        plain_name="a small give below the first storey (a sway spring)",
        reason="0.3 % of the period: daily changes of temperature move it as much",
        size=lambda at: _lengthening(at["compliance"], *at.loop, at.base_shear),
        least=0.003,
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            symbol="compliance",
            unit="m/N",
            neutral=0.0,
            lower=0.0,
            description="displacement of the base per unit of force",
            source=source,
        ),
        Parameter(symbol="m_b", unit="kg", neutral=1.0, lower=1e-9, description="mass of the base", source=source),
        Parameter(symbol="c_b", unit="N s/m", neutral=0.0, lower=0.0, description="damping of the base", source=source),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        compliance, mass, damping, inertial = symbol("compliance"), symbol("m_b"), symbol("c_b"), step("f_b")
        slowest = 1 / (mass * HIGHEST_FREQUENCY**2)
        push = compliance * (FIRST_FORCE - mass * GROUND_ACCELERATION) - DISPLACEMENT
        acceleration = push / (mass * inertial) - damping * VELOCITY / mass
        return replace(
            slots,
            steps=(
                *slots.steps,
                Definition(
                    caption="compliance that the inertia of the base goes with",
                    subject=inertial,
                    expression=sp.Max(compliance, slowest),
                ),
            ),
            base_states=(
                *slots.base_states,
                AddedState(state=DISPLACEMENT, rate=VELOCITY),
                AddedState(state=VELOCITY, rate=acceleration),
            ),
            base_acceleration=slots.base_acceleration + acceleration,
        )


@guides(BaseFlexibility)
class BaseFlexibilitySearch(SearchGuide[BaseFlexibility]):
    """How a search looks for a base that sways."""

    @override
    def priors(self, scales: Scales) -> tuple[BaseFlexibility, ...]:
        return (
            BaseFlexibility(
                compliance=HalfNormal(0.5 / scales.stiffness),
                m_b=Uniform(0.3 * scales.mass, 3.0 * scales.mass),
                c_b=Uniform(0.0, 0.5 * _critical(scales)),
            ),
        )

    @override
    def starts(self, effect: BaseFlexibility, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {
            "compliance": (0.05 / scales.stiffness, 0.3 / scales.stiffness),
            "m_b": (scales.mass,),
            "c_b": (0.03 * _critical(scales), 0.15 * _critical(scales)),
        }


def _critical(scales: Scales) -> float:
    """Critical damping [N s/m] of one floor on one storey."""
    return float(2.0 * np.sqrt(scales.stiffness * scales.mass))


def _lengthening(compliance: float, drift: Floats, force: Floats, shear: Floats) -> float:
    """Share by which a base lengthens the first period, of histories ``(n_links, n_times)`` [m], [N].

    Period goes as the root of the energy stored for one motion of the floors: at the largest base shear, that of the
    links ``sum F_i u_i / 2`` with and without that of the base, ``compliance V^2 / 2`` (Veletsos and Meek's formula
    for sway, with more than one storey; the inertia of the base is left out).
    """
    at = int(np.argmax(np.abs(shear)))
    stored = float(np.sum(force[:, at] * drift[:, at]))
    return float(np.sqrt(1.0 + compliance * shear[at] ** 2 / max(stored, 1e-300)) - 1.0)
