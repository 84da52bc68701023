"""What the benchmark takes from a discovery: the response of its most probable draw, and a whole run."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from benchmarks.measured_tests import discovering
from benchmarks.measured_tests.discovering import discover_first_part, discover_whole, identified_response, read_answer
from benchmarks.measured_tests.specimens import Label, MeasuredTest, parted
from bwbn_bayes import (
    BoucWen,
    DiscoverySettings,
    PerStorey,
    Record,
    ShearBuilding,
    SlipLock,
    Specimen,
    Uniform,
    simulate,
)


def test_the_identified_response_is_that_of_the_most_probable_draw():
    building = ShearBuilding(
        masses=[1.0, 1.0],
        storey=BoucWen(k=PerStorey(Uniform(5, 60)), c=0.2, alpha=Uniform(0.01, 0.5), A=1.0, beta=2.0, gamma=1.0, n=1.5),
    )
    ground = Record(name="pulse", time_step=0.02, excitation=np.sin(np.arange(150) / 8.0))
    truth = {"k[1]": 30.0, "k[2]": 20.0, "alpha": 0.1}
    expected = simulate(building, ground, truth, channels=["displacement_1", "displacement_2"])
    draws = {
        "k": (("chain", "draw", "storey"), np.array([[[10.0, 50.0], [30.0, 20.0], [50.0, 10.0]]])),
        "alpha": (("chain", "draw"), np.array([[0.3, 0.1, 0.2]])),
    }
    tree = xr.DataTree.from_dict(
        {
            "posterior": xr.Dataset(draws, coords={"storey": [1, 2]}),
            "sample_stats": xr.Dataset({"lp": (("chain", "draw"), np.array([[-9.0, -1.0, -5.0]]))}),
        }
    )
    discovery: Any = SimpleNamespace(improved=building, result=SimpleNamespace(tree=tree))
    found = identified_response(discovery, expected)
    assert found == pytest.approx(expected.measured, abs=1e-4 * np.max(np.abs(expected.measured)))


@pytest.mark.slow
def test_discover_is_run_on_the_first_part_and_on_the_whole(monkeypatch):
    t = np.arange(201) / 40.0
    path = Record(
        name="slipping", time_step=1.0, excitation_kind="displacement", has_time=False,
        excitation=0.02 * np.sin(2.0 * np.pi * t) * (0.6 + 0.4 * np.sin(t) ** 2), channels={"force": np.zeros(201)},
    )  # fmt: skip
    specimen = Specimen(
        storey=BoucWen(k=Uniform(1e5, 1e6), c=0.0, alpha=0.05, A=1.0, beta=200.0, gamma=100.0, n=1.5),
        effects=(),
    ).with_effect(SlipLock(delta_s=1e-4, sigma=0.05))
    record = simulate(specimen, path, {"k": 4e5}, snr_db=40.0)
    n_fitted, rule = parted(record)
    label = Label(loops="pinched", zero_force_ratio=0.1, failure="Shear")
    test = MeasuredTest(name="slipping", record=record, n_fitted=n_fitted, rule=rule, label=label)

    def small(seed: int) -> DiscoverySettings:
        return DiscoverySettings(seed=seed, effects=(SlipLock,), particles=200, most_effects=1, n_workers=1)

    monkeypatch.setattr(discovering, "DiscoverySettings", small)
    for run in (discover_first_part, discover_whole):
        facts, response = run(test, 1)
        answer = read_answer(json.loads(json.dumps(facts)))
        assert response.shape == (1, record.n_times)
        # The same model by two roads: the package's own figure, and the response that is drawn.
        assert answer.fit == pytest.approx(facts["errors"][0], rel=0.3, abs=0.5)
    assert facts["loops"]["pinching_index"]["measured"] > 0.0
