"""CVODES through ``sunode``: forward sensitivities and adjoint gradients.

sunode comes from conda-forge only (``environment.yml``), wants SUNDIALS below 6, and is slower than the package's own
:class:`~bwbn_bayes.engines.cvodes.Cvodes`; it is here for those who have it, and as another hand at the same equations.

References
----------
.. [1] A. Seyboldt et al., sunode, https://github.com/pymc-devs/sunode.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from typing import Any, Literal

import numpy as np

from bwbn_bayes.engines.base import Response, Status
from bwbn_bayes.engines.kernel import Functions
from bwbn_bayes.engines.reduction import Reduction
from bwbn_bayes.engines.scalar import Carried, ScalarProblem, Wanted, scalar_problems, solve_each
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Booleans, Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure

_RETRIES = 200
"""Times that SUNDIALS may run out of its 500 steps between two samples."""
_WANTED = Wanted(
    entries=(
        *("prepare", "drive", "strike", "next_event", "ground_at", "rates", "observe"),
        *("rhs", "jacobian", "slopes", "direction"),
    )
)
_WITH_TANGENTS = replace(_WANTED, with_tangents=True)


@dataclass(frozen=True, kw_only=True)
class Sunode(Reduction):
    """SUNDIALS CVODES by way of sunode, one draw at a time.

    Parameters
    ----------
    rtol, atol : float
        Relative and absolute tolerance. [1], [m, m/s, J]
    method : {"adams", "bdf"}
        Linear multistep family; both with Newton's method and the exact Jacobian.
    gradient : {"forward", "adjoint"}
        How a vector-Jacobian product is taken: from forward sensitivities, or by the adjoint, whose cost hardly grows
        with the number of parameters. Tangents themselves are always forward ones.
    """

    rtol: float = 1e-8
    atol: float = 1e-10
    method: Literal["adams", "bdf"] = "adams"
    gradient: Literal["forward", "adjoint"] = "forward"

    name = "sunode"

    @property
    def scheme(self) -> str:
        """Scheme and accuracy in words."""
        word = "Adams" if self.method == "adams" else "BDF"
        return f"CVODES {word} by sunode, relative tolerance {self.rtol:g}, {self.gradient} gradients"

    def simulate(
        self, model: Structure, draws: Floats, record: Record, channels: Sequence[str] | None = None
    ) -> Response:
        """Response at the record's times; its measured channels unless others are named."""
        load_sunode()
        names = tuple(record.channels) if channels is None else tuple(channels)
        problems = scalar_problems(model, draws, record, names, _WANTED)
        return solve_each(problems, self._solve)[0]

    def sensitivities(
        self,
        model: Structure,
        draws: Floats,
        record: Record,
        channels: Sequence[str] | None = None,
        *,
        free: Booleans | None = None,
    ) -> tuple[Response, Floats]:
        """Response and its derivatives ``(n_draws, n_parameters, n_channels, n_times)``, by forward sensitivities.

        They carry error control; at an event of unknown time they jump by the difference of the rates.
        """
        load_sunode()
        names = tuple(record.channels) if channels is None else tuple(channels)
        problems = scalar_problems(model, draws, record, names, _WITH_TANGENTS)
        return solve_each(problems, self._solve)

    def adjoint_pullback(self, model: Structure, draws: Floats, record: Record, cotangents: Floats) -> Floats:
        """Gradients ``(n_draws, n_parameters)`` of ``sum(cotangents * channels)`` by the adjoint; NaN where it failed.

        Parameters
        ----------
        model : Structure
            From rest, without events of unknown time and without sensor effects, for which the adjoint would need
            terms of its own: those and joined records take the forward tangents.
        draws : (n_draws, n_parameters) array
        record : Record
        cotangents : (n_draws, n_channels, n_times) array
        """
        load_sunode()
        problems = scalar_problems(model, draws, record, tuple(record.channels), _WITH_TANGENTS)
        problem, law = problems[0], model.law
        if len(problems) > 1 or problem.sensors is not None or law.events or law.initial or problem.driven:
            slopes = solve_each(problems, self._solve)[1]
            return np.asarray(np.einsum("npct,nct->np", slopes, cotangents))
        return np.array([self._adjoint(problem, i, cotangent) for i, cotangent in enumerate(cotangents)])

    def _solver(self, problem: ScalarProblem) -> Any:
        sizes = problem.n_states, problem.n_directions, len(problem.template)
        return _forward_solver(problem.kernel, *sizes, self.method, self.rtol, self.atol)

    def _solve(self, problem: ScalarProblem, draw: int, carried: Carried, out: Floats) -> Status:
        """Solve from event to event (a driven specimen: from sample to sample) and observe at the samples."""
        kernel, solver = problem.kernel, self._solver(problem)
        numbers = solver._user_data["numbers"]
        numbers[:] = carried.data
        times, tolerance = np.arange(problem.n_times) * problem.time_step, 1e-9 * problem.time_step
        y, tangents = carried.state[0].copy(), carried.state[1:].copy()
        before, after, rate = np.zeros_like(y), np.zeros_like(y), np.zeros_like(y)
        kernel.prepare(numbers)
        kernel.drive(y, numbers, 0)
        kernel.strike(tolerance, 0.0, y, tangents[:0], before, after, numbers)
        now, j = 0.0, 0
        while True:
            event = kernel.next_event(numbers)
            end = min(event, times[min(j + 1, problem.n_times - 1)] if problem.driven else times[-1])
            stops = np.concatenate([[now], times[(times > now + tolerance) & (times < end - tolerance)], [end]])
            try:
                states, slopes = _advance(solver, stops, y, tangents)
            except _solver_errors() as error:
                return Status.STEP_LIMIT if "retries" in str(error) else Status.NON_FINITE
            for stop, state, slope in zip(stops[:-1], states, slopes, strict=False):
                if abs(stop - times[j]) < tolerance:
                    _observe(problem, j, state, slope, numbers, rate, out[j])
                    j += 1
            y, tangents, now = states[-1].copy(), slopes[-1].copy(), end
            if event <= end + tolerance:
                kernel.strike(end + tolerance, kernel.ground_at(end, numbers), y, tangents, before, after, numbers)
            if problem.driven and abs(now - times[j]) < tolerance:
                kernel.drive(y, numbers, j)
            if now >= times[-1] - tolerance:
                _observe(problem, j, y, tangents, numbers, rate, out[j])
                carried.data[:], carried.state[0], carried.state[1:] = numbers, y, tangents
                return Status.OK

    def _adjoint(self, problem: ScalarProblem, draw: int, cotangent: Floats) -> Floats:
        """One backward solve; channels depend on states and on parameters, both through the kernel's own slopes."""
        kernel, n, d = problem.kernel, problem.n_states, problem.n_directions
        solver = _adjoint_solver(kernel, n, d, len(problem.template), self.method, self.rtol, self.atol)
        numbers = solver._user_data["numbers"]
        numbers[:] = problem.data(draw)
        kernel.prepare(numbers)
        times = np.arange(problem.n_times) * problem.time_step
        states, gradient, multiplier = solver.make_output_buffers(times)
        try:
            solver.solve_forward(times[0], times, np.zeros(n), states, max_retries=_RETRIES)
            by_state, by_parameter = _channel_slopes(problem, states, cotangent, numbers)
            solver.solve_backward(times[-1], times[0], times, by_state, gradient, multiplier, max_retries=_RETRIES)
        except _solver_errors():
            return np.full(d, np.nan)
        return np.asarray(by_parameter + gradient)


def _advance(solver: Any, stops: Floats, y: Floats, tangents: Floats) -> tuple[Floats, Floats]:
    """States ``(n_stops, n_states)`` and tangents ``(n_stops, n_directions, n_states)`` at the stops."""
    states = np.empty((len(stops), len(y)))
    slopes = np.empty((len(stops), *tangents.shape))
    options: dict[str, Floats] = {"sens0": tangents, "sens_out": slopes} if len(tangents) else {}
    solver.solve(stops[0], stops, y, states, max_retries=_RETRIES, **options)
    return states, slopes


def _observe(
    problem: ScalarProblem, j: int, y: Floats, tangents: Floats, numbers: Floats, rate: Floats, out: Floats
) -> None:
    kernel = problem.kernel
    kernel.rates(y, kernel.ground_at(j * problem.time_step, numbers), rate, numbers)
    kernel.observe(y, np.ascontiguousarray(tangents), *problem.channel_arrays, numbers, rate, out, j)


def _channel_slopes(
    problem: ScalarProblem, states: Floats, cotangent: Floats, numbers: Floats
) -> tuple[Floats, Floats]:
    """Cotangents times the channels' derivatives: by state ``(n_times, n_states)``, by parameter ``(n_parameters,)``.

    A tangent of the states alone is a direction that moves no parameter: what ``observe`` adds of the parameters is
    found with the states held still and taken off.
    """
    n, d = problem.n_states, problem.n_directions
    by_state, by_parameter = np.zeros_like(states), np.zeros(d)
    rate, out = np.empty(n), np.empty((1 + d, len(problem.channels.names)))
    still = np.zeros((d, n))
    for j, y in enumerate(states):
        _observe(problem, j, y, still, numbers, rate, out)
        own = out[1:].copy()
        by_parameter += own @ cotangent[:, j]
        for first in range(0, n, d):
            rows = np.arange(first, min(first + d, n))
            unit = np.zeros((d, n))
            unit[np.arange(len(rows)), rows] = 1.0
            _observe(problem, j, y, unit, numbers, rate, out)
            by_state[j, rows] = (out[1 : 1 + len(rows)] - own[: len(rows)]) @ cotangent[:, j]
    return by_state, by_parameter


@cache
def _forward_solver(
    kernel: Functions, n_states: int, n_directions: int, n_numbers: int, method: str, rtol: float, atol: float
) -> Any:
    from sunode.solver import Solver

    from bwbn_bayes.engines.sunode_problem import KernelProblem

    problem = KernelProblem(kernel, n_states, n_directions, n_numbers)
    mode = "simultaneous" if n_directions else None
    return Solver(problem, abstol=atol, reltol=rtol, sens_mode=mode, solver=method.upper())


@cache
def _adjoint_solver(
    kernel: Functions, n_states: int, n_directions: int, n_numbers: int, method: str, rtol: float, atol: float
) -> Any:
    from sunode.solver import AdjointSolver

    from bwbn_bayes.engines.sunode_problem import KernelProblem

    problem = KernelProblem(kernel, n_states, n_directions, n_numbers)
    word = method.upper()
    return AdjointSolver(problem, abstol=atol, reltol=rtol, solver=word, adjoint_solver=word)


@cache
def _solver_errors() -> tuple[type[Exception], ...]:
    return (import_module("sunode.solver").SolverError, ValueError)


@cache
def load_sunode() -> None:
    """Import sunode once, its SUNDIALS bound to itself.

    The engine cvodes makes the symbols of another SUNDIALS known to the whole process. Bound to those, sunode's library
    would call functions of another version and crash.

    Raises
    ------
    UserError
        If it is not installed or cannot be loaded.
    """
    flags = sys.getdlopenflags()
    try:
        sys.setdlopenflags(flags | os.RTLD_NOW | getattr(os, "RTLD_DEEPBIND", 0))
        import_module("_sundials_cvodes")
        sys.setdlopenflags(flags)
        import_module("sunode")
    except ImportError as error:
        raise UserError(
            f"the engine sunode needs the package sunode ({error}), on conda-forge only: see environment.yml"
        ) from error
    finally:
        sys.setdlopenflags(flags)
