"""Steps of an imposed displacement: as many as its stride needs, whatever the sampling of the record."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from engine_cases import relative_error
from scipy.integrate import solve_ivp

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.law import off_zero
from bwbn_bayes.engines.base import Engine
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.engines.scalar import ScalarRk4
from bwbn_bayes.engines.step_rules import RANGE_STEPS, interval_steps
from bwbn_bayes.inference.accuracy import LADDER
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen

STRIDE = 0.2
YIELD = 0.02
"""A tenth of a sample's stride: z grows like ``1 - (z / YIELD)`` over it. [m]"""


def digitised() -> Record:
    """Three cycles of ten samples a half cycle, as a figure in a paper gives them."""
    path = np.interp(np.arange(61) / 5, np.arange(13), [0.0, *[1.0, 0.0, -1.0, 0.0] * 3])
    return Record(name="digitised", time_step=1.0, excitation=path, channels={}, excitation_kind="displacement")


def forces(engine: Engine) -> Floats:
    storey = BoucWen(k=10.0, c=0.0, alpha=0.1, beta=0.5 / YIELD, gamma=0.5 / YIELD, n=1.0)
    response = engine.simulate(Specimen(storey=storey), np.zeros((1, 0)), digitised(), ("force",))
    assert response.status.tolist() == [0]
    return response.values[0, 0]


def test_a_long_stride_takes_many_steps_and_a_short_one_the_least() -> None:
    """A range of 2: strides of a half, a tenth and a hundred-thousandth of it."""
    path = np.array([0.0, 1.0, -1.0, -0.8, -0.8 + 2e-5])
    steps = interval_steps(path, 3, driven=True)
    assert steps[:-1].tolist() == [3 * RANGE_STEPS // 2, 3 * RANGE_STEPS, 3 * RANGE_STEPS // 10, 3]
    assert interval_steps(path, 3, driven=False).tolist() == [3] * 5
    assert interval_steps(np.ones(4), 2, driven=True).tolist() == [2] * 4


@pytest.mark.parametrize("engine", [Lanes(substeps=1, n_threads=1), ScalarRk4(substeps=1)], ids=["lanes", "scalar"])
def test_a_yield_far_below_the_stride_of_a_sample_is_solved(engine: Engine) -> None:
    """Equal steps between samples, ten yield displacements long, once ran off to infinity."""
    expected = forces(Reference())
    assert np.max(np.abs(expected)) < 10.0 * (0.1 + 0.9 * YIELD) + 0.1
    assert relative_error(forces(engine), expected) < 1e-3


def test_both_engines_take_the_same_steps() -> None:
    lanes, scalar = forces(Lanes(substeps=2, n_threads=1)), forces(ScalarRk4(substeps=2))
    assert relative_error(lanes, scalar) < 1e-8


@pytest.mark.parametrize("shape", [{"u_y": 1e-3, "rho": 0.7}, {"beta": 0.7, "gamma": 0.3}], ids=["u_y", "beta"])
def test_strides_go_by_the_drift_within_which_z_settles_at_its_bound(shape: dict[str, float]) -> None:
    """There z comes back like ``exp(-n u / u_y)``; Runge-Kutta's fourth order is stable over 2.78 of these."""
    n, bound = 3.0, shape.get("u_y", 1.0)
    (feature,) = Specimen(storey=BoucWen(k=10.0, n=n, **shape)).law.sharp_features
    numbers = {"A": 1.0, "n": n, **shape}
    width = feature.width.replace(off_zero, lambda x: x)
    width = width.subs({one: numbers[one.name] for one in width.free_symbols})
    assert float(width) == pytest.approx(4.0 * bound / n)
    assert not ShearBuilding(masses=[1.0], storey=BoucWen(k=10.0, n=n, **shape)).law.sharp_features


def exact_forces(path: Floats, k: float, alpha: float, u_y: float, rho: float, n: float) -> Floats:
    """By SciPy over the drift, stretch by stretch, with nothing of the package."""
    z, found = 0.0, [0.0]
    for first, last in pairwise(path.tolist()):
        forward = np.sign(last - first)

        def slope(_: float, z: Floats, forward: float = forward) -> Floats:
            return forward * (1.0 - np.abs(z / u_y) ** n * (rho * np.sign(z * forward) + 1.0 - rho))

        solved = solve_ivp(slope, (0.0, abs(last - first)), [z], method="Radau", rtol=1e-9, atol=1e-12)
        z = float(solved.y[0, -1])
        found.append(alpha * k * last + (1.0 - alpha) * k * z)
    return np.array(found)


@pytest.mark.parametrize("rung", LADDER[:2], ids=["first", "second"])
@pytest.mark.parametrize("engine", [Lanes(n_threads=1), ScalarRk4()], ids=["lanes", "scalar"])
def test_what_yields_within_a_small_share_of_a_stride_is_solved_by_the_coarsest_schemes(
    engine: Lanes | ScalarRk4, rung: Lanes
) -> None:
    """Truths of ``models/cyclic_test.py`` do: they ran away, and posteriors that left them out passed their checks."""
    numbers = {"k": 10.0, "alpha": 0.1, "u_y": YIELD / 4, "rho": 1.4, "n": 4.0}
    own = replace(engine, substeps=rung.substeps, resolution=rung.resolution)
    response = own.simulate(Specimen(storey=BoucWen(**numbers)), np.zeros((1, 0)), digitised(), ("force",))
    assert relative_error(response.values[0, 0], exact_forces(digitised().excitation, **numbers)) < 0.01
