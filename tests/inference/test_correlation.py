"""Whitening against the covariance matrix written out, and orders of autoregression against known ones."""

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

from bwbn_bayes.inference.correlation import Correlation, SharedFunctions, autoregression, order_cost
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record

N = 60


def covariance_of_autoregression(coefficients: Floats) -> Floats:
    """Of a process without beginning: the squared sum of the answers to what was new, far back into the past."""
    answer = lfilter([1.0], np.concatenate([[1.0], -coefficients]), np.eye(1, 3000)[0])
    return toeplitz([float(answer[lag:] @ answer[: len(answer) - lag]) for lag in range(N)])


@pytest.mark.parametrize("coefficients", [[], [0.7], [1.2, -0.4], [0.9, 0.2, -0.3, 0.1]])
def test_a_filter_is_the_normal_density_of_its_errors(coefficients: list[float]) -> None:
    own = np.array(coefficients)
    residual = np.random.default_rng(1).standard_normal((1, N))
    correlation = Correlation(coefficients=(own,))
    white = correlation.whitened(residual)[0]
    density = -0.5 * np.sum(np.square(white)) - 0.5 * N * np.log(2.0 * np.pi) + correlation.log_volume
    expected = multivariate_normal(np.zeros(N), covariance_of_autoregression(own)).logpdf(residual[0])
    assert density == pytest.approx(expected)


def test_shared_functions_are_the_normal_density_of_their_process() -> None:
    rng = np.random.default_rng(2)
    basis, residual = rng.standard_normal((N, 7)) * np.linspace(0.1, 3.0, 7), rng.standard_normal((1, N))
    correlation = Correlation(shared=SharedFunctions.of(basis).times(1.5), log_prior=-3.0)
    white = correlation.whitened(residual)[0]
    density = -0.5 * np.sum(np.square(white)) - 0.5 * N * np.log(2.0 * np.pi) + correlation.log_volume
    covariance = np.eye(N) + 1.5**2 * basis @ basis.T
    assert density == pytest.approx(multivariate_normal(np.zeros(N), covariance).logpdf(residual[0]) - 3.0)
    # What the errors share is expected to be K (K + 1)^-1 of them.
    process = covariance - np.eye(N)
    np.testing.assert_allclose(correlation.shared_part(residual[0]), process @ np.linalg.solve(covariance, residual[0]))


def test_derivatives_are_whitened_as_residuals_are() -> None:
    """Any leading dimensions; two channels, each by its own past."""
    rows = np.random.default_rng(3).standard_normal((4, 3, 2, N))
    correlation = Correlation(coefficients=(np.array([0.5]), np.empty(0)))
    white = correlation.whitened(rows)
    assert white.shape == rows.shape
    np.testing.assert_array_equal(white[..., 1, :], rows[..., 1, :])
    np.testing.assert_allclose(white[..., 0, 1:], rows[..., 0, 1:] - 0.5 * rows[..., 0, :-1])


@pytest.mark.parametrize("coefficients", [[], [0.7], [0.9, 0.2, -0.3, 0.1]])
def test_white_rows_are_coloured_as_errors_are_whitened(coefficients: list[float]) -> None:
    """There and back, from the first sample on; two channels, the second white."""
    white = np.random.default_rng(3).standard_normal((4, 2, N))
    correlation = Correlation(coefficients=(np.array(coefficients), np.empty(0)))
    coloured = correlation.coloured(white)
    np.testing.assert_array_equal(coloured[:, 1], white[:, 1])
    np.testing.assert_allclose(correlation.whitened(coloured), white, atol=1e-12)


@pytest.mark.parametrize("shared", [False, True])
def test_products_are_those_of_whitened_rows(*, shared: bool) -> None:
    rng = np.random.default_rng(5)
    rows = rng.standard_normal((4, 3, 1, N))
    basis = SharedFunctions.of(rng.standard_normal((N, 6)) * 30.0)
    correlation = Correlation(shared=basis) if shared else Correlation(coefficients=(np.array([0.6]),))
    white = correlation.whitened(rows)[:, :, 0]
    expected = np.einsum("nit,njt->nij", white, white)[:, None]
    np.testing.assert_allclose(correlation.products(rows), expected, rtol=1e-9, atol=1e-9)


def test_the_first_samples_share_the_same_functions() -> None:
    rng = np.random.default_rng(4)
    basis, residual = rng.standard_normal((N, 3)), rng.standard_normal((1, 20))
    whole = Correlation(shared=SharedFunctions.of(basis))
    record = Record(name="first", time_step=0.1, excitation=np.ones(20), channels={"acceleration_1": np.zeros(20)})
    early = whole.until(record)
    covariance = np.eye(20) + basis[:20] @ basis[:20].T
    quadratic = residual[0] @ np.linalg.solve(covariance, residual[0])
    assert np.sum(np.square(early.whitened(residual))) == pytest.approx(quadratic)
    filtered = Correlation(coefficients=(np.array([0.5]), np.array([0.2])), blocks=(record.blocks[0],) * 2)
    np.testing.assert_array_equal(filtered.until(record).coefficients, [[0.5]])


@pytest.mark.parametrize(("coefficients", "order"), [([], 0), ([0.6], 1), ([1.1, -0.5], 2)])
def test_the_order_is_chosen_by_evidence(coefficients: list[float], order: int) -> None:
    n, errors = 2000, np.random.default_rng(5).standard_normal(2000)
    own = np.array(coefficients)
    for i in range(n):
        errors[i] += sum(c * errors[i - lag] for lag, c in enumerate(own, start=1) if i >= lag)
    found, gain = autoregression(errors)
    assert len(found) == order
    # A standard error of 1 / sqrt(n) at most.
    np.testing.assert_allclose(found, own, atol=4.0 / np.sqrt(n))
    assert (gain > 100.0) if order else (gain == 0.0)


def test_a_slope_is_not_taken_for_noise_of_a_long_memory() -> None:
    """A filter with a root at one asks of a fit its slope alone, and takes any offset for noise."""
    coefficients, _ = autoregression(np.linspace(0.0, 1.0, 400))
    assert np.sum(coefficients) < 1.0
    assert autoregression(np.zeros(50))[1] == 0.0
    assert order_cost(2, 100) == pytest.approx(-np.log(100.0))


def test_each_sample_has_its_part_of_the_volume() -> None:
    """Functions that live in one block each: a block's samples have the determinant of its own covariance."""
    rng, lengths = np.random.default_rng(7), (20, 30)
    own = [rng.standard_normal((n, 4)) for n in lengths]
    basis = np.concatenate([np.hstack([own[0], 0.0 * own[0]]), np.hstack([0.0 * own[1], own[1]])])
    volumes = np.split(SharedFunctions.of(basis).times(2.0).log_volumes, [lengths[0]])
    for volume, functions in zip(volumes, own, strict=True):
        covariance = np.eye(len(functions)) + 4.0 * functions @ functions.T
        assert np.sum(volume) == pytest.approx(-0.5 * np.linalg.slogdet(covariance)[1])


def test_no_rows_are_whitened_to_none() -> None:
    """As where not one draw of a proposal lies within the prior."""
    correlation = Correlation(coefficients=(np.array([0.4]), np.array([])))
    assert correlation.whitened(np.empty((0, 2, 50))).shape == (0, 2, 50)
    assert correlation.products(np.empty((0, 1, 2, 50))).shape == (0, 2, 1, 1)
