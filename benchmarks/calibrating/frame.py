"""A second independent simulator: masses that links join, moved by the ground or by forces, solved by Runge-Kutta.

``m_i (x_i'' + a_g) = f_i - sum of the links' forces - c_m m_i x_i'``, x relative to the ground, at rest at first,
ground acceleration and forces linear between samples. A link's law is that of the blind trials' storey; jumps of its
numbers and friction that grows with speed are added here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.simulator import N_OWN, Floats, storey_rates
from benchmarks.blind.storey import Storey, compiled

LEAST_STEPS, MOST_STEPS = 40, 4000
"""Integration steps between two samples."""
SHARE = 0.05
"""Of a link's ``width`` that its drift may change by in a step, at the rate with which the step's sample begins."""


@dataclass(frozen=True, kw_only=True)
class Link(Storey):
    """Numbers of one link. A zero switches an effect off.

    Attributes
    ----------
    low, high : float
        Whole numbers: the nodes that it joins; 0 is the ground.
    c_jump, delta_nu_jump, delta_eta_jump, delta_s_jump : float
        What is added to a number at a time. [N s/m], [1/J], [1/J], [m/J]
    c_time, delta_nu_time, delta_eta_time, delta_s_time : float
        [s]
    speed_stiffness, speed_growth : float
        The hysteretic spring is stiffer by ``speed_stiffness (1 - exp(-speed_growth |v|))``. [N/m], [s/m]
    width : float
        Over which drift the law changes. [m]
    """

    low: float
    high: float
    c_jump: float = 0.0
    c_time: float = 0.0
    delta_nu_jump: float = 0.0
    delta_nu_time: float = 0.0
    delta_eta_jump: float = 0.0
    delta_eta_time: float = 0.0
    delta_s_jump: float = 0.0
    delta_s_time: float = 0.0
    speed_stiffness: float = 0.0
    speed_growth: float = 0.0
    width: float = 1e9


@dataclass(frozen=True, kw_only=True)
class Frame:
    """Masses, the links that join them, and what concerns all of them; no masses in a testing machine.

    Attributes
    ----------
    masses : tuple of float
        Of nodes 1, 2 and so on. [kg]
    links : tuple of Link
    gains, biases : tuple of float
        What the sensor of each node makes of its acceleration. [1], [m/s^2]
    mass_damping : float
        Force ``c_m m_i x_i'`` on every node. [1/s]
    ground_factor : float
        The ground moves by so many times the recorded motion.
    """

    masses: tuple[float, ...]
    links: tuple[Link, ...]
    gains: tuple[float, ...] = ()
    biases: tuple[float, ...] = ()
    mass_damping: float = 0.0
    ground_factor: float = 1.0


def accelerations(frame: Frame, ground: Floats, forces: Floats, time_step: float) -> Floats:
    """What the sensors of the nodes show, ``(n_nodes, n_times)`` [m/s^2]; not finite where the structure blew up.

    Parameters
    ----------
    frame : Frame
    ground : (n_times,) array
        Ground acceleration as recorded. [m/s^2]
    forces : (n_nodes, n_times) array
        From outside. [N]
    time_step : float
        Time between samples. [s] A number that jumps does so at the nearest integration step.
    """
    links, masses = packed(frame.links), np.array(frame.masses)
    total: Floats = integrate(links, masses, frame.mass_damping, frame.ground_factor * ground, forces, time_step)
    shown: Floats = np.array(frame.gains)[:, None] * total.T + np.array(frame.biases)[:, None]
    return shown


def packed(links: Sequence[Link]) -> NDArray[np.void]:
    """Numbers as a structured array, whose fields the compiled code reads by name.

    In another order than a storey's: Numba takes a record that begins as another for a subtype of it, with a warning.
    """
    kind = np.dtype([(item.name, np.float64) for item in reversed(fields(Link))])
    return np.array([astuple(link)[::-1] for link in links], dtype=kind)


def _jumped(links: NDArray[np.void], t: float, now: NDArray[np.void]) -> None:
    """The links' numbers at a time, written to ``now``."""
    for i in range(len(links)):
        p = links[i]
        now[i].c = p.c + (p.c_jump if t >= p.c_time else 0.0)
        now[i].delta_nu = p.delta_nu + (p.delta_nu_jump if t >= p.delta_nu_time else 0.0)
        now[i].delta_eta = p.delta_eta + (p.delta_eta_jump if t >= p.delta_eta_time else 0.0)
        now[i].delta_s = p.delta_s + (p.delta_s_jump if t >= p.delta_s_time else 0.0)


def _rates(
    links: NDArray[np.void],
    masses: Floats,
    damping: float,
    t: float,
    t_step: float,
    ground: float,
    force: Floats,
    y: Floats,
    dy: Floats,
    total: Floats,
) -> None:
    """Rates of the state, x, x' and the links' own, and the nodes' total accelerations."""
    n = len(masses)
    total[:] = force
    for i in range(len(links)):
        p = links[i]
        low, high = int(p.low), int(p.high)
        u = y[high - 1] - (y[low - 1] if low > 0 else 0.0)
        v = y[n + high - 1] - (y[n + low - 1] if low > 0 else 0.0)
        first = 2 * n + N_OWN * i
        pull = storey_rates(p, t, t_step, u, v, y[first : first + N_OWN], dy[first : first + N_OWN])
        pull += p.speed_stiffness * (1.0 - np.exp(-p.speed_growth * abs(v))) * y[first]
        total[high - 1] -= pull
        if low > 0:
            total[low - 1] += pull
    for i in range(n):
        total[i] = total[i] / masses[i] - damping * y[n + i]
        dy[i], dy[n + i] = y[n + i], total[i] - ground


def _steps(links: NDArray[np.void], n: int, y: Floats, time_step: float) -> int:
    """How many steps the next sample takes."""
    fastest = 0.0
    for i in range(len(links)):
        low, high = int(links[i].low), int(links[i].high)
        v = y[n + high - 1] - (y[n + low - 1] if low > 0 else 0.0)
        fastest = max(fastest, abs(v) / links[i].width)
    wanted = min(time_step * fastest / SHARE, 1.0 * MOST_STEPS)
    return max(int(np.ceil(wanted)), LEAST_STEPS) if wanted == wanted else LEAST_STEPS


def _integrate(
    links: NDArray[np.void], masses: Floats, damping: float, ground: Floats, forces: Floats, time_step: float
) -> Floats:
    """Total accelerations ``(n_times, n_nodes)`` at the samples."""
    n, n_times = len(masses), len(ground)
    found = np.zeros((n_times, n))
    y = np.zeros(2 * n + N_OWN * len(links))
    stage, k1, k2, k3, k4 = np.zeros_like(y), np.zeros_like(y), np.zeros_like(y), np.zeros_like(y), np.zeros_like(y)
    unused, now, still = np.zeros(n), links.copy(), np.zeros(n)
    for j in range(n_times):
        t0, last = j * time_step, j + 1 == n_times
        steps = steps_of(links, n, y, time_step)
        h = time_step / steps
        rise = 0.0 if last else (ground[j + 1] - ground[j]) / time_step
        push = still if last else (forces[:, j + 1] - forces[:, j]) / time_step
        for s in range(1 if last else steps):
            t = t0 + s * h
            middle = t + 0.5 * h
            jumped(links, middle, now)
            begin, half, end = s * h, (s + 0.5) * h, (s + 1) * h
            a, f = ground[j], forces[:, j]
            out = found[j] if s == 0 else unused
            rates(now, masses, damping, t, middle, a + rise * begin, f + push * begin, y, k1, out)
            if last:
                break
            stage[:] = y + 0.5 * h * k1
            rates(now, masses, damping, middle, middle, a + rise * half, f + push * half, stage, k2, unused)
            stage[:] = y + 0.5 * h * k2
            rates(now, masses, damping, middle, middle, a + rise * half, f + push * half, stage, k3, unused)
            stage[:] = y + h * k3
            rates(now, masses, damping, t + h, middle, a + rise * end, f + push * end, stage, k4, unused)
            y += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return found


jumped = compiled(_jumped)
rates = compiled(_rates)
steps_of = compiled(_steps)
integrate = compiled(_integrate)
