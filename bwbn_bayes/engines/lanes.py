"""The default engine: generated numba code that advances sixteen draws at once, threads over blocks of sixteen.

A draw's result depends on its own parameters only: every operation is the same for each lane, a lane that needs no
step takes one of length zero, and unfilled lanes repeat the last draw.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import platform
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType

import llvmlite
import llvmlite.binding
import numba
import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.elements.law import StoreyLaw
from bwbn_bayes.engines.base import (
    ChannelMap,
    NormalEquations,
    Response,
    Status,
    channel_map,
    check_record,
    masses,
    measured_matrix,
)
from bwbn_bayes.engines.codegen import law_programs, spelled
from bwbn_bayes.engines.lane_source import LANES, lane_source
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure


@dataclass(frozen=True, kw_only=True)
class Lanes:
    """Runge-Kutta of order 4 on sixteen draws at once.

    Parameters
    ----------
    substeps : int
        Steps between two samples.
    resolution : float
        Largest change of a sharp state (the hysteretic displacement at the slip) per step, in widths of the feature;
        0 keeps the steps equal. Each draw refines its own steps.
    n_threads : int
        Threads over blocks of sixteen draws.
    """

    substeps: int = 1
    resolution: float = 0.0
    n_threads: int = os.cpu_count() or 1

    name = "lanes"

    @property
    def scheme(self) -> str:
        """Scheme and accuracy in words."""
        refined = f", refined to {self.resolution:g} widths per step at the slip" if self.resolution else ""
        return f"RK4, {self.substeps} step{'s' if self.substeps > 1 else ''} per sample{refined}, {LANES} lanes"

    def simulate(
        self, model: Structure, draws: Floats, record: Record, channels: Sequence[str] | None = None
    ) -> Response:
        """Response at the record's times; its measured channels unless others are named."""
        names = tuple(record.channels) if channels is None else tuple(channels)
        values, _ = self._stored(model, draws, record, names, with_tangents=False)
        return _response(names, values)

    def sensitivities(
        self, model: Structure, draws: Floats, record: Record, channels: Sequence[str] | None = None
    ) -> tuple[Response, Floats]:
        """Response and its derivatives ``(n_draws, n_parameters, n_channels, n_times)``."""
        names = tuple(record.channels) if channels is None else tuple(channels)
        values, slopes = self._stored(model, draws, record, names, with_tangents=True)
        return _response(names, values), slopes

    def misfit(self, model: Structure, draws: Floats, record: Record) -> Floats:
        """Sum of squared residuals ``(n_draws, n_channels)``; infinite where the solve failed."""
        problem = _Problem.build(model, record, tuple(record.channels), with_tangents=False)
        result = np.empty((len(draws), len(record.channels)))

        def solve(block: _Block) -> None:
            outcome = problem.run(self, block.parameters, store=False)
            result[block.rows] = outcome.misfit.reshape(-1, LANES).T[: block.n_draws]

        self._over_blocks(problem, model, draws, solve)
        return np.where(np.isfinite(result), result, np.inf)

    def normal_equations(self, model: Structure, draws: Floats, record: Record) -> NormalEquations:
        """Least squares in summary over the measured channels, summed inside the kernel."""
        problem = _Problem.build(model, record, tuple(record.channels), with_tangents=True)
        n, c, d = len(draws), len(record.channels), model.space.n_dim
        misfit, gradient, information = np.empty((n, c)), np.empty((n, c, d)), np.empty((n, c, d, d))
        left, right = np.tril_indices(d)

        def solve(block: _Block) -> None:
            outcome = problem.run(self, block.parameters, store=False)
            misfit[block.rows] = outcome.misfit.reshape(c, LANES).T[: block.n_draws]
            gram = np.moveaxis(outcome.gram.reshape(c, -1, LANES), 2, 0)[: block.n_draws]
            triangle = _unpack(gram, d)
            gradient[block.rows] = triangle[..., 1:, 0]
            full = np.zeros((block.n_draws, c, d, d))
            full[..., left, right] = triangle[..., 1:, 1:][..., left, right]
            full[..., right, left] = full[..., left, right]
            information[block.rows] = full

        self._over_blocks(problem, model, draws, solve)
        return NormalEquations(misfit=np.where(np.isfinite(misfit), misfit, np.inf), gradient=gradient, information=information)

    def _stored(
        self, model: Structure, draws: Floats, record: Record, names: tuple[str, ...], *, with_tangents: bool
    ) -> tuple[Floats, Floats]:
        problem = _Problem.build(model, record, names, with_tangents=with_tangents)
        d = problem.n_directions
        values = np.empty((len(draws), len(names), record.n_times))
        slopes = np.empty((len(draws), d, len(names), record.n_times))

        def solve(block: _Block) -> None:
            stored = problem.run(self, block.parameters, store=True).stored
            table = np.moveaxis(stored.reshape(record.n_times, 1 + d, len(names), LANES), (0, 3), (3, 0))
            values[block.rows] = table[: block.n_draws, 0]
            slopes[block.rows] = table[: block.n_draws, 1:]

        self._over_blocks(problem, model, draws, solve)
        return values, slopes

    def _over_blocks(
        self, problem: _Problem, model: Structure, draws: Floats, solve: Callable[[_Block], None]
    ) -> None:
        local = model.table.local(np.asarray(draws, dtype=np.float64))
        blocks = [_Block.of(local, start) for start in range(0, len(draws), LANES)]
        if self.n_threads == 1 or len(blocks) == 1:
            for block in blocks:
                solve(block)
        else:
            list(_pool(self.n_threads).map(solve, blocks))


@dataclass(frozen=True, kw_only=True)
class _Block:
    rows: slice
    n_draws: int
    parameters: Floats

    @classmethod
    def of(cls, local: Floats, start: int) -> _Block:
        """Sixteen draws from ``start`` in lane order; a short last block repeats its last draw."""
        chosen = np.minimum(np.arange(start, start + LANES), len(local) - 1)
        n_draws = min(LANES, len(local) - start)
        lanes_last = np.ascontiguousarray(np.moveaxis(local[chosen], 0, 2)).ravel()
        return cls(rows=slice(start, start + n_draws), n_draws=n_draws, parameters=lanes_last)


@dataclass(frozen=True, kw_only=True)
class _Outcome:
    misfit: Floats
    gram: Floats
    stored: Floats


@dataclass(frozen=True, kw_only=True)
class _Problem:
    """What every block of one call shares."""

    kernel: ModuleType
    n_storeys: int
    n_directions: int
    time_step: float
    excitation: Floats
    inverse_masses: Floats
    seed: NDArray[np.int64]
    channels: ChannelMap
    measured: Floats

    @classmethod
    def build(cls, model: Structure, record: Record, names: tuple[str, ...], *, with_tangents: bool) -> _Problem:
        check_record(model, record)
        known = all(name in record.channels for name in names)
        return cls(
            kernel=kernel_module(model.law, driven=model.excitation_kind == "displacement"),
            n_storeys=model.n_storeys,
            n_directions=model.space.n_dim if with_tangents else 0,
            time_step=record.time_step,
            excitation=np.array(record.excitation),  # a copy: read-only arrays are another type to numba
            inverse_masses=np.repeat(1.0 / masses(model), LANES),
            seed=_seed(model) if with_tangents else np.zeros(1, dtype=np.int64),
            channels=channel_map(model, names),
            measured=measured_matrix(record, names) if known else np.zeros((len(names), record.n_times)),
        )

    def run(self, engine: Lanes, parameters: Floats, *, store: bool) -> _Outcome:
        c, d = len(self.channels.names), self.n_directions
        outcome = _Outcome(
            misfit=np.zeros(c * LANES),
            gram=np.zeros(c * (d * (d + 3) // 2) * LANES if not store else 1),
            stored=np.zeros(len(self.excitation) * c * (1 + d) * LANES if store else 1),
        )
        self.kernel.run(
            self.n_storeys,
            d,
            self.time_step,
            self.excitation,
            parameters,
            self.inverse_masses,
            self.seed,
            engine.substeps,
            float(engine.resolution),
            self.channels.starts,
            self.channels.row,
            self.channels.coefficient,
            self.channels.ground,
            self.measured,
            outcome.misfit,
            outcome.gram,
            store,
            outcome.stored,
        )
        return outcome


def _unpack(gram: Floats, d: int) -> Floats:
    """Lower triangle rows 1 to d of the products of (residual, slopes), packed row by row, as a square."""
    square = np.zeros((*gram.shape[:-1], d + 1, d + 1))
    position = 0
    for a in range(1, d + 1):
        square[..., a, : a + 1] = gram[..., position : position + a + 1]
        position += a + 1
    return square


def _seed(model: Structure) -> NDArray[np.int64]:
    """For each storey and direction, the column of the law's derivative table that the direction moves."""
    first = 2 + len(model.law.states)
    none = first + len(model.law.parameters)
    seed = np.full((model.n_storeys, model.space.n_dim), none, dtype=np.int64)
    for storey, row in enumerate(model.table.index):
        for column, parameter in enumerate(row):
            if parameter >= 0:
                seed[storey, parameter] = first + column
    return np.ascontiguousarray(seed.ravel()) if seed.size else np.zeros(1, dtype=np.int64)


def _response(names: tuple[str, ...], values: Floats) -> Response:
    failed = ~np.all(np.isfinite(values), axis=(1, 2))
    values[failed] = np.nan
    return Response(channels=names, values=values, status=np.where(failed, Status.NON_FINITE, Status.OK).astype(np.int64))


@cache
def _pool(n_threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=n_threads, thread_name_prefix="lanes")


def kernel_module(law: StoreyLaw, *, driven: bool) -> ModuleType:
    """The compiled kernel of a law: generated once, kept on disk under a hash of everything that shapes it."""
    return _load_kernel(_source_of(law, driven))


@cache
def _source_of(law: StoreyLaw, driven: bool) -> str:
    safe = spelled(law)
    return lane_source(safe, law_programs(safe), driven=driven)


@cache
def _load_kernel(source: str) -> ModuleType:
    features = llvmlite.binding.get_host_cpu_name() + llvmlite.binding.get_host_cpu_features().flatten()
    shaped_by = (source, features, numba.__version__, llvmlite.__version__, platform.python_version())
    key = hashlib.sha256("\n".join(shaped_by).encode()).hexdigest()[:20]
    path = cache_directory() / f"lanes_{key}.py"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_suffix(f".{os.getpid()}.tmp")
        temporary.write_text(source)
        temporary.replace(path)
    name = f"bwbn_bayes_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"cannot load the generated kernel {path}")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def cache_directory() -> Path:
    """Where generated kernels are kept: ``$BWBN_CACHE_DIR``, or ``bwbn_bayes`` in the user's cache directory."""
    own = os.environ.get("BWBN_CACHE_DIR")
    if own:
        return Path(own)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "bwbn_bayes"
