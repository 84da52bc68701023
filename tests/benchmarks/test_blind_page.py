"""The page of the blind trials: written from what trials filed, with every miss, by whichever version."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from benchmarks import discovery as trial
from benchmarks.blind.cases import KINDS
from benchmarks.blind.filed import FiledCase, filed_entries, finished_entries, other_cases
from benchmarks.blind.page import KIND_TITLES
from benchmarks.blind.pooled import misses

RUN = {"commit": "abc1234", "code": "0123456789ab", "processor": "Some CPU", "seconds": 20.0, "processor_seconds": 35.0}


def hidden(name: str, storey: int, *accepted: str, form: str = "") -> dict[str, Any]:
    return {"name": name, "storeys": [storey], "form": form, "accepted": [name, *accepted], "parameters": {}}


def told(*effects: tuple[str, int, float], verdict: str = "effects_found") -> dict[str, Any]:
    return {
        "schema": 2, "verdict": verdict, "verdict_probabilities": {verdict: 0.8}, "elapsed_s": 10.0,
        "effects": [
            {"name": name, "storeys": [storey], "probability": p, "parameters": {}} for name, storey, p in effects
        ],
        "gap": {"held_out": {"before": 0.2, "after": 0.03}},
        "probabilities": {name: p for name, _, p in effects},
    }  # fmt: skip


def case(
    kind: str, index: int, effects: list[dict[str, Any]], discovery: dict[str, Any], nats: float = 99.0, **run: Any
) -> dict[str, Any]:
    truth = {
        "kind": kind, "name": f"{kind}-{index}", "seed": 7, "index": index, "snr_db": 30.0, "effects": effects,
        "detectable": nats > 40.0, "severe": False, "nats": [nats] * len(effects), "held_out_floor": 0.03,
    }  # fmt: skip
    return {"key": f"{kind}/30 dB/seed 7/{index}", "truth": truth, "discovery": discovery, **run}


SLIP, GAIN = hidden("slip_lock", 2), hidden("sensor_gain", 1)
NOTHING = told(verdict="no_missing_effect")
CASES = [
    case("catalogue", 0, [SLIP], told(("slip_lock", 2, 0.999)), **RUN),
    case("catalogue", 1, [SLIP], told(("slip_lock", 3, 0.97)), **RUN),
    case("catalogue", 2, [SLIP], told(("slip_lock", 2, 0.83)), **RUN),
    case("catalogue", 3, [SLIP], told(("backlash", 1, 0.91)), nats=3.0, **RUN),
    case("catalogue", 4, [SLIP], NOTHING, nats=3.0, **RUN),
    case("none", 0, [], NOTHING, **RUN),
    case("none", 1, [], told(("asymmetry", 3, 0.92)), **RUN),
    case("pairs", 0, [SLIP, GAIN], told(("slip_lock", 2, 0.99), ("mass_error", 1, 0.95)), **RUN),
    case("forms", 0, [hidden("slip_lock", 2, "foliente_pinching", form="bell")],
         told(("foliente_pinching", 2, 0.98)), **RUN),
    case("outside", 0, [hidden("snap_window", 1)], told(verdict="unexplained"), **RUN),
    case("outside", 1, [hidden("snap_window", 1)], {"error": "ValueError: a | b\nmore"}, **RUN),
]  # fmt: skip


def write(path: Path, cases: list[dict[str, Any]]) -> Path:
    path.write_text("".join(json.dumps(one) + "\n" for one in cases))
    return path


def page_of(tmp_path: Path, *logs: Path) -> str:
    arguments = ["--cases", "0", "--json", str(tmp_path / "pooled.json"), "--also", *map(str, logs)]
    trial.main(
        [*arguments, "--page", str(tmp_path / "docs" / "page.md"), "--gallery", str(tmp_path / "docs" / "figures")]
    )
    return (tmp_path / "docs" / "page.md").read_text()


def cells(page: str, start: str) -> list[list[str]]:
    """Rows of a table that begin so."""
    lines = [line for line in page.splitlines() if line.startswith(f"| {start}")]
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines]


def test_the_page_counts_and_lists_every_miss(tmp_path: Path) -> None:
    page = page_of(tmp_path, write(tmp_path / "a.jsonl", CASES))
    assert "Cases: 11, all run at commit `abc1234` (hash of what the code does: `0123456789ab`)." in page
    assert f"--also {tmp_path}/a.jsonl --json pooled.json" in page
    (row,) = cells(page, "catalogue, 30 dB: right name and storey")
    assert row[1:] == [">= 97 %", "1 of 3", "33 %", "1 to 91 %"]
    (by_kind,) = [row for row in cells(page, "`catalogue`") if row[1] == "30 dB: 7"]
    assert by_kind[2:] == ["5", "3", "1", "1 to 91 %", "20 / 20", "35 / 35"]
    assert "by the clock and of the processor (Some CPU):" in page
    assert "Not run: `more_forms`, `later`, `cyclic`." in page
    missed = {(row[0], row[1]): row[2:] for kind in KINDS for row in cells(page, f"`{kind}` | 30 dB, 7/")}
    assert missed == {
        ("`catalogue`", "30 dB, 7/1"): [
            "slip_lock", "2", "slip_lock[3] (0.97)", "effects_found 0.80", "at another storey",
        ],
        ("`catalogue`", "30 dB, 7/2"): [
            "slip_lock", "2", "slip_lock[2] (0.83)", "effects_found 0.80", "not named: slip_lock",
        ],
        ("`catalogue`", "30 dB, 7/3"): [
            "slip_lock", "2", "backlash[1] (0.91)", "effects_found 0.80", "not there: backlash",
        ],
        ("`none`", "30 dB, 7/1"): [
            "nothing", "–", "asymmetry[3] (0.92)", "effects_found 0.80", "not there: asymmetry",
        ],
        ("`pairs`", "30 dB, 7/0"): [
            "slip_lock<br>sensor_gain", "2<br>1", "slip_lock[2] (0.99)<br>mass_error[1] (0.95)", "effects_found 0.80",
            "not named: sensor_gain; not there: mass_error",
        ],
        ("`outside`", "30 dB, 7/1"): ["snap_window", "1", "none", "failed", "failed: ValueError: a \\| b"],
    }  # fmt: skip
    uncounted = page[page.index("Cases that cannot be detected") : page.index("## Hidden against named")]
    assert "7/3" in uncounted
    assert "7/1" not in uncounted
    assert ["`forms`", "slip_lock", "1 of 1", "foliente_pinching 1", "–"] in cells(page, "`forms` | slip_lock")
    assert "\n\n\n" not in page


def test_what_is_kept_of_cases_counts_as_they_do(tmp_path: Path) -> None:
    """Records, histories and sentences of a discovery decide nothing, and are thirty times as long."""
    shown = {
        "sentences": ["a"] * 40,
        "gap": {"noise_floor": 0.1, "held_out": {"before": 0.4, "after": 0.1, "loops": 1}},
    }
    full = [{**one, "discovery": {**one["discovery"], **shown}} for one in CASES]
    kept = tmp_path / "kept" / "cases.jsonl"
    whole = write(tmp_path / "a.jsonl", full)
    trial.main(["--cases", "0", "--json", str(tmp_path / "a.json"), "--also", str(whole), "--keep", str(kept)])
    trial.main(["--cases", "0", "--json", str(tmp_path / "b.json"), "--also", str(kept)])
    before, after = (json.loads((tmp_path / f"{name}.json").read_text())["pooled"] for name in ("a", "b"))
    assert before == after
    assert before["cases"] == len(CASES)
    assert "sentences" not in kept.read_text()
    of = {one["key"]: FiledCase.of(one).outcome for one in full}
    assert {key: FiledCase.of(one).outcome for key, one in filed_entries(kept).items()} == of


def test_every_figure_of_the_page_is_there(tmp_path: Path) -> None:
    page = page_of(tmp_path, write(tmp_path / "a.jsonl", CASES))
    figures = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", page)
    assert sorted(figures) == ["figures/confusion-pairs.png", "figures/reliability.png"]
    assert all((tmp_path / "docs" / figure).read_bytes().startswith(b"\x89PNG") for figure in figures)


def test_more_than_one_version_is_said(tmp_path: Path) -> None:
    # A file of before versions were recorded, one of now, and one whose case the last file has again.
    bare = [{k: v for k, v in one.items() if k not in RUN} for one in CASES]
    old, new = write(tmp_path / "old.jsonl", bare), write(tmp_path / "new.jsonl", CASES[:2])
    page = page_of(tmp_path, old, new)
    assert "**Cases: 11, run by more than one version of the code:**" in page
    assert cells(page, "not recorded") == [
        ["not recorded", "–", "9", "`catalogue`, `forms`, `none`, `outside`, `pairs`"]
    ]
    assert cells(page, "`abc1234`") == [["`abc1234`", "`0123456789ab`", "2", "`catalogue`"]]
    assert "Cases: 11; the files do not say which version of the code ran them." in page_of(tmp_path, old)
    # A commit that changes only documents is no other version.
    later = write(tmp_path / "later.jsonl", [{**one, "commit": "bcd2345"} for one in CASES[:3]])
    assert "Cases: 11, all run at commit `abc1234`, `bcd2345` (" in page_of(
        tmp_path, write(tmp_path / "all.jsonl", CASES), later
    )
    (by_kind,) = [row for row in cells(page, "`none`") if row[1] == "30 dB: 7"]
    assert by_kind[-2:] == ["10 / 10", "–"]  # as discovery itself tells


def test_a_page_of_no_case_says_so(tmp_path: Path) -> None:
    assert "No case has been filed." in page_of(tmp_path, write(tmp_path / "a.jsonl", []))


def test_failures_of_other_trials_count_and_a_missing_file_is_no_empty_trial(tmp_path: Path) -> None:
    log = write(tmp_path / "a.jsonl", CASES)
    assert set(filed_entries(log)) - set(finished_entries(log)) == {"outside/30 dB/seed 7/1"}
    assert len(other_cases([log], set())) == 11
    assert len(other_cases([log], {"none/30 dB/seed 7/0"})) == 10
    with pytest.raises(FileNotFoundError):
        other_cases([tmp_path / "b.jsonl"], set())


def test_a_name_above_nine_tenths_in_no_place_is_a_miss() -> None:
    spread = told(("friction", 1, 0.5), ("friction", 2, 0.45))
    spread["probabilities"] = {"friction": 0.95}
    (found,) = misses([FiledCase.of(case("outside", 0, [hidden("snap_window", 1)], spread))], KINDS)
    assert found["what"] == "above 0.9 in `probabilities`, and not there: friction"
    assert [one["probability"] for one in found["told"]] == [0.5]


def test_every_kind_has_its_title() -> None:
    assert set(KIND_TITLES) == set(KINDS)
