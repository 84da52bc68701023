"""Classical Runge-Kutta steps in ``pytensor.scan``, differentiated by PyTensor."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytensor
import pytensor.tensor as pt

from benchmarks.gradients_of.equations import N_ROWS, chain, squared_residuals
from bwbn_bayes import Record
from bwbn_bayes.structures.structure import Structure


def scan_misfit(model: Structure, record: Record, values: pt.TensorVariable, substeps: int) -> pt.TensorVariable:
    """Squared residuals ``(n_channels,)`` of a chain under a ground motion, by a scan over samples."""
    building = chain(model, values)
    h = record.time_step / substeps

    def between(now: Any, rise: Any, state: Any) -> Any:
        for step in range(substeps):
            begin, middle, end = (now + rise * (step + share) / substeps for share in (0.0, 0.5, 1.0))
            k1 = building.rates(state, begin)
            k2 = building.rates(state + 0.5 * h * k1, middle)
            k3 = building.rates(state + 0.5 * h * k2, middle)
            k4 = building.rates(state + h * k3, end)
            state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return state, building.total(state)

    ground = record.excitation
    _, response = pytensor.scan(
        between,
        sequences=[pt.constant(ground[:-1]), pt.constant(np.diff(ground))],
        outputs_info=[pt.zeros((N_ROWS, len(building.masses))), None],
        return_updates=False,
    )
    return squared_residuals(record, response)
