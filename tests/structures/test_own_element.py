"""An element of a user's own, by the Protocol alone: against its equation of motion, with derivatives and effects."""

from __future__ import annotations

import numpy as np
from cable import Cable
from scipy.integrate import solve_ivp

from bwbn_bayes import CubicStiffness, Oscillator, Uniform, el_centro, simulate
from bwbn_bayes.engines.cvodes import Cvodes
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference

MASS, SPRING, DAMPER, CABLE = 2.0, 60.0, 1.0, 90.0
GROUND = el_centro("chopra", duration=10.0)
NOTHING = np.empty((1, 0))


def moved(cubic: float = 0.0) -> np.ndarray:
    def rates(t: float, y: np.ndarray) -> list[float]:
        u, v = y
        force = SPRING * u + DAMPER * v + CABLE * max(u, 0.0) + cubic * u**3
        return [v, -force / MASS - float(np.interp(t, GROUND.times, GROUND.excitation))]

    span = float(GROUND.times[0]), float(GROUND.times[-1])
    return solve_ivp(rates, span, np.zeros(2), "LSODA", GROUND.times, rtol=1e-10, atol=1e-12, max_step=0.01).y[0]


def test_every_engine_solves_it() -> None:
    model, expected = Oscillator(mass=MASS, spring=Cable(k=SPRING, c=DAMPER, k_t=CABLE)), moved()
    for engine in (Lanes(substeps=8), Cvodes(rtol=1e-10, atol=1e-12), Reference()):
        found = engine.simulate(model, NOTHING, GROUND, ["drift_1"]).values[0, 0]
        np.testing.assert_allclose(found, expected, atol=1e-5 * np.max(np.abs(expected)))


def test_effects_act_on_it() -> None:
    model = Oscillator(mass=MASS, spring=Cable(k=SPRING, c=DAMPER, k_t=CABLE)).with_effect(CubicStiffness(k3=800.0))
    found = simulate(model, GROUND, {}, channels=["drift_1"]).channels["drift_1"]
    expected = moved(800.0)
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.max(np.abs(expected)))


def test_its_derivatives_agree_with_finite_differences() -> None:
    model = Oscillator(mass=MASS, spring=Cable(k=SPRING, c=DAMPER, k_t=Uniform(50.0, 150.0)))
    engine, step = Lanes(substeps=8), 0.01
    _, slopes = engine.sensitivities(model, np.array([[CABLE]]), GROUND, ["drift_1"])
    ends = engine.simulate(model, np.array([[CABLE - step], [CABLE + step]]), GROUND, ["drift_1"]).values[:, 0]
    expected = (ends[1] - ends[0]) / (2.0 * step)
    missed = np.sqrt(np.mean(np.square(slopes[0, 0, 0] - expected)) / np.mean(np.square(expected)))
    assert missed < 1e-3
