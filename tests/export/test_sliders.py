"""Friction pendulums in buildings, written as OpenSees' own sliders and run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from opensees_runs import Histories, error, run_script

from bwbn_bayes import (
    BaseFlexibility,
    CoulombFriction,
    FrictionPendulum,
    Linear,
    Oscillator,
    PerStorey,
    Record,
    Settings,
    ShearBuilding,
    Uniform,
    el_centro,
    identify,
    simulate,
)
from bwbn_bayes.export import Script, of_model, of_result, script_of
from bwbn_bayes.export.sliders import slider_of
from bwbn_bayes.structures.model_file import load_model_file
from bwbn_bayes.structures.structure import Structure

MODEL = Path(__file__).parents[2] / "models" / "isolated_building.py"
MASSES = [6e4, 5e4, 4e4]
SLIDER = FrictionPendulum(W=9.81 * sum(MASSES), R=1.5, mu_slow=0.03, mu_fast=0.06, a_mu=30.0, Y=1e-4)
FRAME = Linear(k=PerStorey([9e7, 7e7]), c=3e5)
ISOLATED = ShearBuilding(masses=MASSES, isolator=SLIDER, storey=FRAME)
SHAKEN = el_centro("chopra", duration=6.0, scale=2.0)


def ours(model: Structure, record: Record) -> Histories:
    kinds = {"acceleration": model.n_floors, "drift": model.n_links, "force": model.n_links}
    channels = [f"{kind}_{i}" for kind, n in kinds.items() for i in range(1, n + 1)]
    return {name: np.array(v) for name, v in simulate(model, record, {}, channels=channels).channels.items()}


def in_opensees(script: Script, folder: Path) -> Histories:
    path = folder / "written.py"
    path.write_text(script.text, encoding="utf-8")
    return run_script(path, 40)


def of(kind: str, histories: Histories) -> Histories:
    return {name: signal for name, signal in histories.items() if name.startswith(kind)}


def test_the_isolated_building_of_the_models_moves_in_opensees(tmp_path: Path) -> None:
    """A fit to its slider took 45 s of processor, missed 12 % of the loop and a third of the acceleration above it."""
    file = load_model_file(MODEL)
    assert isinstance(file.excitation, Record)
    known = file.model.with_values(file.truth)
    script = script_of(of_model(known, file.excitation, {}, name=file.name))
    (note,) = script.notes
    assert note.startswith("Storey 1: Friction is a flatSliderBearing, which slides at once and misses 4")
    found, expected = in_opensees(script, tmp_path), ours(known, file.excitation)
    assert error(found, of("drift_1", expected)) < 0.01
    assert error(found, of("force_1", expected)) < 0.06
    assert error(found, of("acceleration", expected)) < 0.16
    assert error(found, of("acceleration_4", expected)) < 0.07


@pytest.mark.parametrize(
    ("model", "record"),
    [
        (ISOLATED, SHAKEN),
        (ISOLATED.with_effect(BaseFlexibility(compliance=3e-9, m_b=1e5, c_b=1e5)), SHAKEN),
        (
            ShearBuilding(masses=MASSES, storey=Linear(k=PerStorey([9e7, 3e7, 7e7]), c=3e5)).with_link(
                replace(SLIDER, W=9.81 * sum(MASSES[1:])), joins=(1, 2)
            ),
            replace(SHAKEN, forces={"applied_force_2": 4e4 * np.cos(5.0 * SHAKEN.times)}),
        ),
    ],
    ids=["on the ground", "on a base that moves", "between floors, shaken and pushed"],
)
def test_a_contact_that_gives_way_early_is_a_slider_of_opensees(
    model: Structure, record: Record, tmp_path: Path
) -> None:
    script = script_of(of_model(model, record, {}, name="sliding"))
    found, expected = in_opensees(script, tmp_path), ours(model, record)
    sliders = [link.slider for link in script.links if link.slider is not None]
    assert [slider.error < 0.035 for slider in sliders] == [True]
    assert error(found, of("drift", expected)) < 0.015
    assert error(found, of("acceleration", expected)) < 0.05
    assert error(found, of("force", expected)) < 0.035


def test_a_loop_is_missed_by_as_much_as_is_said(tmp_path: Path) -> None:
    """What is said is along our drift, what is found along that of OpenSees; the contact is soft here."""
    model = replace(ISOLATED, links=(replace(ISOLATED.links[0], element=replace(SLIDER, Y=2e-3)), *ISOLATED.links[1:]))
    script = script_of(of_model(model, SHAKEN, {}, name="soft"))
    found, expected = in_opensees(script, tmp_path), ours(model, SHAKEN)
    assert script.links[0].error == pytest.approx(error(found, of("force_1", expected)), rel=0.25)


def test_a_result_is_exported_with_its_slider() -> None:
    unknown = Oscillator(mass=6e4, spring=replace(SLIDER, W=9.81 * 6e4, R=Uniform(1.0, 3.0), Y=5e-3))
    record = simulate(unknown, el_centro("chopra", duration=4.0), {"R": 1.5}, snr_db=30.0)
    found = identify(unknown, record, settings=Settings(particles=50, alternatives=False))
    (slider,) = [link.slider for link in script_of(of_result(found)).links if link.slider is not None]
    assert slider.weight == 9.81 * 6e4
    assert slider.friction == (0.03, 0.06, 30.0)


def test_what_else_opensees_lacks_is_fitted_together_with_the_slider() -> None:
    rough = ISOLATED.with_effect(CoulombFriction(F_c=1e4, v0=0.01), storeys=[1])
    plain, both = (of_model(model, SHAKEN, {}, name="x") for model in (ISOLATED, rough))
    steps = np.diff(SHAKEN.times)
    assert [slider_of(link, steps) is not None for link in plain.links] == [True, False, False]
    assert slider_of(both.links[0], steps) is None
