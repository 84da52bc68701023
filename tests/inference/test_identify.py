"""From a record to a result, end to end, on the one-storey building: the default run's comparison with the truth."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from inference_cases import climbed, posterior_of, recorded, sdof_model, true_point, with_free_a
from pymc_cases import TRUTH, small_model, small_record

from bwbn_bayes import (
    BoucWen,
    HalfNormal,
    InitialState,
    IntegratedNoise,
    KnownNoise,
    Linear,
    Normal,
    Oscillator,
    Record,
    Result,
    SampledNoise,
    Settings,
    ShearBuilding,
    Uniform,
    UserError,
    identify,
    simulate,
)
from bwbn_bayes.engines.base import require_usable
from bwbn_bayes.inference.finely import Solved, solve_finely
from bwbn_bayes.inference.identify import identify_from
from bwbn_bayes.inference.likelihood import Noise, Posterior
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.parameters import Floats
from bwbn_bayes.results import DOUBTS, StageFacts
from bwbn_bayes.structures.model_file import load_model_file

SEEDS = (1, 2, 3)


@pytest.fixture(scope="module")
def results(identified: Result) -> list[Result]:
    """Three data seeds, each by a run of its own seed."""
    others = [Settings(seed=seed, particles=2000) for seed in SEEDS[1:]]
    return [identified, *(identify(sdof_model(), recorded(s.seed), settings=s, name="sdof") for s in others)]


@pytest.fixture(scope="module")
def result(results: list[Result]) -> Result:
    return results[0]


def z_scores(results: list[Result]) -> Floats:
    return np.array([[p.z_score for p in result.facts.parameters] for result in results], dtype=np.float64)


def fisher(posterior: Posterior, mode: Mode) -> tuple[Floats, Floats]:
    """Standard deviations in the parameters' own units, and correlations, from the information at the mode."""
    covariance = np.linalg.inv(mode.information)
    sd = np.sqrt(np.diag(covariance))
    scale = posterior.space.unit_scale(posterior.space.from_unit(mode.point[None]))[0]
    return sd * scale, covariance / np.outer(sd, sd)


def test_posterior_means_against_the_truth(results: list[Result], posterior: Posterior, mode: Mode) -> None:
    """No parameter is off by 4 sds, and the mean square of all z is 1 within 4 standard errors.

    The z of one data set are correlated as the posterior is: the variance of their sum of squares is twice the sum of
    the squared correlations.
    """
    z = z_scores(results)
    assert np.all(np.abs(z) < 4.0)
    _, correlation = fisher(posterior, mode)
    standard_error = np.sqrt(2.0 * np.sum(correlation**2) / len(z)) / z.shape[1]
    assert abs(np.mean(z**2) - 1.0) < 4.0 * standard_error, (np.mean(z**2), standard_error)


def test_posterior_sds_are_fishers(results: list[Result]) -> None:
    for seed, result in zip(SEEDS, results, strict=True):
        posterior = posterior_of(sdof_model(), recorded(seed))
        sd, _ = fisher(posterior, climbed(posterior, true_point(sdof_model(), recorded(seed))))
        ratio = np.array([p.sd for p in result.facts.parameters]) / sd
        free = np.array([p.flag == "" for p in result.facts.parameters])
        assert np.count_nonzero(free) >= 6
        assert np.all(np.abs(ratio[free] - 1.0) < 0.25), ratio


def test_facts_of_a_good_run(result: Result, record: Record) -> None:
    facts = result.facts
    assert facts.method == "importance"
    assert [p.name for p in facts.parameters] == list(sdof_model().space.names)
    assert all(check.passed for check in facts.checks)
    assert facts.grade == "explains"
    assert "another mechanism may do so equally" in facts.verdict[0]
    assert {c.name for c in facts.checks} == {
        "residual level",
        "residual whiteness",
        "quiet residual",
        "within the prior",
        "alternatives",
        "Pareto k",
        "effective draws",
    }
    assert facts.effective_sample_size >= 0.98 * 2000
    assert 0.0 < facts.log_evidence_se < 0.1
    assert facts.evidences == {"importance": (facts.log_evidence, facts.log_evidence_se)}
    assert 0.0 < facts.discretisation["joint_shift_sd"] < 0.5
    assert facts.noise_sd["acceleration_1"] == pytest.approx(record.noise_sd["acceleration_1"], rel=0.1)
    # 30 dB leaves 10^(-30/20) of the rms.
    assert facts.nrmse["acceleration_1"] == pytest.approx(10.0**-1.5, rel=0.1)
    force = facts.restoring_force["1"]
    assert force["nrmse"] < 0.01
    assert min(force["correlation_time"], force["correlation_drift"]) > 0.9999
    assert facts.identifiability == ("The record sees every identified parameter.",)
    assert len(facts.verdict) == 2
    assert "8 of 8 parameters are identified" in facts.verdict[0]
    assert "passed all 7 of its checks" in facts.verdict[1]
    assert facts.provenance["data hash (SHA-256)"] == record.content_hash
    assert [stage.stage for stage in facts.stages] == list(range(facts.n_stages))
    assert facts.n_solves >= 2000


def test_every_promised_group_is_there(result: Result, record: Record) -> None:
    """As ``results.py`` lists them."""
    tree = result.tree
    n_times = record.n_times
    names = set(sdof_model().space.names)
    assert set(tree["posterior"].data_vars) == set(tree["prior"].data_vars) == names | {"noise_sd"}
    assert tree["posterior"]["k"].dims == ("chain", "draw")
    assert tree["sample_stats"]["lp"].dims == ("chain", "draw")
    assert tree["observed_data"]["measured"].sizes == {"channel": 1, "time": n_times}
    assert tree["constant_data"]["ground_acceleration"].sizes == {"time": n_times}
    assert tree["constant_data"]["measured_storey_force"].sizes == {"storey": 1, "time": n_times}
    assert tree["posterior_predictive"]["measured"].dims == ("chain", "draw", "channel", "time")
    for name in ("drift", "drift_rate", "restoring_force", "hysteretic_displacement", "hysteretic_energy"):
        assert tree["response"][name].dims == ("draw", "storey", "time")
        assert tree["true_response"][name].dims == ("storey", "time")
    assert tree["response"]["acceleration"].dims == ("draw", "floor", "time")
    assert names - set(tree["parameters_by_storey"].data_vars) == set()
    assert tree["parameters_by_storey"]["k"].dims == ("draw", "storey")
    for node in tree.subtree:
        for name, variable in node.data_vars.items():
            assert np.all(np.isfinite(variable)), (node.path, name)


def test_draws_and_facts_agree(result: Result) -> None:
    """Means of the equal-weight draws against the weighted means, within 4 standard errors of the resampling."""
    draws = result.tree["posterior"]
    size = draws.sizes["chain"] * draws.sizes["draw"]
    for parameter in result.facts.parameters:
        values = draws[parameter.name].values.ravel()
        assert abs(values.mean() - parameter.mean) < 4.0 * parameter.sd / np.sqrt(size)
        inside = np.mean((values >= parameter.hdi90[0]) & (values <= parameter.hdi90[1]))
        assert inside == pytest.approx(0.9, abs=0.01)


def test_predictive_bands_cover_the_measurement(result: Result) -> None:
    """Of 1,251 samples 89 % lie between the 5 % and 95 % quantiles of 100 draws, give or take 4 binomial errors."""
    measured = result.tree["observed_data"]["measured"].values[0]
    bands = result.tree["predictive_bands"]["acceleration_1"]
    low, high = (bands.sel(statistic=end).values for end in ("lower", "upper"))
    coverage = np.mean((measured >= low) & (measured <= high))
    assert abs(coverage - 0.89) < 4.0 * np.sqrt(0.09 / len(measured))


def test_a_result_saves_and_loads(result: Result, tmp_path: Path) -> None:
    result.save(tmp_path / "result.nc")
    loaded = Result.load(tmp_path / "result.nc")
    np.testing.assert_equal(asdict(loaded.facts), asdict(result.facts))  # equal where both are NaN
    assert loaded.tree.identical(result.tree)


def test_what_is_no_saved_result_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="does not exist: give the path of a saved"):
        Result.load(tmp_path / "result.nc")
    (tmp_path / "text.nc").write_text("no netCDF")
    xr.Dataset({"a": 1.0}).to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
    for name in ("text.nc", "other.nc"):
        with pytest.raises(UserError, match=f"{name} is no saved result"):
            Result.load(str(tmp_path / name))


def test_the_same_seed_repeats_and_another_agrees(result: Result) -> None:
    settings = Settings(seed=1, particles=2000)
    again = identify(sdof_model(), recorded(1), settings=settings, name="sdof")
    assert again.tree["posterior"].equals(result.tree["posterior"])
    assert again.facts.log_evidence == result.facts.log_evidence
    other = identify(sdof_model(), recorded(1), settings=replace(settings, seed=7), name="sdof")
    assert not np.any(np.isin(other.tree["posterior"]["k"], result.tree["posterior"]["k"]))
    require_agreement(other, result)


def require_agreement(first: Result, second: Result) -> None:
    """Means, sds and evidence within 4 Monte Carlo standard errors of each other."""
    size = 1.0 / (1.0 / first.facts.effective_sample_size + 1.0 / second.facts.effective_sample_size)
    for one, two in zip(first.facts.parameters, second.facts.parameters, strict=True):
        assert abs(one.mean - two.mean) < 4.0 * two.sd / np.sqrt(size), (one, two)
        assert abs(one.sd / two.sd - 1.0) < 4.0 / np.sqrt(2.0 * size), (one, two)
    error = np.hypot(first.facts.log_evidence_se, second.facts.log_evidence_se)
    assert abs(first.facts.log_evidence - second.facts.log_evidence) < 4.0 * error


@pytest.mark.parametrize("case", ["small", pytest.param("sdof", marks=pytest.mark.slow)])
def test_tmcmc_agrees_with_importance(case: str) -> None:
    """So does its second start, which knows nothing of the first; with three parameters, and with eight."""
    model, record = (small_model(), small_record()) if case == "small" else (sdof_model(), recorded(1))
    weighted = identify(model, record, settings=Settings(particles=2000))
    told: list[str] = []

    def listen(text: str, facts: StageFacts | None) -> None:
        told.append(facts.label if facts is not None else text)

    settings = Settings(method="tmcmc", particles=600)
    cloud = identify(model, record, settings=settings, listener=listen)
    assert cloud.facts.method == "tmcmc"
    assert set(cloud.facts.evidences) == {"tmcmc (bridge)", "tmcmc (second start)"}
    assert cloud.facts.evidences["tmcmc (bridge)"][0] == cloud.facts.log_evidence
    require_agreement(cloud, weighted)
    assert any("bridge" in text for text in told)
    assert any("second start" in text for text in told)
    assert all(check.passed for check in cloud.facts.checks), cloud.facts.checks


def test_from_known_optima_the_same_posterior(result: Result, posterior: Posterior, mode: Mode) -> None:
    """No search: from the optimum next to the truth, and from a worse point beside it that polishing takes there."""
    beside = np.clip(mode.point + 0.01, 1e-3, 1.0 - 1e-3)
    settings = Settings(seed=5, particles=2000)
    known = identify_from(posterior, np.stack([mode.point, beside]), settings=settings, name="sdof")
    require_agreement(known, result)
    assert known.facts.method == "importance"
    assert {check.name for check in result.facts.checks} - {check.name for check in known.facts.checks} == set(DOUBTS)
    assert all(check.passed for check in known.facts.checks)
    assert not np.any(np.isin(known.tree["posterior"]["k"], result.tree["posterior"]["k"]))


def test_a_missing_effect_is_not_silent(slip_record: Record) -> None:
    """The record slips, the model does not."""
    facts = identify(sdof_model(), slip_record, settings=Settings(particles=400)).facts
    failed = {check.name for check in facts.checks if not check.passed}
    assert {"residual level", "residual whiteness"} <= failed
    assert "does not explain the record" in facts.verdict[0]
    assert "passed all" not in facts.verdict[1]


def test_a_second_search_has_its_scheme_judged_at_the_best_of_both(
    slip_record: Record, mode: Mode, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A worse optimum has a larger noise level, by which a coarse scheme looks fine enough."""
    poor, judged = replace(mode, point=np.clip(mode.point + 0.1, 0.01, 0.99)), []
    found = iter([(mode,), *[(poor,)] * 10])
    monkeypatch.setattr("bwbn_bayes.inference.identify.find_modes", lambda *_, **__: next(found))

    def solved(posterior: Posterior, points: Floats) -> Solved:
        judged.append(posterior.log_likelihood(points))
        return solve_finely(posterior, points)

    monkeypatch.setattr("bwbn_bayes.inference.identify.solve_finely", solved)
    identify(sdof_model(), slip_record, settings=Settings(particles=200))
    assert len(judged) > 1
    assert all(np.argmax(values) == 0 for values in judged)


def test_a_redundant_scale_is_said_and_sampled(record: Record) -> None:
    """With A free the run lays a sheet; A's posterior is nearly its prior."""
    facts = identify(with_free_a(sdof_model()), record, settings=Settings(particles=1000)).facts
    assert len(facts.identifiability) == 1
    assert all(name in facts.identifiability[0] for name in ("k", "A", "alpha", "beta", "gamma"))
    flags = {p.name: p.flag for p in facts.parameters}
    assert flags["A"] == "unidentified"
    assert facts.effective_sample_size >= 0.98 * 1000
    assert "residual" not in " ".join(check.sentence for check in facts.checks if not check.passed)


def test_nothing_to_identify_is_a_user_error(record: Record) -> None:
    known = ShearBuilding(masses=[1.0], storey=BoucWen(k=40.0, beta=30.0, gamma=15.0))
    with pytest.raises(UserError, match="'known' identifies no parameter"):
        identify(known, record, name="known")


def test_a_record_without_channels_is_a_user_error(record: Record) -> None:
    with pytest.raises(UserError, match="measures nothing"):
        identify(sdof_model(), record.with_channels({}))


def test_a_channel_of_a_storey_that_is_not_there_is_a_user_error(record: Record) -> None:
    third = record.with_channels({"acceleration_3": record.channels["acceleration_1"]})
    with pytest.raises(UserError, match="acceleration_3"):
        identify(sdof_model(), third)


def test_an_unknown_engine_is_a_user_error(record: Record) -> None:
    with pytest.raises(UserError, match="nonsense"):
        identify(sdof_model(), record, settings=Settings(engine="nonsense"))


def test_a_dead_channel_is_a_user_error(record: Record) -> None:
    with pytest.raises(UserError, match="acceleration_1 never changes: leave it out"):
        identify(sdof_model(), record.with_channels({"acceleration_1": np.zeros(record.n_times)}))


def test_too_few_particles_are_a_user_error(record: Record) -> None:
    with pytest.raises(UserError, match="particles"):
        identify(sdof_model(), record, settings=Settings(method="tmcmc", particles=10))


def test_numpy_settings_can_be_saved() -> None:
    settings = Settings(seed=np.int64(3), particles=np.int32(200))  # type: ignore[arg-type]
    assert (type(settings.seed), type(settings.particles)) == (int, int)


def test_a_sensor_given_twice_is_a_user_error(record: Record) -> None:
    """Relative to the ground it says the same again; with noise of its own it is another sensor."""
    signal = record.channels["acceleration_1"]
    both = {"acceleration_1": signal, "relative_acceleration_1": signal - record.excitation}
    with pytest.raises(UserError, match="relative_acceleration_1 says the same as acceleration_1 less the ground's"):
        identify(sdof_model(), record.with_channels(both))
    noise = 1e-3 * np.random.default_rng(1).standard_normal(record.n_times)
    require_usable(sdof_model(), record.with_channels(both | {"acceleration_1": signal + noise}))
    double = {"drift_1": signal, "displacement_1": signal}
    with pytest.raises(UserError, match="drift_1 says the same as displacement_1 "):
        require_usable(sdof_model(), record.with_channels(double))


def test_a_released_structure_is_identified_without_excitation() -> None:
    """A free vibration was refused, though the model's initial state moves it."""
    spring = Linear(k=Uniform(20.0, 100.0), c=Uniform(0.0, 2.0))
    released = Oscillator(mass=2.0, spring=spring).with_effect(InitialState(u_0=Normal(0.0, 0.05)))
    still = Record(name="free", time_step=0.02, excitation=np.zeros(400))
    truth = {"k": 60.0, "c": 0.5, "u_0": 0.03}
    record = simulate(released, still, truth, channels=["displacement_1"], snr_db=30.0)
    found = identify(released, record, settings=Settings(particles=200, alternatives=False)).facts
    assert found.grade == "explains"
    for parameter in found.parameters:
        assert abs(parameter.mean - truth[parameter.name]) < 4.0 * parameter.sd
    with pytest.raises(UserError, match=r"'free' has no excitation.*a model with InitialState"):
        identify(Oscillator(mass=2.0, spring=spring), record)


@pytest.mark.parametrize(
    ("noise", "message"),
    [
        (KnownNoise(sd=(0.1, 0.1)), "2 scales for 1 channels"),
        (KnownNoise(sd=(0.0,)), "must be a positive number"),
        (IntegratedNoise(shape=0.0, scale=(1.0,)), "must be a positive number"),
        (IntegratedNoise(shape=1.0, scale=(1.0,), correlation_samples=0.5), "must be a number from 1 up"),
        (SampledNoise(channels=("acceleration_2",), priors=(HalfNormal(1.0),)), "acceleration_1, in this order"),
    ],
    ids=["too many", "zero", "no shape", "more than one each", "another channel"],
)
def test_noise_that_is_not_the_record_s_is_a_user_error(record: Record, noise: Noise, message: str) -> None:
    with pytest.raises(UserError, match=message):
        identify(sdof_model(), record, noise=noise)


@pytest.mark.parametrize("known", [("beta",), ("beta", "delta_eta")], ids=["two", "one"])
def test_tmcmc_of_one_or_two_parameters(known: tuple[str, ...]) -> None:
    """The evidence by importance sampling is the oracle; nothing is left for a ridge to bend."""
    model, record = small_model(**{name: TRUTH[name] for name in known}), small_record()
    found = {m: identify(model, record, settings=Settings(method=m, particles=200)) for m in ("importance", "tmcmc")}
    evidences = found["tmcmc"].facts.evidences
    bridged, error = evidences["tmcmc (bridge)"]
    assert abs(bridged - found["importance"].facts.log_evidence) < 4.0 * error + 0.1
    assert all(abs(p.z_score) < 4.0 for p in found["tmcmc"].facts.parameters if p.z_score is not None)


@pytest.mark.slow
def test_a_specimen_that_yields_in_small_strides_is_identified() -> None:
    """Its points lie three yield displacements apart and the law settles within a quarter of one.

    The scheme that the search began with could not solve the truth, and a posterior without it, 8 standard deviations
    from its n, passed all checks.
    """
    file = load_model_file(Path(__file__).parents[2] / "models" / "cyclic_test.py")
    assert file.excitation is not None
    truth = {"k": 8.54e7, "alpha": 0.415, "u_y": 1.29e-4, "rho": 1.46, "n": 4.25}
    record = simulate(file.model, file.excitation, truth, snr_db=30.0, seed=1)
    facts = identify(file.model, record, settings=Settings(particles=500)).facts
    assert all(check.passed for check in facts.checks)
    assert all(abs(p.mean - truth[p.name]) < 4.0 * p.sd for p in facts.parameters)
