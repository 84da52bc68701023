"""From a saved result: the posterior mean, the densest draw, a point estimate, and what cannot be exported."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from opensees_runs import error, run_script

from bwbn_bayes import (
    BoucWen,
    PerStorey,
    Result,
    Settings,
    ShearBuilding,
    StrengthDegradation,
    Uniform,
    UserError,
    el_centro,
    identify,
    simulate,
)
from bwbn_bayes.export import of_result, script_of

MODEL = ShearBuilding(
    masses=[2.0, 1.5],
    heights=[3.0, 2.8],
    storey=BoucWen(k=PerStorey(Uniform(100, 300)), c=0.4, alpha=Uniform(0.01, 0.2), u_y=0.03, rho=0.6, n=1.5),
).with_effect(StrengthDegradation(delta_nu=Uniform(0.0, 0.5)), storeys=[2])
TRUTH = {"k[1]": 200.0, "k[2]": 160.0, "alpha": 0.08, "delta_nu[2]": 0.1}


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """Identified, saved and loaded."""
    record = simulate(MODEL, el_centro("chopra", duration=8.0), TRUTH, snr_db=30.0)
    path = tmp_path_factory.mktemp("result") / "result.nc"
    identify(MODEL, record, settings=Settings(particles=200), name="two storeys").save(path)
    return Result.load(path)


def test_the_posterior_mean_stands_at_its_storeys(result: Result) -> None:
    structure = of_result(result)
    means = {p.name: p.mean for p in result.facts.parameters}
    first, second = (link.parameters for link in structure.links)
    assert (first["k"], second["k"]) == (means["k[1]"], means["k[2]"])
    assert first["alpha"] == second["alpha"] == means["alpha"]
    assert (first["delta_nu"], second["delta_nu"]) == (0.0, means["delta_nu[2]"])
    assert (first["c"], first["u_y"], first["n"]) == (0.4, 0.03, 1.5)
    assert structure.masses == (2.0, 1.5)
    assert structure.origin.startswith("the posterior mean")


def test_the_densest_draw_is_one_draw(result: Result) -> None:
    first, second = (link.parameters for link in of_result(result, at="map").links)
    posterior = result.tree["posterior"].to_dataset().isel(chain=0)
    best = int(np.argmax(result.tree["sample_stats"]["lp"].values[0]))
    draw = posterior.isel(draw=best)
    np.testing.assert_array_equal([first["k"], second["k"]], draw["k"].values)
    assert first["alpha"] == float(draw["alpha"])
    assert second["delta_nu"] == float(draw["delta_nu"].squeeze() if "delta_nu" in draw else draw["delta_nu[2]"])


def test_the_script_of_a_result_foresees_what_was_measured(result: Result, tmp_path: Path) -> None:
    """At 30 dB the fit leaves 3 % of a channel; mean and step add less than that."""
    path = tmp_path / "two.py"
    path.write_text(script_of(of_result(result)).text, encoding="utf-8")
    rows = result.tree["observed_data"]["measured"]
    measured = {str(name): row.values for name, row in zip(rows["channel"].values, rows, strict=True)}
    assert error(run_script(path), measured) < 0.05


def test_a_result_from_before_masses_were_kept_is_refused(result: Result) -> None:
    tree = result.tree.copy()
    tree["constant_data"] = tree["constant_data"].to_dataset().drop_vars("mass")
    with pytest.raises(UserError, match="identify once more with this version"):
        of_result(Result(tree=tree, facts=result.facts))


def test_a_result_of_forces_alone_is_refused(result: Result) -> None:
    tree = result.tree.copy()
    del tree["parameters_by_storey"]
    with pytest.raises(UserError, match="method ipv holds no parameters by storey"):
        of_result(Result(tree=tree, facts=replace(result.facts, method="ipv")))


def test_a_number_that_is_none_is_refused(result: Result) -> None:
    tree = result.tree.copy()
    broken = tree["parameters_by_storey"].to_dataset()
    tree["parameters_by_storey"] = broken.assign(c=broken["c"] * np.nan)
    with pytest.raises(UserError, match="storey 1: c is not finite"):
        of_result(Result(tree=tree, facts=result.facts))
