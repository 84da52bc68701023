"""MiniSEED, by way of ObsPy where that is installed."""

from __future__ import annotations

import importlib
import io
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.errors import UserError
from bwbn_bayes.records.columns import Table, record_of
from bwbn_bayes.records.labels import Labels
from bwbn_bayes.records.record import Record, one_line
from bwbn_bayes.records.series import column_of
from bwbn_bayes.records.text import file_bytes
from bwbn_bayes.records.time_base import CLOCK_JITTER, Source

_TICK = 1e-4
"""To which headers of version 2 round a start. [s]"""
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
            traces = [_plain(trace) for trace in reader._read_mseed(io.BytesIO(data))]
    except Exception as error:  # whatever ObsPy and its library raise, the file is not what it should be
        raise UserError(f"{path}: the file is not miniSEED, or it is damaged, get it anew") from error
    return record_of(_table(traces, Path(path)), columns)


class _Trace(NamedTuple):
    """A trace: its SEED name, start in words and in s of the epoch, sampling rate [Hz], samples."""

    name: str
    told_start: str
    start: float
    rate: float
    data: NDArray[Any]


def _plain(trace: Any) -> _Trace:
    stats = trace.stats
    start, rate = stats.starttime, float(stats.sampling_rate)
    return _Trace(one_line(trace.id), str(start), float(start.timestamp), rate, np.asarray(trace.data))


def _table(traces: list[_Trace], path: Path) -> Table:
    if not traces:
        raise UserError(f"{path}: the file holds no trace, get it anew")
    first = traces[0]
    if not 0.0 < first.rate < np.inf:
        raise UserError(f"{path}: the sampling rate is {first.rate:g} Hz, it must be positive")
    for position, trace in enumerate(traces):
        if trace.name in [earlier.name for earlier in traces[:position]]:
            raise UserError(f"{path}, trace {trace.name}: it comes in pieces with a gap, cut the file to one piece")
        if trace.rate != first.rate:
            raise UserError(
                f"{path}, trace {trace.name}: it starts at {trace.told_start} with {trace.rate:g} Hz, the first trace "
                f"at {first.told_start} with {first.rate:g} Hz, cut them to one time base"
            )
        late = trace.start - first.start
        if abs(late) > max(CLOCK_JITTER / first.rate, 1.5 * _TICK):
            raise UserError(
                f"{path}, trace {trace.name}: it starts at {trace.told_start}, {abs(late):.3g} s "
                f"{'after' if late > 0.0 else 'before'} the first trace, cut whole samples and resample the rest, so "
                "that they start together"
            )
    source = Source(file=str(path), header=str(path), place=lambda row: f"sample {row + 1}")
    found = tuple(column_of(trace.data, trace.name, None, source) for trace in traces)
    labels = Labels(name=path.stem, time_step=1.0 / first.rate, provenance={"start_time": first.told_start})
    return Table(columns=found, labels=labels, source=source, unit_advice=_UNIT_ADVICE)
