"""A search that is stopped: by its time limit, which concludes it, or by a kill, from which it goes on."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from bwbn_bayes.cli import main
from bwbn_bayes.discovery import pace, race, workflow
from bwbn_bayes.discovery.run import DiscoverySettings, Run
from bwbn_bayes.discovery.unfinished import Unfinished
from bwbn_bayes.discovery.workflow import discover
from bwbn_bayes.elements.effects import CubicStiffness, SensorGain
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference import modes
from bwbn_bayes.records.readers import read_record, write_record
from bwbn_bayes.structures.model_file import load_model_file

pytestmark = pytest.mark.usefixtures("undrawn")

FEW = DiscoverySettings(effects=(CubicStiffness, SensorGain), n_workers=1, particles=300)


class KilledError(Exception):
    """Stands for a killed process."""


@dataclass
class Command:
    """``bwbn discover`` as the fixture ``run`` has it, but with two threads, and killed if asked to."""

    inputs: Path
    directory: Path
    heard: list[str] = field(default_factory=list)
    n_fits: int = 0

    def __call__(self, *options: str, killed: bool = False) -> Any:
        """What ``discovery.json`` holds afterwards."""

        def with_two_effects(*arguments, settings, listener, **others):  # type: ignore[no-untyped-def]
            def hear(text, facts):  # type: ignore[no-untyped-def]
                self.heard.append(text)
                listener(text, facts)
                if killed and isinstance(facts, Unfinished):
                    raise KilledError

            settings = replace(settings, effects=FEW.effects, n_workers=2)
            return discover(*arguments, settings=settings, listener=hear, **others)

        def climb(*arguments, own=modes._climb, **others):  # type: ignore[no-untyped-def]
            self.n_fits += 1
            return own(*arguments, **others)

        self.n_fits = 0
        files = ["--record", str(self.inputs / "record.csv"), "--held-out", str(self.inputs / "held_out.csv")]
        out = ["--out", str(self.directory), "--particles", "300"]
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(workflow, "discover", with_two_effects)
            patch.setattr(modes, "_climb", climb)
            patch.setattr(pace, "_EVERY", 0.0)
            with pytest.raises(KilledError if killed else SystemExit):
                main(["discover", str(self.inputs / "one_storey.py"), *files, *out, *options])
        return json.loads((self.directory / "discovery.json").read_text(encoding="utf-8"))


def timeless(found: Any) -> Any:
    """Without seconds."""
    if isinstance(found, dict):
        return {key: timeless(value) for key, value in found.items() if key != "elapsed_s"}
    return [timeless(value) for value in found] if isinstance(found, list) else found


@pytest.fixture
def command(inputs: Path, tmp_path: Path) -> Command:
    return Command(inputs, tmp_path / "out")


@pytest.mark.parametrize("damage", [b"", b"noise after the last entry"])
def test_a_killed_search_goes_on_to_the_same_result(run: Any, command: Command, damage: bytes) -> None:
    """It wrote nothing and began again."""
    whole = json.loads((run.directory / "discovery.json").read_text(encoding="utf-8"))
    first = command(killed=True)
    n_before = command.n_fits
    kept = command.directory / ".unfinished.solves"
    with kept.open("ab") as file:
        file.write(damage)
    second = command("--resume")
    assert timeless(second) == timeless(whole)
    assert (first["finished"], second["finished"], whole["finished"]) == (False, True, True)
    assert not kept.exists()
    n_after = command.n_fits
    # Nothing was fitted twice.
    assert n_before + n_after == run.n_fits
    assert min(n_before, n_after) > 0


def test_what_is_known_is_written_after_each_step(run: Any, command: Command) -> None:
    """With every key of the finished file, of which held-out figures are empty."""
    whole = json.loads((run.directory / "discovery.json").read_text(encoding="utf-8"))
    known = command(killed=True)
    assert known.keys() == whole.keys()
    assert (known["schema"], known["verdict"], known["probabilities"]["cubic_stiffness"] > 0.9) == (
        whole["schema"],
        whole["verdict"],
        True,
    )
    assert known["best_model"].keys() == whole["best_model"].keys()
    assert known["best_model"]["effects"] == whole["best_model"]["effects"]
    assert known["best_model"]["fit"] == pytest.approx(whole["best_model"]["fit"], rel=1e-6)
    assert (known["best_model"]["held_out"], "held_out" in known["gap"]) == (None, False)
    assert timeless(known["steps"]) == timeless(whole["steps"][:1])
    assert known["where"] == whole["where"]


def test_without_resume_it_begins_anew(command: Command) -> None:
    command(killed=True)
    n_fits = command.n_fits
    command(killed=True)
    assert command.n_fits == n_fits
    command("--seed", "2", "--resume", killed=True)  # of another seed: nothing fits, but what no seed moves
    assert command.n_fits > n_fits / 2


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--record", "nowhere.csv"), "no such file"),
        (("--held-out", "nowhere.csv"), "no such file"),
        (("--held-out", "repeats"), "repeats no cycles"),
    ],
    ids=["record", "held out", "repeats"],
)
def test_what_is_refused_forgets_no_unfinished_search(
    inputs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...], sentence: str
) -> None:
    """A held-out file of a wrong name lost hours of fits, before it was told."""
    kept = tmp_path / ".unfinished.solves"
    kept.write_bytes(b"bwbn")
    record = ("--record", str(inputs / "record.csv"))
    with pytest.raises(SystemExit) as leaving:
        main(["discover", str(inputs / "one_storey.py"), *record, *options, "--out", str(tmp_path)])
    assert leaving.value.code == 2
    assert sentence in capsys.readouterr().err
    assert kept.read_bytes() == b"bwbn"


def _refused(command: Command, *options: str) -> None:
    """Another record, of the same name, into the same directory."""
    record = read_record(command.inputs / "record.csv")
    other = command.directory.parent / "record.csv"
    write_record(record.with_channels({name: 1.01 * y for name, y in record.channels.items()}), other)
    arguments = [str(command.inputs / "one_storey.py"), "--record", str(other), "--out", str(command.directory)]
    with pytest.raises(SystemExit) as leaving:
        main(["discover", *arguments, "--particles", "300", *options])
    assert leaving.value.code == 2


def test_resume_does_not_write_over_another_record(command: Command, capsys: pytest.CaptureFixture[str]) -> None:
    """It began anew without a word, and the unfinished search and then the results of the other record were lost."""
    command(killed=True)
    kept = command.directory / ".unfinished.solves"
    before = kept.read_bytes()
    _refused(command, "--resume")
    assert "it holds the unfinished search of another record, or of an older version: give" in capsys.readouterr().err
    assert kept.read_bytes() == before
    known = (command.directory / "discovery.json").read_bytes()
    kept.unlink()
    _refused(command, "--resume")
    assert (
        "holds results of another record, 'El Centro, record', or of an older version: give another --out"
        in capsys.readouterr().err
    )
    (command.directory / "discovery.json").write_bytes(known[:100])
    _refused(command, "--resume")
    assert "discovery.json is damaged and does not say whose results it holds" in capsys.readouterr().err
    assert (command.directory / "discovery.json").read_bytes() == known[:100]


def test_it_is_said_whether_a_search_goes_on(command: Command) -> None:
    """Nothing was said, whatever was kept."""
    kept = command.directory / ".unfinished"
    told = {
        "nothing": f"nothing is kept in {kept}: beginning anew",
        "kept": f"going on from what is kept in {kept}",
        "another": f"{kept} holds a search of this record with another model, seed or version: beginning anew",
        "damaged": f"checkpoint {kept}: its last 12 bytes are damaged or cut off and left out",
    }

    def heard(*options: str) -> set[str]:
        command.heard.clear()
        command(*options, killed=True)
        return {name for name, sentence in told.items() if sentence in command.heard}

    assert heard() == set()
    assert heard("--resume") == {"kept"}
    assert heard("--resume", "--seed", "2") == {"another"}
    with kept.with_suffix(".solves").open("ab") as file:
        file.write(b"twelve bytes")
    assert heard("--resume") == {"kept", "damaged"}
    kept.with_suffix(".solves").unlink()
    assert heard("--resume") == {"nothing"}


def test_what_is_no_checkpoint_is_told(command: Command, capsys: pytest.CaptureFixture[str]) -> None:
    command.directory.mkdir()
    (command.directory / ".unfinished.solves").write_bytes(b"something else altogether")
    _refused(command, "--resume")
    assert ".unfinished.solves is no checkpoint of this version: delete it, or give another" in capsys.readouterr().err


def test_how_far_it_is_is_heard(command: Command) -> None:
    """With nothing there, ``--resume`` begins."""
    command("--resume", killed=True)
    assert any(text.startswith("fitted 1 of 2 hypotheses, about ") for text in command.heard), command.heard


def test_a_time_limit_concludes_what_was_found(inputs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the middle of a stage: one family was fitted, the other was not."""
    fitted: list[str] = []

    def fit(present, family, points, n_iterations, own=race._fit_family):  # type: ignore[no-untyped-def]
        fitted.append(family.members[0].name)
        return own(present, family, points, n_iterations)

    monkeypatch.setattr(race, "_fit_family", fit)
    monkeypatch.setattr(Run, "elapsed", property(lambda _: 60.0 * len(fitted)))
    settings = replace(FEW, time_limit_s=60.0)
    file = load_model_file(inputs / "one_storey.py")
    found = discover(file.model, read_record(inputs / "record.csv"), settings=settings)
    assert len(fitted) == 1
    assert found.stopped
    assert not any(step.sentence.startswith("Asked") for step in found.steps)  # nobody had the time to
    (told,) = [sentence for sentence in found.sentences if "time limit" in sentence]
    assert told.startswith("The search was stopped by the time limit of 60 s, in its first round: ")
    facts = json.loads(json.dumps(found.as_json(), allow_nan=False))
    assert (facts["finished"], facts["stopped_by_time_limit"]) == (True, True)
    assert {h["name"] for one in facts["candidates"] for h in one["effects"]} == set(fitted)
    assert found.result.facts.parameters


def test_a_search_that_the_limit_stopped_goes_on(
    run: Any, command: Command, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = json.loads((run.directory / "discovery.json").read_text(encoding="utf-8"))
    stopped = command("--time-limit", "0.001")
    assert stopped["stopped_by_time_limit"]
    assert "the same command with --resume goes on from there" in capsys.readouterr().err
    # Nothing was asked, and "no catalogued effect explains it" was concluded, with a probability.
    assert (stopped["verdict"], stopped["verdict_probabilities"], stopped["candidates"]) == ("not_searched", {}, [])
    assert stopped["sentences"][0] == (
        "The search was stopped by the time limit before any effect was tried: whether the model lacks something, and "
        "what, is not known."
    )
    assert not any("probabilit" in sentence for sentence in stopped["sentences"])
    page = (command.directory / "report.html").read_text(encoding="utf-8")
    assert "What competes" not in page
    assert "probability of" not in page.split("</header>")[0]
    assert timeless(command("--resume")) == timeless(whole)


@pytest.mark.parametrize(
    "option",
    [{"seed": -1}, {"particles": 0}, {"particles": 2000.5}, {"n_workers": 0}, {"workers": 0}, {"most_effects": -1}],
)
def test_a_count_is_a_whole_number_before_the_search_begins(option: dict[str, Any]) -> None:
    """Too few draws were refused at its end, a seed below zero in a traceback."""
    (name,) = option
    with pytest.raises(UserError, match=rf"^DiscoverySettings: {name} is .*, it must be a whole number from"):
        DiscoverySettings(**option)


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan"), float("inf")])
def test_a_limit_is_a_positive_number(seconds: float) -> None:
    with pytest.raises(UserError, match="give a positive number of seconds"):
        DiscoverySettings(time_limit_s=seconds)


def test_sums_come_out_alike_on_however_many_cores(inputs: Path) -> None:
    """BLAS adds up in other orders on more threads: on one core a measured column had other laws than on two."""
    model, record = load_model_file(inputs / "one_storey.py").model, read_record(inputs / "record.csv")
    threads: dict[str, int] = {}

    def hear(text: str, _: object) -> None:
        threads[text] = max(one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas")

    with threadpool_limits(limits=2, user_api="blas"):
        discover(model, record, settings=FEW, listener=hear)
    for said in ("fitting the model as given", "fitting", "sampling the posterior of the final model"):
        assert {n for text, n in threads.items() if text.startswith(said)} == {1}
