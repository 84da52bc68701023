"""What a run tells of its steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.history import History
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import WindowFacts
from bwbn_bayes.parameters import Uniform
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.specimen import Specimen

PATH = 0.01 * np.sin(np.linspace(0.0, 12.0, 201))
TIMED = Record(
    name="test", time_step=0.5, excitation=PATH, excitation_kind="displacement", channels={"force": 1e6 * PATH}
)
MODEL = Specimen(storey=BoucWen(k=Uniform(5e5, 2e6), c=0.0, alpha=0.1, u_y=0.02, rho=0.5, n=1.0))


@pytest.mark.parametrize(
    ("record", "said", "label"),
    [
        (TIMED, "fitted the first 25 s of 100 s", "least squares on 0 to 25.0 s, 3 candidates"),
        (
            replace(TIMED, has_time=False),
            "fitted the first 51 of 201 points",
            "least squares on the first 51 points, 3 candidates",
        ),
    ],
)
def test_windows_are_told_in_seconds_or_points(record: Record, said: str, label: str) -> None:
    """A path has no seconds, and its windows were told in them."""
    heard: list[str] = []
    history = History(lambda text, _: heard.append(text), 0.0, [])
    posterior = Posterior(model=MODEL, record=record, engine=Lanes(), noise=default_noise(record))
    history.tell_window(posterior, WindowFacts(end=25.0, log_likelihood=0.0, n_candidates=3, n_solves=10))
    assert (heard, history.stages[0].label) == ([said], label)
