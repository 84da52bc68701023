"""Something unnamed as an outcome has it; nothing is solved for it."""

from __future__ import annotations

import numpy as np

from bwbn_bayes.discovery.outcome import UnnamedForce
from bwbn_bayes.parameters import Floats


def force_without_a_name(
    probability: float,
    share: float,
    *,
    any_probability: float | None = None,
    place: str = "storey 1",
    state: Floats | None = None,
    force: Floats | None = None,
) -> UnnamedForce:
    """One in the first storey; nothing unnamed is elsewhere, and no force is shown, unless it is said."""
    return UnnamedForce(
        storey=1,
        place=place,
        probability=probability,
        any_probability=probability if any_probability is None else any_probability,
        share=share,
        state=np.zeros(2) if state is None else state,
        force=np.zeros(2) if force is None else force,
    )
