"""The command line from end to end: files, exit codes, one sentence for a mistake."""

from __future__ import annotations

import ast
import errno
import io
import json
import math
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from PIL import Image
from rich.console import Console

from bwbn_bayes import Record, Result, read_record, sine
from bwbn_bayes.cli import main
from bwbn_bayes.cli.commands import DISCOVERY_PARTICLES
from bwbn_bayes.cli.console import line_of, parameter_table
from bwbn_bayes.cli.files import write_result
from bwbn_bayes.discovery.run import DiscoverySettings
from bwbn_bayes.elements.catalogue import catalogue
from bwbn_bayes.engines.available import NAMES
from bwbn_bayes.records.readers import write_record
from bwbn_bayes.results import ParameterFacts, StageFacts

MODELS = Path(__file__).parents[1] / "models"
SDOF, PLAIN = MODELS / "sdof.py", MODELS / "plain_three_storey.py"


class Outcome(NamedTuple):
    code: int
    out: str
    err: str


Run = Callable[..., Outcome]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    """Run the command line in this process."""

    def call(*arguments: object) -> Outcome:
        with pytest.raises(SystemExit) as leaving:
            main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return Outcome(int(leaving.value.code or 0), captured.out, captured.err)

    return call


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The record that ``bwbn simulate models/sdof.py`` writes."""
    directory = tmp_path_factory.mktemp("simulated")
    with pytest.raises(SystemExit) as leaving:
        main(["simulate", str(SDOF), "--out", str(directory), "--seed", "3"])
    assert leaving.value.code == 0
    return directory / "sdof.csv"


@pytest.fixture(scope="module")
def identified(simulated: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, str]:
    """Directory, stdout and stderr of one ``bwbn identify`` as a user runs it."""
    directory = tmp_path_factory.mktemp("identified") / "new" / "place"
    command = [sys.executable, "-c", "from bwbn_bayes.cli import main; main()", "identify", str(SDOF)]
    options = ["--record", str(simulated), "--out", str(directory), "--particles", "200", "--seed", "5"]
    done = subprocess.run([*command, *options], capture_output=True, text=True, check=True, timeout=300)
    return directory, done.stdout, done.stderr


def test_the_package_runs_as_a_module() -> None:
    done = subprocess.run([sys.executable, "-m", "bwbn_bayes", "--version"], capture_output=True, text=True, check=True)
    assert version("bwbn-bayes") in done.stdout


def test_identify_writes_every_file_and_nothing_else(identified: tuple[Path, str, str]) -> None:
    names = {path.name for path in identified[0].iterdir()}
    assert names >= {"result.json", "result.nc", "report.html", "acceleration.png", "hysteresis.png", "posterior.png"}
    assert all(Path(name).suffix in {".json", ".nc", ".html", ".png"} for name in names)


def test_result_json_is_schema_1_and_strict(identified: tuple[Path, str, str]) -> None:
    def refuse(constant: str) -> float:
        raise AssertionError(f"{constant} is not JSON")

    facts = json.loads((identified[0] / "result.json").read_text(encoding="utf-8"), parse_constant=refuse)
    assert facts["schema"] == 1
    assert (facts["method"], facts["model"], facts["engine"], facts["seed"]) == ("importance", "sdof", "lanes", 5)
    assert set(facts["parameters"]) == {"k", "c", "alpha", "beta", "gamma", "n", "delta_nu", "delta_eta"}
    k = facts["parameters"]["k"]
    assert (k["true"], k["unit"]) == (40.0, "N/m")
    assert k["hdi90"][0] < k["mean"] < k["hdi90"][1]
    assert abs(k["mean"] - 40.0) < 4.0 * k["sd"]
    assert math.isfinite(facts["log_evidence"])
    assert facts["log_evidence_se"] > 0.0
    # 30 dB of mean square leave 10^(-30/20) of the signal's rms to the noise.
    assert facts["fit"]["nrmse"] == {"acceleration_1": pytest.approx(10.0**-1.5, rel=0.1)}
    assert facts["n_solves"] > 0
    assert facts["n_stages"] > 0
    assert facts["elapsed_s"] > 0.0


def test_result_nc_holds_the_same_facts(identified: tuple[Path, str, str]) -> None:
    result = Result.load(identified[0] / "result.nc")
    facts = json.loads((identified[0] / "result.json").read_text(encoding="utf-8"))
    assert result.facts.as_json() == facts
    assert result.tree["posterior"]["k"].size == 200


def test_results_go_to_stdout_and_the_rest_to_stderr(identified: tuple[Path, str, str]) -> None:
    directory, out, err = identified
    for text in ("delta_eta", "log evidence, importance", f"report: {directory / 'report.html'}"):
        assert text in out
        assert text not in err
    assert "writing the report" in err.splitlines()
    assert not any("\x1b" in text for text in (out, err))


def test_no_number_of_the_table_is_folded_or_cut_on_80_columns() -> None:
    numbers = {"mean": 0.0100462, "sd": 2.5e-05, "hdi90": (0.0100071, 0.0100881), "true": 0.01}
    names = ("alpha", "delta_eta_jump", "delta_s[1,2]")
    facts = [
        ParameterFacts(name=name, symbol=name, unit="N s/m", prior="", flag="prior-bound", **numbers) for name in names
    ]
    console = Console(width=80, file=io.StringIO())
    with console.capture() as capture:
        console.print(parameter_table(facts))
    head, *lines = capture.get().splitlines()
    assert head.split() == ["parameter", "mean", "sd", "90", "%", "from", "to", "true", "unit"]
    cells = ["0.010046", "0.000025", "0.010007", "0.010088", "0.01", "N", "s/m", "prior-bound"]
    assert [line.split() for line in lines] == [[name, *cells] for name in names]


def test_simulate_writes_what_identify_reads(simulated: Path) -> None:
    record = read_record(simulated)
    assert set(record.channels) == {"acceleration_1"}
    assert record.truth["delta_eta"] == 0.4


@pytest.mark.usefixtures("undrawn")
def test_a_starting_model_is_written_and_identified(run: Run, tmp_path: Path) -> None:
    u = np.concatenate([a * np.sin(np.linspace(0.0, 4.0 * np.pi, 81)[1:]) for a in (0.002, 0.01, 0.03)])
    force = 2e5 * np.tanh(u / 0.01) + 1e3 * np.random.default_rng(1).standard_normal(len(u))
    test = Record(
        name="brace", time_step=1.0, excitation=u, excitation_kind="displacement", channels={"force": force},
        has_time=False,
    )  # fmt: skip
    write_record(test, tmp_path / "brace.csv")
    path = tmp_path / "start.py"
    outcome = run("model", tmp_path / "brace.csv", "--out", path)
    assert (outcome.code, outcome.out, outcome.err) == (0, f"{path}\n", "")
    for source in (path, tmp_path / "brace.csv"):
        assert run("identify", source, "--particles", 200, "--out", tmp_path / source.stem).code == 0
    facts = [json.loads((tmp_path / name / "result.json").read_text(encoding="utf-8")) for name in ("start", "brace")]
    assert facts[0]["parameters"] == facts[1]["parameters"] != {}


def test_a_building_s_starting_model_asks_for_its_masses(run: Run, tmp_path: Path) -> None:
    outcome = run("model", MODELS / "hidden_effect.csv", "--out", tmp_path / "start.py")
    assert outcome.code == 0
    assert outcome.err.startswith("Type the mass of each floor")


def test_an_edited_model_file_is_not_overwritten(run: Run, tmp_path: Path) -> None:
    path = _file(tmp_path, "model = 1")
    _is_one_sentence(run("model", MODELS / "hidden_effect.csv", "--out", path), "exists already")
    assert path.read_text(encoding="utf-8") == "model = 1"
    _is_one_sentence(run("model", tmp_path / "none.csv", "--out", tmp_path / "a.py"), "no such file")
    _is_one_sentence(run("model", MODELS / "hidden_effect.csv", "--out", tmp_path / "no" / "a.py"), "cannot be written")


def test_effects_lists_the_catalogue(run: Run) -> None:
    outcome = run("effects")
    assert outcome.code == 0
    assert all(facts.name in outcome.out and facts.equations[0].text in outcome.out for facts in catalogue())


def test_one_effect_is_shown_by_its_name(run: Run) -> None:
    outcome = run("effects", "slip_lock")
    assert outcome.code == 0
    assert outcome.out.startswith("slip_lock")
    assert "gap_impact " not in outcome.out


def test_an_unknown_effect_is_a_user_error(run: Run) -> None:
    outcome = run("effects", "slip")
    assert outcome.code == 2
    assert "effect 'slip' is not in the catalogue: choose one of appendage, asymmetry" in outcome.err


def test_engines_lists_every_engine(run: Run) -> None:
    outcome = run("engines")
    assert outcome.code == 0
    assert [line.split()[0] for line in outcome.out.splitlines()[1:]] == list(NAMES)


def test_help_tells_the_particles_of_a_discovery(run: Run) -> None:
    """Help names the default without loading the settings that hold it, and could fall behind them."""
    assert str(DiscoverySettings.particles) == DISCOVERY_PARTICLES
    assert f"[default: ({DISCOVERY_PARTICLES})" in run("discover", "--help").out


def test_help_keeps_units_in_brackets(run: Run) -> None:
    """They were taken for markup: "ag = ground_acceleration , roof = acceleration_3 "."""
    assert "acceleration_3 [g]" in " ".join(run("discover", "--help").out.replace("│", " ").split())
    assert "[m/s^2]" in run("reproduce", "--help").out


def test_help_waits_for_nothing_that_takes_seconds_to_load() -> None:
    """SymPy, numba, SciPy and Matplotlib were all loaded before a word was printed: 3.3 s of processor."""
    code = (
        "import sys; from bwbn_bayes.cli.commands import app; app(['--help'], standalone_mode=False); "
        "print(sorted({name.partition('.')[0] for name in sys.modules}), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert "discover" in done.stdout
    loaded = set(ast.literal_eval(done.stderr))
    assert not loaded & {"sympy", "numba", "scipy", "matplotlib", "pandas", "xarray", "arviz", "pint", "numpy"}


def test_help_is_not_an_error(run: Run) -> None:
    for arguments in ((), ("--help",), ("identify", "--help")):
        outcome = run(*arguments)
        assert (outcome.code, outcome.err) == (0, "")
        assert "identify" in outcome.out


def _file(directory: Path, text: str) -> Path:
    path = directory / "my_model.py"
    path.write_text(text, encoding="utf-8")
    return path


BAD_MODELS = [
    ("x = 1\n", "does not define `model`"),
    ("model = 3\n", "does not define `model`"),
    ("a = 1\nb = a / 0\n", "line 2: ZeroDivisionError"),
    ("a = 1\nmodel = (\n", "line 2: SyntaxError"),
    ("import sys\nsys.exit(3)\n", "line 2: SystemExit: 3"),
    ("import no_such_module\n", "line 1: ModuleNotFoundError"),
    ("from bwbn_bayes import Uniform\n\nUniform(2, 1)\n", "line 3: Uniform(2, 1)"),
    (SDOF.read_text(encoding="utf-8") + "truth = {'k': 1.0}\n", "`truth`: values of parameters: "),
    (SDOF.read_text(encoding="utf-8") + "truth = [1.0]\n", "`truth` must give a number"),
    (SDOF.read_text(encoding="utf-8") + "excitation = [1.0]\n", "`excitation` must be a Record"),
    (SDOF.read_text(encoding="utf-8") + "snr_db = '30 dB'\n", "`snr_db` is '30 dB'"),
    (SDOF.read_text(encoding="utf-8") + "assumptions = 'one'\n", "`assumptions` must be a list of sentences"),
    # Each of these ended in a traceback, the last ones after the search had begun.
    ("class Odd(BaseException):\n    pass\n\nraise Odd('mine')\n", "line 4: Odd: mine"),
    ("raise GeneratorExit\n", "line 1: GeneratorExit"),
    ("raise KeyboardInterrupt\n", "line 1: KeyboardInterrupt"),
    ("class Mute(Exception):\n    def __str__(self):\n        1 / 0\n\nraise Mute\n", "line 5: Mute: its text cannot"),
    (SDOF.read_text(encoding="utf-8") + "snr_db = -1e6\n", "`snr_db` is '-1e+06'"),
    (SDOF.read_text(encoding="utf-8") + "snr_db = 10**400\n", "`snr_db` is 'beyond all bounds'"),
    (SDOF.read_text(encoding="utf-8") + "snr_db = float('nan')\n", "`snr_db` is 'nan'"),
    (SDOF.read_text(encoding="utf-8") + "truth = dict.fromkeys(truth, 10**5000)\n", "`truth`: k is larger"),
    (
        SDOF.read_text(encoding="utf-8") + "truth = {**truth, 1: 2.0}\n",
        "values of parameters: 1 not identified",
    ),
]


@pytest.mark.parametrize("command", ["identify", "simulate"])
@pytest.mark.parametrize(("text", "sentence"), BAD_MODELS, ids=[sentence for _, sentence in BAD_MODELS])
def test_a_bad_model_file_is_named_with_its_line(
    run: Run, tmp_path: Path, command: str, text: str, sentence: str
) -> None:
    path = _file(tmp_path, text)
    _is_one_sentence(run(command, path, "--out", tmp_path / "out"), str(path), sentence)


BAD_OPTIONS = [
    (("identify", "nowhere.py"), "nowhere.py does not exist"),
    (("identify",), "Missing argument"),
    (("identify", SDOF, "--tempo"), "No such option: --tempo"),
    (("identify", SDOF, "--seed", "-1"), "--seed"),
    (("identify", SDOF, "--seed", "one"), "--seed"),
    (("identify", SDOF, "--particles", "1"), "--particles"),
    (("identify", SDOF, "--method", "guess"), "'guess' is not one of 'importance', 'tmcmc'"),
    (("identify", SDOF, "--engine", "steam"), "'steam' is not one of 'lanes'"),
    (("identify", SDOF, "--record", "nowhere.csv"), "nowhere.csv"),
    (("discover", SDOF, "--held-out", "End"), "--held-out End is neither `end` nor `repeats` nor the file of a record"),
    (("identify", SDOF, "--sequence"), "--sequence is the order of several records: give --record more than once"),
    (("identify", PLAIN), "give one with --record FILE"),
    (("simulate", SDOF, "--sequence"), "--sequence is the order of several records: give --record more than once"),
    (("simulate", PLAIN), "give it with --record FILE"),
    (("dance",), "No such command 'dance'"),
    # Each of these ended in a traceback, or in a refusal only when the work was done.
    (("identify", SDOF, "--particles", 10**12), "--particles"),
    (("discover", SDOF, "--particles", 10**12), "--particles"),
    (("reproduce", "zhao2019", "--particles", 10**12), "--particles"),
    (("reproduce", "zhao2019", "--generations", 10**12), "--generations"),
    (("identify", SDOF, "--out", "o" * 300), "File name too long"),
    (("reproduce", "zhao2019", "--sine-amplitude", "nan"), "amplitude is nan"),
    (("reproduce", "zhao2019", "--sine-frequency", "1e9"), "frequency_hz is 1e+09"),
    (("reproduce", "zhao2019", "--el-centro-scale", "inf"), "El Centro scale is inf"),
    (("identify", SDOF, "--method", "ipv", "--checkpoint", "ck"), "keeps no checkpoint"),
    (("identify", SDOF, "--method", "ga", "--unnamed-force"), "method ga samples no posterior"),
    # Each of these was ignored, and nothing said.
    (("identify", SDOF, "--sampler", "nutpie"), "sampler nutpie says nothing to method importance: leave it out"),
    (("identify", SDOF, "--method", "ipv", "--variant", "plain"), "variant plain says nothing to method ipv"),
    (("model", "--example", "sdof", "--columns", "t = time"), "--columns says what the columns of a RECORD are"),
    (("model", "--examples", "--columns", "t = time"), "and none is given: leave it out"),
    (("model", "--examples", "--out", "x.py"), "--examples lists what there is and writes nothing: leave --out out"),
    (("simulate", "x.csv"), "x.csv is a record: give a model file, Python that defines `model` and its `truth`"),
    (("export", "opensees", "x.AT2"), "x.AT2 is a record: give a model file"),
]


@pytest.mark.parametrize(("arguments", "sentence"), BAD_OPTIONS, ids=[sentence for _, sentence in BAD_OPTIONS])
def test_a_bad_option_is_one_sentence(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[object, ...], sentence: str
) -> None:
    monkeypatch.chdir(tmp_path)
    _is_one_sentence(run(*arguments), sentence)
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("undrawn")
def test_records_of_one_building_are_identified_together(run: Run, simulated: Path, tmp_path: Path) -> None:
    record = read_record(simulated)
    paths = [tmp_path / "first.csv", tmp_path / "second.csv"]
    for path, (start, end) in zip(paths, ((0.0, 8.0), (8.02, 20.0)), strict=True):
        write_record(replace(record.between(start, end), name=path.stem), path)
    several = [option for path in paths for option in ("--record", path)]
    done = run("identify", SDOF, *several, "--sequence", "--particles", "200", "--out", tmp_path / "out")
    assert done.code == 0, done.err
    facts = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
    assert facts["record"] == "first, then second"
    assert list(facts["fit"]["nrmse"]) == ["acceleration_1 of first", "acceleration_1 of second"]
    refused = run("identify", SDOF, *several, "--method", "ga", "--out", tmp_path / "refused")
    _is_one_sentence(refused, "'first and second' joins 2 records", "give one of them")
    shutil.copy(paths[1], tmp_path / "copy.csv")
    twice = run("identify", SDOF, *several, "--record", tmp_path / "copy.csv", "--out", tmp_path / "refused")
    _is_one_sentence(twice, "copy.csv is the measurement of", "second.csv again, which would count twice")
    cyclic = tmp_path / "cyclic.csv"
    cyclic.write_text("displacement [m],force [N]\n" + "".join(f"{x},{x}\n" for x in range(40)), encoding="utf-8")
    mixed = run("identify", SDOF, *several, "--record", cyclic, "--out", tmp_path / "refused")
    _is_one_sentence(mixed, "'first' and 'cyclic' cannot be joined", "driven by displacement")


def test_a_model_file_of_several_excitations_writes_as_many_records(run: Run, tmp_path: Path) -> None:
    done = run("simulate", MODELS / "aftershocks.py", "--engine", "lanes", "--out", tmp_path)
    assert done.out.split() == [str(tmp_path / f"aftershocks_{number}.csv") for number in (1, 2, 3)]
    assert [read_record(path).name for path in done.out.split()] == ["foreshock", "main shock", "aftershock"]


@pytest.mark.parametrize(
    ("old", "new", "sentences"),
    [
        ("acceleration_1", "acceleration_4", ("acceleration_4",)),
        ("acceleration_1 [m/s^2]", "acceleration_1 [s]", ("acceleration_1", "[s]")),
        ("ground_acceleration", "ground_velocity", ("ground_velocity",)),
    ],
)
def test_a_record_that_does_not_fit_is_one_sentence(
    run: Run, simulated: Path, tmp_path: Path, old: str, new: str, sentences: tuple[str, ...]
) -> None:
    path = tmp_path / "record.csv"
    path.write_text(simulated.read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")
    _is_one_sentence(run("identify", PLAIN, "--record", path, "--out", tmp_path / "out"), *sentences)


def test_a_nan_is_named_by_line_and_column(run: Run, simulated: Path, tmp_path: Path) -> None:
    lines = simulated.read_text(encoding="utf-8").splitlines()
    lines[-1] = lines[-1].rsplit(",", 1)[0] + ",nan"
    path = tmp_path / "record.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    outcome = run("identify", SDOF, "--record", path, "--out", tmp_path / "out")
    _is_one_sentence(outcome, f"{path}, line {len(lines)}", "acceleration_1", "nan")


def test_a_refusal_steers_no_terminal(run: Run, simulated: Path, tmp_path: Path) -> None:
    """What a file says is quoted in the sentence that refuses it, an ESC included."""
    path = tmp_path / "record.csv"
    text = simulated.read_text(encoding="utf-8").replace("acceleration_1 [m/s^2]", "acceleration_1 [\x1b[31m/s]", 1)
    path.write_text(text, encoding="utf-8")
    outcome = run("identify", SDOF, "--record", path, "--out", tmp_path / "out")
    _is_one_sentence(outcome, "acceleration_1")
    assert "\x1b" not in outcome.err


def test_a_record_without_channels_is_one_sentence(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "motion.csv"
    write_record(sine(amplitude=1.0, frequency_hz=1.0, duration=5.0, time_step=0.02), path)
    _is_one_sentence(run("identify", SDOF, "--record", path, "--out", tmp_path / "out"), "measures nothing")


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda r: r.with_channels({"acceleration_1": np.full(r.n_times, 3.0)}), "acceleration_1 never changes"),
        (lambda r: replace(r, excitation=np.zeros(r.n_times)), "ground_acceleration never changes"),
        (lambda r: replace(r, excitation=1e200 * r.excitation), "ground_acceleration reaches 3.13e+200 in SI units"),
        (lambda r: Record(name=r.name, time_step=r.time_step, excitation=r.excitation[:8],
                          channels={"acceleration_1": r.channels["acceleration_1"][:8]}), "8 samples: at least 32"),
        (lambda r: r.with_channels({"acceleration_2": r.channels["acceleration_1"]}), "acceleration_2"),
    ],
    ids=["stuck sensor", "no ground motion", "beyond all bounds", "too short", "a floor too many"],
)  # fmt: skip
@pytest.mark.parametrize("method", ["importance", "ga"])
def test_a_record_that_tells_nothing_is_refused_before_the_search(
    run: Run, simulated: Path, tmp_path: Path, change: Callable[[Record], Record], sentence: str, method: str
) -> None:
    path = tmp_path / "record.csv"
    write_record(change(read_record(simulated)), path)
    outcome = run("identify", SDOF, "--record", path, "--method", method, "--out", tmp_path / "new" / "out")
    _is_one_sentence(outcome, sentence)
    assert "fit" not in outcome.err
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda r: replace(r, excitation=1e200 * r.excitation), "ground_acceleration reaches 3.13e+200 in SI units"),
        (lambda r: replace(r, excitation=1e-9 * r.excitation), "ground_acceleration reaches 3.13e-09 in SI units"),
        (lambda r: r.with_channels({"acceleration_1": np.r_[1e300, r.channels["acceleration_1"][1:]]}),
         "acceleration_1 reaches 1e+300 in SI units: mend its unit or its values"),
        (lambda r: r.with_channels({"acceleration_1": np.r_[[1e308, -1e308] * 2, r.channels["acceleration_1"][4:]]}),
         "acceleration_1 reaches 1e+308 in SI units: mend its unit or its values"),
    ],
    ids=["too large", "too small", "one cell", "a range beyond all numbers"],
)  # fmt: skip
@pytest.mark.parametrize("command", ["model", "identify", "discover"])
def test_sizes_that_no_structure_has_are_refused_before_anything_is_computed(
    run: Run, simulated: Path, tmp_path: Path, change: Callable[[Record], Record], sentence: str, command: str
) -> None:
    """A useless model file was written, and NumPy warned of overflows."""
    path = tmp_path / "record.csv"
    write_record(change(read_record(simulated)), path)
    _is_one_sentence(run(command, path, "--out", tmp_path / "new"), "record 'El Centro 1940 (chopra)': ", sentence)
    assert not (tmp_path / "new").exists()


@pytest.mark.usefixtures("undrawn")
def test_figures_of_an_earlier_report_do_not_stay(identified: tuple[Path, str, str], tmp_path: Path) -> None:
    """Another method has other figures; what others put beside them stays."""
    place = tmp_path / "report"
    shutil.copytree(identified[0], place)
    Image.new("RGB", (4, 4)).save(place / "photo.png")
    (place / "broken.png").write_bytes(b"no picture")
    result = Result.load(identified[0] / "result.nc")
    point = Result(tree=result.tree, facts=replace(result.facts, stages=()))
    write_result(point, place)
    kept = {path.name for path in place.glob("*.png")}
    assert {"photo.png", "broken.png", "acceleration.png"} <= kept
    assert "stages.png" in {path.name for path in identified[0].glob("*.png")}
    assert "stages.png" not in kept


def test_the_version_is_that_of_the_package(run: Run) -> None:
    assert run("--version").out == f"bwbn_bayes {version('bwbn-bayes')}\n"


def test_an_out_that_cannot_be_written_is_found_before_the_run(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object, **__: object) -> Record:
        raise AssertionError("the run began")

    monkeypatch.setattr("bwbn_bayes.engines.simulation.simulate", never)
    (tmp_path / "file").write_text("taken", encoding="utf-8")
    for command in ("identify", "simulate"):
        out = tmp_path / "file" / "below"
        _is_one_sentence(run(command, SDOF, "--out", out), f"--out {out} cannot be written")


@pytest.mark.parametrize("place", ["/proc/nowhere/ck", "/dev/full/ck", "/", "o" * 300])
def test_a_checkpoint_that_cannot_be_kept_is_found_before_the_search(
    run: Run, simulated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    """It was found when the search was done, in a traceback."""
    monkeypatch.chdir(tmp_path)
    outcome = run("identify", SDOF, "--record", simulated, "--method", "tmcmc", "--checkpoint", place)
    _is_one_sentence(outcome, f"checkpoint {place}")


def test_a_run_that_fails_leaves_the_old_files_whole(
    run: Run, simulated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_page: str, _drawings: object, directory: Path) -> None:
        (directory / "report.html").write_text("half", encoding="utf-8")
        raise OSError(28, "No space left on device")

    old = tmp_path / "report.html"
    old.write_text("whole", encoding="utf-8")
    monkeypatch.setattr("bwbn_bayes.cli.files.write_page", fail)
    arguments = ("identify", SDOF, "--record", simulated, "--particles", "100", "--out", tmp_path)
    _is_one_sentence(run(*arguments), "No space left on device", after_steps=True)
    assert old.read_text(encoding="utf-8") == "whole"
    assert list(tmp_path.iterdir()) == [old]


def _shown_to(place: object, *arguments: str, closed: bool = False) -> subprocess.CompletedProcess[str]:
    code = f"from bwbn_bayes.cli import main; main({list(arguments)!r})"
    command = ["sh", "-c", f'exec "$@" {">&-" if closed else ""}', "sh", sys.executable, "-c", code]
    return subprocess.run(command, stdout=place, stderr=subprocess.PIPE, text=True, check=False)  # type: ignore[call-overload, no-any-return]


@pytest.mark.parametrize("command", ["--version", "effects"])
def test_what_cannot_be_shown_is_one_sentence(command: str) -> None:
    """A full disk behind `>` ended in sixty lines of traceback."""
    with Path("/dev/full").open("w") as full:
        done = _shown_to(full, command)
    assert done.stderr == (
        "error: what is shown cannot be written (No space left on device): make room, or choose another place\n"
    )
    assert done.returncode == 2


def test_letters_that_a_terminal_lacks_are_question_marks() -> None:
    """The catalogue's Greek ended in a traceback."""
    code = "from bwbn_bayes.cli import main; main(['effects', 'appendage'])"
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, "PYTHONIOENCODING": "ascii"}, capture_output=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"?" in done.stdout


HOMELESS = """
from bwbn_bayes.cli import main
try:
    main(["--version"])
except SystemExit:
    pass
import matplotlib.font_manager
from bwbn_bayes.engines.cache_files import cache_directory
cache_directory()
"""


def test_a_home_that_cannot_be_written_is_one_sentence(tmp_path: Path) -> None:
    """Matplotlib told of it twice besides."""
    kept = {name: it for name, it in os.environ.items() if name not in ("BWBN_CACHE_DIR", "XDG_CACHE_HOME")}
    environment = {**kept, "HOME": "/proc/nowhere", "TMPDIR": str(tmp_path)}
    environment.pop("MPLCONFIGDIR", None)
    done = subprocess.run([sys.executable, "-c", HOMELESS], env=environment, capture_output=True, text=True, check=True)
    assert done.stderr == (
        "compiled kernels cannot be kept in /proc/nowhere/.cache/bwbn_bayes (No such file or directory): "
        f"{tmp_path / f'bwbn_bayes-{os.geteuid()}'} is used instead\n"
    )


@pytest.mark.parametrize(
    ("arguments", "asked"),
    [
        (("simulate", "locked/m.py"), "is_file"),
        (("export", "opensees", "locked/result.nc"), "is_dir"),
        (("batch", "locked"), "iterdir"),
    ],
    ids=lambda value: value if isinstance(value, str) else value[0],
)
def test_what_the_user_may_not_read_is_one_sentence(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], asked: str
) -> None:
    """Asking what a closed folder holds ended in a traceback; root, who runs the tests, may ask."""
    monkeypatch.chdir(tmp_path)
    own = getattr(Path, asked)

    def closed(path: Path, **options: object) -> object:
        if path.parts[:1] == ("locked",):
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return own(path, **options)

    (tmp_path / "locked").mkdir()
    with monkeypatch.context() as patch:
        patch.setattr(Path, asked, closed)
        outcome = run(*arguments)
    _is_one_sentence(outcome, "locked", "Permission denied: ask for the right to it, or give another path")


def test_what_the_user_may_not_write_is_one_sentence(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An example asked a closed folder what it holds; it writes there or says that it may not."""
    monkeypatch.chdir(tmp_path)
    own = Path.open

    def closed(path: Path, *arguments: object, **options: object) -> object:
        if path.parts[:1] == ("locked",):
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return own(path, *arguments, **options)  # type: ignore[call-overload]

    (tmp_path / "locked").mkdir()
    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", closed)
        outcome = run("model", "--example", "sdof", "--out", "locked/m.py")
    _is_one_sentence(outcome, "--out locked/m.py cannot be written (Permission denied): choose another place")


def test_where_nobody_reads_nothing_is_said() -> None:
    """`bwbn engines >&-` ended in a traceback, and so did a reader that closed a pipe."""
    done = _shown_to(None, "engines", closed=True)
    assert (done.stderr, done.returncode) == ("", 0)
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as pipe:
        done = _shown_to(pipe, "--version")
    assert (done.stderr, done.returncode) == ("", 1)


def test_a_fault_of_ours_keeps_its_traceback(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> Record:
        raise RuntimeError("ours")

    monkeypatch.setattr("bwbn_bayes.engines.simulation.simulate", broken)
    with pytest.raises(RuntimeError, match="ours"):
        main(["simulate", str(SDOF), "--out", str(tmp_path)])


def test_a_step_says_stage_tempering_acceptance_and_solves() -> None:
    facts = StageFacts(
        stage=3,
        tempering_parameter=0.0142,
        acceptance=0.4375,
        effective_sample_size=500.0,
        n_solves=8000,
        log_evidence=1.0,
        elapsed_s=2.0,
        label="TMCMC, bridge",
    )
    said = line_of("TMCMC, bridge", facts)
    assert said == "TMCMC, bridge, stage 3, tempering parameter 0.0142, acceptance 0.44, 8000 solves"


def _is_one_sentence(outcome: Outcome, *parts: str, after_steps: bool = False) -> None:
    *before, said = outcome.err.splitlines()
    assert outcome.code == 2
    assert said.startswith("error: ")
    assert "Traceback" not in outcome.err
    assert outcome.out == ""
    for part in parts:
        assert part in said
    assert after_steps or not before


def test_several_given_excitations_are_all_simulated(run: Run, tmp_path: Path) -> None:
    """Of several --record one was used, and nothing was said."""
    several = []
    for i in (1, 2):
        ground = sine(amplitude=3.0 * i, frequency_hz=1.0, duration=4.0, time_step=0.02)
        write_record(replace(ground, name=f"shock {i}"), tmp_path / f"r{i}.csv")
        several += ["--record", tmp_path / f"r{i}.csv"]
    second = []
    for order in ((), ("--sequence",)):
        out = tmp_path / f"out{len(order)}"
        done = run("simulate", SDOF, *several, *order, "--engine", "lanes", "--out", out)
        assert done.out.split() == [str(out / f"sdof_{number}.csv") for number in (1, 2)]
        second.append(read_record(out / "sdof_2.csv").channels["acceleration_1"])
    virgin, damaged = second
    assert np.std(damaged - virgin) > 0.2 * np.std(virgin)
