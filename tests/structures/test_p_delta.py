"""P-Delta against OpenSees, which makes the effect itself: from weights, heights and geometry, not from P / h.

Weights are put on the floors first and held; then the ground moves. Three models of a storey know nothing of a
geometric stiffness: a link with OpenSees' ``-pDelta``, a column with its transformation ``PDelta``, and a rigid strut
that leans, in large displacements, beside a spring of shear. The last is geometry alone, and differs by ``(u / h)^2``.
"""

from __future__ import annotations

import numpy as np
import pytest
from opensees_analysis import analysis

from bwbn_bayes import BoucWen, Linear, PDelta, PerStorey, Record, ShearBuilding
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.structures.structure import Structure

G = 9.81
MASSES, HEIGHTS = [3e4, 2.5e4, 2e4], [4.0, 3.2, 3.0]
STIFFNESS, DAMPING = [1.5e6, 1.1e6, 7e5], [2e4, 1.5e4, 1e4]
LOOP = {"alpha": 0.1, "n": 1.5, "beta": 1500.0, "gamma": 500.0}
"""Yields at some 6 mm; under the first storey's weight half of the stiffness after yield is left."""
RIGID = 1e12
"""Of struts and columns along their axis. [N/m, N]"""
STEP, N = 0.02, 400
TIMES = STEP * np.arange(N)
GROUND = 0.5 * np.sin(6.0 * TIMES) * np.exp(-0.1 * TIMES)
WITHIN = {"link": 1e-6, "column": 1e-6, "strut": 5e-5}
"""Of the largest drift of the storey."""


def storeys(ops, kind: str, n_storeys: int, *, yields: bool) -> None:
    """Storeys of shear: floors do not rotate, and their axial stiffness is as good as infinite."""
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    ops.geomTransf("PDelta", 1)
    ops.node(0, 0.0, 0.0)
    ops.fix(0, 1, 1, 1)
    own = list(zip(MASSES, HEIGHTS, STIFFNESS, DAMPING, strict=True))
    for i, (mass, h, k, c) in enumerate(own[:n_storeys], 1):
        ops.node(i, 0.0, sum(HEIGHTS[:i]))
        ops.fix(i, 0, 0, 1)
        ops.mass(i, mass, 0.0, 0.0)
        axial, spring, dashpot, shear = range(10 * i, 10 * i + 4)
        ops.uniaxialMaterial("Elastic", axial, RIGID)
        ops.uniaxialMaterial("Viscous", dashpot, c, 1.0)
        if yields:
            shape = (LOOP["alpha"], k, LOOP["n"], LOOP["gamma"], LOOP["beta"], 1.0, 0.0, 0.0, 0.0)
            ops.uniaxialMaterial("BoucWen", spring, *shape, 1e-12, 200)
        else:
            ops.uniaxialMaterial("Elastic", spring, k)
        ops.uniaxialMaterial("Parallel", shear, spring, dashpot)
        if kind == "link":  # no moments at its ends: the weight's couple is all shear
            ops.element("twoNodeLink", i, i - 1, i, "-mat", axial, shear, "-dir", 1, 2, "-pDelta", 0.0, 0.0)
        elif kind == "column":
            ops.element("elasticBeamColumn", i, i - 1, i, 1.0, RIGID, k * h**3 / (12.0 * RIGID), 1)
            ops.element("twoNodeLink", 10 + i, i - 1, i, "-mat", dashpot, "-dir", 2)
        else:
            ops.element("corotTruss", i, i - 1, i, 1.0, axial)
            ops.element("twoNodeLink", 10 + i, i - 1, i, "-mat", shear, "-dir", 2)


def opensees(kind: str, n_storeys: int, substeps: int, *, yields: bool = False) -> np.ndarray:
    """Drifts ``(n_storeys, n_times)`` [m]."""
    ops = pytest.importorskip("openseespy.opensees")
    storeys(ops, kind, n_storeys, yields=yields)

    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    for i in range(1, n_storeys + 1):
        ops.load(i, 0.0, -G * MASSES[i - 1], 0.0)
    analysis(ops, "Static", "LoadControl", 1.0)
    assert ops.analyze(1) == 0
    ops.loadConst("-time", 0.0)
    ops.timeSeries("Path", 2, "-dt", STEP, "-values", *GROUND, GROUND[-1])
    ops.pattern("UniformExcitation", 2, 1, "-accel", 2)
    analysis(ops, "Transient", "Newmark", 0.5, 0.25)
    floors = np.zeros((n_storeys, N))
    for j in range(1, N):
        assert ops.analyze(substeps, STEP / substeps) == 0
        floors[:, j] = [ops.nodeDisp(i, 1) for i in range(1, n_storeys + 1)]
    ops.wipe()
    return np.diff(floors, axis=0, prepend=0.0)


def weighed(n_storeys: int, *, share: float = 1.0, yields: bool = False) -> Structure:
    """The package's model, with so much of the weight of the floors above each storey."""
    k, c = PerStorey(STIFFNESS[:n_storeys]), PerStorey(DAMPING[:n_storeys])
    above = G * np.cumsum(MASSES[:n_storeys][::-1])[::-1]
    geometric = share * above / np.array(HEIGHTS[:n_storeys])
    storey = BoucWen(k=k, c=c, **LOOP) if yields else Linear(k=k, c=c)
    model = ShearBuilding(masses=MASSES[:n_storeys], storey=storey)
    return model.with_effect(PDelta(k_geo=PerStorey(geometric.tolist())))


def missed(model: Structure, expected: np.ndarray, engine: Reference | Lanes | None = None) -> float:
    """The largest difference of a drift, in the largest of its storey."""
    record = Record(name="shaking", time_step=STEP, excitation=GROUND)
    channels = [f"drift_{i}" for i in range(1, len(expected) + 1)]
    found = (engine or Reference()).simulate(model, np.zeros((1, 0)), record, channels).values[0]
    return float(np.max(np.max(np.abs(found - expected), axis=1) / np.max(np.abs(expected), axis=1)))


@pytest.mark.parametrize("n_storeys", [1, 3])
@pytest.mark.parametrize("kind", WITHIN)
def test_linear_storeys_under_their_weight_drift_as_in_opensees(kind: str, n_storeys: int) -> None:
    """Weights are 5 to 13 % of ``k h``: a hundredth of them is seen, and without them a quarter of the drift goes."""
    coarse, fine = (opensees(kind, n_storeys, substeps) for substeps in (4, 8))
    limit = (4.0 * fine - coarse) / 3.0  # Newmark's error is of second order
    assert missed(weighed(n_storeys), limit) < WITHIN[kind]
    assert missed(weighed(n_storeys), limit, Lanes(substeps=8, n_threads=1)) < 2.0 * WITHIN[kind]
    assert missed(weighed(n_storeys, share=0.99), limit) > 20.0 * WITHIN[kind]
    assert missed(weighed(n_storeys, share=0.0), limit) > 0.25


@pytest.mark.parametrize(("n_storeys", "within"), [(1, 1e-4), (3, 4e-3)])
def test_storeys_that_yield_lean_on_as_in_opensees(n_storeys: int, within: float) -> None:
    """The lowest of three drifts by 3 % of its height: 1e-3 of its own stiffness, which P / h does not have."""
    coarse, fine = (opensees("strut", n_storeys, substeps, yields=True) for substeps in (10, 20))
    limit = 2.0 * fine - coarse  # the Bouc-Wen material's error is of first order
    assert missed(weighed(n_storeys, yields=True), limit) < within
    assert missed(weighed(n_storeys, yields=True, share=0.99), limit) > 8.0 * within
    assert missed(weighed(n_storeys, yields=True, share=0.0), limit) > 0.2
