"""The sunode adapter, wherever sunode imports: the engine contract, its adjoint, and one identification."""

from __future__ import annotations

import numpy as np
import pytest
from engine_cases import FREE, building, record_of, relative_error

from bwbn_bayes import Settings, Uniform, UserError, identify, simulate
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.engines.base import Status
from bwbn_bayes.engines.cvodes import Cvodes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.engines.sunode import Sunode, load_sunode
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen

try:
    load_sunode()
    MISSING = ""
except UserError as error:
    MISSING = str(error)

needs_sunode = pytest.mark.skipif(bool(MISSING), reason=MISSING)
ENGINE = Sunode(rtol=1e-10, atol=1e-12)


@pytest.mark.skipif(not MISSING, reason="sunode is installed here")
def test_where_it_is_missing_the_reason_says_where_to_get_it() -> None:
    assert "conda-forge only" in MISSING
    assert "environment.yml" in MISSING


def means(model: ShearBuilding, **values: float) -> Floats:
    """The prior means as one draw, some of them replaced."""
    return np.array([[values.get(p.name, p.prior.mean) for p in model.space.parameters]])


@needs_sunode
@pytest.mark.parametrize("method", ["adams", "bdf"])
def test_response_and_tangents_agree_with_the_reference(method: str) -> None:
    """Every effect of the contract's building, events included."""
    model = building(2, {**FREE, "delta_s": Uniform(0.0, 0.2), "jump": Uniform(0, 2), "time": Uniform(1, 2)})
    record = record_of(model)
    draw = means(model, delta_nu_time=1.511)  # between samples: at one, differences see two responses
    engine = Sunode(rtol=1e-10, atol=1e-12, method=method)  # type: ignore[arg-type]
    response, slopes = engine.sensitivities(model, draw, record)
    truth, exact = Reference().sensitivities(model, draw, record)
    assert response.status[0] == Status.OK
    assert relative_error(response.values, truth.values) < 1e-6
    assert relative_error(engine.simulate(model, draw, record).values, truth.values) < 1e-6
    for k, name in enumerate(model.space.names):
        assert relative_error(slopes[0, k], exact[0, k]) < 1e-4, name


@needs_sunode
@pytest.mark.parametrize("gradient", ["forward", "adjoint"])
def test_misfit_and_gradients_agree_with_the_reference(gradient: str) -> None:
    model = plain(2)
    record = record_of(model)
    draw = means(model)
    engine = Sunode(rtol=1e-10, atol=1e-12, gradient=gradient)  # type: ignore[arg-type]
    cotangent = np.random.default_rng(1).standard_normal((1, 2, record.n_times))
    oracle = Reference().normal_equations(model, draw, record)
    np.testing.assert_allclose(engine.misfit(model, draw, record), oracle.misfit, rtol=1e-6)
    _, slopes = Reference().sensitivities(model, draw, record)
    got = engine.adjoint_pullback(model, draw, record, cotangent)
    np.testing.assert_allclose(got, np.einsum("npct,nct->np", slopes, cotangent), rtol=1e-3)
    got = engine.normal_equations(model, draw, record).gradient
    np.testing.assert_allclose(got, oracle.gradient, rtol=1e-3)


def plain(n_storeys: int) -> ShearBuilding:
    """A building without effects: the adjoint has no events to jump over."""
    storey = BoucWen(k=Uniform(20, 60), c=Uniform(0.05, 0.2), alpha=0.05, beta=Uniform(1, 3), gamma=1.0, n=1.5)
    return ShearBuilding(masses=[1.0] * n_storeys, storey=storey)


@needs_sunode
def test_a_failed_draw_spoils_no_other() -> None:
    model = plain(1)
    record = record_of(model)
    draws = np.repeat(means(model), 3, axis=0)
    draws[1, 0] = np.nan
    draws[2, 2] = -1e9
    response = ENGINE.simulate(model, draws, record)
    assert response.status[0] == Status.OK
    assert np.all(response.status[1:] != Status.OK)
    assert np.all(np.isnan(response.values[1:]))
    np.testing.assert_array_equal(response.values[:1], ENGINE.simulate(model, draws[:1], record).values)


@needs_sunode
def test_it_works_after_the_other_cvodes() -> None:
    """Both bring a SUNDIALS, of other versions: the first one's symbols must not catch the second's calls."""
    model = plain(1)
    record = record_of(model)
    other = Cvodes().simulate(model, means(model), record).values
    assert relative_error(ENGINE.simulate(model, means(model), record).values, other) < 1e-5
    assert relative_error(Cvodes().simulate(model, means(model), record).values, other) == 0.0


@needs_sunode
def test_a_driven_specimen() -> None:
    storey = BoucWen(k=Uniform(20, 60), c=0.0, alpha=0.05, beta=2.0, gamma=1.0, n=1.5)
    model = Specimen(storey=storey)
    displacement = 0.8 * np.sin(np.arange(200) * 0.05)
    record = Record(
        name="cyclic",
        time_step=0.02,
        excitation=displacement,
        excitation_kind="displacement",
        channels={"force": displacement},
    )
    draw = np.array([[40.0]])
    response, slopes = ENGINE.sensitivities(model, draw, record)
    truth, exact = Reference().sensitivities(model, draw, record)
    assert relative_error(response.values, truth.values) < 1e-6
    assert relative_error(slopes, exact) < 1e-4


@needs_sunode
@pytest.mark.slow
def test_identify() -> None:
    """One identification, of a record made by the reference engine."""
    model = plain(1)
    truth = {"k": 40.0, "c": 0.1, "beta": 2.0}
    excitation = record_of(model, duration=4.0)
    record = simulate(model, excitation, truth, snr_db=25.0, seed=1)
    result = identify(model, record, settings=Settings(engine="sunode", particles=200, seed=1))
    assert result.facts.engine == "sunode"
    assert all(abs(z) < 4.0 for p in result.facts.parameters if (z := p.z_score) is not None)
