"""Probabilities as discovery.json states them (schema 2): reading, reliability, the rows asked, pooling of trials."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import discovery as trial
from benchmarks.blind import cases
from benchmarks.blind.columns import column_summary
from benchmarks.blind.filed import FiledCase
from benchmarks.blind.picture import draw_reliability
from benchmarks.blind.reliability import reliability
from benchmarks.blind.scoring import Outcome, case_outcome
from benchmarks.blind.show import show_rows
from benchmarks.blind.stated import stated
from bwbn_bayes.records import Record


def hidden(name: str, storey: int, *accepted: str) -> dict[str, Any]:
    return {"name": name, "storeys": [storey], "accepted": [name, *accepted], "parameters": {}}


def truth(*effects: dict[str, Any], kind: str = "catalogue", nats: tuple[float, ...] = ()) -> dict[str, Any]:
    return {
        "kind": kind, "name": "case", "effects": list(effects), "detectable": all(n > 40.0 for n in nats),
        "severe": True, "held_out_floor": 0.03, "snr_db": 30.0, "nats": list(nats),
    }  # fmt: skip


def answer(probabilities: dict[str, float], *named: tuple[str, int, float]) -> dict[str, Any]:
    """Schema 2, as DESIGN.md has it."""
    return {
        "schema": 2,
        "verdict": "effects_found" if named else "no_missing_effect",
        "verdict_probabilities": {"effects_found": 0.9, "partly_explained": 0.1},
        "effects": [
            {"name": name, "storeys": [storey], "probability": p, "equivalent": [], "parameters": {}}
            for name, storey, p in named
        ],
        "gap": {"held_out": {"before": 0.2, "after": 0.03}},
        "probabilities": probabilities,
        "elapsed_s": 1.0,
    }


SLIP = hidden("slip_lock", 2)


def test_probabilities_are_read_in_one_place_and_schema_1_has_none() -> None:
    found = stated(answer({"slip_lock": 0.998, "asymmetry": None}, ("slip_lock", 2, 0.5), ("gap_impact", 1, 0.93)))  # type: ignore[dict-item]
    assert found is not None
    assert found.names == {"slip_lock": 0.998, "gap_impact": 0.93}
    assert found.verdicts["effects_found"] == 0.9
    assert stated({"schema": 1, "effects": [], "candidates": [{"log_odds": 3.0}]}) is None
    old = case_outcome(truth(SLIP), {"schema": 1, "verdict": "effects_found", "effects": []})
    assert (old.claims, old.sure_and_wrong) == (None, ())
    assert case_outcome(truth(SLIP), {"error": "ValueError: no"}).claims is None


def test_an_effect_counts_as_named_from_nine_tenths() -> None:
    found = case_outcome(
        truth(SLIP), answer({"slip_lock": 0.95, "asymmetry": 0.6}, ("asymmetry", 1, 0.6), ("slip_lock", 2, 0.95))
    )
    assert (found.named, found.right_place, found.extra) == (("slip_lock[2]",), True, ())
    assert found.sure_and_wrong == ()
    shared = answer({"gap_impact": 0.5, "slip_lock": 0.5}, ("gap_impact", 2, 0.5))
    shared["effects"][0]["equivalent"] = ["slip_lock"]
    undecided = case_outcome(truth(SLIP), shared)
    assert (undecided.named, undecided.within_class, undecided.class_size) == ((), True, 2)
    assert not undecided.wrong_with_confidence
    wrong = case_outcome(truth(SLIP), answer({"asymmetry": 0.91}, ("asymmetry", 1, 0.91)))
    assert (wrong.sure_and_wrong, wrong.right_name) == (("asymmetry",), False)


def test_claims_are_probabilities_with_what_was_hidden() -> None:
    found = case_outcome(truth(SLIP), answer({"slip_lock": 0.8, "foliente_pinching": 0.15, "asymmetry": 0.02}))
    assert found.claims == ((0.8, True), (0.15, False), (0.02, False))
    # Either name of a pinch is right for another bell: together they are one statement.
    bell = hidden("slip_lock", 2, "foliente_pinching")
    both = case_outcome(truth(bell, kind="more_forms"), answer({"slip_lock": 0.6, "foliente_pinching": 0.55, "x": 0.1}))
    assert both.claims == ((1.0, True), (0.1, False))
    missed = case_outcome(truth(SLIP, hidden("mass_error", 1), kind="pairs"), answer({"mass_error": 0.97}))
    assert sorted(missed.claims or ()) == [(0.0, True), (0.97, True)]
    assert case_outcome(truth(kind="none"), answer({"asymmetry": 0.3})).claims == ((0.3, False),)
    # What the catalogue lacks cannot be named; what it came to hold can.
    strange, bending = hidden("snap_window", 1), hidden("bending_coupling", 1, "storey_coupling")
    stated_of = {"asymmetry": 0.3, "storey_coupling": 0.6}
    assert case_outcome(truth(strange, kind="outside"), answer({"asymmetry": 0.3})).claims == ((0.3, False),)
    assert case_outcome(truth(bending, kind="outside"), answer(stated_of)).claims == ((0.6, True), (0.3, False))


def test_the_calibration_error_is_that_of_a_sum_by_hand() -> None:
    made = [[(0.95, True), (0.05, False)], [(0.95, False), (0.02, False)], [(0.62, True)], [(0.05, True)]]
    found = reliability(made)
    # Bins: 0 to 0.1 holds three, one of them true; 0.6 to 0.7 one, true; 0.9 to 1 two, one of them true.
    stated_error = (abs(1.9 - 1.0) + abs(0.62 - 1.0)) / 3.0
    every = (abs(1.9 - 1.0) + abs(0.62 - 1.0) + abs(0.12 - 1.0)) / 6.0
    assert found["expected_calibration_error"]["value"] == pytest.approx(stated_error)
    assert found["expected_calibration_error"]["statements"] == 3
    assert found["expected_calibration_error_of_all"]["value"] == pytest.approx(every)
    last = found["bins"][-1]
    assert (last["statements"], last["mean_probability"], last["share"]) == (2, pytest.approx(0.95), 0.5)
    assert [b["statements"] for b in found["bins"]] == [3, 0, 0, 0, 0, 0, 1, 0, 0, 2]
    assert found["bins"][1]["share"] is None
    assert reliability([])["expected_calibration_error"]["value"] is None


@pytest.mark.parametrize(("bent", "error"), [(1.0, 0.0), (3.0, 0.25)])
def test_probabilities_that_are_kept_have_the_error_of_chance(bent: float, error: float) -> None:
    """Uniform p that comes true with p, or with p^3: then the error is E|p - p^3| = 1/4."""
    rng = np.random.default_rng(3)
    p = rng.random((800, 5))
    came_true = rng.random(p.shape) < p**bent
    found = reliability([list(zip(a.tolist(), b.tolist(), strict=True)) for a, b in zip(p, came_true, strict=True)])
    of_all = found["expected_calibration_error_of_all"]
    # The bins of ten tenths, 400 statements each: by chance 0.016 is expected where probabilities are kept.
    assert of_all["if_calibrated"] == pytest.approx(0.016, abs=0.003)
    assert of_all["value"] == pytest.approx(max(error, of_all["if_calibrated"]), abs=4.0 * of_all["se"] + 0.005)
    middle = found["bins"][5]
    assert middle["share_se"] == pytest.approx(np.sqrt(middle["share"] * (1.0 - middle["share"]) / 400.0), rel=0.15)


def outcomes() -> list[Outcome]:
    right = answer({"slip_lock": 0.99}, ("slip_lock", 2, 0.99))
    wrong = answer({"asymmetry": 0.95}, ("asymmetry", 2, 0.95))
    nothing = answer({"asymmetry": 0.1})
    strange = {**hidden("snap_window", 1)}
    pair = (SLIP, hidden("mass_error", 1))
    both = answer({"slip_lock": 1.0, "mass_error": 1.0}, ("slip_lock", 2, 1.0), ("mass_error", 1, 1.0))
    return [
        case_outcome(truth(SLIP, nats=(99.0,)), right),
        case_outcome(truth(SLIP, nats=(99.0,)), nothing),
        case_outcome(truth(SLIP, nats=(2.0,)), nothing),
        case_outcome({**truth(SLIP, nats=(99.0,)), "snr_db": 10.0}, right),
        case_outcome(truth(kind="none"), nothing),
        case_outcome(truth(kind="none"), wrong),
        case_outcome(truth(SLIP, kind="forms", nats=(99.0,)), right),
        case_outcome(truth(SLIP, kind="more_forms", nats=(99.0,)), wrong),
        case_outcome(truth(SLIP, kind="more_forms", nats=(99.0,)), {"schema": 1, "verdict": "unexplained"}),
        case_outcome(truth(strange, kind="outside", nats=(99.0,)), nothing),
        case_outcome(truth(*pair, kind="pairs", nats=(99.0, 99.0)), both),
        case_outcome(truth(*pair, kind="pairs", nats=(99.0, 99.0)), right),
        # Of a specimen's two effects one cannot be seen beside the other.
        case_outcome(truth(*pair, kind="cyclic", nats=(99.0, 3.0)), right),
        case_outcome(truth(kind="cyclic"), wrong),
    ]


def test_the_rows_asked_are_counted_over_detectable_cases_of_all_trials() -> None:
    rows = {row["what"]: (row["count"], row["total"], row["asked"]) for row in show_rows(outcomes())}
    assert rows == {
        "catalogue, 30 dB: right name and storey": (1, 2, ">= 97 %"),
        "catalogue, 10 dB: right name and storey": (1, 1, ">= 85 %"),
        "nothing hidden: an effect named, or failed": (1, 2, "<= 1 %"),
        "other forms: right name": (1, 3, ">= 85 %"),
        "other forms: a wrong effect with probability above 0.9": (1, 2, "<= 3 %"),
        "outside the catalogue: no name above 0.9": (1, 1, ">= 95 %"),
        "pairs: every hidden effect named": (1, 2, ">= 88 %"),
        "pairs: an effect that is not there": (0, 2, "<= 3 %"),
        "cyclic tests: every hidden effect named": (1, 1, ""),
        "cyclic tests: an effect that is not there": (0, 1, ""),
        "cyclic tests: a wrong effect with probability above 0.9": (0, 1, ""),
        "cyclic tests, nothing hidden: an effect named, or failed": (1, 1, ""),
    }


def test_a_column_says_which_verdict_and_with_which_probability() -> None:
    found = column_summary("pairs", [o for o in outcomes() if o.kind == "pairs"])
    assert found["mean_verdict_probabilities"]["effects_found"] == pytest.approx(0.9)
    verdicts = {p["what"]: p["count"] for p in found["proportions"] if p["what"].startswith("verdict")}
    assert verdicts["verdict effects_found"] == sum(verdicts.values()) == 2


def test_the_reliability_diagram_is_drawn(tmp_path: Path) -> None:
    draw_reliability(reliability([[(0.95, True), (0.2, False)]]), tmp_path / "kept.png", "a title")
    assert (tmp_path / "kept.png").read_bytes().startswith(b"\x89PNG")


def test_a_small_balanced_trial_takes_kinds_in_turns_and_pools_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    drawn = []

    def drew(kind: cases.Kind, seed: int, index: int, snr_db: float) -> cases.Case:
        drawn.append((kind, index))
        record = Record(name="r", time_step=0.02, excitation=np.ones(9), channels={"acceleration_1": np.ones(9)})
        made = cases.Truth(
            kind=kind, seed=seed, index=index, snr_db=snr_db, effects=(), base={}, severe=False, peak_ratio=0.5,
            excitation="", noise="white", noise_sd=(0.1,), held_out_floor=0.1, nats=(),
        )  # fmt: skip
        return cases.Case(name="r", record=record, held_out=record, truth=made, given="plain_three_storey")

    monkeypatch.setattr(trial, "make_case", drew)
    monkeypatch.setattr(
        trial, "discover", lambda *_, **__: type("Found", (), {"as_json": lambda _: answer({"a": 0.2})})()
    )
    first, second = tmp_path / "first.json", tmp_path / "new" / "second.json"
    trial.main(["--kind", "all", "--cases", "2", "--json", str(first)])
    assert drawn == [(kind, index) for index in range(2) for kind in cases.KINDS]
    trial.main(["--cases", "0", "--json", str(second), "--also", str(first.with_suffix(".jsonl"))])
    assert len(drawn) == 2 * len(cases.KINDS)
    for path, n_columns in ((first, len(cases.KINDS)), (second, 0)):
        facts = json.loads(path.read_text())
        assert len(facts["columns"]) == n_columns
        kept = facts["pooled"]["reliability"]
        assert kept["cases"] == kept["bins"][2]["statements"] == 2 * len(cases.KINDS)
        assert kept["expected_calibration_error"]["value"] == pytest.approx(0.2)
        assert path.with_name(f"{path.stem}-reliability.png").exists()
    assert "expected calibration error of statements of 0.1 and more: 0.200" in capsys.readouterr().out


def test_each_case_is_given_its_model(monkeypatch: pytest.MonkeyPatch) -> None:
    """A cyclic test one from its own columns, a building Bouc-Wen storeys or, where these are hidden, linear ones."""
    seen = []

    def discovered(model: object, *_: object, **__: object) -> object:
        seen.append(model)
        return type("Found", (), {"as_json": lambda _: {}})()

    monkeypatch.setattr(trial, "discover", discovered)
    setting = cases.Setting(duration=12.0, judged=False)
    for kind, index in (("cyclic", 0), *(("later", index) for index in range(3))):
        case = cases.make_case(kind, 3, index, 30.0, setting)
        trial.discover_blind(case.given, case.record, case.held_out, 1, 1)
        if kind == "cyclic":
            assert seen[-1].is_driven
        else:
            element = "linear" if case.truth.effects[0].name == "hysteresis" else "bouc_wen"
            assert [seen[-1].element_of(i) for i in (1, 2, 3)] == [element] * 3
            assert set(case.truth.base) == set(seen[-1].space.names)
    assert len(seen) == 4


def test_nothing_stated_leaves_no_diagram(tmp_path: Path) -> None:
    old = {**truth(SLIP), "seed": 1, "index": 0}
    case = FiledCase.of({"key": "old", "truth": old, "discovery": {"schema": 1, "verdict": "unexplained"}})
    pooled = trial.pooled_summary([case])
    assert pooled["reliability"]["expected_calibration_error"]["value"] is None
    assert trial.draw_gallery(pooled, tmp_path) == {}
