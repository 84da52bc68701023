"""Dry friction in free shapes: a contact that wears, under a pressure that follows the drift, or a force by speed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

import numpy as np
import sympy as sp

from bwbn_bayes.elements.law import DRIFT, DRIFT_RATE, PATH, AddedState, Effect, SharpFeature, Slots, symbol
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import PlaceResponse, Signature
from bwbn_bayes.parameters import Floats, HalfNormal, LogNormal, Normal, Parameter, Prior, Value

SHARE = symbol("q_d")
"""Share of the friction force that the contact has reached, from -1 to 1."""
_ROUNDING = 0.1
"""Distance of the share from its end within which the power is rounded: below one it would be met at infinite speed."""
_TURNED = 0.5
"""Of the share, by which a step may change it at a resolution of one."""
WIDEST = 0.125
"""Share of the largest drift rate, or drift, over which dry friction may turn: what turns more slowly is not dry."""


def width_prior(largest: float) -> Prior:
    """Of the drift rate [m/s] or drift [m] over which dry friction turns, by the largest one."""
    return LogNormal(0.03 * largest, 0.8).truncated(0.004 * largest, 0.3 * largest)


def width_starts(largest: float) -> tuple[float, ...]:
    """Where fits of that width start."""
    return (0.015 * largest, 0.08 * largest)


def _parameter(
    name: str, unit: str, neutral: float, lower: float, description: str, source: str = "Dahl 1968"
) -> Parameter:
    return Parameter(symbol=name, unit=unit, neutral=neutral, lower=lower, description=description, source=source)


@dataclass(frozen=True, kw_only=True)
class FreeFriction(Effect):
    """The force ``F_d q_d p(u) exp(-c_d u_c/U_d)``, ``dq_d/dt = v/x_d (1 - sgn(v) q_d) |1 - sgn(v) q_d|^(r_d - 1)``.

    The pressure ``p = 1 + g_d |u|/u_d`` is never negative: a contact that opens does not pull. It wears with the path,
    ``du_c/dt = |v|``. With ``r_d = 1`` and ``g_d = c_d = 0`` it is the contact that sticks of
    :class:`~bwbn_bayes.elements.effects.coulomb_friction.CoulombFriction`, whose other forms resemble it where they
    turn within little drift.

    Parameters
    ----------
    F_d : float, Prior or PerStorey
        Friction force at zero drift. [N]
    x_d : float, Prior or PerStorey
        Drift over which it turns at first. [m]
    r_d : float, Prior or PerStorey
        Dahl's exponent: below one the contact slides sooner, above one later.
    g_d : float, Prior or PerStorey
        Share by which the pressure has grown at the drift ``u_d``.
    u_d : float
        Drift at which the pressure is measured. [m]
    c_d : float, Prior or PerStorey
        Logarithm of what the force was over what it is at the path ``U_d``.
    U_d : float
        Path at which the wear is measured. [m]

    References
    ----------
    .. [1] P. R. Dahl, "A Solid Friction Model", Aerospace Corporation TOR-0158(3107-18)-1, 1968 (the exponent; cited
       from memory, not consulted); that the pressure follows the drift is our generalisation.
    .. [2] J. F. Archard, "Contact and Rubbing of Flat Surfaces", J. Applied Physics 24(8), 1953 (wear in proportion to
       the path; cited from memory, not consulted); that the force falls with it, by its own share, is our use.
    """

    F_d: Value
    x_d: Value
    r_d: Value
    g_d: Value
    u_d: Value
    c_d: Value
    U_d: Value

    name: ClassVar[str] = "coulomb_friction"
    title: ClassVar[str] = "dry friction"
    summary: ClassVar[str] = "dry friction that resists every drift"
    source: ClassVar[str] = "Dahl 1968"
    residual: ClassVar[str] = "a square wave in phase with the drift rate, sticking"
    confusable: ClassVar[str] = "a stiff Bouc-Wen spring with alpha near 0, quadratic_damping at one amplitude"
    form: ClassVar[str] = "free shape"
    signature: ClassVar[Signature] = Signature(
        measure="friction force over the peak force",
        plain_name="the shape of the force after reversals (a smoothed friction)",
        reason="0.4 % of the peak force, turned within an eighth of the largest drift: what turns slowly is not dry",
        size=lambda at: at["F_d"] / at.peak("restoring_force"),
        least=0.004,
        is_genuine=lambda at: at["x_d"] <= WIDEST * at.peak("drift"),
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        _parameter("F_d", "N", 0.0, 0.0, "friction force at zero drift"),
        _parameter("x_d", "m", 1.0, 1e-9, "drift over which friction turns at first"),
        _parameter("r_d", "", 1.0, 0.1, "exponent of the turn"),
        _parameter("g_d", "", 0.0, -0.95, "growth of the pressure at a known drift"),
        _parameter("u_d", "m", 1.0, 1e-12, "that drift, known"),
        _parameter("c_d", "", 0.0, 0.0, "wear by a known path, as a logarithm", "Archard 1953"),
        _parameter("U_d", "m", 1.0, 1e-12, "that path, known", "Archard 1953"),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        force, width, exponent, growth, largest, wear, path = (symbol(one.symbol) for one in self.parameters)
        left = 1 - sp.sign(DRIFT_RATE) * SHARE
        # A power of the square, not of the magnitude: derivatives of the sign inside it are none.
        rate = DRIFT_RATE / width * left * (left**2 + _ROUNDING**2) ** ((exponent - 1) / 2)
        pressure = sp.Max(1 + growth * sp.Abs(DRIFT) / largest, 0) * sp.exp(-wear * PATH / path)
        # A contact that slides pulls its share back by r_d |1 - q_d|^(r_d - 1) / x_d, and a step of a stable scheme is
        # shorter than a few of these. Above one they vanish as the share nears its end; below one the rounding leaves
        # five at 0.3. After a turn the share runs, and steps are as short as that.
        sliding = 4 * width * sp.Max(exponent, 1) / (1 + 6 * sp.Max(1 - exponent, 0))
        return replace(
            slots,
            added_force=slots.added_force + force * SHARE * pressure,
            added_states=(*slots.added_states, AddedState(state=SHARE, rate=rate)),
            sharp_features=(
                *slots.sharp_features,
                SharpFeature(state=DRIFT, width=sliding, everywhere=True),
                SharpFeature(state=SHARE, width=sp.Float(_TURNED), everywhere=True),
            ),
        )


def _at_speeds(at: PlaceResponse, speed: Floats) -> float:
    """Largest force [N] of a friction that depends on speed, over some drift rates ``(n,)`` [m/s]."""
    near_rest = 1.0 + at["s_k"] / (1.0 + np.square(speed / at["v_k"]))
    return float(at["F_k"] * np.max(np.abs(np.tanh(speed / at["w_k"]) * near_rest)))


def _is_dry(at: PlaceResponse, fastest: float) -> bool:
    """Whether it turns within little of the largest drift rate [m/s], and is half of what it is there by then."""
    slow, fast = (_at_speeds(at, np.array([speed])) for speed in (WIDEST * fastest, fastest))
    return at["w_k"] <= WIDEST * fastest and slow >= 0.5 * fast


@dataclass(frozen=True, kw_only=True)
class SpeedFriction(Effect):
    """The force ``F_k tanh(v/w_k) (1 + s_k/(1 + (v/v_k)^2))``: of another size near rest than in motion.

    With ``s_k = 0`` it is the ``tanh`` of :class:`~bwbn_bayes.elements.effects.coulomb_friction.CoulombFriction`.

    Parameters
    ----------
    F_k : float, Prior or PerStorey
        Friction force at high speed. [N]
    w_k : float, Prior or PerStorey
        Drift rate over which it turns. [m/s]
    s_k : float, Prior or PerStorey
        Share by which it is larger near rest.
    v_k : float, Prior or PerStorey
        Drift rate at which half of that is left. [m/s]

    References
    ----------
    .. [1] D. P. Hess and A. Soom, "Friction at a Lubricated Line Contact Operating at Oscillating Sliding Velocities",
       J. Tribology 112(1), 1990 (the fall with speed; cited from memory, not consulted).
    """

    F_k: Value
    w_k: Value
    s_k: Value
    v_k: Value

    name: ClassVar[str] = FreeFriction.name
    title: ClassVar[str] = FreeFriction.title
    summary: ClassVar[str] = FreeFriction.summary
    source: ClassVar[str] = "Hess and Soom 1990"
    residual: ClassVar[str] = FreeFriction.residual
    confusable: ClassVar[str] = FreeFriction.confusable
    form: ClassVar[str] = "free shape, with the speed"
    signature: ClassVar[Signature] = replace(
        FreeFriction.signature,
        reason="0.4 % of the peak force, half of it within an eighth of the largest drift rate: else it is viscous",
        size=lambda at: _at_speeds(at, at.histories["drift_rate"]) / at.peak("restoring_force"),
        is_genuine=lambda at: _is_dry(at, at.peak("drift_rate")),
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        _parameter("F_k", "N", 0.0, 0.0, "friction force at high speed", source),
        _parameter("w_k", "m/s", 1.0, 1e-9, "drift rate over which friction turns", source),
        _parameter("s_k", "", 0.0, -0.95, "share by which friction is larger near rest", source),
        _parameter("v_k", "m/s", 1.0, 1e-9, "drift rate at which half of that is left", source),
    )

    @override
    def fill(self, slots: Slots) -> Slots:
        force, width, more, speed = (symbol(parameter.symbol) for parameter in self.parameters)
        v = DRIFT_RATE
        return replace(
            slots,
            added_force=slots.added_force + force * sp.tanh(v / width) * (1 + more / (1 + v**2 / speed**2)),
            sharp_features=(*slots.sharp_features, SharpFeature(state=v, width=width)),
        )


@guides(SpeedFriction)
class SpeedFrictionSearch(SearchGuide[SpeedFriction]):
    """How a search looks for dry friction that depends on speed."""

    @override
    def priors(self, scales: Scales) -> tuple[SpeedFriction, ...]:
        one = SpeedFriction(
            F_k=HalfNormal(0.3 * scales.force),
            w_k=width_prior(scales.drift_rate),
            s_k=Normal(0.0, 0.5).truncated(-0.95, 3.0),
            v_k=LogNormal(0.1 * scales.drift_rate, 1.0).truncated(0.005 * scales.drift_rate, 2.0 * scales.drift_rate),
        )
        return (one,)

    @override
    def starts(self, effect: SpeedFriction, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {
            "F_k": (0.03 * scales.force, 0.15 * scales.force),
            "w_k": width_starts(scales.drift_rate),
            "s_k": (-0.3, 0.4),
            "v_k": (0.1 * scales.drift_rate,),
        }


@guides(FreeFriction)
class FreeFrictionSearch(SearchGuide[FreeFriction]):
    """How a search looks for dry friction in a free shape."""

    @override
    def priors(self, scales: Scales) -> tuple[FreeFriction, ...]:
        one = FreeFriction(
            F_d=HalfNormal(0.3 * scales.force),
            x_d=width_prior(scales.drift),
            r_d=LogNormal(1.0, 0.5).truncated(0.3, 3.0),
            g_d=Normal(0.0, 0.5).truncated(-0.95, 5.0),
            u_d=scales.drift,
            c_d=HalfNormal(1.0).truncated(0.0, 5.0),
            U_d=scales.path,
        )
        return (one,)

    @override
    def starts(self, effect: FreeFriction, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return {
            "F_d": (0.03 * scales.force, 0.15 * scales.force),
            "x_d": width_starts(scales.drift),
            "r_d": (0.8,),
            "g_d": (-0.2, 0.3),
            "c_d": (0.2,),
        }
