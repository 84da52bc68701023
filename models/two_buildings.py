"""Two buildings of one kind whose rates of stiffness degradation share a prior: a hierarchical model in PyMC.

``model`` is either building; ``hierarchy`` joins records of both. The stiffness and the strength of each building are
its own, its rate of degradation is drawn around a typical rate of the kind, which both records inform. The mass is
1 kg, so that forces read as accelerations. Units: N, m, s, J.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from bwbn_bayes import BoucWen, Record, ShearBuilding, StiffnessDegradation, StrengthDegradation, Uniform, el_centro

if TYPE_CHECKING:
    import pymc as pm

model = (
    ShearBuilding(
        masses=[1.0],  # kg
        storey=BoucWen(k=Uniform(30, 50), c=0.2, alpha=0.05, A=1.0, beta=Uniform(1, 80), gamma=15.0, n=1.2),
    )
    .with_effect(StrengthDegradation(delta_nu=0.6))
    .with_effect(StiffnessDegradation(delta_eta=Uniform(0, 2)))
)

excitation = el_centro("chopra", duration=8.0)
snr_db = 20.0  # dB of mean square
truth = {"k": 40.0, "beta": 30.0, "delta_eta": 0.4}
second_truth = {"k": 37.0, "beta": 35.0, "delta_eta": 0.5}
assumptions = (
    "Both buildings are invented: period near 1 s, yield near a sixth of their weight.",
    "The ground motion is the first 8 s of El Centro 1940, north-south, as printed by Chopra, unscaled.",
    "Rates of degradation differ between buildings of the kind by about 30 %, which is taken as known.",
)

SPREAD = 0.3
"""Standard deviation of the logarithm of the rate of degradation between buildings of the kind."""


def hierarchy(records: Mapping[str, Record]) -> pm.Model:
    """The joint model of one record for each building, by the building's name.

    Parameters
    ----------
    records : mapping of str to Record
        Records of buildings of this kind.

    Returns
    -------
    pymc.Model
        ``delta_eta_typical`` [1/J], ``delta_eta`` over the buildings, and each building's own ``k`` and ``beta``.
    """
    import pymc as pm

    from bwbn_bayes import to_pymc

    with pm.Model(coords={"building": list(records)}) as whole:
        typical = pm.LogNormal("delta_eta_typical", np.log(0.5), 1.0)
        delta_eta = pm.LogNormal("delta_eta", pm.math.log(typical), SPREAD, dims="building")
        for place, (name, record) in enumerate(records.items()):
            to_pymc(model, record, name=name, parameters={"delta_eta": delta_eta[place]})
    return whole
