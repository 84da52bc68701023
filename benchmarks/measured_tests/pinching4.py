"""OpenSees' Pinching4 through openseespy, 21 parameters.

Four displacements that both directions share and four forces for each; three numbers of the pinch; for loss of
unloading stiffness, of reloading and of strength a share by displacement and one by energy. OpenSees' exponents of the
damage are one, its limits and its energy capacity are stated below.

References
----------
.. [1] L. N. Lowes, N. Mitra, A. Altoontash, "A Beam-Column Joint Model for Simulating the Earthquake Response of
   Reinforced Concrete Frames", PEER 2003/10.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import openseespy.opensees as ops

from benchmarks.measured_tests.fitting import Budget
from bwbn_bayes.parameters import Floats

SYMBOLS = (
    *("e1", "e2", "e3", "e4", "p1", "p2", "p3", "p4", "n1", "n2", "n3", "n4"),
    *("r_disp", "r_force", "u_force", "gk_disp", "gk_energy", "gd_disp", "gd_energy", "gf_disp", "gf_energy"),
)
BUDGET = Budget(members=126, generations=110, rounds=2)

DAMAGE_LIMIT = 0.95
ENERGY_CAPACITY = 10.0
"""In energies of the backbone, loaded once to its end."""


@dataclass(frozen=True, kw_only=True)
class Pinching4:
    """The material with ranges for a test of stated size.

    Attributes
    ----------
    travel : float
        Largest displacement of the fitted part. [m]
    peak : float
        Largest force of the fitted part. [N]
    """

    travel: float
    peak: float

    name = "pinching4"
    symbols = SYMBOLS

    def parameters(self, point: Floats) -> Floats:
        """Physical parameters in the order of the symbols, at a point ``(21,)`` of the unit cube.

        Displacements and forces are shares of the fitted part's largest; the steps between displacements stay positive.
        """
        t = point
        steps = np.array(
            [
                0.002 * 150.0 ** t[0],  # 0.2 to 30 % of the travel
                0.02 * 25.0 ** t[1],
                0.05 * 16.0 ** t[2],
                0.05 * 40.0 ** t[3],
            ]
        )
        forces = np.concatenate([0.02 + 0.98 * t[[4, 8]], 0.02 + 1.38 * t[[5, 6, 7, 9, 10, 11]]])
        pinch = np.array([-0.5 + 1.45 * t[12], 0.95 * t[13], -0.8 + 1.3 * t[14]])
        ordered = forces[[0, 2, 3, 4, 1, 5, 6, 7]]
        return np.concatenate([np.cumsum(steps), ordered, pinch, 1.5 * t[15:] ** 2])

    def force(self, parameters: Floats, displacement: Floats) -> Floats:
        """Force [N] along a displacement history [m], both ``(n_times,)``."""
        define(parameters)
        set_strain, get_stress = ops.setStrain, ops.getStress
        found = np.empty(len(displacement))
        for i, strain in enumerate(((displacement - displacement[0]) / self.travel).tolist()):
            set_strain(strain)
            found[i] = get_stress()
        return self.peak * found


def define(parameters: Floats) -> None:
    """Make a Pinching4 of parameters in the order of the symbols OpenSees' material under test."""
    p = parameters.tolist()
    strains, positive, negative, pinch, damage = p[:4], p[4:8], p[8:12], p[12:15], p[15:]
    backbone = [value for pair in zip(positive, strains, strict=True) for value in pair]
    mirrored = [-value for pair in zip(negative, strains, strict=True) for value in pair]
    shares = [value for i in (0, 2, 4) for value in (damage[i], damage[i + 1], 1.0, 1.0, DAMAGE_LIMIT)]
    ops.wipe()
    ops.uniaxialMaterial("Pinching4", 1, *backbone, *mirrored, *pinch, *pinch, *shares, ENERGY_CAPACITY, "energy")
    ops.testUniaxialMaterial(1)
