"""What a long benchmark has finished is kept."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import telling


def test_what_is_finished_is_filed_and_by_the_same_code_not_run_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(telling, "commit", lambda: "abc1234")
    ran: list[str] = []

    def job(name: str, *, fails: bool = False) -> dict[str, str]:
        ran.append(name)
        if fails:
            raise KeyboardInterrupt
        return {"found": name}

    path = tmp_path / "lines.json"
    with pytest.raises(KeyboardInterrupt):
        telling.gather({"first": lambda: job("first"), "second": lambda: job("second", fails=True)}, path)
    jobs = {name: (lambda name=name: job(name)) for name in ("second", "first")}
    lines = telling.gather(jobs, path)
    assert ran == ["first", "second", "second"]
    assert lines == [{"job": "second", "found": "second"}, {"job": "first", "found": "first"}]
    monkeypatch.setattr(telling, "commit", lambda: "another")
    assert telling.gather(jobs, path) == lines
    assert ran[3:] == ["second", "first"]
    monkeypatch.setattr(telling, "commit", lambda: "abc1234-dirty")
    for _ in range(2):
        telling.gather(jobs, path)
    assert ran[5:] == ["second", "first"] * 2


def test_without_a_file_every_job_runs() -> None:
    assert telling.gather({"one": lambda: {"found": 1}}, None) == [{"job": "one", "found": 1}]
