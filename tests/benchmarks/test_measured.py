"""Data, splits, filing and tables of the benchmark on measured tests; nothing here runs a discovery."""

from __future__ import annotations

import io
import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from benchmarks import measured
from benchmarks.measured_tests.discovering import Answer, Effect, Kin, read_answer, says_pinched
from benchmarks.measured_tests.filing import file_result, filed, identity, is_current, keep, shown_response
from benchmarks.measured_tests.gallery import draw_gallery
from benchmarks.measured_tests.page import write_page
from benchmarks.measured_tests.specimens import DATA, Label, MeasuredTest, load, names, nrmse, parted, read_frame
from benchmarks.measured_tests.tables import (
    in_per_cent,
    in_words,
    label_row,
    label_sums,
    names_in_words,
    repeat_row,
    repeat_sums,
    row,
    sums,
)
from benchmarks.running import code_version
from bwbn_bayes import Record, UserError

FRAME = """\
# time_step: 0.015625
table_acceleration [g],base_displacement [inch],floor_1 [inch],floor_2 [inch],floor_3 [inch]
"""


def cyclic(n_cycles: int = 8, per_cycle: int = 40, name: str = "loops") -> Record:
    t = np.arange(n_cycles * per_cycle + 1) / per_cycle
    u = 0.01 * np.sin(2.0 * np.pi * t)
    v = np.cos(2.0 * np.pi * t)
    return Record(
        name=name, time_step=1.0, excitation=u, excitation_kind="displacement", has_time=False,
        channels={"force": 1e3 * (u / 0.01 + 0.5 * np.tanh(5.0 * v))},
    )  # fmt: skip


def measured_test(name: str = "loops") -> MeasuredTest:
    return MeasuredTest(name=name, record=cyclic(name=name), n_fitted=200, rule="parting_time")


def here() -> None:
    if not DATA.is_dir():
        pytest.skip(f"measured data {DATA} are not here")


def test_every_measured_test_is_listed():
    here()
    listed = names()
    assert len(listed) == len(set(listed)) == 31
    assert sum(name.startswith("peer_") for name in listed) == 24


def test_a_column_comes_with_its_label():
    here()
    column = load("peer_336")
    assert column.label is not None
    assert (column.label.loops, column.label.failure, column.label.zero_force_ratio) == ("pinched", "Shear", 0.058)
    assert column.record.n_times == 801
    assert column.training.n_times == column.n_fitted


def test_a_frame_moves_relative_to_its_base():
    here()
    test = load("frame_small")
    raw = np.genfromtxt(DATA / "shake_table_frame" / "fbgm152s1.csv", delimiter=",", skip_header=3)
    assert test.is_frame
    assert list(test.record.channels) == ["displacement_1", "displacement_2", "displacement_3"]
    assert test.record.measured == pytest.approx(0.0254 * (raw[:, 2:].T - raw[:, 1]), abs=1e-15)
    assert test.record.excitation == pytest.approx(9.80665 * raw[:, 0])
    assert test.record.time_step == 1 / 64


def test_missing_data_are_said_in_one_sentence(tmp_path):
    with pytest.raises(UserError, match=r"index.csv: no such file, the measured tests are read from"):
        names(tmp_path)


def test_a_name_that_is_not_there_is_said(tmp_path):
    (tmp_path / "rc_columns").mkdir()
    (tmp_path / "rc_columns" / "index.csv").write_text("file,loops,zero_force_ratio,last_peak_ratio,failure,name\n")
    with pytest.raises(UserError, match="there is no measured test 'nothing'"):
        load("nothing", tmp_path)
    with pytest.raises(UserError, match=r"chiu_bracing.csv: no such file"):
        load("chiu_bracing", tmp_path)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("displacement [mm],force [kN]\n0,0\n", "this is no shake-table run"),
        (FRAME.removeprefix("# time_step: 0.015625\n"), "this is no shake-table run"),
        (f"{FRAME}0,0,0,x,0\n", "a cell is not a number"),
    ],
)
def test_a_wrong_frame_file_is_said(tmp_path, text, sentence):
    path = tmp_path / "frame.csv"
    path.write_text(text)
    with pytest.raises(UserError, match=sentence):
        read_frame(path)


def test_equal_cycles_are_parted_by_the_package():
    record = cyclic()
    n_fitted, rule = parted(record)
    assert rule == "parting_time"
    assert 0.5 * record.n_times <= n_fitted <= 0.85 * record.n_times + 1


def test_where_the_end_is_weak_the_path_parts():
    # A strong first quarter, then almost nothing: no end moves like the whole, 30 % of the path are held out.
    t = np.arange(400)
    u = np.where(t < 100, 1.0, 0.01) * np.sin(2.0 * np.pi * t / 20.0)
    record = Record(
        name="weak end", time_step=1.0, excitation=u, excitation_kind="displacement", has_time=False,
        channels={"force": 100.0 * u},
    )  # fmt: skip
    n_fitted, rule = parted(record)
    assert rule == "path"
    moved = np.abs(np.diff(u))
    assert moved[: n_fitted - 1].sum() == pytest.approx(0.7 * moved.sum(), abs=moved.max())
    assert moved[: n_fitted - 1].sum() >= 0.7 * moved.sum()


def test_error_in_per_cent():
    # Channels count alike: 10 % of one and none of the other are 10/sqrt(2).
    truth = np.array([[1.0, -1.0], [20.0, 20.0]])
    assert nrmse(truth, truth * [[1.1], [1.0]]) == pytest.approx(10.0 / np.sqrt(2.0))
    assert nrmse([1.0, 2.0], [1.0, np.nan]) == np.inf


SCHEMA_1 = {
    "schema": 1, "verdict": "effects_found", "elapsed_s": 3.0,
    "effects": [{"name": "slip_lock", "storeys": [1], "log_bayes_factor": 9.0}],
    "gap": {"fit": {"before": 0.3, "after": 0.1}, "held_out": {"before": 0.4, "after": 0.2}},
}  # fmt: skip
SCHEMA_2 = {
    "schema": 2, "verdict": "partly_explained", "elapsed_s": 3.0,
    "verdict_probabilities": {"partly_explained": 0.8, "effects_found": 0.2},
    "effects": [
        {"name": "slip_lock", "storeys": [], "probability": 0.95,
         "signature": {"measure": "pinching index", "measured": 0.1, "identified": {"mean": 0.3}}},
        {"name": "strength_degradation", "storeys": [], "probability": 0.6},
    ],
    "best_model": {"effects": ["slip_lock"], "fit": 0.09, "held_out": 0.19, "cross_validated": 0.1},
    "gap": {"fit": {"before": 0.3, "after": 0.1}, "held_out": {"before": 0.4, "after": 0.2}},
}  # fmt: skip


def test_an_answer_without_probabilities_is_read():
    answer = read_answer(SCHEMA_1)
    assert answer == Answer(
        verdict="effects_found", probability=None, fit=pytest.approx(10.0), held_out=pytest.approx(20.0), seconds=3.0,
        effects=(Effect(name="slip_lock", storeys=(1,), probability=None, identified=None),), families=(),
    )  # fmt: skip
    assert read_answer({**SCHEMA_1, "gap": {"fit": {"before": 0.3, "after": None}}}).fit is None


def test_an_answer_with_probabilities_is_read():
    answer = read_answer(SCHEMA_2)
    assert (answer.verdict, answer.probability) == ("partly_explained", 0.8)
    assert (answer.fit, answer.held_out) == (pytest.approx(9.0), pytest.approx(19.0))
    assert [(one.probability, one.identified) for one in answer.effects] == [(0.95, 0.3), (0.6, None)]
    assert in_words(answer) == "partly_explained 0.80: slip_lock 0.95, strength_degradation 0.60"
    assert in_words(read_answer(SCHEMA_1)) == "effects_found: slip_lock[1]"


def test_a_family_is_told_where_none_of_it_is_named():
    loss = {
        "title": "a loss of strength or stiffness", "probability": 0.98, "log_bayes_factor": 208.0,
        "names": ["stiffness_degradation", "strength_degradation"],
    }  # fmt: skip
    told = names_in_words(read_answer({**SCHEMA_2, "families": [loss]}))
    assert told == "slip_lock (0.95), a loss of strength or stiffness (0.98), possibly strength_degradation (0.60)"
    kin = {**loss, "names": ["slip_lock", "strength_degradation"]}
    assert "loss" not in names_in_words(read_answer({**SCHEMA_2, "families": [kin]}))
    assert "loss" not in names_in_words(read_answer({**SCHEMA_2, "families": [{**loss, "probability": 0.8}]}))


@pytest.mark.parametrize(
    ("name", "probability", "signature", "loop", "said"),
    [
        ("slip_lock", 0.95, 0.1, 0.5, True),
        ("foliente_pinching", None, None, 0.2, True),
        ("slip_lock", 0.85, 0.1, 0.1, False),  # possible, not named
        ("slip_lock", 0.95, 0.3, 0.1, False),  # a law that helps, a loop that is not pinched
        ("slip_lock", None, None, None, False),
        ("strength_degradation", 0.99, 0.1, 0.1, False),
    ],
)
def test_what_counts_as_pinched(name, probability, signature, loop, said):
    effect = Effect(name=name, storeys=(), probability=probability, identified=signature)
    answer = Answer(
        verdict="effects_found", probability=None, effects=(effect,), families=(), fit=1.0, held_out=1.0, seconds=1.0
    )
    assert says_pinched(answer, loop) is said


@pytest.mark.parametrize(
    ("names", "probability", "loop", "said"),
    [
        (("foliente_pinching", "slip_lock"), 0.95, 0.2, True),
        (("foliente_pinching", "slip_lock"), 0.85, 0.2, False),
        (("foliente_pinching", "slip_lock"), 0.95, 0.3, False),
        (("stiffness_degradation", "strength_degradation"), 0.95, 0.2, False),
    ],
)
def test_either_pinch_counts_as_pinched(names, probability, loop, said):
    kin = Kin(title="one or the other", names=names, probability=probability)
    answer = Answer(
        verdict="effects_found", probability=None, effects=(), families=(kin,), fit=1.0, held_out=1.0, seconds=1.0
    )
    assert says_pinched(answer, loop) is said


def test_a_version_is_that_of_what_the_code_does(tmp_path):
    path = tmp_path / "law.py"
    path.write_text('"""One."""\n\nx = 1  # why\n"""What x is."""\n\n\ndef f():\n    """Two."""\n    return x\n')
    first = code_version([path])
    path.write_text("x = 1\n\ndef f(): return x\n")
    assert code_version([path]) == first
    path.write_text("x = 2\n\ndef f(): return x\n")
    assert code_version([path]) != first


def entry(test: MeasuredTest, what: str, result: dict[str, Any], code: str = "a") -> dict[str, Any]:
    shown = shown_response(test, test.record.measured)
    return {"identity": identity(test, what, code, 1), "result": result, "shown": shown, "seconds": 1.0}


def test_what_is_filed_counts_for_its_code_data_and_split(tmp_path):
    test, path = measured_test(), tmp_path / "log.jsonl"
    file_result(path, entry(test, "bwbn", {"errors": [10.0, float("inf")]}))
    with path.open("a") as file:
        file.write('{"identity": {"na')  # broken off
    file_result(path, {"identity": identity(test, "pinching4", "a", 1), "error": "ValueError: no"})
    found = filed(path)
    assert found["loops", "bwbn"]["result"] == {"errors": [10.0, None]}
    assert is_current(found["loops", "bwbn"], identity(test, "bwbn", "a", 1))
    assert not is_current(found["loops", "bwbn"], identity(test, "bwbn", "b", 1))
    assert not is_current(found["loops", "pinching4"], identity(test, "pinching4", "a", 1))
    assert not is_current(None, identity(test, "bwbn", "a", 1))
    other = MeasuredTest(name="loops", record=test.record, n_fitted=201, rule="path")
    assert not is_current(found["loops", "bwbn"], identity(other, "bwbn", "a", 1))


def discovered(answer: dict[str, Any], errors: list[float]) -> dict[str, Any]:
    return {"facts": {**answer, "errors": errors}}


def test_a_row_holds_the_better_competitor_of_each_part():
    test = measured_test()
    entries = {
        "bwbn": entry(test, "bwbn", {"errors": [8.0, 30.0]}),
        "pinching4": entry(test, "pinching4", {"errors": [12.0, None]}),
        "discover": entry(test, "discover", discovered(SCHEMA_2, [9.5, 20.0])),
    }
    found = row(test, entries)
    assert found.best == (8.0, 30.0)
    assert found.ours == (pytest.approx(9.0), pytest.approx(19.0))
    assert (found.fits, found.predicts, found.is_hopeless) == (False, True, False)
    assert in_per_cent(found.competitors["pinching4"]) == "12.0 / runs away"
    assert [total["count"] for total in sums([found])] == [0, 1, 0, 0, 0]


def test_each_law_is_counted_beside_the_best_of_the_others():
    test = measured_test()
    entries = {
        "bwbn": entry(test, "bwbn", {"errors": [8.0, 20.0]}),
        "pinching4": entry(test, "pinching4", {"errors": [12.0, 23.0]}),
        "discover": entry(test, "discover", discovered(SCHEMA_2, [9.5, 20.0])),
    }
    found = row(test, entries)
    # 19 beside 20, 20 beside 19 and 23 beside 19, a tenth more allowed.
    assert [found.keeps_up(what) for what in ("discover", "bwbn", "pinching4")] == [True, True, False]
    assert found.keeps_up("linear_chain") is None
    told = {total["what"]: (total["count"], total["total"]) for total in sums([found])}
    assert told["the same of BWBN beside the better of the other and discover"] == (1, 1)
    assert told["the same of Pinching4 beside the better of the other and discover"] == (0, 1)
    del entries["discover"]
    assert row(test, entries).keeps_up("bwbn") is True


def test_a_prediction_that_runs_away_keeps_up_with_none():
    """All ran away, and each counted as predicting what it should."""
    ran_away = {**SCHEMA_2, "best_model": {"effects": [], "fit": 0.09, "held_out": None}}
    entries = {
        "bwbn": entry(measured_test(), "bwbn", {"errors": [8.0, None]}),
        "pinching4": entry(measured_test(), "pinching4", {"errors": [None, None]}),
        "discover": entry(measured_test(), "discover", discovered(ran_away, [9.5, None])),
    }
    found = row(measured_test(), entries)
    assert [found.keeps_up(what) for what in entries] == [False, False, False]


def test_a_failure_is_told_and_counts_nowhere():
    test = measured_test()
    failed = {"identity": identity(test, "bwbn", "a", 1), "error": "ValueError: no"}
    found = row(test, {"bwbn": failed})
    assert found.failed == ("bwbn: ValueError: no",)
    assert (found.best, found.fits, found.predicts) == (None, None, None)


def test_on_a_split_by_path_the_identified_response_is_judged():
    test = MeasuredTest(name="loops", record=cyclic(), n_fitted=200, rule="path")
    answer = {**SCHEMA_2, "best_model": {"effects": [], "fit": 0.09, "held_out": None}, "gap": {"fit": {"after": 0.1}}}
    found = row(test, {"discover": entry(test, "discover", discovered(answer, [9.5, 20.0]))})
    assert found.ours == (pytest.approx(9.0), 20.0)


def whole_entry(test: MeasuredTest, index: float, strength: float) -> dict[str, Any]:
    loops = {
        "pinching_index": {"measured": 0.1, "identified": index},
        "strength_lost": {"measured": 0.06, "identified": strength},
    }
    return entry(test, "whole", {"facts": {**SCHEMA_1, "errors": [9.0, None], "loops": loops}})


def test_labels_are_counted():

    rows = []
    for loops, index, strength in (("pinched", 0.2, 0.07), ("pinched", 0.3, 0.1), ("fat", 0.24, 0.05)):
        label = Label(loops=loops, zero_force_ratio=0.1, failure="Shear")
        test = MeasuredTest(name=loops, record=cyclic(), n_fitted=200, rule="path", label=label)
        rows.append(label_row(test, whole_entry(test, index, strength)))
    totals = label_sums(rows)
    assert [(total["count"], total["total"]) for total in totals] == [(1, 2), (1, 1), (2, 3), (2, 3)]
    assert "median error 0.14" in totals[2]["what"]
    totals = label_sums(rows, ["fat", "pinched"])
    assert [(total["count"], total["total"]) for total in totals] == [(1, 3), (2, 2), (2, 5), (2, 5)]


def test_a_whole_record_that_failed_is_on_the_page_and_in_every_sum(tmp_path):
    test, _ = labelled("one", "fat", 0.2, 0.07, "abc1234")
    broken = {"error": "ValueError: no", "identity": {"code": "a", "name": "one"}}
    _, labels, _, facts = measured.gather([test], {("one", "whole"): broken})
    assert labels == []
    write_page(json.loads(json.dumps(facts)), {}, tmp_path / "page.md")
    page = (tmp_path / "page.md").read_text()
    assert "- one, whole: ValueError: no" in page
    assert "| pinched said of the fat, or failed | <= 1 of 12 | 1 of 1 |" in page


def labelled(name: str, loops: str, index: float, strength: float, commit: str) -> tuple[MeasuredTest, dict[str, Any]]:
    label = Label(loops=loops, zero_force_ratio=0.1, failure="Shear")
    test = MeasuredTest(name=name, record=cyclic(name=name), n_fitted=200, rule="path", label=label)
    found = {**whole_entry(test, index, strength), "commit": commit, "seconds": 61.4, "processor": "Some CPU"}
    found["identity"] = {**found["identity"], "code": f"code of {commit}"}
    signature = {"measure": "pinching index", "identified": {"mean": index, "low": 0.05, "high": 0.25}}
    effects = [
        {"name": "slip_lock", "storeys": [1], "probability": 0.999, "signature": signature},
        {"name": "coulomb_friction", "storeys": [1], "probability": 0.61, "signature": None},
        {"name": "gap_impact", "storeys": [1], "probability": 0.2, "signature": None},
    ]
    found["result"]["facts"] |= {"effects": effects, "unnamed_force": {"share": 0.16}}
    return test, found


def test_whole_records_are_on_the_page_with_names_intervals_seconds_and_versions(tmp_path):
    made = [labelled("one", "pinched", 0.2, 0.07, "abc1234"), labelled("two", "fat", 0.5, 0.06, "def5678")]
    tests = [*(test for test, _ in made), labelled("three", "fat", 0.5, 0.06, "")[0]]
    *_, facts = measured.gather(tests, {(test.name, "whole"): entry for test, entry in made})
    write_page(json.loads(json.dumps(facts)), {}, tmp_path / "page.md")
    page = (tmp_path / "page.md").read_text()
    (row,) = [line for line in page.splitlines() if line.startswith("| one |")]
    assert [cell.strip() for cell in row.strip("|").split("|")] == [
        "one", "pinched", "pinched", "10.0 %", "16 %", "slip_lock (> 0.99), possibly coulomb_friction (0.61)",
        "0.100", "0.200", "0.050 to 0.250", "0.060", "0.070", "61",
    ]  # fmt: skip
    assert "| pinched said of the pinched | >= 10 of 12 | 1 of 1 |" in page
    assert "| `discover`, whole record | `abc1234` | `code of abc1234` | one |" in page
    assert "| `discover`, whole record | `def5678` | `code of def5678` | two |" in page
    assert "- `discover`, whole record: not run on three." in page
    assert "on Some CPU." in page
    assert "| three |" not in page
    assert "## The first part" not in page


def test_a_run_is_filed_resumed_drawn_and_written(tmp_path):
    runs = []

    def run(test):
        runs.append(test.name)
        if test.name == "bad":
            raise ValueError("no")
        return {"errors": [1.0, 2.0]}, test.record.measured

    log = tmp_path / "out.competitors.jsonl"
    trial = measured.Trial(what="bwbn", code="a", seed=1, log=log, run=run)
    tests = [measured_test(), measured_test("bad")]
    console = Console(file=io.StringIO(), width=120)
    for _ in range(2):
        measured.run_trials([trial], tests, console)
    assert runs == ["loops", "bad", "bad"]
    entries = filed(log)
    rows, labels, repeated, facts = measured.gather(tests, entries)
    measured.print_rows(console, rows)
    assert "1.0 / 2.0" in console.file.getvalue()
    assert "ValueError: no" in console.file.getvalue()
    assert labels == repeated == []
    facts = json.loads(json.dumps(facts))
    assert "shown" not in facts["results"]["loops"]["bwbn"]
    figures = draw_gallery(tests, entries, tmp_path / "figures")
    assert figures == {"loops": tmp_path / "figures" / "loops.png"}
    assert figures["loops"].read_bytes().startswith(b"\x89PNG")
    write_page(facts, figures, tmp_path / "page.md")
    page = (tmp_path / "page.md").read_text()
    assert "| loops | 321 | 62 % | 1.0 / 2.0 |\n" in page
    assert "- bad, bwbn: ValueError: no" in page
    assert "- Pinching4: not run." in page
    assert "BWBN: not run" not in page
    assert "(figures/loops.png)" in page


def test_what_was_kept_is_not_run_again_elsewhere_and_gives_the_same_tables(tmp_path):
    runs, log = [], tmp_path / "elsewhere" / "out.jsonl"

    def run(test):
        runs.append(test.name)
        return {"errors": [1.0, 2.0]}, test.record.measured

    trial = measured.Trial(what="bwbn", code="a", seed=1, log=log, run=run)
    test, found = labelled("one", "pinched", 0.2, 0.07, "abc1234")
    entries = {
        ("loops", "bwbn"): measured._filed_run(trial, measured_test(), identity(measured_test(), "bwbn", "a", 1))
    }
    entries[("one", "whole")] = {**found, "result": {**found["result"], "facts": {
        **found["result"]["facts"], "candidates": [1.0] * 1000}}}  # fmt: skip
    keep(tmp_path / "kept.jsonl", entries)
    assert runs == ["loops"]
    measured.run_trials([trial], [measured_test()], Console(file=io.StringIO()), tmp_path / "kept.jsonl")
    assert runs == ["loops"]
    kept = filed(tmp_path / "kept.jsonl")
    assert "candidates" not in kept[("one", "whole")]["result"]["facts"]
    tests = [measured_test(), test]
    there, here = (measured.gather(tests, one)[3] for one in (entries, kept))
    assert {k: v for k, v in here.items() if k != "results"} == {k: v for k, v in there.items() if k != "results"}


def test_missing_data_end_the_command(tmp_path, capsys):
    assert measured.main(["--json", str(tmp_path / "out.json"), "--data", str(tmp_path)]) == 2
    assert "no such file" in capsys.readouterr().err


def test_every_kind_of_trial_concerns_its_tests():
    frame = MeasuredTest(
        name="frame", n_fitted=20, rule="path",
        record=Record(name="frame", time_step=0.1, excitation=np.zeros(30), channels={"displacement_1": np.zeros(30)}),
    )  # fmt: skip
    kinds = measured.trials(Path("out.json"), 1)
    assert {what for what in kinds if measured.concerns(what, frame)} == {"linear_chain", "discover"}
    assert {what for what in kinds if measured.concerns(what, measured_test())} == {"bwbn", "pinching4", "discover"}


def test_repeat_cycles_are_tabulated_with_what_their_intervals_hold(tmp_path):
    targets = [0.0, *np.repeat([1.0, 2.0, 3.0], 4) * np.tile([1.0, -1.0], 6)]
    ways = [np.linspace(a, b, 11)[1:] for a, b in pairwise(targets)]
    path = np.concatenate([[0.0], *ways])
    record = Record(name="twice", time_step=1.0, excitation=path, excitation_kind="displacement", has_time=False,
                    channels={"force": path})  # fmt: skip
    test = MeasuredTest(name="twice", record=record, n_fitted=80, rule="path")
    assert measured.concerns("repeats", test)

    def filed_with(coverage):
        held_out = {"before": 0.3, "after": 0.08, "coverage_90": coverage}
        facts = {"verdict": "effects_found", "effects": [], "elapsed_s": 1.0, "errors": [5.0, 8.0],
                 "gap": {"fit": {"before": 0.2, "after": 0.05}, "held_out": held_out}}  # fmt: skip
        return {"result": {"facts": facts}, "identity": {"code": "a", "name": "twice"}}

    rows = [repeat_row(test, filed_with(coverage)) for coverage in (0.79, 0.8, 0.97, 0.98)]
    assert [one.is_covered for one in rows] == [False, True, True, False]
    assert (rows[0].n_points, rows[0].n_held_out, rows[0].given, rows[0].errors) == (121, 60, 30.0, (5.0, 8.0))
    (total,) = repeat_sums(rows)
    assert total == {"what": "coverage within 80 to 97 %", "count": 2, "total": 4, "asked": "all"}
    console = Console(file=io.StringIO(), width=160)
    measured.print_repeats(console, rows[:2], repeat_sums(rows[:2]))
    assert "coverage within 80 to 97 %: 1 of 2 specimens" in console.file.getvalue()
    broken = {"error": "ValueError: no", "identity": {"code": "a", "name": "twice"}}
    *_, repeated, facts = measured.gather([test], {("twice", "repeats"): broken})
    assert (repeated, facts["failed"]) == ([], ["twice, repeats: ValueError: no"])
    assert [(one["count"], one["total"]) for one in facts["repeat_sums"]] == [(0, 1)]
    *_, repeated, facts = measured.gather([test], {("twice", "repeats"): filed_with(0.9)})
    assert [one.coverage for one in repeated] == [0.9]
    write_page(facts, {}, tmp_path / "page.md")
    page = (tmp_path / "page.md").read_text()
    assert "| twice | 121 | 60 | 30.0 | 5.0 / 8.0 | 90 % |" in page
    assert "| coverage within 80 to 97 % | all | 1 of 1 |" in page
    assert "## The first part" not in page
    assert "## Columns" not in page
