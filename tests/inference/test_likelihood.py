"""Likelihoods against scipy.stats and quadrature, slopes against finite differences."""

import pickle
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from inference_cases import posterior_of, recorded, sdof_model, true_point
from scipy import integrate, signal, stats

from bwbn_bayes import BoucWen, HalfNormal, IntegratedNoise, KnownNoise, LogNormal, Record, SampledNoise, UserError
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.correlation import Correlation, SharedFunctions
from bwbn_bayes.inference.likelihood import Noise, Posterior, default_noise
from bwbn_bayes.parameters import Floats, Uniform

N_TIMES = 60
RESIDUALS = np.random.default_rng(1).normal(0.0, [[[0.3], [2.0]]], (5, 2, N_TIMES))
MISFIT = np.sum(RESIDUALS**2, axis=2)
VALUES = np.random.default_rng(2).uniform(0.2, 3.0, (5, 2))

KNOWN = KnownNoise(sd=(0.3, 2.5))
INTEGRATED = IntegratedNoise(shape=2.5, scale=(0.2, 6.0))
SAMPLED = SampledNoise(channels=("acceleration_1", "acceleration_2"), priors=(HalfNormal(1.0), LogNormal(1.0, 0.5)))
FILTERED = replace(INTEGRATED, correlation_samples=2.5)
NOISES = [KNOWN, INTEGRATED, FILTERED, SAMPLED]


def test_known_noise() -> None:
    expected = np.sum(stats.norm.logpdf(RESIDUALS, scale=np.array(KNOWN.sd)[:, None]), axis=(1, 2))
    np.testing.assert_allclose(KNOWN.log_likelihood(MISFIT, N_TIMES, VALUES), expected, rtol=1e-12)


def test_sampled_noise() -> None:
    expected = np.sum(stats.norm.logpdf(RESIDUALS, scale=VALUES[:, :, None]), axis=(1, 2))
    np.testing.assert_allclose(SAMPLED.log_likelihood(MISFIT, N_TIMES, VALUES), expected, rtol=1e-12)


def test_integrated_noise_is_the_quadrature_over_its_prior() -> None:
    def channel(residual: Floats, scale: float) -> float:
        centre = np.log((scale + 0.5 * residual @ residual) / (INTEGRATED.shape + 0.5 * N_TIMES))

        def log_integrand(log_variance: float) -> float:
            variance = np.exp(log_variance)
            likelihood = np.sum(stats.norm.logpdf(residual, scale=np.sqrt(variance)))
            return float(likelihood + stats.invgamma.logpdf(variance, INTEGRATED.shape, scale=scale) + log_variance)

        peak = log_integrand(centre)
        area, _ = integrate.quad(lambda t: np.exp(log_integrand(t) - peak), centre - 3.0, centre + 3.0, epsrel=1e-10)
        return peak + float(np.log(area))

    expected = [sum(map(channel, draw, INTEGRATED.scale)) for draw in RESIDUALS]
    np.testing.assert_allclose(INTEGRATED.log_likelihood(MISFIT, N_TIMES, VALUES), expected, rtol=1e-9)


def test_where_samples_count_together_there_are_fewer_of_them() -> None:
    """Residuals that each stand twice, two counting as one, say what each of them says once."""
    twice = replace(INTEGRATED, correlation_samples=2.0)
    once = INTEGRATED.log_likelihood(MISFIT, N_TIMES, VALUES)
    np.testing.assert_allclose(twice.log_likelihood(2.0 * MISFIT, 2 * N_TIMES, VALUES), once, rtol=1e-12)
    drawn = [
        noise.draw_sd(np.random.default_rng(1), factor * MISFIT, factor * N_TIMES, VALUES)
        for noise, factor in ((INTEGRATED, 1), (twice, 2))
    ]
    np.testing.assert_allclose(drawn[0], drawn[1], rtol=1e-12)


@pytest.mark.parametrize("promised", [30.0, 400.0, 3000.0])
def test_at_most_is_what_blocks_of_unlike_length_can_gain(promised: float) -> None:
    """By any division of a fall of the squared residuals among them; it was less than promised."""
    noise, n_times = IntegratedNoise(shape=1.0, scale=(1.0, 1.0)), np.array([100.0, 20_000.0])
    counted = noise.shape + 0.5 * n_times
    misfit = 2.0 * counted - 2.0  # levels of one
    most = noise.most(np.array([promised]), n_times)[0]
    for share in np.linspace(0.0, 1.0, 101):
        fall = 2.0 * promised * np.array([share, 1.0 - share])
        left = np.maximum(misfit - fall, 0.0)
        gained = noise.log_likelihood(left[None], n_times, VALUES) - noise.log_likelihood(misfit[None], n_times, VALUES)
        if np.all(fall < misfit):
            assert gained[0] <= most * (1.0 + 1e-9)
    assert most >= promised


def test_the_likelihood_of_filtered_noise_is_calibrated(record: Record) -> None:
    """At the truth the slopes scatter as the information says: their squared length has a chi-square's mean.

    Sixty draws of noise behind a filter at 0.4 of half the sampling rate; samples counted one by one would give 2.4
    times that mean.
    """
    model, rng = sdof_model(), np.random.default_rng(7)
    posterior = posterior_of(model, record)
    point = true_point(model, record)[None]
    values, _ = posterior.split(point)
    clean = posterior.engine.simulate(model, values, record).values[0, 0]
    sos = signal.butter(8, 0.4, output="sos")
    # One over the filter's equivalent noise bandwidth: the mean of its squared gain.
    as_one = 1.0 / float(np.mean(np.square(np.abs(signal.freqz_sos(sos, 4096)[1]))))
    lengths = []
    for _ in range(60):
        noise = signal.sosfilt(sos, rng.standard_normal(record.n_times + 500))[500:]
        noisy = record.with_channels({"acceleration_1": clean + 0.03 * np.std(clean) * noise / np.std(noise)})
        filtered = replace(default_noise(noisy), correlation_samples=as_one)
        local = replace(posterior, record=noisy, noise=filtered).linearise(point)
        lengths.append(local.gradient[0] @ np.linalg.solve(local.information[0], local.gradient[0]))
    error = np.sqrt(2.0 * model.space.n_dim / len(lengths))
    assert abs(np.mean(lengths) - model.space.n_dim) < 4.0 * error


@pytest.mark.parametrize("noise", NOISES, ids=["known", "integrated", "filtered", "sampled"])
def test_precision_is_the_slope_in_the_misfit(noise: Noise) -> None:
    precision = noise.precision(MISFIT, N_TIMES, VALUES)
    for channel in range(2):
        step = np.zeros(2)
        step[channel] = 1e-4 * MISFIT[0, channel]
        ahead, behind = (noise.log_likelihood(MISFIT + side * step, N_TIMES, VALUES) for side in (1, -1))
        np.testing.assert_allclose(precision[:, channel], -(ahead - behind) / step[channel], rtol=1e-6)


def test_drawn_noise_follows_the_inverse_gamma_posterior() -> None:
    """Mean and variance of the drawn variances within 4 standard errors, and the whole law by Kolmogorov-Smirnov."""
    n = 20_000
    misfit = np.tile(MISFIT[:1], (n, 1))
    drawn = INTEGRATED.draw_sd(np.random.default_rng(3), misfit, N_TIMES, np.empty((n, 0))) ** 2
    for channel in range(2):
        law = stats.invgamma(
            INTEGRATED.shape + 0.5 * N_TIMES, scale=INTEGRATED.scale[channel] + 0.5 * MISFIT[0, channel]
        )
        assert abs(drawn[:, channel].mean() - law.mean()) < 4.0 * law.std() / np.sqrt(n)
        error = np.sqrt((float(law.stats("k")) + 2.0) / n)
        assert abs(drawn[:, channel].var() / law.var() - 1.0) < 4.0 * error
        assert stats.kstest(drawn[:, channel], law.cdf).pvalue > 1e-4


def test_known_and_sampled_noise_draw_what_they_hold() -> None:
    rng = np.random.default_rng(4)
    np.testing.assert_array_equal(KNOWN.draw_sd(rng, MISFIT, N_TIMES, VALUES), np.tile(KNOWN.sd, (5, 1)))
    np.testing.assert_array_equal(SAMPLED.draw_sd(rng, MISFIT, N_TIMES, VALUES), VALUES)


def smooth_with_noise(sd: float) -> Record:
    """Two slow sines of an rms of about 3 m/s^2, and white noise."""
    times = 0.01 * np.arange(4000)
    clean = 4.0 * np.sin(2.0 * times) + np.cos(5.0 * times)
    measured = clean + sd * np.random.default_rng(8).standard_normal(len(times))
    return Record(name="slow", time_step=0.01, excitation=clean, channels={"acceleration_1": measured})


@pytest.mark.parametrize("sd", [0.001, 0.1])
def test_the_default_noise_prior_is_centred_on_the_noise_level_of_the_record(sd: float) -> None:
    """It used to be 3 % of the rms, here 0.09: at 60 dB that doubled the intervals of every parameter."""
    noise = default_noise(smooth_with_noise(sd))
    assert noise.shape == 1.0
    assert np.sqrt(noise.scale) == pytest.approx([sd], rel=0.2)
    assert f"{noise.scale[0]:.3g}" in noise.describe()
    assert noise.correlation_samples == 1.0
    assert "filter" not in noise.describe()
    assert "2.5 samples count as one" in FILTERED.describe()


def test_the_default_noise_prior_weighs_as_much_as_two_samples() -> None:
    """The level after n residuals of a level of their own is the mean square of those and of two more as expected."""
    noise, n, misfit = default_noise(smooth_with_noise(0.1)), 50, 50 * 0.3**2
    level = 1.0 / noise.precision(np.array([[misfit]]), n, np.empty((1, 0)))
    assert level == pytest.approx(np.array([[(misfit + 2.0 * noise.scale[0]) / (n + 2.0)]]))


def test_a_record_without_noise_is_given_what_no_solver_is_beyond() -> None:
    record = smooth_with_noise(0.0)
    rms = np.sqrt(np.mean(np.square(record.channels["acceleration_1"])))
    assert np.sqrt(default_noise(record).scale) == pytest.approx([1e-5 * rms])


def test_a_dead_channel_is_refused(record: Record) -> None:
    with pytest.raises(UserError, match=r"channel acceleration_1 of record .* is zero throughout"):
        default_noise(record.with_channels({"acceleration_1": np.zeros(record.n_times)}))


def test_log_likelihood_is_that_of_the_residuals(posterior: Posterior) -> None:
    """Engine, unit cube and noise together, against the response at the same values."""
    record = posterior.record
    known = replace(posterior, noise=KnownNoise(sd=(0.05,)))
    points = known.sample_prior(np.random.default_rng(5), 3)
    response = known.engine.simulate(known.model, known.space.from_unit(points), record).values[:, 0]
    expected = np.sum(stats.norm.logpdf(record.channels["acceleration_1"], response, 0.05), axis=1)
    np.testing.assert_allclose(known.log_likelihood(points), expected, rtol=1e-10)


def test_solves_are_counted_across_views(record: Record) -> None:
    posterior = posterior_of(sdof_model(), record)
    points = posterior.sample_prior(np.random.default_rng(6), 5)
    posterior.until(3.0).log_likelihood(points)
    posterior.linearise(points[:2])
    assert posterior.solves.total == 7


def test_a_failed_solve_has_no_likelihood_and_harms_no_other(record: Record) -> None:
    """A stiffness of 1e9 N/m makes the Runge-Kutta step unstable: its solution overflows."""
    model = sdof_model()
    stiff = model.with_values({"k": Uniform(20.0, 1e9)})
    posterior = posterior_of(stiff, record)
    points = np.tile(true_point(stiff, record), (3, 1))
    points[1, 0] = 0.999
    value, local = posterior.log_likelihood(points), posterior.linearise(points)
    assert value[1] == -np.inf
    assert local.log_likelihood[1] == -np.inf
    assert not np.any(local.gradient[1])
    assert not np.any(local.information[1])
    alone = posterior.log_likelihood(points[:1])[0]
    assert value[0] == value[2] == alone
    assert local.log_likelihood[0] == pytest.approx(alone, rel=1e-12)
    assert np.all(np.isfinite(local.gradient))


def curved_posterior(noise: Noise) -> Posterior:
    """Priors that are not uniform, so that the unit cube is a curved map of the values."""
    model = sdof_model()
    storey = BoucWen(
        k=LogNormal(40.0, 0.2),
        c=HalfNormal(0.5),
        alpha=Uniform(0.001, 0.3),
        beta=Uniform(1, 80),
        gamma=Uniform(-20, 60),
        n=Uniform(1, 3),
    )
    posterior = posterior_of(replace(model, links=(replace(model.links[0], element=storey),)), recorded(1), noise)
    # Coarse steps end where the state says, which the tangents do not follow: their error falls with the step.
    return posterior.with_engine(Lanes(substeps=32, resolution=0.03))


@pytest.mark.parametrize(
    "noise",
    [
        KnownNoise(sd=(0.05,)),
        IntegratedNoise(shape=1.0, scale=(0.002,)),
        SampledNoise(channels=("acceleration_1",), priors=(LogNormal(0.05, 1.0),)),
    ],
    ids=lambda noise: type(noise).__name__,
)
def test_slopes_against_finite_differences(noise: Noise) -> None:
    """Away from the optimum, where every component of the gradient is hundreds of nats per unit or more."""
    posterior = curved_posterior(noise)
    d = posterior.model.space.n_dim
    point = np.concatenate([true_point(sdof_model(), posterior.record), [0.6] * (posterior.n_dim - d)])
    point = 0.9 * point + 0.05
    local = posterior.linearise(point[None])
    assert local.log_likelihood[0] == pytest.approx(posterior.log_likelihood(point[None])[0], rel=1e-8)
    step = 1e-4
    both = np.concatenate([point + step * np.eye(posterior.n_dim), point - step * np.eye(posterior.n_dim)])
    ahead, behind = np.split(posterior.log_likelihood(both), 2)
    slope = (ahead - behind) / (2.0 * step)
    np.testing.assert_allclose(local.gradient[0], slope, rtol=2e-3, atol=2e-4 * np.max(np.abs(slope)))
    values, noise_values = posterior.split(both)
    response = posterior.engine.simulate(posterior.model, values, posterior.record).values[:, 0]
    jacobian = ((response[: posterior.n_dim] - response[posterior.n_dim :]) / (2.0 * step))[:d]
    weight = posterior.noise.precision(posterior.misfit(point[None]), posterior.record.n_times, noise_values[:1])[0, 0]
    expected = weight * jacobian @ jacobian.T
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(local.information[0, :d, :d] / scale, expected / scale, atol=5e-3)


def test_information_on_a_sampled_noise_scale_is_fishers() -> None:
    """2 N / sd^2 in its own unit; in unit coordinates times the squared slope of the prior's quantile."""
    prior = LogNormal(0.05, 1.0)
    posterior = curved_posterior(SampledNoise(channels=("acceleration_1",), priors=(prior,)))
    point = np.append(true_point(sdof_model(), posterior.record), 0.6)[None]
    sd, slope = prior.quantile(0.6), (prior.quantile(0.6001) - prior.quantile(0.5999)) / 2e-4
    expected = 2.0 * posterior.record.n_times / sd**2 * slope**2
    information = posterior.linearise(point).information[0]
    assert information[-1, -1] == pytest.approx(expected, rel=1e-5)
    assert not np.any(information[-1, :-1])
    assert posterior.space.names[-1] == "noise_sd[acceleration_1]"


class _Interrupted(np.ndarray):
    """Points in the midst of whose counting another thread takes over."""

    def __len__(self) -> int:
        time.sleep(0.05)
        return int(self.shape[0])


def test_no_solve_is_lost_between_threads() -> None:
    """``total += len(points)`` reads the total before it asks for the length: two threads counted 7 solves for 14."""
    posterior = posterior_of(sdof_model(), recorded(1))
    points = np.full((7, posterior.n_dim), 0.5).view(_Interrupted)
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(posterior.misfit, [points, points]))
    assert posterior.solves.total == 14
    assert pickle.loads(pickle.dumps(posterior.solves)).total == 14


def test_the_likelihood_is_that_of_the_samples_that_count() -> None:
    """Whatever was measured elsewhere; with shared functions it is the normal density of those samples alone."""
    model, record = sdof_model(), recorded(1)
    counted = np.arange(record.n_times) % 50 < 30
    changed = {name: np.where(counted, signal, 1e6) for name, signal in record.channels.items()}
    masked = replace(record, counted=counted)
    points = true_point(model, record)[None] * np.array([[1.0], [1.01]])
    noise = default_noise(masked)
    posterior = posterior_of(model, masked, noise)
    residual = record.measured - posterior.engine.simulate(model, posterior.split(points)[0], record).values
    expected = noise.log_likelihood(np.sum(residual[..., counted] ** 2, axis=2), int(np.sum(counted)), np.empty((2, 0)))
    np.testing.assert_allclose(posterior.log_likelihood(points), expected, rtol=1e-12)
    other = posterior_of(model, replace(record, counted=counted, channels=changed))
    assert other.noise == noise
    np.testing.assert_array_equal(other.log_likelihood(points), posterior.log_likelihood(points))
    for one, two in zip(
        vars(other.linearise(points)).values(), vars(posterior.linearise(points)).values(), strict=True
    ):
        np.testing.assert_array_equal(one, two)

    basis = np.cos(np.outer(np.arange(record.n_times), [0.01, 0.03, 0.1])) * counted[:, None]
    shared = replace(noise, correlation=Correlation(shared=SharedFunctions.of(basis).times(2.0)))
    covariance = np.eye(np.sum(counted)) + 4.0 * basis[counted] @ basis[counted].T
    for row, found in zip(residual[:, 0, counted], posterior.with_noise(shared).log_likelihood(points), strict=True):
        t = stats.multivariate_t(shape=noise.scale[0] / noise.shape * covariance, df=2.0 * noise.shape)
        assert found == pytest.approx(t.logpdf(row), rel=1e-9)
