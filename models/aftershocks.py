"""Two storeys under a foreshock, a main shock and an aftershock: the damage goes on from one to the next.

Energy, strength and residual drift of one record are where the next begins. Units: N, m, s, kg, J.
"""

from dataclasses import replace

import numpy as np

from bwbn_bayes import (
    BoucWen,
    PerStorey,
    Record,
    ShearBuilding,
    StiffnessDegradation,
    StrengthDegradation,
    Uniform,
    el_centro,
    join_records,
)

model = ShearBuilding(
    masses=[2e4, 1.5e4],  # kg
    storey=BoucWen(
        k=PerStorey(Uniform(5e6, 4e7)),  # N/m
        c=Uniform(0, 3e5),  # N s/m
        alpha=Uniform(0.001, 0.3),
        A=1.0,
        beta=Uniform(1, 200),  # 1/m^n
        gamma=Uniform(-50, 200),  # 1/m^n
        n=1.0,
    ),
)
model = model.with_effect(StrengthDegradation(delta_nu=Uniform(0, 2e-4)))  # 1/J
model = model.with_effect(StiffnessDegradation(delta_eta=Uniform(0, 2e-4)))  # 1/J


def shock(name: str, factor: float, start: float) -> Record:
    """Twelve seconds of El Centro, scaled, and five in which the building comes to rest."""
    part = el_centro("chopra").between(start, start + 12.0)
    quiet = np.zeros(round(5.0 / part.time_step))
    return replace(part, name=name, excitation=np.concatenate([factor * part.excitation, quiet]))


excitation = join_records(
    [shock("foreshock", 0.4, 0.0), shock("main shock", 1.0, 0.0), shock("aftershock", 0.6, 14.0)], in_sequence=True
)
snr_db = 30.0  # dB of mean square, of each record
truth = {
    "k[1]": 2e7,
    "k[2]": 1.2e7,
    "c": 8e4,
    "alpha": 0.1,
    "beta": 60.0,
    "gamma": 40.0,
    "delta_nu": 3e-5,
    "delta_eta": 2e-5,
}
assumptions = (
    "The building is invented, and nobody repaired it between the shocks.",
    "The ground motions are parts of El Centro 1940, north-south, as printed by Chopra, scaled.",
)
