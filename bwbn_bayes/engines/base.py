"""What every engine promises.

``simulate`` solves a model for many draws under one record; ``sensitivities`` adds the derivatives with respect to
the identified parameters; ``misfit`` and ``normal_equations`` reduce both to what inference needs. A failed draw has a
status and NaN rows, never an exception; a draw's result does not depend on which other draws share its batch.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Booleans, Floats
from bwbn_bayes.records.directions import require_one_direction
from bwbn_bayes.records.noise import require_long_enough
from bwbn_bayes.records.record import Record, require_measured, require_whole
from bwbn_bayes.records.sizes import require_sizes
from bwbn_bayes.structures.structure import Structure

OBSERVED_KINDS = (
    "drift",
    "drift_rate",
    "hysteretic_displacement",
    "hysteretic_energy",
    "restoring_force",
    "acceleration",
)
"""Rows every engine can observe at each storey or floor; measured channels are linear combinations of them."""


BASE_DISPLACEMENT = "base_displacement"
"""Channel: displacement of what the building stands on, relative to the ground; zero where it is rigid."""


class Status(IntEnum):
    """What became of a draw."""

    OK = 0
    NON_FINITE = 1
    STEP_LIMIT = 2


@dataclass(frozen=True, kw_only=True)
class Response:
    """Solutions of a batch.

    Attributes
    ----------
    channels : tuple of str
        What was asked for, e.g. ``("acceleration_1", "drift_2")``.
    values : (n_draws, n_channels, n_times) array
        In SI units; NaN where the draw failed.
    status : (n_draws,) array of :class:`Status` values
    """

    channels: tuple[str, ...]
    values: Floats
    status: NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class NormalEquations:
    """Least squares in summary: residual r = measured - model, J = d model / d parameters, summed over time.

    Attributes
    ----------
    misfit : (n_draws, n_blocks) array
        Sum of squared residuals, of each channel of each record (:attr:`~bwbn_bayes.records.record.Record.blocks`).
    gradient : (n_draws, n_blocks, n_parameters) array
        ``J^T r``.
    information : (n_draws, n_blocks, n_parameters, n_parameters) array
        ``J^T J``.
    """

    misfit: Floats
    gradient: Floats
    information: Floats

    def __getitem__(self, index: slice | NDArray[np.int64]) -> NormalEquations:
        """The same for some of the draws."""
        return replace(
            self, misfit=self.misfit[index], gradient=self.gradient[index], information=self.information[index]
        )

    def weighted(self, weight: Floats) -> tuple[Floats, Floats]:
        """``J^T r`` and ``J^T J`` summed over blocks with weights ``(n_draws, n_blocks)``.

        Zero where not finite: near collapse derivatives leave the range of the engine's numbers.
        """
        known = (np.nan_to_num(own, posinf=0.0, neginf=0.0) for own in (self.gradient, self.information))
        gradient, information = known
        return np.einsum("nc,ncp->np", weight, gradient), np.einsum("nc,ncpq->npq", weight, information)


class Engine(Protocol):
    """Solves a model for draws ``(n_draws, n_parameters)`` in the parameters' own units."""

    @property
    def name(self) -> str:
        """Name on the command line."""
        ...

    @property
    def scheme(self) -> str:
        """Scheme and accuracy in words, for the report."""
        ...

    def simulate(
        self, model: Structure, draws: Floats, record: Record, channels: Sequence[str] | None = None
    ) -> Response:
        """Response at the record's times; its measured channels unless others are named."""
        ...

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

        ``free``, ``(n_draws, n_parameters)``, tells which derivatives are wanted; what stands for the others is
        undefined.
        """
        ...

    def misfit(self, model: Structure, draws: Floats, record: Record) -> Floats:
        """Sum of squared residuals ``(n_draws, n_blocks)`` over the measured channels; infinite where it failed.

        Here and in :meth:`normal_equations` only samples that count take part.
        """
        ...

    def normal_equations(
        self, model: Structure, draws: Floats, record: Record, *, free: Booleans | None = None
    ) -> NormalEquations:
        """Least squares in summary over the measured channels; ``free`` as in :meth:`sensitivities`."""
        ...


@dataclass(frozen=True, kw_only=True)
class ChannelMap:
    """Channels as linear combinations of observed rows.

    ``row[starts[c]:starts[c+1]]`` and ``coefficient`` are the terms of channel c; ``ground`` multiplies the excitation.
    Row ``kind * n_links + link`` counts kinds as in :data:`OBSERVED_KINDS`; the row after all of them is the
    displacement of a base that can move.
    """

    names: tuple[str, ...]
    starts: NDArray[np.int64]
    row: NDArray[np.int64]
    coefficient: Floats
    ground: Floats

    def apply(self, rows: Floats, excitation: Floats) -> Floats:
        """Channels ``(..., n_channels, n_times)`` from observed rows ``(..., 6 n_links, n_times)``."""
        result = np.empty((*rows.shape[:-2], len(self.names), rows.shape[-1]))
        for c in range(len(self.names)):
            terms = slice(self.starts[c], self.starts[c + 1])
            result[..., c, :] = self.ground[c] * excitation
            for row, coefficient in zip(self.row[terms], self.coefficient[terms], strict=True):
                result[..., c, :] += coefficient * rows[..., row, :]
        return result


def channel_map(model: Structure, names: Sequence[str]) -> ChannelMap:
    """Resolve channel names such as ``acceleration_2`` for a model.

    Raises
    ------
    UserError
        If a channel is unknown or its storey does not exist.
    """
    n = model.n_links
    starts, rows, coefficients, ground = [0], [], [], []
    for name in names:
        kind, number = _split(name, model)
        terms, base = _terms(kind, number, model, name)
        if kind in ("displacement", BASE_DISPLACEMENT) and model.law.base_states:
            terms.append((len(OBSERVED_KINDS) * n, 1.0))
        rows += [row for row, _ in terms]
        coefficients += [coefficient for _, coefficient in terms]
        starts.append(len(rows))
        ground.append(base)
    return ChannelMap(
        names=tuple(names),
        starts=np.array(starts, dtype=np.int64),
        row=np.array(rows, dtype=np.int64),
        coefficient=np.array(coefficients, dtype=np.float64),
        ground=np.array(ground, dtype=np.float64),
    )


OF_FLOORS = ("acceleration", "relative_acceleration", "displacement")
"""Channels that count floors; others count storeys and further links."""


def _split(name: str, model: Structure) -> tuple[str, int]:
    if name in ("force", BASE_DISPLACEMENT):
        return name, 1
    match = re.fullmatch(r"([a-z_]+)_(\d+)", name)
    if match is None:
        raise UserError(f"channel {name!r} is not known: write a quantity and a floor or storey, e.g. acceleration_1")
    number, n_links, n_floors = int(match[2]), model.n_links, model.n_floors
    of_floor = match[1] in OF_FLOORS and not model.is_driven
    if not 1 <= number <= (n_floors if of_floor else n_links):
        has = f"floors 1 to {n_floors}" if of_floor and n_links > n_floors else f"storeys 1 to {n_links}"
        raise UserError(f"channel {name!r}: the model has {has}; drop the channel or add storeys")
    return match[1], number


def _terms(kind: str, number: int, model: Structure, name: str) -> tuple[list[tuple[int, float]], float]:
    n = model.n_links
    if kind in OBSERVED_KINDS:
        return [(OBSERVED_KINDS.index(kind) * n + number - 1, 1.0)], 0.0
    if kind == "force":
        return [(OBSERVED_KINDS.index("restoring_force") * n + number - 1, 1.0)], 0.0
    if kind == BASE_DISPLACEMENT:
        return [], 0.0
    if kind == "relative_acceleration":
        return [(OBSERVED_KINDS.index("acceleration") * n + number - 1, 1.0)], -1.0
    if kind == "displacement":
        return [(link - 1, 1.0) for link in model.links_below(number)], 0.0
    raise UserError(
        f"channel {name!r} is not known: the engines give {', '.join(OBSERVED_KINDS)}, force, "
        "relative_acceleration and displacement"
    )


def masses(model: Structure) -> Floats:
    """Mass of the node that each link carries ``(n_links,)`` [kg]; 1 where it carries none, and nothing moves it."""
    return np.array([*model.masses, *(1.0 for _ in range(model.n_links - model.n_floors))], dtype=np.float64)


def check_record(model: Structure, record: Record) -> None:
    """Raise :class:`UserError` unless the record excites the model in the model's own way."""
    if record.excitation_kind != model.excitation_kind:
        raise UserError(
            f"record {record.name!r} is driven by {record.excitation_kind}, the model by {model.excitation_kind}: "
            "use a ShearBuilding for ground motion and a Specimen for a displacement-driven test"
        )
    beyond = [floor for floor in record.forced_floors if floor > model.n_floors]
    if beyond:
        raise UserError(
            f"record {record.name!r}: applied_force_{beyond[0]} acts on a floor that the model does not have, it has "
            f"floors 1 to {model.n_floors}; drop the column or add floors"
        )
    if len(record.parts) > 1 and not record.is_sequence and model.law.initial:
        raise UserError(
            f"{record.name!r} joins records that each find the structure virgin, and the model starts in an identified "
            "state, which is that of one record: join them in sequence, or give one"
        )


def require_parameters(model: Structure, name: str) -> None:
    """Raise :class:`UserError` unless a model, called ``name`` in reports, identifies a parameter."""
    if model.space.n_dim == 0:
        raise UserError(
            f"model {name!r} identifies no parameter: give at least one of them a prior instead of a number"
        )


def require_usable(model: Structure, record: Record) -> None:
    """Raise :class:`UserError` unless a model can be identified from a record.

    It must be of the model's kind of test, excite it unless it starts in an initial state, and measure something of it
    that changes, for long enough that its noise can be told, a force in the direction of its displacement: each of
    several joined records that measures anything.
    """
    check_record(model, record)
    require_measured(record)
    require_sizes(record)
    for part in record.parts:
        if part.channels:
            _require_telling(model, part)


def _require_telling(model: Structure, record: Record) -> None:
    where = f"record {record.name!r}"
    channel_map(model, tuple(record.channels))
    require_long_enough(record)
    require_whole(record)
    moves = any(np.ptp(signal) > 0.0 for signal in (record.excitation, *record.forces.values()))
    if not moves and not model.law.initial:
        raise UserError(
            f"{where} has no excitation: its {record.excitation_kind} never changes, give one that moves; or for a "
            "structure that was released a model with InitialState"
        )
    still = [channel for channel, signal in record.channels.items() if np.ptp(signal[record.kept]) == 0.0]
    if still:
        raise UserError(f"{where}: {', '.join(still)} never changes: leave it out")
    require_one_direction(record)
    for channel, others, known in _same_by_definition(model, record):
        signal = record.channels[channel]
        if np.allclose(signal, known, rtol=0.0, atol=1e-9 * float(np.max(np.abs(signal)))):
            raise UserError(f"{where}: {channel} says the same as {others} and would count twice: leave one out")


def _same_by_definition(model: Structure, record: Record) -> Iterator[tuple[str, str, Floats]]:
    """Channels that others would give if they came from the same sensors: name, the others' names, what they give."""
    channels = record.channels
    for i in range(1, (model.n_floors if model.is_chain else 0) + 1):
        absolute, relative = channels.get(f"acceleration_{i}"), f"relative_acceleration_{i}"
        if absolute is not None and relative in channels:
            yield relative, f"acceleration_{i} less the ground's", absolute - record.excitation
        upper, lower = channels.get(f"displacement_{i}"), channels.get(f"displacement_{i - 1}")
        if f"drift_{i}" in channels and upper is not None and (i == 1 or lower is not None):
            others = f"displacement_{i}" + (f" less displacement_{i - 1}" if lower is not None else "")
            yield f"drift_{i}", others, upper - (lower if lower is not None else 0.0)
