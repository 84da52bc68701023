"""Scoring on outcomes made by hand, and a trial that is broken off and resumed."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from scipy.stats import beta

from benchmarks import discovery as trial
from benchmarks.blind import cases
from benchmarks.blind.columns import Proportion, column_summary
from benchmarks.blind.picture import draw_confusion
from benchmarks.blind.scoring import case_outcome
from benchmarks.blind.show import show_rows
from benchmarks.running import commit, package_version
from bwbn_bayes.records import Record


def hidden(name: str, *storeys: int, accepted: tuple[str, ...] = (), **parameters: float) -> dict[str, Any]:
    return {"name": name, "storeys": list(storeys), "accepted": [name, *accepted], "parameters": parameters}


def truth(
    *effects: dict[str, Any], kind: str = "catalogue", detectable: bool = True, nats: tuple[float, ...] = ()
) -> dict[str, Any]:
    return {
        "kind": kind, "name": "case", "effects": list(effects), "detectable": detectable, "severe": True,
        "held_out_floor": 0.03, "snr_db": 30.0, "nats": list(nats),
    }  # fmt: skip


def effect(
    name: str, *storeys: int, equivalent: tuple[str, ...] = (), **moments: tuple[float, float]
) -> dict[str, Any]:
    parameters = {f"{key}[{storeys[0]}]": {"mean": mean, "sd": sd} for key, (mean, sd) in moments.items()}
    return {"name": name, "storeys": list(storeys), "equivalent": list(equivalent), "parameters": parameters}


def answer(*effects: dict[str, Any], verdict: str = "effects_found", after: float = 0.031) -> dict[str, Any]:
    gap = {"noise_floor": 0.5, "held_out": {"before": 0.2, "after": after}}
    return {"schema": 1, "verdict": verdict, "effects": list(effects), "gap": gap, "elapsed_s": 12.0}


SLIP = hidden("slip_lock", 2, delta_s=0.05, sigma=0.02)


@pytest.mark.parametrize(
    ("given", "right"),
    [
        (effect("slip_lock", 2), "name place class"),
        (effect("slip_lock", 3), "name class"),
        (effect("gap_impact", 2, equivalent=("slip_lock",)), "class"),
        (effect("gap_impact", 2, equivalent=("backlash", "slip_lock, storey 2")), "class"),
        (effect("gap_impact", 2), "wrong"),
        (effect("gap_impact", 2, equivalent=("slip_lock_other",)), "wrong"),
    ],
)
def test_one_hidden_effect(given: dict[str, Any], right: str) -> None:
    found = case_outcome(truth(SLIP), answer(given))
    assert (found.right_name, found.right_place, found.within_class, found.wrong_with_confidence) == tuple(
        word in right for word in ("name", "place", "class", "wrong")
    )
    assert found.confusion == (("slip_lock", given["name"], "name" in right.split()),)
    assert found.class_size == 1 + len(given["equivalent"])
    assert found.floor_ratio == pytest.approx(0.031 / 0.03)


def test_a_wrong_name_beside_the_right_one_stands_in_the_matrix() -> None:
    """It was seen in the row of shares and in the list of misses alone."""
    wrong = ("nothing", "gap_impact", False)
    found = case_outcome(truth(SLIP), answer(effect("slip_lock", 2), effect("gap_impact", 1)))
    assert found.confusion == (("slip_lock", "slip_lock", True), wrong)
    both = truth(SLIP, hidden("input_scale"), kind="pairs")
    every = answer(effect("slip_lock", 2), effect("input_scale"), effect("gap_impact", 1))
    assert case_outcome(both, every).confusion[2:] == (wrong,)


def test_naming_none_is_wrong_but_not_with_confidence() -> None:
    for verdict, column in (("no_missing_effect", "nothing"), ("unexplained", "unexplained")):
        found = case_outcome(truth(SLIP), answer(verdict=verdict))
        assert not (found.right_name or found.wrong_with_confidence)
        assert found.confusion == (("slip_lock", column, False),)


def test_another_form_may_have_several_right_names() -> None:
    pinching = hidden("foliente_pinching", 1, accepted=("slip_lock",))
    assert case_outcome(truth(pinching, kind="forms"), answer(effect("slip_lock", 1))).right_place


def test_an_effect_of_the_whole_building_has_no_storey() -> None:
    assert case_outcome(truth(hidden("input_scale")), answer(effect("input_scale"))).right_place


def test_parameters_are_compared_where_the_labels_agree() -> None:
    given = effect("slip_lock", 2, delta_s=(0.06, 0.005), other=(1.0, 0.1))
    assert case_outcome(truth(SLIP), answer(given)).z == {"delta_s[2]": pytest.approx(2.0)}
    assert case_outcome(truth(SLIP), answer(effect("slip_lock", 1, delta_s=(0.06, 0.005)))).z == {}


def test_pairs_want_both_and_nothing_else() -> None:
    both = truth(SLIP, hidden("input_scale"), kind="pairs")
    whole = case_outcome(both, answer(effect("input_scale"), effect("slip_lock", 2)))
    assert (whole.all_named, whole.extra) == (True, ())
    assert whole.confusion == (("slip_lock", "slip_lock", True), ("input_scale", "input_scale", True))
    half = case_outcome(both, answer(effect("slip_lock", 2), effect("gap_impact", 1)))
    assert (half.all_named, half.extra) == (False, ("gap_impact[1]",))
    assert half.confusion == (("slip_lock", "slip_lock", True), ("input_scale", "gap_impact", False))


def test_a_crash_is_a_miss_that_is_seen() -> None:
    found = case_outcome(truth(SLIP), {"error": "ValueError: no"})
    assert found.verdict == "failed"
    assert column_summary("catalogue", [found])["failed"] == ["case: ValueError: no"]
    assert column_summary("catalogue", [found])["misses"] == ["case: slip_lock[2]; said failed"]


def test_a_column_counts_over_its_detectable_cases() -> None:
    right, far = (effect("slip_lock", 2, delta_s=(mean, 0.01)) for mean in (0.05, 0.1))
    outcomes = [
        case_outcome(truth(SLIP), answer(right)),
        case_outcome(truth(SLIP), answer(far, after=0.05)),
        case_outcome(truth(SLIP), answer(effect("gap_impact", 1, equivalent=("backlash", "cubic_stiffness")))),
        case_outcome(truth(SLIP, detectable=False), answer(verdict="no_missing_effect")),
    ]
    found = column_summary("catalogue", outcomes)
    shares = {p["what"]: (p["count"], p["total"]) for p in found["proportions"]}
    assert shares == {
        "detectable": (3, 4),
        "right name": (2, 3),
        "right name and storey": (2, 3),
        "within the equivalence class": (2, 3),
        "wrong name, with confidence": (1, 3),
        "a second effect that is not there": (0, 3),
        "a wrong effect with probability above 0.9": (0, 0),
        "named: held-out error <= 1.1 noise floor": (2, 3),
        "added parameters within 4 sd": (1, 2),
        "verdict effects_found": (3, 3),
        "verdict partly_explained": (0, 3),
        "verdict unexplained": (0, 3),
        "verdict no_missing_effect": (0, 3),
        "verdict failed": (0, 3),
    }
    assert found["mean_class_size"] == pytest.approx(5 / 3)
    assert found["seconds_median"] == 12.0
    assert found["confusion"] == [
        {"hidden": "slip_lock", "named": "gap_impact", "right": False, "count": 1},
        {"hidden": "slip_lock", "named": "slip_lock", "right": True, "count": 2},
    ]
    assert found["undetectable"] == ["case: slip_lock[2]"]
    assert found["misses"] == ["case: slip_lock[2]; said gap_impact[1]"]


def test_columns_without_a_right_name() -> None:
    nothing = [case_outcome(truth(kind="none"), answer(e, verdict=v)) for e, v in ((effect("asymmetry", 1), "x"),)]
    nothing.append(case_outcome(truth(kind="none"), answer(verdict="no_missing_effect")))
    named = column_summary("none", nothing)["proportions"][1]
    assert (named["what"], named["count"], named["total"]) == ("an effect named, or failed", 1, 2)
    strange = truth(hidden("snap_window", 1), kind="outside")
    outcomes = [case_outcome(strange, answer(verdict=v)) for v in ("unexplained", "unexplained", "no_missing_effect")]
    outcomes.append(case_outcome(strange, answer(effect("asymmetry", 1), verdict="partly_explained")))
    column = column_summary("outside", outcomes)
    verdicts = {p["what"]: p["count"] for p in column["proportions"]}
    assert [verdicts[f"verdict {v}"] for v in ("unexplained", "partly_explained", "no_missing_effect")] == [2, 1, 1]
    assert verdicts["an effect named"] == 1
    assert column["misses"] == ["case: snap_window[1]; said asymmetry[1]"]


@pytest.mark.parametrize(
    ("kind", "effects", "row", "counted"),
    [
        ("none", (), "an effect named, or failed", (1, 1)),
        ("outside", (hidden("snap_window", 1),), "no name above 0.9", (0, 1)),
    ],
)
def test_a_crash_is_a_miss_where_nothing_is_to_be_named(
    kind: str, effects: tuple[dict[str, Any], ...], row: str, counted: tuple[int, int]
) -> None:
    failed = [case_outcome(truth(*effects, kind=kind), {"error": "ValueError: no"})]
    for rows in (column_summary(kind, failed)["proportions"], show_rows(failed)):
        assert [(one["count"], one["total"]) for one in rows if one["what"].endswith(row)] == [counted]


@pytest.mark.parametrize(("count", "total"), [(0, 20), (13, 40), (40, 40)])
def test_intervals_are_clopper_and_pearson_s(count: int, total: int) -> None:
    low = 0.0 if count == 0 else beta.ppf(0.025, count, total - count + 1)
    high = 1.0 if count == total else beta.ppf(0.975, count + 1, total - count)
    assert Proportion(what="", count=count, total=total).interval == pytest.approx((low, high), abs=1e-9)


def test_the_confusion_matrix_is_drawn(tmp_path: Path) -> None:
    cells = (("slip_lock", "slip_lock", True, 3), ("slip_lock", "nothing", False, 1), ("nothing", "nothing", True, 5))
    matrix = [dict(zip(("hidden", "named", "right", "count"), cell, strict=True)) for cell in cells]
    draw_confusion(matrix, tmp_path / "matrix.png", "a title")
    assert (tmp_path / "matrix.png").read_bytes().startswith(b"\x89PNG")


class Oracle:
    """Stands in for discovery: counts its calls, fails when told to."""

    def __init__(self, *, fails_at: int = -1) -> None:
        self.seen: list[Record] = []
        self.fails_at = fails_at

    def __call__(self, given: str, record: Record, held_out: Record, seed: int, n_threads: int) -> dict[str, Any]:
        assert given == "plain_three_storey"
        self.seen.append(record)
        if len(self.seen) == self.fails_at:
            raise ValueError("told to")
        return answer(verdict="no_missing_effect")


def test_a_trial_goes_on_where_it_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cases, "nats_against", lambda *_, **__: 50.0)
    log, console = tmp_path / "trial.jsonl", Console(file=io.StringIO())
    jobs = [
        trial.Job(kind="none", seed=3, index=i, snr_db=30.0, folder=tmp_path / "trial", n_threads=1) for i in range(3)
    ]
    oracle = Oracle(fails_at=2)
    first = trial.run_trial(jobs[:2], log, workers=1, console=console, discoverer=oracle)
    assert [case.outcome.verdict for case in first] == ["no_missing_effect", "failed"]
    with log.open("a", encoding="utf-8") as file:
        file.write('{"key": "none/30 dB/se')  # a run that was cut off while it wrote
    oracle = Oracle()
    second = trial.run_trial(jobs, log, workers=1, console=console, discoverer=oracle)
    assert [case.outcome.verdict for case in second] == ["no_missing_effect"] * 3
    assert [record.name for record in oracle.seen] == ["case-0001", "case-0002"]
    assert trial.run_trial(jobs, log, workers=1, console=console, discoverer=Oracle(fails_at=1)) == second
    for entry in map(json.loads, log.read_text().splitlines()[-2:]):
        assert entry["commit"] == commit()
        assert entry["code"] == package_version()
        assert entry["processor"]
        assert entry["seconds"] >= 0.0
        assert entry["processor_seconds"] >= 0.0
    for record in oracle.seen:
        assert not record.truth
        assert not record.noise_sd
    truths = [json.loads(path.read_text()) for path in sorted((tmp_path / "trial" / "truth").iterdir())]
    assert [t["index"] for t in truths] == [0, 1, 2]
