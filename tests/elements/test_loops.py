"""Measures of a loop against closed forms and against 24 measured columns."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from bwbn_bayes.elements.loops import (
    is_full,
    large_half_cycles,
    peak_asymmetry,
    pinching_index,
    reloading_bulge,
    stiffness_lost_per_cycle,
    strength_lost_per_cycle,
)

COLUMNS = next(
    (p / "shared" / "data" / "rc_columns" for p in Path(__file__).parents if (p / "shared" / "data").exists()), None
)
EVERY = (
    pinching_index, reloading_bulge, strength_lost_per_cycle, stiffness_lost_per_cycle, peak_asymmetry,
)  # fmt: skip


def path(*turning_points: float, per_segment: int = 400) -> np.ndarray:
    """A drift history, straight between turning points, from zero."""
    ends = np.concatenate([[0.0], turning_points])
    return np.interp(np.arange(per_segment * len(turning_points) + 1) / per_segment, np.arange(len(ends)), ends)


def plastic(drift: np.ndarray, stiffness: float = 100.0, strength: np.ndarray | float = 1.0) -> np.ndarray:
    """Force of an elastic-perfectly-plastic spring, its strength given at each sample."""
    bound = np.broadcast_to(strength, drift.shape)
    force = np.zeros(len(drift))
    for i in range(1, len(drift)):
        force[i] = np.clip(force[i - 1] + stiffness * (drift[i] - drift[i - 1]), -bound[i], bound[i])
    return force


def test_a_plastic_loop_is_not_pinched_and_full():
    u = path(1.0, -1.0, 1.0, -1.0, 1.0)
    f = plastic(u)
    assert pinching_index(u, f) == pytest.approx(1.0)
    # Branch from zero force at u = -1 + 0.01 + 0.01: a triangle up to yield, then flat.
    elastic, flat = 0.01, 1.0 - (-1.0 + 0.01) - 0.01
    expected = (0.5 * elastic + flat) / (0.5 * (elastic + flat)) - 1.0
    assert reloading_bulge(u, f) == pytest.approx(expected, abs=0.01)
    assert is_full(u, f, index=0.5)


def test_a_linear_spring_has_no_index_no_bulge_and_loses_nothing():
    u = path(1.0, -1.0, 1.0, -1.0, 1.0)
    for measure in (pinching_index, reloading_bulge, strength_lost_per_cycle, stiffness_lost_per_cycle, peak_asymmetry):
        assert measure(u, 3.0 * u) == pytest.approx(0.0, abs=1e-9), measure
    assert not is_full(u, 3.0 * u, index=0.25)


def test_the_index_of_a_bilinear_loop():
    """Springs k_1 (plastic at f_y) and k_2 side by side: at zero drift the plastic one alone holds f_y."""
    u = path(1.0, -1.0, 1.0, -1.0, 1.0)
    f = plastic(u, stiffness=20.0, strength=1.0) + 0.7 * u
    assert pinching_index(u, f) == pytest.approx(1.0 / 1.7, rel=1e-6)


def test_the_index_is_taken_where_the_drift_goes_through_zero_between_samples():
    u = np.array([0.0, 1.0, 0.3, -0.1, -1.0, -0.2, 0.2, 1.0])
    f = np.array([0.0, 2.0, 0.5, 0.1, -2.0, -0.6, -0.2, 2.0])
    # On unloading: (0.1 + 0.25 * 0.4) / 2 from above, (0.2 + 0.4) / 2 / 2 from below.
    assert pinching_index(u, f) == pytest.approx(np.median([0.2 / 2.0, 0.4 / 2.0]))


def test_a_branch_that_locks_sags():
    """Force u^3 has no force at zero drift and hangs half below its chord: area 1/4 over 1/2."""
    u = path(1.0, -1.0, 1.0, -1.0, 1.0)
    assert reloading_bulge(u, u**3) == pytest.approx(-0.5, abs=1e-4)
    assert pinching_index(u, u**3) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("loss", [0.0, 0.03, 0.2])
def test_a_known_loss_of_strength_per_cycle(loss):
    amplitudes = [1.0, -1.0] * 6
    u = path(*amplitudes)
    cycle = np.repeat(np.arange(len(amplitudes)) // 2, 400)
    f = plastic(u, strength=np.append(1.0, (1.0 - loss) ** cycle))
    assert strength_lost_per_cycle(u, f) == pytest.approx(loss, abs=1e-9)
    assert stiffness_lost_per_cycle(u, f) == pytest.approx(0.0, abs=1e-6)


def test_a_loss_of_strength_is_seen_while_amplitudes_grow():
    amplitudes = [sign * size for size in np.linspace(1.0, 1.9, 8) for sign in (1.0, -1.0)]
    u = path(*amplitudes)
    cycle = np.repeat(np.arange(len(amplitudes)) // 2, 400)
    f = plastic(u, strength=np.append(1.0, 0.9**cycle))
    assert strength_lost_per_cycle(u, f) == pytest.approx(0.1, abs=1e-9)
    assert strength_lost_per_cycle(u, plastic(u)) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("growth", [1.0, 1.05])
def test_a_known_loss_of_unloading_stiffness_per_cycle(growth):
    """Unloading at k_0 0.9^i from the force 1 in cycle i; the strength stays."""
    u, f = [0.0], [0.0]
    for i in range(6):
        for sign in (1.0, -1.0):
            peak, back = sign * growth**i, 1.0 / (20.0 * 0.9**i)
            u += [peak - sign * 0.3, peak, peak - sign * back]
            f += [sign, sign, 0.0]
    drift, force = np.array(u), np.array(f)
    assert stiffness_lost_per_cycle(drift, force) == pytest.approx(0.1, abs=1e-9)
    assert strength_lost_per_cycle(drift, force) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("reach", [1.0, 0.7, 1.6])
def test_peaks_are_compared_at_the_drift_that_both_directions_reach(reach):
    u = path(1.0, -reach, 1.0, -reach, 1.0, -reach)
    f = np.where(u > 0.0, 3.0, 2.0) * u
    assert peak_asymmetry(u, f) == pytest.approx(0.2)
    assert peak_asymmetry(u, np.where(u > 0.0, 2.0, 3.0) * u) == pytest.approx(-0.2)


def test_half_cycles_below_half_of_the_largest_do_not_count():
    u = path(0.3, -0.3, 1.0, -1.0, 0.6, -0.4, 1.0)
    assert [cycle.target for cycle in large_half_cycles(u)] == [1.0, -1.0, 0.6, 1.0]


@pytest.mark.parametrize("measure", EVERY)
@pytest.mark.parametrize("drift", [np.zeros(50), np.linspace(1.0, 2.0, 50), np.full(50, np.nan)])
def test_what_the_loop_does_not_tell_is_not_a_number(measure, drift):
    assert np.isnan(measure(drift, 2.0 * drift))


@pytest.mark.parametrize("measure", EVERY)
def test_measures_do_not_depend_on_units_and_on_which_direction_is_positive(measure):
    u = path(1.0, -0.9, 1.1, -1.2, 1.1, -1.2)
    f = plastic(u, stiffness=5.0, strength=np.linspace(1.0, 0.7, len(u))) + 0.3 * u + 0.2 * u**2
    known = measure(u, f)
    assert np.isfinite(known)
    assert measure(1e-3 * u, 1e5 * f) == pytest.approx(known, rel=1e-9)
    turned = -known if measure is peak_asymmetry else known
    assert measure(-u, -f) == pytest.approx(turned, rel=1e-9)


def columns() -> list[tuple[dict[str, str], np.ndarray, np.ndarray]]:
    if COLUMNS is None or not (COLUMNS / "index.csv").exists():
        pytest.skip("the measured columns shared/data/rc_columns are not here")
    with (COLUMNS / "index.csv").open(encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    return [(row, *np.loadtxt(COLUMNS / row["file"], delimiter=",", skiprows=2).T) for row in rows]


def test_the_index_of_the_measured_columns():
    """What stands in index.csv was computed by other code, from the same words."""
    difference = [abs(pinching_index(u, f) - float(row["zero_force_ratio"])) for row, u, f in columns()]
    assert len(difference) == 24
    assert np.median(difference) < 0.015
    assert max(difference) < 0.07


@pytest.mark.parametrize("index", [0.25, 0.49])
def test_fat_columns_are_full_and_pinched_ones_are_not(index):
    for row, u, f in columns():
        assert is_full(u, f, index=index) == (row["loops"] == "fat"), row["file"]


def test_columns_that_end_weak_lost_strength_in_their_cycles():
    """Last peak over the largest, as reported: below 0.7 the cycles lost strength; 0.8 and more: next to none."""
    lost = {row["file"]: (float(row["last_peak_ratio"]), strength_lost_per_cycle(u, f)) for row, u, f in columns()}
    assert all(loss > 0.03 for last, loss in lost.values() if last < 0.35)
    assert all(abs(loss) < 0.02 for last, loss in lost.values() if last > 0.8)
