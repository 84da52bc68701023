"""The step behind printed times: any rate comes back to within the rounding, and usual ones exactly."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bwbn_bayes.errors import UserError
from bwbn_bayes.records.time_base import Source, printed_quantum, step_interval, stored_quantum, uniform_step

SOURCE = Source(file="run.csv", header="run.csv, line 1", place=lambda row: f"line {row + 2}")


def printed(rate: float, n_times: int, decimals: int, start: float = 0.0) -> list[str]:
    return [f"{start + i / rate:.{decimals}f}" for i in range(n_times)]


def read_step(cells: list[str], stated: float | None = None) -> float:
    return uniform_step(np.array([float(cell) for cell in cells]), printed_quantum(cells), stated, SOURCE)


@pytest.mark.parametrize("n_times", [8, 9, 10, 13, 16, 32, 63, 64, 100, 257, 1000, 5000, 40_000])
def test_256_hz_with_three_decimals(n_times: int) -> None:
    """It failed at every length: the slope between the first and the last printed time is no step that all allow."""
    assert read_step(printed(256.0, n_times, 3)) == 1 / 256


@pytest.mark.parametrize("decimals", [3, 4, 5, 6])
@pytest.mark.parametrize(
    "rate", [20, 25, 50, 51.2, 60, 64, 75, 100, 102.4, 120, 125, 128, 150, 200, 204.8, 240, 250, 256, 300, 320, 400]
)
@pytest.mark.parametrize("start", [0.0, 12.0])
def test_usual_rates_are_exact_from_64_rows_on(rate: float, decimals: int, start: float) -> None:
    """300 Hz with 64 rows was read 0.1 % wrong, as the shortest decimal near 1/300 s."""
    for n_times in (64, 1000):
        assert read_step(printed(rate, n_times, decimals, start)) == pytest.approx(1.0 / rate, rel=1e-15)


def test_digits_that_two_rates_share_give_the_rounder_step() -> None:
    """With 64 rows and three decimals 333 Hz prints the digits of a step of 3 ms; with more of either it does not."""
    assert printed(333.0, 64, 3) == [f"{0.003 * i:.3f}" for i in range(64)]
    assert read_step(printed(333.0, 64, 3)) == 0.003
    assert read_step(printed(333.0, 64, 4)) == pytest.approx(1 / 333, rel=1e-15)
    assert read_step(printed(333.0, 1000, 3)) == pytest.approx(1 / 333, rel=1e-15)


@settings(max_examples=200, deadline=None)
@given(
    rate=st.floats(1.0, 900.0),
    decimals=st.integers(3, 7),
    n_times=st.integers(8, 60),
    start=st.floats(0.0, 100.0),
)
def test_any_rate_is_read_to_within_the_rounding(rate: float, decimals: int, n_times: int, start: float) -> None:
    cells = printed(rate, n_times, decimals, start)
    times, quantum = np.array([float(cell) for cell in cells]), 10.0**-decimals
    try:
        step = read_step(cells)
    except UserError as error:
        # Steps as coarse as the printing, of which a few are long: a missing sample would look the same.
        assert quantum > 0.5 / rate
        assert "where the others are" in str(error)  # noqa: PT017
        return
    # Oracle: a time base of that step passes within half a digit of every printed time.
    residual = times - step * np.arange(n_times)
    assert np.ptp(residual) <= quantum * (1.0 + 1e-6)
    assert step == pytest.approx(1.0 / rate, abs=2.0 * quantum / (n_times - 1))


@settings(max_examples=100, deadline=None)
@given(st.lists(st.floats(-100.0, 100.0), min_size=2, max_size=12), st.floats(0.0, 5.0))
def test_the_interval_is_that_of_all_pairs(values: list[float], resolution: float) -> None:
    times = np.array(values)
    pairs = list(combinations(range(len(values)), 2))
    low, high = step_interval(times, resolution)
    assert low == pytest.approx(max((times[j] - times[i] - resolution) / (j - i) for i, j in pairs), abs=1e-9)
    assert high == pytest.approx(min((times[j] - times[i] + resolution) / (j - i) for i, j in pairs), abs=1e-9)


@pytest.mark.parametrize("rate", [700.0, 256.0 * 5])
def test_times_printed_no_finer_than_a_step(rate: float) -> None:
    """Steps of 1 and 2 ms in turn, or times that repeat: evenly placed, they are rounding."""
    assert read_step(printed(rate, 2000, 3)) == pytest.approx(1.0 / rate, rel=1e-15)


@pytest.mark.parametrize("missing", [1, 500, 998])
def test_a_missing_sample_does_not_hide_in_the_rounding(missing: int) -> None:
    """100 Hz with two decimals, one sample gone: 99.9 Hz would print the same digits, but nobody samples so."""
    cells = [cell for i, cell in enumerate(printed(100.0, 1000, 2)) if i != missing]
    with pytest.raises(UserError) as caught:
        read_step(cells)
    # Sample i stands in line i + 2; the gap shows at the line after it.
    assert str(caught.value).startswith(
        f"run.csv, line {missing + 2}, column time: the step is 0.02 s where the others"
    )


@pytest.mark.parametrize(
    ("times", "sentence"),
    [
        (np.full(10, 0.5), "line 3, column time: 0.5 s does not come after 0.5 s"),
        (1.0 - 0.02 * np.arange(10.0), "line 3, column time: 0.98 s does not come after 1 s"),
        (0.01 * np.arange(10.0) ** 1.5, "the step is"),
        (np.cumsum(0.01 * (1.0 + 4e-4 * np.linspace(-1.0, 1.0, 3000))), "the times drift"),
    ],
    ids=["constant", "backwards", "chirp", "slow clock"],
)
def test_what_is_not_uniform_is_refused(times: np.ndarray, sentence: str) -> None:
    with pytest.raises(UserError, match=sentence):
        uniform_step(times, stored_quantum(times), None, SOURCE)


def test_stored_times_that_were_rounded_before() -> None:
    times = np.round(np.arange(500) / 256.0, 3)
    assert uniform_step(times, stored_quantum(times), None, SOURCE) == 1 / 256


def test_clock_jitter_below_a_thousandth_of_a_step_is_no_step_of_its_own() -> None:
    times = 0.005 * np.arange(400) + 2e-6 * np.sin(np.arange(400.0))
    assert uniform_step(times, stored_quantum(times), None, SOURCE) == 0.005


def test_a_stated_step_is_taken_where_the_times_allow_it() -> None:
    cells = printed(333.0, 64, 3)
    assert read_step(cells, stated=1 / 333) == 1 / 333
    with pytest.raises(UserError, match=r"the time_step is stated as 0\.004 s but the times step by 0\.003 s"):
        read_step(cells, stated=0.004)


@pytest.mark.parametrize("zero", ["0e400", "0E-999", "0.000e308"])
def test_a_zero_has_no_leading_digit(zero: str) -> None:
    """Its exponent made a step of 1e395, and a traceback."""
    assert printed_quantum([zero, "0.01", "0.02"]) <= 0.01
    assert np.isfinite(printed_quantum([zero]))
