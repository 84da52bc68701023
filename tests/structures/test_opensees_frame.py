"""A braced frame of linear links against OpenSees, which integrates it by Newmark's average acceleration."""

from __future__ import annotations

import numpy as np
import pytest

from bwbn_bayes import Linear, Record, ShearBuilding
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.parameters import PerStorey

MASSES, STIFFNESS, DAMPING = [2.0, 1.5, 1.0], [60.0, 50.0, 40.0, 25.0], [0.5, 0.4, 0.3, 0.2]
JOINTS = [(0, 1), (1, 2), (2, 3), (0, 2)]
STEP, N = 0.02, 400


def opensees(ground: np.ndarray, force: np.ndarray, substeps: int) -> np.ndarray:
    """Displacements ``(3, n_times)`` relative to the ground [m]."""
    ops = pytest.importorskip("openseespy.opensees")
    ops.wipe()
    ops.model("basic", "-ndm", 1, "-ndf", 1)
    for node in range(4):
        ops.node(node, 0.0)
    ops.fix(0, 1)
    for node, mass in enumerate(MASSES, 1):
        ops.mass(node, mass)
    for link, (low, high) in enumerate(JOINTS):
        ops.uniaxialMaterial("Elastic", link, STIFFNESS[link], DAMPING[link])
        ops.element("zeroLength", link, low, high, "-mat", link, "-dir", 1)
    ops.timeSeries("Path", 1, "-dt", STEP, "-values", *ground, ground[-1])
    ops.pattern("UniformExcitation", 1, 1, "-accel", 1)
    ops.timeSeries("Path", 2, "-dt", STEP, "-values", *force, force[-1])
    ops.pattern("Plain", 2, 2)
    ops.load(3, 1.0)
    ops.system("FullGeneral")
    ops.numberer("Plain")
    ops.constraints("Plain")
    ops.integrator("Newmark", 0.5, 0.25)
    ops.algorithm("Linear")
    ops.analysis("Transient")
    found = np.zeros((3, N))
    for j in range(1, N):
        assert ops.analyze(substeps, STEP / substeps) == 0
        found[:, j] = [ops.nodeDisp(node, 1) for node in (1, 2, 3)]
    ops.wipe()
    return found


def test_a_braced_frame_under_ground_motion_and_a_force_moves_as_in_opensees():
    times = STEP * np.arange(N)
    ground, force = np.sin(3.0 * times) * np.exp(-0.1 * times), 2.0 * np.sin(5.0 * times)
    coarse, fine = (opensees(ground, force, substeps) for substeps in (8, 16))
    limit = (4.0 * fine - coarse) / 3.0  # Newmark's error is of second order
    frame = ShearBuilding(masses=MASSES, storey=Linear(k=PerStorey(STIFFNESS[:3]), c=PerStorey(DAMPING[:3]))).with_link(
        Linear(k=STIFFNESS[3], c=DAMPING[3]), joins=JOINTS[3]
    )
    record = Record(name="both", time_step=STEP, excitation=ground, forces={"applied_force_3": force})
    channels = [f"displacement_{i}" for i in (1, 2, 3)]
    found = Reference().simulate(frame, np.zeros((1, 0)), record, channels).values[0]
    assert np.max(np.abs(found - limit)) < 1e-5 * np.max(np.abs(limit))
