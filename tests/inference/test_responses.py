"""Histories in summary against whole ones, and how little of a long record is kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest
import xarray as xr
from inference_cases import ENGINE, recorded, sdof_model

from bwbn_bayes import BoucWen, Record, ShearBuilding
from bwbn_bayes.engines.base import Response
from bwbn_bayes.inference import arrays, responses
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.responses import Responses, evenly, summarised
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.structure import Structure

RECORD = recorded(1)
MODEL = sdof_model()
N = 40


def _summarised() -> tuple[Responses, Floats, Floats]:
    rng = np.random.default_rng(3)
    values = MODEL.space.from_unit(0.4 + 0.2 * rng.random((N, MODEL.space.n_dim)))
    noise_sd = np.full((N, 1), 0.02)
    return summarised(ENGINE, MODEL, RECORD, np.arange(N), values, noise_sd, rng), values, noise_sd


def test_bands_are_those_of_all_draws_and_a_few_are_kept_whole() -> None:
    found, values, _ = _summarised()
    solved = ENGINE.simulate(MODEL, values, RECORD, ["drift_1", "acceleration_1"]).values
    for place, kind in enumerate(("drift", "acceleration")):
        expected = np.stack([solved[:, place].mean(axis=0), *np.quantile(solved[:, place], [0.05, 0.95], axis=0)])
        tolerance = 1e-6 * float(np.max(np.abs(solved[:, place])))
        np.testing.assert_allclose(found.bands[kind][:, 0], expected, atol=tolerance)
        np.testing.assert_allclose(found.histories[kind][:, 0], solved[found.whole, place], atol=tolerance)
    np.testing.assert_allclose(found.signals[0], solved[:, 1].mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(found.landmarks["peak_drift"][1][:, 0], np.abs(solved[:, 0]).max(axis=1), rtol=1e-6)
    assert len(found.whole) == 25


def test_how_much_is_solved_at_once_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A long record is solved in many passes: one kind at a time, sixteen draws at a time, quantiles in stretches."""
    at_once, _, _ = _summarised()
    for name, value in (("_HELD", 1), ("_SOLVED", 1), ("_SORTED", 50 * N)):
        monkeypatch.setattr(responses, name, value)
    in_pieces, _, _ = _summarised()
    for kind in at_once.bands:
        np.testing.assert_array_equal(in_pieces.bands[kind], at_once.bands[kind])
        np.testing.assert_array_equal(in_pieces.histories[kind], at_once.histories[kind])
    np.testing.assert_array_equal(in_pieces.predicted_bands, at_once.predicted_bands)
    np.testing.assert_allclose(in_pieces.signals, at_once.signals, rtol=0, atol=1e-14)


@dataclass(frozen=True)
class _Noise:
    """Gives any draw any history at once."""

    name = scheme = "noise"

    def simulate(self, model: Structure, draws: Floats, record: Record, channels: Sequence[str]) -> Response:
        values = np.random.default_rng(0).standard_normal((len(draws), len(channels), record.n_times))
        return Response(channels=tuple(channels), values=values, status=np.zeros(len(draws), dtype=np.int64))


def test_a_long_record_leaves_few_numbers_for_each_sample() -> None:
    """A hundred whole histories of every kind left 2.9 kB a sample: 289 MB of 10^5 samples, 3 GB of 10^6."""
    n = 10**6 // 4
    model = ShearBuilding(masses=[1.0], storey=BoucWen(k=20.0, c=0.2, alpha=0.1, A=1.0, beta=2.0, gamma=1.0, n=1.5))
    excitation = np.sin(0.1 * np.arange(n))
    record = Record(
        name="long", time_step=0.02, excitation=excitation, excitation_kind="ground_acceleration",
        channels={"acceleration_1": excitation},
    )  # fmt: skip
    rng = np.random.default_rng(1)
    found = summarised(_Noise(), model, record, np.arange(32), np.zeros((32, 0)), np.ones((32, 1)), rng)  # type: ignore[arg-type]
    kept = [*found.bands.values(), *found.histories.values(), found.predicted_bands]
    assert sum(array.nbytes for array in kept) < 236 * n
    assert len(found.whole) == 6


def _by_sample(posterior: Posterior, points: Floats) -> tuple[xr.DataArray, xr.DataArray]:
    found = arrays._by_sample(posterior, points, np.full((N, 1), 0.02), np.random.default_rng(5))
    return found[0]["measured"], found[1]["measured"]


def test_replicates_are_responses_of_their_draws_and_noise() -> None:
    posterior = Posterior(model=MODEL, record=RECORD, engine=ENGINE, noise=default_noise(RECORD))
    points = 0.4 + 0.2 * np.random.default_rng(4).random((N, MODEL.space.n_dim))
    _, replicates = _by_sample(posterior, points)
    values, _ = posterior.split(points)
    solved = ENGINE.simulate(MODEL, values, RECORD).values
    noise = (replicates.values[0] - solved) / 0.02
    assert abs(np.std(noise) - 1.0) < 4.0 / np.sqrt(2.0 * noise.size)


def test_densities_of_a_long_record_are_those_of_stretches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pointwise, a hundred draws of 10^6 samples are 400 MB; their sums over stretches are the same in all."""
    posterior = Posterior(model=MODEL, record=RECORD, engine=ENGINE, noise=default_noise(RECORD))
    points = 0.4 + 0.2 * np.random.default_rng(4).random((N, MODEL.space.n_dim))
    each, replicates = _by_sample(posterior, points)
    monkeypatch.setattr(arrays, "_POINTWISE_NUMBERS", 10 * 100)
    stretches, few = _by_sample(posterior, points)
    assert (replicates.sizes["draw"], few.sizes["draw"]) == (N, 2)
    assert stretches.sizes["time"] <= 10
    np.testing.assert_allclose(stretches.sum("time"), each.sum("time"), rtol=1e-5)
    first = each.sel(time=slice(None, float(stretches["time"][1]) - 1e-9))
    np.testing.assert_allclose(stretches.isel(time=0), first.sum("time"), rtol=1e-5)


def test_positions_are_spread_evenly_with_both_ends() -> None:
    np.testing.assert_array_equal(evenly(11, 3), [0, 5, 10])
    np.testing.assert_array_equal(evenly(2, 3), [0, 1])
