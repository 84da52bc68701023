"""A storey as a specimen: its displacement is imposed, its force follows; the same laws, along the path."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.simulator import N_OWN, Floats, packed, storey_rates
from benchmarks.blind.storey import Storey, compiled, ultimate_displacement

FINE, COARSE = 100.0, 15.0
"""Steps per bound of z: for records, and for fits (0.1 % of the force and less)."""


@dataclass(frozen=True, kw_only=True)
class Loop:
    """What a specimen does along an imposed displacement.

    Attributes
    ----------
    displacement, force, hysteretic_displacement, energy, path : (n_points,) array
        [m], [N], [m], [J], [m]
    """

    displacement: Floats
    force: Floats
    hysteretic_displacement: Floats
    energy: Floats
    path: Floats

    @property
    def finite(self) -> bool:
        """Whether every number is finite."""
        return bool(np.isfinite(self.force).all() and np.isfinite(self.energy).all())


def follow(storey: Storey, displacement: Floats, steps: float = FINE) -> Loop:
    """Force of a specimen at rest at first, along a displacement that is straight between its points.

    Points are one second apart: what depends on rate or time takes them so.

    Parameters
    ----------
    storey : Storey
        The law.
    displacement : (n_points,) array
        From zero. [m]
    steps : float
        Integration steps per bound of z; at least one between two points.
    """
    law = packed([storey], Storey)
    force, own = follow_law(law, displacement, ultimate_displacement(storey) / steps)
    return Loop(
        displacement=displacement, force=force, hysteretic_displacement=own[:, 0], energy=own[:, 1], path=own[:, 5]
    )


def with_shape(storey: Storey, numbers: Floats) -> Storey:
    """The storey with another plain law: log k, alpha, log of the bound of z, beta / (beta + gamma), n."""
    log_k, alpha, log_bound, rho, n = numbers.tolist()
    both = math.exp(-n * log_bound)
    return replace(storey, k=math.exp(log_k), alpha=alpha, beta=rho * both, gamma=(1.0 - rho) * both, n=n)


def _follow_law(law: NDArray[np.void], displacement: Floats, longest: float) -> tuple[Floats, Floats]:
    """Forces ``(n_points,)`` and the storey's own states ``(n_points, N_OWN)``."""
    p, n_points = law[0], len(displacement)
    force, states = np.zeros(n_points), np.zeros((n_points, N_OWN))
    own, stage = np.zeros(N_OWN), np.zeros(N_OWN)
    k1, k2, k3, k4 = np.zeros(N_OWN), np.zeros(N_OWN), np.zeros(N_OWN), np.zeros(N_OWN)
    for j in range(n_points - 1):
        start, v = displacement[j], displacement[j + 1] - displacement[j]
        n_steps = max(math.ceil(abs(v) / longest), 1)
        h = 1.0 / n_steps
        for s in range(n_steps):
            t, u = j + s * h, start + v * s * h
            storey_rates(p, t, t, u, v, own, k1)
            stage[:] = own + 0.5 * h * k1
            storey_rates(p, t + 0.5 * h, t, u + 0.5 * h * v, v, stage, k2)
            stage[:] = own + 0.5 * h * k2
            storey_rates(p, t + 0.5 * h, t, u + 0.5 * h * v, v, stage, k3)
            stage[:] = own + h * k3
            storey_rates(p, t + h, t, u + h * v, v, stage, k4)
            own += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            own[4] = min(max(own[4], -p.b), p.b)
        states[j + 1] = own
        force[j + 1] = storey_rates(p, j + 1.0, j + 1.0, displacement[j + 1], v, own, k1)
    return force, states


follow_law = compiled(_follow_law)
