"""The independent simulator: a base-excited shear building, classical Runge-Kutta at a fixed step, compiled by numba.

``m_i (1 + e_i) (x_i'' + a_g) = -F_i + F_{i+1} - c_m m_i x_i'``, x relative to the ground, at rest at first, ground
acceleration linear between samples. Floors measure ``x_i'' + a_g``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from benchmarks.blind.storey import (
    Storey,
    compiled,
    drift_force,
    hysteretic_rate,
    play_rate,
    rate_force,
    slack_rate,
    stiffness,
    stop_rate,
    wear,
)

Floats = NDArray[np.float64]

STEPS_PER_SAMPLE = 80
"""At 50 samples a second: 4 kHz."""

N_OWN = 6
"""States of a storey besides its floor's motion: z, eps, Maxwell force, bristle, play, path."""


@dataclass(frozen=True, kw_only=True)
class Whole:
    """What concerns the building as a whole; zero switches an effect off.

    Attributes
    ----------
    base_compliance, base_mass, base_damping : float
        Sway of the base ``m_b (x_b'' + a_g) = F_1 - k_b x_b - c_b x_b'``; compliance ``1 / k_b``. [m/N], [kg], [N s/m]
    slipperiness, slider_give, pendulum : float
        The base slides: in the place of its spring stand that of the pendulum and dry friction, which sticks over the
        deflection ``slider_give`` and slides at ``1 / slipperiness``. [1/N], [m], [N/m]
    coupling : float
        Spring between each storey's drift and the next one's, as bending makes it. [N/m]
    mass_damping : float
        Force ``c_m m_i x_i'`` on every floor. [1/s]
    input_error : float
        The ground moves by ``1 + input_error`` times the recorded motion. [1]
    """

    base_compliance: float = 0.0
    base_mass: float = 1.0
    base_damping: float = 0.0
    slipperiness: float = 0.0
    slider_give: float = 1.0
    pendulum: float = 0.0
    coupling: float = 0.0
    mass_damping: float = 0.0
    input_error: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Building:
    """Storeys from the ground up, and the whole."""

    storeys: tuple[Storey, ...]
    whole: Whole = Whole()


@dataclass(frozen=True, kw_only=True)
class Motion:
    """What the simulator returns.

    Attributes
    ----------
    measured : (n_storeys, n_times) array
        What the sensors show, without noise. [m/s^2]
    drift, drift_rate, hysteretic_displacement, energy : (n_storeys, n_times) array
        Storey histories. [m], [m/s], [m], [J]
    """

    measured: Floats
    drift: Floats
    drift_rate: Floats
    hysteretic_displacement: Floats
    energy: Floats

    @property
    def finite(self) -> bool:
        """Whether every number is finite."""
        return bool(np.isfinite(self.measured).all() and np.isfinite(self.energy).all())


def respond(building: Building, ground: Floats, time_step: float, steps: int = STEPS_PER_SAMPLE) -> Motion:
    """Response of a building to a ground acceleration.

    Parameters
    ----------
    building : Building
        Structure with its effects.
    ground : (n_times,) array
        Ground acceleration as recorded. [m/s^2]
    time_step : float
        Time between samples. [s]
    steps : int
        Integration steps per sample; a sudden change happens at the nearest step.

    Returns
    -------
    Motion
        Not finite where the structure blew up.
    """
    n = len(building.storeys)
    states, fine = integrate(
        packed(building.storeys, Storey), packed([building.whole], Whole), ground, time_step, steps
    )
    table = states[:, : 4 * n].reshape(-1, 4, n)
    base, base_rate = states[:, 8 * n], states[:, 8 * n + 1]
    return Motion(
        measured=np.stack([_sensed(p, fine[:, i], time_step, steps) for i, p in enumerate(building.storeys)]),
        drift=np.diff(table[:, 0], axis=1, prepend=base[:, None]).T,
        drift_rate=np.diff(table[:, 1], axis=1, prepend=base_rate[:, None]).T,
        hysteretic_displacement=table[:, 2].T,
        energy=table[:, 3].T,
    )


def packed(parts: Sequence[Storey] | Sequence[Whole], kind: type[Storey | Whole]) -> NDArray[np.void]:
    """Numbers of a kind as a structured array, whose fields the compiled code reads by name, and no others."""
    names = [item.name for item in fields(kind)]
    rows = [tuple(getattr(part, name) for name in names) for part in parts]
    return np.array(rows, dtype=[(name, np.float64) for name in names])


def _sensed(p: Storey, fine: Floats, time_step: float, steps: int) -> Floats:
    signal = fine[::steps]
    times = time_step * np.arange(len(signal))
    if p.lag != 0.0 and np.isfinite(fine).all():
        spline = CubicSpline(time_step / steps * np.arange(len(fine)), fine)
        signal = np.where(times >= p.lag, spline(np.maximum(times - p.lag, 0.0)), fine[0])
    signal = (1.0 + p.gain_error) * signal + p.bias
    if p.saturation > 0.0:
        signal = p.saturation * np.tanh(signal / p.saturation)
    return signal + p.drift_amplitude * np.sin(2.0 * np.pi * times / p.drift_period)


def _storey_rates(p: Storey, t: float, t_step: float, u: float, v: float, own: Floats, out: Floats) -> float:
    """Storey force with damping; ``own`` holds z, eps, Maxwell force, bristle, play and path, ``out`` their rates."""
    k = stiffness(p, t, t_step)
    taken = u - own[4]
    spring = (1.0 - p.alpha) * k * own[0]
    within = 0.0
    if p.b > 0.0 and p.slack > 0.0:
        within = slack_rate(own[4], p.b, v, p.alpha * k * taken + spring)
    elif p.b > 0.0:
        within = play_rate(own[4], p.b, v)
    rate = v - within
    worn = wear(p, t, own[1], own[5])
    out[0] = hysteretic_rate(p, taken, rate, own[0], own[1], worn)
    out[1] = spring * rate
    out[2] = p.k_m * v - own[2] / p.tau
    out[3] = stop_rate(own[3], p.bristle, v) if p.F_bristle != 0.0 else 0.0
    out[4] = within
    out[5] = abs(rate)
    force = p.alpha * k * taken + spring + own[2] + p.F_bristle * own[3] / p.bristle
    return float(force + rate_force(p, u, v) + drift_force(p, u, worn))


def _rates(
    storeys: Sequence[Storey],
    whole: Whole,
    t: float,
    t_step: float,
    ground: float,
    y: Floats,
    dy: Floats,
    total: Floats,
) -> None:
    """Rates of the state, and the floors' total accelerations.

    The state: x, x', z, eps, Maxwell force, bristle, play, path (each n), base and its rate, appendages and rates (each
    n), deflection of the sliders' contact.
    """
    n = len(storeys)
    base, shaken = 8 * n, (1.0 + whole.input_error) * ground
    force, own, slope = np.empty(n), np.empty(N_OWN), np.empty(N_OWN)
    drift = np.empty(n)
    for i in range(n):
        below = y[i - 1] if i > 0 else y[base]
        below_rate = y[n + i - 1] if i > 0 else y[base + 1]
        drift[i] = y[i] - below
        for j in range(N_OWN):
            own[j] = y[(2 + j) * n + i]
        force[i] = storey_rates(storeys[i], t, t_step, drift[i], y[n + i] - below_rate, own, slope)
        for j in range(N_OWN):
            dy[(2 + j) * n + i] = slope[j]
    for i in range(n - 1):
        bending = (storeys[i].coupling + whole.coupling) * (drift[i] - drift[i + 1])
        force[i] += bending
        force[i + 1] -= bending
    for i in range(n):
        p = storeys[i]
        tuned = base + 2 + i
        apart, apart_rate = y[tuned] - y[i], y[tuned + n] - y[n + i]
        pull = p.appendage_omega * (p.appendage_omega * apart + 2.0 * p.appendage_zeta * apart_rate)
        above = force[i + 1] if i + 1 < n else 0.0
        push = above - force[i] - whole.mass_damping * p.mass * y[n + i] + p.appendage_mass * p.mass * pull
        total[i] = push / (p.mass * (1.0 + p.mass_error))
        dy[i], dy[n + i] = y[n + i], total[i] - shaken
        tunes = 1.0 if p.appendage_mass > 0.0 else 0.0
        dy[tuned], dy[tuned + n] = tunes * y[tuned + n], tunes * (-pull - shaken)
    contact = base + 2 + 2 * n
    dy[base], dy[base + 1], dy[contact] = 0.0, 0.0, 0.0
    if whole.base_compliance > 0.0 or whole.slipperiness > 0.0:
        held = whole.pendulum * y[base] + whole.base_damping * y[base + 1]
        if whole.base_compliance > 0.0:
            held += y[base] / whole.base_compliance
        if whole.slipperiness > 0.0:
            held += y[contact] / (whole.slider_give * whole.slipperiness)
            dy[contact] = stop_rate(y[contact], whole.slider_give, y[base + 1])
        dy[base], dy[base + 1] = y[base + 1], (force[0] - held) / whole.base_mass - shaken


def _integrate(
    storeys: Sequence[Storey], wholes: Sequence[Whole], ground: Floats, time_step: float, steps: int
) -> tuple[Floats, Floats]:
    """States at the samples and total accelerations at every step."""
    n, n_times, h = len(storeys), len(ground), time_step / steps
    whole = wholes[0]
    states = np.zeros((n_times, 10 * n + 3))
    total = np.zeros(((n_times - 1) * steps + 1, n))
    y = np.zeros(10 * n + 3)
    stage, k1, k2, k3, k4 = np.zeros_like(y), np.zeros_like(y), np.zeros_like(y), np.zeros_like(y), np.zeros_like(y)
    unused = np.zeros(n)
    for j in range(n_times - 1):
        slope = (ground[j + 1] - ground[j]) / steps
        for s in range(steps):
            t, a = (j * steps + s) * h, ground[j] + slope * s
            middle = t + 0.5 * h
            rates(storeys, whole, t, middle, a, y, k1, total[j * steps + s])
            stage[:] = y + 0.5 * h * k1
            rates(storeys, whole, middle, middle, a + 0.5 * slope, stage, k2, unused)
            stage[:] = y + 0.5 * h * k2
            rates(storeys, whole, middle, middle, a + 0.5 * slope, stage, k3, unused)
            stage[:] = y + h * k3
            rates(storeys, whole, t + h, middle, a + slope, stage, k4, unused)
            y += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            for i in range(n):
                y[6 * n + i] = min(max(y[6 * n + i], -storeys[i].b), storeys[i].b)
        states[j + 1] = y
    end = (n_times - 1) * time_step
    rates(storeys, whole, end, end + 0.5 * h, ground[-1], y, k1, total[-1])
    return states, total


storey_rates = compiled(_storey_rates)
rates = compiled(_rates)
integrate = compiled(_integrate)
