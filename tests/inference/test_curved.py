"""A proposal that follows bends: against a density that is bent just so, and on a building with one sensor."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.stats import ortho_group

from bwbn_bayes import BoucWen, PerStorey, Settings, ShearBuilding, Uniform, el_centro, identify, simulate
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.curved import Curved, curved_mixture, gradients_at
from bwbn_bayes.inference.importance import Proposal, effective_draws, laplace_mixture, log_targets
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import Mode, find_modes
from bwbn_bayes.parameters import Floats

N_WIDE, N_DIM = 3, 7
SDS = np.array([0.015, 0.012, 0.01, 0.002, 0.001, 0.0005, 0.0003])
TURNED = ortho_group.rvs(N_DIM, random_state=np.random.default_rng(1))
CENTRE = np.full(N_DIM, 0.5)
BEND = np.random.default_rng(2).uniform(3.0, 9.0, (N_WIDE, N_WIDE, N_DIM - N_WIDE))
"""Standard deviations by which the later directions follow the product of any two of the first."""


def residuals(points: Floats) -> Floats:
    """Standard normal under the density: the bent one is normal in them."""
    standard = (points - CENTRE) @ TURNED / SDS
    wide = standard[:, :N_WIDE]
    standard[:, N_WIDE:] -= np.einsum("ni,nj,ijk->nk", wide, wide, BEND)
    return np.asarray(standard)


def log_truth(points: Floats) -> Floats:
    """Normalised: a shear of a rotated normal."""
    squared = np.sum(np.square(residuals(points)), axis=1)
    return np.asarray(-0.5 * squared - 0.5 * N_DIM * np.log(2.0 * np.pi) - np.sum(np.log(SDS)))


def mode_at(point: Floats = CENTRE) -> Mode:
    """With the information that the residuals' slopes have in the centre, and no gradient."""
    return Mode(
        point=point,
        log_likelihood=float(log_truth(point[None])[0]),
        gradient=np.zeros(N_DIM),
        information=(TURNED / SDS**2) @ TURNED.T,
    )


def gradients(points: Floats) -> Floats:
    """By the slopes in the centre."""
    return np.asarray(-residuals(points) / SDS @ TURNED.T)


def curved() -> Curved:
    found = Curved.at(mode_at(), gradients)
    assert found is not None
    return found


def test_a_bent_normal_is_found_exactly() -> None:
    """No draw of Laplace's mixture is near it in seven dimensions."""
    points = curved().sample(np.random.default_rng(3), 500)
    np.testing.assert_allclose(curved().log_density(points), log_truth(points), atol=1e-6)
    straight = laplace_mixture([mode_at()])
    draws = straight.sample(np.random.default_rng(4), 2000)
    assert effective_draws(log_truth(draws) - straight.log_density(draws)) < 100


@pytest.mark.parametrize(("variance", "degrees"), [(1.3, np.inf), (1.6, 8.0)])
def test_a_wider_one_is_normalised(variance: float, degrees: float) -> None:
    """The mean of the true density over its own, under its draws, is one."""
    wider = curved().inflated(variance, degrees)
    points = wider.sample(np.random.default_rng(5), 40_000)
    ratio = np.exp(log_truth(points) - wider.log_density(points))
    assert abs(np.mean(ratio) - 1.0) < 4.0 * np.std(ratio) / np.sqrt(len(ratio))
    assert np.std(ratio) < 3.0


def test_a_stop_short_of_the_optimum_is_made_up_for() -> None:
    """A search that ended half a standard deviation off, in the directions that are known well."""
    off = CENTRE + TURNED[:, N_WIDE:] @ (0.5 * SDS[N_WIDE:])
    found = Curved.at(mode_at(off), gradients)
    assert found is not None
    np.testing.assert_allclose(found.point, CENTRE, atol=1e-9)


def test_what_lies_on_the_surface_is_no_mode_of_its_own() -> None:
    """Search ends at many points of one bent valley; two standard deviations on it needs no further component."""
    standard = np.zeros((1, N_DIM))
    standard[0, 0] = 2.0
    standard[0, N_WIDE:] = 4.0 * BEND[0, 0]
    on = CENTRE + (standard * SDS)[0] @ TURNED.T
    straight = CENTRE + 2.0 * SDS[0] * TURNED[:, 0]
    assert curved().foresees(mode_at(on), mode_at())
    as_good = Mode(
        point=straight,
        log_likelihood=mode_at().log_likelihood,
        gradient=np.zeros(N_DIM),
        information=mode_at().information,
    )
    assert not curved().foresees(as_good, mode_at())


def test_there_is_none_where_nothing_can_be_solved() -> None:
    assert Curved.at(mode_at(), lambda points: np.full(points.shape, np.nan)) is None


@cache
def tall() -> tuple[Posterior, tuple[Mode, ...]]:
    """Ten storeys, of which the roof alone is measured."""
    storey = BoucWen(k=PerStorey(Uniform(1000, 9000)), c=5.0, alpha=0.1, A=1.0, beta=30.0, gamma=5.0, n=1.2)
    model = ShearBuilding(masses=[1.0] * 10, storey=storey)
    truth = {f"k[{i}]": 4000.0 - 150.0 * i for i in range(1, 11)}
    record = simulate(model, el_centro("chopra", duration=12.0), truth, channels=["acceleration_10"], snr_db=30.0)
    engine = Lanes(substeps=2, resolution=0.5, n_threads=1)
    posterior = Posterior(model=model, record=record, engine=engine, noise=default_noise(record))
    return posterior, find_modes(posterior, np.random.default_rng(1), n_starts=512)


def efficiency(proposal: Proposal, posterior: Posterior) -> float:
    points = proposal.sample(np.random.default_rng(6), 800)
    return effective_draws(log_targets(posterior, points)[1] - proposal.log_density(points)) / len(points)


def test_gradients_are_those_of_the_likelihood_at_the_mode() -> None:
    posterior, (best, *_) = tall()
    near = best.point + 1e-5
    expected = posterior.linearise(near[None]).gradient[0]
    found = gradients_at(posterior, near)(np.tile(near, (20, 1)))
    np.testing.assert_allclose(found, np.tile(expected, (20, 1)), rtol=1e-3, atol=1e-3 * np.max(np.abs(expected)))


def test_a_building_with_one_sensor_is_followed() -> None:
    """Search ended at many points of its valley; a few components cover all of them."""
    posterior, modes = tall()
    mixture = curved_mixture(posterior, modes)
    assert mixture is not None
    assert len(mixture.components) < len(modes)
    assert efficiency(mixture, posterior) > 10.0 * efficiency(laplace_mixture(modes), posterior)


def test_many_storeys_that_are_known_well_need_no_sheet() -> None:
    """With a sensor on each of sixteen floors no stiffness is wide, yet few draws of the mixture at the mode count."""
    storey = BoucWen(k=PerStorey(Uniform(2000, 20000)), c=8.0, alpha=0.1, A=1.0, beta=60.0, gamma=5.0, n=1.2)
    model = ShearBuilding(masses=[1.0] * 16, storey=storey)
    truth = {f"k[{i}]": 9000.0 - 250.0 * i for i in range(1, 17)}
    record = simulate(model, el_centro("chopra", duration=8.0), truth, snr_db=30.0, seed=2)
    told: list[str] = []
    settings = Settings(particles=200, alternatives=False)
    result = identify(model, record, settings=settings, listener=lambda text, _: told.append(text))
    assert "the posterior is bent in many directions: following them" in told
    assert all(check.passed for check in result.facts.checks), result.facts.checks
    assert result.facts.method == "importance"
    z = [(one.mean - truth[one.name]) / one.sd for one in result.facts.parameters]
    assert np.max(np.abs(z)) < 4.5
