"""CVODES with a compiled right-hand side: LLNL's solver through the library that ``sundials4py`` ships.

Its Python callbacks cost more than the solve, so the kernel hands CVODES the addresses of its own functions.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Literal

import llvmlite.binding
import numpy as np

from bwbn_bayes.engines.base import Response, Status
from bwbn_bayes.engines.cvodes_template import CALLBACKS, LIBRARY, SOLVE
from bwbn_bayes.engines.reduction import Reduction
from bwbn_bayes.engines.scalar import (
    Carried,
    ScalarProblem,
    Wanted,
    in_rows,
    scalar_problems,
    solve_each,
)
from bwbn_bayes.errors import UserError, require_installed
from bwbn_bayes.parameters import Booleans, Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure

_STEP_FLAGS = (-1, -2, -3, -4)
"""CVODES: too much work, too much accuracy asked for, error test or convergence failed at the smallest step."""


@dataclass(frozen=True, kw_only=True)
class Cvodes(Reduction):
    """SUNDIALS CVODES.

    Parameters
    ----------
    rtol, atol : float
        Relative and absolute tolerance of the states; those of the sensitivities follow from them, with error control
        on. [1], [m, m/s, J]
    max_steps : int
        Steps allowed in one solve.
    method : {"adams", "bdf"}
        Adams with fixed-point iteration, or BDF with Newton's method and the generated dense Jacobian. The models are
        not stiff as a rule, and Adams is the faster at equal accuracy. Steps run on over the kinks of the excitation at
        the samples: ending them there was measured to cost more and to be less accurate.
    n_threads : int
        Threads over draws.
    """

    rtol: float = 1e-8
    atol: float = 1e-10
    max_steps: int = 1_000_000
    method: Literal["adams", "bdf"] = "adams"
    n_threads: int = 1

    name = "cvodes"

    @property
    def scheme(self) -> str:
        """Scheme and accuracy in words."""
        word = "Adams" if self.method == "adams" else "BDF"
        return f"CVODES {word}, relative tolerance {self.rtol:g}, compiled right-hand side"

    def simulate(
        self, model: Structure, draws: Floats, record: Record, channels: Sequence[str] | None = None
    ) -> Response:
        """Response at the record's times; its measured channels unless others are named."""
        names = tuple(record.channels) if channels is None else tuple(channels)
        return self._solve_each(model, draws, record, names, with_tangents=False)[0]

    def sensitivities(
        self,
        model: Structure,
        draws: Floats,
        record: Record,
        channels: Sequence[str] | None = None,
        *,
        free: Booleans | None = None,
    ) -> tuple[Response, Floats]:
        """Response and its derivatives ``(n_draws, n_parameters, n_channels, n_times)``.

        CVODES solves the sensitivity equations with their exact right-hand side, staggered, with error control; at an
        event of unknown time the sensitivities jump by the difference of the rates.
        """
        names = tuple(record.channels) if channels is None else tuple(channels)
        return self._solve_each(model, draws, record, names, with_tangents=True)

    def _solve_each(
        self, model: Structure, draws: Floats, record: Record, names: tuple[str, ...], *, with_tangents: bool
    ) -> tuple[Response, Floats]:
        load_library()  # code that calls it cannot be loaded before
        wanted = Wanted(entries=("run_cvodes",), with_tangents=with_tangents, further=LIBRARY + CALLBACKS + SOLVE)
        problems = scalar_problems(model, draws, record, names, wanted)
        spread = np.array([parameter.prior.sd for parameter in model.space.parameters])
        scales = np.maximum(np.abs(draws), spread)

        def solve(problem: ScalarProblem, draw: int, carried: Carried, out: Floats) -> Status:
            return self._solve(problem, np.ascontiguousarray(scales[draw]), carried, out)

        return solve_each(problems, solve, self.n_threads)

    def _solve(self, problem: ScalarProblem, scales: Floats, carried: Carried, out: Floats) -> Status:
        n_rows, n_states = carried.state.shape
        flag = problem.kernel.run_cvodes(
            self.method == "bdf",
            self.rtol,
            self.atol,
            self.max_steps,
            scales,
            *problem.channel_arrays,
            *carried,
            np.empty(n_rows, dtype=np.int64),
            np.empty(1, dtype=np.int64),
            np.empty((2, n_states)),
            np.empty(1),
            in_rows(out),
        )
        if flag >= 0:
            return Status.OK
        return Status.STEP_LIMIT if flag in _STEP_FLAGS else Status.NON_FINITE


@cache
def load_library() -> None:
    """Make the symbols of the SUNDIALS library known to compiled code.

    Raises
    ------
    UserError
        If ``sundials4py`` is not installed or its library lacks a function that is called.
    """
    require_installed("cvodes", "engine cvodes")
    library = import_module("sundials4py").__file__ or ""
    try:
        llvmlite.binding.load_library_permanently(library)
    except RuntimeError as error:
        raise UserError(f"the engine cvodes cannot load {library}: reinstall sundials4py") from error
    for name in re.findall(r"def (\w+)", LIBRARY):  # LLVM ends the process where code calls what it cannot find
        if llvmlite.binding.address_of_symbol(name) is None:
            raise UserError(f"the engine cvodes finds no {name} in {library}: install another version of sundials4py")
