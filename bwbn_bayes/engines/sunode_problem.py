"""The generated kernel as a ``sunode`` problem; importing this module needs ``sunode``.

sunode's own SymPy front end takes every state for positive and would drop ``Abs`` and ``sign`` from a hysteretic law,
so the compiled functions of :mod:`~bwbn_bayes.engines.scalar_source` are handed over instead. A draw's flat array
travels as user data.
"""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

import numba
import numpy as np
from sunode.problem import Problem

from bwbn_bayes.parameters import Floats

Compiled = Callable[..., int]


class KernelProblem(Problem):  # type: ignore[misc]
    """Right-hand side, Jacobian, sensitivities and adjoint of one kernel at one size.

    Parameters
    ----------
    kernel : module
        Compiled functions of one storey law.
    n_states, n_directions, n_numbers : int
        Sizes of the state, of the identified parameters and of a draw's flat array.
    """

    def __init__(self, kernel: ModuleType, n_states: int, n_directions: int, n_numbers: int) -> None:
        square, wide = (n_states, n_states), (n_directions, n_states)
        self.kernel = kernel
        self.state_dtype = np.dtype([("y", np.float64, (n_states,))])
        self.user_data_dtype = np.dtype(
            [
                ("numbers", np.float64, (n_numbers,)),
                ("matrix", np.float64, square),
                ("tmp_nparams_nstates", np.float64, wide),
                ("tmp2_nparams_nstates", np.float64, wide),
                ("room", np.float64, (2, n_states)),
            ]
        )
        self._sizes = n_states, n_directions

    @property
    def n_states(self) -> int:
        """Rows of the state."""
        return self._sizes[0]

    @property
    def n_params(self) -> int:
        """Identified parameters."""
        return self._sizes[1]

    def make_rhs(self) -> Compiled:
        """Rates of the states."""
        rhs = self.kernel.rhs

        @numba.njit  # type: ignore[untyped-decorator]
        def rates(out: Floats, t: float, y: Any, user_data: Any) -> int:
            return rhs(t, y.y, out, user_data.numbers)  # type: ignore[no-any-return]

        return rates  # type: ignore[no-any-return]

    def make_jac_dense(self) -> Compiled:
        """Derivative of the rates with respect to the states."""
        jacobian = self.kernel.jacobian

        @numba.njit  # type: ignore[untyped-decorator]
        def jac(out: Floats, _time: float, y: Any, _rates: Floats, user_data: Any) -> int:
            jacobian(y.y, user_data.matrix, user_data.numbers)
            out[:, :] = user_data.matrix.T
            return 0

        return jac  # type: ignore[no-any-return]

    def make_sensitivity_rhs(self) -> Compiled:
        """Rates of the sensitivities, ``out (n_params, n_states)``."""
        slopes, direction, ground_at = self.kernel.slopes, self.kernel.direction, self.kernel.ground_at

        @numba.njit  # type: ignore[untyped-decorator]
        def sensitivity(out: Floats, t: float, y: Any, tangents: Floats, user_data: Any) -> int:
            slopes(y.y, ground_at(t, user_data.numbers), user_data.numbers)
            for k in range(tangents.shape[0]):
                direction(k, tangents[k], out[k], user_data.numbers)
            return 0 if np.isfinite(np.sum(out)) else 1

        return sensitivity  # type: ignore[no-any-return]

    def make_adjoint_rhs(self) -> Compiled:
        """Rates of the adjoint, minus the transposed Jacobian times it."""
        jacobian = self.kernel.jacobian

        @numba.njit  # type: ignore[untyped-decorator]
        def adjoint(out: Floats, _time: float, y: Any, multiplier: Floats, user_data: Any) -> int:
            jacobian(y.y, user_data.matrix, user_data.numbers)
            for i in range(out.shape[0]):
                total = 0.0
                for j in range(out.shape[0]):
                    total -= user_data.matrix[i, j] * multiplier[j]
                out[i] = total
            return 0 if np.isfinite(np.sum(out)) else 1

        return adjoint  # type: ignore[no-any-return]

    def make_adjoint_quad_rhs(self) -> Compiled:
        """Rates of the parameters' gradient: the adjoint times the rates' derivatives at a fixed state."""
        slopes, direction, ground_at = self.kernel.slopes, self.kernel.direction, self.kernel.ground_at

        @numba.njit  # type: ignore[untyped-decorator]
        def quadrature(out: Floats, t: float, y: Any, multiplier: Floats, user_data: Any) -> int:
            slopes(y.y, ground_at(t, user_data.numbers), user_data.numbers)
            still, rate = user_data.room[0], user_data.room[1]
            for k in range(out.shape[0]):
                direction(k, still, rate, user_data.numbers)
                out[k] = np.sum(multiplier * rate)
            return 0 if np.isfinite(np.sum(out)) else 1

        return quadrature  # type: ignore[no-any-return]

    def make_adjoint_jac_dense(self) -> Compiled:
        """Derivative of the adjoint's rates with respect to the adjoint."""
        jacobian = self.kernel.jacobian

        @numba.njit  # type: ignore[untyped-decorator]
        def jac(out: Floats, _time: float, y: Any, _multiplier: Floats, _rates: Floats, user_data: Any) -> int:
            jacobian(y.y, user_data.matrix, user_data.numbers)
            out[:, :] = -user_data.matrix
            return 0

        return jac  # type: ignore[no-any-return]
