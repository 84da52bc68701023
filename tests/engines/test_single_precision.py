"""Lanes of single precision: they add rounding, and neither long records nor late events make more of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from engine_cases import CONVERGED, FREE, TIME_STEP, building, record_of, relative_error

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.effects import SlipLock, StrengthDegradation, SuddenDamage
from bwbn_bayes.engines.base import Status
from bwbn_bayes.engines.kernel import Kernel
from bwbn_bayes.engines.lane_laws import is_compiled
from bwbn_bayes.engines.lane_template import SINGLE_MATHEMATICS
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.precompile import precompile
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.parameters import Floats, PerStorey, Uniform
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen

DOUBLE, SINGLE = Lanes(n_threads=1), Lanes(n_threads=1, single=True)
ROUNDING = 2.0**-24
"""Of a number of 32 bits, relative."""


def _draws(model: ShearBuilding | Specimen, n: int) -> Floats:
    return model.space.from_unit(model.space.sample_unit(np.random.default_rng(3), n))


def test_powers_and_logarithms() -> None:
    """Against NumPy's doubles, over all that is not cut off."""
    text = """
def run(x: floats, power: floats, logarithm: floats):
    for l in range(LANES):
        power[l] = _exp2(x[l])
        logarithm[l] = _log2(power[l])
"""
    kernel = Kernel("probe", f"LANES = 16\nBITS = 32\n{SINGLE_MATHEMATICS}\n{text}")
    for x in np.random.default_rng(1).uniform(-100.0, 127.0, (200, 16)).astype(np.float32):
        power, logarithm = np.empty_like(x), np.empty_like(x)
        kernel.run(x, power, logarithm)
        np.testing.assert_allclose(power, np.exp2(x.astype(np.float64)), rtol=2.0 * ROUNDING)
        np.testing.assert_allclose(logarithm, np.log2(power.astype(np.float64)), rtol=2.0 * ROUNDING, atol=1e-7)


def test_a_text_of_singles_sums_in_doubles() -> None:
    """What is made of the two is a double, and becomes a single where it is put into an array of them."""
    text = """
LANES = 16
BITS = 32
TENTH = 0.1


def run(n: int, h: double, x: floats, total: doubles, shown: floats):
    for i in range(n):
        for l in range(LANES):
            total[l] += x[l] * 0.5
    for l in range(LANES):
        shown[l] = total[l]
    shown[0] = float(h / 3) + TENTH
    total[1] = h / 3
"""
    x, total, shown = np.full(16, 0.1, dtype=np.float32), np.zeros(16), np.zeros(16, dtype=np.float32)
    Kernel("probe", text).run(1000, 0.7, x, total, shown)
    np.testing.assert_allclose(total[2:], 500.0 * x[2:].astype(np.float64), rtol=1e-13)
    np.testing.assert_array_equal(shown[2:], total[2:].astype(np.float32))
    assert total[1] == 0.7 / 3.0
    assert shown[0] == np.float32(np.float32(0.7 / 3.0) + np.float32(0.1))
    with pytest.raises(TypeError, match="a kernel takes floats that lie row after row, not float64"):
        Kernel("probe", text).run(1, 0.7, x.astype(np.float64), total, shown)


@pytest.mark.parametrize("time", [1.3, 1.3071, 5.0])
def test_every_effect_and_events_follow_the_reference(time: float) -> None:
    """At a sample, between samples, after the record; storeys at different times."""
    model = building(2, {"jump": 3.0, "time": PerStorey([time, 1.1]), "k_jump": -10.0, "k_time": time})
    record = record_of(model, 2.4)
    no_draw = np.zeros((1, 0))
    expected = Reference().simulate(model, no_draw, record).values
    engine = replace(SINGLE, substeps=16)
    assert relative_error(engine.simulate(model, no_draw, record).values, expected) < CONVERGED


SETTINGS: dict[str, dict[str, Any]] = {"plain": {}, "refined": {"resolution": 0.25}, "uncut": {"cut_at_turns": False}}


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
def test_responses_and_derivatives_differ_by_rounding(settings: dict[str, Any]) -> None:
    model = building(3, FREE)
    one, other = _solved(model, record_of(model, 4.0), settings)
    for (expected, slopes), (values, own) in zip(one, other, strict=True):
        assert 0.0 < relative_error(values, expected) < 50.0 * ROUNDING
        for k, parameter in enumerate(model.space.names):
            assert relative_error(own[k], slopes[k]) < 500.0 * ROUNDING, parameter


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
def test_rounding_does_not_add_up_over_a_long_record(settings: dict[str, Any]) -> None:
    """Thirty times the length makes no more than ten times the difference.

    Derivatives jump where rounding puts a stage on the other side of a switch of sign. They do so in doubles, too, from
    one step length to the next, and by more.
    """
    model = building(3, FREE)
    record = record_of(model, 120.0)
    one, other = _solved(model, record, settings)
    finer, _ = _solved(model, record, {**settings, "substeps": 8})
    for (expected, slopes), (values, own), (_, finer_slopes) in zip(one, other, finer, strict=True):
        assert relative_error(values, expected) < 500.0 * ROUNDING
        for k, parameter in enumerate(model.space.names):
            assert relative_error(own[k], slopes[k]) < relative_error(finer_slopes[k], slopes[k]), parameter


def _solved(
    model: ShearBuilding, record: Record, settings: dict[str, Any]
) -> tuple[list[tuple[Floats, Floats]], list[tuple[Floats, Floats]]]:
    """Values and derivatives of five draws, in doubles and in singles."""
    found = []
    for engine in (DOUBLE, SINGLE):
        response, slopes = replace(engine, **settings).sensitivities(model, _draws(model, 5), record)
        assert response.values.dtype == slopes.dtype == np.float64
        found.append(list(zip(response.values, slopes, strict=True)))
    return found[0], found[1]


def test_late_events_come_when_they_do() -> None:
    """Singles round a time of 100 s to 4e-6 s; the derivative at a sample of an event is that of an earlier one."""
    model = building(2, {"jump": 0.2, "time": PerStorey(Uniform(90.0, 110.0)), "k_jump": -5.0})
    record = record_of(model, 110.0)
    samples = np.array([[4750, 5003], [4999, 4999], [5001, 5432]])
    draws = np.concatenate([samples * TIME_STEP, samples * TIME_STEP + 0.3 * TIME_STEP])
    (expected, slopes), (response, own) = (each.sensitivities(model, draws, record) for each in (DOUBLE, SINGLE))
    for i in range(len(draws)):
        assert relative_error(response.values[i], expected.values[i]) < 500.0 * ROUNDING
        for k in range(2):
            assert relative_error(own[i, k], slopes[i, k]) < 1e-3
            first = np.argmax(np.any(slopes[i, k] != 0.0, axis=0))
            assert first == np.argmax(np.any(own[i, k] != 0.0, axis=0))


@pytest.mark.parametrize("n_draws", [1, 16])
def test_sums_over_a_long_record_keep_their_digits(n_draws: int) -> None:
    """Those of the engine's own stored response; one draw shares its derivatives out between lanes.

    A sum of singles over 20,000 samples would be off by some hundred roundings.
    """
    model = ShearBuilding(masses=[1.0], storey=BoucWen(k=Uniform(30, 50), c=Uniform(0.1, 0.3), beta=1.0, gamma=1.0))
    record, draws = record_of(model, 400.0), _draws(model, n_draws)
    response, slopes = SINGLE.sensitivities(model, draws, record)
    residual = np.float32(record.measured) - response.values
    found = SINGLE.normal_equations(model, draws, record)
    np.testing.assert_allclose(found.misfit, np.sum(residual**2, axis=2), rtol=2.0 * ROUNDING)
    np.testing.assert_allclose(SINGLE.misfit(model, draws, record), np.sum(residual**2, axis=2), rtol=2.0 * ROUNDING)
    expected = np.einsum("nact,nbct->ncab", slopes, slopes)
    np.testing.assert_allclose(found.information, expected, rtol=2.0 * ROUNDING, atol=1e-8 * np.max(np.abs(expected)))
    expected = np.einsum("nact,nct->nca", slopes, residual)
    scale = np.sqrt(np.einsum("ncaa,nc->nca", found.information, found.misfit))
    assert np.max(np.abs(found.gradient - expected) / scale) < 2.0 * ROUNDING


def test_few_points_at_a_time() -> None:
    model = building(2, FREE)
    record, draws = record_of(model), _draws(model, 2)
    solve = SINGLE.of_points(model, record)
    assert solve is not None
    misfit, slopes = solve(draws, record.measured)
    expected = DOUBLE.normal_equations(model, draws, record)
    assert misfit.dtype == slopes.dtype == np.float64
    np.testing.assert_allclose(misfit, expected.misfit, rtol=1e-5)
    scale = np.sqrt(np.einsum("ncaa,nc->nca", expected.information, expected.misfit))
    assert np.max(np.abs(slopes + 2.0 * expected.gradient) / scale) < 1e-4


def test_a_driven_specimen_follows_the_reference() -> None:
    """Growing cycles about a displacement that is not zero, a slip, and damage on the way."""
    storey = BoucWen(k=10.0, c=0.01, alpha=0.03, beta=Uniform(1.0, 3.0), gamma=2.0, n=1.5)
    model = Specimen(storey=storey).with_effect(StrengthDegradation(delta_nu=0.05))
    model = model.with_effect(SlipLock(delta_s=0.05, sigma=0.1))
    model = model.with_effect(SuddenDamage(parameter="k", jump=-2.0, time=Uniform(30.0, 90.0)))
    turning = np.append(1.7, 1.7 + np.repeat(np.arange(1, 7) * 0.2, 2) * np.resize([1.0, -1.0], 12))
    path = np.interp(np.arange(12 * 100 + 1) / 100, np.arange(13), turning)
    record = Record(name="cycles", time_step=0.1, excitation=path, excitation_kind="displacement")
    draws = np.array([[1.5, 42.0], [2.5, 77.77]])
    expected = Reference().simulate(model, draws, record, ["force"]).values
    force = replace(SINGLE, substeps=4).simulate(model, draws, record, ["force"]).values
    assert relative_error(force, expected) < CONVERGED


def test_bad_draws_fail_and_leave_their_neighbours_alone() -> None:
    """Numbers that doubles hold and singles do not among them, without a warning."""
    model = building(2, {"k": Uniform(20, 60), "gamma": Uniform(-4000, 2)})
    record = record_of(model, 1.5)
    draws = np.array([[40.0, 1.0], [np.nan, 1.0], [35.0, 0.5], [1e39, 1.0], [50.0, 1.5], [40.0, -4000.0]])
    response, alone = SINGLE.simulate(model, draws, record), SINGLE.simulate(model, draws[::2], record)
    np.testing.assert_array_equal(response.values[::2], alone.values)
    assert (response.status != Status.OK).tolist() == [False, True] * 3
    assert np.isposinf(SINGLE.misfit(model, draws, record)).all(axis=1).tolist() == [False, True] * 3


def test_both_precisions_have_files_of_their_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BWBN_CACHE_DIR", str(tmp_path))
    law = ShearBuilding(masses=[1.0], storey=BoucWen(k=10.0, beta=1.0, gamma=1.0)).law
    compiling = precompile({law: False}, driven=False, single=True)
    assert compiling is not None
    compiling.join(timeout=300)
    assert is_compiled(law, False, single=True)
    assert not is_compiled(law, False)
    assert SINGLE.scheme == f"{DOUBLE.scheme}, single precision"
