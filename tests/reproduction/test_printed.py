"""The printed numbers in the package are the paper's, and each is asked for by a case."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from bwbn_bayes import UserError
from bwbn_bayes.reproduction.cases import DAMAGE_TIMES, Case, building, cases_of, truth_of
from bwbn_bayes.reproduction.options import Options
from bwbn_bayes.reproduction.printed import TABLES, one_row, printed

PAPER = Path(__file__).parents[3] / "shared" / "paper"


@pytest.mark.parametrize("table", TABLES)
def test_the_package_holds_the_paper_s_numbers(table: int) -> None:
    found = sorted(PAPER.glob(f"table{table}*.csv"))
    if not found:
        pytest.skip(f"the paper's tables are not beside this checkout ({PAPER})")
    with found[0].open(encoding="utf-8") as file:
        assert [dict(row) for row in csv.DictReader(file)] == [dict(row) for row in printed(table)]


def test_tables_agree_with_each_other() -> None:
    """Table 3 is group 1 of tables 5, 6 and 7, number by number: typed twice by the paper, read twice here."""
    group_one = [row for table in (5, 6, 7) for row in printed(table) if row["group"] == "1"]
    assert [{**row, "group": "1"} for row in printed(3)] == [dict(row) for row in group_one]


def test_three_numbers_read_off_the_paper_itself() -> None:
    assert one_row(3, method="TMCMC", snr_db="10", excitation="ElCentro")["running_time_s"] == "68014.28"
    assert one_row(2, method="GA", snr_db="inf", excitation="Sin")["k3"] == "-7.89"
    assert one_row(7, group="5", snr_db="10", excitation="ElCentro")["corr_R_x_storey3"] == "0.798"


def test_a_row_that_is_not_there_is_an_error() -> None:
    with pytest.raises(LookupError, match="0 rows"):
        one_row(3, method="IPV", snr_db="20")


def test_every_table_s_cases() -> None:
    assert {table: len(cases_of(table)) for table in TABLES} == {1: 0, 2: 12, 3: 18, 4: 0, 5: 30, 6: 30, 7: 30}
    everything = {case for table in TABLES for case in cases_of(table)}
    assert len(everything) == 90
    assert len({case.key for case in everything}) == 90


@pytest.mark.parametrize("order", ["123", "321"])
def test_a_case_is_the_paper_s_building(order: str) -> None:
    """Group 5 under the sine, TMCMC: jumps to 2.1, bounds 0.1 to 4.2 (table 4); damages at 30, 60, 100 s in turn."""
    case = Case(method="TMCMC", group=5, snr="30", excitation="Sin")
    options = Options(damage_order=order)  # type: ignore[arg-type]
    truth = truth_of(case)
    assert (truth["delta_nu_jump"], truth["delta_eta_jump"], truth["k[2]"], truth["n"]) == (2.1, 2.1, 10.0, 1.5)
    model = building(case, options, identified=True)
    supports = {p.name: p.prior.support for p in model.space.parameters}
    assert len(supports) == 16
    assert supports["delta_nu_jump"] == (0.1, 4.2)
    assert supports["k[3]"] == (5.0, 15.0)
    symbols = [p.symbol for p in model.law.parameters]
    times = model.table.fixed[:, symbols.index("delta_nu_time")].tolist()
    assert times == ([30.0, 60.0, 100.0] if order == "123" else [100.0, 60.0, 30.0])
    known = building(case, options, identified=False)
    assert known.space.n_dim == 0


def test_a_is_identified_only_where_asked() -> None:
    case = Case(method="TMCMC", group=1, snr="30", excitation="ElCentro")
    assert "A" not in building(case, Options(), identified=True).space.names
    free = building(case, Options(free_a=True), identified=True).space
    assert free.parameters[free.names.index("A")].prior.support == (0.1, 2.0)


def test_ipv_has_its_own_exponent_and_groups() -> None:
    for excitation, jump in zip(DAMAGE_TIMES, (2.7, 4.2), strict=True):
        truth = truth_of(Case(method="IPV", group=5, snr="inf", excitation=excitation))
        assert truth["n"] == 1.0
        assert truth["delta_nu_jump"] == pytest.approx(jump)


@pytest.mark.parametrize(
    ("options", "word"),
    [({"damage_order": "213"}, "damage order"), ({"seeds": 0}, "seeds"), ({"error_floor": 0.0}, "error floor")],
)
def test_bad_options_are_named(options: dict[str, object], word: str) -> None:
    with pytest.raises(UserError, match=word):
        Options(**options)  # type: ignore[arg-type]
