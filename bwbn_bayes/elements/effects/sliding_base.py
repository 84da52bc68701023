"""The building stands on sliders: isolation that the model lacks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

import numpy as np
import sympy as sp

from bwbn_bayes.elements.law import (
    FIRST_FORCE,
    GROUND_ACCELERATION,
    TIME,
    AddedState,
    Definition,
    Effect,
    SharpFeature,
    Slots,
    off_zero,
    step,
    symbol,
)
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import PlaceResponse, Signature
from bwbn_bayes.parameters import HalfNormal, LogNormal, Parameter, Uniform, Value

DISPLACEMENT, VELOCITY, MOBILISED = sp.symbols("x_s v_s q_s", real=True)
"""Of the slab relative to the ground, and the share of the friction that its contact has reached. [m], [m/s], [1]"""
HIGHEST_FREQUENCY = sp.Integer(500)
"""Circular frequency of the slab on a contact that sticks: one that is stiffer gets inertia in its place. [rad/s]

A contact of 0.2 mm at a friction of a tenth, under four times the slab's weight, has 140.
"""
HIGHEST_RATE = sp.Integer(5000)
"""At which a contact that slides comes to its end: one that would sooner is softer while it slides so fast. [1/s]

Steps a sixty-fourth of a sample long follow no faster one, and their derivatives run away. Of one of 10 um that is from
50 mm/s on, where it is at its end.
"""
_GRAVITY = 9.80665
_SLOWEST = 50.0
"""Periods of the pendulum, in those of the building, beyond which it is flat."""
_GROWTH = 30.0
"""Of the friction of PTFE on steel with speed: 20 to 60 by pressure and finish. [s/m]"""


@dataclass(frozen=True, kw_only=True)
class SlidingBase(Effect):
    """A slab of mass ``m_s`` on sliders, ``m_s (x_s'' + a_g) = F_1 - W_s x_s / R_s - mu W_s q_s``.

    ``dq_s/dt = (1 - |q_s|^n_s (sgn(q_s v_s) + 1) / 2) v_s / Y_s``, with ``n_s = 2`` as in a friction pendulum, and
    ``mu = mu_fast (1 - r_mu exp(-a_s |v_s|))``: friction that is the same at every speed unless said otherwise. The
    parameter is ``inv_mu = 1 / mu_fast``: at 0 no force moves the slab. Floors and the first drift feel the slab's
    acceleration; channels named relative stay relative to the ground.

    While it sticks, the slab alone on its contact would ask explicit schemes for tiny steps where friction is large. So
    below ``i_s = W_s / (m_s Y_s 500^2)`` the slab still begins to slide at ``mu W_s``, with the inertia that goes with
    ``i_s``; the motion is exact from ``i_s`` on. Nor do steps follow a contact that slides to its end within fractions
    of a millisecond: while the slab is faster than ``5000 Y_s / n_s`` it gives way as if that were its speed.

    Parameters
    ----------
    inv_mu : float or Prior
        One over the coefficient of friction at speed; 0 is a building that does not slide.
    R_s : float or Prior
        Effective radius of the dishes: the isolated period is ``2 pi sqrt(R_s / g)``. [m]
    m_s : float or Prior
        Mass of the slab. [kg]
    W_s : float
        Weight on the sliders, known. [N]
    Y_s : float or Prior
        Yield displacement of the contact. [m]
    n_s : float or Prior
        Sharpness of its yield: the larger, the longer it is an elastic spring before it slides.
    r_mu : float or Prior
        Share of that friction which is missing near rest.
    a_s : float or Prior
        Growth of friction with speed. [s/m]

    References
    ----------
    .. [1] M. Constantinou, A. Mokha and A. Reinhorn, "Teflon Bearings in Base Isolation II: Modeling", J. Struct. Eng.
       116(2), 1990, doi:10.1061/(ASCE)0733-9445(1990)116:2(455) (the contact, with their exponent 2, and friction by
       speed; the range of ``a_s`` is cited from memory).
    """

    inv_mu: Value
    R_s: Value
    m_s: Value
    W_s: Value
    Y_s: Value
    n_s: Value = 2.0
    r_mu: Value = 0.0
    a_s: Value = 0.0

    name: ClassVar[str] = "sliding_base"
    title: ClassVar[str] = "a base that slides"
    level: ClassVar[str] = "structure"
    mechanism: ClassVar[str] = "base_flexibility"
    summary: ClassVar[str] = "the building stands on sliders, an isolation that the model lacks"
    source: ClassVar[str] = "Constantinou et al. 1990"
    residual: ClassVar[str] = "floor accelerations that stay below a level, a displacement that remains"
    confusable: ClassVar[str] = "base_flexibility, hysteresis or a low yield of storey 1"
    signature: ClassVar[Signature] = Signature(
        measure="base shear over the friction below it",
        plain_name="a contact below the building that hardly slides",
        reason="friction is overcome: below it nothing slides",
        size=lambda at: _shear_over_friction(at),
        least=1.0,
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            symbol="inv_mu",
            unit="",
            neutral=0.0,
            lower=0.0,
            description="one over the coefficient of friction at speed",
            source=source,
        ),
        Parameter(symbol="R_s", unit="m", neutral=1.0, lower=1e-6, description="radius of the dishes", source=source),
        Parameter(symbol="m_s", unit="kg", neutral=1.0, lower=1e-9, description="mass of the slab", source=source),
        Parameter(symbol="W_s", unit="N", neutral=1.0, lower=1e-9, description="weight, known", source=source),
        Parameter(
            symbol="Y_s",
            unit="m",
            neutral=1.0,
            lower=1e-9,
            description="yield displacement of the contact",
            source=source,
        ),
        Parameter(symbol="n_s", unit="", neutral=2.0, lower=1.0, description="sharpness of its yield", source=source),
        Parameter(
            symbol="r_mu",
            unit="",
            neutral=0.0,
            lower=0.0,
            upper=0.99,
            description="share of the friction that is missing near rest",
            source=source,
        ),
        Parameter(
            symbol="a_s", unit="s/m", neutral=0.0, lower=0.0, description="growth of friction with speed", source=source
        ),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        slipperiness, radius, mass, weight, drift, n, missing, growth = (symbol(p.symbol) for p in self.parameters)
        inertial = step("i_s")
        reached = sp.Abs(MOBILISED)
        # Beyond 1, where a step may carry it but no exact solution, it comes back gently: its power would run away.
        taken = reached - sp.Max(reached - reached**n, 0)
        gives = sp.Max(drift, n * sp.Abs(VELOCITY) / HIGHEST_RATE)
        rate = (1 - taken * (sp.sign(MOBILISED * VELOCITY) + 1) / 2) * VELOCITY / gives
        driven = slipperiness * (FIRST_FORCE - mass * GROUND_ACCELERATION - weight / radius * DISPLACEMENT)
        of_speed = 1 - missing * sp.exp(-growth * sp.Abs(VELOCITY))
        acceleration = (driven - weight * of_speed * MOBILISED) / (mass * inertial)
        radian = sp.sqrt(mass * inertial * drift / weight)  # of the slab on a contact that sticks
        return replace(
            slots,
            steps=(
                *slots.steps,
                Definition(
                    caption="one over the friction that the inertia of the slab goes with",
                    subject=inertial,
                    expression=sp.Max(slipperiness, weight / (mass * drift * HIGHEST_FREQUENCY**2)),
                ),
            ),
            base_states=(
                *slots.base_states,
                AddedState(state=DISPLACEMENT, rate=VELOCITY),
                AddedState(state=VELOCITY, rate=acceleration),
                AddedState(state=MOBILISED, rate=rate),
            ),
            base_acceleration=slots.base_acceleration + acceleration,
            # q_s follows the slip within Y_s / n_s: a step of a stable scheme must be shorter than a few of these.
            sharp_features=(
                *slots.sharp_features,
                SharpFeature(state=DISPLACEMENT, width=4 * drift / n, everywhere=True),
                # At the turns it stands still, and a step foretold from its speed would be as long as ever.
                SharpFeature(state=TIME, width=radian / off_zero(sp.sign(slipperiness)), everywhere=True),
            ),
        )


@guides(SlidingBase)
class SlidingBaseSearch(SearchGuide[SlidingBase]):
    """How a search looks for a base that slides."""

    @override
    def priors(self, scales: Scales) -> tuple[SlidingBase, ...]:
        weight = _weight(scales)
        return (
            SlidingBase(
                inv_mu=HalfNormal(4.0 * weight / scales.force),
                R_s=LogNormal(_radius(5.0, scales), 1.5).truncated(_radius(1.0, scales), _radius(_SLOWEST, scales)),
                m_s=Uniform(0.3 * scales.mass, 3.0 * scales.mass),
                W_s=weight,
                # Not known: other effects make up for a contact that is too soft or too stiff. One that gives way by a
                # quarter of a storey's drift is a spring; at the lower end next to nothing is cut off, since the drift
                # without the sliders may be several times what it is with them.
                Y_s=LogNormal(0.01 * scales.drift, 1.5).truncated(0.0001 * scales.drift, 0.25 * scales.drift),
                # From a gradual onset to a spring that breaks off. Held at 2, a sharp one leaves hundreds of nats that
                # backlash in the first storey takes up.
                n_s=LogNormal(2.0, 1.0).truncated(1.0, 20.0),
                # Sliders are of PTFE nearly always. Held at one friction, measured ones leave hundreds of nats that a
                # storey whose stiffness changes in time takes up. How fast it grows is not asked: where it does not, no
                # record tells, and a posterior that is wide in it takes minutes to follow.
                r_mu=Uniform(0.0, 0.9),
                a_s=_GROWTH,
            ),
        )

    @override
    def starts(self, effect: SlidingBase, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        least = _weight(scales) / scales.force
        return {
            "inv_mu": (1.3 * least, 2.5 * least, 6.0 * least),
            "R_s": (_radius(2.5, scales), _radius(8.0, scales)),
            "m_s": (scales.mass,),
            "Y_s": (0.005 * scales.drift, 0.05 * scales.drift),
            "n_s": (2.0,),
            "r_mu": (0.3,),
        }


def _weight(scales: Scales) -> float:
    """Weight [N] of all floors and a slab like the first of them."""
    return _GRAVITY * (scales.total_mass + scales.mass)


def _radius(periods: float, scales: Scales) -> float:
    """Radius [m] of a dish whose period is so many times the building's own."""
    return _GRAVITY * (periods * scales.period / (2.0 * np.pi)) ** 2


def _shear_over_friction(at: PlaceResponse) -> float:
    """Largest base shear over the friction force near rest, both without the share of the slab."""
    shear = float(np.max(np.abs(at.base_shear)))
    return shear * at["inv_mu"] / (1.0 - at["r_mu"]) / (_GRAVITY * at.scales.total_mass)
