"""The force of no known law: its functions, what it takes up and what it leaves, its force, its first-order gain."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from bwbn_bayes.discovery.evidence import laplace, with_shared
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.probability import UNNAMED_SCALE, beliefs
from bwbn_bayes.discovery.unnamed import unnamed_basis
from bwbn_bayes.discovery.unnamed_facts import unnamed_facts
from bwbn_bayes.discovery.unnamed_storey import (
    POWERS,
    WAVES,
    UnnamedForce,
    first_order_gain,
    force_of,
    unnamed_hypothesis,
)
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.law import DRIFT, DRIFT_RATE, ENERGY, HYSTERETIC_DISPLACEMENT, symbol
from bwbn_bayes.elements.scales import NOMINAL
from bwbn_bayes.engines.base import Response
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.correlation import SharedFunctions
from bwbn_bayes.inference.likelihood import IntegratedNoise, KnownNoise, Posterior
from bwbn_bayes.inference.modes import distinct, polish
from bwbn_bayes.parameters import Floats, Normal, Uniform
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen
from bwbn_bayes.structures.structure import Structure

N = 240
PATH = 0.02 * np.sin(np.linspace(0.0, 8.0 * np.pi, N)) * np.linspace(0.3, 1.0, N)
"""Four growing cycles. [m]"""
SPECIMEN = Specimen(storey=BoucWen(k=60.0, alpha=Normal(0.15, 0.01).truncated(0.0, 1.0), beta=40.0, gamma=10.0, n=1.0))
ENGINE = Lanes(substeps=1, n_threads=1)
PUSHED = Record(name="pushed", time_step=1.0, excitation=PATH, channels={}, excitation_kind="displacement")
SD = 0.002
"""Noise on the force, of which the largest is about 0.5. [N]"""


@pytest.fixture(scope="module")
def law() -> Floats:
    """Force ``(N,)`` of the specimen as it is."""
    return ENGINE.simulate(SPECIMEN, np.array([[0.15]]), PUSHED, ("force",)).values[0, 0]


def fitted(force: Floats) -> Explanation:
    record = PUSHED.with_channels({"force": force + SD * np.random.default_rng(7).standard_normal(N)})
    posterior = Posterior(
        model=SPECIMEN, record=record, engine=ENGINE, noise=IntegratedNoise(shape=1.0, scale=(SD**2,))
    )
    modes = distinct(*polish(posterior, np.full((1, 1), 0.5), n_iterations=20))
    return Explanation(added=(), posterior=posterior, modes=modes, evidence=laplace(posterior, modes))


def beside(plain: Explanation) -> Explanation:
    """The same with an unnamed force, as a search has it."""
    record = plain.posterior.record
    largest = UNNAMED_SCALE * float(np.max(np.abs(record.channels["force"])))
    shared = SharedFunctions.of(unnamed_basis(record))
    evidence = with_shared(plain.posterior, plain.modes, shared, largest, None)
    return replace(plain, unnamed=(1,), evidence=evidence)


def test_the_functions_have_unit_variance_on_the_average_over_the_test(law: Floats) -> None:
    """By drawing forces: a law that is missing and what no law holds have half of it each."""
    basis = unnamed_basis(PUSHED.with_channels({"force": law}))
    assert basis.shape[0] == N
    assert np.mean(np.sum(np.square(basis), axis=1)) == pytest.approx(1.0)
    weights = np.random.default_rng(1).standard_normal((basis.shape[1], 4000))
    power = np.mean(np.square(basis @ weights), axis=0)
    assert abs(np.mean(power) - 1.0) < 4.0 * np.std(power) / np.sqrt(4000)


def test_a_force_of_the_states_goes_on_where_the_direction_turns(law: Floats) -> None:
    """No function jumps between two samples: a sign of the drift rate once did, and took up every turn's noise."""
    basis = unnamed_basis(PUSHED.with_channels({"force": law}))
    spread = np.sqrt(np.sum(np.square(np.diff(basis, axis=0)), axis=1))
    assert np.max(spread) < 1.0
    turns = np.flatnonzero(np.diff(np.sign(np.diff(PATH)))) + 1
    assert len(turns) == 8
    assert np.max(spread[turns]) < np.median(spread) * 2.0


def test_a_smooth_force_that_the_law_lacks_is_taken_up(law: Floats) -> None:
    missing = 0.05 * np.max(np.abs(law)) * np.sin(PATH / 0.004)
    plain = fitted(law + missing)
    whole = beside(plain)
    believed = beliefs((plain, whole), 1, {})
    assert believed.verdict == "unexplained"
    pool: Any = type("Pool", (), {"shared": object()})()
    found = unnamed_facts(pool, believed)
    assert found is not None
    assert (found.storey, found.place) == (1, "the specimen")
    assert found.probability > 0.999
    assert np.corrcoef(found.force, missing)[0, 1] > 0.95
    expected = np.std(missing) / np.sqrt(np.mean(np.square(plain.posterior.record.channels["force"])))
    assert found.share == pytest.approx(expected, rel=0.2)


def test_white_noise_is_not_taken_up(law: Floats) -> None:
    """A specimen without a missing effect: the force stays improbable, and is not told."""
    plain = fitted(law)
    believed = beliefs((plain, beside(plain)), 1, {})
    assert believed.verdict == "no_missing_effect"
    assert believed.verdicts["unexplained"] < 0.05
    pool: Any = type("Pool", (), {"shared": object()})()
    assert unnamed_facts(pool, believed) is None


def test_what_no_force_explains_is_no_force(law: Floats) -> None:
    """A sensor that drifts, say: the class says that something is left, where no unnamed force is likely or none is.

    Telling the force of the best explanation that has one stopped where there was none.
    """
    plain = fitted(law)
    plain.__dict__["is_noise"] = False
    pool: Any = type("Pool", (), {"shared": object()})()
    improbable = beside(plain)
    for every in ((plain,), (plain, improbable)):
        believed = beliefs(every, 1, {})
        assert believed.verdict == "unexplained"
        assert believed.unnamed < 0.05
        assert unnamed_facts(pool, believed) is None


BUILDING = ShearBuilding(masses=[2.0, 1.0], storey=BoucWen(k=Uniform(40, 80), c=0.4, alpha=0.15, beta=12.0, gamma=2.0))


N_WEIGHTS = len(POWERS) + len(WAVES)


def test_at_neutral_values_it_changes_nothing_and_else_adds_its_force() -> None:
    """The law with it less the law without, at random states, against powers and Chebyshev's cosines written out."""
    placed = BUILDING.with_effect(UnnamedForce())
    added = sp.expand(placed.law.force - BUILDING.law.force)
    assert added.subs({symbol(f"unnamed_{n}"): 0 for n in range(1, N_WEIGHTS + 1)}) == 0
    assert len(placed.law.rates) == len(BUILDING.law.rates) + 1  # a clock that runs from 0 to 1
    rng = np.random.default_rng(2)
    states, clock = rng.standard_normal((4, 50)), np.linspace(0.0, 1.0, 50)
    sizes, weights = np.array([0.3, 2.0, 0.1, 5.0]), rng.standard_normal(N_WEIGHTS)
    u, v, z, work = states / sizes[:, None]
    wave = [np.cos(k * np.arccos(2.0 * clock - 1.0)) for k in range(5)]
    terms = [
        u, v, z, u**3, u * u * v, u * u * z, u * v * v, u * v * z, u * z * z, v**3, v * v * z, v * z * z, z**3,
        u * work, v * work, z * work, z**3 * work, u * u, z * z, v * v,
        *(u * wave[k] for k in (1, 2, 3, 4)), *(v * wave[k] for k in (1, 2)), *(z * wave[k] for k in (1, 2, 3, 4)),
    ]  # fmt: skip
    expected = sum(w * term for w, term in zip(weights, terms, strict=True))
    names = {f"unnamed_{n}": w for n, w in enumerate(weights.tolist(), start=1)}
    names |= {f"unnamed_{short}": size for short, size in zip("uvze", sizes.tolist(), strict=True)}
    states_and_clock = (DRIFT, DRIFT_RATE, HYSTERETIC_DISPLACEMENT, ENERGY, symbol("unnamed_clock"))
    by_law = sp.lambdify(states_and_clock, added.subs({symbol(name): value for name, value in names.items()}))
    np.testing.assert_allclose(by_law(*states, clock), expected, rtol=1e-9)
    kinds = ("drift", "drift_rate", "hysteretic_displacement", "hysteretic_energy")
    np.testing.assert_allclose(force_of(names, dict(zip(kinds, states, strict=True))), expected, rtol=1e-9)


def test_its_weights_share_what_the_largest_force_allows() -> None:
    scales = replace(NOMINAL, force=50.0, drift=0.2)
    hypothesis = unnamed_hypothesis(BUILDING, 2, scales, UNNAMED_SCALE)
    assert hypothesis.storeys == (2,)
    assert len(hypothesis.amplitudes) == len(hypothesis.brought) == N_WEIGHTS
    own = {p.name: p.prior for p in hypothesis.model.space.parameters}
    assert {own[name] for name in hypothesis.brought} == {Normal(0.0, 5.0)}
    assert hypothesis.effect.values["unnamed_u"] == 0.2


@dataclass(frozen=True)
class LinearEngine:
    """A response that is linear in every parameter, each with a history of its own; not a model of anything."""

    histories: dict[str, Floats]
    name: str = "linear"

    def simulate(self, model: Structure, draws: Floats, record: Record, *_: Any) -> Response:
        columns = np.array([self.histories[name] for name in model.space.names])
        values = np.einsum("dp,pct->dct", draws, columns)
        return Response(channels=tuple(record.channels), values=values, status=np.zeros(len(draws), dtype=np.int64))

    def sensitivities(self, model: Structure, draws: Floats, record: Record, **_: Any) -> tuple[Response, Floats]:
        columns = np.array([self.histories[name] for name in model.space.names])
        return self.simulate(model, draws, record), np.repeat(columns[None], len(draws), axis=0)


def test_the_first_order_gain_is_the_bayes_factor_of_a_linear_model() -> None:
    """By multivariate normals, with the weights' priors in the covariance and without, over scales by quadrature.

    The stiffness stands in both with the prior's precision of 12 in the unit cube, about the fit.
    """
    rng = np.random.default_rng(3)
    hypothesis = unnamed_hypothesis(BUILDING, 1, replace(NOMINAL, force=2.0), 0.1)
    names = hypothesis.model.space.names
    histories = {name: 0.3 * rng.standard_normal((1, 60)) for name in names}
    record = Record(
        name="drawn", time_step=0.01, excitation=np.ones(60), channels={"acceleration_1": rng.standard_normal(60)}
    )
    engine: Any = LinearEngine(histories)
    posterior = Posterior(model=BUILDING, record=record, engine=engine, noise=KnownNoise(sd=(0.5,)))
    point = np.array([0.4])
    stiffness = 40.0 + 0.4 * 40.0
    residual = record.channels["acceleration_1"] - stiffness * histories["k"][0]
    without = 0.25 * np.eye(60) + 40.0**2 / 12.0 * np.outer(histories["k"][0], histories["k"][0])
    weights = np.array([histories[name][0] for name in names if name != "k"])
    assert len(weights) == N_WEIGHTS
    nothing = multivariate_normal(np.zeros(60), without).logpdf(residual)

    def weighed(scale: float) -> float:
        with_it = without + (0.2 * scale) ** 2 * weights.T @ weights
        ratio = np.exp(multivariate_normal(np.zeros(60), with_it).logpdf(residual) - nothing)
        return float(ratio * 2.0 * norm.pdf(scale))

    expected = np.log(quad(weighed, 0.0, 8.0, limit=200)[0])
    assert first_order_gain(posterior, hypothesis, point) == pytest.approx(expected, abs=0.02)
