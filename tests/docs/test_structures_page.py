"""The page's structures are built and solved."""

from __future__ import annotations

from pages import run_page


def test_the_page_runs(capsys) -> None:
    names = run_page("structures.md")
    said = capsys.readouterr().out.splitlines()
    *shown, virgin, in_sequence = said
    assert shown == [
        "((0, 1), (1, 2), (0, 2))",
        "[0.2084, 0.0021]",
        "['applied_force_1', 'displacement_1']",
        "('u_0',)",
        "6 True",
    ]
    spread = [float(line.split("+-")[1]) for line in (virgin, in_sequence)]
    assert spread[1] < spread[0]
    assert names["towers"].links_below(3) == (1, 3)
