"""Measured, as given and improved: any samples of a record, loops by cycle, errors by cycle, figures."""

from dataclasses import replace
from types import SimpleNamespace

import matplotlib as mpl
import numpy as np
import pytest

from bwbn_bayes.discovery.held_out import HeldOut
from bwbn_bayes.discovery.predictive import PredictiveInterval
from bwbn_bayes.records.joined import join_records
from bwbn_bayes.records.record import Record
from bwbn_bayes.report.canvas import STYLE
from bwbn_bayes.report.comparison import MAX_CYCLES, Part, errors_by_cycle, loops_by_cycle, parts_of
from bwbn_bayes.report.comparison_figures import draw_comparison

N_CYCLES, PER_CYCLE = 12, 40
PHASE = 2.0 * np.pi * np.arange(N_CYCLES * PER_CYCLE) / PER_CYCLE
PUSHED = -0.05 * (1.0 + np.arange(len(PHASE)) / len(PHASE)) * np.cos(PHASE)
"""Turns at every half period, from the first sample on, and grows."""


def specimen_part(counted, *, name="fitted", given=1.2, improved=1.01):
    record = Record(
        name="test", time_step=1.0, excitation=PUSHED, excitation_kind="displacement",
        channels={"force": 1e6 * PUSHED}, has_time=False,
    )  # fmt: skip
    measured = record.measured[:, counted]
    return Part(
        name=name, label=name, record=record, counted=counted, channels=("force",), measured=measured,
        given=given * measured, improved=None if improved is None else improved * measured,
    )  # fmt: skip


def test_loops_are_single_cycles_of_the_samples_that_count():
    """Repeat cycles are held out: every second cycle, so that neither part is one stretch."""
    number = np.arange(len(PUSHED)) // PER_CYCLE
    fitted, held_out = (np.flatnonzero(number % 2 == odd) for odd in (0, 1))
    loops = loops_by_cycle((specimen_part(fitted), specimen_part(held_out, name="held_out")))
    numbers = [1, 3, 5, 7, 9, 11, 2, 4, 6, 8, 10, 12]
    assert [loop.name for loop in loops] == [f"cycle {number}" for number in numbers]
    for number, loop in zip(numbers, loops, strict=True):
        own = slice((number - 1) * PER_CYCLE, number * PER_CYCLE)
        np.testing.assert_allclose(loop.displacement, PUSHED[own], atol=0.01)
        np.testing.assert_allclose(loop.models[0], 1.2e6 * loop.displacement)
    assert len(loops_by_cycle([specimen_part(np.arange(len(PUSHED)))])) == MAX_CYCLES


def test_a_turning_point_alone_is_no_loop():
    """Half cycles end with their turning point, which the cycle's number counts with the next."""
    held_out = np.arange(PER_CYCLE + 1, 2 * PER_CYCLE + 1)
    part = specimen_part(held_out, name="held_out")
    assert [loop.name for loop in loops_by_cycle([part])] == ["cycle 2"]
    assert errors_by_cycle([part])[0].numbers.tolist() == [2]


def test_predictive_intervals_are_drawn_where_they_are_known():
    counted = np.arange(len(PUSHED))
    held_out = specimen_part(counted[300:], name="held_out")
    interval = PredictiveInterval(low=held_out.measured - 1e3, high=held_out.measured + 1e3, coverage=0.9)
    held_out = replace(held_out, interval=interval)
    loops = loops_by_cycle([specimen_part(counted[:300]), held_out])
    for loop in loops:
        assert (loop.band is None) == (loop.part.name == "fitted")
        if loop.band is not None:
            np.testing.assert_allclose(loop.band[1] - loop.band[0], 2e3)
    with mpl.rc_context(STYLE):
        drawings = draw_comparison([specimen_part(counted[:300]), held_out])
    assert "90 % predictive intervals" in drawings[0].caption


def test_errors_by_cycle_are_over_one_force():
    (found,) = errors_by_cycle([specimen_part(np.arange(len(PUSHED)))])
    rms = np.sqrt(np.mean(np.square(PUSHED)))
    own = np.sqrt(np.mean(np.square(PUSHED.reshape(N_CYCLES, PER_CYCLE)), axis=1))
    np.testing.assert_allclose(found.errors[0], 0.2 * own / rms, rtol=0.02)
    np.testing.assert_allclose(found.errors[1], 0.01 * own / rms, rtol=0.02)


def test_errors_of_the_parts_of_one_measurement_are_over_its_whole_force():
    """Two pictures of one error stood at different heights: the end that is held out moves more than what is fitted."""
    whole = specimen_part(np.arange(len(PUSHED))).record
    fitted, apart = whole.until(299.0), HeldOut(record=whole, after_s=299.0)
    counted = np.arange(300), apart.counted
    gaps = [
        SimpleNamespace(before=SimpleNamespace(channels=("force",), values=1.2 * whole.measured[:, own]), after=None)
        for own in counted
    ]
    gap = SimpleNamespace(**vars(gaps[0]), held_out=SimpleNamespace(**vars(gaps[1]), interval=None))
    found = errors_by_cycle(parts_of(SimpleNamespace(record=fitted, gap=gap, held_out=apart, added=())))
    own = np.sqrt(np.mean(np.square(PUSHED.reshape(N_CYCLES, PER_CYCLE)), axis=1))
    rms = np.sqrt(np.mean(np.square(PUSHED)))
    assert found[0].errors[0][:7] == pytest.approx(0.2 * own[:7] / rms, rel=0.02)
    assert found[1].errors[0][-4:] == pytest.approx(0.2 * own[-4:] / rms, rel=0.02)


@pytest.mark.parametrize("improved", [None, 1.01, np.inf, 1e200], ids=["nothing added", "near", "infinite", "far"])
def test_a_specimen_is_drawn_by_cycle_and_never_against_seconds(improved):
    counted = np.arange(len(PUSHED))
    parts = (specimen_part(counted[:300], improved=improved),
             specimen_part(counted[300:], name="held_out", improved=improved))  # fmt: skip
    with mpl.rc_context(STYLE):
        drawings = draw_comparison(parts)
    assert [drawing.name for drawing in drawings] == ["loops_by_cycle.png", "error_by_cycle.png"]
    assert not any("[s]" in drawing.caption + drawing.alt for drawing in drawings)
    assert "held out" in drawings[0].alt


def test_cycles_of_several_tests_are_counted_in_each():
    """Errors stand side by side, loops by the names of their tests."""
    one = specimen_part(np.arange(len(PUSHED))).record
    record = join_records([replace(one, name="A").until(3 * PER_CYCLE), replace(one, name="B").until(2 * PER_CYCLE)])
    measured = record.measured
    part = Part(
        name="fitted", label="fitted", record=record, counted=np.arange(record.n_times), channels=("force",),
        measured=measured, given=1.2 * measured, improved=None,
    )  # fmt: skip
    names = [loop.name for loop in loops_by_cycle([part])]
    assert names == [*(f"cycle {number} of A" for number in (1, 2, 3)), *(f"cycle {number} of B" for number in (1, 2))]
    (errors,) = errors_by_cycle([part])
    assert errors.numbers.tolist() == [1, 2, 3, 4, 5]
    assert [name for _, name in errors.begins] == ["A", "B"]
    assert errors.begins[1][0] == 3.5
    with mpl.rc_context(STYLE):
        assert all(drawing.png for drawing in draw_comparison([part]))


def test_a_building_is_drawn_against_time_the_worst_channel_first():
    times = 0.02 * np.arange(1000)
    rows = {f"acceleration_{i}": np.sin((2.0 + i) * times) for i in (1, 2, 3)}
    record = Record(name="quake", time_step=0.02, excitation=np.sin(3.0 * times), channels=rows)
    given = record.measured * np.array([[1.1], [1.5], [1.2]])
    part = Part(
        name="fitted", label="fitted record", record=record, counted=np.arange(1000), channels=tuple(rows),
        measured=record.measured, given=given, improved=record.measured,
    )  # fmt: skip
    assert part.worst_first() == [1, 2, 0]
    with mpl.rc_context(STYLE):
        (drawing,) = draw_comparison([part])
    assert drawing.name == "history_fitted.png"
    assert "acceleration, floor 2, which the model as given misses most" in drawing.caption
