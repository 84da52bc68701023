"""The page's structures are built and solved."""

from __future__ import annotations

from pages import run_page


def test_the_page_runs(capsys) -> None:
    names = run_page("structures.md")
    said = capsys.readouterr().out.splitlines()
    assert said == ["((0, 1), (1, 2), (0, 2))", "[0.2084, 0.0021]", "['applied_force_1', 'displacement_1']"]
    assert names["towers"].links_below(3) == (1, 3)
