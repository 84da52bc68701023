"""What an installation without the extras can do, and what it says of the rest."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import bwbn_bayes
from bwbn_bayes import BoucWen, Record, Settings, ShearBuilding, Uniform, UserError, identify
from bwbn_bayes.cli import main
from bwbn_bayes.engines.cvodes import load_library
from bwbn_bayes.errors import EXTRAS

DECLARED = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]

IMPORT_ALL = """
import importlib, pkgutil, sys
for library in sys.argv[1:]:
    sys.modules[library] = None
import bwbn_bayes
for module in pkgutil.walk_packages(bwbn_bayes.__path__, "bwbn_bayes."):
    if not module.name.startswith("bwbn_bayes.inference.pymc.") and module.name != "bwbn_bayes.engines.sunode_problem":
        importlib.import_module(module.name)
for name in bwbn_bayes.__all__:
    if name != "to_pymc":
        getattr(bwbn_bayes, name)
"""


def libraries(extra: str) -> set[str]:
    """What an extra brings, with what the extras it names bring."""
    found: set[str] = set()
    for requirement in DECLARED["optional-dependencies"][extra]:
        own = re.fullmatch(r"bwbn-bayes\[(.*)\]", requirement)
        if own is None:
            found |= {re.split(r"[\[<>=~! ]", requirement)[0]}
        else:
            found |= {library for name in own.group(1).split(",") for library in libraries(name.strip())}
    return found


def test_an_extra_brings_what_its_sentence_promises() -> None:
    """ObsPy has a sentence of its own; ``all`` is every method and engine, without a reader and a cluster."""
    assert {extra: set(needed) for extra, needed in EXTRAS.items()} == {
        extra: libraries(extra) for extra in DECLARED["optional-dependencies"] if extra not in ("all", "obspy")
    }
    assert libraries("all") == {library for extra in EXTRAS if extra != "distributed" for library in EXTRAS[extra]}
    required = {re.split(r"[\[<>=~! ]", requirement)[0] for requirement in DECLARED["dependencies"]}
    assert not required & libraries("all")


SOLVE = """
import sys
sys.modules["numba"] = None
import numpy as np
from bwbn_bayes import BoucWen, ShearBuilding, Uniform, sine
from bwbn_bayes.engines.available import engine
model = ShearBuilding(masses=[1.0], storey=BoucWen(k=Uniform(20, 60), beta=1.0, gamma=1.0))
for name in ("lanes", "scalar", "reference", "cvodes"):
    response, slopes = engine(name).sensitivities(model, np.array([[40.0]]), sine(1.0, 1.0, 0.4, 0.02), ["drift_1"])
    print(name, bool(np.all(np.isfinite(slopes)) and np.any(slopes != 0.0)))
"""


def test_no_engine_needs_numba() -> None:
    """It took seconds for every law, and 33 MB; sunode brings its own."""
    done = subprocess.run([sys.executable, "-c", SOLVE], capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["lanes", "True", "scalar", "True", "reference", "True", "cvodes", "True"]


def test_the_package_is_imported_without_any_extra() -> None:
    """PyMC and pymoo were imported with the package's own modules, so that none ran where one was missing."""
    optional = {library for extra in DECLARED["optional-dependencies"] for library in libraries(extra)}
    command = [sys.executable, "-c", IMPORT_ALL, *sorted(optional)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("library", "settings", "sentence"),
    [
        ("pymoo", Settings(method="ga"), "method ga needs pymoo, which is not installed: add the extra ga"),
        ("pymc", Settings(method="smc"), "method smc needs pymc, which is not installed: add the extra pymc"),
        ("pymc", Settings(method="nuts"), "method nuts needs pymc, which is not installed: add the extra pymc"),
        ("nutpie", Settings(method="nuts", sampler="nutpie"), "sampler nutpie needs nutpie, .*: add the extra nuts"),
        ("sundials4py", Settings(engine="cvodes"), "engine cvodes needs sundials4py, .*: add the extra cvodes"),
    ],
)
def test_a_missing_library_is_told_before_the_search(
    library: str, settings: Settings, sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    load_library.cache_clear()
    storey = BoucWen(k=Uniform(20, 60), c=0.5, alpha=0.05, A=1.0, beta=15.0, gamma=15.0, n=1.2)
    sway = np.sin(np.arange(64))
    record = Record(name="sway", time_step=0.02, excitation=sway, channels={"acceleration_1": 0.1 * sway})
    said: list[str] = []
    with pytest.raises(UserError, match=sentence):
        identify(
            ShearBuilding(masses=[1.0], storey=storey),
            record,
            settings=settings,
            listener=lambda text, _: said.append(text),
        )
    assert not [text for text in said if "mode" in text]


@pytest.mark.parametrize(
    ("library", "command", "options"),
    [
        ("pymoo", "identify", ("--method", "ga")),
        ("pymc", "identify", ("--method", "smc")),
        ("sundials4py", "identify", ("--engine", "cvodes")),
        ("nutpie", "identify", ("--method", "nuts", "--sampler", "nutpie")),
        ("distributed", "identify", ("--scheduler", "tcp://127.0.0.1:9")),
        ("distributed", "discover", ("--scheduler", "tcp://127.0.0.1:9")),
    ],
)
def test_the_command_line_tells_it_before_anything_else(
    library: str,
    command: str,
    options: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """It made the record first, seconds of work, and told what it did."""
    monkeypatch.setitem(sys.modules, library, None)
    load_library.cache_clear()
    with pytest.raises(SystemExit) as leaving:
        main([command, str(Path(__file__).parents[1] / "models" / "sdof.py"), *options])
    (said,) = capsys.readouterr().err.splitlines()
    assert leaving.value.code == 2
    assert f"needs {library}, which is not installed: add the extra" in said


def test_a_missing_pymc_is_told_where_a_joint_model_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pymc", None)
    with pytest.raises(UserError, match="to_pymc needs pymc, which is not installed: add the extra pymc"):
        _ = bwbn_bayes.to_pymc
