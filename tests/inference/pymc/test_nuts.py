"""Both implementations of NUTS against a density in closed form."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pymc as pm
import pytest
from pymc.step_methods.hmc.quadpotential import QuadPotentialDiag
from pymc_cases import small_mode, small_posterior, still_running, within_time
from pytensor.compile.mode import Mode

from bwbn_bayes.inference.pymc.coordinates import NormalCoordinates
from bwbn_bayes.inference.pymc.lockstep import in_lockstep
from bwbn_bayes.inference.pymc.nuts import Chain, LogDensity, Sampler, convergence, sample_nuts
from bwbn_bayes.parameters import Floats


@dataclass(frozen=True)
class Normal:
    """Independent normals, nothing beyond a bound of the last."""

    mean: Floats
    sd: Floats
    bound: float = np.inf
    fails_at: int = 10**9
    asked: list[int] = field(default_factory=list)

    @property
    def n_dim(self) -> int:
        """Number of coordinates."""
        return len(self.mean)

    def log_density(self, x: Floats) -> tuple[Floats, Floats]:
        """Minus infinity and no gradient beyond the bound."""
        self.asked.append(len(x))
        if len(self.asked) == self.fails_at:
            raise ArithmeticError("cannot be evaluated")
        standard = (x - self.mean) / self.sd
        beyond = x[:, -1] > self.bound
        value = np.where(beyond, -np.inf, -0.5 * np.sum(np.square(standard), axis=1))
        return value, np.where(beyond[:, None], 0.0, -standard / self.sd)


@pytest.mark.parametrize("sampler", ["pymc", "nutpie"])
def test_moments_are_those_of_the_density(sampler: Sampler) -> None:
    density = Normal(np.array([0.3, -0.5, 0.0]), np.array([0.8, 1.3, 1.0]))
    run = sample_nuts(density, sampler=sampler, draws=400, tune=100, chains=2, seed=1)
    assert run.coordinates.shape == (2, 400, 3)
    assert run.n_divergences == 0
    assert run.n_solves == sum(density.asked) >= 1000  # of 1,530 asked 306 were counted: those after warm-up
    r_hat, size = convergence(run.coordinates, ("a", "b", "c"))
    assert r_hat < 1.02
    assert np.all(np.abs(run.coordinates.mean(axis=(0, 1)) - density.mean) < 4.0 * density.sd / np.sqrt(size))
    # The log of an sd from n draws has standard error 1 / sqrt(2 n).
    assert np.all(np.abs(np.log(run.coordinates.std(axis=(0, 1)) / density.sd)) < 4.0 / np.sqrt(2.0 * size))


@pytest.mark.parametrize("sampler", ["pymc", "nutpie"])
def test_a_seed_gives_the_same_draws_and_none_beyond_a_bound(sampler: Sampler) -> None:
    """Paths that leave where the density is diverge; the draws stay inside."""
    density = Normal(np.zeros(2), np.ones(2), bound=1.5)
    runs = [sample_nuts(density, sampler=sampler, draws=60, tune=60, chains=2, seed=3) for _ in range(2)]
    np.testing.assert_array_equal(runs[0].coordinates, runs[1].coordinates)
    assert np.max(runs[0].coordinates[..., -1]) <= 1.5
    assert not np.array_equal(runs[0].coordinates[0], runs[0].coordinates[1])


def test_the_draws_are_those_of_pymc_sampling_one_chain_after_another() -> None:
    """The same starts and streams; PyMC draws a number from each stream before it samples."""
    density = Normal(np.array([0.3, -0.5, 0.0]), np.array([0.8, 1.3, 1.0]), bound=2.0)
    starts = np.random.default_rng(1).standard_normal((3, 3))
    starts[:, -1] = -1.0

    def at_one(x: Floats) -> tuple[float, Floats]:
        value, gradient = density.log_density(x[None])
        return float(value[0]), gradient[0]

    interpreted = {"mode": Mode(linker="py", optimizer="fast_compile")}
    with pm.Model():
        pm.Potential("density", LogDensity(at_one)(pm.Flat("x", shape=3))[0])
        metric = QuadPotentialDiag(np.ones(3))
        step = pm.NUTS(potential=metric, target_accept=0.8, step_scale=3**0.25, compile_kwargs=interpreted)
        tree = pm.sample(
            draws=60,
            tune=40,
            chains=3,
            cores=1,
            step=step,
            initvals=[{"x": start} for start in starts],
            random_seed=7,
            progressbar=False,
            quiet=True,
            compute_convergence_checks=False,
            compile_kwargs=interpreted,
        )
    streams = np.random.default_rng(7).spawn(3)
    for stream in streams:
        stream.integers(2**30)
    each = [Chain(*own, draws=60, tune=40) for own in zip(starts, streams, strict=True)]
    draws, n_divergences = zip(*in_lockstep([chain.sample for chain in each], density.log_density), strict=True)
    np.testing.assert_array_equal(draws, tree["posterior"]["x"].values)
    np.testing.assert_array_equal(n_divergences, tree["sample_stats"]["diverging"].sum("draw").values)


def test_what_chains_ask_for_is_asked_together_and_none_knows_of_the_others() -> None:
    """Paths of one to seven gradients: chains end one after another, and the rest go on."""
    densities = [Normal(np.zeros(2), np.array([1.0, 3.0]), bound=1.5) for _ in range(2)]
    four, one = (
        within_time(lambda d=d, n=n: sample_nuts(d, draws=50, tune=30, chains=n, seed=4))
        for d, n in zip(densities, (4, 1), strict=True)
    )
    widths = densities[0].asked
    assert widths == sorted(widths, reverse=True)
    assert (widths[0], widths[-1]) == (4, 1)
    assert four.n_solves == sum(widths)
    assert one.n_solves == len(densities[1].asked)
    np.testing.assert_array_equal(four.coordinates[0], one.coordinates[0])


def test_draws_of_a_structure_do_not_depend_on_the_chains_beside_them() -> None:
    posterior = small_posterior()
    density = NormalCoordinates.at(posterior, small_mode(posterior).point)
    four, again, one = (
        within_time(lambda n=n: sample_nuts(density, draws=15, tune=10, chains=n, seed=2)) for n in (4, 4, 1)
    )
    np.testing.assert_array_equal(four.coordinates, again.coordinates)
    np.testing.assert_array_equal(four.coordinates[0], one.coordinates[0])
    assert four.n_solves == again.n_solves > 2 * one.n_solves


@pytest.mark.parametrize("at", [1, 100])
def test_an_error_in_the_density_ends_all_chains(at: int) -> None:
    with pytest.raises(ArithmeticError, match=r"^cannot be evaluated$"):
        within_time(lambda: sample_nuts(Normal(np.zeros(2), np.ones(2), fails_at=at), chains=3, seed=1))
    assert not still_running()


@pytest.mark.filterwarnings("ignore:Numba will use object mode")  # PyMC asks once more, to say what is not finite
def test_a_chain_that_cannot_begin_ends_all() -> None:
    """PyMC raises in that chain, and the others would wait for it."""
    density = Normal(np.zeros(2), np.ones(2), bound=-20.0)
    with pytest.raises(pm.exceptions.SamplingError, match="Bad initial energy"):
        within_time(lambda: sample_nuts(density, chains=3, seed=1))
    assert not still_running()
