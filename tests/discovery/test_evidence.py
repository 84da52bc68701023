"""Evidences against closed forms of a linear model and against direct quadrature of one-parameter models."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import cauchy, multivariate_normal

from bwbn_bayes.discovery.candidates import hypotheses, scales_of
from bwbn_bayes.discovery.evidence import (
    PRIOR_WIDTHS,
    Evidence,
    bridged_evidence,
    laplace_evidence,
    present_evidence,
    sampled_evidence,
)
from bwbn_bayes.discovery.race import Fit
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import CubicStiffness, QuadraticDamping, SensorBias, SensorGain
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import KnownNoise, Posterior
from bwbn_bayes.inference.modes import distinct, polish
from bwbn_bayes.parameters import Floats, Normal, PerStorey
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.structures.shear_building import ShearBuilding

KNOWN = ShearBuilding(masses=[2.0, 1.0], storey=BoucWen(k=60.0, c=0.4, alpha=0.15, beta=12.0, gamma=2.0, n=1.3))
BASE = KNOWN.with_effect(SensorGain(gain=PerStorey([Normal(1.0, 0.1), Normal(1.0, 0.2)])))
GROUND = el_centro("chopra", duration=8.0)
ENGINE = Lanes(substeps=1, n_threads=1)
CHANNELS = ("acceleration_1", "acceleration_2")
SD = 0.1
GAINS, BIAS = np.array([[1.03], [0.95]]), 0.02
WIDER, NARROWER = "ten times wider", "ten times narrower"


def shown(model: ShearBuilding, *values: float) -> Floats:
    """Response without noise, ``(2, n_times)``."""
    return ENGINE.simulate(model, np.array([values]), GROUND, CHANNELS).values[0]


def posterior_of(model: ShearBuilding, signals: Floats, noise: Floats | None = None) -> Posterior:
    """Given a record with white noise unless other noise is given."""
    white = SD * np.random.default_rng(1).standard_normal(signals.shape)
    measured = signals + (white if noise is None else noise)
    record = GROUND.with_channels(dict(zip(CHANNELS, measured, strict=True)))
    return Posterior(model=model, record=record, engine=ENGINE, noise=KnownNoise(sd=(SD, SD)))


def fitted(present: Posterior, effect: type[Effect]) -> Fit:
    """An effect at storey 1, polished from its starts."""
    centre = np.full((1, present.space.n_dim), 0.5)
    scales = scales_of(present, centre[0])
    hypothesis = hypotheses(present.model, scales, measured=CHANNELS, effects=[effect])[0]
    assert hypothesis.storeys == (1,)
    posterior = present.with_model(hypothesis.model)
    points, local = polish(posterior, hypothesis.starts(centre), n_iterations=40)
    return Fit(hypothesis=hypothesis, posterior=posterior, points=points, local=local)


def sampled(fit: Fit, n: int = 2000) -> Evidence:
    return sampled_evidence(fit, laplace_evidence(fit), np.random.default_rng(2), n)


@pytest.fixture(scope="module")
def linear() -> Fit:
    """Two sensors' gains are identified, a bias is asked for: the signals are linear in all three."""
    return fitted(posterior_of(BASE, GAINS * shown(KNOWN) + [[BIAS], [0.0]]), SensorBias)


def design(posterior: Posterior) -> tuple[Floats, Floats, Floats]:
    """Columns ``(2 n_times, n)``, prior means and standard deviations, in the order of the posterior's coordinates."""
    first, second = shown(KNOWN)
    none, ones = np.zeros_like(first), np.ones_like(first)
    columns = {"gain[1]": (first, none), "gain[2]": (none, second), "bias[1]": (ones, none)}
    priors = [parameter.prior for parameter in posterior.space.parameters]
    return (
        np.stack([np.concatenate(columns[name]) for name in posterior.space.names], axis=1),
        np.array([prior.mean for prior in priors]),
        np.array([prior.sd for prior in priors]),
    )


def measured_by(posterior: Posterior) -> Floats:
    return np.concatenate([posterior.record.channels[name] for name in CHANNELS])


def closed_form(posterior: Posterior) -> tuple[float, Floats, Floats]:
    """Log evidence, posterior means and standard deviations of the linear model with normal priors."""
    columns, means, sds = design(posterior)
    measured = measured_by(posterior)
    covariance = SD**2 * np.eye(len(measured)) + (columns * sds**2) @ columns.T
    log_evidence = multivariate_normal(columns @ means, covariance).logpdf(measured)
    precision = columns.T @ columns / SD**2 + np.diag(sds**-2.0)
    right = columns.T @ measured / SD**2 + means / sds**2
    return float(log_evidence), np.linalg.solve(precision, right), np.sqrt(np.diag(np.linalg.inv(precision)))


def test_laplace_is_the_closed_form_of_a_linear_model(linear: Fit) -> None:
    """The prior is flat in the cube and normal in its own unit: it bends over the posterior by less than 0.02 nat."""
    found = laplace_evidence(linear)
    log_evidence, means, sds = closed_form(linear.posterior)
    assert found.log_evidence == pytest.approx(log_evidence, abs=0.02)
    np.testing.assert_allclose(list(found.means.values()), means, atol=0.05 * np.min(sds))
    np.testing.assert_allclose(list(found.sds.values()), sds, rtol=0.02)
    assert (found.method, found.pareto_k) == ("Laplace", None)


def test_errors_are_real_where_the_information_is_far_sharper_in_one_direction(linear: Fit) -> None:
    """Rounding leaves such a matrix indefinite: the smallest eigenvalue can come out far below zero."""
    d = linear.points.shape[1]
    directions = np.linalg.qr(np.random.default_rng(3).standard_normal((d, d)))[0]
    information = 1e12 * np.outer(directions[:, 0], directions[:, 0]) - 1e3 * np.eye(d)
    local = replace(linear.local[np.array([0])], information=information[None])
    found = laplace_evidence(replace(linear, points=linear.points[:1], local=local))
    scale = linear.posterior.space.unit_scale(linear.posterior.space.from_unit(linear.points[:1]))[0]
    expected = np.sqrt((1.0 - np.square(directions[:, 0])) / 12.0) * scale
    assert list(found.sds.values()) == pytest.approx(expected)


def test_sampled_evidence_is_the_closed_form_within_four_standard_errors(linear: Fit) -> None:
    found = sampled(linear)
    log_evidence, means, sds = closed_form(linear.posterior)
    assert found.method == "importance"
    assert found.pareto_k is not None and found.pareto_k < 0.7
    assert 0.0 < found.log_evidence_se < 0.05
    assert abs(found.log_evidence - log_evidence) < 4.0 * found.log_evidence_se
    # 2,000 effective draws know a mean to 0.022 sd and an sd to 1.6 %.
    np.testing.assert_allclose(list(found.means.values()), means, atol=4.0 * 0.022 * np.min(sds))
    np.testing.assert_allclose(list(found.sds.values()), sds, rtol=4.0 * 0.016)


def test_evidence_by_tempering_is_the_closed_form(linear: Fit) -> None:
    """With 200 particles, as discovery uses where importance weights fail."""
    found = bridged_evidence(linear, laplace_evidence(linear), np.random.default_rng(3), 200)
    log_evidence, means, sds = closed_form(linear.posterior)
    assert found.method == "TMCMC"
    assert 0.0 < found.log_evidence_se < 0.5
    assert abs(found.log_evidence - log_evidence) < 4.0 * found.log_evidence_se
    np.testing.assert_allclose(list(found.means.values()), means, atol=4.0 * np.max(sds) / np.sqrt(50.0))


def test_the_present_model_too(linear: Fit) -> None:
    posterior = linear.posterior.with_model(linear.hypothesis.base)
    modes = distinct(*polish(posterior, np.full((1, 2), 0.5), n_iterations=20))
    found = present_evidence(posterior, modes, np.random.default_rng(4), 2000)
    log_evidence, _, _ = closed_form(posterior)
    assert abs(found.log_evidence - log_evidence) < 4.0 * found.log_evidence_se
    assert found.prior_shifts == {WIDER: 0.0, NARROWER: 0.0}


def test_an_effect_s_own_parameter_has_the_other_priors_and_no_one_else_s(linear: Fit) -> None:
    """The gains' normal priors are integrated in closed form; the bias, under Cauchy priors, by quadrature."""
    columns, means, sds = design(linear.posterior)
    own = linear.posterior.space.names.index("bias[1]")
    others = [i for i in range(3) if i != own]
    residual = measured_by(linear.posterior) - columns[:, others] @ means[others]
    covariance = SD**2 * np.eye(len(residual)) + (columns[:, others] * sds[others] ** 2) @ columns[:, others].T
    weighted = np.linalg.solve(covariance, columns[:, own])
    curvature = float(weighted @ columns[:, own])
    best = float(weighted @ residual) / curvature
    grid = best + np.linspace(-10.0, 10.0, 4001) / np.sqrt(curvature)
    log_likelihood = -0.5 * curvature * (grid - best) ** 2
    prior = linear.posterior.space.parameters[own].prior
    expected = {
        label: logsumexp(log_likelihood + cauchy(0.0, factor * prior.sd).logpdf(grid))
        - logsumexp(log_likelihood + prior.log_density(grid))
        for label, factor in PRIOR_WIDTHS.items()
    }
    assert expected[WIDER] < -2.0
    by_sampling, by_laplace = sampled(linear).prior_shifts, laplace_evidence(linear).prior_shifts
    for label, value in expected.items():
        # The posterior is a fiftieth as wide as the prior: a ratio of priors changes little over it.
        assert by_sampling[label] == pytest.approx(value, abs=0.01)
        assert by_laplace[label] == pytest.approx(value, abs=0.05)


@pytest.mark.parametrize(("effect", "size"), [(CubicStiffness, 60.0), (QuadraticDamping, 0.03)])
def test_one_parameter_models_against_quadrature(effect: type[Effect], size: float) -> None:
    """Two-sided and one-sided, so small that noise blurs them: a trapezium rule over the unit interval."""
    present = posterior_of(KNOWN, shown(KNOWN))
    hidden = fitted(present, effect).hypothesis
    fit = fitted(posterior_of(KNOWN, shown(hidden.model, size)), effect)
    (parameter,) = fit.posterior.space.parameters
    grid = np.linspace(0.0, 1.0, 6001)[1:-1]
    spacing = grid[1] - grid[0]
    values = parameter.prior.quantile(grid)
    near = (
        np.abs(values - fit.posterior.space.from_unit(fit.best(1))[0])
        < 12.0 * laplace_evidence(fit).sds[parameter.name]
    )
    log_likelihood = fit.posterior.log_likelihood(grid[near][:, None])
    log_evidence = float(logsumexp(log_likelihood) + np.log(spacing))
    found = sampled(fit)
    assert found.method == "importance"
    assert abs(found.log_evidence - log_evidence) < 4.0 * found.log_evidence_se
    for label, factor in PRIOR_WIDTHS.items():
        other = cauchy(0.0, factor * parameter.prior.sd)
        density = other.logpdf(values[near]) - np.log(1.0 - other.cdf(parameter.prior.support[0]))
        shifted = logsumexp(log_likelihood + density - parameter.prior.log_density(values[near]))
        expected = float(shifted - logsumexp(log_likelihood))
        assert found.prior_shifts[label] == pytest.approx(expected, abs=0.05)


def test_where_weights_have_no_usable_tail_laplace_stays(linear: Fit) -> None:
    """Modes far from where the posterior is: importance weights of almost nothing."""
    point = np.array([[0.9, 0.1, 0.9]])
    elsewhere = replace(linear, points=point, local=linear.posterior.linearise(point))
    laplace = laplace_evidence(elsewhere)
    assert sampled_evidence(elsewhere, laplace, np.random.default_rng(5), 400) == laplace


def test_coloured_noise_counts_for_each_model() -> None:
    """AR(1) of coefficient m gains ``-n/2 log(1 - m^2)`` nats over white noise; Schwarz takes half a log n for it.

    By the delta method the gain has an sd of ``m sqrt(n / (1 - m^2))``. White noise gains nothing in 49 of 50 records.
    """
    rng, n, memory = np.random.default_rng(6), GROUND.n_times, 0.6
    noise = SD * rng.standard_normal((2, n))
    for i in range(1, n):
        noise[0, i] = memory * noise[0, i - 1] + np.sqrt(1.0 - memory**2) * noise[0, i]
    posterior = posterior_of(BASE, shown(KNOWN), noise)
    modes = distinct(*polish(posterior, np.full((1, 2), 0.5), n_iterations=20))
    found = present_evidence(posterior, modes, rng, 200)
    expected = -0.5 * n * np.log(1.0 - memory**2) - 0.5 * np.log(n)
    assert abs(found.coloured_gain - expected) < 4.0 * memory * np.sqrt(n / (1.0 - memory**2))
    assert found.total == found.log_evidence + found.coloured_gain
