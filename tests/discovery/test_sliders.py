"""What sliders are by speed is taken up by their own friction, not by a second effect in the building above."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from bwbn_bayes import DiscoverySettings, Linear, LogNormal, ShearBuilding, discover, el_centro
from bwbn_bayes.elements.effects import SlidingBase, SuddenDamage
from bwbn_bayes.parameters import Floats

GROUND = el_centro("chopra", duration=12.0)
GRAVITY = 9.80665
FLOOR, SLAB, K, C = 1.0, 1.2, 60.0, 0.4
"""[kg], [kg], [N/m], [N s/m]"""
FAST, SLOW, SPEED, GIVE, RADIUS = 0.10, 0.04, 1 / 30, 0.0004, 1.2
"""Friction at speed and near rest, between which 33 mm/s lie, of a contact of 0.4 mm on a dish. [m]"""


def shown() -> tuple[Floats, Floats]:
    """Drift [m] and total acceleration [m/s^2] of one storey on a slab that slides, by SciPy."""
    weight = GRAVITY * (FLOOR + SLAB)

    def rates(t: float, y: Floats) -> list[float]:
        u, v, x, w, q = y
        a_g = float(np.interp(t, GROUND.times, GROUND.excitation))
        storey = K * u + C * v
        friction = FAST - (FAST - SLOW) * np.exp(-abs(w) / SPEED)
        slab = (storey - weight * (x / RADIUS + friction * q)) / SLAB - a_g
        stuck = 1.0 - q * q if q * w > 0.0 else 1.0
        return [v, -storey / FLOOR - a_g - slab, w, slab, stuck * w / GIVE]

    span = float(GROUND.times[0]), float(GROUND.times[-1])
    found = solve_ivp(rates, span, np.zeros(5), "LSODA", GROUND.times, rtol=1e-8, atol=1e-10, max_step=0.01)
    return found.y[0], -(K * found.y[0] + C * found.y[1]) / FLOOR


def test_sliders_by_speed_are_named_alone() -> None:
    """Held at one friction they left more than noise: the verdict was that something without a name is part of it."""
    rng = np.random.default_rng(3)
    drift, acceleration = (y + 0.02 * np.std(y) * rng.standard_normal(len(y)) for y in shown())
    record = GROUND.with_channels({"drift_1": drift, "acceleration_1": acceleration})
    fixed = ShearBuilding(masses=[FLOOR], storey=Linear(k=LogNormal(60.0, 0.5), c=LogNormal(0.5, 1.0)))
    settings = DiscoverySettings(effects=(SlidingBase, SuddenDamage), n_workers=1, particles=200)
    found = discover(fixed, record, settings=settings)
    assert found.verdict == "effects_found"
    assert [one.hypothesis.name for one in found.added] == ["sliding_base"]
    assert found.added[0].grade == "named"
    (mean, sd), (missing, error) = (found.added[0].moments[name] for name in ("inv_mu", "r_mu"))
    # The effect knows the weight of a slab like the floor.
    truth = 2.0 * FLOOR / (FLOOR + SLAB) / FAST
    assert abs(mean - truth) < 4.0 * sd < 0.1 * truth
    assert abs(missing - (1.0 - SLOW / FAST)) < 4.0 * error < 0.1
