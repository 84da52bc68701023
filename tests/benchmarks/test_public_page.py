"""The page of public benchmarks says what its JSON says."""

from __future__ import annotations

import copy
import json
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks import boucwen, public

FOUND = {
    "model": "found from a linear oscillator",
    "n_parameters": 6,
    "verdict": "partly_explained",
    "effects": [
        {"name": "hysteresis", "title": "hysteresis (a Bouc-Wen spring)", "grade": "named", "probability": 0.9991},
        {"name": "backlash", "title": "backlash", "grade": "possible", "probability": 0.62},
    ],
    "probabilities": {"hysteresis": 0.9991, "backlash": 0.62, "appendage": 0.03, "gap_impact": 1e-5},
    "gap": {"noise_floor": 0.012, "fit": {"before": 0.3456, "after": 0.0234}},
    "unnamed": {"function": "of the drift alone", "share": 0.021, "probability": 0.97},
    "where_left": ["floor 1, 3 to 4 s: residual 2.9 times the noise"],
    "processor": "some processor",
    "processor_seconds": 41.6,
}
GIVEN = {
    "model": "Bouc-Wen, given",
    "n_parameters": 5,
    "inside_99": {"k": True, "c": True},
    "without_hardening": "The best fit lies at the edge of what is admitted.",
    "processor": "some processor",
    "processor_seconds": 100.0,
}
MISSED = {"small": 17.31, "large": 52.04, "large in sequence": 50.0}


def sources() -> dict[str, Any]:
    """What the three benchmarks write."""
    boucwen, silverbox = (
        [{**GIVEN, key: {one: 1.234e-7, other: 2.5e-6}}, {**FOUND, key: {one: 4.321e-7, other: 2.6e-6}}]
        for key, one, other in (("rmse_m", "multisine", "sinesweep"), ("missed_mV", "test_arrow", "test_multisine"))
    )
    frame = [{**line, "fitted_on": "both in sequence", "missed_percent": MISSED} for line in (GIVEN, FOUND)]
    every = {"boucwen": boucwen, "silverbox": silverbox, "frame": frame}
    return {name: {"commit": "abc1234", "lines": lines} for name, lines in every.items()}


def page(written: dict[str, Any], folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Written by the command."""
    arguments = ["public", "--page", str(folder / "page.md")]
    for name, source in written.items():
        (folder / f"{name}.json").write_text(json.dumps(source), encoding="utf-8")
        arguments += [f"--{name}", str(folder / f"{name}.json")]
    monkeypatch.setattr(sys, "argv", arguments)
    public.main()
    return (folder / "page.md").read_text("utf-8")


def test_figures_effects_and_what_is_left_stand_on_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = page(sources(), tmp_path, monkeypatch)
    assert "| multisine [m] | 5e-07 | **1.23e-07** | **4.32e-07** | 7.53e-6" in text
    assert "| found from a linear oscillator | 6 | both in sequence | 17.3 % | 52.0 % | 50.0 % | 42 |" in text
    assert "| hysteresis (a Bouc-Wen spring) | named | > 0.99 |" in text
    assert "| backlash | possible | 0.62 |" in text
    assert "Considered and not added: `appendage`, probability 0.03." in text
    assert "gap_impact" not in text
    assert "from 34.6 to 2.34 % of the signal; noise\nalone would leave 1.2." in text
    assert "Its errors are 3.50 and 1.04 times those of the spring" in " ".join(text.split())
    assert "a force of the drift alone, its rms 2.1 % of the storey force's." in text
    assert "- floor 1, 3 to 4 s: residual 2.9 times the noise" in text
    assert "abc1234 on some processor" in text
    assert "All true parameters lie in their 99 % intervals." in text
    assert "\n\nOf priors that exclude it, on 1,024 samples, it is said:\n\n> The best fit lies at the edge" in text
    assert "what is admitted.\n\nFrom" in text


def test_a_parameter_outside_its_interval_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written = copy.deepcopy(sources())
    written["boucwen"]["lines"][0]["inside_99"]["c"] = False
    assert "Not all true parameters lie in their 99 % intervals." in page(written, tmp_path, monkeypatch)


def test_priors_that_exclude_the_loops_that_harden_are_said_to_bind() -> None:
    assert "the edge of what beta + gamma >= 0 admits (hardens=True is without it)" in boucwen.without_hardening(1)
