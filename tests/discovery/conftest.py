"""One run of ``bwbn discover`` on a hidden cubic stiffness, kept whole: files, what was printed, the Discovery."""

from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path

import pytest

from bwbn_bayes.cli import main
from bwbn_bayes.discovery import workflow
from bwbn_bayes.discovery.outcome import Discovery
from bwbn_bayes.discovery.workflow import discover
from bwbn_bayes.elements.effects import CubicStiffness, SensorGain
from bwbn_bayes.engines.simulation import simulate
from bwbn_bayes.inference import modes
from bwbn_bayes.records.excitation import el_centro
from bwbn_bayes.records.readers import write_record
from bwbn_bayes.structures.model_file import load_model_file

MODEL = '''"""One storey."""

from bwbn_bayes import BoucWen, ShearBuilding, Uniform

model = ShearBuilding(
    masses=[2.0],  # kg
    storey=BoucWen(
        k=Uniform(20, 120), c=Uniform(0.01, 2), alpha=Uniform(0.01, 0.5), beta=Uniform(0.5, 40), gamma=2.0, n=1.3
    ),
)
'''
TRUTH = {"k": 60.0, "c": 0.4, "alpha": 0.15, "beta": 12.0}
K3 = 900.0
"""At the largest drift, 0.16 m, the cubic spring carries about as much as the storey's elastic one. [N/m^3]"""


@dataclass(frozen=True)
class Run:
    """A finished run of the command."""

    discovery: Discovery
    k3: float
    """The hidden value. [N/m^3]"""
    directory: Path
    code: int
    out: str
    err: str
    n_fits: int
    """How often the search climbed."""


@pytest.fixture(scope="session")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory with a model file, a record of it with a cubic spring, and one under another ground motion."""
    directory = tmp_path_factory.mktemp("inputs")
    (directory / "one_storey.py").write_text(MODEL, encoding="utf-8")
    hidden = load_model_file(directory / "one_storey.py").model.with_effect(CubicStiffness(k3=K3))
    for name, version, seed in (("record", "chopra", 1), ("held_out", "rsn6_180", 2)):
        made = simulate(hidden, el_centro(version, duration=12.0), TRUTH, snr_db=30.0, seed=seed)
        write_record(replace(made, name=f"El Centro, {name}", truth={}), directory / f"{name}.csv")
    return directory


@pytest.fixture(scope="session")
def run(inputs: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """``bwbn discover`` with a catalogue of two effects, to be quick."""
    directory = tmp_path_factory.mktemp("discovered") / "new"
    kept: list[Discovery] = []
    climbed: list[int] = []

    def with_two_effects(*arguments, settings, **options):  # type: ignore[no-untyped-def]
        settings = replace(settings, effects=(CubicStiffness, SensorGain), n_workers=1)
        kept.append(discover(*arguments, settings=settings, **options))
        return kept[0]

    def climb(*arguments, own=modes._climb, **options):  # type: ignore[no-untyped-def]
        climbed.append(1)
        return own(*arguments, **options)

    out, err = StringIO(), StringIO()
    files = ["--record", str(inputs / "record.csv"), "--held-out", str(inputs / "held_out.csv")]
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr(workflow, "discover", with_two_effects)
        patch.setattr(modes, "_climb", climb)
        with pytest.raises(SystemExit) as leaving:
            main(["discover", str(inputs / "one_storey.py"), *files, "--out", str(directory), "--particles", "300"])
    code = int(leaving.value.code or 0)
    return Run(kept[0], K3, directory, code, out.getvalue(), err.getvalue(), len(climbed))
