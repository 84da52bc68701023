"""The reference engine: SciPy's adaptive solvers at tight tolerances. Slow and right.

The excitation is linear between samples, so DOP853 starts anew at every sample and at every event: each piece is smooth
but for the switches of ``sign(v)`` and ``sign(z v)``, where the rates are continuous and their slope jumps; the step
control resolves those.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853, LSODA
from scipy.optimize import brentq

from bwbn_bayes.engines.base import Response, Status
from bwbn_bayes.engines.reduction import Reduction
from bwbn_bayes.engines.scalar import Carried, ScalarProblem, Wanted, scalar_problems, solve_each
from bwbn_bayes.parameters import Booleans, Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure

_SLACK = 1e-9
"""Events within this share of a sample interval of a sample happen at the sample."""
WANTED = Wanted(entries=("prepare", "strike", "drive", "rhs", "see", "next_event"))
"""What it calls of a kernel."""


class _NonFiniteError(ArithmeticError):
    """A rate is not finite."""


class _StepLimitError(ArithmeticError):
    """Too many steps, or a step too small to change the time."""


@dataclass(frozen=True, kw_only=True)
class Reference(Reduction):
    """SciPy's DOP853 or LSODA.

    Parameters
    ----------
    method : {"DOP853", "LSODA"}
        DOP853 starts anew at every sample and event. LSODA, a multistep method, would lose its order by that: it runs
        on from event to event and leaves the kinks of the excitation to its step control; slower per digit.
    rtol, atol : float
        Relative and absolute tolerance of the states. [1], [m, m/s, J] At the defaults the accelerations of a
        three-storey building with a slip of width 0.01 m are right to 1e-10 (NRMSE over 150 s), at 1e-10 to 1e-9:
        verified against runs at 1e-13 and against RK4 with 1024 steps per sample (1e-10).
    max_steps : int
        Steps allowed between two samples.
    difference_step : float
        Step of the central differences behind ``sensitivities``, relative to the larger of the parameter's magnitude
        and its prior standard deviation. At 1e-4 the derivatives are right to about 1e-6.
    """

    method: Literal["DOP853", "LSODA"] = "DOP853"
    rtol: float = 1e-12
    atol: float = 1e-14
    max_steps: int = 20_000
    difference_step: float = 1e-4

    name = "reference"

    @property
    def scheme(self) -> str:
        """Scheme and accuracy in words."""
        return f"SciPy {self.method}, relative tolerance {self.rtol:g}"

    def simulate(
        self, model: Structure, draws: Floats, record: Record, channels: Sequence[str] | None = None
    ) -> Response:
        """Response at the record's times; its measured channels unless others are named."""
        names = tuple(record.channels) if channels is None else tuple(channels)
        problems = scalar_problems(model, draws, record, names, WANTED)
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
        """Response and its derivatives ``(n_draws, n_parameters, n_channels, n_times)`` by central differences."""
        response = self.simulate(model, draws, record, channels)
        spread = np.array([p.prior.sd for p in model.space.parameters])
        slopes = np.empty((len(draws), model.space.n_dim, len(response.channels), record.n_times))
        for k in range(model.space.n_dim):
            step = self.difference_step * np.maximum(np.abs(draws[:, k]), spread[k])
            ends = []
            for side in (1.0, -1.0):
                moved = np.array(draws, dtype=np.float64)
                moved[:, k] += side * step
                ends.append(self.simulate(model, moved, record, channels).values)
            slopes[:, k] = (ends[0] - ends[1]) / (2.0 * step[:, None, None])
        slopes[response.status != Status.OK] = np.nan
        return response, slopes

    def _solve(self, problem: ScalarProblem, draw: int, carried: Carried, out: Floats) -> Status:
        try:
            self._integrate(problem, carried, out)
        except _NonFiniteError:
            return Status.NON_FINITE
        except _StepLimitError:
            return Status.STEP_LIMIT
        return Status.OK

    def _integrate(self, problem: ScalarProblem, carried: Carried, out: Floats) -> None:
        kernel, dt, data = problem.kernel, problem.time_step, carried.data
        slack = _SLACK * dt
        kernel.prepare(data)
        y, rates, seen = carried.state[0], np.zeros(problem.n_states), np.empty(out.shape[2])
        no_tangents = np.zeros((0, problem.n_states))
        kernel.strike(slack, 0.0, y, no_tangents, rates, rates, data)
        piece = self._start(problem, data)
        drive, rhs = kernel.drive.given(y, data), kernel.rhs.given(y, rates, data)
        see = kernel.see.given(y, *problem.channel_arrays, data, seen)
        event = kernel.next_event(data)
        for j in range(problem.n_times):
            drive(j)
            if rhs(j * dt):
                raise _NonFiniteError
            see(j)
            out[j, 0] = seen
            if j + 1 == problem.n_times:
                break
            now, end = j * dt, (j + 1) * dt
            while now < end:
                until = event if event < end - slack else end
                y[:] = piece(now, until, y.copy())
                now = until
                if event <= until + slack:
                    kernel.strike(until + slack, 0.0, y, no_tangents, rates, rates, data)
                    event = kernel.next_event(data)

    def _start(self, problem: ScalarProblem, data: Floats) -> Callable[[float, float, Floats], Floats]:
        """A function that carries the state from one time to another."""
        state, dy = np.empty(problem.n_states), np.empty(problem.n_states)
        rhs = problem.kernel.rhs.given(state, dy, data)

        restarts = self.method == "DOP853"
        nowhere = np.full(problem.n_states, np.nan)

        def rates(t: float, y: Floats) -> Floats:
            state[:] = y
            if not rhs(t):
                return dy.copy()
            if restarts:  # a step tried too far, where a power of z is no number, is tried again, shorter
                return nowhere
            raise _NonFiniteError

        if restarts:
            return _RestartedDop853(rates=rates, engine=self, problem=problem)
        return _ContinuedLsoda(rates=rates, engine=self, problem=problem, data=data)


class _RestartedDop853:
    """Starts at each piece with the step that the last one ended on, and anew at every switch of a sign.

    A step in which a drift rate or a hysteretic displacement changes sign is taken again up to the change, so that no
    step straddles a kink of the law: without this the error at rtol 1e-10 is hundreds of times larger.
    """

    def __init__(self, *, rates: Callable[[float, Floats], Floats], engine: Reference, problem: ScalarProblem) -> None:
        self.rates = rates
        self.engine = engine
        rows = problem.place.n_rows * np.arange(problem.n_links)
        self.watched = np.stack([rows + 1, rows + 2], axis=1).ravel()
        self.shortest = _SLACK * problem.time_step
        self.step = problem.time_step
        self._solver: DOP853 | None = None

    def __call__(self, now: float, until: float, y: Floats) -> Floats:
        solver = self._from(now, until, y)
        for _ in range(self.engine.max_steps):
            before = solver.y[self.watched]
            solver.step()
            if solver.status == "failed":
                raise _StepLimitError
            crossed = self.watched[before * solver.y[self.watched] < 0.0]
            switch = self._first_switch(solver, crossed) if crossed.size else None
            if switch is not None:
                at_switch = self._carry(float(solver.t_old), switch, solver.dense_output()(solver.t_old))
                solver = self._from(switch, until, at_switch)
            elif solver.status == "finished":
                return np.asarray(solver.y, dtype=np.float64)
            self.step = max(float(solver.h_abs), self.shortest)
        raise _StepLimitError

    def _from(self, now: float, until: float, y: Floats) -> DOP853:
        """The solver at the beginning of a piece: one for all of them, since to make one takes as long as two steps."""
        first = min(self.step, until - now)
        solver = self._solver
        if solver is None:
            rates: Any = self.rates  # the stubs ask for a function that also takes complex states
            engine = self.engine
            solver = DOP853(rates, now, y, until, first_step=first, rtol=engine.rtol, atol=engine.atol)
            solver.fun = rates  # without a count and a conversion around it
            self._solver = solver
            return solver
        solver.t, solver.t_bound, solver.status = now, until, "running"
        solver.y, solver.f, solver.h_abs = y, self.rates(now, y), first
        return solver

    def _carry(self, now: float, until: float, y: Floats) -> Floats:
        solver = self._from(now, until, y)
        while solver.status == "running":
            solver.step()
        if solver.status == "failed":
            raise _StepLimitError
        return np.asarray(solver.y, dtype=np.float64)

    def _first_switch(self, solver: DOP853, rows: NDArray[np.int64]) -> float | None:
        """Time of the first change of sign inside the step, None where it is at its ends."""
        dense, start, end = solver.dense_output(), float(solver.t_old), float(solver.t)
        first = min(_root(dense, int(row), start, end) for row in rows)
        return first if start + self.shortest < first < end - self.shortest else None


def _root(dense: Callable[[float], Floats], row: int, start: float, end: float) -> float:
    return float(brentq(lambda t: float(dense(t)[row]), start, end, xtol=1e-15))


class _ContinuedLsoda:
    """Runs on over the samples; starts anew at events and at every sample of a driven specimen."""

    def __init__(
        self, *, rates: Callable[[float, Floats], Floats], engine: Reference, problem: ScalarProblem, data: Floats
    ) -> None:
        self.rates = rates
        self.engine = engine
        self.problem = problem
        self.data = data
        self.solver: LSODA | None = None

    def __call__(self, now: float, until: float, y: Floats) -> Floats:
        slack = _SLACK * self.problem.time_step
        if self.solver is None or (self.solver.t >= self.solver.t_bound):
            self.solver = self._new(now, until, y)
        solver = self.solver
        for _ in range(self.engine.max_steps):
            if solver.t >= until - slack * 1e-3:
                break
            solver.step()
            if solver.status == "failed":
                raise _StepLimitError
        else:
            raise _StepLimitError
        return np.asarray(solver.y if solver.t == until else solver.dense_output()(until), dtype=np.float64)

    def _new(self, now: float, until: float, y: Floats) -> LSODA:
        problem = self.problem
        event = self.problem.kernel.next_event(self.data)
        end = until if problem.driven else min(event, (problem.n_times - 1) * problem.time_step)
        return LSODA(self.rates, now, y, end, rtol=self.engine.rtol, atol=self.engine.atol)
