"""One tiny case end to end: what it measures, the page's columns, and that finished cases are kept."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from bwbn_bayes import BoucWen, ShearBuilding, Uniform, UserError, el_centro, simulate
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.reproduction import workflow
from bwbn_bayes.reproduction.cases import Case, MethodName, building, truth_of
from bwbn_bayes.reproduction.comparison import comparison
from bwbn_bayes.reproduction.measure import Histories, Outcome, clean_record, cramer_rao_sd
from bwbn_bayes.reproduction.options import Options
from bwbn_bayes.reproduction.page import costs, errors, findings
from bwbn_bayes.reproduction.printed import printed
from bwbn_bayes.reproduction.workflow import Files, _jobs, fingerprint, reproduce

OPTIONS = Options(quick=True, generations=2, sine_duration=20.0, el_centro_version="chopra")
"""The short version of El Centro: a test, not a reproduction."""
CASES = [
    Case(method="IPV", group=1, snr="30", excitation="ElCentro"),
    Case(method="GA", group=1, snr="inf", excitation="ElCentro"),
]


class Cells(HTMLParser):
    """Text of every cell, row by row."""

    def __init__(self) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.inside = False

    def handle_starttag(self, tag: str, attrs: object) -> None:
        if tag == "tr":
            self.rows.append([])
        self.inside = tag in ("td", "th")
        if self.inside:
            self.rows[-1].append("")

    def handle_endtag(self, tag: str) -> None:
        self.inside = self.inside and tag not in ("td", "th")

    def handle_data(self, data: str) -> None:
        if self.inside:
            self.rows[-1][-1] += data


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    return reproduce(tmp_path_factory.mktemp("reproduction"), options=OPTIONS, cases=CASES)


def test_a_table_of_what_is_assumed_needs_no_case(tmp_path: Path) -> None:
    """``--table 1`` ended in "cannot be written": no case had made the directory."""
    made = reproduce(tmp_path / "new" / "out", tables=(1,), options=OPTIONS)
    assert made.n_run == made.n_kept == 0
    assert made.html.is_file()
    assert made.csv.is_file()


@pytest.fixture
def directory(files: Files) -> Path:
    """Where both cases are finished."""
    return files.html.parent


@pytest.fixture(scope="module")
def rows(files: Files) -> list[list[str]]:
    cells = Cells()
    cells.feed(files.html.read_text(encoding="utf-8"))
    return cells.rows


def test_every_printed_number_stands_in_the_page(rows: list[list[str]]) -> None:
    """Row by row: the table's own name of the case and the quantity, then the number as printed."""
    compared = {tuple(row[:6]) for row in rows if len(row) == 11}
    for table in (2, 3, 5, 6, 7):
        for row in printed(table):
            case = (row["method"], row.get("group", "1"), row["snr_db"], row["excitation"])
            for quantity in set(row) - {"method", "group", "snr_db", "excitation"}:
                assert (*case, quantity, row[quantity]) in compared, (table, case, quantity)
    shown = [tuple(row) for row in rows]
    for table in (1, 4):
        assert all(tuple(row.values()) in shown for row in printed(table))


def test_the_page_says_what_was_assumed_and_that_it_was_quick(files: Files) -> None:
    page = unescape(files.html.read_text(encoding="utf-8"))
    assert "A quick run" in page
    for option, sentence in OPTIONS.sentences():
        assert option in page
        assert sentence in page
    assert 'src="data:image/png;base64,' in page
    assert "http" not in page.replace("https://doi", "")


def test_the_csv_holds_paper_and_ours(files: Files) -> None:
    with files.csv.open(encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == 12 * 17 + (18 + 90) * 7
    ipv = [line for line in lines if line["method"] == "IPV" and line["ours"]]
    # Table 3 and table 5 hold the case: three storeys, two correlations and one time in each.
    assert len(ipv) == 2 * 7
    for line in ipv:
        if line["quantity"].startswith("corr"):
            # 30 dB: the noise of a sum of accelerations is no larger than 10^(-30/20) of the sum's rms by much.
            assert 0.999 < float(line["ours"]) < 1.0
            assert float(line["ours_noisy"]) > 0.99999
            assert float(line["ours"]) >= float(line["paper"])


def test_finished_cases_are_kept_and_an_interrupted_one_is_run_again(directory: Path, files: Files) -> None:
    assert (files.n_run, files.n_kept) == (2, 0)
    again = reproduce(directory, options=OPTIONS, cases=CASES)
    assert (again.n_run, again.n_kept) == (0, 2)
    (finished,) = (directory / "cases").glob(f"*/{CASES[0].key}_seed1.json")
    finished.rename(finished.with_suffix(".partial"))
    assert reproduce(directory, tables=[5], options=OPTIONS, cases=CASES).n_run == 1


def test_other_assumptions_do_not_share_a_cache() -> None:
    """More seeds do: they only add cases. So do the settings of a method that the case does not use."""

    def mark(options: Options, method: MethodName, *, predicts: bool = True) -> str:
        return fingerprint(options, method, predicts=predicts)

    assert mark(OPTIONS, "TMCMC") == mark(replace(OPTIONS, seeds=10, quick=False), "TMCMC")
    own: dict[MethodName, dict[str, object]] = {
        "IPV": {"damage_order": "321", "error_floor": 2e-3, "free_a": True},
        "GA": {"damage_order": "321", "generations": 7, "growing": False},
        "TMCMC": {"damage_order": "321", "error_floor": 2e-3, "free_a": True, "particles": 600},
    }
    for method, changes in own.items():
        others = {mark(replace(OPTIONS, **{name: value}), method) for name, value in changes.items()}  # type: ignore[arg-type]
        assert len(others | {mark(OPTIONS, method)}) == 1 + len(changes)
    assert mark(OPTIONS, "TMCMC") == mark(replace(OPTIONS, generations=7), "TMCMC")
    assert mark(OPTIONS, "GA") == mark(replace(OPTIONS, particles=600), "GA")
    assert mark(OPTIONS, "IPV") != mark(OPTIONS, "IPV", predicts=False)


@pytest.mark.parametrize("particles", [100, 600])
def test_a_further_seed_does_not_stand_in_for_a_first_one(particles: int) -> None:
    """It has fewer particles and no prediction, also where its number is asked for alone."""
    case, options = Case(method="TMCMC", group=1, snr="30", excitation="Sin"), replace(OPTIONS, particles=particles)
    first, second = _jobs(case, replace(options, seeds=2))
    (own,) = _jobs(case, replace(options, seed=2))
    assert (first.predicts, second.predicts, own.predicts) == (True, False, True)
    assert (first.options.particles, second.options.particles) == (particles, options.further_particles)
    assert second.seed == own.seed == 2
    assert len({job.path(Path()) for job in (first, second, own)}) == 3


def test_a_broken_cache_is_one_sentence(directory: Path) -> None:
    """It is read before anything runs again."""
    path = next((directory / "cases").glob(f"*/{CASES[1].key}_seed1.json"))
    whole = path.read_text(encoding="utf-8")
    path.write_text("{", encoding="utf-8")
    with pytest.raises(UserError, match="remove it and run again"):
        reproduce(directory, tables=[6], options=OPTIONS, cases=CASES[1:])
    path.write_text(whole, encoding="utf-8")


def test_a_full_disk_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It ended in a traceback."""

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    histories = Histories(drift=np.zeros(1), true=np.zeros(1), identified=np.zeros(1))
    monkeypatch.setattr(workflow, "run_case", lambda *_, **__: (None, histories))
    monkeypatch.setattr("numpy.savez_compressed", full)
    with pytest.raises(UserError, match=r"No space left on device\): finished cases are kept"):
        reproduce(tmp_path, options=OPTIONS, cases=CASES)


def test_an_unknown_table_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="table 8"):
        reproduce(tmp_path, tables=[8])


def made(method: str, seed: int, value: float, correlation: float = 0.9) -> Outcome:
    case = Case(method=method, group=1, snr="30", excitation="Sin")  # type: ignore[arg-type]
    force = dict.fromkeys(("R_t_truth", "R_x_truth"), correlation)
    force |= {"R_t_noisy": 0.8, "R_x_noisy": 0.8, "nrmse": 0.01}
    parameter = {"true": 10.0, "value": value, "sd": 0.1, "low": 9.9, "high": 10.1, "cramer_rao": 0.2}
    return Outcome(
        case=case,
        seed=seed,
        elapsed_s=2.0,
        n_solves=7,
        force={str(i): force for i in (1, 2, 3)},
        parameters={"k[1]": parameter},
    )


def test_errors_of_several_seeds_are_medians() -> None:
    """k of 10: errors of +1, -3 and +2 % have a median size of 2 %; the Cramer-Rao sd of 0.2 is 2 % too."""
    lines = comparison([2], [made("TMCMC", seed, value) for seed, value in ((1, 10.1), (2, 9.7), (3, 10.2))])
    (line,) = [line for line in lines if line.quantity == "k1" and np.isfinite(line.ours)]
    assert (line.ours, line.limit) == (pytest.approx(2.0), pytest.approx(2.0))
    assert (line.n_covered, line.n_seeds, line.paper) == (3, 3, "5.57")
    (single,) = [x for x in comparison([2], [made("TMCMC", 1, 9.7)]) if x.quantity == "k1" and np.isfinite(x.ours)]
    assert single.ours == pytest.approx(-3.0)


def test_coverage_and_digits_of_an_outcome() -> None:
    outcome = made("TMCMC", 1, 10.0)
    assert outcome.coverage == 1.0
    assert outcome.digits == pytest.approx(2.0)
    assert Outcome.from_json(json.loads(json.dumps(outcome.as_json()))) == outcome


def test_the_page_says_which_reference_the_printed_numbers_fit() -> None:
    """TMCMC under the sine at 30 dB is printed as 0.9108, 0.9138, 0.9259: mean 0.9168, nearer to 0.9 than to 0.8."""
    (sentence,) = findings(comparison([3], [made("TMCMC", 1, 10.0)]))
    assert "0.9168 printed" in sentence
    assert sentence.endswith("fits neither; the noise-free truth is nearer, 0.0168 away.")
    (sentence,) = findings(comparison([3], [made("TMCMC", 1, 10.0, correlation=0.91)]))
    assert sentence.endswith("fits ours with the noise-free truth.")


def test_the_page_says_how_large_errors_are_and_what_they_cost() -> None:
    """k of 10: median error 2 % against a bound of 2 %; the paper's 69,334 s against 2 s. One of three misses."""
    outcomes = [made("TMCMC", seed, value) for seed, value in ((1, 10.1), (2, 9.7), (3, 10.2))]
    low, high = 9.65, 9.75
    missed = replace(outcomes[1], parameters={"k[1]": {**outcomes[1].parameters["k[1]"], "low": low, "high": high}})
    lines = comparison([2, 3], [outcomes[0], missed, outcomes[2]])
    (error,) = errors(lines)
    assert error.startswith("Sin at 30 dB, 3 seeds: 1 of 1 median errors are within their Cramér-Rao sd")
    assert error.endswith("the largest (k1) is 1.00 of it; 90 % intervals hold 2 of 3 true values.")
    (cost,) = costs(lines)
    assert cost.startswith("TMCMC: 6")
    assert cost.endswith(" s printed, 2 s here.")


def test_cramer_rao_is_the_inverse_information_of_finite_differences() -> None:
    """Independent: central differences of the lane engine's response, and a plain inverse."""
    case = Case(method="GA", group=1, snr="30", excitation="ElCentro")
    model, truth = building(case, OPTIONS, identified=True), truth_of(case)
    record = clean_record(building(case, OPTIONS, identified=False), "ElCentro", OPTIONS).select(["acceleration_1"])
    engine = Lanes(substeps=4, resolution=0.06)
    centre = model.draws({name: truth[name] for name in model.space.names})[0]
    steps = 1e-5 * np.maximum(np.abs(centre), 0.1)
    both = np.concatenate([centre + np.diag(steps), centre - np.diag(steps)])
    values = engine.simulate(model, both, record).values[:, 0]
    slopes = (values[: len(centre)] - values[len(centre) :]) / (2.0 * steps[:, None])
    scaled = slopes * np.maximum(np.abs(centre), 0.1)[:, None]
    expected = np.sqrt(np.diag(np.linalg.inv(scaled @ scaled.T / 0.02**2))) * np.maximum(np.abs(centre), 0.1)
    found = cramer_rao_sd(model, truth, record, (0.02,))
    inside = [i for i, name in enumerate(model.space.names) if name not in ("delta_nu", "delta_eta")]
    assert found[inside] == pytest.approx(expected[inside], rel=0.05)


def test_a_redundant_direction_takes_no_bound_from_what_lies_outside_it() -> None:
    """With A free one scale cannot be seen: what shares it has no bound, c and n have the bound that A = 1 gives."""
    truth = {"k": 20.0, "c": 0.1, "alpha": 0.05, "A": 1.0, "beta": 2.0, "gamma": 2.0, "n": 1.5}
    priors = {name: Uniform(0.5 * value, 1.5 * value) for name, value in truth.items() if name != "n"}
    priors["n"] = Uniform(1, 4)
    free = ShearBuilding(masses=[1.0], storey=BoucWen(**priors))
    known = ShearBuilding(masses=[1.0], storey=BoucWen(**(priors | {"A": 1.0})))
    given = ShearBuilding(masses=[1.0], storey=BoucWen(**truth))
    record = simulate(given, el_centro("chopra", duration=12.0), {}, channels=["acceleration_1"])
    with_a = dict(zip(free.space.names, cramer_rao_sd(free, truth, record, (0.02,)), strict=True))
    without = dict(zip(known.space.names, cramer_rao_sd(known, truth, record, (0.02,)), strict=True))
    assert {name for name, sd in with_a.items() if np.isinf(sd)} == {"k", "alpha", "A", "beta", "gamma"}
    assert np.all(np.isfinite(list(without.values())))
    for name in ("c", "n"):
        assert with_a[name] == pytest.approx(without[name], rel=1e-6)


@pytest.mark.slow
def test_a_noisy_posterior_case_against_the_paper(tmp_path: Path) -> None:
    """TMCMC under El Centro at 30 dB: the force is better than printed, most intervals hold the truth.

    With 90 % intervals of 16 correlated parameters, 10 covered is the 0.1 % quantile of independent ones.
    """
    case = Case(method="TMCMC", group=1, snr="30", excitation="ElCentro")
    files = reproduce(tmp_path, tables=[2, 3], options=Options(quick=True, particles=500), cases=[case])
    with files.csv.open(encoding="utf-8") as file:
        lines = [line for line in csv.DictReader(file) if line["ours"]]
    forces = [line for line in lines if line["quantity"].startswith("corr_R_x")]
    assert len(forces) == 3
    assert all(float(line["ours"]) > 0.9999 for line in forces)
    assert sum(line["n_covered"] == "1" for line in lines if line["table"] == "2") >= 10
