"""The lanes' scheme on a graphics card of NVIDIA's, one thread for each draw.

The text of the lanes' kernel, with one lane, is compiled by the same compiler, for the card: the same operations in the
same order but for what either processor's compiler may join or regroup, so that results differ by rounding. Squared
residuals are summed on the card; responses leave it only where they are asked for. Derivatives are left to the lanes:
they are asked for a few draws at a time, and a card solves one draw in the time of thousands.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple, override

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.elements.law import StoreyLaw
from bwbn_bayes.engines.cuda_driver import Card, CudaError, Room, first_card
from bwbn_bayes.engines.cuda_source import ENTRY, SELDOM, opening_rows, rows_of_thread, thread_source
from bwbn_bayes.engines.kernel import words_of
from bwbn_bayes.engines.kernel_compiler import signatures
from bwbn_bayes.engines.lane_block import Block
from bwbn_bayes.engines.lane_problem import SHARES, WEIGHTS, Outcome, Part, Problem, Same
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.scalar import programs_of
from bwbn_bayes.errors import UserError

_DOUBLE = np.dtype(np.float64)
_SHARE_OF_MEMORY = 0.5
"""Of a card's free memory, what draws that are solved at once may take: threads have memory of their own beside."""
_MOST_STORED = 2**30
"""Bytes of responses that come back at once: they stand in this machine's memory twice."""


@dataclass(frozen=True, kw_only=True)
class Cuda(Lanes):
    """Runge-Kutta of order 4 on a graphics card, one thread for each draw.

    Its parameters are those of :class:`~bwbn_bayes.engines.lanes.Lanes`. ``simulate`` and ``misfit`` are solved on the
    card, ``sensitivities`` and ``normal_equations`` by the lanes. A card takes as long for one draw as for thousands,
    so it pays where so many are asked for at once. A population too large for the card's free memory is cut.

    Raises
    ------
    UserError
        When it solves and there is no card, or the driver refuses a call.
    """

    name = "cuda"

    @property
    def card(self) -> Card:
        """The card that solves."""
        return first_card()

    @property
    @override
    def _at_once(self) -> str:
        return "a thread of a graphics card for each draw"

    @override
    def lanes_for(self, problem: Problem, n_draws: int, *, store: bool) -> int:
        """As many draws as the card has memory for, in equal blocks; of derivatives, the lanes there are."""
        if problem.n_parameters > 0:
            return super().lanes_for(problem, n_draws, store=store)
        size = problem.real.itemsize
        stored = problem.record.n_times * len(problem.channels.names) * size if store else 0
        each = 2 * rows_of_thread(problem.layout, problem.n_links) * size + stored
        with _told():
            most = int(_SHARE_OF_MEMORY * self.card.free_bytes) // each
        most = max(1, min(most, _MOST_STORED // stored if stored else n_draws))
        n_blocks = max(1, -(-n_draws // most))
        return max(1, -(-n_draws // n_blocks))

    @override
    def march(self, problem: Problem, block: Block, *, store: bool) -> Iterator[tuple[Part, Outcome]]:
        """What comes of a block of draws, part after part."""
        if problem.n_parameters > 0:
            return super().march(problem, block, store=store)
        with _told(), self.card.lock:  # blocks that other threads have prepared wait for the card's memory
            return iter(list(_marched(self, problem, block, store=store)))


@contextmanager
def _told() -> Iterator[None]:
    """What the driver refuses in the middle of a run, memory that others have taken, say, is the user's to mend."""
    try:
        yield
    except CudaError as error:
        raise UserError(
            f"the graphics card solves no further ({error}): end what else works on it, or take --engine lanes"
        ) from error


class _Array(NamedTuple):
    """An array on the card."""

    card: Card
    room: Room
    shape: tuple[int, ...]
    real: np.dtype[Any]

    @classmethod
    def of(cls, card: Card, values: NDArray[Any]) -> _Array:
        """A copy."""
        return cls(card, card.array(values), values.shape, values.dtype)

    @classmethod
    def empty(cls, card: Card, size: int, real: np.dtype[Any] = _DOUBLE) -> _Array:
        """So many numbers, whatever they are."""
        return cls(card, card.room(size * real.itemsize), (size,), real)

    def read(self) -> NDArray[Any]:
        """What it holds."""
        values = np.empty(self.shape, dtype=self.real)
        self.card.read(self.room, values)
        return values


class _OnCard(NamedTuple):
    """A part of a record on the card: the function that solves it, and what is the same for all draws."""

    card: Card
    function: Any
    names: tuple[str, ...]
    """Of the function's arguments, but for the thread's number."""
    words: struct.Struct
    shared: Mapping[str, _Array]

    def __call__(self, n_draws: int, given: Mapping[str, _Array | float]) -> None:
        """Solve draws; an array is passed as where it begins and its sizes."""
        words: list[float] = []
        for one in ({**self.shared, **given}[name] for name in self.names):
            words += [one.room.address, *one.shape] if isinstance(one, _Array) else [one]
        self.card.call(self.function, n_draws, self.words.pack(*words))


@lru_cache(maxsize=16)
def _on_card(card: Card, part: Same[Part], law: Same[StoreyLaw], driven: bool, real: np.dtype[Any]) -> _OnCard:
    """The function of a part, compiled once, and its arrays, sent once."""
    own, channels = part.it, part.it.channels
    tables: dict[str, NDArray[Any]] = {
        "joints": own.joints,
        "forced": own.forced,
        "shares": SHARES.astype(real),
        "weights": WEIGHTS.astype(real),
        "starts": channels.starts,
        "block": own.seen_blocks,
        "row": own.seen_rows,
        "coefficient": channels.coefficient.astype(real),
        "ground_part": channels.ground.astype(real),
    }
    safe, programs = programs_of(law.it)
    sizes = {
        "n_links": len(own.joints),
        "n_channels": len(channels.names),
        "n_inputs": own.stretch.inputs.shape[1],
    }
    source = thread_source(safe, programs, driven=driven, single=real == np.float32, **sizes)
    signature = signatures(source, [ENTRY])[ENTRY]
    arrays = {**tables, "excitation": own.stretch.inputs.astype(real), "measured": own.measured}
    fixed = {**tables, "n_links": sizes["n_links"], "excitation.size1": sizes["n_inputs"]}
    return _OnCard(
        card,
        card.function(source, ENTRY, fixed, SELDOM),
        signature.names[1:],
        words_of(signature, 1),
        {name: _Array.of(card, values) for name, values in arrays.items()},
    )


def _marched(engine: Cuda, problem: Problem, block: Block, *, store: bool) -> Iterator[tuple[Part, Outcome]]:
    """A block of draws on the card."""
    card, n, place, real = engine.card, block.n_lanes, problem.layout, problem.real
    is_carried = any(part.stretch.is_carried for part in problem.parts)
    kept = _Array.empty(card, rows_of_thread(place, problem.n_links) * n if is_carried else 0, real)
    opening = problem.started(block)[0][:, opening_rows(place, problem.law)]
    begun = _Array.of(card, opening.ravel())
    for part in problem.parts:
        solve = _on_card(card, Same(part), Same(problem.law), problem.driven, real)
        stretch, c = part.stretch, len(part.channels.names)
        misfit = _Array.empty(card, c * n)
        stored = _Array.empty(card, n * len(stretch.inputs) * c if store else 0, real)
        given: dict[str, _Array | float] = {
            "n_draws": n,
            "n_links": problem.n_links,
            "interval": stretch.time_step,
            "opening": begun,
            "times": _Array.of(card, problem.times(block, stretch).ravel()),
            "substeps": _Array.of(card, problem.steps(engine, stretch)),
            "resolution": engine.resolution,
            "cut": engine.cut_at_turns,
            "is_carried": stretch.is_carried,
            "kept": kept,
            "misfit": misfit,
            "store": store,
            "stored": stored,
        }
        solve(n, given)
        sums, responses = misfit.read(), stored.read().reshape(n, -1, max(c, 1))
        if stretch.samples is not None:
            # As the lanes store: by sample, direction (there is none), channel and draw.
            by_sample = np.moveaxis(responses, 0, 2)[:, None]
            yield part, Outcome(misfit=sums, gram=np.zeros(0), stored=by_sample)
