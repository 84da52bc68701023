"""MiniSEED, by way of ObsPy where that is installed."""

from __future__ import annotations

import importlib
import io
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from bwbn_bayes.errors import UserError
from bwbn_bayes.records.columns import Column, Table, record_of
from bwbn_bayes.records.labels import Labels
from bwbn_bayes.records.record import Record
from bwbn_bayes.records.text import file_bytes
from bwbn_bayes.records.time_base import Source

_UNIT_ADVICE = 'say in the column map what one count is, as in "IV.ABC..HNZ = {name} [2.4e-6 {unit}]"'


def read_miniseed(path: Path | str, columns: str | None = None) -> Record:
    """Read a record from miniSEED.

    Parameters
    ----------
    path : Path or str
        Traces are called by network, station, location and channel, as in ``IV.ABC..HNZ``. They are to start together
        and have one sampling rate and no gaps.
    columns : str, optional
        A column map. MiniSEED holds counts without a unit, so that it is needed; ``[2.4e-6 m/s^2]`` is a unit.

    Raises
    ------
    UserError
        If ObsPy is not installed, the file is damaged, or its traces do not belong together.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            reader = importlib.import_module("obspy.io.mseed.core")
    except ImportError:
        raise UserError(
            f"{path}: miniSEED is read by ObsPy, which is not installed, add it with pip install 'bwbn-bayes[obspy]'"
        ) from None
    data = file_bytes(Path(path))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            # This format alone: ObsPy's own search for the format would try pickles, too.
            traces: list[Any] = list(reader._read_mseed(io.BytesIO(data)))
    except Exception as error:  # whatever ObsPy and its library raise, the file is not what it should be
        raise UserError(f"{path}: the file is not miniSEED, or it is damaged, get it anew") from error
    return record_of(_table(traces, Path(path)), columns)


def _table(traces: list[Any], path: Path) -> Table:
    if not traces:
        raise UserError(f"{path}: the file holds no trace")
    first = traces[0].stats
    seen: set[str] = set()
    for trace in traces:
        stats = trace.stats
        if trace.id in seen:
            raise UserError(f"{path}, trace {trace.id}: it comes in pieces with a gap, cut the file to one piece")
        seen.add(trace.id)
        if stats.sampling_rate != first.sampling_rate or abs(stats.starttime - first.starttime) > 0.5 * first.delta:
            raise UserError(
                f"{path}, trace {trace.id}: it starts at {stats.starttime} with {stats.sampling_rate:g} Hz, the first "
                f"trace at {first.starttime} with {first.sampling_rate:g} Hz, cut them to one time base"
            )
    if not first.sampling_rate > 0.0:
        raise UserError(f"{path}: the sampling rate is {first.sampling_rate:g} Hz, it must be positive")
    found = tuple(
        Column(label=trace.id, values=np.asarray(trace.data, dtype=np.float64))
        if trace.data.dtype.kind in "fiu"
        else Column(label=trace.id, values=np.empty(0), fault=f"{path}, trace {trace.id}: it holds text, no numbers")
        for trace in traces
    )
    labels = Labels(
        name=path.stem,
        time_step=1.0 / float(first.sampling_rate),
        provenance={"start_time": str(first.starttime)},
    )
    source = Source(file=str(path), header=str(path), place=lambda row: f"sample {row + 1}")
    return Table(columns=found, labels=labels, source=source, unit_advice=_UNIT_ADVICE)
