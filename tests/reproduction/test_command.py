"""``bwbn reproduce`` as a user types it."""

from __future__ import annotations

from pathlib import Path

import pytest

from bwbn_bayes.cli import main


def test_a_table_of_assignments_needs_no_run(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as leaving:
        main(["reproduce", "zhao2019", "--table", "1", "--table", "4", "--out", str(tmp_path)])
    captured = capsys.readouterr()
    assert leaving.value.code == 0
    assert captured.out.strip() == str(tmp_path / "reproduction.html")
    assert "0 cases run" in captured.err
    page = (tmp_path / "reproduction.html").read_text(encoding="utf-8")
    assert "Table 1" in page and "Table 4" in page and "Table 3" not in page


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("zhao2020",), "zhao2019"),
        (("zhao2019", "--table", "8"), "--table"),
        (("zhao2019", "--error-floor", "0"), "error floor is 0"),
        (("zhao2019", "--generations", "0"), "--generations"),
    ],
)
def test_a_mistake_is_one_sentence(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    sentence: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as leaving:
        main(["reproduce", *arguments])
    captured = capsys.readouterr()
    assert leaving.value.code == 2
    assert captured.err.startswith("error: ")
    assert sentence in captured.err
    assert len(captured.err.splitlines()) == 1
