"""What the reference engine makes of a model, solved once.

A synthetic record asks it for the measured channels at the true parameters; later, what is shown beside a posterior
asks it for every history at the same ones. It takes seconds where the lanes take milliseconds, and solves the same
states whatever is asked of them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from bwbn_bayes.engines.base import BASE_DISPLACEMENT, OBSERVED_KINDS, Response
from bwbn_bayes.engines.journal import model_in_words, question_of
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure

_MOST_KEPT = 2_000_000
"""Numbers of a response that is kept: 16 MB."""
_SOLVED: deque[tuple[bytes, Response]] = deque(maxlen=2)
"""The last responses, with what was asked: by content, so that a hit answers the very question."""


def observable(model: Structure) -> dict[str, tuple[str, ...]]:
    """Channels of every history that a model has, by kind."""
    counts = {"acceleration": model.n_floors or 1}
    kinds = {
        kind: tuple(f"{kind}_{i}" for i in range(1, counts.get(kind, model.n_links) + 1)) for kind in OBSERVED_KINDS
    }
    return kinds | ({BASE_DISPLACEMENT: (BASE_DISPLACEMENT,)} if model.law.base_states else {})


def exact_response(model: Structure, draws: Floats, record: Record, channels: Sequence[str]) -> Response:
    """Response by the reference engine, with every observable history solved and kept beside it.

    Parameters
    ----------
    model : Structure
    draws : (n_draws, n_parameters) array
    record : Record
        Its excitation; channels are ignored.
    channels : sequence of str
        What is asked for.
    """
    engine = Reference()
    histories = (name for names in observable(model).values() for name in names)
    names = tuple(dict.fromkeys([*channels, *histories]))
    if len(draws) * len(names) * record.n_times > _MOST_KEPT:
        return engine.simulate(model, draws, record, channels)
    bare = record.with_channels({}, truth={})
    question = question_of("exact", "\n".join([repr(engine), *model_in_words(model), bare.content_hash]), draws)
    known = (found for asked, found in tuple(_SOLVED) if asked == question and {*channels} <= {*found.channels})
    solved = next(known, None)
    if solved is None:
        solved = engine.simulate(model, draws, record, names)
        _SOLVED.append((question, solved))
    rows = np.array([solved.channels.index(name) for name in channels], dtype=np.int64)
    return Response(channels=tuple(channels), values=solved.values[:, rows], status=solved.status.copy())
