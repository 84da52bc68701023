"""Where a prediction runs away, of errors whose place is known."""

import numpy as np
import pytest

from bwbn_bayes.discovery.runaway import moment_in_words, runaway_sample
from bwbn_bayes.records.record import Record

N = 300
SINE = np.sin(2.0 * np.pi * np.arange(N) / 30.0)[None]
RMS = float(np.sqrt(0.5))
WIDTH = N // 30


@pytest.mark.parametrize("far", [10.0, 1e200, np.inf, np.nan], ids=str)
def test_a_prediction_that_jumps_is_lost_from_there_on(far: float) -> None:
    """The error was printed as 1.3e14 %; squares of larger ones overflow, and some predictions are no numbers."""
    predicted = SINE.copy()
    predicted[:, 200:] = far
    found = runaway_sample(SINE, predicted)
    assert found is not None
    # The mean over the WIDTH samples from the one that is found holds enough of what lies beyond the jump.
    assert 200 - WIDTH < found <= 200
    assert runaway_sample(SINE[:, :190], predicted[:, :190]) is None


@pytest.mark.parametrize(("times", "lost"), [(2.9, False), (3.1, True)])
def test_it_takes_three_times_the_signal(times: float, lost: bool) -> None:
    assert (runaway_sample(SINE, SINE + times * RMS) is not None) == lost


def test_one_channel_is_enough() -> None:
    both = np.concatenate([SINE, SINE])
    predicted = both.copy()
    predicted[1, 100:] += 10.0
    found = runaway_sample(both, predicted)
    assert found is not None and 90 < found <= 100


def test_moments_are_times_of_a_building_and_whole_cycles_of_a_specimen() -> None:
    ground = Record(name="g", time_step=0.5, excitation=SINE[0])
    assert moment_in_words(ground, 25) == "t = 12.5 s"
    # Peaks at samples 7.5, 37.5, ...: two half cycles to each period of 30.
    pushed = Record(name="p", time_step=0.5, excitation=SINE[0], excitation_kind="displacement")
    assert moment_in_words(pushed, 160) == "cycle 5"
