"""The source of a kernel for a graphics card: the lanes' own text with one lane, which each thread runs for its draw.

What a draw's march changes stands in the thread's own memory; what is the same for all draws is read from the card's.
Tables that say how a building hangs together are put into the code. Arrays over draws have the draws last, so that
neighbouring threads read neighbouring numbers; responses, which are seldom asked for, have them first.
"""

from __future__ import annotations

from bwbn_bayes.elements.law import StoreyLaw
from bwbn_bayes.engines.codegen import LawPrograms
from bwbn_bayes.engines.lane_source import LaneLayout, lane_layout, lane_source

ENTRY = "solve"
SELDOM = ("strike", "flip", "prepare")
"""Functions that a solve calls before its first step and at events alone."""

_SOLVE = """
ROWS = {rows}
FIRST = {first}
N_OPENING = {n_opening}
N_CHANNELS = {n_channels}
N_INPUTS = {n_inputs}
N_EVENTS = {n_events}


def solve(thread: int, n_draws: int, n_links: int, interval: double, opening: floats, times: doubles,
          excitation: floats_2d, joints: integers_2d, forced: integers, shares: floats, weights: floats,
          substeps: integers, resolution: float, cut: bool, starts: integers, block: integers, row: integers,
          coefficient: floats, ground_part: floats, measured: floats_2d, is_carried: bool, kept: floats,
          misfit: doubles, store: bool, stored: floats):
    if thread < n_draws:
        w = _own(ROWS)
        none = _own(1)
        own_times = _own_doubles(N_EVENTS)
        sums = _own_doubles(N_CHANNELS)
        value = _own(N_CHANNELS)
        ground = _own(N_INPUTS)
        room = _own(4 + N_INPUTS)
        if is_carried:
            for r in range(ROWS):
                w[r] = kept[r * n_draws + thread]
        else:
            for r in range(ROWS):
                w[r] = 0.0
            for i in range(n_links + 2):
                for r in range(N_OPENING):
                    w[i * BLOCK + FIRST + r] = opening[(i * N_OPENING + r) * n_draws + thread]
        for e in range(n_links * {n_events_of_link}):
            own_times[e] = times[e * n_draws + thread]
        for r in range(4 + N_INPUTS):
            room[r] = 0.0
        for c in range(N_CHANNELS):
            sums[c] = 0.0
        # In no direction: what stands for the arrays of derivatives is never read.
        run(n_links, 0, interval, own_times, excitation, joints, forced, w, none, starts, starts, none, shares, weights,
            substeps, resolution, cut, starts, block, row, coefficient, ground_part, measured, sums, sums, store,
            stored[thread * N_CHANNELS * excitation.shape[0]:], value, ground, room)
        for c in range(N_CHANNELS):
            misfit[c * n_draws + thread] = sums[c]
        if kept.shape[0] > 0:
            for r in range(ROWS):
                kept[r * n_draws + thread] = w[r]
"""


def rows_of_thread(place: LaneLayout, n_links: int) -> int:
    """Rows that a thread keeps: blocks of a building without room for derivatives."""
    return (n_links + 2) * place.slope


def opening_rows(place: LaneLayout, law: StoreyLaw) -> slice:
    """Rows of a block that are not zero before the first sample: where states start, masses and parameters."""
    return slice(2 * place.n_states, place.parameters + len(law.parameters))


def thread_source(
    law: StoreyLaw,
    programs: LawPrograms,
    *,
    driven: bool,
    single: bool,
    n_links: int,
    n_channels: int,
    n_inputs: int,
) -> str:
    """Source of the kernel of a building of one storey law.

    Parameters
    ----------
    law, programs, driven, single
        As for :func:`~bwbn_bayes.engines.lane_source.lane_source`.
    n_links, n_channels, n_inputs : int
        Sizes of what a thread keeps to itself.
    """
    place = lane_layout(law, programs)
    rows = opening_rows(place, law)
    marching = lane_source(law, programs, driven=driven, single=single, lanes=1, block=place.slope)
    return marching + _SOLVE.format(
        rows=rows_of_thread(place, n_links),
        first=rows.start,
        n_opening=rows.stop - rows.start,
        n_channels=n_channels,
        n_inputs=n_inputs,
        n_events=max(1, n_links * len(law.events)),
        n_events_of_link=len(law.events),
    )
