"""A linear spring pulled to and fro, of which only the stiffness is unknown."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.discovery.evidence import laplace
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.elements.linear import Linear
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import distinct, polish
from bwbn_bayes.parameters import Floats, Uniform
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.specimen import Specimen

TIME_STEP = 0.02
STIFFNESS = 2000.0


def explained(travel: Floats, errors: Floats, left_out: NDArray[np.int64] | None = None) -> Explanation:
    """The spring itself, fitted to its force with errors, but for samples that are left out."""
    force = {"force": STIFFNESS * travel + errors}
    record = Record(name="loop", time_step=TIME_STEP, excitation=travel, excitation_kind="displacement", channels=force)
    if left_out is not None:
        record = replace(record, counted=np.isin(np.arange(len(travel)), left_out, invert=True))
    model = Specimen(storey=Linear(k=Uniform(1000.0, 3000.0), c=0.0))
    posterior = Posterior(model=model, record=record, engine=Lanes(n_threads=1), noise=default_noise(record))
    modes = distinct(*polish(posterior, np.array([[0.4]]), n_iterations=10))
    return Explanation(added=(), posterior=posterior, modes=modes, evidence=laplace(posterior, modes))


def with_past(white: Floats, share: float) -> Floats:
    """Errors each of which has a share of the one before it."""
    errors = np.zeros_like(white)
    for number in range(1, len(white)):
        errors[number] = share * errors[number - 1] + white[number]
    return errors
