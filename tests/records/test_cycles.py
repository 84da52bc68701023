"""Half cycles of synthetic histories, whose turns are known, and of the measured tests of ../shared/data."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from bwbn_bayes import UserError
from bwbn_bayes.records import HalfCycle, half_cycles, read_record, repeats
from bwbn_bayes.records.cycles import cycle_numbers, path_of, repeated_samples

DATA = Path(__file__).parents[3] / "shared" / "data"


def through(*peaks: float, n: int = 40) -> np.ndarray:
    """Straight lines from zero through the peaks, ``n`` samples each."""
    ends = (0.0, *peaks)
    return np.concatenate([[0.0], *(np.linspace(a, b, n + 1)[1:] for a, b in pairwise(ends))])


def displacement(name: str) -> np.ndarray:
    if not (DATA / name).exists():
        pytest.skip(f"measured file {DATA / name} is not here")
    return read_record(DATA / name).excitation


def test_half_cycles_of_straight_lines():
    cycles = half_cycles(through(1.0, -2.0, 3.0, 0.0))
    assert cycles == (
        HalfCycle(first=0, last=40, direction=1, start=0.0, target=1.0),
        HalfCycle(first=40, last=80, direction=-1, start=1.0, target=-2.0),
        HalfCycle(first=80, last=120, direction=1, start=-2.0, target=3.0),
        HalfCycle(first=120, last=160, direction=-1, start=3.0, target=0.0),
    )
    assert [one.amplitude for one in cycles] == [1.0, 2.0, 3.0, 0.0]
    assert [one.travel for one in cycles] == [1.0, 3.0, 5.0, 3.0]
    assert through(1.0, -2.0)[cycles[1].samples][[0, -1]].tolist() == [1.0, -2.0]


def test_half_cycles_are_the_same_mirrored():
    u = through(0.5, -0.4, 1.0, 0.2, 0.9, -1.0)
    for one, other in zip(half_cycles(u), half_cycles(-u), strict=True):
        assert (one.first, one.last) == (other.first, other.last)
        assert (one.direction, one.start, one.target) == (-other.direction, -other.start, -other.target)


@pytest.mark.parametrize("noise", [1e-4, 1e-3, 5e-3])
def test_noise_below_the_threshold_makes_no_turn(noise: float):
    u = through(0.1, -0.1, 0.5, -0.5, 1.0, -1.0, 0.0, n=300)
    noisy = u + noise * np.random.default_rng(3).standard_normal(len(u))
    found = half_cycles(noisy, threshold=10.0 * noise)
    assert [one.direction for one in found] == [1, -1, 1, -1, 1, -1, 1]
    np.testing.assert_allclose([one.target for one in found], [0.1, -0.1, 0.5, -0.5, 1.0, -1.0, 0.0], atol=4.5 * noise)
    assert all(a.last == b.first for a, b in pairwise(found))


def test_a_standstill_and_a_hold_belong_to_their_half_cycles():
    # Digitised data stand still at first, repeat points and hold their peaks.
    u = np.concatenate([np.zeros(100), np.repeat(through(1.0, -1.0)[1:], 3)])
    up, down = half_cycles(u)
    assert (up.first, up.last) == (0, 100 + 3 * 39)
    assert (down.first, down.last) == (up.last, 100 + 3 * 79)


@pytest.mark.parametrize("u", [np.zeros(50), 1e-3 * np.sin(np.arange(50.0)) + 1.0])
def test_no_half_cycle_within_the_threshold(u: np.ndarray):
    assert half_cycles(u) == ()


def test_a_push_over_is_one_half_cycle():
    (only,) = half_cycles(through(2.0))
    assert (only.direction, only.target) == (1, 2.0)


@pytest.mark.parametrize("threshold", [0.0, -1.0, np.nan])
def test_a_threshold_is_positive(threshold: float):
    with pytest.raises(UserError, match="threshold is"):
        half_cycles(through(1.0), threshold)


def test_repeats_count_within_a_row():
    cycles = half_cycles(through(1.0, -1.0, 1.05, -0.95, 1.0, -1.0, 2.0, -2.0, 1.9, -2.1, 1.0, -1.0))
    assert repeats(cycles) == (0, 0, 1, 1, 2, 2, 0, 0, 1, 1, 0, 0)


def test_slowly_growing_amplitudes_are_compared_with_the_first_of_their_row():
    peaks = 1.06 ** np.arange(6)
    cycles = half_cycles(through(*(sign * peak for peak in peaks for sign in (1.0, -1.0))))
    assert repeats(cycles)[::2] == (0, 1, 0, 1, 0, 1)


def test_samples_of_three_cycles_at_each_amplitude():
    """Of three cycles at 1 and at 2 the second and third repeat; a turning point belongs to the half cycle it ends."""
    targets = [1.0, -1.0] * 3 + [2.0, -2.0] * 3
    ways = [np.linspace(a, b, 11)[1:] for a, b in pairwise([0.0, *targets])]
    expected = np.repeat([False, False, True, True, True, True] * 2, 10)
    np.testing.assert_array_equal(repeated_samples(np.concatenate([[0.0], *ways])), [False, *expected])


def test_directions_repeat_apart():
    assert repeats(half_cycles(through(1.0, -0.5, 1.0, -0.8, 1.0, -0.8))) == (0, 0, 1, 0, 2, 1)


def test_a_turn_before_the_origin_ends_no_row():
    assert repeats(half_cycles(through(1.0, -1.0, -0.2, -0.6, 1.0))) == (0, 0, 0, 0, 1)


# Half cycles, repeats among them and the largest amplitude [mm]: the protocols as their plots show them.
MEASURED = {
    "chiu_bracing.csv": (145, 78, 330.25),
    "clt_connection_spc1.csv": (57, 26, 84.58),
    "steel_damper_ganey.csv": (22, 2, 2.878),
    "friction_damper_sine_0p5hz.csv": (15, 4, 38.34),
    "rc_columns/peer_222.csv": (24, 6, 162.35),
    "rc_columns/peer_269.csv": (17, 14, 40.34),
    "rc_columns/peer_323.csv": (17, 0, 8.07),
}


@pytest.mark.parametrize("name", MEASURED)
def test_measured_protocols(name: str):
    u = displacement(name)
    cycles = half_cycles(u)
    largest = 1e3 * max(one.amplitude for one in cycles)
    n_repeats = sum(count > 0 for count in repeats(cycles))
    assert (len(cycles), n_repeats, largest) == (*MEASURED[name][:2], pytest.approx(MEASURED[name][2], rel=1e-3))
    assert all(a.last == b.first and a.direction == -b.direction for a, b in pairwise(cycles))
    assert all(one.target == u[one.last] for one in cycles)


def test_the_curee_protocol_of_the_connection():
    # One primary cycle, then four trailing ones at three quarters of it, as the protocol prescribes.
    cycles = half_cycles(displacement("clt_connection_spc1.csv"))[:10:2]
    np.testing.assert_allclose([1e3 * one.amplitude for one in cycles], [3.26, 2.44, 2.44, 2.44, 2.44], atol=0.01)
    assert repeats(cycles) == (0, 0, 1, 2, 3)


def test_cycles_are_counted_by_two_half_cycles_from_one():
    history = through(1.0, -1.0, 2.0, -2.0, 0.0)
    numbers = cycle_numbers(history)
    assert numbers.dtype.kind == "i"
    # Half cycles end at samples 40, 80, 120, 160, 200; the turn itself begins the next one.
    expected = np.repeat([1, 2, 3], [80, 80, 41])
    np.testing.assert_array_equal(numbers, expected)
    assert cycle_numbers(np.zeros(5)).tolist() == [1] * 5


def test_the_path_is_the_sum_of_all_ways():
    path = path_of(through(1.0, -2.0, 3.0))
    assert path[[0, 40, 80, 120]] == pytest.approx([0.0, 1.0, 4.0, 9.0])
    assert len(path) == 121
