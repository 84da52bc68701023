"""One draw at a time: the problem that SciPy, CVODES and the scalar Runge-Kutta solve, and the last as an engine.

The scalar Runge-Kutta is the scheme of the lane engine without its lanes: the measure of what the lanes bring.
"""

from __future__ import annotations

import platform
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
import sympy
from numpy.typing import NDArray

from bwbn_bayes.elements.law import StoreyLaw
from bwbn_bayes.engines import codegen
from bwbn_bayes.engines.base import (
    ChannelMap,
    Response,
    Status,
    channel_map,
    check_record,
    masses,
)
from bwbn_bayes.engines.codegen import LawPrograms, law_programs, packed, spelled, unpacked
from bwbn_bayes.engines.kept_code import is_remembered, remembered
from bwbn_bayes.engines.kernel import Functions, Kernel
from bwbn_bayes.engines.observation import Sensors, read_all, sensors_of
from bwbn_bayes.engines.reduction import Reduction
from bwbn_bayes.engines.scalar_source import HEAD, Layout, layout, scalar_source
from bwbn_bayes.engines.step_rules import interval_steps, steps_in_words
from bwbn_bayes.engines.stretches import Stretch, event_columns, starting_terms, stretches_of
from bwbn_bayes.parameters import Booleans, Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure


@dataclass(frozen=True, kw_only=True)
class ScalarProblem:
    """What all draws of one call share on one stretch of the record.

    Attributes
    ----------
    kernel : Functions
        Those of :mod:`~bwbn_bayes.engines.scalar_source` that the engine asked for.
    place : Layout
        Where things stand in ``data``.
    n_links, n_states, n_directions, n_times : int
        Sizes; ``n_directions`` is zero without sensitivities.
    stretch : Stretch
        Samples of one time step.
    driven : bool
        Whether the displacement is given.
    template : (n_data,) array
        ``data`` without the law parameters.
    channels : ChannelMap
        What is asked for.
    local : (n_draws, n_links, n_law) array
        Law parameters of each draw.
    model : Structure
        What is solved.
    sensors : Sensors or None
        What stands between the floors and the channels.
    sensor_parameters : (n_draws, n_links, n_sensor_parameters) array
        Of each draw.
    """

    kernel: Functions
    place: Layout
    n_links: int
    n_states: int
    n_directions: int
    n_times: int
    stretch: Stretch
    driven: bool
    template: Floats
    channels: ChannelMap
    local: Floats
    model: Structure
    sensors: Sensors | None
    sensor_parameters: Floats

    @property
    def time_step(self) -> float:
        """Time between samples [s]."""
        return self.stretch.time_step

    def data(self, draw: int, before: Floats | None = None) -> Floats:
        """The flat array of one draw, its own copy; events that have happened ``before`` have happened in it."""
        data, own = self.template.copy(), slice(HEAD, self.place.seed(self.n_links))
        blocks = data[own].reshape(self.n_links, self.place.block)
        blocks[:, : self.local.shape[2]] = self.local[draw]
        blocks[:, event_columns(self.model)] -= self.stretch.begin
        if before is not None:
            happened = slice(self.place.happened, self.place.inverse_mass)
            blocks[:, happened] = before[own].reshape(blocks.shape)[:, happened]
        return data

    def start(self, draw: int) -> Floats:
        """States before the first sample and their derivatives, ``(1 + n_directions, n_states)``."""
        state, index = np.zeros((1 + self.n_directions, self.n_states)), self.model.table.index
        for term in starting_terms(self.model):
            row = term.link * self.place.n_rows + term.row
            state[0, row] += term.factor * self.local[draw, term.source, term.column]
            parameter = index[term.source, term.column]
            if parameter >= 0 and self.n_directions:
                state[1 + parameter, row] += term.factor
        return state

    @property
    def excitation(self) -> Floats:
        """The record's, ``(n_times,)``."""
        start = self.place.excitation(self.n_links, self.n_directions)
        return self.template[start : start + self.n_times]

    def empty_output(self) -> Floats:
        """Room for channels and their derivatives ``(n_times, 1 + n_directions, n_channels)``."""
        return np.full((self.n_times, 1 + self.n_directions, len(self.channels.names)), np.nan)

    @property
    def channel_arrays(self) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats, Floats]:
        """The channel map as the kernel takes it."""
        return self.channels.starts, self.channels.row, self.channels.coefficient, self.channels.ground


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """What an engine asks of a law's kernel.

    Attributes
    ----------
    entries : tuple of str
        Functions of the text, compiled together.
    with_tangents : bool
        Whether they march and observe with derivatives.
    further : str
        Text after that of :mod:`~bwbn_bayes.engines.scalar_source`.
    """

    entries: tuple[str, ...]
    with_tangents: bool = False
    further: str = ""


def scalar_problems(
    model: Structure, draws: Floats, record: Record, names: Sequence[str], wanted: Wanted
) -> tuple[ScalarProblem, ...]:
    """Set up the draws of a model under a record, stretch by stretch.

    Parameters
    ----------
    model : Structure
        What is solved.
    draws : (n_draws, n_parameters) array
        In the parameters' own units.
    record : Record
        Its excitation must be of the model's kind.
    names : sequence of str
        Channels to observe.
    wanted : Wanted
        Functions of the kernel, and whether derivatives with respect to the identified parameters are wanted.

    Raises
    ------
    UserError
        If the record does not excite the model in its own way, or a channel is not known.
    """
    check_record(model, record)
    driven = model.excitation_kind == "displacement"
    place = layout(*programs_of(model.law))
    n, d = model.n_links, model.space.n_dim if wanted.with_tangents else 0
    local, n_law = model.table.local(np.asarray(draws, dtype=np.float64)), len(model.law.parameters)

    def on(stretch: Stretch) -> ScalarProblem:
        own = tuple(names) if stretch.samples is not None else ()
        return ScalarProblem(
            kernel=scalar_kernel(model.law, driven, wanted),
            place=place,
            n_links=n,
            n_states=place.n_states(n),
            n_directions=d,
            n_times=len(stretch.inputs),
            stretch=stretch,
            driven=driven,
            template=_template(model, stretch, place, d),
            channels=channel_map(model, own),
            local=local[..., :n_law],
            model=model,
            sensors=sensors_of(model, record, stretch, own),
            sensor_parameters=local[..., n_law:],
        )

    return tuple(map(on, stretches_of(record)))


def _template(model: Structure, stretch: Stretch, place: Layout, d: int) -> Floats:
    n, driving = model.n_links, stretch.inputs.T
    template = np.zeros(place.excitation(n, d) + driving.size)
    template[:HEAD] = n, stretch.time_step, len(stretch.inputs), d, len(driving)
    blocks = template[HEAD : place.seed(n)].reshape(n, place.block)
    blocks[:, place.inverse_mass] = 1.0 / masses(model)
    blocks[:, [place.lower, place.upper]] = model.joints
    blocks[:, place.runs_on_from] = model.runs_on_from
    for row, floor in enumerate(stretch.forced_floors):
        blocks[floor - 1, place.force_row] = 1 + row
    if d:
        template[place.seed(n) : place.excitation(n, d)] = _columns(model, place).ravel()
    template[place.excitation(n, d) :] = driving.ravel()
    return template


def _columns(model: Structure, place: Layout) -> Floats:
    """For each link and direction, the column of the table of partials that the direction moves."""
    first = 2 + len(model.law.states)
    columns = np.full((model.n_links, model.space.n_dim), place.n_columns - 1, dtype=np.float64)
    for link, row in enumerate(model.table.index):
        for column, parameter in enumerate(row[: len(model.law.parameters)]):
            if parameter >= 0:
                columns[link, parameter] = first + column
    return columns


@cache
def programs_of(law: StoreyLaw) -> tuple[StoreyLaw, LawPrograms]:
    """The law with names that no kernel uses, and as straight-line code; generated once and kept on disk."""
    safe = spelled(law)
    return safe, unpacked(remembered("programs", _key_of(safe), lambda: packed(law_programs(safe))), safe)


def has_programs(law: StoreyLaw) -> bool:
    """Whether the cache holds a law as straight-line code, which takes seconds to generate."""
    return is_remembered("programs", _key_of(spelled(law)))


def _key_of(safe: StoreyLaw) -> str:
    generator = Path(codegen.__file__).read_text()
    return "\n".join((repr(safe), generator, sympy.__version__, platform.python_version()))


@cache
def scalar_kernel(law: StoreyLaw, driven: bool, wanted: Wanted) -> Functions:
    """Compiled functions of the scalar kernel of a law."""
    source = scalar_source(*programs_of(law), driven=driven, with_tangents=wanted.with_tangents)
    return Kernel("scalar", source + wanted.further).functions(*wanted.entries)


def in_rows(out: Floats) -> Floats:
    """Room for channels and their derivatives as kernels take it, ``(n_times * (1 + n_directions), n_channels)``."""
    return out.reshape(out.shape[0] * out.shape[1], out.shape[2])


class Carried(NamedTuple):
    """What a solve of one draw begins with and changes in place: the next stretch may begin with it."""

    data: Floats
    """The flat array of the draw."""
    state: Floats
    """States and their derivatives, ``(1 + n_directions, n_states)``."""


class SolveOne(Protocol):
    """Solves one draw of a problem into ``out (n_times, 1 + n_directions, n_channels)`` and says what became of it."""

    def __call__(self, problem: ScalarProblem, draw: int, carried: Carried, out: Floats) -> Status:
        """Solve draw number ``draw``."""
        ...


def solve_each(problems: Sequence[ScalarProblem], solve: SolveOne, n_threads: int = 1) -> tuple[Response, Floats]:
    """Solve the draws one by one, each stretch after stretch.

    Returns
    -------
    tuple of Response and (n_draws, n_directions, n_channels, n_times) array
        NaN where a draw failed or a number is not finite.
    """
    asked = [problem for problem in problems if problem.stretch.samples is not None]
    first, n_times = problems[0], sum(problem.n_times for problem in asked)
    n_draws, names = len(first.local), first.channels.names
    values = np.full((n_draws, len(names), n_times), np.nan)
    slopes = np.full((n_draws, first.n_directions, len(names), n_times), np.nan)
    status = np.full(n_draws, Status.NON_FINITE, dtype=np.int64)

    def one(draw: int) -> None:
        status[draw] = _solve_stretches(problems, solve, draw, values[draw], slopes[draw])

    if n_threads == 1 or n_draws == 1:
        for draw in range(n_draws):
            one(draw)
    else:
        with ThreadPoolExecutor(n_threads) as pool:
            list(pool.map(one, range(n_draws)))
    read_all([problem.sensors for problem in asked], first.sensor_parameters, values, slopes)
    failed = ~np.all(np.isfinite(values), axis=(1, 2))
    status[failed & (status == Status.OK)] = Status.NON_FINITE
    values[failed], slopes[failed] = np.nan, np.nan
    return Response(channels=names, values=values, status=status), slopes


def _solve_stretches(
    problems: Sequence[ScalarProblem], solve: SolveOne, draw: int, values: Floats, slopes: Floats
) -> Status:
    """Fill a draw's channels ``(n_channels, n_times)`` and derivatives, as far as it can be solved."""
    if not np.all(np.isfinite(problems[0].local[draw])):
        return Status.NON_FINITE
    carried: Carried | None = None
    for problem in problems:
        if carried is None or not problem.stretch.is_carried:
            carried = Carried(problem.data(draw), problem.start(draw))
        else:
            carried = Carried(problem.data(draw, carried.data), carried.state)
        out = problem.empty_output()
        status = solve(problem, draw, carried, out)
        if status != Status.OK or not np.all(np.isfinite(out)):
            return Status.NON_FINITE if status == Status.OK else status
        if problem.stretch.samples is not None:
            values[:, problem.stretch.samples] = out[:, 0].T
            slopes[..., problem.stretch.samples] = np.moveaxis(out[:, 1:], 0, 2)
    return Status.OK


_ENTRIES = ("run_rk4",)


@dataclass(frozen=True, kw_only=True)
class ScalarRk4(Reduction):
    """Runge-Kutta of order 4, one draw at a time.

    Parameters
    ----------
    substeps : int
        Steps between two samples at least; an event splits the step it falls in.
    resolution : float
        As for :class:`~bwbn_bayes.engines.lanes.Lanes`.
    n_threads : int
        Threads over draws.
    """

    substeps: int = 1
    resolution: float = 0.0
    n_threads: int = 1

    name = "scalar"

    @property
    def scheme(self) -> str:
        """Scheme and accuracy in words."""
        return f"RK4, {steps_in_words(self.substeps, self.resolution)}, one draw at a time"

    def simulate(
        self, model: Structure, draws: Floats, record: Record, channels: Sequence[str] | None = None
    ) -> Response:
        """Response at the record's times; its measured channels unless others are named."""
        names = tuple(record.channels) if channels is None else tuple(channels)
        problems = scalar_problems(model, draws, record, names, Wanted(entries=_ENTRIES))
        return solve_each(problems, self._solve, self.n_threads)[0]

    def sensitivities(
        self,
        model: Structure,
        draws: Floats,
        record: Record,
        channels: Sequence[str] | None = None,
        *,
        free: Booleans | None = None,
    ) -> tuple[Response, Floats]:
        """Response and its derivatives ``(n_draws, n_parameters, n_channels, n_times)``."""
        names = tuple(record.channels) if channels is None else tuple(channels)
        problems = scalar_problems(model, draws, record, names, Wanted(entries=_ENTRIES, with_tangents=True))
        return solve_each(problems, self._solve, self.n_threads)

    def _solve(self, problem: ScalarProblem, draw: int, carried: Carried, out: Floats) -> Status:
        steps = interval_steps(problem.excitation, self.substeps, driven=problem.driven)
        room = np.empty((3, *carried.state.shape))
        problem.kernel.run_rk4(steps, self.resolution, *problem.channel_arrays, *carried, *room, in_rows(out))
        return Status.OK
