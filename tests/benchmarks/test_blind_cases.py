"""Blind cases are a function of seed, kind and index, and are what they say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.blind import cases
from benchmarks.blind.cases import make_case
from benchmarks.blind.catalogue_draws import CATALOGUE
from benchmarks.blind.later_draws import LATER
from benchmarks.blind.more_forms import MORE_FORMS
from benchmarks.blind.other_draws import FORMS, OUTSIDE
from benchmarks.blind.simulator import Floats
from bwbn_bayes.records import Record

SHORT = Record(name="short", time_step=0.02, excitation=np.ones(40))
SMALL = cases.Setting(n_storeys=2, duration=6.0, judged=False)
TABLES = {"catalogue": CATALOGUE, "forms": FORMS, "more_forms": MORE_FORMS, "outside": OUTSIDE, "later": LATER}


@pytest.fixture(autouse=True)
def _no_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cases, "nats_against", lambda *_, **__: 50.0)


@pytest.mark.parametrize("kind", ["none", "pairs"])
def test_a_case_is_a_function_of_its_seed_and_index(kind: cases.Kind) -> None:
    first, again, other = (make_case(kind, seed, 1, 30.0, SMALL) for seed in (4, 4, 5))
    assert first.record.equals(again.record)
    assert first.held_out.equals(again.held_out)
    assert first.truth == again.truth
    assert first.record.content_hash != other.record.content_hash


def test_every_run_of_cases_holds_every_effect_once() -> None:
    for kind, table in TABLES.items():
        n = len(table)
        for turn in (0, 1):
            names = [cases._draws(kind, 8, turn * n + i)[0] for i in range(n)]  # type: ignore[arg-type]
            assert len(set(names)) == n


def test_seeds_that_were_spent_draw_what_they_drew() -> None:
    """A snapshot of November 2026: a table that grows, or a kind put before another, would redraw every spent seed."""

    def order(kind: cases.Kind, n: int) -> list[str]:
        names = {draw: name for name, draw in TABLES[kind].items()}
        return [names[cases._draws(kind, 66, index)[0]] for index in range(n)]

    assert order("forms", 9) == [
        "friction_root", "asymmetry_drift_rate", "pinching_lorentz", "asymmetry_drift", "friction_stick_slip",
        "slip_sech", "gap_softened", "gap_one_sided", "damage_ramp",
    ]  # fmt: skip
    assert order("later", 3) == ["storey_coupling", "sliding_base", "hysteresis"]
    assert order("catalogue", 3) == ["storey_parameter", "stiffness_degradation", "mass_error"]
    assert order("outside", 3) == ["softening_damping", "root_damping", "breathing_stiffness"]
    pair = [hidden.name for hidden in make_case("pairs", 66, 2, 30.0).truth.effects]
    assert pair == ["base_flexibility", "maxwell_branch"]


@pytest.mark.parametrize(("kind", "index", "n_hidden"), [("catalogue", 1, 1), ("catalogue", 2, 1), ("pairs", 3, 2)])
def test_severity_noise_and_records_are_as_stated(kind: cases.Kind, index: int, n_hidden: int) -> None:
    case = make_case(kind, 6, index, 20.0)
    truth, record = case.truth, case.record
    assert len(truth.effects) == len(truth.nats) == n_hidden
    assert truth.detectable
    assert truth.severe == bool(index % 2) == (truth.peak_ratio > 0.85)
    signal = np.array([np.mean(np.square(values)) for values in record.channels.values()])
    # 1,560 samples: the noise variance, and the signal's through it, are known to 4 per cent (one standard error).
    assert np.square(truth.noise_sd) / signal == pytest.approx(0.01 / 1.01, rel=0.16)
    assert truth.held_out_floor == pytest.approx(0.1 / np.sqrt(1.01), rel=0.08)
    assert {record.name, case.held_out.name} == {f"case-{index:04d}", f"case-{index:04d}-held-out"}
    for written in (record, case.held_out):
        assert (written.n_times, written.time_step) == (1560, 0.02)
        assert not written.truth
        assert not written.noise_sd
        assert not written.provenance


def test_a_smaller_setting_draws_smaller_cases() -> None:
    """Two storeys and 6 s; with half of every size range taken away, sizes lie in the upper half."""
    setting = replace(SMALL, raise_by=0.5)
    sizes = {}
    for index in range(len(CATALOGUE)):
        case = make_case("catalogue", 6, index, 40.0, setting)
        (hidden,) = case.truth.effects
        assert set(hidden.storeys) <= {1, 2}
        assert list(case.record.channels) == ["acceleration_1", "acceleration_2"]
        assert case.record.n_times == case.held_out.n_times == 301
        assert set(case.truth.base) == {"k[1]", "k[2]", "c[1]", "c[2]", "alpha", "beta", "gamma", "n"}
        assert case.truth.nats == ()
        sizes.update({hidden.name: hidden.parameters})
    assert set(sizes) == set(CATALOGUE)
    # Ranges of 0.012 to 0.25 and 0.002 to 0.05 s: their geometric middles are 0.055 and 0.01.
    assert abs(sizes["mass_error"]["e_m"]) > 0.0547
    assert abs(sizes["input_scale"]["s_g"] - 1.0) > 0.0547
    assert sizes["sensor_lag"]["lag"] > 0.00999


def test_a_quarter_of_the_cases_without_effect_has_correlated_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    correlated: list[bool] = []
    quiet = cases._noise

    def noted(rng: np.random.Generator, clean: Floats, snr_db: float, memory: bool) -> Floats:
        correlated.append(memory)
        return quiet(rng, clean, snr_db, memory)

    monkeypatch.setattr(cases, "_noise", noted)
    monkeypatch.setattr(
        cases, "_structure", lambda *_: (None, np.zeros(10), (), [SHORT] * 2, [np.ones((3, 40))] * 2, 0)
    )
    made = [make_case("none", 2, index, 30.0).truth for index in range(16)]
    assert [truth.noise for truth in made].count("AR(1)") == 4
    assert correlated == [truth.noise == "AR(1)" for truth in made for _ in ("training", "held out")]
    assert all(truth.effects == () and truth.nats == () and truth.detectable for truth in made)


def test_correlated_noise_has_its_variance_and_its_memory() -> None:
    n = 200_000
    noise = cases._noise(np.random.default_rng(7), np.ones((1, n)), 20.0, True)[0]
    lags = [float(np.mean(noise[lag:] * noise[: n - lag])) for lag in (0, 1, 2)]
    memory = lags[1] / lags[0]
    # Standard errors: of the variance sqrt(2 (1 + m^2) / (1 - m^2) / n), below 1 % for m = 0.8; of m, below 0.3 %.
    assert lags[0] == pytest.approx(0.01, rel=0.04)
    assert 0.3 - 0.01 < memory < 0.8 + 0.01
    assert lags[2] / lags[0] == pytest.approx(memory**2, abs=4.0 * 1.6 / np.sqrt(n))
