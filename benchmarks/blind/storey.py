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
    delta_s, sigma, slip_bell : float
        Series slip-lock and its width; ``slip_bell`` 0 is the Gaussian, 1 a squared hyperbolic secant, 2 a Lorentzian,
        3 ``exp(-(z / sigma)^4)``, all of the same area. [m/J], [m], [1]
    zeta_s, p, q, psi_0, delta_psi, lambda_, pinch_bell : float
        Foliente's pinching; ``pinch_bell`` 0 is the Gaussian, 1 a hyperbolic secant, 2 a triangle. [1], [1/J], [1],
        [m], [m/J], [1], [1]
    pinch, pinch_width : float
        Another pinching law: ``1 - pinch / (1 + (z / pinch_width)^2)``, without memory. [1], [m]
    wear_energy, wear_path, wear_time, wear_power, wear_saturates : float
        What wears a storey besides ``epsilon``: ``x`` is epsilon, path or time over whichever scale is not zero, and
        the wear is ``x^wear_power``, or ``1 - exp(-x)`` with ``wear_saturates`` 1. [J], [m], [s], [1], [1]
    eta_wear, nu_wear, slip_wear, phi_wear, g_wear : float
        What a wear of one adds to eta, to nu, to the slip s, to phi and to the gap. [1], [1], [m], [1/m^n], [m]
    phi, phi_drift_rate, phi_drift : float
        Asymmetry ``phi (sgn z + sgn v)``; other forms ``phi sgn u sgn v`` and ``phi sgn u``. [1/m^n]
    k3, c2 : float
        Cubic stiffness, quadratic damping. [N/m^3], [N s^2/m^2]
    k_power, drift_power, c_power, rate_power : float
        Other powers: ``k_power sgn u |u|^drift_power``, ``c_power sgn v |v|^rate_power``. [N/m^a], [1],
        [N (s/m)^a], [1]
    F_c, v0, F_root, F_bristle, bristle : float
        Coulomb friction ``F_c tanh(v / v0)``; other forms ``F_root v / sqrt(v^2 + v0^2)`` and a bristle that sticks
        over the deflection ``bristle``. [N], [m/s], [N], [N], [m]
    F_arctan, F_stribeck, stribeck, v_stribeck, F_pressed, u_pressed : float
        Friction ``F (2 / pi) arctan(v / v0)``; ``F (1 + stribeck exp(-(v / v_stribeck)^2)) tanh(v / v0)``; one whose
        pressure grows with drift, ``F (1 + |u| / u_pressed) tanh(v / v0)``. [N], [N], [1], [m/s], [N], [m]
    k_g, g, k_g_side, k_g_soft, gap_width, k_hertz : float
        Stops beyond a gap on both sides; on the side of positive drift alone; with an onset softened over
        ``gap_width``; of Hertz's power three halves. [N/m], [m], [N/m], [N/m], [m], [N/m^1.5]
    k_jump, k_time, k_ramp : float
        Stiffness changes by ``k_jump`` at ``k_time``, over ``k_ramp``. [N/m], [s], [s]
    k_fade, k_fade_time : float
        Stiffness falls with time, by ``k_fade (1 - exp(-t / k_fade_time))`` of itself. [1], [s]
    k_m, tau : float
        Maxwell branch. [N/m], [s]
    b, slack : float
        Backlash: play of width 2 b; with ``slack`` 1 one that is crossed only once the springs carry nothing. [m], [1]
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
    slip_bell: float = 0.0
    zeta_s: float = 0.0
    p: float = 0.0
    q: float = 0.0
    psi_0: float = 1.0
    delta_psi: float = 0.0
    lambda_: float = 1.0
    pinch_bell: float = 0.0
    pinch: float = 0.0
    pinch_width: float = 1.0
    wear_energy: float = 0.0
    wear_path: float = 0.0
    wear_time: float = 0.0
    wear_power: float = 1.0
    wear_saturates: float = 0.0
    eta_wear: float = 0.0
    nu_wear: float = 0.0
    slip_wear: float = 0.0
    phi_wear: float = 0.0
    g_wear: float = 0.0
    phi: float = 0.0
    phi_drift_rate: float = 0.0
    phi_drift: float = 0.0
    k3: float = 0.0
    c2: float = 0.0
    k_power: float = 0.0
    drift_power: float = 1.0
    c_power: float = 0.0
    rate_power: float = 1.0
    F_c: float = 0.0
    v0: float = 1.0
    F_root: float = 0.0
    F_bristle: float = 0.0
    bristle: float = 1.0
    F_arctan: float = 0.0
    F_stribeck: float = 0.0
    stribeck: float = 0.0
    v_stribeck: float = 1.0
    F_pressed: float = 0.0
    u_pressed: float = 1.0
    k_g: float = 0.0
    g: float = 0.0
    k_g_side: float = 0.0
    k_g_soft: float = 0.0
    gap_width: float = 1.0
    k_hertz: float = 0.0
    k_jump: float = 0.0
    k_time: float = 0.0
    k_ramp: float = 0.0
    k_fade: float = 0.0
    k_fade_time: float = 1.0
    k_m: float = 0.0
    tau: float = 1.0
    b: float = 0.0
    slack: float = 0.0
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
    """Bound ``(1 / (beta + gamma))^(1/n)`` [m] of the hysteretic displacement without degradation; none if linear."""
    if p.beta + p.gamma == 0.0:
        return math.inf
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
    if p.k_fade != 0.0:
        breathing *= 1.0 - p.k_fade * (1.0 - math.exp(-t / p.k_fade_time))
    return (p.k + p.k_jump * share) * breathing


def _wear(p: Storey, t: float, eps: float, path: float) -> float:
    x = 0.0
    if p.wear_energy > 0.0:
        x = max(eps, 0.0) / p.wear_energy
    elif p.wear_path > 0.0:
        x = path / p.wear_path
    elif p.wear_time > 0.0:
        x = t / p.wear_time
    if p.wear_saturates > 0.0:
        return 1.0 - math.exp(-x)
    return float(x**p.wear_power)


def _play_rate(position: float, half_width: float, v: float) -> float:
    """Rate of the position in a play: with the drift until it meets a side, and again at once when the drift turns."""
    return 0.0 if position * v > 0.0 and abs(position) >= half_width else v


def _slack_rate(position: float, half_width: float, v: float, force: float) -> float:
    """Rate of the position in slack: none while the springs unload, then that in a play."""
    return 0.0 if force * v < 0.0 else play_rate(position, half_width, v)


def _stop_rate(deflection: float, limit: float, v: float) -> float:
    """Rate of a spring-like deflection that moves with v until it reaches its limit."""
    if deflection * v <= 0.0:
        return v
    # Never below zero: a step that oversteps the limit stays where it is.
    return v * max(1.0 - abs(deflection / limit) ** BRISTLE_EXPONENT, 0.0)


def _pinch_bell(kind: float, x: float) -> float:
    if kind == 1.0:
        return 1.0 / math.cosh(min(abs(x), 300.0))
    if kind == 2.0:
        return max(1.0 - abs(x), 0.0)
    return math.exp(-x * x)


def _slip_density(kind: float, z: float, sigma: float) -> float:
    """Bells of area 2 over z: what slips while z goes from one side to the other is 2 s."""
    if kind == 1.0:
        return 1.0 / (sigma * math.cosh(min(abs(z) / sigma, 300.0)) ** 2)
    if kind == 2.0:
        return 2.0 / math.pi * sigma / (sigma**2 + z**2)
    if kind == 3.0:
        return math.exp(-((z / sigma) ** 4)) / (math.gamma(1.25) * sigma)
    return math.sqrt(2.0 / math.pi) / sigma * math.exp(-0.5 * (z / sigma) ** 2)


def _pinching(p: Storey, v: float, z: float, eps: float) -> float:
    h = 1.0
    if p.zeta_s != 0.0:
        z1 = p.zeta_s * (1.0 - math.exp(-p.p * eps))
        z2 = (p.psi_0 + p.delta_psi * eps) * (p.lambda_ + z1)
        centre = p.q * (1.0 / (p.beta + p.gamma)) ** (1.0 / p.n)
        h -= z1 * pinch_bell(p.pinch_bell, (z * sign(v) - centre) / z2)
    if p.pinch != 0.0:
        h -= p.pinch / (1.0 + (z / p.pinch_width) ** 2)
    return h


def _hysteretic_rate(p: Storey, u: float, v: float, z: float, eps: float, worn: float) -> float:
    bracket = p.beta * sign(z * v) + p.gamma + (p.phi + p.phi_wear * worn) * (sign(z) + sign(v))
    bracket += p.phi_drift_rate * sign(u) * sign(v) + p.phi_drift * sign(u)
    nu = 1.0 + p.delta_nu * eps + p.nu_wear * worn
    eta = 1.0 + p.delta_eta * eps + p.eta_wear * worn
    f: float = (1.0 - nu * float(abs(z) ** p.n) * bracket) / eta
    f *= pinching(p, v, z, eps)
    if p.delta_s == 0.0 and p.slip_wear == 0.0:
        return f * v
    slip = p.delta_s * eps + p.slip_wear * worn
    compliance: float = slip * slip_density(p.slip_bell, z, p.sigma)
    return f * v / (1.0 + compliance * f)


def _stops(p: Storey, u: float, worn: float) -> float:
    beyond = max(abs(u) - (p.g + p.g_wear * worn), 0.0)
    force: float = p.k_g * beyond * sign(u) + p.k_g_side * max(u - p.g, 0.0) + p.k_hertz * beyond**1.5 * sign(u)
    if p.k_g_soft != 0.0:
        beyond = (abs(u) - p.g) / p.gap_width
        soft = beyond if beyond > 30.0 else math.log1p(math.exp(beyond))
        at_rest = math.log1p(math.exp(-p.g / p.gap_width))
        force += p.k_g_soft * p.gap_width * (soft - at_rest) * sign(u)
    return force


def _friction(p: Storey, u: float, v: float) -> float:
    force = 0.0
    if p.F_c != 0.0:
        force += p.F_c * math.tanh(v / p.v0)
    if p.F_root != 0.0:
        force += p.F_root * v / math.sqrt(v * v + p.v0 * p.v0)
    if p.F_arctan != 0.0:
        force += p.F_arctan * 2.0 / math.pi * math.atan(v / p.v0)
    if p.F_stribeck != 0.0:
        force += p.F_stribeck * (1.0 + p.stribeck * math.exp(-((v / p.v_stribeck) ** 2))) * math.tanh(v / p.v0)
    if p.F_pressed != 0.0:
        force += p.F_pressed * (1.0 + abs(u) / p.u_pressed) * math.tanh(v / p.v0)
    return force


def _rate_force(p: Storey, u: float, v: float) -> float:
    force: float = p.c * v + p.c2 * v * abs(v) + friction(p, u, v)
    if p.c_power != 0.0:
        force += p.c_power * sign(v) * abs(v) ** p.rate_power
    if p.c_soft != 0.0:
        force += p.c_soft * v * math.exp(-abs(v) / p.v_soft)
    if p.c_root != 0.0:
        force += p.c_root * v / (v * v + 1e-8) ** 0.25
    return force


def _drift_force(p: Storey, u: float, worn: float) -> float:
    force: float = p.k3 * u**3 + stops(p, u, worn)
    if p.k_power != 0.0:
        force += p.k_power * sign(u) * abs(u) ** p.drift_power
    if p.snap != 0.0:
        force -= p.snap * u * math.exp(-(((abs(u) - p.snap_centre) / p.snap_width) ** 2))
    return force


compiled = njit(cache=True, error_model="numpy")
sign = compiled(_sign)
stiffness = compiled(_stiffness)
wear = compiled(_wear)
play_rate = compiled(_play_rate)
slack_rate = compiled(_slack_rate)
stop_rate = compiled(_stop_rate)
pinch_bell = compiled(_pinch_bell)
slip_density = compiled(_slip_density)
pinching = compiled(_pinching)
hysteretic_rate = compiled(_hysteretic_rate)
stops = compiled(_stops)
friction = compiled(_friction)
rate_force = compiled(_rate_force)
drift_force = compiled(_drift_force)
