"""The storey law of the independent simulator, written from the equations, with a switch for every effect.

Every effect is a number that is zero where the effect is absent. The catalogue's effects come first, then other forms
of the same effects, then effects that no catalogue holds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from numba import njit

BRISTLE_EXPONENT = 10
"""Sharpness of the bristle (stick-slip friction): a stop operator in Bouc-Wen's form."""


@dataclass(frozen=True, kw_only=True)
class Storey:
    """Numbers of one storey, and of the floor and the sensor above it. A zero switches an effect off.

    Attributes
    ----------
    k, c, alpha, beta, gamma, n : float
        The plain Bouc-Wen law with A = 1. [N/m], [N s/m], [1], [1/m^n], [1/m^n], [1]
    delta_eta, delta_nu : float
        Stiffness and strength degradation. [1/J]
    delta_s, sigma, slip_sech : float
        Series slip-lock and its width; with ``slip_sech`` 1 the slip is a squared hyperbolic secant. [m/J], [m], [1]
    zeta_s, p, q, psi_0, delta_psi, lambda_ : float
        Foliente's pinching. [1], [1/J], [1], [m], [m/J], [1]
    pinch, pinch_width : float
        Another pinching law: ``1 - pinch / (1 + (z / pinch_width)^2)``, without memory. [1], [m]
    phi, phi_drift_rate, phi_drift : float
        Asymmetry ``phi (sgn z + sgn v)``; other forms ``phi sgn u sgn v`` and ``phi sgn u``. [1/m^n]
    k3, c2 : float
        Cubic stiffness, quadratic damping. [N/m^3], [N s^2/m^2]
    F_c, v0, F_root, F_bristle, bristle : float
        Coulomb friction ``F_c tanh(v / v0)``; other forms ``F_root v / sqrt(v^2 + v0^2)`` and a bristle that sticks
        over the deflection ``bristle``. [N], [m/s], [N], [N], [m]
    k_g, g, k_g_side, k_g_soft, gap_width : float
        Stops beyond a gap on both sides; on the side of positive drift alone; with an onset softened over
        ``gap_width``. [N/m], [m], [N/m], [N/m], [m]
    k_jump, k_time, k_ramp : float
        Stiffness changes by ``k_jump`` at ``k_time``, over ``k_ramp``. [N/m], [s], [s]
    k_m, tau : float
        Maxwell branch. [N/m], [s]
    b : float
        Backlash: play of width 2 b. [m]
    snap, snap_centre, snap_width : float
        A window of negative stiffness. [N/m], [m], [m]
    modulation, modulation_period, modulation_phase : float
        Stiffness that breathes with time. [1], [s], [1]
    c_soft, v_soft, c_root : float
        Damping ``c_soft v exp(-|v| / v_soft)`` and ``c_root sgn v sqrt|v|``. [N s/m], [m/s], [N (s/m)^(1/2)]
    coupling : float
        Spring between this storey's drift and the next one's, as bending makes it. [N/m]
    mass, mass_error : float
        Floor mass as stated, and the share by which it is larger. [kg], [1]
    appendage_mass, appendage_omega, appendage_zeta : float
        Tuned mass on the floor: share of the floor's mass, angular frequency, damping ratio. [1], [1/s], [1]
    bias, gain_error, lag : float
        Sensor: ``(1 + gain_error) a(t - lag) + bias``. [m/s^2], [1], [s]
    drift_amplitude, drift_period, saturation : float
        Sensor: a slow wander, and ``S tanh(a / S)``. [m/s^2], [s], [m/s^2]
    """

    k: float
    c: float
    alpha: float
    beta: float
    gamma: float
    n: float
    delta_eta: float = 0.0
    delta_nu: float = 0.0
    delta_s: float = 0.0
    sigma: float = 1.0
    slip_sech: float = 0.0
    zeta_s: float = 0.0
    p: float = 0.0
    q: float = 0.0
    psi_0: float = 1.0
    delta_psi: float = 0.0
    lambda_: float = 1.0
    pinch: float = 0.0
    pinch_width: float = 1.0
    phi: float = 0.0
    phi_drift_rate: float = 0.0
    phi_drift: float = 0.0
    k3: float = 0.0
    c2: float = 0.0
    F_c: float = 0.0
    v0: float = 1.0
    F_root: float = 0.0
    F_bristle: float = 0.0
    bristle: float = 1.0
    k_g: float = 0.0
    g: float = 0.0
    k_g_side: float = 0.0
    k_g_soft: float = 0.0
    gap_width: float = 1.0
    k_jump: float = 0.0
    k_time: float = 0.0
    k_ramp: float = 0.0
    k_m: float = 0.0
    tau: float = 1.0
    b: float = 0.0
    snap: float = 0.0
    snap_centre: float = 0.0
    snap_width: float = 1.0
    modulation: float = 0.0
    modulation_period: float = 1.0
    modulation_phase: float = 0.0
    c_soft: float = 0.0
    v_soft: float = 1.0
    c_root: float = 0.0
    coupling: float = 0.0
    mass: float = 1.0
    mass_error: float = 0.0
    appendage_mass: float = 0.0
    appendage_omega: float = 1.0
    appendage_zeta: float = 0.0
    bias: float = 0.0
    gain_error: float = 0.0
    lag: float = 0.0
    drift_amplitude: float = 0.0
    drift_period: float = 1.0
    saturation: float = 0.0


def ultimate_displacement(p: Storey) -> float:
    """Bound ``(1 / (beta + gamma))^(1/n)`` [m] of the hysteretic displacement without degradation."""
    return float((1.0 / (p.beta + p.gamma)) ** (1.0 / p.n))


def _sign(x: float) -> float:
    if x > 0.0:
        return 1.0
    return -1.0 if x < 0.0 else 0.0


def _stiffness(p: Storey, t: float, t_step: float) -> float:
    share = 0.0
    if p.k_jump != 0.0:
        share = min(max((t - p.k_time) / p.k_ramp, 0.0), 1.0) if p.k_ramp > 0.0 else sign(max(t_step - p.k_time, 0.0))
    breathing = 1.0
    if p.modulation != 0.0:
        breathing += p.modulation * math.sin(2.0 * math.pi * t / p.modulation_period + p.modulation_phase)
    return (p.k + p.k_jump * share) * breathing


def _play_rate(position: float, half_width: float, v: float) -> float:
    """Rate of the position in a play: with the drift until it meets a side, and again at once when the drift turns."""
    return 0.0 if position * v > 0.0 and abs(position) >= half_width else v


def _stop_rate(deflection: float, limit: float, v: float) -> float:
    """Rate of a spring-like deflection that moves with v until it reaches its limit."""
    if deflection * v <= 0.0:
        return v
    # Never below zero: a step that oversteps the limit stays where it is.
    return v * max(1.0 - abs(deflection / limit) ** BRISTLE_EXPONENT, 0.0)


def _pinching(p: Storey, v: float, z: float, eps: float) -> float:
    h = 1.0
    if p.zeta_s != 0.0:
        z1 = p.zeta_s * (1.0 - math.exp(-p.p * eps))
        z2 = (p.psi_0 + p.delta_psi * eps) * (p.lambda_ + z1)
        centre = p.q * (1.0 / (p.beta + p.gamma)) ** (1.0 / p.n)
        h -= z1 * math.exp(-(((z * sign(v) - centre) / z2) ** 2))
    if p.pinch != 0.0:
        h -= p.pinch / (1.0 + (z / p.pinch_width) ** 2)
    return h


def _hysteretic_rate(p: Storey, u: float, v: float, z: float, eps: float) -> float:
    bracket = p.beta * sign(z * v) + p.gamma + p.phi * (sign(z) + sign(v))
    bracket += p.phi_drift_rate * sign(u) * sign(v) + p.phi_drift * sign(u)
    f: float = (1.0 - (1.0 + p.delta_nu * eps) * float(abs(z) ** p.n) * bracket) / (1.0 + p.delta_eta * eps)
    f *= pinching(p, v, z, eps)
    if p.delta_s == 0.0:
        return f * v
    if p.slip_sech > 0.0:
        density = 1.0 / (p.sigma * math.cosh(min(abs(z) / p.sigma, 300.0)) ** 2)
    else:
        density = math.sqrt(2.0 / math.pi) / p.sigma * math.exp(-0.5 * (z / p.sigma) ** 2)
    return f * v / (1.0 + p.delta_s * eps * density * f)


def _stops(p: Storey, u: float) -> float:
    force: float = p.k_g * max(abs(u) - p.g, 0.0) * sign(u) + p.k_g_side * max(u - p.g, 0.0)
    if p.k_g_soft != 0.0:
        beyond = (abs(u) - p.g) / p.gap_width
        soft = beyond if beyond > 30.0 else math.log1p(math.exp(beyond))
        at_rest = math.log1p(math.exp(-p.g / p.gap_width))
        force += p.k_g_soft * p.gap_width * (soft - at_rest) * sign(u)
    return force


def _rate_force(p: Storey, v: float) -> float:
    force: float = p.c * v + p.c2 * v * abs(v)
    if p.F_c != 0.0:
        force += p.F_c * math.tanh(v / p.v0)
    if p.F_root != 0.0:
        force += p.F_root * v / math.sqrt(v * v + p.v0 * p.v0)
    if p.c_soft != 0.0:
        force += p.c_soft * v * math.exp(-abs(v) / p.v_soft)
    if p.c_root != 0.0:
        force += p.c_root * v / (v * v + 1e-8) ** 0.25
    return force


def _drift_force(p: Storey, u: float) -> float:
    force: float = p.k3 * u**3 + stops(p, u)
    if p.snap != 0.0:
        force -= p.snap * u * math.exp(-(((abs(u) - p.snap_centre) / p.snap_width) ** 2))
    return force


compiled = njit(cache=True, error_model="numpy")
sign = compiled(_sign)
stiffness = compiled(_stiffness)
play_rate = compiled(_play_rate)
stop_rate = compiled(_stop_rate)
pinching = compiled(_pinching)
hysteretic_rate = compiled(_hysteretic_rate)
stops = compiled(_stops)
rate_force = compiled(_rate_force)
drift_force = compiled(_drift_force)
