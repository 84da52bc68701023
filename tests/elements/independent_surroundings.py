"""A second implementation of floors, base, ground and sensors, from the written equations.

Nothing of the package is used; the storey law is that of :mod:`independent`. The states are the floors' displacements
and velocities, relative to the free field, the storeys' own states, those of the masses on the floors and three
of the base. A lag is met by solving for the earlier time, not by interpolation between samples.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from independent import PLAIN, at, between, storey
from scipy.integrate import solve_ivp

NEUTRAL = {
    "k_bend": 0.0, "inv_mu": 0.0, "R_s": 1.0, "m_s": 1.0, "W_s": 1.0, "Y_s": 1.0, "n_s": 2.0, "r_mu": 0.0,
    "a_s": 0.0,
    "c_m": 0.0, "compliance": 0.0, "m_b": 1.0, "c_b": 0.0, "s_g": 1.0,
    "e_m": 0.0, "mu_t": 0.0, "f_t": 1.0, "zeta_t": 0.05, "gain": 1.0, "bias": 0.0, "lag": 0.0,
}  # fmt: skip
OF_THE_BUILDING = (
    "k_bend", "inv_mu", "R_s", "m_s", "W_s", "Y_s", "n_s", "r_mu", "a_s", "c_m", "compliance", "m_b", "c_b", "s_g"
)  # fmt: skip


class Building:
    """Floors of given masses on one base; ``floors`` and ``storeys`` hold what differs from neutral, place by place."""

    def __init__(
        self, masses: Sequence[float], storeys: list[dict[str, float]], floors: list[dict[str, float]],
        whole: dict[str, float], ground: np.ndarray, dt: float,
    ) -> None:  # fmt: skip
        self.n = len(masses)
        self.storeys = [{**PLAIN, **p} for p in storeys]
        self.floors = [{**NEUTRAL, **p} for p in floors]
        self.whole = {**NEUTRAL, **whole}
        self.mass = np.array([m * (1.0 + p["e_m"]) for m, p in zip(masses, self.floors, strict=True)])
        self.ground, self.dt = ground, dt
        self.times = dt * np.arange(len(ground))
        self.omega = 2.0 * math.pi * np.array([p["f_t"] for p in self.floors])
        self.damping = 2.0 * np.array([p["zeta_t"] for p in self.floors]) * self.omega
        self.share = np.array([p["mu_t"] for p in self.floors])

    def rates(self, t: float, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rates of the states, and the floors' total accelerations."""
        whole, n = self.whole, self.n
        x, w, *inner, mass_x, mass_w = y[:-3].reshape(11, n)
        moves = whole["compliance"] > 0.0 or whole["inv_mu"] > 0.0
        base_x, base_w, mobilised = y[-3:] if moves else (0.0, 0.0, 0.0)
        a_g = whole["s_g"] * np.interp(t, self.times, self.ground)
        u, v = between(x, base_x), between(w, base_w)
        states = (row.tolist() for row in (u, v, *inner))
        parts = [storey(at(p, t), *state) for p, *state in zip(self.storeys, *states, strict=True)]
        force, *inner_rates = (np.array(part) for part in zip(*parts, strict=True))
        for floor in range(n - 1):  # a hinge's moment at each floor, from the difference of the drifts beside it
            moment = whole["k_bend"] * (u[floor + 1] - u[floor])
            force[floor] -= moment
            force[floor + 1] += moment
        pull = self.damping * mass_w + self.omega**2 * mass_x
        push = self.share * self.mass * pull - force - whole["c_m"] * self.mass * w
        push[:-1] += force[1:]
        total = push / self.mass
        base_rates = np.zeros(3)
        if whole["compliance"] > 0.0:
            spring = base_x / whole["compliance"] + whole["c_b"] * base_w
            base_rates[:2] = base_w, (force[0] - spring) / whole["m_b"] - a_g
        if whole["inv_mu"] > 0.0:  # a dish, and a contact that is an elastic spring until friction is reached
            stuck = 1.0 - abs(mobilised) ** whole["n_s"] if mobilised * base_w > 0.0 else 1.0
            slow, fast = (1.0 - whole["r_mu"]) / whole["inv_mu"], 1.0 / whole["inv_mu"]
            friction = fast - (fast - slow) * math.exp(-whole["a_s"] * abs(base_w))
            held = whole["W_s"] * (base_x / whole["R_s"] + friction * mobilised)
            base_rates[:] = base_w, (force[0] - held) / whole["m_s"] - a_g, stuck * base_w / whole["Y_s"]
        return np.concatenate([w, total - a_g, *inner_rates, mass_w, -pull - total, base_rates]), total

    def respond(self) -> dict[str, np.ndarray]:
        """What each floor's accelerometer shows, and displacements relative to the free field, at the samples."""
        lags = [p["lag"] for p in self.floors]
        n_times = len(self.ground)
        shown, displacement = np.zeros((self.n, n_times)), np.zeros((self.n, n_times))
        y = np.zeros(11 * self.n + 3)
        for j in range(n_times):
            for floor, lag in enumerate(lags):
                if lag == 0.0:
                    shown[floor, j] = self.rates(j * self.dt, y)[1][floor]
            displacement[:, j] = y[: self.n]
            if j + 1 == n_times:
                break
            start, end = j * self.dt, (j + 1) * self.dt
            piece = solve_ivp(
                lambda t, y: self.rates(t, y)[0], (start, end), y, method="DOP853", rtol=1e-10, atol=1e-12,
                dense_output=True,
            )  # fmt: skip
            for floor, lag in enumerate(lags):
                sample = math.ceil((start + lag) / self.dt)
                if lag > 0.0 and sample < n_times and start < sample * self.dt - lag <= end:
                    then = sample * self.dt - lag
                    shown[floor, sample] = self.rates(then, piece.sol(then))[1][floor]
            y = piece.y[:, -1]
        gain = np.array([[p["gain"]] for p in self.floors])
        return {
            "acceleration": gain * shown + np.array([[p["bias"]] for p in self.floors]),
            "displacement": displacement,
        }
