"""A specimen's record without time: its script knows no seconds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from opensees_runs import error, in_the_limit

from bwbn_bayes import BoucWen, Record, Specimen, UserError, simulate
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
