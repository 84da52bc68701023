"""Drive an OpenSees uniaxial material along straight segments; run as a script to print the test vectors anew.

OpenSees's BWBN has Foliente's pinching without degradation, its BoucWen has nu and eta without pinching; both are
first order in the step, so the printed forces carry a Richardson extrapolation of two steps.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import openseespy.opensees as ops

VECTORS = json.loads((Path(__file__).parent / "opensees_vectors.json").read_text())["vectors"]
_NEWTON = (1e-12, 200)


def forces_at_turning_points(
    material: str, parameters: Mapping[str, float], turning_points: Sequence[float], step: float
) -> np.ndarray:
    """Force at each turning point, with displacement steps of at most ``step``."""
    p = dict(parameters)
    ops.wipe()
    ops.model("basic", "-ndm", 1, "-ndf", 1)
    first = (p["alpha"], p["k"], p["n"], p["gamma"], p["beta"], p["A"])
    if material == "BWBN":
        pinching = (p["q"], p["zeta_s"], p["p"], p["psi_0"], p["delta_psi"], p["lambda_"])
        ops.uniaxialMaterial("BWBN", 1, *first, *pinching, *_NEWTON)
    else:
        ops.uniaxialMaterial("BoucWen", 1, *first, 0.0, p["delta_nu"], p["delta_eta"], *_NEWTON)
    ops.testUniaxialMaterial(1)
    forces, here = [], 0.0
    for there in turning_points:
        n_steps = round(abs(there - here) / step)
        for strain in here + (there - here) * np.arange(1, n_steps + 1) / n_steps:
            ops.setStrain(float(strain))
        here = there
        forces.append(ops.getStress())
    ops.wipe()
    return np.array(forces)


if __name__ == "__main__":
    for vector in VECTORS:
        coarse, fine = (
            forces_at_turning_points(vector["material"], vector["parameters"], vector["turning_points"], step)
            for step in (2e-4, 1e-4)
        )
        print(vector["material"], np.round(2 * fine - coarse, 6).tolist())
