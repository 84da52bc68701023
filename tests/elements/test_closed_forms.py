"""The storey law and its integration against closed forms and balances."""

from __future__ import annotations

from dataclasses import replace
from math import erf, sqrt

import numpy as np
import pytest
from laboratory import building, cyclic_test, finer, nrmse, shaking, solve, specimen, storey
from scipy.linalg import expm

from bwbn_bayes.elements.effects import CoulombFriction
from bwbn_bayes.elements.effects.backlash import Slack
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen


@pytest.mark.parametrize("A", [1.0, 1.4])
def test_monotonic_loading_with_n_one(A):
    """z = A/(beta+gamma) (1 - exp(-(beta+gamma) u))."""
    record = cyclic_test([1.5], 300)
    z = solve(specimen({}, n=1.0, A=A, beta=1.3, gamma=0.9), record, ["hysteretic_displacement_1"], 4)
    exact = A / 2.2 * (1.0 - np.exp(-2.2 * record.excitation))
    np.testing.assert_allclose(z["hysteretic_displacement_1"], exact, atol=1e-11)


def test_a_contact_that_sticks():
    """From a turn at drift u_0 on: q = s + (q_0 - s) exp(-|u - u_0| / x0), with s the new direction."""
    record = cyclic_test([1.0, -1.0, 1.0], 400)
    friction = CoulombFriction(F_c=0.7, x0=0.15, smoothing="dahl")
    plain = Specimen(storey=storey())
    added = [solve(model, record, ["force"], 8)["force"] for model in (plain.with_effect(friction), plain)]
    exact = [0.0]
    for move in np.diff(record.excitation):
        exact.append(np.sign(move) + (exact[-1] - np.sign(move)) * np.exp(-abs(move) / 0.15))
    np.testing.assert_allclose(added[0] - added[1], 0.7 * np.array(exact), atol=1e-8)


@pytest.mark.parametrize("n", [1.0, 1.5, 3.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_bound_of_the_hysteretic_displacement(n, sign):
    record = cyclic_test([20.0 * sign], 1000)
    z = solve(specimen({}, n=n, A=1.2, beta=1.3, gamma=0.9), record, ["hysteretic_displacement_1"], 4)
    assert z["hysteretic_displacement_1"][-1] == pytest.approx(sign * (1.2 / 2.2) ** (1.0 / n), rel=1e-10)


def test_strength_degradation_lowers_the_bound():
    """Far along a straight path f is nearly zero: z follows z_u(nu) = (A/(nu (beta+gamma)))^(1/n)."""
    record = cyclic_test([50.0], 2000)
    values = solve(
        specimen({"delta_nu": 0.001}, n=1.5), record, ["hysteretic_displacement_1", "hysteretic_energy_1"], 4
    )
    nu = 1.0 + 0.001 * values["hysteretic_energy_1"][-1]
    assert nu > 1.1
    assert values["hysteretic_displacement_1"][-1] == pytest.approx((1.0 / (4.0 * nu)) ** (1.0 / 1.5), rel=1e-3)


def test_the_loop_does_not_depend_on_the_rate():
    values = {"delta_nu": 0.1, "delta_s": 0.05, "sigma": 0.05}
    slow, fast = (
        solve(specimen(values), cyclic_test([0.8, -0.7, 1.2, -1.0], 100, time_step=dt), ["force"], 4)["force"]
        for dt in (0.5, 0.002)
    )
    np.testing.assert_allclose(fast, slow, rtol=0.0, atol=1e-11 * np.max(np.abs(slow)))


def slip_test() -> tuple[Record, dict[str, np.ndarray], float, float]:
    """Load into yield and come back across z = 0; beta = gamma and n = 1 make the spring's own drift known.

    Unloading to z = 0: f = 1 and du1 = dz. Loading on the other side: f = 1 - 2 beta |z|.
    """
    delta_s, sigma = 0.02, 0.01
    record = cyclic_test([1.2, -0.4], 4000)
    channels = ["drift_1", "hysteretic_displacement_1", "hysteretic_energy_1"]
    solution = solve(specimen({"delta_s": delta_s, "sigma": sigma}, n=1.0), record, channels, 16)
    back = {name.removesuffix("_1"): values[4000:] for name, values in solution.items()}
    return record, back, delta_s, sigma


def own_drift(z: np.ndarray, beta: float) -> np.ndarray:
    """Drift of the hysteretic spring from z = 0 on the way down."""
    return np.where(z > 0.0, z, np.log(1.0 - 2.0 * beta * np.abs(z)) / (2.0 * beta))


def test_slip_of_a_full_crossing():
    """s [erf(z1/(sqrt2 sigma)) - erf(z0/(sqrt2 sigma))] at the work s = delta_s eps of the crossing: 2 s in full."""
    _, back, delta_s, sigma = slip_test()
    z, inside = back["hysteretic_displacement"], np.abs(back["hysteretic_displacement"]) < 6.0 * sigma
    slipped = back["drift"] - own_drift(z, beta=2.0)
    first, last = np.flatnonzero(inside)[[0, -1]]
    energy = back["hysteretic_energy"][first : last + 1]
    assert np.ptp(energy) < 2e-2 * energy.mean()
    at_zero = np.interp(0.0, -z[first:last], energy[:-1])
    expected = delta_s * at_zero * (erf(z[last] / (sqrt(2.0) * sigma)) - erf(z[first] / (sqrt(2.0) * sigma)))
    assert slipped[last] - slipped[first] == pytest.approx(expected, rel=2e-3)
    assert slipped[last] - slipped[first] == pytest.approx(-2.0 * delta_s * at_zero, rel=2e-3)


def test_slip_is_the_integral_of_its_density():
    """u - u1 = integral of delta_s eps a(z) dz with the work that was recorded, by trapezoids."""
    _, back, delta_s, sigma = slip_test()
    z, energy = back["hysteretic_displacement"], back["hysteretic_energy"]
    slipped = back["drift"] - own_drift(z, beta=2.0)
    density = delta_s * energy * sqrt(2.0 / np.pi) / sigma * np.exp(-0.5 * (z / sigma) ** 2)
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(z))])
    # Trapezoids with steps of up to 0.04 sigma are good to 1e-4 at worst.
    np.testing.assert_allclose(slipped - slipped[0], integral, atol=5e-5 * np.ptp(integral))


def test_slack_is_crossed_while_there_is_no_force():
    """Where the springs' force changes sign, a way of 2 b_0 is put into the displacement: the force does not see it."""
    b, springs = 0.3, cyclic_test([1.0, -0.8, 0.5, -1.1], 2000)
    own = solve(Specimen(storey=storey(alpha=0.2, c=0.0)), springs, ["force"], 8)["force"]
    way = np.linspace(0.0, 1.0, 400)
    path, force, taken = [b * way], [0.0 * way], b
    for j in range(1, len(own)):
        if own[j] * own[j - 1] < 0.0:
            side = np.sign(own[j])
            path.append(springs.excitation[j] + taken + 2.0 * b * side * way)
            force.append(0.0 * way)
            taken += 2.0 * b * side
        path.append(springs.excitation[j : j + 1] + taken)
        force.append(own[j : j + 1])
    driven = replace(springs, excitation=np.concatenate(path))
    model = Specimen(storey=storey(alpha=0.2, c=0.0)).with_effect(Slack(b_0=b, w_0=2e-4))
    found = solve(model, driven, ["force"], 32)["force"]
    np.testing.assert_allclose(found, np.concatenate(force), atol=5e-3 * np.ptp(own))


def linear_building(k: np.ndarray, c: np.ndarray, masses: np.ndarray, record: Record) -> np.ndarray:
    """Total accelerations of a linear shear building, exact for straight excitation (first-order hold)."""
    n, dt = len(k), record.time_step
    stiffness, damping = (np.diag(s + np.append(s[1:], 0.0)) - np.diag(s[1:], 1) - np.diag(s[1:], -1) for s in (k, c))
    inverse = np.diag(1.0 / masses)
    system = np.zeros((2 * n + 2, 2 * n + 2))
    system[:n, n : 2 * n] = np.eye(n)
    system[n : 2 * n, : 2 * n] = -inverse @ np.hstack([stiffness, damping])
    system[n : 2 * n, 2 * n] = -1.0
    system[2 * n, 2 * n + 1] = 1.0 / dt
    transition = expm(system * dt)[: 2 * n]
    state, rows = np.zeros(2 * n), []
    ground = record.excitation
    for j in range(record.n_times):
        rows.append(system[n : 2 * n, : 2 * n] @ state)
        if j + 1 < record.n_times:
            state = transition @ np.concatenate([state, [ground[j], ground[j + 1] - ground[j]]])
    return np.array(rows).T


@pytest.mark.parametrize("n_storeys", [1, 3])
def test_beta_gamma_zero_is_the_linear_building(n_storeys):
    masses = np.array([1.0, 1.3, 0.7])[:n_storeys]
    model = ShearBuilding(masses=list(masses), storey=storey(k=15.0, c=0.3, beta=0.0, gamma=0.0))
    record = shaking()
    floors = [f"acceleration_{i + 1}" for i in range(n_storeys)]
    solution = solve(model, record, floors, 16)
    exact = linear_building(np.full(n_storeys, 15.0), np.full(n_storeys, 0.3), masses, record)
    for floor, values in zip(floors, exact, strict=True):
        assert nrmse(solution[floor], values) < 1e-8


BALANCES = {
    "plain": {},
    "degrading and slipping": {"delta_nu": 0.3, "delta_eta": 0.3, "delta_s": 0.05, "sigma": 0.05},
    "sudden loss of k": {"k_jump": -4.0, "k_time": 2.5, "delta_nu_jump": 0.5, "delta_nu_time": 2.5},
}


@pytest.mark.parametrize("name", BALANCES)
def test_energy_balance(name):
    """Input = kinetic + elastic + viscous + eps + what a jump of k takes with it, to 1e-5 of the input.

    Quadrature by trapezoids at 1/2000 s is good to about 1e-6 of the input.
    """
    values, alpha, c, n = BALANCES[name], 0.1, 0.1, 2
    model = building(n, values, alpha=alpha, c=c)
    record = finer(shaking(), 80)
    kinds = ("drift", "drift_rate", "hysteretic_energy")
    solution = solve(model, record, [f"{kind}_{i + 1}" for kind in kinds for i in range(n)], 2)
    u, v, eps = (np.array([solution[f"{kind}_{i + 1}"] for i in range(n)]) for kind in kinds)
    floor_rate, t = np.cumsum(v, axis=0), record.times

    def integral(power: np.ndarray) -> np.ndarray:
        steps = 0.5 * (power[:, 1:] + power[:, :-1]) * record.time_step
        return np.concatenate([np.zeros((n, 1)), np.cumsum(steps, axis=1)], axis=1).sum(axis=0)

    jump, after = values.get("k_jump", 0.0), t >= values.get("k_time", np.inf)
    k = 10.0 + jump * after
    taken = -0.5 * alpha * jump * np.sum(u[:, np.argmax(after)] ** 2) * after
    supplied = integral(-record.excitation * floor_rate)
    held = 0.5 * np.sum(floor_rate**2, axis=0) + 0.5 * alpha * k * np.sum(u**2, axis=0)
    spent = integral(c * v**2) + np.sum(eps, axis=0) + taken
    np.testing.assert_allclose(held + spent, supplied, atol=1e-5 * np.max(supplied))
    if jump:
        assert np.max(taken) > 1e-3 * np.max(supplied)
