"""What is gathered equals what the tree holds."""

import numpy as np
import pytest

from bwbn_bayes.report.content import gather, shown
from bwbn_bayes.report.pieces import strongest_window, thinned


@pytest.fixture(scope="module")
def content(result):
    return gather(result)


def test_traces_hold_the_measured_channel_and_percentiles_of_the_predictive(result, content):
    trace = content.traces[1]
    assert (trace.channel, trace.title, trace.unit) == ("acceleration_2", "Floor 2", "m/s^2")
    own = {"channel": "acceleration_2"}
    np.testing.assert_array_equal(trace.measured, result.tree["observed_data"]["measured"].sel(own))
    draws = np.sort(result.tree["posterior_predictive"]["measured"].sel(own).values[0], axis=0)
    below = np.mean(draws < trace.predicted.lower, axis=0)
    above = np.mean(draws > trace.predicted.upper, axis=0)
    np.testing.assert_allclose(below, 0.05, atol=0.006)
    np.testing.assert_allclose(above, 0.05, atol=0.006)
    noise_free = result.tree["response"]["acceleration"].sel(floor=2).mean("draw")
    np.testing.assert_allclose(trace.residual, trace.measured - noise_free)


def test_loops_hold_measured_and_true_forces(result, content):
    assert [loop.place for loop in content.loops] == ["storey 1", "storey 2", "storey 3"]
    loop = content.loops[2]
    np.testing.assert_array_equal(loop.measured_force, result.tree["constant_data"]["measured_storey_force"][2])
    np.testing.assert_array_equal(loop.true_force, result.tree["true_response"]["restoring_force"][2])
    np.testing.assert_allclose(loop.force, result.tree["response"]["restoring_force"].values[:, 2].mean(axis=0))
    assert loop.drift_draws.shape == (25, 400)


def test_marginals_pick_the_right_storey(result, content):
    by_name = {marginal.parameter.name: marginal for marginal in content.marginals}
    assert set(by_name) == {p.name for p in result.facts.parameters}
    np.testing.assert_array_equal(by_name["k[3]"].posterior, result.tree["posterior"]["k"][..., 2])
    np.testing.assert_array_equal(by_name["n"].posterior, result.tree["posterior"]["n"])
    assert by_name["c[2]"].prior.shape == (1000,)


def test_pairs_are_the_strongest_correlations(content):
    draws = np.stack([m.posterior.ravel() for m in content.marginals])
    expected = np.sort(np.abs(np.corrcoef(draws))[np.triu_indices(len(draws), 1)])[::-1][:4]
    np.testing.assert_allclose([abs(pair.correlation) for pair in content.pairs], expected)


def test_quantities_are_read_with_their_bands(result, content):
    quantity = next(q for q in content.storey_quantities if q.name == "stiffness lost")
    draws = result.tree["quantities"]["stiffness_lost"].values
    np.testing.assert_allclose(quantity.band.middle, 100 * draws.mean(axis=0))
    np.testing.assert_allclose(quantity.band.upper, 100 * np.percentile(draws, 95, axis=0))
    assert content.period is not None
    assert content.period.time[-1] == pytest.approx(19.95)


def test_thinning_keeps_the_extremes_of_a_long_history():
    values = np.random.default_rng(3).standard_normal(50_000)
    values[12_345], values[40_001] = 9.0, -8.0
    index = thinned(values, 1000)
    assert len(index) <= 1000
    assert np.all(np.diff(index) > 0)
    assert {12_345, 40_001} <= set(index.tolist())
    np.testing.assert_array_equal(thinned(values[:500], 1000), np.arange(500))


def test_strongest_window_finds_the_burst():
    time = np.arange(0.0, 60.0, 0.02)
    burst = np.exp(-(((time - 31.0) / 1.0) ** 2)) * np.sin(20 * time)
    start, end = strongest_window(time, [burst])
    assert end - start == pytest.approx(5.0, abs=0.03)
    assert (start + end) / 2 == pytest.approx(31.0, abs=0.6)
    assert strongest_window(time[:100], [burst[:100]]) == (0.0, time[99])


def test_tall_buildings_show_evenly_chosen_storeys():
    assert shown([1, 2, 3]) == (1, 2, 3)
    chosen = shown(range(1, 51))
    assert len(chosen) == 6
    assert (chosen[0], chosen[-1]) == (1, 50)


def test_missing_groups_leave_their_parts_empty(bare_result):
    content = gather(bare_result)
    assert content.loops[0].measured_force is None
    assert content.loops[0].true_force is None
    assert content.period is None
    assert content.storey_quantities == ()
