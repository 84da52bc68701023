"""Blind cyclic tests are a function of their seed, look like measured ones, and hide what they say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.blind import cases
from benchmarks.blind.cases import Setting, make_case
from benchmarks.blind.cyclic import CYCLIC, PINCHED, PINCHES, QUIETER_DB, UNNAMED, cyclic_test, zero_force_ratio
from benchmarks.blind.path import Loop, follow
from benchmarks.blind.simulator import Building, Floats
from benchmarks.blind.storey import Storey, ultimate_displacement
from benchmarks.blind.unnamed import unnamed_force
from bwbn_bayes.records import half_cycles, read_csv, repeats, write_csv

UNJUDGED = Setting(judged=False)


def law(truth: cases.Truth) -> Storey:
    building = Building(storeys=(Storey(c=0.0, **truth.base),))
    for effect in truth.effects:
        building = effect.inside(building)
    return building.storeys[0]


def of(name: str, seed: int, *, judged: bool = False) -> cases.Case:
    """The case of a seed that hides an entry of the table."""
    index = next(i for i in range(len(CYCLIC)) if tuple(cases._draws("cyclic", seed, i)) == CYCLIC[name])
    return make_case("cyclic", seed, index, 30.0, Setting(judged=judged))


def test_a_case_is_a_function_of_its_seed_and_index() -> None:
    first, again, other = (make_case("cyclic", seed, 1, 30.0, UNJUDGED) for seed in (4, 4, 5))
    assert first.record.equals(again.record)
    assert first.held_out.equals(again.held_out)
    assert first.truth == again.truth
    assert first.record.content_hash != other.record.content_hash


def test_every_run_of_cases_holds_every_entry_once() -> None:
    n = len(CYCLIC)
    for turn in (0, 1):
        drawn = [tuple(cases._draws("cyclic", 8, turn * n + i)) for i in range(n)]
        assert sorted(map(len, drawn)) == sorted(map(len, CYCLIC.values()))
        assert set(drawn) == set(CYCLIC.values())


@pytest.mark.parametrize("index", range(3))
def test_it_looks_like_a_measured_test(index: int, tmp_path: Path) -> None:
    """A path without time, growing amplitudes that are repeated, two columns in steps; nothing told in the file."""
    case = make_case("cyclic", 7, index, 30.0, UNJUDGED)
    for written in (case.record, case.held_out):
        write_csv(written, tmp_path / "test.csv")
        record = read_csv(tmp_path / "test.csv")
        assert not record.has_time
        assert not record.truth
        assert not record.noise_sd
        assert set(record.provenance) == {"time_base"}
        cycles = half_cycles(record.excitation)
        large = [cycle.amplitude for cycle in cycles if cycle.amplitude > 0.0]
        assert np.mean(large[:4]) < 0.5 * np.mean(large[-4:])
        assert max(repeats(cycles)) >= 1
        for column in (record.excitation, record.channels["force"]):
            step = 10.0 ** np.floor(np.log10(np.max(np.abs(column)) / 400.0))
            smallest = min(step, step / 10.0)
            assert np.max(np.abs(column / smallest - np.round(column / smallest))) < 1e-6
            assert len(np.unique(column)) < 0.999 * len(column)
    assert np.max(np.abs(case.held_out.excitation)) < np.max(np.abs(case.record.excitation))


@pytest.mark.parametrize("name", ["nothing", "stiffness, saturating", "pinch, stiffness and strength"])
def test_what_the_truth_leaves_is_what_is_said(name: str) -> None:
    """The law in the truth leaves the unnamed force, ten times the noise and more, on both tests."""
    case = of(name, 9)
    truth = case.truth
    assert UNNAMED[0] <= truth.unnamed_share <= UNNAMED[1]
    signal = case.record.channels["force"]
    left = signal - follow(law(truth), case.record.excitation).force
    rms = float(np.sqrt(np.mean(signal**2)))
    # The digits of the displacement leave up to half a per cent where the loop is steep.
    assert np.sqrt(np.mean(left**2)) / rms == pytest.approx(truth.unnamed_share, rel=0.15, abs=0.005)
    assert truth.noise_sd[0] / rms == pytest.approx(10.0 ** (-(30.0 + QUIETER_DB) / 20.0), rel=0.1)
    floor = case.held_out.channels["force"] - follow(law(truth), case.held_out.excitation).force
    assert np.sqrt(np.mean(floor**2) / np.mean(case.held_out.channels["force"] ** 2)) == pytest.approx(
        truth.held_out_floor, rel=0.1, abs=0.005
    )


def test_a_pinch_that_is_hidden_shows() -> None:
    for name in ("slip", "pinch", "slip, saturating", "slip and strength, with cycles"):
        truth = of(name, 3).truth
        record = of(name, 3).record
        assert truth.effects[0].accepted == PINCHES
        assert zero_force_ratio(follow(law(truth), record.excitation)) < 1.1 * PINCHED
    plain = of("nothing", 3)
    assert zero_force_ratio(follow(law(plain.truth), plain.record.excitation)) > 0.4


def test_the_ratio_at_zero_displacement_of_a_rigid_plastic_loop_is_one_of_an_elastic_one_zero() -> None:
    u = np.sin(np.linspace(0.0, 12.0, 400))

    def loop(force: Floats) -> Loop:
        return Loop(displacement=u, force=force, hysteretic_displacement=u, energy=u, path=u)

    assert zero_force_ratio(loop(3.0 * u)) == pytest.approx(0.0, abs=1e-12)
    assert zero_force_ratio(loop(np.sign(np.gradient(u)))) == pytest.approx(1.0)


def test_no_simple_law_explains_the_unnamed_force() -> None:
    """Springs, an asymmetry and their wear with the path account for nothing of it, along the loop it was drawn for."""
    base = Storey(k=1e7, c=0.0, alpha=0.05, beta=1.0, gamma=0.5, n=1.5)
    bound = ultimate_displacement(base)
    amplitudes = bound * np.repeat([0.5, 1.0, 2.0, 4.0, 6.0], 4) * np.tile([1.0, -1.0], 10)
    ways = [np.linspace(a, b, 151)[1:] for a, b in zip(np.append(0.0, amplitudes[:-1]), amplitudes, strict=True)]
    loop = follow(base, np.concatenate([[0.0], *ways]))
    drawn = unnamed_force(np.random.default_rng(4), loop, 50.0)
    force = drawn.along(loop)
    assert np.sqrt(np.mean(force**2)) == pytest.approx(50.0)
    u, z, path = loop.displacement, loop.hysteretic_displacement, loop.path
    for law_force in (np.ones_like(u), u, u**2, u**3, z, z**2, z * path, u * path, u**3 * path):
        assert abs(np.corrcoef(force, law_force)[0, 1] if np.ptp(law_force) else np.mean(force) / 50.0) < 1e-6
    # Smooth: over a twelfth of the yield displacement it changes by a small part of its size.
    assert np.sqrt(np.mean(np.diff(force) ** 2)) < 0.1 * 50.0
    # A state of the specimen decides it, not the sample: another protocol through the same states has the same force.
    finer = follow(base, np.interp(np.arange(0, len(u) - 0.5, 0.5), np.arange(len(u)), u))
    np.testing.assert_allclose(drawn.along(finer)[::2], force, atol=0.01 * 50.0)


def test_what_shows_is_counted_in_nats_of_correlated_noise() -> None:
    """A strong pinch speaks by hundreds of nats against the plain law; one of a thousandth of its size by none."""
    case = of("pinch", 3, judged=True)
    assert case.truth.nats[0] > 100.0
    (draw,) = CYCLIC["strength"]

    def faint(place: object) -> object:
        found = draw(place)  # type: ignore[arg-type]
        return replace(found, storey_values={"delta_nu": 1e-3 * found.storey_values["delta_nu"]})

    test = cyclic_test(np.random.default_rng(3), [faint], 30.0, "faint", judged=True)  # type: ignore[list-item]
    assert abs(test.nats[0]) < 10.0
