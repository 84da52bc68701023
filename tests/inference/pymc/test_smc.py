"""PyMC's SMC with the batched kernel: exact evidences, statistics that any number of chains can save."""

from __future__ import annotations

import timeit
from pathlib import Path

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import pytest
import xarray as xr
from evidence_oracles import EvidenceOracle, linear_gaussian
from pymc_cases import ENGINE, small_model, small_record

from bwbn_bayes import to_pymc
from bwbn_bayes.inference.pymc.smc import Batched, KernelName, sample_smc, tidy


def twin_of(oracle: EvidenceOracle) -> pm.Model:
    """The linear-Gaussian oracle, standard normal prior, as a PyMC model.

    Its log likelihood is a quadratic, read off the oracle itself: value at zero, gradient and curvature.
    """
    d = oracle.n_dim
    at = oracle.log_likelihood_of_values
    unit = np.eye(d)
    zero = at(np.zeros((1, d)))[0]
    pairs = at((unit[:, None] + unit[None]).reshape(-1, d)).reshape(d, d)
    single = at(unit)
    curvature = pairs - single[:, None] - single[None] + zero
    gradient = single - zero - 0.5 * np.diag(curvature)
    with pm.Model() as twin:
        theta = pm.Normal("theta", np.zeros(d), 1.0, shape=d)
        pm.Potential("likelihood", zero + pt.dot(theta, gradient) + 0.5 * pt.sum(theta * pt.dot(curvature, theta)))
    return twin


def require_evidence(oracle: EvidenceOracle, draws: int, chains: int, seed: int) -> None:
    """Evidence within four standard errors and 0.3 nat, moments within their Monte Carlo errors."""
    run = sample_smc(twin_of(oracle), draws=draws, chains=chains, seed=seed)
    error = run.log_evidence - oracle.log_evidence
    assert abs(error) < 0.3, (error, run.log_evidences)
    assert abs(error) < 4.0 * run.log_evidence_se + 0.05, (error, run.log_evidence_se)
    assert oracle.posterior_mean is not None
    assert oracle.posterior_sd is not None
    theta = run.tree["posterior"]["theta"].values.reshape(-1, oracle.n_dim)
    # Resampled particles are worth at least a fifth of their number.
    z = (theta.mean(axis=0) - oracle.posterior_mean) / oracle.posterior_sd * np.sqrt(0.2 * len(theta))
    assert np.all(np.abs(z) < 4.0), z
    assert np.all(np.abs(np.log(theta.std(axis=0) / oracle.posterior_sd)) < 4.0 / np.sqrt(0.4 * len(theta)))


def test_evidence_of_a_linear_gaussian() -> None:
    require_evidence(linear_gaussian(5, 200), draws=800, chains=3, seed=1)


@pytest.mark.slow
@pytest.mark.parametrize("n_dim", [12, 20])
def test_evidence_of_a_long_record(n_dim: int) -> None:
    """Where kernels with an absolute tolerance were seen off by 44 and 45,173 nats."""
    require_evidence(linear_gaussian(n_dim, 9000), draws=2000, chains=4, seed=1)


def small_twin() -> pm.Model:
    """A model on which every kernel ends at once."""
    with pm.Model() as twin:
        x = pm.Normal("x")
        pm.Potential("likelihood", -0.5 * (x - 1.0) ** 2)
    return twin


@pytest.mark.parametrize("chains", [1, 2, 3])
@pytest.mark.parametrize("kernel", ["batched", "imh", "mh"])
def test_any_number_of_chains_can_be_saved(tmp_path: Path, chains: int, kernel: KernelName) -> None:
    run = sample_smc(small_twin(), draws=60, chains=chains, seed=2, kernel=kernel)
    statistics = run.tree["sample_stats"].dataset
    assert statistics["beta"].dims == ("chain", "stage")
    assert statistics.sizes["chain"] == chains
    assert np.all(statistics["beta"].max("stage") == 1.0)
    assert len(run.log_evidences) == chains
    assert np.isfinite(run.log_evidence_se) == (chains > 1)
    run.tree.to_netcdf(tmp_path / "run.nc", engine="h5netcdf")
    again = xr.open_datatree(tmp_path / "run.nc", engine="h5netcdf")
    assert again["posterior"]["x"].shape == (chains, 60)
    np.testing.assert_array_equal(again["sample_stats"]["beta"], statistics["beta"])
    assert np.isfinite(run.effective_sample_size) == (kernel == "batched")


def test_chains_of_unequal_length_are_padded() -> None:
    """PyMC keeps ragged statistics as objects, which netCDF refuses."""
    ragged = np.empty(2, dtype=object)
    ragged[:] = [[0.1, 1.0], [0.1, 0.4, 1.0]]
    evidence = np.empty(2, dtype=object)
    evidence[:] = [[np.nan, -3.0], [np.nan, np.nan, -3.5]]
    tree = xr.DataTree.from_dict(
        {
            "posterior": xr.Dataset({"x": (("chain", "draw"), np.zeros((2, 4)))}, coords={"chain": [0, 1]}),
            "sample_stats": xr.Dataset({"beta": ("chain", ragged), "log_marginal_likelihood": ("chain", evidence)}),
        }
    )
    run = tidy(tree)
    np.testing.assert_array_equal(run.tree["sample_stats"]["beta"], [[0.1, 1.0, np.nan], [0.1, 0.4, 1.0]])
    np.testing.assert_array_equal(run.log_evidences, [-3.0, -3.5])
    assert run.log_evidence == pytest.approx(np.log(0.5 * (np.exp(-3.0) + np.exp(-3.5))))


def test_a_run_is_a_function_of_its_seed() -> None:
    twin = to_pymc(small_model(), small_record().until(3.0), engine=ENGINE)
    runs = [sample_smc(twin, draws=80, chains=1, seed=seed) for seed in (4, 4, 5)]
    k = [run.tree["posterior"]["k"].values for run in runs]
    assert np.array_equal(k[0], k[1])
    assert not np.array_equal(k[0], k[2])


@pytest.mark.slow
def test_batching_is_ten_times_faster_than_one_by_one() -> None:
    """Solves per second of the kernels, so that their different numbers of moves do not enter; one thread."""
    twin = to_pymc(small_model(), small_record(), engine=ENGINE)
    kernel = Batched(draws=1000, model=twin, random_seed=1)
    points = np.random.default_rng(1).normal(scale=0.5, size=(1000, 3))
    kernel.density(points)
    batched = min(timeit.repeat(lambda: kernel.density(points), number=1, repeat=3))
    one = timeit.timeit(lambda: [kernel.likelihood_logp_func(p) + kernel.prior_logp_func(p) for p in points], number=1)
    likelihood = np.array([kernel.likelihood_logp_func(p) for p in points[:50]])
    np.testing.assert_allclose(kernel.density(points)[1][:50], likelihood, rtol=1e-9)
    print(f"one by one {one:.3f} s, batched {batched:.3f} s")
    assert one > 10.0 * batched, (one, batched)
