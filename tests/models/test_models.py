"""Every model file loads, and can make the record it promises."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from bwbn_bayes.elements.loops import pinching_index
from bwbn_bayes.engines.simulation import simulate
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Uniform
from bwbn_bayes.records.cycles import half_cycles
from bwbn_bayes.structures.model_file import load_model_file

MODELS = Path(__file__).parents[2] / "models"
FILES = sorted(MODELS.glob("*.py"))

PLAIN = {
    **{f"k[{storey}]": Uniform(5, 60) for storey in (1, 2, 3)},
    **{f"c[{storey}]": Uniform(0, 0.5) for storey in (1, 2, 3)},
    "alpha": Uniform(0.001, 0.3),
    "beta": Uniform(0.1, 8),
    "gamma": Uniform(-4, 8),
    "n": Uniform(1, 4),
}

PAPER_TABLE_1 = """
quantity, sine_true, sine_lower, sine_upper, el_centro_true, el_centro_lower, el_centro_upper
k[1], 10, 5, 15, 20, 15, 25
k[2], 10, 5, 15, 20, 15, 25
k[3], 10, 5, 15, 20, 15, 25
c[1], 0.05, 0.01, 0.1, 0.05, 0.01, 0.1
c[2], 0.05, 0.01, 0.1, 0.05, 0.01, 0.1
c[3], 0.05, 0.01, 0.1, 0.05, 0.01, 0.1
alpha, 0.01, 0.001, 0.02, 0.01, 0.001, 0.02
beta, 2, 0.1, 4, 2, 0.1, 4
gamma, 2, 0.1, 4, 2, 0.1, 4
n, 1.5, 1, 2, 1.5, 1, 2
delta_nu, 0, 0, 0.1, 0, 0, 0.1
delta_nu_jump, 1.5, 0.1, 3, 3, 0.1, 6
delta_eta, 0, 0, 0.1, 0, 0, 0.1
delta_eta_jump, 1.5, 0.1, 3, 3, 0.1, 6
sigma, 0.01, 0.001, 0.02, 0.01, 0.001, 0.02
delta_s, 0.05, 0.01, 0.1, 0.05, 0.01, 0.1
"""
"""Zhao et al. 2019, doi:10.3389/fbuil.2018.00080, table 1, without A, which the models fix at 1."""


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_model_file_is_documented_and_its_truth_has_prior_density(path: Path) -> None:
    file = load_model_file(path)
    assert path.read_text(encoding="utf-8").startswith('"""')
    if file.truth:
        space = file.model.space
        assert space.admissible(file.model.draws(file.truth)).all()
        assert all(np.isfinite(p.prior.log_density(file.truth[p.name])) for p in space.parameters)
        assert file.excitation is not None
        assert file.snr_db is not None
        assert file.assumptions


@pytest.mark.parametrize(("name", "case"), [("three_storey_sine", "sine"), ("three_storey_el_centro", "el_centro")])
def test_the_paper_s_cases_hold_its_printed_numbers(name: str, case: str) -> None:
    file = load_model_file(MODELS / f"{name}.py")
    rows = list(csv.DictReader(PAPER_TABLE_1.strip().splitlines(), skipinitialspace=True))
    printed = {
        row["quantity"]: [float(row[f"{case}_{column}"]) for column in ("true", "lower", "upper")] for row in rows
    }
    space = file.model.space
    assert {p.name: [file.truth[p.name], *p.prior.support] for p in space.parameters} == printed


def test_the_assumed_sine_makes_the_ground_floor_yield() -> None:
    file = load_model_file(MODELS / "three_storey_sine.py")
    assert file.excitation is not None
    assert (file.excitation.n_times, file.excitation.time_step) == (7501, 0.02)
    response = simulate(file.model, file.excitation, file.truth, channels=["drift_1"])
    hysteretic_bound = (1.0 / (file.truth["beta"] + file.truth["gamma"])) ** (1.0 / file.truth["n"])
    assert np.max(np.abs(response.channels["drift_1"])) > 2.0 * hysteretic_bound


def test_the_plain_model_is_the_one_that_users_are_promised() -> None:
    file = load_model_file(MODELS / "plain_three_storey.py")
    assert {p.name: p.prior for p in file.model.space.parameters} == PLAIN
    assert file.model.masses == (1.0, 1.0, 1.0)
    assert file.model.element.A == 1.0
    assert file.model.effects == ()
    assert file.excitation is None


def test_the_single_storey_identifies_at_least_six_parameters() -> None:
    file = load_model_file(MODELS / "sdof.py")
    assert file.model.n_links == 1
    assert file.model.space.n_dim >= 6


def test_the_hidden_effect_s_model_is_the_plain_one_with_two_measured_records() -> None:
    file = load_model_file(MODELS / "hidden_effect.py")
    assert file.model == load_model_file(MODELS / "plain_three_storey.py").model
    assert file.record is not None
    assert file.held_out is not None
    assert not np.array_equal(file.record.excitation, file.held_out.excitation)
    for record in (file.record, file.held_out):
        assert record.floors == (1, 2, 3)
        assert not record.truth
        assert not record.noise_sd


@pytest.mark.parametrize("name", ["record", "held_out"])
@pytest.mark.parametrize(
    ("value", "sentence"),
    [("[1.0]", "must be a Record"), ("el_centro(duration=1.0)", "measures nothing")],
)
def test_a_measured_record_that_is_none_is_refused(tmp_path: Path, name: str, value: str, sentence: str) -> None:
    path = tmp_path / "bad.py"
    plain = (MODELS / "plain_three_storey.py").read_text(encoding="utf-8")
    path.write_text(f"{plain}\nfrom bwbn_bayes import el_centro\n\n{name} = {value}\n", encoding="utf-8")
    with pytest.raises(UserError, match=f"bad.py: `{name}` {sentence}"):
        load_model_file(path)


def test_the_cyclic_test_looks_like_the_column_that_it_was_written_for() -> None:
    """16 cycles to 20.7 mm and 409 kN were measured: the file's own record must be of that kind, without time."""
    file = load_model_file(MODELS / "cyclic_test.py")
    assert file.model.is_driven
    assert file.excitation is not None
    assert not file.excitation.has_time
    made = simulate(file.model, file.excitation, file.truth, snr_db=file.snr_db, seed=1)
    assert len(half_cycles(made.excitation)) == 31  # the first starts at zero, 15 cycles have two, and one comes back
    assert np.max(np.abs(made.excitation)) == pytest.approx(0.0205)
    assert 0.8 * 409e3 < np.max(np.abs(made.channels["force"])) < 1.2 * 409e3
    # Fat, as that column is: its index is 0.66.
    assert pinching_index(made.excitation, made.channels["force"]) > 0.5
