"""A second implementation of the storey law, from the written equations: NumPy and SciPy only, nothing of the package.

Sources: Baber and Noori 1985 (series slip-lock), Foliente 1995 (pinching multiplier, z_u as OpenSees has it),
Zhao et al. 2019 eqs. 1 to 7 with the corrections stated in the project's physics notes.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

PLAIN = {
    "k": 10.0, "c": 0.05, "alpha": 0.01, "A": 1.0, "beta": 2.0, "gamma": 2.0, "n": 1.5,
    "delta_nu": 0.0, "delta_eta": 0.0, "delta_s": 0.0, "sigma": 1.0,
    "nu_inf": 0.0, "p_nu": 1.0, "eta_inf": 0.0, "p_eta": 1.0, "theta_nu": 0.0, "theta_eta": 0.0,
    "nu_a": 0.0, "s_nu": 1.0, "q_nu": 1.0, "N_nu": 1.0, "u_nu": 1.0,
    "eta_a": 0.0, "s_eta": 1.0, "q_eta": 1.0, "N_eta": 1.0, "u_eta": 1.0,
    "zeta_s": 0.0, "p": 1.0, "q": 0.0, "psi_0": 1.0, "delta_psi": 0.0, "lambda_": 1.0,
    "phi": 0.0, "phi_uv": 0.0, "u_uv": 1.0, "phi_u": 0.0, "u_u": 1.0, "k3": 0.0, "c2": 0.0, "k_geo": 0.0,
    "F_v": 0.0, "p_v": 1.0, "v_v": 1.0,
    "F_c": 0.0, "v0": 1.0, "F_ratio": 0.0, "v_ratio": 1.0, "F_root": 0.0, "v_root": 1.0,
    "F_dahl": 0.0, "x_dahl": 1.0, "b_0": 0.0, "w_0": 1.0,
    "k_g": 0.0, "g": 1.0, "k_gp": 0.0, "g_p": 1.0, "k_gn": 0.0, "g_n": 1.0,
    "k_m": 0.0, "tau": 1.0, "b": 0.0, "w": 1.0, "k_ramp": 0.0, "k_ramp_time": 0.0, "k_ramp_duration": 1.0,
}  # fmt: skip


def storey(p: dict[str, float], u: float, v: float, *states: float) -> tuple[float, ...]:
    """Storey force with damping, and the rates of its states.

    The states are z, eps, a Maxwell branch's force q, the place d in a play, the deflection of a contact that sticks,
    the path and the place s in slack [m], and excursions that wear the strength, and the stiffness.
    """
    z, eps, q, d, stuck, path, s, *worn = states
    worn = worn or [0.0, 0.0]
    beside = parallel_force(p, u, v) + q + p["F_dahl"] / p["x_dahl"] * stuck + p["c"] * v
    stuck_rate = v * (1.0 - stuck / p["x_dahl"] * sign(v))
    q_rate = p["k_m"] * v - q / p["tau"]
    path_rate = abs(v)
    worn_rates = [
        (p[f"q_{one}"] + 1.0) * abs(v) / p[f"u_{one}"] * abs(u / p[f"u_{one}"]) ** p[f"q_{one}"]
        for one in ("nu", "eta")
    ]
    d_rate = v * min(max((p["b"] - d * sign(v)) / p["w"], 0.0), 1.0)
    u_turn = {width: math.tanh(u / p[width]) for width in ("u_uv", "u_u")}
    loose = min(max(1.0 + sign(v) / p["w_0"] * (p["alpha"] * (u - s) + (1.0 - p["alpha"]) * z), 0.0), 1.0)
    s_rate = v * loose * min(max((p["b_0"] - s * sign(v)) / p["w_0"], 0.0), 1.0)
    u, v = u - d - s, v - d_rate - s_rate
    nu = 1.0 + p["delta_nu"] * eps + p["nu_inf"] * (1.0 - math.exp(-p["p_nu"] * eps)) + p["theta_nu"] * path
    eta = 1.0 + p["delta_eta"] * eps + p["eta_inf"] * (1.0 - math.exp(-p["p_eta"] * eps)) + p["theta_eta"] * path
    nu += p["nu_a"] * (worn[0] / p["N_nu"]) ** (p["s_nu"] / (p["q_nu"] + 1.0))
    eta += p["eta_a"] * (worn[1] / p["N_eta"]) ** (p["s_eta"] / (p["q_eta"] + 1.0))
    shape = p["beta"] * sign(z * v) + p["gamma"] + p["phi"] * (sign(z) + sign(v))
    shape += p["phi_uv"] * u_turn["u_uv"] * sign(v) + p["phi_u"] * u_turn["u_u"]
    f = (p["A"] - nu * abs(z) ** p["n"] * shape) / eta
    z1 = p["zeta_s"] * (1.0 - math.exp(-p["p"] * eps))
    if z1 != 0.0:
        z2 = (p["psi_0"] + p["delta_psi"] * eps) * (p["lambda_"] + z1)
        z_u = (1.0 / (p["beta"] + p["gamma"])) ** (1.0 / p["n"])
        f *= 1.0 - z1 * math.exp(-((z * sign(v) - p["q"] * z_u) ** 2) / z2**2)
    slip = p["delta_s"] * eps * math.sqrt(2.0 / math.pi) / p["sigma"] * math.exp(-0.5 * (z / p["sigma"]) ** 2)
    spring = (1.0 - p["alpha"]) * p["k"] * z
    rates = (
        f * v / (1.0 + slip * f),
        spring * v,
        q_rate,
        d_rate,
        stuck_rate,
        path_rate,
        s_rate,
        *worn_rates[: len(states) - 7],
    )
    return p["alpha"] * p["k"] * u + spring + beside, *rates


def parallel_force(p: dict[str, float], u: float, v: float) -> float:
    """What stands beside the springs: hardening, dampers, friction, stops."""
    friction = p["F_c"] * math.tanh(v / p["v0"])
    friction += p["F_ratio"] * v / (abs(v) + p["v_ratio"]) + p["F_root"] * v / math.hypot(v, p["v_root"])
    friction += p["F_v"] * v / p["v_v"] * math.hypot(v / p["v_v"], 0.002) ** (p["p_v"] - 1.0)
    stops = p["k_g"] * max(abs(u) - p["g"], 0.0) * sign(u)
    stops += p["k_gp"] * max(u - p["g_p"], 0.0) - p["k_gn"] * max(-u - p["g_n"], 0.0)
    return float(p["k3"] * u**3 - p["k_geo"] * u + p["c2"] * v * abs(v) + friction + stops)


def sign(x: float) -> float:
    """1, 0 or -1: of single numbers, asked too often for NumPy."""
    return math.copysign(1.0, x) if x else 0.0


def between(heights: np.ndarray, base: float = 0.0) -> np.ndarray:
    """What each stands above the one below, the first above the base."""
    found = heights.copy()
    found[1:] -= heights[:-1]
    found[0] -= base
    return found


def at(p: dict[str, float], t: float) -> dict[str, float]:
    """Parameters at a time: a ramp of k has gone so far."""
    if p["k_ramp"] == 0.0:
        return p
    share = min(max((t - p["k_ramp_time"]) / p["k_ramp_duration"], 0.0), 1.0)
    return {**p, "k": p["k"] + share * p["k_ramp"]}


def respond(
    storeys: list[dict[str, float]], masses: list[float], ground: np.ndarray, dt: float, jump_time: float = math.inf
) -> dict[str, np.ndarray]:
    """Floor accelerations, drifts, z and eps at the samples; ``X_jump`` is added to X from ``jump_time`` on.

    ``X_offset`` is added to X throughout.
    """
    own = [{**p, **{k: PLAIN[k] + p.get(f"{k}_offset", 0.0) for k in PLAIN if f"{k}_offset" in p}} for p in storeys]
    before = [{**PLAIN, **{k: v for k, v in p.items() if k in PLAIN}} for p in own]
    after = [{k: v + p.get(f"{k}_jump", 0.0) for k, v in b.items()} for b, p in zip(before, storeys, strict=True)]
    m, n, times = np.asarray(masses), len(masses), dt * np.arange(len(ground))

    def rates(t: float, y: np.ndarray, parameters: list[dict[str, float]]) -> tuple[np.ndarray, np.ndarray]:
        x, w, *others = y.reshape(11, n)
        rows = (row.tolist() for row in (between(x), between(w), *others))
        parts = [storey(at(p, t), *state) for p, *state in zip(parameters, *rows, strict=True)]
        force, *inner_rates = (np.array(part) for part in zip(*parts, strict=True))
        total = -force / m
        total[:-1] += force[1:] / m[:-1]
        relative = total - np.interp(t, times, ground)
        return np.concatenate([w, relative, *inner_rates]), total

    ends = [p["k_ramp_time"] + share * p["k_ramp_duration"] for p in before if p["k_ramp"] for share in (0.0, 1.0)]
    breaks = sorted({jump_time, *ends})
    y = np.zeros(11 * n)
    states, accelerations = [y], [rates(0.0, y, before)[1]]
    for j in range(len(ground) - 1):
        start, end = j * dt, (j + 1) * dt
        inner = [t for t in breaks if start < t < end]
        for left, right in pairwise([start, *inner, end]):
            now = after if left >= jump_time else before
            piece = solve_ivp(
                lambda t, y, now=now: rates(t, y, now)[0], (left, right), y, method="DOP853", rtol=1e-10, atol=1e-12
            )
            y = piece.y[:, -1]
        states.append(y)
        accelerations.append(rates(end, y, after if end >= jump_time else before)[1])
    table = np.array(states).reshape(-1, 11, n)
    return {
        "acceleration": np.array(accelerations).T,
        "drift": np.diff(table[:, 0], prepend=0.0, axis=1).T,
        "hysteretic_displacement": table[:, 2].T,
        "hysteretic_energy": table[:, 3].T,
    }
