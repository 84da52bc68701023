"""Columns from the arrays of other programs: numbers, dates and time differences."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.records.columns import Column
from bwbn_bayes.records.time_base import Source, stored_quantum


def column_of(array: NDArray[Any], label: str, unit: str | None, source: Source) -> Column:
    """A column from an array ``(n_times,)`` of any kind; a single number, too.

    Dates and time differences become seconds from the first; what is no row of finite numbers becomes a fault, which
    the user hears only where the column is used.
    """
    if array.dtype.kind in "mM" and array.ndim == 1:
        array, unit = _seconds(array), "s"
    fault, values = "", np.empty(0)
    if array.ndim > 1 or array.dtype.kind not in "fiu":
        fault = f"{source.file}, column {label}: it must hold one number for each time"
    else:
        values = np.atleast_1d(array).astype(np.float64)
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            place = f"{source.file}, {source.place(int(bad[0]))}, column {label}"
            fault = f"{place}: the value is {values[bad[0]]}, every value must be a finite number"

    def resolution() -> float:
        if array.dtype == np.float32:
            return float(np.spacing(np.float32(np.max(np.abs(values), initial=0.0))))
        return stored_quantum(values)

    return Column(label=label, values=values, unit=unit, resolution=resolution, fault=fault)


def _seconds(array: NDArray[Any]) -> NDArray[np.float64]:
    """Seconds from the first date or time difference; not a number where one is missing."""
    since = (array - array[0]) if array.size else array.astype("m8[ns]")
    # Whole nanoseconds over 1e9, rounded once: 0.02, not 0.020000000000000004.
    nanoseconds = since.astype("m8[ns]")
    return np.where(np.isnat(nanoseconds), np.nan, nanoseconds.astype(np.int64) / 1e9)
