"""The PyMC model of a structure: the package's own density, coordinates, several records, parts of other models."""

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

from bwbn_bayes import (
    HalfNormal,
    LogNormal,
    Normal,
    PerStorey,
    Record,
    ShearBuilding,
    Uniform,
    UserError,
    join_records,
    to_pymc,
)
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.inference.accuracy import Judge
from bwbn_bayes.inference.likelihood import (
    IntegratedNoise,
    Posterior,
    SampledNoise,
    default_noise,
)
from bwbn_bayes.inference.pymc.densities import noise_log_likelihood, sample_log_densities
from bwbn_bayes.inference.pymc.model import complete, draws_of, observations
from bwbn_bayes.inference.pymc.operators import ChannelResponse, SquaredResiduals
from bwbn_bayes.inference.pymc.priors import prior_twin
from bwbn_bayes.parameters import Floats, Prior


def log_density(twin: pm.Model, values: dict[str, float], parts: list[pm.Distribution] | None = None) -> float:
    """Log density of the model at values in their own units, without the Jacobian of PyMC's transforms."""
    point = {}
    for rv in twin.free_RVs:
        transform, variable = twin.rvs_to_transforms[rv], twin.rvs_to_values[rv]
        value = np.asarray(values[rv.name])
        point[variable.name] = value if transform is None else transform.forward(value, *rv.owner.inputs).eval()
    return float(twin.compile_logp(vars=parts, jacobian=False)(point))


@pytest.mark.parametrize("kind", NOISES)
def test_density_is_the_packages_own(kind: str) -> None:
    """Prior on an admissible region that cuts the box, and each kind of noise."""
    model, record = small_model(gamma=Uniform(-40, 20)), small_record()
    posterior = Posterior(model=model, record=record, engine=ENGINE, noise=NOISES[kind])
    twin = to_pymc(model, record, noise=NOISES[kind], engine=ENGINE)
    values = {"k": 41.0, "beta": 29.0, "gamma": -10.0, "delta_eta": 0.5}
    named = values | ({"noise_sd": np.array([0.3])} if kind == "sampled" else {})
    flat = [values[name] for name in model.space.names] + ([0.3] if kind == "sampled" else [])
    point = posterior.space.to_unit(np.array([flat]))
    prior = sum(float(p.prior.log_density(v)) for p, v in zip(posterior.space.parameters, flat, strict=True))
    expected = prior - model.space.log_admissible_mass + float(posterior.log_likelihood(point)[0])
    assert log_density(twin, named) == pytest.approx(expected, rel=1e-10)
    assert log_density(twin, named | {"gamma": -35.0}) == -np.inf


def test_what_does_not_belong_together_is_a_user_error() -> None:
    """When the model is built, not when it is first solved."""
    record, known = small_record(), {name: TRUTH[name] for name in TRUTH}
    with pytest.raises(UserError, match="identifies no parameter"):
        to_pymc(small_model(**known), record)
    second = record.with_channels({"acceleration_2": record.channels["acceleration_1"]})
    with pytest.raises(UserError, match="acceleration_2"):
        to_pymc(small_model(), second)
    with pytest.raises(UserError, match="2 scales for 1 channels"):
        to_pymc(small_model(), record, noise=IntegratedNoise(shape=1.0, scale=(0.1, 0.1)))


@pytest.mark.parametrize(
    "prior",
    [
        Uniform(1, 3),
        Normal(1.0, 2.0),
        HalfNormal(0.7),
        LogNormal(2.0, 0.4),
        Normal(1.0, 2.0).truncated(0.0, np.inf),
        LogNormal(2.0, 0.4).truncated(1.5, 2.5),
        HalfNormal(0.7).truncated(-np.inf, 0.9),
        Uniform(1, 3).truncated(2.0, 8.0),
    ],
    ids=str,
)
def test_prior_twins_have_the_same_density_and_normalisation(prior: Prior) -> None:
    with pm.Model() as twin:
        prior_twin("x", [prior])
    for share in (0.02, 0.5, 0.93):
        value = float(prior.quantile(share))
        # PyMC's truncation itself computes with a constant of single precision.
        assert log_density(twin, {"x": value}) == pytest.approx(float(prior.log_density(value)), abs=1e-7)


def test_a_vector_of_mixed_priors_is_stacked() -> None:
    with pm.Model(coords={"storey": [1, 2]}) as twin:
        prior_twin("k", [Uniform(1, 3), LogNormal(2.0, 0.1)], "storey")
    assert [rv.name for rv in twin.free_RVs] == ["k_1", "k_2"]
    assert twin.named_vars_to_dims["k"] == ("storey",)


def test_a_prior_without_a_twin_is_told() -> None:
    class Odd(Prior):
        def __str__(self) -> str:
            return "Odd()"

    with pm.Model(), pytest.raises(UserError, match=r"prior Odd\(\) has no PyMC twin"):
        prior_twin("x", [Odd()])


def two_storeys() -> tuple[ShearBuilding, Record]:
    """A model with a stiffness for each storey, and some record of its floors."""
    one = small_model()
    model = ShearBuilding(
        masses=[1.0, 1.0], storey=one.element.__class__(**{**one.element.values, "k": PerStorey(Uniform(20, 60))})
    )
    record = small_record()
    curve = record.channels["acceleration_1"]
    channels = {"acceleration_1": curve, "acceleration_2": 0.5 * curve}
    return model, Record(name="two", time_step=record.time_step, excitation=record.excitation, channels=channels)


def test_variables_have_names_and_coordinates() -> None:
    model, record = two_storeys()
    twin = to_pymc(model, record, engine=ENGINE)
    assert {rv.name for rv in twin.free_RVs} == {"k", "beta"}
    assert twin.named_vars_to_dims["k"] == ("storey",)
    assert twin.named_vars_to_dims["measured"] == ("channel", "time")
    assert twin.coords["storey"] == (1, 2)
    assert twin.coords["channel"] == ("acceleration_1", "acceleration_2")
    np.testing.assert_array_equal(twin.coords["time"], record.times)


def test_several_records_share_the_parameters() -> None:
    records = [small_record(seed=1), small_record(seed=2, duration=5.0)]
    model = small_model()
    twin = to_pymc(model, records, engine=ENGINE)
    point = model.space.to_unit(np.array([list(TRUTH.values())]))
    likelihoods = [float(small_posterior(record).log_likelihood(point)[0]) for record in records]
    assert log_density(twin, TRUTH, twin.observed_RVs) == pytest.approx(sum(likelihoods), rel=1e-10)
    assert list(observations(twin)) == ["measured_1", "measured_2"]


@pytest.mark.parametrize("in_sequence", [False, True], ids=["virgin", "in sequence"])
@pytest.mark.parametrize("kind", ["integrated", "sampled"])
def test_joined_records_have_the_packages_own_density_and_slopes(kind: str, in_sequence: bool) -> None:
    """Two records and a pause that measures nothing; each record has noise of its own level."""
    pause = Record(name="pause", time_step=0.02, excitation=np.zeros(20))
    pair = [replace(small_record(seed=seed, duration=4.0), name=f"run {seed}") for seed in (1, 2)]
    record = join_records([pair[0], pause, pair[1]], in_sequence=in_sequence)
    labels = tuple(block.label for block in record.blocks)
    sampled = SampledNoise(channels=labels, priors=(LogNormal(0.2, 0.5), LogNormal(0.3, 0.5)))
    noise = default_noise(record) if kind == "integrated" else sampled
    model = small_model()
    twin = to_pymc(model, record, noise=noise, engine=ENGINE)
    sd = [0.2, 0.4] if kind == "sampled" else []
    named = TRUTH | ({"noise_sd": np.array(sd)} if sd else {})
    posterior = Posterior(model=model, record=record, engine=ENGINE, noise=noise)
    point = posterior.space.to_unit(np.array([[*TRUTH.values(), *sd]]))
    expected = float(posterior.log_likelihood(point)[0])
    assert log_density(twin, named, twin.observed_RVs) == pytest.approx(expected, rel=1e-10)
    slope = twin.compile_dlogp(vars=[twin["k"]], jacobian=False)
    start = twin.initial_point()
    step, free = 1e-5, twin.rvs_to_values[twin["k"]].name
    density = twin.compile_logp(jacobian=False)
    ends = [density({**start, free: start[free] + side * step}) for side in (1.0, -1.0)]
    assert float(slope(start)[0]) == pytest.approx((ends[0] - ends[1]) / (2.0 * step), rel=5e-3)
    one = {
        name: (("chain", "draw", "level")[: 2 + np.ndim(value)], np.array(value)[None, None])
        for name, value in named.items()
    }
    tree = xr.DataTree.from_dict({"posterior": xr.Dataset(one, coords={"chain": [0], "draw": [0]})})
    done = complete(tree, twin, rng=np.random.default_rng(1))
    pointwise = done["log_likelihood"]["measured"].values
    if kind == "sampled":
        assert float(pointwise.sum()) == pytest.approx(expected, rel=1e-10)
    assert not np.any(pointwise[0, 0, 0, pair[0].n_times : pair[0].n_times + 20])


def test_it_is_a_part_of_another_model() -> None:
    """Two buildings, one prior on delta_eta: the density is that of the parts."""
    records = [small_record(seed=1), small_record(seed=2)]
    with pm.Model() as whole:
        typical = pm.HalfNormal("typical", 0.5)
        for name, record in zip(("north", "south"), records, strict=True):
            own = pm.LogNormal(f"delta_eta_{name}", pm.math.log(typical), 0.3)
            to_pymc(small_model(), record, engine=ENGINE, name=name, parameters={"delta_eta": own})
    free = {rv.name for rv in whole.free_RVs}
    assert free == {"typical", *(f"{n}::{p}" for n in ("north", "south") for p in ("k", "beta")),
                    "delta_eta_north", "delta_eta_south"}  # fmt: skip
    values = {"typical": 0.4, "delta_eta_north": 0.4, "delta_eta_south": 0.4}
    values |= {f"{name}::{p}": TRUTH[p] for name in ("north", "south") for p in ("k", "beta")}
    point = small_model().space.to_unit(np.array([list(TRUTH.values())]))
    expected = sum(float(small_posterior(record).log_likelihood(point)[0]) for record in records)
    assert log_density(whole, values, whole.observed_RVs) == pytest.approx(expected, rel=1e-10)


def test_a_wrong_call_is_told_in_one_sentence() -> None:
    model, record = small_model(), small_record()
    with pytest.raises(UserError, match="parameters kk: the model identifies k, beta, delta_eta"):
        to_pymc(model, record, engine=ENGINE, parameters={"kk": pm.math.constant(1.0)})
    with pytest.raises(UserError, match="2 noise models for 1 records"):
        to_pymc(model, record, engine=ENGINE, noise=[default_noise(record)] * 2)
    with pytest.raises(UserError, match="no record"):
        to_pymc(model, [], engine=ENGINE)


def test_pointwise_log_likelihood_and_predictions() -> None:
    model, record = small_model(), small_record()
    twin = to_pymc(model, record, engine=ENGINE)
    tree = posterior_tree(model.space, 600)
    full = complete(tree, twin, rng=np.random.default_rng(2), most=400)
    assert full["posterior"].sizes["draw"] == 200
    pointwise = full["log_likelihood"]["measured"]
    assert pointwise.dims == ("chain", "draw", "channel", "time")
    assert pointwise.shape == (2, 200, 1, record.n_times)
    loo = az.loo(full)
    # At the truth each point's density is that of noise of the record's own size; se from the points themselves.
    sd = float(np.std(record.channels["acceleration_1"] - noise_free(record)))
    expected = -record.n_times * (np.log(sd) + 0.5 * np.log(2.0 * np.pi) + 0.5)
    assert abs(float(loo.elpd) - expected) < 4.0 * float(loo.se)
    replicates = full["posterior_predictive"]["measured"].values
    units = {str(name): values.attrs["units"] for name, values in full["posterior"].data_vars.items()}
    assert units == {parameter.name: parameter.unit for parameter in model.space.parameters}
    assert full["posterior_predictive"]["measured"].attrs["units"] == "m/s^2"
    spread = float(np.std(replicates - noise_free(record)))
    assert spread == pytest.approx(sd, rel=0.1)


def test_the_scheme_is_the_one_of_identify() -> None:
    """At 60 dB the engine's default scheme moved this posterior by 0.87 standard deviations, and nobody was told."""
    record, model = small_record(snr_db=60.0), small_model()
    observation = observations(to_pymc(model, record))["measured"]
    assert observation.discretisation is not None
    assert observation.discretisation.acceptable
    posterior = replace(small_posterior(record), engine=observation.problem.engine)
    point = model.space.to_unit(np.array([list(TRUTH.values())]))[0]
    judge = Judge.at(posterior, point, Reference())
    assert judge(observation.problem.engine).joint_shift_sd < 0.5
    assert judge(Lanes()).joint_shift_sd > 0.5


def test_a_scheme_too_coarse_is_warned_of() -> None:
    record, model = small_record(snr_db=60.0), small_model()
    twin = to_pymc(model, record, engine=Lanes())
    with pytest.warns(UserWarning, match='leave the choice to to_pymc with engine="lanes"'):
        complete(posterior_tree(model.space, 20), twin, rng=np.random.default_rng(1))


def test_measured_channels_can_be_replaced() -> None:
    """``pm.set_data``: density, gradient and pointwise densities are those of the other record, same noise prior."""
    model, first, second = small_model(), small_record(seed=1), small_record(seed=2)
    noise = default_noise(first)
    twin = to_pymc(model, first, noise=noise, engine=ENGINE)
    fresh = to_pymc(model, second, noise=noise, engine=ENGINE)
    point = twin.initial_point()
    density, slope = twin.compile_logp(), twin.compile_dlogp()
    before = float(density(point))
    pm.set_data({"measured_data": second.measured}, model=twin)
    assert float(density(point)) == pytest.approx(float(fresh.compile_logp()(point)), rel=1e-12)
    np.testing.assert_allclose(slope(point), fresh.compile_dlogp()(point), rtol=1e-10)
    tree, seed = posterior_tree(model.space, 10), 3
    ours, theirs = (complete(tree, one, rng=np.random.default_rng(seed))["log_likelihood"] for one in (twin, fresh))
    np.testing.assert_allclose(ours["measured"], theirs["measured"], rtol=1e-12)
    pm.set_data({"measured_data": first.measured}, model=twin)
    assert float(density(point)) == before


def noise_free(record: Record) -> Floats:
    """The response at the truth."""
    model = small_model()
    return ENGINE.simulate(model, model.draws(TRUTH), record).values[0, 0]


def test_values_of_draws_run_chain_after_chain() -> None:
    model = small_model()
    twin = to_pymc(model, small_record(), engine=ENGINE)
    tree = posterior_tree(model.space, 5)
    got = draws_of(twin, tree, observations(twin)["measured"].values)
    assert np.array_equal(got[:, 0], tree["posterior"]["k"].values.ravel())


@pytest.mark.parametrize("kind", NOISES)
def test_prior_prediction_has_the_noise_of_the_prior(kind: str) -> None:
    model, record = small_model(), small_record()
    twin = to_pymc(model, record, noise=NOISES[kind], engine=ENGINE)
    tree = pm.sample_prior_predictive(40, model=twin, random_seed=3)
    draws = draws_of(
        twin, xr.DataTree.from_dict({"posterior": tree["prior"].dataset}), observations(twin)["measured"].values
    )
    response = ENGINE.simulate(model, draws, record).values
    sd = np.std(tree["prior_predictive"]["measured"].values[0] - response, axis=(1, 2))
    if kind == "known":
        np.testing.assert_allclose(sd, 0.2, rtol=4.0 / np.sqrt(2.0 * record.n_times))
    else:
        assert np.all(sd > 0.0)
        assert np.std(np.log(sd)) > 0.2


def test_an_unnamed_force_widens_the_posterior_of_a_twin() -> None:
    """Its log likelihood is the package's own, but for a constant, and its gradient that of central differences."""
    record = small_record()
    twin = to_pymc(small_model(), record, unnamed_force=True)
    observation = next(iter(observations(twin).values()))
    posterior = Posterior(
        model=small_model(), record=record, engine=observation.problem.engine, noise=observation.noise
    )
    points = np.full((3, posterior.n_dim), 0.5) + np.array([[0.0], [1e-3], [-1e-3]])
    values = pt.vector("values")
    sums = SquaredResiduals(observation.problem)(values, observation.problem.measured)
    log_likelihood = noise_log_likelihood(observation.noise, sums, record.n_times)
    residual = observation.problem.measured - ChannelResponse(observation.problem)(values)
    samples = pt.sum(sample_log_densities(observation.noise, record, residual))
    both = pytensor.function([values], [log_likelihood, pt.grad(log_likelihood, values)])
    # Not by numba, which warns of large constants that it cannot keep compiled code of.
    summed = pytensor.function([values], samples, mode=pytensor.compile.Mode(linker="py"))
    own = [both(one) for one in posterior.split(points)[0]]
    expected = posterior.log_likelihood(points)
    np.testing.assert_allclose([value for value, _ in own], expected, rtol=1e-8)
    np.testing.assert_allclose([summed(one) for one in posterior.split(points)[0]], expected, atol=1e-8)
    first, second = posterior.split(points)[0][1:]
    assert own[0][1] @ (first - second) == pytest.approx(expected[1] - expected[2], rel=1e-3)
