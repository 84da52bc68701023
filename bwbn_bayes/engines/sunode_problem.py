"""The generated kernel as a ``sunode`` problem; importing this module needs ``sunode``.

sunode's own SymPy front end takes every state for positive and would drop ``Abs`` and ``sign`` from a hysteretic law,
so the compiled functions of :mod:`~bwbn_bayes.engines.scalar_source` are handed over instead, which numba's code calls
by their addresses. A draw's flat array travels as user data.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from sunode.problem import Problem

from bwbn_bayes.engines.kernel import SCALARS, Compiled, Functions
from bwbn_bayes.parameters import Floats

Callback = Callable[..., int]


class KernelProblem(Problem):  # type: ignore[misc]
    """Right-hand side, Jacobian, sensitivities and adjoint of one kernel at one size.

    Parameters
    ----------
    kernel : Functions
        Compiled functions of one storey law.
    n_states, n_directions, n_numbers : int
        Sizes of the state, of the identified parameters and of a draw's flat array.
    """

    def __init__(self, kernel: Functions, n_states: int, n_directions: int, n_numbers: int) -> None:
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

    def make_rhs(self) -> Callback:
        """Rates of the states."""
        rhs = _for_numba(self.kernel.rhs)

        @numba.njit  # type: ignore[untyped-decorator]
        def rates(out: Floats, t: float, y: Any, user_data: Any) -> int:
            y, data = y.y, user_data.numbers
            return rhs(y.ctypes, y.size, out.ctypes, out.size, data.ctypes, data.size, t)  # type: ignore[no-any-return]

        return rates  # type: ignore[no-any-return]

    def make_jac_dense(self) -> Callback:
        """Derivative of the rates with respect to the states."""
        jacobian = self._jacobian()

        @numba.njit  # type: ignore[untyped-decorator]
        def jac(out: Floats, _time: float, y: Any, _rates: Floats, user_data: Any) -> int:
            jacobian(y.y, user_data)
            out[:, :] = user_data.matrix.T
            return 0

        return jac  # type: ignore[no-any-return]

    def make_sensitivity_rhs(self) -> Callback:
        """Rates of the sensitivities, ``out (n_params, n_states)``."""
        slopes, direction = self._slopes(), self._direction()

        @numba.njit  # type: ignore[untyped-decorator]
        def sensitivity(out: Floats, t: float, y: Any, tangents: Floats, user_data: Any) -> int:
            slopes(t, y.y, user_data.numbers)
            for k in range(tangents.shape[0]):
                direction(k, tangents[k], out[k], user_data.numbers)
            return 0 if np.isfinite(np.sum(out)) else 1

        return sensitivity  # type: ignore[no-any-return]

    def make_adjoint_rhs(self) -> Callback:
        """Rates of the adjoint, minus the transposed Jacobian times it."""
        jacobian = self._jacobian()

        @numba.njit  # type: ignore[untyped-decorator]
        def adjoint(out: Floats, _time: float, y: Any, multiplier: Floats, user_data: Any) -> int:
            jacobian(y.y, user_data)
            for i in range(out.shape[0]):
                total = 0.0
                for j in range(out.shape[0]):
                    total -= user_data.matrix[i, j] * multiplier[j]
                out[i] = total
            return 0 if np.isfinite(np.sum(out)) else 1

        return adjoint  # type: ignore[no-any-return]

    def make_adjoint_quad_rhs(self) -> Callback:
        """Rates of the parameters' gradient: the adjoint times the rates' derivatives at a fixed state."""
        slopes, direction = self._slopes(), self._direction()

        @numba.njit  # type: ignore[untyped-decorator]
        def quadrature(out: Floats, t: float, y: Any, multiplier: Floats, user_data: Any) -> int:
            slopes(t, y.y, user_data.numbers)
            still, rate = user_data.room[0], user_data.room[1]
            for k in range(out.shape[0]):
                direction(k, still, rate, user_data.numbers)
                out[k] = np.sum(multiplier * rate)
            return 0 if np.isfinite(np.sum(out)) else 1

        return quadrature  # type: ignore[no-any-return]

    def make_adjoint_jac_dense(self) -> Callback:
        """Derivative of the adjoint's rates with respect to the adjoint."""
        jacobian = self._jacobian()

        @numba.njit  # type: ignore[untyped-decorator]
        def jac(out: Floats, _time: float, y: Any, _multiplier: Floats, _rates: Floats, user_data: Any) -> int:
            jacobian(y.y, user_data)
            out[:, :] = -user_data.matrix
            return 0

        return jac  # type: ignore[no-any-return]

    def _slopes(self) -> Callable[..., None]:
        """The table of partial derivatives at time t, into ``data``."""
        slopes, ground_at = _for_numba(self.kernel.slopes), _for_numba(self.kernel.ground_at)

        @numba.njit  # type: ignore[untyped-decorator]
        def slopes_at(t: float, y: Floats, data: Floats) -> None:
            ground = ground_at(t, data.ctypes, data.size)
            slopes(y.ctypes, y.size, ground, data.ctypes, data.size)

        return slopes_at  # type: ignore[no-any-return]

    def _direction(self) -> Callable[..., None]:
        """Rates of the tangent in direction k."""
        direction = _for_numba(self.kernel.direction)

        @numba.njit  # type: ignore[untyped-decorator]
        def direction_of(k: int, tangent: Floats, rate: Floats, data: Floats) -> None:
            direction(k, tangent.ctypes, tangent.size, rate.ctypes, rate.size, data.ctypes, data.size)

        return direction_of  # type: ignore[no-any-return]

    def _jacobian(self) -> Callable[..., None]:
        """The Jacobian, transposed, into ``user_data.matrix``."""
        jacobian, n_states = _for_numba(self.kernel.jacobian), self.n_states

        @numba.njit  # type: ignore[untyped-decorator]
        def transposed(y: Floats, user_data: Any) -> None:
            matrix, unit, data = user_data.matrix, user_data.room[1], user_data.numbers
            jacobian(y.ctypes, y.size, matrix.ctypes, n_states, n_states, unit.ctypes, n_states, data.ctypes, data.size)

        return transposed  # type: ignore[no-any-return]


def _for_numba(function: Compiled) -> Callable[..., Any]:
    """A compiled function as numba's code calls it: an array is its address and its sizes."""
    words: list[Any] = []
    for _, kind in function.signature.parameters:
        if isinstance(kind, tuple):
            words += [ctypes.c_void_p, *[ctypes.c_int64] * kind[1]]
        else:
            words.append(SCALARS[kind])
    returns = function.signature.returns
    return ctypes.CFUNCTYPE(None if returns is None else SCALARS[returns], *words)(function.address)
