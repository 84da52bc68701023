"""The frames' competitor: a linear chain of equal masses, a spring and a dashpot for each storey."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter

from benchmarks.measured_tests.fitting import Budget, Fitted, minimised
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record

BUDGET = Budget(members=48, generations=40, rounds=2)


@dataclass(frozen=True, kw_only=True)
class LinearChain:
    """``x_i'' + a_g = -f_i + f_{i+1}``, ``f_i = k_i d_i + c_i d_i'`` with the drifts d; k and c per unit of mass.

    Attributes
    ----------
    n_storeys : int
    """

    n_storeys: int

    name = "linear_chain"

    @property
    def symbols(self) -> tuple[str, ...]:
        """Its parameters: k [1/s^2] and c [1/s] of each storey, lowest first."""
        return tuple(f"{symbol}[{storey}]" for symbol in "kc" for storey in range(1, self.n_storeys + 1))

    def parameters(self, point: Floats) -> Floats:
        """Physical parameters at a point ``(2 n_storeys,)`` of the unit cube: k from 30 to 3e4, c from 1e-3 to 30."""
        k, c = np.split(point, 2)
        return np.concatenate([30.0 * 1e3**k, 1e-3 * 3e4**c])

    def displacements(self, parameters: Floats, record: Record) -> Floats:
        """Floor displacements ``(n_storeys, n_times)`` relative to the base [m], from rest.

        The ground acceleration is linear between samples, the solution exact.
        """
        n = self.n_storeys
        k, c = np.split(parameters, 2)
        drift = np.eye(n) - np.eye(n, k=-1)
        matrix = np.zeros((2 * n + 2, 2 * n + 2))
        matrix[:n, n : 2 * n] = np.eye(n)
        matrix[n : 2 * n, :n] = -drift.T @ np.diag(k) @ drift
        matrix[n : 2 * n, n : 2 * n] = -drift.T @ np.diag(c) @ drift
        matrix[n : 2 * n, 2 * n] = -1.0
        step = expm(record.time_step * matrix + np.eye(2 * n + 2, k=1) * ([0.0] * (2 * n + 1) + [1.0]))
        over, change = step[: 2 * n, 2 * n], step[: 2 * n, 2 * n + 1]
        values, vectors = np.linalg.eig(step[: 2 * n, : 2 * n])
        by_first, by_last = np.linalg.solve(vectors, np.stack([over - change, change], axis=1)).T
        modes = [
            lfilter([last, first], [1.0, -value], record.excitation, zi=[-last * record.excitation[0]])[0]
            for value, first, last in zip(values, by_first, by_last, strict=True)
        ]
        return np.asarray((vectors[:n] @ np.array(modes)).real)

    def fit(self, record: Record, budget: Budget = BUDGET) -> Fitted:
        """Fit it to the displacements of a record, each floor's error over its own rms."""
        measured = record.measured
        scale = 1.0 / np.sqrt(len(measured) * np.sum(np.square(measured), axis=1, keepdims=True))
        return minimised(
            lambda point: (scale * (self.displacements(self.parameters(point), record) - measured)).ravel(),
            2 * self.n_storeys,
            budget,
        )
