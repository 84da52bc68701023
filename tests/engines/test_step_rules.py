"""Steps of an imposed displacement: as many as its stride needs, whatever the sampling of the record."""

import numpy as np
import pytest
from engine_cases import relative_error

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.engines.base import Engine
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.engines.scalar import ScalarRk4
from bwbn_bayes.engines.step_rules import RANGE_STEPS, interval_steps
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.specimen import Specimen

STRIDE = 0.2
YIELD = 0.02
"""A tenth of a sample's stride: z grows like ``1 - (z / YIELD)`` over it. [m]"""


def digitised() -> Record:
    """Three cycles of ten samples a half cycle, as a figure in a paper gives them."""
    path = np.interp(np.arange(61) / 5, np.arange(13), [0.0, *[1.0, 0.0, -1.0, 0.0] * 3])
    return Record(name="digitised", time_step=1.0, excitation=path, channels={}, excitation_kind="displacement")


def forces(engine: Engine) -> Floats:
    storey = BoucWen(k=10.0, c=0.0, alpha=0.1, beta=0.5 / YIELD, gamma=0.5 / YIELD, n=1.0)
    response = engine.simulate(Specimen(storey=storey), np.zeros((1, 0)), digitised(), ("force",))
    assert response.status.tolist() == [0]
    return response.values[0, 0]


def test_a_long_stride_takes_many_steps_and_a_short_one_the_least() -> None:
    """A range of 2: strides of a half, a tenth and a hundred-thousandth of it."""
    path = np.array([0.0, 1.0, -1.0, -0.8, -0.8 + 2e-5])
    steps = interval_steps(path, 3, driven=True)
    assert steps[:-1].tolist() == [3 * RANGE_STEPS // 2, 3 * RANGE_STEPS, 3 * RANGE_STEPS // 10, 3]
    assert interval_steps(path, 3, driven=False).tolist() == [3] * 5
    assert interval_steps(np.ones(4), 2, driven=True).tolist() == [2] * 4


@pytest.mark.parametrize("engine", [Lanes(substeps=1, n_threads=1), ScalarRk4(substeps=1)], ids=["lanes", "scalar"])
def test_a_yield_far_below_the_stride_of_a_sample_is_solved(engine: Engine) -> None:
    """Equal steps between samples, ten yield displacements long, once ran off to infinity."""
    expected = forces(Reference())
    assert np.max(np.abs(expected)) < 10.0 * (0.1 + 0.9 * YIELD) + 0.1
    assert relative_error(forces(engine), expected) < 1e-3


def test_both_engines_take_the_same_steps() -> None:
    lanes, scalar = forces(Lanes(substeps=2, n_threads=1)), forces(ScalarRk4(substeps=2))
    assert relative_error(lanes, scalar) < 1e-8
