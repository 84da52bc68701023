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
    "zeta_s": 0.0, "p": 1.0, "q": 0.0, "psi_0": 1.0, "delta_psi": 0.0, "lambda_": 1.0,
}  # fmt: skip


def storey(p: dict[str, float], u: float, v: float, z: float, eps: float) -> tuple[float, float, float]:
    """Storey force with damping, dz/dt and d eps/dt."""
    nu = 1.0 + p["delta_nu"] * eps
    eta = 1.0 + p["delta_eta"] * eps
    shape = p["beta"] * np.sign(z * v) + p["gamma"]
    f = (p["A"] - nu * abs(z) ** p["n"] * shape) / eta
    z1 = p["zeta_s"] * (1.0 - math.exp(-p["p"] * eps))
    if z1 != 0.0:
        z2 = (p["psi_0"] + p["delta_psi"] * eps) * (p["lambda_"] + z1)
        z_u = (1.0 / (p["beta"] + p["gamma"])) ** (1.0 / p["n"])
        f *= 1.0 - z1 * math.exp(-((z * np.sign(v) - p["q"] * z_u) ** 2) / z2**2)
    slip = p["delta_s"] * eps * math.sqrt(2.0 / math.pi) / p["sigma"] * math.exp(-0.5 * (z / p["sigma"]) ** 2)
    spring = (1.0 - p["alpha"]) * p["k"] * z
    return p["alpha"] * p["k"] * u + spring + p["c"] * v, f * v / (1.0 + slip * f), spring * v


def respond(
    storeys: list[dict[str, float]], masses: list[float], ground: np.ndarray, dt: float, jump_time: float = math.inf
) -> dict[str, np.ndarray]:
    """Floor accelerations, drifts, z and eps at the samples; ``X_jump`` is added to X from ``jump_time`` on."""
    before = [{**PLAIN, **{k: v for k, v in p.items() if not k.endswith("_jump")}} for p in storeys]
    after = [{k: v + p.get(f"{k}_jump", 0.0) for k, v in b.items()} for b, p in zip(before, storeys, strict=True)]
    m, n = np.asarray(masses), len(masses)

    def rates(t: float, y: np.ndarray, parameters: list[dict[str, float]]) -> tuple[np.ndarray, np.ndarray]:
        x, w, z, eps = y.reshape(4, n)
        u, v = np.diff(x, prepend=0.0), np.diff(w, prepend=0.0)
        parts = [storey(p, *state) for p, *state in zip(parameters, u, v, z, eps, strict=True)]
        force, dz, deps = (np.array(part) for part in zip(*parts, strict=True))
        total = (np.append(force[1:], 0.0) - force) / m
        relative = total - np.interp(t, dt * np.arange(len(ground)), ground)
        return np.concatenate([w, relative, dz, deps]), total

    y = np.zeros(4 * n)
    states, accelerations = [y], [rates(0.0, y, before)[1]]
    for j in range(len(ground) - 1):
        start, end = j * dt, (j + 1) * dt
        inner = [jump_time] if start < jump_time < end else []
        for left, right in pairwise([start, *inner, end]):
            now = after if left >= jump_time else before
            piece = solve_ivp(
                lambda t, y, now=now: rates(t, y, now)[0], (left, right), y, method="DOP853", rtol=1e-10, atol=1e-12
            )
            y = piece.y[:, -1]
        states.append(y)
        accelerations.append(rates(end, y, after if end >= jump_time else before)[1])
    table = np.array(states).reshape(-1, 4, n)
    return {
        "acceleration": np.array(accelerations).T,
        "drift": np.diff(table[:, 0], prepend=0.0, axis=1).T,
        "hysteretic_displacement": table[:, 2].T,
        "hysteretic_energy": table[:, 3].T,
    }
