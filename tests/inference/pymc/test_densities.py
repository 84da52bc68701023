"""Log likelihood and samples' log densities in PyTensor: sums, leave-one-out, slopes, and what a sampler is spared."""

from __future__ import annotations

from dataclasses import replace

import arviz as az
import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
import xarray as xr
from pymc_cases import ENGINE, NOISES, TRUTH, posterior_tree, small_model, small_posterior, small_record
from pytensor.graph.replace import vectorize_graph

from bwbn_bayes import Record, join_records, to_pymc
from bwbn_bayes.inference.correlation import Correlation, SharedFunctions
from bwbn_bayes.inference.least_squares import squares
from bwbn_bayes.inference.likelihood import IntegratedNoise, KnownNoise, Noise, Posterior, default_noise
from bwbn_bayes.inference.pymc.densities import noise_log_likelihood, sample_log_densities
from bwbn_bayes.inference.pymc.model import complete
from bwbn_bayes.inference.pymc.operators import ChannelResponse, SquaredResiduals
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.blocks import counts

NOTHING = np.zeros((1, 0))


def two_channels(n_times: int = 60) -> Record:
    """A record of two channels that nothing has to explain."""
    rows = np.random.default_rng(1).standard_normal((2, n_times)) * [[0.3], [2.0]]
    channels = {"acceleration_1": rows[0], "acceleration_2": rows[1]}
    return Record(name="two", time_step=0.02, excitation=np.ones(n_times), channels=channels)


def correlated(record: Record) -> dict[str, Noise]:
    """Noise of every kind that is integrated out."""
    white = IntegratedNoise(shape=1.5, scale=(0.2, 5.0))
    past = Correlation(coefficients=(np.array([0.6, -0.2]), np.empty(0)), log_prior=-3.0)
    basis = 0.3 * np.random.default_rng(2).standard_normal((2 * record.n_times, 4))
    shared = SharedFunctions.of(basis, np.array([0.3, 2.0]))
    return {
        "white": white,
        "filtered": replace(white, correlation_samples=2.5),
        "each filtered": replace(white, correlation_samples=(1.0, 3.0)),
        "autoregressive": replace(white, correlation=past),
        "beside a force": replace(white, correlation=Correlation(shared=shared, log_prior=-1.0)),
    }


def test_noise_twins_agree_with_the_noise_models() -> None:
    misfit, n_times = np.array([[3.0, 0.5]]), 400
    integrated = IntegratedNoise(shape=1.5, scale=(0.2, 0.7))
    filtered = IntegratedNoise(shape=1.5, scale=(0.2, 0.7), correlation_samples=2.5)
    known = KnownNoise(sd=(0.1, 0.4))
    for noise in (integrated, filtered, known):
        got = noise_log_likelihood(noise, misfit[0], n_times)
        assert float(got.eval()) == pytest.approx(noise.log_likelihood(misfit, n_times, NOTHING)[0], rel=1e-12)


@pytest.mark.parametrize("kind", correlated(two_channels()))
def test_samples_sum_to_the_log_likelihood(kind: str) -> None:
    record = two_channels()
    noise = correlated(record)[kind]
    got = sample_log_densities(noise, record, pt.constant(record.measured)).eval()
    misfit = squares(record, record.measured[None], noise.correlation)
    assert float(np.sum(got)) == pytest.approx(noise.log_likelihood(misfit, counts(record), NOTHING)[0], abs=1e-8)


def test_an_autoregression_is_told_from_the_past() -> None:
    """Against the joint normal density of the block, sample by sample, at a scale that its prior pins down."""
    record, sd = two_channels(30), np.array([0.3, 2.0])
    sure = 1e8
    noise = IntegratedNoise(shape=sure, scale=tuple(sure * sd**2))
    noise = replace(noise, correlation=Correlation(coefficients=(np.array([0.6]), np.empty(0))))
    got = sample_log_densities(noise, record, pt.constant(record.measured)).eval()
    expected = np.empty_like(got)
    past = np.column_stack([np.zeros(2), record.measured[:, :-1]]) * [[0.6], [0.0]]
    own_sd = np.tile(sd[:, None], 30)
    own_sd[0, 0] /= np.sqrt(1.0 - 0.6**2)  # stationary
    expected = -0.5 * ((record.measured - past) / own_sd) ** 2 - np.log(own_sd) - 0.5 * np.log(2.0 * np.pi)
    np.testing.assert_allclose(got, expected, atol=1e-4)


@pytest.mark.parametrize("kind", NOISES)
def test_pymc_finds_one_value_for_each_sample(kind: str) -> None:
    """It was one for the whole record, which ``az.loo`` took for its only observation."""
    model, record, noise = small_model(), small_record(), NOISES[kind]
    twin = to_pymc(model, record, noise=noise, engine=ENGINE)
    tree = posterior_tree(model.space, 5)
    columns = [tree["posterior"][name].values.ravel() for name in model.space.names]
    if kind == "sampled":
        sd = np.linspace(0.1, 0.3, 10)
        own = tree["posterior"].dataset.assign(noise_sd=(("chain", "draw", "channel"), sd.reshape(2, 5, 1)))
        tree = xr.DataTree.from_dict({"posterior": own})
        columns.append(sd)
    posterior = Posterior(model=model, record=record, engine=ENGINE, noise=noise)
    expected = posterior.log_likelihood(posterior.space.to_unit(np.stack(columns, axis=1)))
    pm.compute_log_likelihood(tree, model=twin, progressbar=False)
    pointwise = tree["log_likelihood"]["measured"]
    assert pointwise.dims == ("chain", "draw", "channel", "time")
    assert pointwise.shape == (2, 5, 1, record.n_times)
    np.testing.assert_array_equal(pointwise["time"], record.times)
    np.testing.assert_allclose(pointwise.sum(("channel", "time")).values.ravel(), expected, atol=1e-8)


def test_completed_densities_and_replicates_are_of_errors_with_a_past() -> None:
    """Densities as PyMC finds them; replicates hang together as the errors do. Both were those of white errors."""
    model, record, sd, past = small_model(), small_record(), 0.2, 0.8
    sure = 1e8
    noise = IntegratedNoise(shape=sure, scale=(sure * sd**2,))
    noise = replace(noise, correlation=Correlation(coefficients=(np.array([past]),)))
    twin = to_pymc(model, record, noise=noise, engine=ENGINE)
    tree = posterior_tree(model.space, 40)
    full = complete(tree, twin, rng=np.random.default_rng(3), most=80)
    pm.compute_log_likelihood(tree, model=twin, progressbar=False)
    found, expected = (one["log_likelihood"]["measured"].values for one in (full, tree))
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-3)
    values = np.stack([tree["posterior"][name].values.ravel() for name in model.space.names], axis=1)
    response = ENGINE.simulate(model, values, record).values[:, 0]
    errors = full["posterior_predictive"]["measured"].values.reshape(response.shape) - response
    assert np.mean(errors[:, 1:] * errors[:, :-1]) / np.mean(errors**2) == pytest.approx(past, abs=0.05)
    assert np.std(errors) == pytest.approx(sd / np.sqrt(1.0 - past**2), rel=0.1)


def test_samples_are_those_of_the_channels_as_replaced() -> None:
    model, first, second = small_model(), small_record(seed=1), small_record(seed=2)
    twin = to_pymc(model, first, engine=ENGINE)
    pm.set_data({"measured_data": second.measured}, model=twin)
    tree = posterior_tree(model.space, 2)
    pm.compute_log_likelihood(tree, model=twin, progressbar=False)
    columns = [tree["posterior"][name].values.ravel() for name in model.space.names]
    posterior = Posterior(model=model, record=second, engine=ENGINE, noise=default_noise(first))
    expected = posterior.log_likelihood(model.space.to_unit(np.stack(columns, axis=1)))
    got = tree["log_likelihood"]["measured"].sum(("channel", "time")).values.ravel()
    np.testing.assert_allclose(got, expected, atol=1e-8)


def test_a_pause_has_no_density_and_each_record_its_own() -> None:
    pause = Record(name="pause", time_step=0.02, excitation=np.zeros(20))
    pair = [replace(small_record(seed=seed, duration=4.0), name=f"run {seed}") for seed in (1, 2)]
    record = join_records([pair[0], pause, pair[1]], in_sequence=False)
    twin = to_pymc(small_model(), record, engine=ENGINE)
    one = {name: (("chain", "draw"), np.array([[value]])) for name, value in TRUTH.items()}
    tree = xr.DataTree.from_dict({"posterior": xr.Dataset(one, coords={"chain": [0], "draw": [0]})})
    pm.compute_log_likelihood(tree, model=twin, progressbar=False)
    got = tree["log_likelihood"]["measured"].values[0, 0, 0]
    assert not np.any(got[pair[0].n_times : pair[0].n_times + 20])
    point = small_model().space.to_unit(np.array([list(TRUTH.values())]))
    parts = got[: pair[0].n_times], got[pair[0].n_times + 20 :]
    for part, own in zip(pair, parts, strict=True):
        assert float(own.sum()) == pytest.approx(float(small_posterior(part).log_likelihood(point)[0]), abs=1e-8)


def test_leave_one_out_is_that_of_drawn_scales() -> None:
    """``az.loo`` of scales integrated out and of scales drawn back, which results have: the same, sample by sample.

    But for what the shares add, the log likelihood less the densities of each sample given the others, divided by their
    number. A sample's estimate from 1,200 drawn scales has standard error ``|w^2 - 1| / sqrt(2 n 1200)``, w its
    residual over the scale, and smoothing the largest weights moves it by as little.
    """
    model, record = small_model(), small_record()
    twin = to_pymc(model, record, engine=ENGINE)
    tree = posterior_tree(model.space, 600)
    drawn = az.loo(complete(tree, twin, rng=np.random.default_rng(3), most=1200), pointwise=True)
    integrated = az.loo(pm.compute_log_likelihood(tree, model=twin, progressbar=False), pointwise=True)
    assert integrated.n_data_points == record.n_times
    response = ENGINE.simulate(model, model.draws(TRUTH), record).values[0]
    squared = np.square(record.measured - response)[0]
    noise, n = default_noise(record), record.n_times
    whole = noise.log_likelihood(np.array([[np.sum(squared)]]), n, NOTHING)[0]
    others = noise.log_likelihood((np.sum(squared) - squared)[:, None], n - 1, NOTHING)
    shares = (whole - np.sum(whole - others)) / n
    error = (1.0 + squared / np.mean(squared)) / np.sqrt(2.0 * n * 1200)
    assert np.all(np.abs(integrated.elpd_i - drawn.elpd_i - shares)[0] < 4.0 * error)
    assert float(integrated.elpd - drawn.elpd) == pytest.approx(n * shares, abs=0.1)


def ops_of(function: object) -> set[type]:
    """Types of the operators of a compiled function."""
    return {type(node.op) for node in function.maker.fgraph.apply_nodes}  # type: ignore[attr-defined]


def test_a_sampler_solves_for_no_response() -> None:
    """Density, gradient and batch compile to the sums alone, also where the only channel's dimension is one."""
    twin = to_pymc(small_model(), small_record(), engine=ENGINE)
    assert SquaredResiduals in ops_of(twin.compile_logp().f)
    assert ChannelResponse not in ops_of(twin.compile_logp().f)
    assert ChannelResponse not in ops_of(twin.compile_dlogp().f)
    assert ChannelResponse not in ops_of(twin.logp_dlogp_function(ravel_inputs=True)._pytensor_function)
    batches = {value: pt.vector(value.name) for value in twin.value_vars}
    batched = pytensor.function([*batches.values()], vectorize_graph(twin.datalogp, batches))
    assert ChannelResponse not in ops_of(batched)
    start = twin.initial_point()
    assert batched(*[np.tile(start[name.name], 3) for name in batches]) == pytest.approx(
        np.full(3, float(twin.compile_logp(vars=twin.observed_RVs)(start))), rel=1e-12
    )


def test_single_samples_have_derivatives() -> None:
    """Whoever weighs them gets the slopes of his own sum, by central differences."""
    twin = to_pymc(small_model(), small_record(duration=3.0), engine=ENGINE)
    (pointwise,) = twin.logp(vars=twin.observed_RVs, sum=False)
    weights = np.random.default_rng(4).uniform(size=small_record(duration=3.0).measured.shape)
    values = twin.value_vars
    costs = [pt.sum(weights * pointwise), pt.sum(pointwise)]
    function = pytensor.function(values, [*costs, *(pt.grad(cost, values[0]) for cost in costs)])
    start = [twin.initial_point()[value.name] for value in values]
    step = 1e-5
    ends = [function(start[0] + side * step, *start[1:])[:2] for side in (1.0, -1.0)]
    differences: Floats = (np.array(ends[0]) - np.array(ends[1])) / (2.0 * step)
    np.testing.assert_allclose(function(*start)[2:], differences, rtol=5e-3)


def test_a_failed_solve_is_impossible_in_every_sample() -> None:
    record = two_channels(10)
    residual = record.measured.copy()
    residual[:] = np.nan
    noise = IntegratedNoise(shape=1.0, scale=(1.0, 1.0))
    assert np.all(np.isneginf(sample_log_densities(noise, record, pt.constant(residual)).eval()))
