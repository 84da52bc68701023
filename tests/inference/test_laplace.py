"""Laplace's approximation against closed forms, sums over a grid and Mills' ratio."""

import numpy as np
import pytest
from evidence_oracles import gaussian_in_box
from inference_cases import AT_BOUND, INSIDE, gaussian_mode
from scipy import special, stats

from bwbn_bayes.inference.laplace import laplace_log_evidence
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.parameters import Floats


@pytest.mark.parametrize("case", [INSIDE, AT_BOUND], ids=["inside", "at a bound and past it"])
def test_laplace_is_exact_for_a_gaussian_in_a_box(case: tuple[Floats, Floats]) -> None:
    """Over all space the expansion at a bound has up to 2.1 nats more than the cube holds of it."""
    assert laplace_log_evidence([gaussian_mode(*case)]) == pytest.approx(gaussian_in_box(*case).log_evidence, abs=1e-6)


@pytest.mark.parametrize("sd", [0.01, 1e-9])
@pytest.mark.parametrize("steepness", [0.5, 3.0, 990.0, 1010.0, 1e6, 1e175])
def test_laplace_of_an_optimum_that_presses_on_its_bound(steepness: float, sd: float) -> None:
    """Beside the tail of a normal distribution (Mills' ratio), however far out; fits stop a millionth short of bounds.

    By slopes as steep as of the second, a specimen's explanations were worth a million nats in that millionth.
    """
    mode = Mode(
        point=np.array([1e-6, 0.5]),
        log_likelihood=0.0,
        gradient=np.array([-steepness / sd, 0.0]),
        information=np.diag([sd**-2, sd**-2]),
    )
    ratio = np.sqrt(0.5 * np.pi) * special.erfcx(steepness / np.sqrt(2.0))
    expected = np.log(sd * ratio) + np.log(sd * np.sqrt(2.0 * np.pi))
    assert laplace_log_evidence([mode]) == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("n_dim", [1, 3, 10])
def test_laplace_of_a_likelihood_that_says_nothing(n_dim: int) -> None:
    """The prior's mass is one; by the prior's variance alone each direction had 0.72 of it."""
    nothing, centre = np.zeros((n_dim, n_dim)), np.full(n_dim, 0.5)
    mode = Mode(point=centre, log_likelihood=0.0, gradient=np.zeros(n_dim), information=nothing)
    assert laplace_log_evidence([mode]) == pytest.approx(0.0, abs=0.01)


def test_laplace_of_a_ridge_that_is_pressed_on_a_bound() -> None:
    """Against the sum over a grid."""
    root = np.random.default_rng(0).normal(size=(2, 2))
    point, gradient, information = np.array([0.0, 0.4]), np.array([-8.0, 0.0]), 50.0 * root @ root.T
    share = (np.arange(400) + 0.5) / 400
    step = np.stack(np.meshgrid(share, share), axis=-1).reshape(-1, 2) - point
    exact = np.log(np.mean(np.exp(step @ gradient - 0.5 * np.einsum("ni,ij,nj->n", step, information, step))))
    mode = Mode(point=point, log_likelihood=0.0, gradient=gradient, information=information)
    assert laplace_log_evidence([mode]) == pytest.approx(exact, abs=0.01)


@pytest.mark.parametrize(("scale", "noise"), [(0.5, 0.3), (1.0, 1.0), (2.0, 0.3), (2.0, 1.0)])
def test_laplace_of_a_normal_prior_is_exact_in_its_standard_normal(scale: float, noise: float) -> None:
    """One weight z of prior N(0, scale), measured once; its coordinate is uniform where it is N(0, 1).

    In the cube Laplace's approximation erred by up to two nats.
    """
    measured, along = 0.8, 1e4
    z = measured / noise**2 / (1.0 / noise**2 + 1.0 / scale**2 - 1.0)  # the optimum in the cube
    growth = 1.0 / stats.norm.pdf(z)
    reached = stats.norm.logpdf(measured, z, noise) - 0.5 * z**2 * (scale**-2.0 - 1.0) - np.log(scale)
    curvature = (noise**-2.0 + scale**-2.0 - 1.0) * growth**2
    mode = Mode(
        point=np.array([stats.norm.cdf(z), 0.3]),
        log_likelihood=float(reached),
        gradient=np.zeros(2),
        information=np.diag([curvature, along]),
    )
    exact = stats.norm.logpdf(measured, 0.0, np.hypot(scale, noise)) + 0.5 * np.log(2.0 * np.pi / along)
    assert laplace_log_evidence([mode], np.array([0])) == pytest.approx(exact, abs=1e-6)
