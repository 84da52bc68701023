"""Arrays of a result as ArviZ reads them: draws by number, pointwise densities, noise scales, units."""

from __future__ import annotations

import arviz as az
import numpy as np
import pytest
from inference_cases import ENGINE, sdof_model
from scipy import stats

from bwbn_bayes import LogNormal, Record, Result, SampledNoise, Settings, identify
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.report.content import gather


@pytest.fixture(scope="module")
def result(identified: Result) -> Result:
    return identified


def test_leave_one_out_sees_samples(result: Result, record: Record) -> None:
    """Nine effective parameters, eight and the noise; ``az.loo`` took one scalar per draw for the one observation.

    A sample's own density at the truth has mean ``-log(sd) - log(2 pi e) / 2``; a parameter costs a nat.
    """
    loo = az.loo(result.tree)
    sd = record.noise_sd["acceleration_1"]
    expected = -record.n_times * (np.log(sd) + 0.5 * np.log(2.0 * np.pi) + 0.5)
    assert loo.n_data_points == record.n_times
    assert abs(loo.elpd - expected) < 4.0 * loo.se
    assert loo.p == pytest.approx(9.0, abs=2.0)


def test_leave_one_out_ranks_are_uniform(result: Result, record: Record) -> None:
    """Densities were of ``measured``, data and replicates of channels, of other draws: ``az.loo_pit`` found no pair.

    The ranks' mean has standard error 1 / sqrt(12 n) of independent samples.
    """
    ranks = az.loo_pit(result.tree)["measured"].values
    assert ranks.shape == (1, record.n_times)
    assert abs(float(np.mean(ranks)) - 0.5) < 4.0 / np.sqrt(12.0 * record.n_times)


def test_draws_of_all_groups_are_the_posteriors(result: Result, posterior: Posterior) -> None:
    """By number: a response is that of its draw, a log density is that of its draw and its noise scale."""
    tree = result.tree
    number = tree["response"]["draw"].values[7]
    draw = tree["posterior"].sel(chain=0, draw=number)
    values = np.array([[draw[name].item() for name in sdof_model().space.names]])
    np.testing.assert_array_equal(tree["parameters_by_storey"]["k"].sel(draw=number), draw["k"])
    number = tree["log_likelihood"]["draw"].values[7]
    draw = tree["posterior"].sel(chain=0, draw=number)
    values = np.array([[draw[name].item() for name in sdof_model().space.names]])
    solved = ENGINE.simulate(sdof_model(), values, posterior.record).values[0]
    np.testing.assert_allclose(
        tree["posterior_predictive"]["measured"].sel(chain=0, draw=number), solved, atol=5.5 * draw["noise_sd"].item()
    )
    expected = stats.norm(solved, draw["noise_sd"].item()).logpdf(posterior.record.measured)
    np.testing.assert_allclose(
        tree["log_likelihood"]["measured"].sel(chain=0, draw=number).sum(), np.sum(expected), atol=0.5
    )
    one = posterior.space.to_unit(values)
    density = float(
        np.sum([p.prior.log_density(v) for p, v in zip(posterior.space.parameters, values[0], strict=True)])
    )
    own = float(posterior.log_likelihood(one)[0]) + density - posterior.space.log_admissible_mass
    assert tree["sample_stats"]["lp"].sel(chain=0, draw=number).item() == pytest.approx(own, abs=0.5)


def test_units_are_attributes(result: Result) -> None:
    tree = result.tree
    assert tree["posterior"]["k"].attrs["units"] == "N/m"
    assert tree["posterior"]["noise_sd"].attrs["units"] == tree["observed_data"]["measured"].attrs["units"]
    assert tree["response"]["drift"].attrs["units"] == "m"
    assert tree["quantities"]["dissipated_energy"].attrs["units"] == "J"
    assert tree["observed_data"]["time"].attrs["units"] == "s"


def test_the_prior_of_integrated_noise_is_given(result: Result, record: Record) -> None:
    """The posterior alone had ``noise_sd``. The variance's prior is inverse-gamma of shape 1: its median is b / log 2.

    The share of 2,000 draws below a median has standard error .011.
    """
    median = np.sqrt(default_noise(record).scale[0] / np.log(2.0))
    assert abs(float((result.tree["prior"]["noise_sd"] < median).mean()) - 0.5) < 0.045


def test_sampled_noise_is_under_the_same_name(record: Record) -> None:
    """``noise_sd`` by channel, as where it is integrated out, in posterior, prior and report."""
    noise = SampledNoise(channels=tuple(record.channels), priors=(LogNormal(0.02, 0.5),))
    sampled = identify(sdof_model(), record, settings=Settings(particles=400), noise=noise)
    for group in ("posterior", "prior"):
        assert sampled.tree[group]["noise_sd"].dims == ("chain", "draw", "channel")
    assert sampled.tree["posterior"]["noise_sd"].mean().item() == pytest.approx(0.0177, rel=0.05)
    names = [marginal.parameter.name for marginal in gather(sampled).marginals]
    assert names[-1] == "noise_sd[acceleration_1]"
