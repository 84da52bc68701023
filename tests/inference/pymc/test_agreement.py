"""TMCMC, PyMC's SMC with the batched kernel and NUTS see the same posterior, and the truth in it."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import arviz_stats
import numpy as np
import pytest
from inference_cases import climbed, posterior_of, recorded, sdof_model, true_point
from pymc_cases import TRUTH, small_mode, small_posterior

from bwbn_bayes import Result, Settings, identify, simulate, to_pymc
from bwbn_bayes.inference.accuracy import LADDER, choose_scheme
from bwbn_bayes.inference.bridge import bridge
from bwbn_bayes.inference.importance import PARETO_CLEAR, sample_importance
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.nested_laplace import Sheet
from bwbn_bayes.inference.pymc.coordinates import NormalCoordinates
from bwbn_bayes.inference.pymc.nuts import convergence, sample_nuts
from bwbn_bayes.inference.pymc.roads import values_of
from bwbn_bayes.inference.pymc.smc import sample_smc
from bwbn_bayes.inference.tmcmc.sampler import sample
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.model_file import load_model_file

MODELS = Path(__file__).parents[3] / "models"
Moments = tuple[Floats, Floats, float]
"""Mean, standard deviation, and the number of independent draws behind them."""


def require_agreement(found: dict[str, Moments], truth: Floats) -> None:
    """Means within four standard errors of each other, sds likewise, and the truth within four sds."""
    names = list(found)
    for i, one in enumerate(names):
        mean, sd, size = found[one]
        assert np.all(np.abs(mean - truth) < 4.0 * sd), one
        for other in names[i + 1 :]:
            mean_2, sd_2, size_2 = found[other]
            error = np.sqrt(sd**2 / size + sd_2**2 / size_2)
            assert np.all(np.abs(mean - mean_2) < 4.0 * error), (one, other, (mean - mean_2) / error)
            # The log of an sd from n draws has standard error 1 / sqrt(2 n).
            spread = np.sqrt(0.5 / size + 0.5 / size_2)
            assert np.all(np.abs(np.log(sd / sd_2)) < 4.0 * spread), (one, other, np.log(sd / sd_2) / spread)


def moments(values: Floats, size: float) -> Moments:
    """Of equal-weight draws worth ``size`` independent ones."""
    return values.mean(axis=0), values.std(axis=0), size


def roads(
    posterior: Posterior, mode: Mode, draws: int, *, nuts_draws: int | None = None, bent: bool = False
) -> tuple[dict[str, Moments], dict[str, tuple[float, float]]]:
    """Moments and log evidences by sampler.

    TMCMC starts from the prior; where the posterior is bent, it and importance sampling start from the sheet.
    """
    space = posterior.space
    twin = to_pymc(posterior.model, posterior.record, noise=posterior.noise, engine=posterior.engine)
    sheet = Sheet(posterior, (mode,), np.random.default_rng(1))
    if bent:
        sheet.lay()
    weighted = sample_importance(posterior, sheet.proposal, np.random.default_rng(4), effective=2 * draws)
    if weighted.pareto_k > PARETO_CLEAR:  # as identify does: such draws miss a tail
        sheet.lay()
        weighted = sample_importance(posterior, sheet.proposal, np.random.default_rng(4), effective=2 * draws)
    points, _ = weighted.resampled(np.random.default_rng(2), 4 * draws)
    from_start = partial(bridge, modes=(mode,), sheet=sheet.nested) if bent else sample
    cloud = from_start(posterior, n_particles=draws, rng_seed=1)
    smc = sample_smc(twin, draws=draws, chains=2, seed=1)
    coordinates = NormalCoordinates.at(posterior, mode.point)
    nuts = sample_nuts(coordinates, draws=nuts_draws or draws, tune=100, chains=2, seed=1)
    assert nuts.n_divergences <= 0.01 * 2 * (nuts_draws or draws)
    _, nuts_size = convergence(nuts.coordinates, space.names)
    ess = arviz_stats.ess(smc.tree["posterior"].dataset)
    size = min(float(v.min()) for v in ess.data_vars.values())
    found = {
        "importance": moments(space.from_unit(points), weighted.effective_sample_size),
        "tmcmc": moments(space.from_unit(cloud.particles), min(cloud.stages[-1].effective_sample_size, draws)),
        # Particles of one chain descend from each other: worth no more than a fifth of their number.
        "smc": moments(values_of(smc.tree, space), min(size, 0.2 * 2 * draws)),
        "nuts": moments(space.from_unit(coordinates.points(nuts.coordinates.reshape(-1, space.n_dim))), nuts_size),
    }
    evidences = {
        "importance": (weighted.log_evidence, weighted.log_evidence_se),
        "tmcmc": (cloud.log_evidence, cloud.log_evidence_se),
        "smc": (smc.log_evidence, smc.log_evidence_se),
    }
    return found, evidences


def test_the_samplers_agree_with_each_other_and_with_the_truth() -> None:
    posterior = small_posterior()
    found, evidences = roads(posterior, small_mode(posterior), 300)
    require_agreement(found, np.array(list(TRUTH.values())))
    exact, _ = evidences["importance"]
    assert all(abs(value - exact) < 4.0 * se + 0.2 for value, se in evidences.values()), evidences


@pytest.mark.slow
def test_they_agree_on_the_whole_sdof_case() -> None:
    """Moments; the evidences of tempering from the prior fall short here and are shown by ``benchmarks.samplers``."""
    record = recorded(1)
    posterior = posterior_of(sdof_model(), record)
    point = true_point(sdof_model(), record)
    found, _ = roads(posterior, climbed(posterior, point), 1000)
    require_agreement(found, posterior.space.from_unit(point[None])[0])


@pytest.mark.slow
def test_they_agree_on_the_three_storey_case() -> None:
    """The paper's building under the first 12 s of El Centro, 30 dB: 16 parameters, some of them hardly seen."""
    file = load_model_file(MODELS / "three_storey_el_centro.py")
    assert file.excitation is not None
    record = simulate(file.model, file.excitation.until(12.0), file.truth, snr_db=30.0, seed=3)
    coarse = Posterior(model=file.model, record=record, engine=LADDER[0], noise=default_noise(record))
    truth = np.array([file.truth[name] for name in coarse.space.names])
    point = coarse.space.to_unit(truth[None])[0]
    scheme, _ = choose_scheme(coarse, point, LADDER[0])
    posterior = coarse.with_engine(scheme)
    found, evidences = roads(posterior, climbed(posterior, point), 300, nuts_draws=150, bent=True)
    require_agreement(found, truth)
    assert abs(evidences["tmcmc"][0] - evidences["importance"][0]) < 1.0, evidences


@pytest.mark.parametrize("method", ["smc", "nuts"])
def test_identify_by_pymc(method: str, tmp_path: object) -> None:
    posterior = small_posterior()
    result = identify(
        posterior.model,
        posterior.record,
        settings=Settings(method=method, particles=100, seed=2),  # type: ignore[arg-type]
    )
    assert result.facts.method == method
    assert all(abs(z) < 4.0 for p in result.facts.parameters if (z := p.z_score) is not None)
    assert np.isfinite(result.facts.log_evidence) == (method == "smc")
    names = {check.name for check in result.facts.checks}
    assert names >= ({"chains agree"} if method == "smc" else {"divergences", "R-hat"})
    result.save(tmp_path / "result.nc")  # type: ignore[operator]
    assert Result.load(tmp_path / "result.nc").facts.method == method  # type: ignore[operator]
