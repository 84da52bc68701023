"""A whole building, written and run in OpenSees: floors, drifts and forces against the reference engine."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from opensees_runs import Histories, error, in_the_limit, run_script

from bwbn_bayes import (
    Appendage,
    BaseFlexibility,
    BoucWen,
    FolientePinching,
    InputScale,
    Linear,
    MassDamping,
    MassError,
    PDelta,
    PerStorey,
    Record,
    SensorGain,
    ShearBuilding,
    SlidingBase,
    StiffnessDegradation,
    StoreyCoupling,
    StrengthDegradation,
    Uniform,
    UserError,
    el_centro,
    simulate,
)
from bwbn_bayes.export import of_model, script_of
from bwbn_bayes.structures.structure import Structure

STOREY = BoucWen(k=PerStorey([9e7, 7e7]), c=3e5, alpha=0.05, u_y=0.008, rho=0.6, n=1.7)
SHAKEN = el_centro("chopra", duration=8.0)


AROUND = (
    (StrengthDegradation(delta_nu=4e-6), [1]),
    (StiffnessDegradation(delta_eta=3e-6), [1]),
    (FolientePinching(zeta_s=0.7, p=3e-5, q=0.1, psi_0=0.002, delta_psi=0.0, lambda_=0.3), [2]),
    (MassDamping(c_m=0.2), None),
    (Appendage(mu_t=0.05, f_t=2.0, zeta_t=0.02), [2]),
    (MassError(e_m=0.1), [1]),
    (BaseFlexibility(compliance=3e-9, m_b=1e5, c_b=1e5), None),
    (InputScale(s_g=1.2), None),
)
"""All that OpenSees can do beside the storeys, and links of two laws."""
PLAIN = replace(ShearBuilding(masses=[2e5, 1.5e5], storey=STOREY), carried=tuple(effect for effect, _ in AROUND))
"""It has the law of them all, so that one compiled kernel serves every test."""


def everything_around() -> ShearBuilding:
    model = PLAIN
    for effect, storeys in AROUND:
        model = model.with_effect(effect, storeys)
    return model


def by_reference(model: Structure, record: Record) -> Histories:
    channels = [f"{kind}_{i}" for kind in ("acceleration", "drift", "force") for i in (1, 2)]
    return {name: np.array(v) for name, v in simulate(model, record, {}, channels=channels).channels.items()}


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Histories, Histories, Histories, Histories]:
    model = everything_around()
    script = script_of(of_model(model, SHAKEN, {}, name="two storeys"))
    assert script.notes == ()
    return by_reference(model, SHAKEN), *in_the_limit(script, tmp_path_factory.mktemp("written"), substeps=60)


def test_floors_drifts_and_forces_follow_the_reference_engine(written: tuple[Histories, ...]) -> None:
    """Within one per cent at sixty substeps, and 2e-4 extrapolated to a step of zero."""
    truth, coarse, _, limit = written
    assert error(coarse, truth) < 1e-2
    assert error(limit, truth) < 2e-4


def test_the_error_is_of_first_order(written: tuple[Histories, ...]) -> None:
    truth, coarse, fine, _ = written
    assert error(coarse, truth) / error(fine, truth) == pytest.approx(2.0, abs=0.1)


def test_a_ground_that_moves_from_the_first_sample_on(tmp_path: Path) -> None:
    """OpenSees starts with floors that accelerate with the ground; without their acceleration set it rings."""
    times = 0.02 * np.arange(200)
    record = Record(name="cosine", time_step=0.02, excitation=2.0 * np.cos(9.0 * times))
    model = everything_around()
    _, _, limit = in_the_limit(script_of(of_model(model, record, {}, name="cosine")), tmp_path, substeps=40)
    assert error(limit, by_reference(model, record)) < 1e-3


def test_the_substeps_of_the_script_are_enough_for_half_a_per_cent(tmp_path: Path) -> None:
    model = everything_around()
    path = tmp_path / "two.py"
    path.write_text(script_of(of_model(model, SHAKEN, {}, name="two")).text, encoding="utf-8")
    assert error(run_script(path), by_reference(model, SHAKEN)) < 5e-3


def test_a_building_slides_and_tilts_as_in_opensees(tmp_path: Path) -> None:
    """Slab and sliders are a node on OpenSees' own material; the storeys are linear but for their weights."""
    model = ShearBuilding(masses=[2e5, 1.5e5], storey=Linear(k=PerStorey([9e7, 7e7]), c=3e5))
    model = model.with_effect(PDelta(k_geo=PerStorey([3e6, 1e6])))
    slides = SlidingBase(inv_mu=15.0, R_s=1.5, m_s=2e5, W_s=9.81 * 5.5e5, Y_s=0.002, n_s=3.0)
    record = el_centro("chopra", duration=6.0)
    plain, sliding = model, model.with_effect(slides)
    script = script_of(of_model(sliding, record, {}, name="two"))
    path = tmp_path / "two.py"
    path.write_text(script.text, encoding="utf-8")
    found, expected = run_script(path, 400), by_reference(sliding, record)
    assert error(found, expected) < 0.02
    assert error(by_reference(plain, record), expected) > 0.5


def test_friction_by_speed_is_said_to_be_left_out() -> None:
    """The script was exact without it: sliders whose friction grows with speed would have been exported in silence."""
    fast = SlidingBase(inv_mu=15.0, R_s=1.5, m_s=2e5, W_s=9.81 * 5.5e5, Y_s=0.002)
    slower = replace(fast, r_mu=0.4, a_s=30.0)
    model = ShearBuilding(masses=[2e5, 1.5e5], storey=Linear(k=9e7, c=3e5))
    plain, said = (script_of(of_model(model.with_effect(own), SHAKEN, {}, name="x")) for own in (fast, slower))
    assert plain.notes == ()
    assert said.notes == ("Sliders have their friction at speed at every speed; ours have 40 % less near rest.",)


def test_bending_couples_storeys_as_in_opensees(tmp_path: Path) -> None:
    """By springs of its own, one of them negative and past a floor, so that the links' forces are without it."""
    model = ShearBuilding(masses=[2e5, 1.5e5], storey=Linear(k=PerStorey([9e7, 7e7]), c=3e5))
    coupled = model.with_effect(StoreyCoupling(k_bend=5e7))
    script = script_of(of_model(coupled, SHAKEN, {}, name="two"))
    assert script.notes == ("Storey forces in the script are without bending, which has springs of its own.",)
    path = tmp_path / "two.py"
    path.write_text(script.text, encoding="utf-8")
    found, expected, plain = (
        {name: signal for name, signal in histories.items() if not name.startswith("force")}
        for histories in (run_script(path, 40), by_reference(coupled, SHAKEN), by_reference(model, SHAKEN))
    )
    assert error(found, expected) < 0.01
    assert error(plain, expected) > 0.1


def test_a_base_that_hardly_moves_is_said_to_be_taken_for_rigid() -> None:
    model = PLAIN.with_effect(BaseFlexibility(compliance=1e-12, m_b=1e5, c_b=1e5))
    assert script_of(of_model(model, SHAKEN, {}, name="x")).notes == (
        "The base is so stiff that it is taken for rigid.",
    )


def test_sensors_are_said_to_be_left_out() -> None:
    model = PLAIN.with_effect(SensorGain(gain=1.1))
    script = script_of(of_model(model, SHAKEN, {}, name="x"))
    (note,) = script.notes
    assert "belongs to the record" in note
    assert note in " ".join(script.text.split())


def test_a_name_cannot_put_code_into_the_script() -> None:
    """A result file names its model; the name once in a docstring ends it, unless it is escaped."""
    name = '"""\nimport os  # \\'
    text = script_of(of_model(PLAIN, SHAKEN, {}, name=name)).text
    code = compile(text, "script", "exec")
    assert "os" not in code.co_names
    assert code.co_consts[0].startswith('""" import os')


def test_a_missing_value_is_one_sentence() -> None:
    model = ShearBuilding(masses=[1.0], storey=BoucWen(k=Uniform(1, 2), beta=1.0, gamma=1.0))
    with pytest.raises(UserError, match="k missing"):
        of_model(model, SHAKEN, {}, name="x")
