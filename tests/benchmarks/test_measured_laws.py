"""The competitors' own laws against OpenSees, against closed forms and against SciPy; and how they are fitted."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import openseespy.opensees as ops
import pytest
from scipy.signal import lsim

from benchmarks.measured_tests.bouc_wen_baber_noori import BoucWenBaberNoori
from benchmarks.measured_tests.fitting import Budget, fit_force, minimised, thinned
from benchmarks.measured_tests.linear_chain import LinearChain
from benchmarks.measured_tests.pinching4 import SYMBOLS, Pinching4, define
from bwbn_bayes import Record

VECTORS = json.loads((Path(__file__).parents[1] / "reference" / "opensees_vectors.json").read_text())["vectors"]

UNIT = {"travel": 1.0, "peak": 1.0}


@pytest.mark.parametrize("vector", VECTORS, ids=lambda vector: f"{vector['material']}-n{vector['parameters']['n']}")
def test_bwbn_gives_the_forces_of_opensees(vector):
    # OpenSees knows Foliente's pinch without degradation, and degradation without a pinch.
    p = vector["parameters"]
    u_y = (p["beta"] + p["gamma"]) ** (-1.0 / p["n"])
    first = [p["k"], u_y, p["alpha"], p["n"], p["beta"] / (p["beta"] + p["gamma"])]
    loss = [p.get("delta_nu", 0.0), p.get("delta_eta", 0.0)]
    pinch = [p.get("zeta_s", 0.0), p.get("p", 1.0), p.get("q", 0.0)]
    widths = [p.get("psi_0", 1.0) / u_y, p.get("delta_psi", 0.0) / u_y, p.get("lambda_", 1.0)]
    path = np.concatenate([[0.0], vector["turning_points"]])
    force = BoucWenBaberNoori(**UNIT).force(np.array([*first, *loss, *pinch, *widths]), path)
    assert force[1:] == pytest.approx(vector["forces"], abs=5e-4 * np.max(np.abs(vector["forces"])))


def pinching4(**changed: float) -> np.ndarray:
    backbone = {"e1": 0.1, "e2": 0.3, "e3": 0.6, "e4": 2.0}
    backbone |= {f"{side}{i}": force for side in "pn" for i, force in enumerate((0.5, 0.8, 1.0, 0.7), start=1)}
    values = dict.fromkeys(SYMBOLS, 0.0) | backbone | {"r_disp": 0.5, "r_force": 0.25, "u_force": 0.05} | changed
    return np.array([values[symbol] for symbol in SYMBOLS])


def test_pinching4_loaded_once_follows_its_backbone():
    strain = np.linspace(0.0, 1.9, 200)
    law = Pinching4(travel=2.0, peak=3.0)
    forces = law.force(pinching4(n2=0.6), 2.0 * strain), law.force(pinching4(n2=0.6), -2.0 * strain)
    ends = [0.0, 0.1, 0.3, 0.6, 2.0]
    assert forces[0] == pytest.approx(3.0 * np.interp(strain, ends, [0.0, 0.5, 0.8, 1.0, 0.7]), abs=2e-3)
    assert forces[1] == pytest.approx(-3.0 * np.interp(strain, ends, [0.0, 0.5, 0.6, 1.0, 0.7]), abs=2e-3)


def test_pinching4_reloads_through_the_stated_point():
    # Loaded to +-0.5 and back towards 0.5: it bends at r_disp times that strain and r_force times its force.
    path = np.concatenate([np.linspace(a, b, 400) for a, b in ((0.0, 0.5), (0.5, -0.5), (-0.5, 0.5))])
    force = Pinching4(**UNIT).force(pinching4(), path)[800:]
    reached = np.interp(0.5, [0.3, 0.6], [0.8, 1.0])
    assert np.interp(0.25, path[800:], force) == pytest.approx(0.25 * reached, rel=0.01)
    assert force[-1] == pytest.approx(reached, rel=0.01)


def test_pinching4_keeps_directions_and_damages_apart():
    # Seven of its 21 numbers would do nothing if they stood at another's place: each must move the response.
    path = np.concatenate(
        [np.linspace(a, b, 60) for a, b in ((0, 0.5), (0.5, -0.5), (-0.5, 0.8), (0.8, -0.8), (-0.8, 1))]
    )
    law, plain = Pinching4(**UNIT), pinching4(n3=0.9, gk_disp=0.2, gd_disp=0.1, gf_disp=0.1)
    base = law.force(plain, path)
    moved = []
    for i in range(len(SYMBOLS)):
        changed = plain.copy()
        changed[i] += 0.05
        moved.append(float(np.max(np.abs(law.force(changed, path) - base))))
    assert min(moved) > 1e-3, dict(zip(SYMBOLS, moved, strict=True))


def test_pinching4_as_defined_is_under_test():
    define(pinching4())
    ops.setStrain(0.05)
    assert ops.getStress() == pytest.approx(0.25, rel=0.01)


def test_linear_chain_is_exact_between_samples():
    rng = np.random.default_rng(3)
    record = Record(name="ground", time_step=0.02, excitation=rng.standard_normal(200))
    p = np.array([300.0, 250.0, 200.0, 0.4, 0.3, 0.2])
    k, c = (
        np.array([[550.0, -250, 0], [-250, 450, -200], [0, -200, 200]]),
        np.array([[0.7, -0.3, 0], [-0.3, 0.5, -0.2], [0, -0.2, 0.2]]),
    )
    state = np.block([[np.zeros((3, 3)), np.eye(3)], [-k, -c]])
    system = state, np.array([[0.0, 0, 0, -1, -1, -1]]).T, np.eye(3, 6), np.zeros((3, 1))
    _, expected, _ = lsim(system, record.excitation, record.times)
    assert LinearChain(n_storeys=3).displacements(p, record) == pytest.approx(
        expected.T, abs=1e-10 * np.max(np.abs(expected))
    )


def cyclic_path(n_cycles: int, per_cycle: int) -> np.ndarray:
    t = np.arange(n_cycles * per_cycle + 1) / per_cycle
    return t / n_cycles * np.sin(2.0 * np.pi * t)


def test_a_thinned_record_keeps_turns_and_counts_every_sample():
    path = cyclic_path(6, 500)
    index, weight = thinned(path, np.tanh(5.0 * path), most=200)
    assert len(index) <= 200
    assert weight.sum() == len(path)
    turns = [i for i in range(1, len(path) - 1) if (path[i] - path[i - 1]) * (path[i + 1] - path[i]) < 0.0]
    assert set(turns) <= set(index.tolist())
    values = np.cos(3.0 * path)
    assert weight @ values[index] / weight.sum() == pytest.approx(np.mean(values), abs=0.02)


def test_a_short_record_is_not_thinned():
    index, weight = thinned(np.arange(20.0), np.arange(20.0), most=30)
    assert index.tolist() == list(range(20))
    assert set(weight) == {1.0}


def test_least_squares_ends_what_evolution_began():
    # Two valleys; evolution of ten generations is in the right one, a thousandth of its width off.
    def residuals(point):
        return np.array([10.0 * (point[0] - 0.3), np.exp(point[1]) - np.exp(0.7), 0.1 * np.sin(40.0 * point[0])])

    fitted = minimised(residuals, 2, Budget(members=20, generations=10))
    assert fitted.point[1] == pytest.approx(0.7, abs=1e-6)
    assert fitted.n_runs >= 20 * 11


def test_a_law_that_is_not_finite_somewhere_is_fitted_elsewhere():
    def residuals(point):
        return np.array([np.nan, np.nan]) if point[0] < 0.4 else np.array([point[0] - 0.6, 0.0])

    assert minimised(residuals, 1, Budget(members=10, generations=8)).point[0] == pytest.approx(0.6, abs=1e-6)


@pytest.mark.parametrize("law", [BoucWenBaberNoori(**UNIT), Pinching4(**UNIT)], ids=["bwbn", "pinching4"])
def test_a_law_fits_its_own_loop(law):
    path = cyclic_path(4, 60)
    truth = np.random.default_rng(4).uniform(0.25, 0.6, len(law.symbols))
    force = law.force(law.parameters(truth), path)
    fitted = fit_force(law, path, force, Budget(members=42, generations=25, polished=3, steps=30))
    left = law.force(law.parameters(fitted.point), path) - force
    assert np.sqrt(np.mean(left**2) / np.mean(force**2)) < 0.1
