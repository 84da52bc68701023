"""Yield displacement and ratio in the place of beta and gamma: the same law, in every effect and every engine."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
import xarray as xr
from laboratory import NO_DRAW, cyclic_test, having, nrmse, shaking

from bwbn_bayes.discovery.candidates import hypotheses, scales_of
from bwbn_bayes.discovery.improved_model import improved_model_source
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.catalogue import registered
from bwbn_bayes.elements.combine import combine
from bwbn_bayes.elements.effects import Asymmetry, FolientePinching, SlipLock, StoreyParameter
from bwbn_bayes.elements.equations import law_equations
from bwbn_bayes.elements.law import DRIFT, DRIFT_RATE, Effect, StoreyLaw
from bwbn_bayes.elements.scales import NOMINAL
from bwbn_bayes.elements.scaling import powers_of_scale
from bwbn_bayes.engines.base import Engine
from bwbn_bayes.engines.cvodes import Cvodes
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.engines.scalar import ScalarRk4
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.parameters import LogNormal, PerStorey, Uniform, Value
from bwbn_bayes.structures.model_file import load_model_file
from bwbn_bayes.structures.quantities import parameters_at, storey_parameters, yield_drift
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen

BY_SHAPE, BY_YIELD = BoucWen(k=1.0, beta=1.0, gamma=0.0), BoucWen(k=1.0, u_y=1.0, rho=0.5)
FORMS = [
    form
    for kind in registered()
    if kind.level == "link" and "bouc_wen" in kind.elements
    for form in kind.neutral_forms()
]
N_STATES = 300
A, U_Y, RHO, N = 1.3, 0.21, 1.2, 1.7
BETA, GAMMA = (share * A ** (1.0 - N) / U_Y**N for share in (RHO, 1.0 - RHO))
SPRINGS: dict[str, Value] = {"k": 10.0, "c": 0.05, "alpha": 0.1, "A": A, "n": N}
LIVELY = (
    Asymmetry(phi=0.3),
    FolientePinching(zeta_s=0.6, p=0.8, q=0.2, psi_0=0.1, delta_psi=0.02, lambda_=0.3),
    SlipLock(delta_s=0.01, sigma=0.05),
)
"""Effects that refer to beta, gamma and n, and one that does not."""


def label(form: Effect) -> str:
    return "-".join((form.name, *(p.symbol for p in form.parameters)))


def law_of(element: BoucWen, *effects: Effect) -> StoreyLaw:
    return combine(element.parameters, element.constraints, effects, element.derived)


def at_random(law: StoreyLaw, given: dict[str, np.ndarray]) -> np.ndarray:
    """Force and rates at random states and parameters; each symbol has its own random stream."""
    symbols = (DRIFT, DRIFT_RATE, *law.states, *law.symbols, *(event.indicator for event in law.events))
    values = [given.get(s.name, random(s.name)) for s in symbols]
    outputs = sp.lambdify(symbols, (law.force, *law.rates), "numpy")(*values)
    return np.array([np.broadcast_to(output, N_STATES) for output in outputs])


def random(name: str) -> np.ndarray:
    rng = np.random.default_rng(list(name.encode()))
    return rng.uniform(1.2, 2.0, N_STATES) if name == "n" else rng.uniform(0.2, 0.9, N_STATES)


@pytest.mark.parametrize("form", FORMS, ids=label)
def test_the_law_is_the_same_with_every_effect(form: Effect):
    """Whatever an effect does to beta, gamma, n or their sum, at random sizes of it."""
    bounding = random("A") ** (1.0 - random("n")) / random("u_y") ** random("n")
    if form.form == "n":  # the yield displacement stays where n differs
        n = random("n") + random("n_offset")
        bounding = random("A") ** (1.0 - n) / random("u_y") ** n
    shape = {"beta": random("rho") * bounding, "gamma": (1.0 - random("rho")) * bounding}
    carriers = tuple(
        f for f in FORMS if f.form == "" and f.name in {"strength_degradation", "stiffness_degradation", "slip_lock"}
    )
    others = () if form in carriers else carriers
    expected = at_random(law_of(BY_SHAPE, *others, form), shape)
    np.testing.assert_allclose(at_random(law_of(BY_YIELD, *others, form), {}), expected, rtol=1e-12)


def test_the_response_is_the_same():
    by_shape = Specimen(storey=BoucWen(**SPRINGS, beta=BETA, gamma=GAMMA))
    by_yield = Specimen(storey=BoucWen(**SPRINGS, u_y=U_Y, rho=RHO))
    record = cyclic_test([0.3, -0.3, 0.6, -0.7, 0.2], 40)
    for effect in (None, *LIVELY):
        if effect is not None:
            by_shape, by_yield = by_shape.with_effect(effect), by_yield.with_effect(effect)
    expected, found = (Lanes(n_threads=1).simulate(m, NO_DRAW, record, ("force",)).values for m in (by_shape, by_yield))
    assert np.max(np.abs(found - expected)) < 1e-12 * np.max(np.abs(expected))


def free_building() -> ShearBuilding:
    storey = BoucWen(
        k=PerStorey(Uniform(20, 60)), c=0.05, alpha=0.1, A=Uniform(0.8, 1.2),
        u_y=PerStorey(LogNormal(0.1, 0.3)), rho=Uniform(0.4, 1.4), n=Uniform(1.2, 2),
    )  # fmt: skip
    return ShearBuilding(masses=[1.0, 1.0], storey=storey).with_effect(
        StoreyParameter(parameter="beta", offset=Uniform(-1, 1)), storeys=[2]
    )


@pytest.mark.parametrize(
    "engine",
    [Lanes(substeps=64), ScalarRk4(substeps=64), Cvodes(rtol=1e-10, atol=1e-12)],
    ids=lambda engine: type(engine).__name__,
)
def test_derivatives_agree_with_finite_differences(engine: Engine):
    model, record, channels = free_building(), shaking(2.0, 0.02, 5.0), ("acceleration_1", "acceleration_2")
    record = record.with_channels({name: np.zeros(record.n_times) for name in channels})
    draw = model.space.from_unit(np.full((1, model.space.n_dim), 0.413))
    _, slopes = engine.sensitivities(model, draw, record)
    for i, name in enumerate(model.space.names):
        step = 1e-5 * np.eye(model.space.n_dim)[i] * draw[0, i]
        ends = Reference().simulate(model, np.stack([draw[0] + step, draw[0] - step]), record).values
        expected = (ends[0] - ends[1]) / (2.0 * step[i])
        assert nrmse(slopes[0, i], expected) < 1e-3, name


@pytest.mark.parametrize("n", [1.0, 1.7, 6.0])
@pytest.mark.parametrize("a", [1.0, 0.6])
def test_it_is_the_yield_drift(a: float, n: float):
    """Initial slope A against the bound of z, and z itself on a long push."""
    model = Specimen(storey=BoucWen(k=10.0, A=a, u_y=U_Y, rho=0.7, n=n))
    given = parameters_at(model.law, storey_parameters(model, NO_DRAW), 0.0)
    np.testing.assert_allclose(yield_drift(given), U_Y, rtol=1e-12)
    np.testing.assert_allclose(given["beta"] / (given["beta"] + given["gamma"]), 0.7, rtol=1e-12)
    force = Reference().simulate(model, NO_DRAW, cyclic_test([40.0 * U_Y], 400), ("force",)).values[0, 0]
    assert force[-1] == pytest.approx(10.0 * a * U_Y, rel=1e-3)


def test_offsets_reach_what_an_engineer_asks():
    """A storey whose n differs yields at the same drift; one whose beta is larger yields earlier."""
    model = ShearBuilding(masses=[1.0, 1.0], storey=BoucWen(k=10.0, u_y=U_Y, rho=0.5, n=2.0))
    other_n = model.with_effect(StoreyParameter(parameter="n", offset=1.5), storeys=[2])
    other_beta = model.with_effect(StoreyParameter(parameter="beta", offset=20.0), storeys=[2])
    found = [
        yield_drift(parameters_at(m.law, storey_parameters(m, NO_DRAW), 0.0)).values[0] for m in (other_n, other_beta)
    ]
    np.testing.assert_allclose(found, [[U_Y, U_Y], [U_Y, (U_Y**-2.0 + 20.0) ** -0.5]])


def test_parameters_that_change_in_time_keep_their_dimensions():
    model = free_building()
    times = xr.DataArray([0.0, 1.0], dims="time_point")
    values = model.space.from_unit(np.full((3, model.space.n_dim), 0.5))
    at = parameters_at(model.law, storey_parameters(model, values), times)
    assert at["gamma"].dims == at["k"].dims == ("draw", "storey")


def test_a_change_that_takes_away_the_bound_of_z_is_refused():
    model = Specimen(storey=BoucWen(k=10.0, u_y=1.0, rho=0.5, n=2.0))
    model.with_effect(StoreyParameter(parameter="beta", offset=-0.9))
    with pytest.raises(UserError, match="does not hold"):
        model.with_effect(StoreyParameter(parameter="beta", offset=-1.1))
    with pytest.raises(UserError, match="does not hold"):
        model.with_effect(Asymmetry(phi=0.6))


def test_no_condition_cuts_priors_of_the_element_alone():
    model = Specimen(storey=BoucWen(k=Uniform(1, 2), u_y=LogNormal(0.01, 2.0), rho=Uniform(0.3, 1.8), n=Uniform(1, 50)))
    assert model.space.constraints == ()


@pytest.mark.parametrize(
    "given",
    [{}, {"beta": 1.0}, {"u_y": 0.1}, {"rho": 0.5}, {"beta": 1.0, "gamma": 0.5, "u_y": 0.1}, {"gamma": 1.0, "rho": 0.5},
     {"beta": 1.0, "gamma": 0.5, "u_y": 0.1, "rho": 0.5}],
)  # fmt: skip
def test_one_pair_alone(given: dict[str, float]):
    with pytest.raises(UserError, match=r"give beta and gamma, or u_y and rho, one pair of the two$"):
        BoucWen(k=1.0, **given)


def test_a_yield_displacement_is_positive():
    with pytest.raises(UserError, match="u_y = 0 lies outside"):
        Specimen(storey=BoucWen(k=1.0, u_y=0.0, rho=0.5))


def test_the_warning_looks_at_the_ratio():
    def warnings(rho: Value) -> tuple[str, ...]:
        return ShearBuilding(masses=[1.0, 1.0], storey=BoucWen(k=1.0, u_y=0.1, rho=rho)).warnings

    assert warnings(0.5) == warnings(Uniform(0.5, 2.0)) == ()
    assert "more energy than it took" in warnings(Uniform(0.3, 1.0))[0]
    assert warnings(PerStorey([0.6, 0.4])) != ()


def test_the_scale_of_z_leaves_them_alone():
    """A yield drift and a ratio have no unit of z: with A identified nothing but the springs follows it."""
    assert powers_of_scale(law_of(BY_YIELD)) == {}


def test_the_printed_law_tells_beta_and_gamma():
    texts = [equation.text for equation in law_equations(law_of(BY_YIELD))]
    assert texts[:3] == ["β = A ρ (A u_y)^(−n)", "γ = (1 − ρ) A (A u_y)^(−n)", "f = A − |z|^n (β sgn(z v) + γ)"]
    differing = [e.text for e in law_equations(law_of(BY_YIELD, StoreyParameter(parameter="beta", offset=0.0)))]
    assert differing[0] == "β_i = β + β_offset"
    assert "f = A − |z|^n (β_i sgn(z v) + γ)" in differing


def test_discovery_sees_beta_and_gamma():
    """Sizes at a point, hypotheses about a storey's shape, and the improved model read back."""
    model, record = free_building(), shaking(2.0, 0.02, 5.0)
    record = record.with_channels({"acceleration_1": np.cos(record.times), "acceleration_2": np.sin(record.times)})
    posterior = Posterior(model=model, record=record, engine=Lanes(), noise=default_noise(record))
    first, second = scales_of(posterior, np.full(model.space.n_dim, 0.5))
    assert first.beta / (first.beta + first.gamma) == pytest.approx(0.9)
    assert (first.beta + first.gamma) == pytest.approx(0.1**-1.6) == pytest.approx(second.beta + second.gamma)
    labels = {h.label for h in hypotheses(model, [first, second], measured=tuple(record.channels))}
    assert {"deviating parameter (beta) in storey 1", "deviating parameter (n) in storey 2"} <= labels
    assert "deviating parameter (beta) in storey 2" not in labels


def test_both_free_at_the_specimen_leave_its_shape_no_other_value():
    free = Specimen(storey=BoucWen(k=1.0, u_y=Uniform(1, 2), rho=Uniform(0.4, 1), n=2.0))
    ratio_known = Specimen(storey=BoucWen(k=1.0, u_y=Uniform(1, 2), rho=0.5, n=2.0))
    shapes = [
        {h.effect.form for h in hypotheses(model, [NOMINAL], measured=("force",)) if h.name == "storey_parameter"}
        for model in (free, ratio_known)
    ]
    assert shapes == [{"alpha", "n"}, {"alpha", "beta", "gamma", "n"}]


def test_a_written_model_reads_back(tmp_path):
    model = free_building().with_effect(having(Asymmetry(phi=0.0), {"phi": 0.01}))
    path = tmp_path / "model.py"
    path.write_text(improved_model_source(model), encoding="utf-8")
    assert load_model_file(path).model == model
    assert "u_y=PerStorey(LogNormal(0.1, 0.3)),  # m" in path.read_text(encoding="utf-8")


def test_other_values_by_label():
    other = free_building().with_values({"u_y[1]": 0.3, "rho": 0.9})
    assert other.space.names == ("k[1]", "k[2]", "A", "u_y[2]", "n", "beta_offset[2]")
