"""A specimen's record without time: its script knows no seconds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from opensees_runs import error, in_the_limit

from bwbn_bayes import (
    BoucWen,
    CubicStiffness,
    FolientePinching,
    PDelta,
    Record,
    SlipLock,
    Specimen,
    StrengthDegradation,
    UserError,
    simulate,
)
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.export import of_model, script_of
from bwbn_bayes.records.readers import read_record

SPRING = {"k": 8e7, "alpha": 0.05, "u_y": 0.008, "rho": 0.6, "n": 1.7}
CYCLES = np.linspace(0.0, 4.0, 321)
PATH = Record(
    name="path",
    time_step=1.0,
    has_time=False,
    excitation=0.03 * np.sin(2.0 * np.pi * CYCLES) * CYCLES / 4.0,
    excitation_kind="displacement",
)


def test_the_script_of_a_path_knows_no_seconds(tmp_path: Path) -> None:
    """Points stood 1 s apart in it, and its CSV had a column of time, which was read back as one."""
    model = Specimen(storey=BoucWen(c=0.0, **SPRING))
    script = script_of(of_model(model, PATH, {}, name="specimen"))
    assert "TIME_STEP" not in script.text and "[s]" not in script.text and "m/s" not in script.text
    truth = {"force": np.array(simulate(model, PATH, {}).channels["force"])}
    *_, limit = in_the_limit(script, tmp_path, substeps=10)
    assert error(limit, truth) < 1e-3
    assert not read_record(tmp_path / "written.csv").has_time


def test_a_record_with_time_keeps_it() -> None:
    timed = replace(PATH, has_time=True, time_step=0.05)
    script = script_of(of_model(Specimen(storey=BoucWen(c=1e3, **SPRING)), timed, {}, name="specimen"))
    assert (
        f"TIME_STEPS = [0.05] * {timed.n_times - 1}  # s" in script.text and '"time [s],displacement [m]' in script.text
    )


def test_a_rate_needs_time() -> None:
    with pytest.raises(UserError, match=r"The specimen has a part that depends on the drift rate \(Viscous\)"):
        script_of(of_model(Specimen(storey=BoucWen(c=1e3, **SPRING)), PATH, {}, name="specimen"))


PINCH = FolientePinching(zeta_s=0.8, p=2e-5, q=0.2, psi_0=0.005, delta_psi=0.0, lambda_=0.3)
BEGUN = replace(PATH, excitation=PATH.excitation + 0.01)


@pytest.mark.parametrize(
    "effects",
    [(), (StrengthDegradation(delta_nu=2e-6),), (PINCH,), (CubicStiffness(k3=2e10), PDelta(k_geo=3e6))],
    ids=["spring", "loss", "pinch", "beside"],
)
def test_a_record_may_begin_anywhere(effects: tuple[Effect, ...], tmp_path: Path) -> None:
    """The script strained its materials from zero to the first displacement: 5.5 % of the force of the spring alone."""
    model = Specimen(storey=BoucWen(c=0.0, **SPRING))
    for effect in effects:
        model = model.with_effect(effect)
    truth = {"force": np.array(simulate(model, BEGUN, {}).channels["force"])}
    *_, limit = in_the_limit(script_of(of_model(model, BEGUN, {}, name="specimen")), tmp_path, substeps=20)
    assert error(limit, truth) < 1e-3
    assert limit["force"][0] == pytest.approx(truth["force"][0], rel=1e-9)


def test_a_dashpot_takes_the_slope_that_begins(tmp_path: Path) -> None:
    """It took that of the segment before: 1e8 N s/m at 0.1 m/s."""
    timed = replace(BEGUN, has_time=True, time_step=0.05)
    model = Specimen(storey=BoucWen(c=1e7, **SPRING))
    truth = {"force": np.array(simulate(model, timed, {}).channels["force"])}
    *_, limit = in_the_limit(script_of(of_model(model, timed, {}, name="specimen")), tmp_path, substeps=20)
    assert error(limit, truth) < 1e-3


def test_a_fit_begins_where_the_record_does(tmp_path: Path) -> None:
    """Its error is what OpenSees itself misses."""
    model = Specimen(storey=BoucWen(c=0.0, **SPRING)).with_effect(SlipLock(delta_s=4e-8, sigma=0.004))
    script = script_of(of_model(model, BEGUN, {}, name="specimen"))
    *_, limit = in_the_limit(script, tmp_path, substeps=20)
    truth = {"force": np.array(simulate(model, BEGUN, {}).channels["force"])}
    (link,) = script.links
    assert link.error is not None
    assert link.error < 0.05
    assert error(limit, truth) == pytest.approx(link.error, rel=0.3)
