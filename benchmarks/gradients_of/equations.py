"""The equation of motion of a chain of Bouc-Wen storeys in PyTensor, as a PyMC user would write it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytensor.tensor as pt

from bwbn_bayes import Record
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.structure import Structure

_TINY = 1e-12
"""Keeps powers of z differentiable where it is zero."""
_LAW = ("k", "c", "alpha", "beta", "gamma", "n", "delta_nu", "delta_eta")
N_ROWS = 4
"""Of a state: drift [m], drift rate [m/s], hysteretic displacement [m] and energy [J] of each storey."""


@dataclass(frozen=True, kw_only=True)
class Chain:
    """Storeys one on the other with the law's values, expressions ``(n_storeys,)`` by symbol."""

    masses: Floats
    law: dict[str, Any]

    def total(self, state: Any) -> Any:
        """Total accelerations ``(n_storeys,)`` of the floors [m/s^2]."""
        u, v, z = state[0], state[1], state[2]
        k, alpha = self.law["k"], self.law["alpha"]
        force = self.law["c"] * v + alpha * k * u + (1.0 - alpha) * k * z
        return (pt.concatenate([force[1:], pt.zeros(1)]) - force) / self.masses

    def rates(self, state: Any, ground: Any) -> Any:
        """Rates ``(4, n_storeys)`` of a state under a ground acceleration."""
        v, z, epsilon = state[1], state[2], state[3]
        law, floors = self.law, self.total(state)
        size = pt.abs(z) + _TINY
        n = law["n"]
        dissipated = law["beta"] * pt.abs(v) * size ** (n - 1.0) * z + law["gamma"] * v * size**n
        rate = (v - (1.0 + law["delta_nu"] * epsilon) * dissipated) / (1.0 + law["delta_eta"] * epsilon)
        work = (1.0 - law["alpha"]) * law["k"] * z * v
        return pt.stack([v, floors - pt.concatenate([ground[None], floors[:-1]]), rate, work])


def chain(model: Structure, values: Any) -> Chain:
    """A shear building with identified parameters ``(n_parameters,)``."""
    table, masses = model.table, np.array(model.masses)
    symbols = [parameter.symbol for parameter in model.parameters]
    law = {}
    for name in _LAW:
        if name not in symbols:
            law[name] = pt.zeros(len(masses))
            continue
        column = symbols.index(name)
        own = [
            values[index] if index >= 0 else pt.constant(fixed)
            for index, fixed in zip(table.index[:, column], table.fixed[:, column], strict=True)
        ]
        law[name] = pt.stack(own)
    return Chain(masses=masses, law=law)


def squared_residuals(record: Record, response: pt.TensorVariable) -> pt.TensorVariable:
    """Sums ``(n_channels,)`` over samples, floors ``(n_times - 1, n_storeys)`` being those after the first, at rest."""
    floors = [floor - 1 for floor in record.floors]
    first = np.sum(np.square(record.measured[:, 0]))
    rest = pt.constant(record.measured[:, 1:].T) - response[:, floors]
    return pt.sum(pt.square(rest), axis=0) + first
