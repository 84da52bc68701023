"""Whether the force and the displacement of a cyclic test count in one direction, told by the work that is done."""

from __future__ import annotations

import numpy as np

from bwbn_bayes.errors import UserError
from bwbn_bayes.records.record import Record


def require_one_direction(record: Record) -> None:
    """Raise :class:`UserError` where a cyclic test's force is counted against its displacement.

    From rest no specimen gives more work than it takes, whatever its law. Counted against the displacement, the work
    done on it by each instant changes its sign and nothing else, so that the larger extreme tells: of 29 measured tests
    the wrong one is below half a per cent of the right one. Where some samples do not count, the work is not known.
    """
    if record.excitation_kind != "displacement" or "force" not in record.channels or record.counted is not None:
        return
    force = record.channels["force"]
    work = np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(record.excitation))
    given, taken = -float(np.min(work)), float(np.max(work))
    if given > max(taken, 0.0):
        raise UserError(
            f"record {record.name!r}: force and displacement are counted in opposite directions, the specimen would "
            f"give work ({given:.3g} J) instead of taking it: turn one of them by -1 before its unit, in the header as "
            'in "force [-1 kN]", or with --columns "displacement [mm], force [-1 kN]"'
        )
