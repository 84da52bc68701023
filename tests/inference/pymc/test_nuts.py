"""Both implementations of NUTS against a density in closed form."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from bwbn_bayes.inference.pymc.nuts import Sampler, convergence, sample_nuts
from bwbn_bayes.parameters import Floats


@dataclass(frozen=True)
class Normal:
    """Independent normals, nothing beyond a bound of the last."""

    mean: Floats
    sd: Floats
    bound: float = np.inf
    asked: list[int] = field(default_factory=list)

    @property
    def n_dim(self) -> int:
        """Number of coordinates."""
        return len(self.mean)

    def log_density(self, x: Floats) -> tuple[float, Floats]:
        """Minus infinity and no gradient beyond the bound."""
        self.asked.append(1)
        if x[-1] > self.bound:
            return -np.inf, np.zeros_like(x)
        standard = (x - self.mean) / self.sd
        return -0.5 * float(standard @ standard), -standard / self.sd


@pytest.mark.parametrize("sampler", ["pymc", "nutpie"])
def test_moments_are_those_of_the_density(sampler: Sampler) -> None:
    density = Normal(np.array([0.3, -0.5, 0.0]), np.array([0.8, 1.3, 1.0]))
    run = sample_nuts(density, sampler=sampler, draws=400, tune=100, chains=2, seed=1)
    assert run.coordinates.shape == (2, 400, 3)
    assert run.n_divergences == 0
    assert run.n_solves == len(density.asked) >= 1000  # of 1,530 asked 306 were counted: those after warm-up
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
