"""Hypothesis strategies: small records of every kind."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bwbn_bayes.records import Record
from bwbn_bayes.records.record import ExcitationKind

KINDS: tuple[ExcitationKind, ...] = ("ground_acceleration", "displacement")

FINITE = st.floats(allow_nan=False, allow_infinity=False)
TEXT = st.text(max_size=12)
LABELS = st.text(min_size=1, max_size=8).filter(
    lambda text: (
        ":" not in text and text.split() and not text.strip().startswith(("#", "true", "noise_sd", "name", "time_step"))
    )
)
NUMBERED = st.builds(
    "{}_{}".format,
    st.sampled_from(["acceleration", "relative_acceleration", "displacement", "drift", "force"]),
    st.integers(1, 50),
)


@st.composite
def records(draw: st.DrawFn) -> Record:
    """A record with awkward numbers, names and labels."""
    kind = draw(st.sampled_from(KINDS))
    names = draw(st.lists(NUMBERED, max_size=3, unique=True)) if kind == "ground_acceleration" else ["force"]
    series = arrays(np.float64, draw(st.integers(8, 12)), elements=FINITE)
    positive = st.floats(0.0, 1e300)
    return Record(
        name=draw(TEXT),
        time_step=draw(st.floats(1e-6, 1e3)),
        excitation=draw(series),
        excitation_kind=kind,
        channels={name: draw(series) for name in names},
        provenance=draw(st.dictionaries(LABELS, TEXT, max_size=3)),
        truth=draw(st.dictionaries(LABELS, FINITE, max_size=3)),
        noise_sd=draw(st.dictionaries(st.sampled_from(names), positive, max_size=2)) if names else {},
        has_time=kind == "ground_acceleration" or draw(st.booleans()),
    )
