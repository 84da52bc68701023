"""The benchmark of calibration: conditions, wrong models, what cannot be drawn, and its sums."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from benchmarks import calibration as benchmark
from benchmarks.blind.simulator import respond
from benchmarks.calibrating.framing import building_of
from benchmarks.calibrating.outcome import Outcome, draws_of
from benchmarks.calibrating.records import CONDITIONS, Condition, clean, replicate
from benchmarks.calibrating.summary import calibration, wrong
from benchmarks.calibrating.wrong import FORCES, KINDS, force_replicate, wrong_replicate
from benchmarks.calibration import main
from bwbn_bayes import Settings, Uniform
from bwbn_bayes.errors import UserError
from bwbn_bayes.structures.model_file import ModelFile, load_model_file


def filed(name: str) -> ModelFile:
    """A stock model with a ground motion."""
    found = load_model_file(Path(__file__).parents[2] / "models" / f"{name}.py")
    return found if found.excitation is not None else replace(found, excitation=FILE.excitation)


FILE = load_model_file(Path(__file__).parents[2] / "models" / "sdof.py")


def test_a_condition_shapes_the_record() -> None:
    short, near = (replicate(FILE, CONDITIONS[name], 1, 0) for name in ("100 samples", "n near 1"))
    assert short.record.n_times == 100
    assert 1.0 <= near.truth["n"] <= 1.1
    assert near.model.space.parameters[near.model.space.names.index("n")].prior == Uniform(1.0, 1.1)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_wrong_model_can_be_recorded(kind: str) -> None:
    made = wrong_replicate(FILE, kind, 30.0, 1, 0)
    assert set(made.truth) == set(made.model.space.names)
    if kind == "prior excludes c":
        low, high = made.model.space.parameters[made.model.space.names.index("c")].prior.support
        assert not low <= made.truth["c"] <= high


def test_a_wrong_model_is_recorded_with_one_force_in_one_storey() -> None:
    """Another in each case; the record is another than that of the plain building by more than its noise."""
    names = set()
    for number in range(8):
        name, made = force_replicate(FILE, 60.0, 11, number)
        kind, _, storey = name.partition(", ")
        assert kind in FORCES and storey == "storey 1"
        names.add(kind)
        condition = Condition(snr_db=60.0)
        plain = clean(FILE, made.model, made.frame, condition.drive(FILE))["acceleration_1"]
        assert np.std(made.record.channels["acceleration_1"] - plain) > 3e-3 * np.std(plain)
    assert len(names) > 2


def test_the_chain_of_the_wrong_models_is_that_of_the_right_ones() -> None:
    """Two simulators, each with its own integration, of one building."""
    made = replicate(FILE, CONDITIONS["regular"], 1, 0)
    drive = CONDITIONS["regular"].drive(FILE)
    expected = clean(FILE, made.model, made.frame, drive)["acceleration_1"]
    found = respond(building_of(made.model, made.frame), drive.excitation, drive.time_step, 40).measured[0]
    assert np.max(np.abs(found - expected)) < 1e-9 * np.std(expected)


@pytest.mark.parametrize("name", ["three_storey_sine", "isolated_building", "braced_frame", "shaker", "cyclic_test"])
def test_wrong_models_are_chains_under_ground_motion(name: str) -> None:
    with pytest.raises(UserError, match="wrong models are drawn"):
        force_replicate(filed(name), 30.0, 1, 0)


def test_a_chain_without_one_damping_has_no_prior_to_exclude_it() -> None:
    with pytest.raises(UserError, match="no one damping c"):
        wrong_replicate(filed("plain_three_storey"), "prior excludes c", 30.0, 1, 0)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--model", "models/none.py"], "does not exist"),
        (["--condition", "one floor"], "all that can be measured"),
        (["--model", "models/shaker.py", "--condition", "n near 1"], "shaker identifies no n"),
        (["--model", "models/isolated_building.py", "--unnamed-force"], "wrong models are drawn of chains"),
    ],
)
def test_what_cannot_be_drawn_is_told_in_one_sentence(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(Path(__file__).parents[2])
    with pytest.raises(SystemExit) as stopped:
        main([*arguments, "--replicates", "1"])
    said = capsys.readouterr().err
    assert stopped.value.code == 2
    assert sentence in said and said.count("\n") == 1


def test_draws_are_found_by_the_label_of_a_parameter() -> None:
    """Also of one that some storeys share, and of one that not all storeys have: both once raised an error."""
    draws = xr.Dataset(
        {
            "c[1,2]": (("chain", "draw"), [[1.0, 2.0]]),
            "k": (("chain", "draw", "storey_k"), [[[3.0, 4.0], [5.0, 6.0]]]),
            "n": (("chain", "draw"), [[7.0, 8.0]]),
        },
        coords={"storey_k": [2, 3]},
    )
    found = {name: draws_of(draws, name).tolist() for name in ("c[1,2]", "k[3]", "n")}
    assert found == {"c[1,2]": [1.0, 2.0], "k[3]": [4.0, 6.0], "n": [7.0, 8.0]}


def outcome(rank: float, z: float, grade: str) -> Outcome:
    return Outcome(
        method="importance",
        ranks={"k": rank},
        z={"k": z},
        covered={"k": abs(z) < 1.645},
        checks={},
        grade=grade,
        effective=1000.0,
        log_evidence=0.0,
        log_evidence_se=0.0,
        elapsed_s=3.0,
        processor_s=1.0,
    )


def test_sums() -> None:
    rng = np.random.default_rng(1)
    right = [outcome(float(rng.random()), float(rng.standard_normal()), "explains") for _ in range(400)]
    found = calibration(right)
    assert found.coverage_low < 0.9 < found.coverage_high
    assert abs(found.rms_z - 1.0) < 4.0 / np.sqrt(800)
    assert found.rank_p > 0.001
    assert found.held == {"k": round(400 * found.coverage)}
    assert (found.median_s, found.worst_s) == (1.0, 1.0)
    lying = [replace(one, ranks={"k": 0.5 * one.ranks["k"]}) for one in right]
    assert calibration(lying).rank_p < 1e-6
    found_wrong = wrong(
        [outcome(0.5, z, grade) for z, grade in ((9.0, "doubtful"), (5.0, "explains"), (1.0, "refused"))]
    )
    assert (found_wrong.n_misleading, found_wrong.misleading_doubtful, found_wrong.misleading_refused) == (2, 1, 0)
    assert found_wrong.others_refused_or_doubtful == 1


@pytest.mark.parametrize("which", [(), ("--unnamed-force", "--snr", "30")])
def test_a_replicate_is_kept_for_its_code_model_and_settings(
    which: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One of an older version, another file of the name or another number of particles stood for a new one."""
    runs: list[Settings] = []

    def run(_: object, settings: Settings, **__: object) -> Outcome:
        runs.append(settings)
        return outcome(0.2, 0.5, "explains")

    monkeypatch.setattr(benchmark, "run", run)
    model = tmp_path / "sdof.py"
    source = (Path(__file__).parents[2] / "models" / "sdof.py").read_text()
    model.write_text(source)
    asked = ["--model", str(model), "--replicates", "1", "--checkpoint", str(tmp_path / "kept.jsonl"), *which]

    def n_new(*more: str) -> int:
        before = len(runs)
        main([*asked, *more])
        return len(runs) - before

    n_asked = 2 if which else 1
    assert [n_new(), n_new(), n_new("--particles", "500"), n_new()] == [n_asked, 0, n_asked, 0]
    model.write_text(source.replace("Uniform(20, 60)", "Uniform(20, 70)", 1))
    assert [n_new(), n_new()] == [n_asked, 0]
    monkeypatch.setattr(benchmark, "package_version", lambda: "another")
    assert n_new() == n_asked


def test_a_truth_that_cannot_be_identified_is_counted_and_ends_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def refusing(*_: object, **__: object) -> None:
        raise UserError("no draw could be solved")

    monkeypatch.setattr(benchmark, "identify", refusing)
    refused = benchmark.run(replicate(FILE, CONDITIONS["regular"], 1, 0), Settings(particles=100))
    row = calibration([outcome(0.2, 0.5, "explains"), refused, outcome(0.7, 2.0, "explains")])
    assert row.n_replicates == 3
    assert row.coverage == 0.5
    assert row.grades == {"explains": 2, "not identified": 1}
    assert row.methods == {"importance": 2, "none": 1}
    with pytest.raises(UserError, match="none was identified"):
        calibration([refused])
