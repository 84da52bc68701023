"""The road from a reference other than the prior."""

import numpy as np
import pytest
from evidence_oracles import EvidenceOracle, Floats, exponential, linear_gaussian, log_normal, two_gaussians
from scipy import special, stats

from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.tmcmc import DefensiveMixture, sample
from bwbn_bayes.inference.tmcmc.stages import CHECK


class GaussianOnCube:
    """Independent Gaussians about ``centre`` truncated to the unit cube."""

    def __init__(self, centre: Floats, sd: Floats) -> None:
        self.law = stats.truncnorm(-centre / sd, (1.0 - centre) / sd, loc=centre, scale=sd)
        self.centre, self.sd = centre, sd
        self.log_mass = np.log(special.ndtr((1.0 - centre) / sd) - special.ndtr(-centre / sd))
        self.n_dim = len(centre)

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        return np.asarray(self.law.rvs(size=(n, self.n_dim), random_state=rng))

    def log_density(self, points: Floats) -> Floats:
        return np.asarray(np.sum(log_normal(points, self.centre, self.sd) - self.log_mass, axis=1))


def bridged(
    oracle: EvidenceOracle,
    component: GaussianOnCube,
    share: float,
    seed: int,
    n_particles: int = 2000,
    guide: GaussianOnCube | None = None,
) -> tuple[float, float, Floats]:
    reference = DefensiveMixture(prior_share=share, target=oracle, component=component)
    at = None if guide is None else lambda _: guide
    result = sample(oracle, n_particles=n_particles, rng_seed=seed, reference=reference, guide=at)
    return result.log_evidence - oracle.log_evidence, result.log_evidence_se, oracle.values(result.particles)


@pytest.mark.parametrize("guided", [False, True])
@pytest.mark.parametrize("n_runs", [3, pytest.param(12, marks=pytest.mark.slow)])
def test_bridge_finds_the_mode_that_the_component_missed(n_runs: int, guided: bool) -> None:
    """The Laplace component, five times inflated, sits on the smaller mode only; 80 % of the mass is elsewhere.

    Nor is it lost to a guide that knows of the smaller mode alone.
    """
    oracle = two_gaussians(2, share=0.2)
    component = GaussianOnCube(np.full(2, 0.75), np.full(2, 5 * 0.025))
    guide = GaussianOnCube(np.full(2, 0.75), np.full(2, 0.025)) if guided else None
    outcomes = [bridged(oracle, component, 0.2, seed, 500, guide) for seed in range(n_runs)]
    errors, shares = [o[0] for o in outcomes], [float(np.mean(o[2][:, 0] > 0.0)) for o in outcomes]
    assert abs(np.mean(errors)) < 3.0 * max(np.std(errors, ddof=1), np.mean([o[1] for o in outcomes])) / n_runs**0.5
    assert abs(np.mean(shares) - 0.2) < 4.0 * np.std(shares, ddof=1) / n_runs**0.5


def test_without_the_prior_share_the_mode_is_lost() -> None:
    """The test above can fail: with a component that cannot reach, most of the evidence is missing."""
    oracle = two_gaussians(2, share=0.2)
    component = GaussianOnCube(np.full(2, 0.75), np.full(2, 2 * 0.025))
    result = sample(oracle, rng_seed=1, reference=component)
    assert result.log_evidence - oracle.log_evidence == pytest.approx(np.log(0.2), abs=0.2)


def test_bridge_over_an_asymmetric_posterior() -> None:
    """A Gaussian centred beside a one-sided posterior."""
    oracle = exponential(2, rate=500.0)
    component = GaussianOnCube(np.full(2, 0.003), np.full(2, 0.01))
    outcomes = [bridged(oracle, component, 0.1, seed, 1000) for seed in range(6)]
    errors, reported = [o[0] for o in outcomes], np.mean([o[1] for o in outcomes])
    assert abs(np.mean(errors)) < 3.0 * max(np.std(errors, ddof=1), reported) / np.sqrt(6)
    means = [float(o[2].mean()) for o in outcomes]
    assert oracle.posterior_mean is not None
    assert abs(np.mean(means) - oracle.posterior_mean[0]) < 4.0 * np.std(means, ddof=1) / np.sqrt(6)


def test_bridge_is_shorter_than_the_road_from_the_prior() -> None:
    oracle = linear_gaussian(4)
    assert oracle.posterior_mean is not None
    assert oracle.posterior_sd is not None
    centre = special.ndtr(oracle.posterior_mean)
    sd = 5.0 * oracle.posterior_sd * stats.norm.pdf(oracle.posterior_mean)
    reference = DefensiveMixture(prior_share=0.1, target=oracle, component=GaussianOnCube(centre, sd))
    short = sample(oracle, n_particles=1000, rng_seed=1, reference=reference)
    long = sample(oracle, n_particles=1000, rng_seed=1)
    assert short.n_solves < 0.5 * long.n_solves
    assert abs(short.log_evidence - oracle.log_evidence) < 4.0 * short.log_evidence_se


def test_a_guide_near_the_density_shortens_the_road() -> None:
    """In sixteen dimensions a mixture fitted to the cloud of a stage is a poorer proposal than what is known."""
    oracle = exponential(16, rate=500.0)
    component, near = (GaussianOnCube(np.zeros(16), np.full(16, sd)) for sd in (0.01, 0.003))
    reference = DefensiveMixture(prior_share=0.2, target=oracle, component=component)
    alone = sample(oracle, n_particles=300, rng_seed=1, reference=reference, lengths=CHECK)
    guided = sample(oracle, n_particles=300, rng_seed=1, reference=reference, guide=lambda _: near, lengths=CHECK)
    assert guided.n_solves < alone.n_solves
    for result in (alone, guided):
        assert abs(result.log_evidence - oracle.log_evidence) < 4.0 * result.log_evidence_se


def test_defensive_mixture_is_normalised() -> None:
    oracle = two_gaussians(2)
    mixture = DefensiveMixture(
        prior_share=0.3, target=oracle, component=GaussianOnCube(np.full(2, 0.4), np.full(2, 0.3))
    )
    axis = (np.arange(400) + 0.5) / 400
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    assert np.mean(np.exp(mixture.log_density(grid))) == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("share", [0.0, -0.1, 1.5])
def test_defensive_mixture_refuses_a_bad_share(share: float) -> None:
    oracle = two_gaussians(2)
    with pytest.raises(UserError, match="prior_share"):
        DefensiveMixture(prior_share=share, target=oracle, component=GaussianOnCube(np.full(2, 0.5), np.full(2, 0.1)))
