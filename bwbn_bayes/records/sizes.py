"""Whether the numbers of a record can be a structure's: told before anything is computed of them."""

from __future__ import annotations

import numpy as np

from bwbn_bayes.errors import UserError
from bwbn_bayes.records.record import Record, si_unit

LEAST_LENGTH = 1e-9
"""Of the peak of a displacement: what is less was not measured on a structure, and no law yields as early. [m]"""
_MOST = 1e15
"""Of a peak, far beyond any, and one over the least: sums of squares are still numbers of single precision."""
_LEAST = {"m": LEAST_LENGTH, "m/s^2": 1e-8}
"""Of a peak, by its unit: far below what a quiet building does. One metre and one g, read as nano, are no more."""


def require_sizes(record: Record) -> None:
    """Raise :class:`UserError` where the peak of a column is beyond what can be measured; zeros pass."""
    for part in record.parts:
        for name, signal in {**part.drivers, **part.channels}.items():
            peak = float(np.max(np.abs(signal)))
            if peak > _MOST or 0.0 < peak < _LEAST.get(si_unit(name), 1.0 / _MOST):
                raise UserError(
                    f"record {part.name!r}: {name} reaches {peak:.3g} in SI units: mend its unit or its values"
                )
