"""``pm.ode.DifferentialEquation``: SciPy's ``odeint`` on the equations and their sensitivities.

It takes ``odeint``'s default tolerances, and lets nobody set them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytensor
import pytensor.tensor as pt
from pymc.ode import DifferentialEquation

from benchmarks.gradients_of.equations import N_ROWS, chain, squared_residuals
from bwbn_bayes import Record
from bwbn_bayes.structures.structure import Structure


def ode_misfit(model: Structure, record: Record, values: pt.TensorVariable) -> pt.TensorVariable:
    """Squared residuals ``(n_channels,)`` of a chain under a ground motion that is linear between samples."""
    n_storeys, ground = len(model.masses), pt.constant(record.excitation)

    def rates(state: Any, time: Any, parameters: Any) -> Any:
        place = time / record.time_step
        before = pt.clip(pt.floor(place), 0, record.n_times - 2).astype("int64")
        now = ground[before] + (ground[before + 1] - ground[before]) * (place - before)
        return chain(model, parameters).rates(state.reshape((N_ROWS, n_storeys)), now).ravel()

    solved = DifferentialEquation(
        func=rates, times=record.times[1:], n_states=N_ROWS * n_storeys, n_theta=model.space.n_dim, t0=0.0
    )
    states = solved(y0=np.zeros(N_ROWS * n_storeys), theta=values)
    rows = states.reshape((record.n_times - 1, N_ROWS, n_storeys))
    building = chain(model, values)
    response = pytensor.graph.replace.vectorize_graph(
        building.total(one := pt.matrix("state", shape=(N_ROWS, n_storeys))), {one: rows}
    )
    return squared_residuals(record, response)
