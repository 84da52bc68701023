"""Evidences against closed forms of a linear model and against direct quadrature of one-parameter models."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from bwbn_bayes.discovery.candidates import hypotheses, scales_of
from bwbn_bayes.discovery.evidence import Evidence, autoregressive, autoregressive_bound, laplace, recounted
from bwbn_bayes.discovery.evidence import sampled as sampled_evidence
from bwbn_bayes.discovery.race import Fit
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import CubicStiffness, QuadraticDamping, SensorBias, SensorGain
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import IntegratedNoise, KnownNoise, Posterior
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
    return sampled_evidence(laplace_of(fit), np.random.default_rng(2), n)


def laplace_of(fit: Fit) -> Evidence:
    return laplace(fit.posterior, fit.modes)


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
    found = laplace_of(linear)
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
    found = laplace_of(replace(linear, points=linear.points[:1], local=local))
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


def test_the_present_model_too(linear: Fit) -> None:
    posterior = linear.posterior.with_model(linear.hypothesis.base)
    modes = distinct(*polish(posterior, np.full((1, 2), 0.5), n_iterations=20))
    found = sampled_evidence(laplace(posterior, modes), np.random.default_rng(4), 2000)
    log_evidence, _, _ = closed_form(posterior)
    assert abs(found.log_evidence - log_evidence) < 4.0 * found.log_evidence_se


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
    near = np.abs(values - fit.posterior.space.from_unit(fit.best(1))[0]) < 12.0 * laplace_of(fit).sds[parameter.name]
    log_likelihood = fit.posterior.log_likelihood(grid[near][:, None])
    log_evidence = float(logsumexp(log_likelihood) + np.log(spacing))
    found = sampled(fit)
    assert found.method == "importance"
    assert abs(found.log_evidence - log_evidence) < 4.0 * found.log_evidence_se


def test_where_so_many_draws_are_not_to_be_had_laplace_stays(linear: Fit) -> None:
    """Modes far from where the posterior is: importance weights of almost nothing."""
    point = np.array([[0.9, 0.1, 0.9]])
    elsewhere = replace(linear, points=point, local=linear.posterior.linearise(point))
    at_hand = laplace_of(elsewhere)
    assert sampled_evidence(at_hand, np.random.default_rng(5), 400) == at_hand


def with_memory(memory: float) -> Posterior:
    """The first sensor's errors are autoregressive; the level is integrated, since a known one leaves no choice."""
    rng, n = np.random.default_rng(6), GROUND.n_times
    noise = SD * rng.standard_normal((2, n))
    for i in range(1, n):
        noise[0, i] = memory * noise[0, i - 1] + np.sqrt(1.0 - memory**2) * noise[0, i]
    return replace(posterior_of(BASE, shown(KNOWN), noise), noise=IntegratedNoise(shape=1.0, scale=(SD**2, SD**2)))


@pytest.mark.parametrize("as_one", [1.0, 1.5])
def test_autoregressive_errors_count_for_each_model(as_one: float) -> None:
    """AR(1) of coefficient m gains ``-n/2 log(1 - m^2)`` nats over white noise; Schwarz takes half a log n for it.

    By the delta method the gain has an sd of ``m sqrt(n / (1 - m^2))``. White noise gains nothing in 49 of 50 records.
    Behind a filter fewer samples count, in the least that is gained as in what is.
    """
    memory, n = 0.6, GROUND.n_times
    posterior = with_memory(memory)
    assert isinstance(posterior.noise, IntegratedNoise)
    posterior = replace(posterior, noise=replace(posterior.noise, correlation_samples=as_one))
    modes = distinct(*polish(posterior, np.full((1, 2), 0.5), n_iterations=20))
    white, found = laplace(posterior, modes), autoregressive(posterior, modes)
    expected = -0.5 * n / as_one * np.log(1.0 - memory**2) - 0.5 * np.log(n)
    tolerance = 4.0 * memory / as_one * np.sqrt(n / (1.0 - memory**2))
    assert abs(autoregressive_bound(posterior, modes) - expected) < tolerance
    # What is gained at the white optimum is the least that is gained.
    assert found.log_evidence >= white.log_evidence + autoregressive_bound(posterior, modes) - 0.1
    assert found.correlation is not None
    assert [len(own) for own in found.correlation.coefficients] == [1, 0]
    assert found.correlation.coefficients[0] == pytest.approx([memory], abs=4.0 / np.sqrt(n))


@pytest.mark.parametrize("memory", [0.0, 0.9])
@pytest.mark.parametrize("effect", [CubicStiffness, QuadraticDamping, SensorBias])
def test_a_law_never_fits_worse_than_the_one_it_contains(effect: type[Effect], memory: float) -> None:
    """Under errors with a past too: the gain used to be added at the optimum for white ones, 379 nats too low."""
    posterior = replace(with_memory(memory), model=BASE)
    modes = distinct(*polish(posterior, np.full((1, 2), 0.5), n_iterations=20))
    fit = fitted(posterior, effect)
    without, with_it = autoregressive(posterior, modes), autoregressive(fit.posterior, fit.modes)
    assert with_it.log_likelihood > without.log_likelihood - 0.05


@pytest.mark.parametrize("of_one_channel", [False, True])
@pytest.mark.parametrize("as_one", [1.0, 8.0])
def test_under_another_count_of_samples_the_evidence_is_that_of_a_fit_under_it(
    as_one: float, of_one_channel: bool
) -> None:
    posterior, n = with_memory(0.6), 1 if of_one_channel else 2
    record = posterior.record.with_channels({name: posterior.record.channels[name] for name in CHANNELS[:n]})
    posterior = replace(posterior, record=record, noise=IntegratedNoise(shape=1.0, scale=(SD**2,) * n))
    modes = distinct(*polish(posterior, np.full((1, 2), 0.5), n_iterations=20))
    noise = IntegratedNoise(shape=1.0, scale=(SD**2,) * n, correlation_samples=as_one)
    view = posterior.with_noise(noise)
    expected = laplace(view, distinct(*polish(view, np.full((1, 2), 0.5), n_iterations=20)))
    found = recounted(posterior, modes, noise)
    assert found.posterior.noise == noise
    assert found.log_evidence == pytest.approx(expected.log_evidence, abs=0.01)
    assert list(found.means.values()) == pytest.approx(list(expected.means.values()), abs=1e-4)
