"""A structure under a record, solved by an engine: what the operators call, under a key that compiled code can keep.

Compiled graphs outlive the process in PyTensor's cache. They hold no solver and no numbers of the model, only a key,
and the key hashes everything that shapes an answer: change the law, the record, the engine or the code, and it is
another graph.
"""

from __future__ import annotations

import hashlib
import multiprocessing
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from weakref import WeakValueDictionary

import numpy as np

from bwbn_bayes.engines.base import Engine, NormalEquations, check_record, masses
from bwbn_bayes.engines.lane_points import OfPoints
from bwbn_bayes.engines.lane_source import LANES
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.sunode import Sunode
from bwbn_bayes.inference import least_squares
from bwbn_bayes.inference.correlation import Correlation
from bwbn_bayes.inference.likelihood import SolveCount
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.blocks import labels
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure

_ROOMS = ("elements", "structures", "engines", "inference/pymc")
"""Rooms whose code shapes what an operator returns."""


@dataclass(kw_only=True, eq=False)
class ForwardProblem:
    """A model under a record; get one from :func:`forward_problem`, which gives equal problems the same object.

    Attributes
    ----------
    model : Structure
        Shear building or specimen.
    record : Record
        Its channels are what the operators return.
    engine : Engine
        What solves; of those that are alike but for their journal, the last one asked for.
    key : str
        Hash of all that shapes an answer.
    correlation : Correlation or None
        Of the samples' errors: squared residuals are those of whitened ones.
    solves, failures : SolveCount
        Draws solved in this process, and how many of them failed.
    """

    model: Structure
    record: Record
    engine: Engine
    key: str
    correlation: Correlation | None = None
    solves: SolveCount = field(default_factory=SolveCount)
    failures: SolveCount = field(default_factory=SolveCount)

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        """Another process registers the problem anew, under the same key, and counts for itself."""
        return forward_problem, (self.model, self.record, self.engine, self.correlation)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the measured channels."""
        return tuple(self.record.channels)

    @property
    def levels(self) -> tuple[str, ...]:
        """Names of the blocks, which have a noise level each."""
        return labels(self.record)

    @property
    def measured(self) -> Floats:
        """Measured channels ``(n_channels, n_times)``."""
        return self.record.measured

    @cached_property
    def solver(self) -> Engine:
        """The engine; in a worker process on one thread.

        A parent's thread pool does not survive a fork, and chains in processes share the cores already.
        """
        threaded = is_dataclass(self.engine) and any(f.name == "n_threads" for f in fields(self.engine))
        if multiprocessing.parent_process() is not None and threaded:
            return replace(self.engine, n_threads=1)  # type: ignore[type-var]
        return self.engine

    def solve_by(self, engine: Engine) -> None:
        """From now on by an engine of the same answers, as one with another journal is."""
        self.engine = engine
        for solver in ("solver", "_of_points"):
            self.__dict__.pop(solver, None)

    def response(self, values: Floats) -> Floats:
        """Channels ``(n_draws, n_channels, n_times)``; NaN where the solve failed."""
        response = self.solver.simulate(self.model, values, self.record).values
        self._count(np.all(np.isfinite(response), axis=(1, 2)))
        return response

    def response_pullback(self, values: Floats, cotangents: Floats) -> Floats:
        """Products ``(n_draws, n_parameters)`` of cotangents and exact tangents; zero where the solve failed."""
        if isinstance(self.solver, Sunode) and self.has_adjoint:
            return self._counted_slopes(self.solver.adjoint_pullback(self.model, values, self.record, cotangents))
        _, slopes = self.solver.sensitivities(self.model, values, self.record)
        return self._counted_slopes(np.einsum("npct,nct->np", slopes, cotangents))

    def squared_residuals(self, values: Floats, measured: Floats | None = None) -> Floats:
        """Sums over time ``(n_draws, n_blocks)``; infinite where the solve failed."""
        misfit = least_squares.squared_residuals(
            self.solver, self.model, values, self._record_with(measured), self.correlation
        )
        self._count(np.all(np.isfinite(misfit), axis=1))
        return misfit

    def squared_residuals_and_slopes(self, values: Floats, measured: Floats) -> Floats:
        """Both from one solve, ``(n_draws, n_blocks, 1 + n_parameters)``; where it failed infinite, and zero slopes."""
        solve = self._of_points if len(values) <= LANES else None
        if solve is not None:
            misfit, slopes = solve(values, measured)
        else:
            equations = least_squares.normal_equations(
                self.solver, self.model, values, self._record_with(measured), self.correlation
            )
            assert isinstance(equations, NormalEquations)
            misfit, slopes = equations.misfit, -2.0 * equations.gradient
        ok = np.all(np.isfinite(misfit), axis=1) & np.all(np.isfinite(slopes), axis=(1, 2))
        self._count(ok)
        whole = np.concatenate([misfit[..., None], slopes], axis=2)
        failed = np.zeros(whole.shape[1:])
        failed[:, 0] = np.inf
        return np.where(ok[:, None, None], whole, failed)

    @cached_property
    def _of_points(self) -> OfPoints | None:
        # What keeps or spreads answers is another class, and is asked as ever.
        is_plain = type(self.solver) is Lanes and self.correlation is None
        return self.solver.of_points(self.model, self.record) if is_plain and isinstance(self.solver, Lanes) else None

    @property
    def has_adjoint(self) -> bool:
        """Whether products with the derivatives cost no more than one derivative."""
        return isinstance(self.solver, Sunode) and self.solver.gradient == "adjoint" and self.correlation is None

    def log_admissible(self, values: Floats) -> Floats:
        """Zero ``(n_draws,)`` where every joint constraint of the law holds, minus infinity elsewhere."""
        return np.where(self.model.space.admissible(values), 0.0, -np.inf)

    def _record_with(self, measured: Floats | None) -> Record:
        """The record, with other measured channels ``(n_channels, n_times)`` where they are given."""
        if measured is None or np.array_equal(measured, self.measured):
            return self.record
        return self.record.with_channels(dict(zip(self.channels, measured, strict=True)))

    def _count(self, ok: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> None:
        self.solves.add(len(ok))
        self.failures.add(int(np.count_nonzero(~ok)))

    def _counted_slopes(self, products: Floats) -> Floats:
        ok = np.all(np.isfinite(products), axis=1)
        self._count(ok)
        return np.where(ok[:, None], products, 0.0)


_PROBLEMS: WeakValueDictionary[str, ForwardProblem] = WeakValueDictionary()
"""Those that an operator of some graph still holds."""


def forward_problem(
    model: Structure,
    record: Record,
    engine: Engine,
    correlation: Correlation | None = None,
) -> ForwardProblem:
    """The problem of a model, a record, an engine and errors that hang together; one object while they are equal.

    Raises
    ------
    UserError
        If the record does not excite the model in its own way.
    """
    check_record(model, record)
    key = _key(model, record, engine, correlation)
    known = _PROBLEMS.get(key)
    if known is None:
        known = _PROBLEMS[key] = ForwardProblem(
            model=model, record=record, engine=engine, key=key, correlation=correlation
        )
    elif known.engine != engine:
        known.solve_by(engine)
    return known


def solved(quantity: str, key: str, arrays: Sequence[Floats], *measured: Floats) -> Floats:
    """Evaluate one quantity of a registered problem: what compiled code calls.

    Parameters
    ----------
    quantity : str
        Method of :class:`ForwardProblem`.
    key : str
        Of the problem.
    arrays : sequence of arrays
        Values ``(n_parameters,)`` or ``(n_draws, n_parameters)``, and cotangents where the quantity takes them.
    *measured : (n_channels, n_times) array, optional
        In place of the record's.
    """
    single = arrays[0].ndim == 1
    batched = [np.ascontiguousarray(array[None] if single else array, dtype=np.float64) for array in arrays]
    result = getattr(_PROBLEMS[key], quantity)(*batched, *measured)
    return np.ascontiguousarray(result[0] if single else result, dtype=np.float64)


def _key(model: Structure, record: Record, engine: Engine, correlation: Correlation | None) -> str:
    table = model.table
    words = (
        code_digest(),
        type(model).__name__,
        repr(model),
        repr(model.law),
        table.fixed.tobytes().hex(),
        table.index.tobytes().hex(),
        masses(model).tobytes().hex(),
        str(model.space.names),
        record.content_hash,
        type(engine).__qualname__,
        repr(engine),
        *(array.tobytes().hex() for array in (correlation.arrays if correlation is not None else ())),
    )
    return hashlib.sha256("\n".join(words).encode()).hexdigest()


@cache
def code_digest() -> str:
    """Hash of the sources from which kernels are generated and of those that call them."""
    package = Path(__file__).parents[2]
    digest = hashlib.sha256()
    for room in _ROOMS:
        for path in sorted((package / room).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()
