"""Force and displacement counted in opposite directions: told by the work, of laws whose work is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bwbn_bayes.engines.base import require_usable
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Uniform
from bwbn_bayes.records import Record, read_record
from bwbn_bayes.records.directions import require_one_direction
from bwbn_bayes.structures.specimen import Specimen
from bwbn_bayes.structures.starting_model import starting_model

DATA = Path(__file__).parents[3] / "shared" / "data"
OTHERS = (
    "chiu_bracing",
    "clt_connection_spc1",
    "friction_damper_imperial_valley",
    "friction_damper_sine_0p5hz",
    "steel_damper_ganey",
)
MEASURED = (*sorted((DATA / "rc_columns").glob("peer_*.csv")), *(DATA / f"{name}.csv" for name in OTHERS))
PHASE = np.linspace(0.0, 7.3 * np.pi, 400)
"""It ends loaded."""
PATH = 0.01 * PHASE / PHASE[-1] * np.sin(PHASE)
FORCES = {
    "elastic": 1e6 * PATH,
    "elastic, back at zero": 1e6 * np.where(np.arange(400) < 384, PATH, 0.0),
    "elastic, far from zero at the start": 1e6 * PATH + 2e3,
    "softening": 1e4 * np.tanh(PATH / 2e-3) - 6e5 * PATH,
    "dry friction": 5e3 * np.sign(np.gradient(PATH)),
    "a dashpot": 3e5 * np.gradient(PATH, PHASE),
}


def record(force: np.ndarray) -> Record:
    channels = {"force": force + 50.0 * np.random.default_rng(1).standard_normal(len(force))}
    kind = {"excitation_kind": "displacement", "has_time": False}
    return Record(name="test", time_step=1.0, excitation=PATH, channels=channels, **kind)


@pytest.mark.parametrize("law", FORCES)
def test_the_work_tells_the_direction(law: str) -> None:
    """A force counted against its displacement was fitted, and its laws named."""
    require_one_direction(record(FORCES[law]))
    with pytest.raises(UserError, match=r"opposite directions.*: turn one of them by -1 before its unit"):
        require_one_direction(record(-FORCES[law]))


@pytest.mark.parametrize("path", MEASURED, ids=lambda path: path.stem)
def test_measured_tests_count_in_one_direction(path: Path) -> None:
    if not path.exists():
        pytest.skip(f"measured file {path} is not here")
    measured = read_record(path)
    require_one_direction(measured)
    with pytest.raises(UserError, match="opposite directions"):
        require_one_direction(measured.with_channels({"force": -measured.channels["force"]}))


def test_what_does_not_count_tells_nothing() -> None:
    """Forces are erased where they are held out: what is left of an elastic loop may only unload."""
    some = replace(record(FORCES["elastic"]), counted=np.arange(len(PATH)) % 50 < 25)
    require_one_direction(some)


def test_models_and_starting_models_ask_for_it() -> None:
    opposed = record(-FORCES["elastic"])
    for asked in (starting_model, lambda one: require_usable(_specimen(), one)):
        with pytest.raises(UserError, match="opposite directions"):
            asked(opposed)


def _specimen() -> Specimen:
    return Specimen(storey=replace(starting_model(record(FORCES["elastic"])).element, k=Uniform(1e5, 1e7)))


def test_a_column_is_turned_by_its_unit(tmp_path: Path) -> None:
    """As the sentence says, in the header and by a map."""
    rows = "".join(f"{u!r},{-f!r}\n" for u, f in zip(PATH.tolist(), FORCES["softening"].tolist(), strict=True))
    (tmp_path / "header.csv").write_text("displacement [m],force [-1 N]\n" + rows)
    (tmp_path / "map.csv").write_text("displacement [m],force [N]\n" + rows)
    require_one_direction(read_record(tmp_path / "header.csv"))
    require_one_direction(read_record(tmp_path / "map.csv", "displacement [m], force [-1 N]"))
    with pytest.raises(UserError, match="opposite directions"):
        require_one_direction(read_record(tmp_path / "map.csv"))
