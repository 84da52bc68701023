"""The contract that every engine keeps, over all engines."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass, replace
from functools import cache
from typing import ClassVar

import numpy as np
import pytest
import sympy as sp
from emulated_card import EmulatedCuda
from engine_cases import CONVERGED, ENGINES, FREE, TIME_STEP, building, record_of, relative_error

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.law import DRIFT_RATE, Effect, Slots, symbol
from bwbn_bayes.engines.base import Engine, Response, Status
from bwbn_bayes.engines.cvodes import Cvodes
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.engines.scalar import ScalarRk4
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Floats, Parameter, PerStorey, Uniform, Value
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen

OTHERS = [name for name in ENGINES if name != "reference"]

FINE: dict[str, Engine] = {
    **ENGINES,
    "lanes": Lanes(substeps=64),
    "scalar": ScalarRk4(substeps=64),
    "cuda": EmulatedCuda(substeps=64),
}
"""Runge-Kutta tangents are of order one where a step straddles a switch of sign: 16 steps per sample leave 2e-3."""

CASES: dict[str, dict[str, Value]] = {
    "bouc_wen": FREE,
    "strength_degradation": {"delta_nu": PerStorey(Uniform(0.01, 0.2))},
    "stiffness_degradation": {"delta_eta": PerStorey(Uniform(0.01, 0.2))},
    "slip_lock": {"delta_s": PerStorey(Uniform(0.05, 0.2)), "sigma": Uniform(0.03, 0.1)},
    "foliente_pinching": {
        "zeta_s": Uniform(0.4, 0.8),
        "p": Uniform(0.5, 2),
        "q": Uniform(0.05, 0.3),
        "psi_0": Uniform(0.1, 0.4),
        "delta_psi": Uniform(0.02, 0.1),
        "lambda_": Uniform(0.1, 0.5),
    },
    "sudden_damage": {"jump": Uniform(0.5, 2), "time": PerStorey([Uniform(1.0, 2.0), Uniform(1.2, 2.1)])},
    "sudden_damage_of_stiffness": {"k_jump": Uniform(-15, -5), "k_time": Uniform(1.0, 2.0)},
}
"""Per effect, the parameters that are free."""


@cache
def differences(case: str) -> tuple[ShearBuilding, Floats, Response, Floats]:
    """Model, draw, and the reference's response and derivatives for one effect."""
    model = building(2, CASES[case])
    draw = model.space.from_unit(np.full((1, model.space.n_dim), 0.413))
    return (model, draw, *Reference().sensitivities(model, draw, record_of(model, 3.0)))


@pytest.mark.parametrize("n_storeys", [1, 3, 10, 50])
@pytest.mark.parametrize("name", OTHERS)
def test_every_engine_agrees_with_the_reference(name: str, n_storeys: int) -> None:
    # At 50 storeys the highest mode, 2 sqrt(k/m) = 12.6 rad/s, still lies well inside the steps.
    model = building(n_storeys)
    record = record_of(model, 2.4)
    expected = _reference_response(n_storeys)
    response = ENGINES[name].simulate(model, np.zeros((1, 0)), record)
    assert response.channels == tuple(record.channels)
    assert response.values.shape == (1, n_storeys, record.n_times)
    assert response.status.tolist() == [Status.OK]
    assert relative_error(response.values, expected) < CONVERGED


@cache
def _reference_response(n_storeys: int) -> Floats:
    model = building(n_storeys)
    return Reference().simulate(model, np.zeros((1, 0)), record_of(model, 2.4)).values


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("name", OTHERS)
def test_sensitivities_agree_with_finite_differences(name: str, case: str) -> None:
    model, draw, expected, slopes = differences(case)
    response, own = FINE[name].sensitivities(model, draw, record_of(model, 3.0))
    assert own.shape == (1, model.space.n_dim, 2, expected.values.shape[2])
    assert relative_error(response.values, expected.values) < CONVERGED
    for k, parameter in enumerate(model.space.names):
        assert np.any(slopes[:, k] != 0.0), parameter
        assert relative_error(own[:, k], slopes[:, k]) < 1e-3, parameter


def test_channels_are_what_their_names_say(engine: Engine) -> None:
    model = building(3)
    record = record_of(model, 2.0)
    kinds = ("acceleration", "relative_acceleration", "displacement", "drift", "force", "restoring_force")
    names = [f"{kind}_{i}" for kind in kinds for i in (1, 2, 3)]
    values = engine.simulate(model, np.zeros((1, 0)), record, names).values[0].reshape(len(kinds), 3, -1)
    total, relative, displacement, drift, force, restoring = values
    np.testing.assert_allclose(relative, total - record.excitation, rtol=0, atol=1e-12)
    np.testing.assert_allclose(displacement, np.cumsum(drift, axis=0), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(force, restoring)
    measured = record.with_channels({f"acceleration_{i + 1}": a for i, a in enumerate(total)})
    np.testing.assert_allclose(force, measured.storey_forces(model.masses), rtol=0, atol=1e-10)
    # The second difference of a displacement whose acceleration is linear between samples is this mean of it.
    mean = (relative[:, :-2] + 4.0 * relative[:, 1:-1] + relative[:, 2:]) / 6.0
    assert relative_error(np.diff(displacement, 2, axis=1) / TIME_STEP**2, mean) < 3e-3


def test_a_subset_of_floors_is_a_subset_of_rows(engine: Engine) -> None:
    model = building(3)
    everything = engine.simulate(model, np.zeros((1, 0)), record_of(model, 1.0)).values
    record = record_of(model, 1.0, ("acceleration_3", "acceleration_1"))
    np.testing.assert_array_equal(engine.simulate(model, np.zeros((1, 0)), record).values, everything[:, [2, 0]])


def test_a_bad_draw_has_a_status_and_leaves_its_neighbours_alone(engine: Engine) -> None:
    model = building(2, {"k": Uniform(20, 60), "gamma": Uniform(-4000, 2)})
    record = record_of(model, 1.5)
    good = np.array([[40.0, 1.0], [35.0, 0.5], [50.0, 1.5]])
    bad = np.array([[np.nan, 1.0], [40.0, -4000.0], [np.inf, 1.0]])
    mixed = np.stack([good, bad], axis=1).reshape(6, 2)
    alone = engine.simulate(model, good, record)
    response = engine.simulate(model, mixed, record)
    np.testing.assert_array_equal(response.values[::2], alone.values)
    assert response.status[::2].tolist() == [Status.OK] * 3
    assert all(status != Status.OK for status in response.status[1::2])
    assert np.all(np.isnan(response.values[1::2]))
    misfit = engine.misfit(model, mixed, record)
    assert np.all(np.isfinite(misfit[::2]))
    assert np.all(np.isposinf(misfit[1::2]))


def test_normal_equations_are_the_explicit_sums(engine: Engine) -> None:
    model = building(2, {"k": PerStorey(Uniform(20, 60)), "beta": Uniform(1, 3), "sigma": Uniform(0.03, 0.1)})
    draws = model.space.from_unit(np.random.default_rng(3).uniform(0.2, 0.8, (2, model.space.n_dim)))
    record = record_of(model, 1.0)
    response, slopes = engine.sensitivities(model, draws, record)
    residual = np.array(list(record.channels.values())) - response.values
    equations = engine.normal_equations(model, draws, record)
    np.testing.assert_allclose(equations.misfit, np.sum(residual**2, axis=2), rtol=1e-10)
    np.testing.assert_allclose(engine.misfit(model, draws, record), equations.misfit, rtol=1e-6)
    for draw in range(2):
        for channel in range(2):
            jacobian = slopes[draw, :, channel].T
            gradient = jacobian.T @ residual[draw, channel]
            np.testing.assert_allclose(equations.gradient[draw, channel], gradient, rtol=1e-8)
            np.testing.assert_allclose(equations.information[draw, channel], jacobian.T @ jacobian, rtol=1e-8)


@pytest.mark.parametrize("name", OTHERS)
@pytest.mark.parametrize("time", [1.3, 1.3071, 5.0])
def test_events_at_a_sample_between_samples_and_after_the_record(name: str, time: float, reference: Reference) -> None:
    model = building(2, {"jump": 3.0, "time": PerStorey([time, 1.1]), "k_jump": -10.0, "k_time": time})
    record = record_of(model, 2.4)
    expected = reference.simulate(model, np.zeros((1, 0)), record).values
    response = ENGINES[name].simulate(model, np.zeros((1, 0)), record)
    assert relative_error(response.values, expected) < CONVERGED


@pytest.mark.parametrize("name", OTHERS)
def test_the_derivative_at_a_shared_event_on_a_sample_is_one_sided(name: str, reference: Reference) -> None:
    # At the sample of the event itself an earlier event has acted and a later one has not: the response has two
    # one-sided derivatives there. Engines give that of an earlier event; elsewhere both sides agree. Both storeys
    # share the time: kernels once counted the jump of the rates once for each storey.
    model = building(2, {"jump": 3.0, "time": Uniform(1.0, 2.0)})
    record = record_of(model, 2.0)
    sample, step = 66, 1e-5
    draws = sample * TIME_STEP + np.array([[-step], [0.0], [step]])
    ends = reference.simulate(model, draws, record).values
    slopes = FINE[name].sensitivities(model, draws[1:2], record)[1][0, 0]
    central, backward = (ends[2] - ends[0]) / (2 * step), (ends[1] - ends[0]) / step
    scale = np.max(np.abs(central))
    after = slice(sample + 1, None)
    assert np.max(np.abs(slopes[..., after] - central[..., after])) < 1e-3 * scale
    assert np.max(np.abs(slopes[..., sample] - backward[..., sample])) < 1e-3 * scale
    np.testing.assert_array_equal(slopes[..., :sample], 0.0)


def test_lanes_do_not_depend_on_batch_order_or_threads() -> None:
    model = building(2, {"k": PerStorey(Uniform(20, 60)), "beta": Uniform(1, 3), "sigma": Uniform(0.01, 0.1)})
    draws = model.space.from_unit(np.random.default_rng(5).uniform(size=(37, model.space.n_dim)))
    record = record_of(model, 1.0)
    for resolution in (0.0, 0.5):
        one, two = (Lanes(n_threads=n, resolution=resolution) for n in (1, 2))
        whole = one.simulate(model, draws, record).values
        np.testing.assert_array_equal(two.simulate(model, draws, record).values, whole)
        np.testing.assert_array_equal(two.simulate(model, draws[::-1], record).values, whole[::-1])
        for i in (0, 17, 36):
            np.testing.assert_array_equal(two.simulate(model, draws[i : i + 1], record).values[0], whole[i])
    forward = Lanes(n_threads=1).normal_equations(model, draws, record)
    reverse = Lanes(n_threads=2).normal_equations(model, draws[::-1], record)
    np.testing.assert_array_equal(reverse.information[::-1], forward.information)


@pytest.mark.parametrize(("substeps", "resolution"), [(1, 0.0), (2, 0.25)])
def test_lanes_and_scalar_are_one_scheme(substeps: int, resolution: float) -> None:
    """The same refinement, turns and events: the two differ by rounding and by their exponentials only."""
    model = building(3, {"sigma": 0.02, "delta_s": 0.2, "jump": 3.0, "time": PerStorey([1.1, 1.3071, 1.3])})
    record = record_of(model, 3.0)
    lanes, scalar = (
        engine.simulate(model, np.zeros((1, 0)), record).values
        for engine in (
            Lanes(substeps=substeps, resolution=resolution),
            ScalarRk4(substeps=substeps, resolution=resolution),
        )
    )
    assert relative_error(lanes, scalar) < 1e-8


def test_a_value_that_is_only_compared_is_not_lost(engine: Engine) -> None:
    """A time that is not a number never comes: kernels once went on as if there were no damage."""
    model = building(2, {"time": Uniform(1.0, 2.0)})
    response = engine.simulate(model, np.array([[np.nan], [1.5]]), record_of(model, 1.0))
    assert response.status.tolist() == [Status.NON_FINITE, Status.OK]


@dataclass(frozen=True, kw_only=True)
class _Rubbing(Effect):
    """A force whose parameters are named as a kernel's own variables once were."""

    b: Value
    p: Value
    l: Value  # noqa: E741
    base: Value
    here: Value
    h0: Value
    x0: Value
    rate: Value
    dy: Value

    name: ClassVar[str] = "rubbing"
    summary: ClassVar[str] = "a viscous force in nine parts"
    source: ClassVar[str] = "this test"
    residual: ClassVar[str] = "none"
    confusable: ClassVar[str] = "c"
    parameters: ClassVar[tuple[Parameter, ...]] = tuple(
        Parameter(symbol=name, unit="N s/m", neutral=0.0, description="part", source="this test")
        for name in ("b", "p", "l", "base", "here", "h0", "x0", "rate", "dy")
    )

    def fill(self, slots: Slots) -> Slots:
        added = sum((symbol(parameter.symbol) for parameter in self.parameters), sp.Integer(0)) * DRIFT_RATE
        return replace(slots, added_force=slots.added_force + added)


def test_a_parameter_may_have_any_name(engine: Engine) -> None:
    storey = BoucWen(k=40.0, c=0.1, beta=1.0, gamma=1.0)
    names = [parameter.symbol for parameter in _Rubbing.parameters]
    model = ShearBuilding(masses=[1.0, 1.0], storey=storey).with_effect(_Rubbing(**dict.fromkeys(names, 0.01)))
    damped = ShearBuilding(masses=[1.0, 1.0], storey=replace(storey, c=0.19))
    record = record_of(model, 1.0)
    expected = engine.simulate(damped, np.zeros((1, 0)), record).values
    assert relative_error(engine.simulate(model, np.zeros((1, 0)), record).values, expected) < 1e-9


def test_the_last_sample_of_a_specimen_keeps_the_slope_it_came_with(engine: Engine) -> None:
    storey = BoucWen(k=10.0, c=0.5, beta=1.0, gamma=1.0)
    record = Record(name="ramp", time_step=0.01, excitation=np.arange(9) * 0.01, excitation_kind="displacement")
    rates = engine.simulate(Specimen(storey=storey), np.zeros((1, 0)), record, ["drift_rate_1"]).values[0, 0]
    np.testing.assert_allclose(rates, 1.0, rtol=1e-12)


def test_threads_of_cvodes_share_nothing() -> None:
    model = building(2, {"k": Uniform(20, 60)})
    draws = np.linspace(25, 55, 9)[:, None]
    one = Cvodes().sensitivities(model, draws, record_of(model, 1.0))
    two = Cvodes(n_threads=2).sensitivities(model, draws, record_of(model, 1.0))
    np.testing.assert_array_equal(two[0].values, one[0].values)
    np.testing.assert_array_equal(two[1], one[1])


@pytest.mark.parametrize("limited", [Cvodes(max_steps=20), Reference(max_steps=1)], ids=["cvodes", "reference"])
def test_too_many_steps_are_a_status(limited: Engine) -> None:
    model = building(2)
    response = limited.simulate(model, np.zeros((1, 0)), record_of(model, 1.0))
    assert response.status.tolist() == [Status.STEP_LIMIT]
    assert np.all(np.isnan(response.values))


def test_mistakes_are_named(engine: Engine) -> None:
    model = building(2)
    record = record_of(model, 1.0)
    with pytest.raises(UserError, match="storeys 1 to 2"):
        engine.simulate(model, np.zeros((1, 0)), record, ["acceleration_3"])
    with pytest.raises(UserError, match="not known"):
        engine.simulate(model, np.zeros((1, 0)), record, ["speed_1"])


def test_threads_are_those_that_this_process_may_use() -> None:
    """A container that lends two of sixty-four processors got sixty-four threads."""
    lent = "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})"
    asked = "from bwbn_bayes import DiscoverySettings; from bwbn_bayes.engines.lanes import Lanes"
    code = f"{lent}; {asked}; print(Lanes().n_threads, DiscoverySettings().n_workers)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "1 1\n"


@pytest.mark.parametrize("name", ENGINES)
def test_only_samples_that_count_are_summed(name: str) -> None:
    model = building(2, CASES["bouc_wen"])
    engine, record = ENGINES[name], record_of(model, 1.8)
    masked = replace(record, counted=np.arange(record.n_times) % 10 < 6)
    draws = model.space.from_unit(np.array([[0.4], [0.6]]) * np.ones(model.space.n_dim))
    response, slopes = engine.sensitivities(model, draws, record)
    residual = (record.measured - response.values)[..., masked.kept]
    expected = np.sum(residual**2, axis=2)
    np.testing.assert_allclose(engine.misfit(model, draws, masked), expected, rtol=1e-6)
    found = engine.normal_equations(model, draws, masked)
    np.testing.assert_allclose(found.misfit, expected, rtol=1e-6)
    kept = slopes[..., masked.kept]
    gradient = np.einsum("nact,nct->nca", kept, residual)
    information = np.einsum("nact,nbct->ncab", kept, kept)
    np.testing.assert_allclose(found.gradient, gradient, rtol=1e-6, atol=1e-6 * np.max(np.abs(gradient)))
    np.testing.assert_allclose(found.information, information, rtol=1e-6, atol=1e-6 * np.max(np.abs(information)))
