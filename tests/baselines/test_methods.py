"""One door to every method, and one report for all of them."""

from __future__ import annotations

import math
import re
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from inference_cases import recorded, sdof_model

from bwbn_bayes import GeneticSettings, Result, Settings, ShearBuilding, Specimen, UserError, identify, write_report

GENETIC = GeneticSettings(population=40, elite=4, generations=12)


@pytest.fixture(scope="module")
def found() -> Result:
    return identify(sdof_model(), recorded(1), settings=Settings(method="ga"), options=GENETIC, name="sdof")


@pytest.fixture(scope="module")
def learned() -> Result:
    return identify(sdof_model(), recorded(1), settings=Settings(method="ipv"), name="sdof")


def page_of(result: Result, directory: Path) -> str:
    text = write_report(result, directory).html.read_text(encoding="utf-8")
    return re.sub(r"\s+", " ", text)


def test_a_point_has_no_intervals(found: Result) -> None:
    facts = found.facts
    assert facts.method == "ga"
    assert [p.name for p in facts.parameters] == list(sdof_model().space.names)
    for parameter in facts.parameters:
        assert math.isnan(parameter.sd) and math.isnan(parameter.hdi90[0])
        assert parameter.z_score is None
    assert math.isnan(facts.log_evidence)
    assert "posterior" not in found.tree.children
    assert found.tree["history"].sizes["generation"] == 13
    assert facts.n_solves == 40 + 12 * 36
    assert found.tree["estimate"]["k"].item() == pytest.approx(facts.parameters[0].mean)


def test_forces_come_without_parameters(learned: Result) -> None:
    facts = learned.facts
    assert (facts.method, facts.parameters) == ("ipv", ())
    # 30 dB of mean square: the force of one storey is minus the mass times the measured acceleration.
    assert facts.restoring_force["1"]["nrmse"] == pytest.approx(10.0**-1.5, rel=0.15)
    assert facts.checks[0].name == "identity map" and facts.checks[0].passed


def test_both_save_and_load(found: Result, learned: Result, tmp_path: Path) -> None:
    for result in (found, learned):
        path = tmp_path / f"{result.facts.method}.nc"
        result.save(path)
        np.testing.assert_equal(asdict(Result.load(path).facts), asdict(result.facts))


def test_both_render_in_the_same_report_and_say_what_they_lack(found: Result, learned: Result, tmp_path: Path) -> None:
    point, forces = page_of(found, tmp_path / "ga"), page_of(learned, tmp_path / "ipv")
    assert "this method gives no standard deviations and no intervals" in point
    assert "this method gives no parameters of the model" in forces
    for page in (point, forces):
        assert "90 % band" not in page and "posterior mean" not in page and "log evidence" not in page
        assert "hysteresis.png" not in page and "Storey force against drift" in page
    assert "delta_eta" in point


def test_ipv_needs_a_mass_for_every_floor() -> None:
    """A mass too few, and the first storey would be learned without what lies above."""
    record = recorded(1)
    two = record.with_channels({f"acceleration_{i}": record.channels["acceleration_1"] for i in (1, 2)})
    with pytest.raises(UserError, match="acceleration_2"):
        identify(sdof_model(), two, settings=Settings(method="ipv"))


def test_ipv_needs_a_building() -> None:
    specimen = Specimen(storey=sdof_model().element)
    with pytest.raises(UserError, match="ShearBuilding"):
        identify(specimen, recorded(1), settings=Settings(method="ipv"))


def test_networks_keep_no_checkpoint(tmp_path: Path) -> None:
    settings = Settings(method="ipv", checkpoint=tmp_path / "kept")
    with pytest.raises(UserError, match="keeps no checkpoint: leave it out"):
        identify(sdof_model(), recorded(1), settings=settings)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("channels", [(), ("acceleration_1",)])
def test_nothing_measured_or_nothing_to_find_is_one_sentence(channels: tuple[str, ...]) -> None:
    model = sdof_model()
    if channels:
        storey = type(model.element)(k=40.0, c=0.2, alpha=0.05, A=1.0, beta=30.0, gamma=15.0, n=1.2)
        model = ShearBuilding(masses=[1.0], storey=storey)
    with pytest.raises(UserError, match="identifies no parameter" if channels else "measures nothing"):
        identify(model, recorded(1).select(channels), settings=Settings(method="ga"))
