"""Integrals on panels against closed forms: narrow, far apart, cut off, with a jump."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from bwbn_bayes.inference.panels import LogDensity, Rows, resolve
from bwbn_bayes.parameters import Floats

SD = np.array([1.0, 1e-2, 1e-4])


def normals(centre: Floats) -> LogDensity:
    """Log of standard normals' densities of the widths SD about a centre ``(n_rows,)``, not normalised."""

    def log_density(rows: Rows, at: Floats) -> Floats:
        return np.asarray(-0.5 * np.square((at - centre[rows, None]) / SD[rows, None]))

    return log_density


def edges_at(*marks: float) -> Floats:
    return np.tile([-5.0, *marks, 5.0], (3, 1))


def test_a_peak_between_marks_is_found() -> None:
    """No mark lies at the peak of a ten-thousandth of the span: only the steps between nodes betray it."""
    found = resolve(normals(np.full(3, 0.1234)), edges_at())
    ends = stats.norm(0.1234, SD).cdf(5.0) - stats.norm(0.1234, SD).cdf(-5.0)
    np.testing.assert_allclose(found.log_integral, np.log(SD * np.sqrt(2.0 * np.pi) * ends), atol=1e-9)


def test_two_peaks_at_marks_share_the_mass() -> None:
    def log_density(rows: Rows, at: Floats) -> Floats:
        return np.logaddexp(normals(np.full(3, -1.0))(rows, at), normals(np.full(3, 2.0))(rows, at) + np.log(3.0))

    found = resolve(log_density, edges_at(-1.0, 2.0))
    np.testing.assert_allclose(found.log_integral[1:], np.log(4.0 * SD[1:] * np.sqrt(2.0 * np.pi)), atol=1e-9)
    rng = np.random.default_rng(1)
    drawn = np.array([found.draw(log_density, rng)[1] for _ in range(2000)])
    assert abs(np.mean(drawn > 0.5) - 0.75) < 4.0 * np.sqrt(0.75 * 0.25 / 2000)


@pytest.mark.parametrize("row", [0, 1, 2])
def test_draws_follow_the_density(row: int) -> None:
    """Kolmogorov and Smirnov's test, a cut within the first one's density included."""
    log_density = normals(np.full(3, 0.1234))
    found = resolve(log_density, np.array([[0.0, 2.0], [-5.0, 5.0], [-5.0, 5.0]]))
    rng = np.random.default_rng(2)
    drawn = np.array([found.draw(log_density, rng)[row] for _ in range(2000)])
    whole = stats.norm(0.1234, SD[row])
    low, high = whole.cdf((0.0, 2.0) if row == 0 else (-5.0, 5.0))
    assert stats.kstest(drawn, lambda x: (whole.cdf(x) - low) / (high - low)).pvalue > 1e-3


def test_a_jump_is_closed_in_on() -> None:
    def log_density(_: Rows, at: Floats) -> Floats:
        return np.where(at < 0.3, 0.0, -np.inf)

    found = resolve(log_density, np.array([[0.0, 1.0]]))
    np.testing.assert_allclose(found.log_integral, np.log(0.3), atol=1e-6)


def test_rows_without_mass_have_none() -> None:
    def log_density(rows: Rows, at: Floats) -> Floats:
        return np.where(rows[:, None] == 1, 0.0, np.full_like(at, -np.inf))

    edges = np.array([[0.0, 1.0], [0.0, 1.0], [1.0, 1.0]])
    found = resolve(log_density, edges)
    np.testing.assert_allclose(found.log_integral, [-np.inf, 0.0, -np.inf], atol=1e-12)
    drawn = found.draw(log_density, np.random.default_rng(3))
    assert np.all(np.isnan(drawn) == [True, False, True])
    assert 0.0 < drawn[1] < 1.0


def test_no_rows_at_all() -> None:
    assert len(resolve(normals(np.empty(0)), np.empty((0, 4))).log_integral) == 0
