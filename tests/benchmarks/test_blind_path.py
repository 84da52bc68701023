"""The imposed path: test vectors of an independent code, and every form again by SciPy from equations written here."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from math import atan, cosh, exp, gamma, pi, sqrt, tanh

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.blind.draws import Dice, Hidden, Place, Reached
from benchmarks.blind.more_forms import MORE_FORMS
from benchmarks.blind.path import COARSE, FINE, follow, with_shape
from benchmarks.blind.simulator import Building, Floats
from benchmarks.blind.storey import Storey, ultimate_displacement

K, ALPHA, BETA, GAMMA, N = 30.0, 0.1, 3.0, 1.0, 1.6
BASE = Storey(k=K, c=0.0, alpha=ALPHA, beta=BETA, gamma=GAMMA, n=N)
TURNS = (0.0, 0.3, -0.3, 0.31, -0.3, 0.6, -0.55, 0.62, -0.6, 0.6, -0.9, 0.9, -0.9, 0.85, 0.2)
PATH = np.concatenate([[0.0], *(np.linspace(a, b, 4)[1:] for a, b in pairwise(TURNS))])

# OpenSees' materials BWBN and BoucWen (Foliente's pinch without wear; wear without a pinch), the limit of small steps:
# the law's ODE by LSODA at 1e-11, which OpenSees approaches to 1.6e-5.
BWBN = (
    Storey(
        k=24.877, c=0.0, alpha=0.03, n=1.0, gamma=0.1, beta=0.5,
        q=0.4, zeta_s=0.9, p=1.0, psi_0=0.2, delta_psi=0.001, lambda_=0.05,
    ),
    (1.57, -0.95, 1.64, -0.97, 1.67, -0.94, 3.19, -1.91, 3.35, -1.96, 3.42, -2.04,
     7.74, -5.42, 7.77, -5.29, 7.84, -5.27),
    (16.69693287, -16.68243962, 17.14138224, -16.53218499, 16.9624101, -16.2303473, 20.12005173, -20.51279416,
     21.13281925, -19.68297904, 20.47492662, -19.19924083, 31.98353693, -34.90293732,
     32.70663256, -28.9584941, 29.88534281, -27.1308748),
    1456.38877,
)  # fmt: skip
BOUC_WEN = (
    Storey(k=10.0, c=0.0, alpha=0.03, n=1.5, gamma=2.0, beta=2.0, delta_nu=0.05, delta_eta=0.05),
    (0.5, -0.5, 1.0, -1.0, 1.5, -1.5, 2.0, -2.0),
    (3.17331707, -3.44293619, 3.69330147, -3.45251422, 3.30513168, -3.02622724, 2.9338118, -2.72766956),
    29.43936827,
)


@pytest.mark.parametrize(("storey", "turns", "forces", "energy"), [BWBN, BOUC_WEN], ids=["pinch", "wear"])
def test_the_loop_is_that_of_opensees(
    storey: Storey, turns: tuple[float, ...], forces: tuple[float, ...], energy: float
) -> None:
    loop = follow(storey, np.array([0.0, *turns]), 1000.0)
    np.testing.assert_allclose(loop.force[1:], forces, atol=1e-6)
    assert loop.energy[-1] == pytest.approx(energy, rel=1e-7)
    assert loop.path[-1] == pytest.approx(np.sum(np.abs(np.diff([0.0, *turns]))))
    for steps, off in ((FINE, 1e-6), (COARSE, 1e-4)):
        coarse = follow(storey, np.array([0.0, *turns]), steps).force[1:]
        np.testing.assert_allclose(coarse, forces, atol=off * np.max(np.abs(forces)))


def test_a_shape_is_the_law_in_other_numbers() -> None:
    shaped = with_shape(
        BASE, np.array([np.log(K), ALPHA, np.log(ultimate_displacement(BASE)), BETA / (BETA + GAMMA), N])
    )
    np.testing.assert_allclose(follow(shaped, PATH).force, follow(BASE, PATH).force, rtol=1e-12)


def place() -> Place:
    loop = follow(BASE, PATH)
    at = Reached(
        drift=0.9, rate=float(np.max(np.abs(np.diff(PATH)))), z=float(np.max(np.abs(loop.hysteretic_displacement))),
        z_bound=ultimate_displacement(BASE), force=float(np.max(np.abs(loop.force))), energy=float(np.max(loop.energy)),
        path=float(loop.path[-1]), acceleration=1.0, base_shear=1.0, strong_from=5.0,
        strong_until=25.0, omegas=(1.0,),
    )  # fmt: skip
    return Place(dice=Dice(rng=np.random.default_rng(9)), at=at, building=Building(storeys=(BASE,)), storey=1)


Values = Mapping[str, float]


def worn(name: str, q: Values, t: float, eps: float, path: float) -> float:
    """What has worn, between zero and one or so, in the words of each form."""
    if name in ("stiffness_power", "strength_power"):
        return max(eps / q["wear_energy"], 0.0) ** q["wear_power"]
    if name in ("stiffness_with_cycles", "stop_wearing"):
        return path / q["wear_path"]
    if name == "strength_with_cycles":
        return 1.0 - exp(-path / q["wear_path"])
    if name == "strength_in_time":
        return 1.0 - exp(-t / q["wear_time"])
    return 1.0 - exp(-max(eps, 0.0) / q["wear_energy"]) if "wear_energy" in q else 0.0


def slip_per_z(name: str, q: Values, z: float, w: float, eps: float) -> float:
    """Slip per unit of z: the bell's area is two."""
    x = z / q.get("sigma", 1.0)
    if name == "slip_lorentz":
        return q["delta_s"] * eps * 2.0 / (pi * q["sigma"] * (1.0 + x * x))
    if name == "slip_flat":
        return q["delta_s"] * eps * exp(-(x**4)) / (gamma(1.25) * q["sigma"])
    if name == "slip_saturating":
        return q["slip_wear"] * w * sqrt(2.0 / pi) * exp(-x * x / 2.0) / q["sigma"]
    return 0.0


def pinched(name: str, q: Values, v: float, z: float, eps: float) -> float:
    if not name.startswith("pinch"):
        return 1.0
    depth = q["zeta_s"] * (1.0 - exp(-q["p"] * eps))
    x = (z * np.sign(v) - q["q"] * (1.0 / (BETA + GAMMA)) ** (1.0 / N)) / (q["psi_0"] * (q["lambda_"] + depth))
    return 1.0 - depth * (1.0 / cosh(x) if name == "pinch_sech" else max(1.0 - abs(x), 0.0))


def beside(name: str, q: Values, w: float, u: float, v: float) -> float:
    """Force beside the hysteretic spring."""
    s = float(np.sign(v))
    forces = {
        "friction_arctan": lambda: 2.0 / pi * q["F_arctan"] * atan(v / q["v0"]),
        "friction_stribeck": lambda: (
            q["F_stribeck"] * (1.0 + q["stribeck"] * exp(-((v / q["v_stribeck"]) ** 2))) * tanh(v / q["v0"])
        ),
        "friction_pressed": lambda: q["F_pressed"] * (1.0 + abs(u) / q["u_pressed"]) * tanh(v / q["v0"]),
        "spring_power": lambda: q["k_power"] * np.sign(u) * abs(u) ** q["drift_power"],
        "damper_power": lambda: q["c_power"] * s * abs(v) ** q["rate_power"],
        "stop_hertz": lambda: q["k_hertz"] * max(abs(u) - q["g"], 0.0) ** 1.5 * np.sign(u),
        "stop_wearing": lambda: q["k_g"] * max(abs(u) - q["g"] - q["g_wear"] * w, 0.0) * np.sign(u),
    }
    return float(forces[name]()) if name in forces else 0.0


def by_scipy(name: str, q: Values) -> Floats:
    """Force at the end of every straight piece of the path, by DOP853."""

    def stiffness(t: float) -> float:
        return K * (1.0 - q["k_fade"] * (1.0 - exp(-t / q["k_fade_time"]))) if name == "stiffness_in_time" else K

    state, forces = np.zeros(3), [0.0]
    for j, v in enumerate(np.diff(PATH).tolist()):

        def rate(t: float, y: Floats, v: float = v) -> list[float]:
            z, eps, path = y.tolist()
            w = worn(name, q, t, eps, path)
            phi = q.get("phi_wear", 0.0) * w
            bracket = BETA * np.sign(z * v) + GAMMA + phi * (np.sign(z) + np.sign(v))
            nu, eta = 1.0 + q.get("nu_wear", 0.0) * w, 1.0 + q.get("eta_wear", 0.0) * w
            f = (1.0 - nu * abs(z) ** N * bracket) / eta * pinched(name, q, v, z, eps)
            return [f * v / (1.0 + slip_per_z(name, q, z, w, eps) * f), (1.0 - ALPHA) * stiffness(t) * z * v, abs(v)]

        state = solve_ivp(rate, (j, j + 1.0), state, method="DOP853", rtol=1e-9, atol=1e-11, max_step=0.02).y[:, -1]
        u, k = PATH[j + 1], stiffness(j + 1.0)
        w = worn(name, q, j + 1.0, state[1], state[2])
        forces.append(ALPHA * k * u + (1.0 - ALPHA) * k * state[0] + beside(name, q, w, u, v))
    return np.array(forces)


@pytest.mark.parametrize("name", [name for name in MORE_FORMS if name != "play_slack"])  # its oracle: the reference
def test_every_form_is_its_equation(name: str) -> None:
    hidden: Hidden = MORE_FORMS[name](place())
    expected = by_scipy(name, hidden.storey_values)
    plain = follow(BASE, PATH).force
    scale = np.max(np.abs(expected))
    # Far from the plain law, and as near to the equations as half steps across kinks of z allow.
    assert np.max(np.abs(expected - plain)) > 5e-3 * scale
    found = follow(hidden.inside(Building(storeys=(BASE,))).storeys[0], PATH, 1000.0).force
    np.testing.assert_allclose(found, expected, atol=2e-4 * scale)
