"""The operators: values, exact derivatives, batches, failures, and what a second process sees."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytensor
import pytensor.tensor as pt
import pytest
from engine_cases import FREE, building, record_of
from pymc_cases import ENGINE, TRUTH, small_model, small_record
from pytensor.gradient import verify_grad
from pytensor.graph.replace import vectorize_graph

from bwbn_bayes import Linear, Uniform
from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.catalogue import registered
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import guide_of, is_sought
from bwbn_bayes.engines.base import Engine, NormalEquations, Response
from bwbn_bayes.engines.cvodes import Cvodes
from bwbn_bayes.engines.journal import kept
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.engines.scalar import ScalarRk4
from bwbn_bayes.engines.sunode import Sunode
from bwbn_bayes.inference.pymc.forward import forward_problem
from bwbn_bayes.inference.pymc.operators import ChannelResponse, LogAdmissible, SquaredResiduals
from bwbn_bayes.parameters import Booleans, Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.structure import WHOLE_BUILDING, Structure

EFFECTS = {
    "delta_nu": Uniform(0, 0.1),
    "delta_eta": Uniform(0, 0.1),
    "delta_s": Uniform(0, 0.2),
    "sigma": Uniform(0.02, 0.1),
    "jump": Uniform(0, 2),
}
"""Parameters of strength and stiffness degradation, slip and a sudden change."""


@dataclass(frozen=True, kw_only=True)
class Counted:
    """An engine that notes the number of draws of every call."""

    inner: Lanes = ENGINE
    calls: list[int] = field(default_factory=list, repr=False)
    name = "counted"
    scheme = "counted"

    def simulate(
        self, model: Structure, draws: Floats, record: Record, channels: Sequence[str] | None = None
    ) -> Response:
        self.calls.append(len(draws))
        return self.inner.simulate(model, draws, record, channels)

    def sensitivities(
        self,
        model: Structure,
        draws: Floats,
        record: Record,
        channels: Sequence[str] | None = None,
        *,
        free: Booleans | None = None,
    ) -> tuple[Response, Floats]:
        self.calls.append(len(draws))
        return self.inner.sensitivities(model, draws, record, channels, free=free)

    def misfit(self, model: Structure, draws: Floats, record: Record) -> Floats:
        self.calls.append(len(draws))
        return self.inner.misfit(model, draws, record)

    def normal_equations(
        self, model: Structure, draws: Floats, record: Record, *, free: Booleans | None = None
    ) -> NormalEquations:
        self.calls.append(len(draws))
        return self.inner.normal_equations(model, draws, record, free=free)


SCALES = Scales(
    drift=0.3, path=12.0, drift_rate=1.5, hysteretic_displacement=0.2, energy=3.0, force=4.0, stiffness=20.0,
    damping=0.3, alpha=0.1, beta=2.0, gamma=1.0, n=1.5, mass=1.0, acceleration=3.0,
    ground_acceleration=2.0, period=0.8, onset=0.3, duration=2.0, total_mass=3, time_step=0.02,
)  # fmt: skip
FORMS: list[Effect] = [form for effect in filter(is_sought, registered()) for form in guide_of(effect).priors(SCALES)]


def around_truth(n: int) -> Floats:
    """Draws within two per cent of the truth."""
    return np.array(list(TRUTH.values())) * np.random.default_rng(1).uniform(0.98, 1.02, (n, 3))


WITHOUT_SUNODE = pytest.mark.skipif(find_spec("sunode") is None, reason="sunode is on conda-forge only, not installed")
SOLVERS = [ENGINE, ScalarRk4(substeps=2), Cvodes(), pytest.param(Sunode(gradient="adjoint"), marks=WITHOUT_SUNODE)]


@pytest.mark.parametrize("engine", SOLVERS, ids=lambda engine: engine.name)
def test_values_are_the_engines_own(engine: Engine) -> None:
    problem = forward_problem(small_model(), small_record(), engine)
    x, draws = pt.vector("x"), around_truth(1)
    function = pytensor.function([x], [ChannelResponse(problem)(x), SquaredResiduals(problem)(x)])
    response, squares = function(draws[0])
    np.testing.assert_array_equal(response, engine.simulate(problem.model, draws, problem.record).values[0])
    np.testing.assert_allclose(squares, np.sum((problem.measured - response) ** 2, axis=1), rtol=1e-9)


def test_shapes_are_known_before_running() -> None:
    problem = forward_problem(small_model(), small_record(), ENGINE)
    x, draws = pt.vector("x"), pt.matrix("draws")
    assert ChannelResponse(problem)(x).type.shape == problem.measured.shape
    assert SquaredResiduals(problem)(draws).type.shape == (None, 1)
    (calls := []).append(pytensor.function([draws], ChannelResponse(problem)(draws).shape)(around_truth(3)))
    assert tuple(calls[0]) == (3, *problem.measured.shape)


def test_pullbacks_agree_with_finite_differences_of_the_reference() -> None:
    model = building(2, {**FREE, **EFFECTS})
    record = record_of(model)
    problem = forward_problem(model, record, Lanes(substeps=64))
    draw = np.array([p.prior.mean for p in model.space.parameters])
    cotangent = np.random.default_rng(2).standard_normal(problem.measured.shape)
    x = pt.vector("x")
    pulled = pytensor.grad(pt.sum(ChannelResponse(problem)(x) * cotangent), x)
    summed = pytensor.grad(pt.sum(SquaredResiduals(problem)(x)), x)
    got = pytensor.function([x], [pulled, summed])(draw)
    response, slopes = Reference().sensitivities(model, draw[None], record)
    residual = problem.measured - response.values[0]
    expected = [np.einsum("pct,ct->p", slopes[0], c) for c in (cotangent, -2.0 * residual)]
    # A product may cancel: its scale is that of the terms summed.
    scales = [np.sqrt(np.einsum("pct,ct->p", slopes[0] ** 2, c**2)) for c in (cotangent, residual)]
    for mine, oracle, scale, name in zip(got, expected, scales, ("response", "squares"), strict=True):
        error = np.abs(mine - oracle) / np.maximum(np.abs(oracle), scale)
        assert np.all(error < 1e-3), (name, dict(zip(model.space.names, error, strict=True)))


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS, ids=lambda form: f"{form.name} {form.form}")
def test_pullback_of_every_effect(form: Effect) -> None:
    """A third up its grid, at the converged substep, against the reference's finite differences.

    Half up, the one-sided gap is grazed within the difference's own step.
    """
    # A spring is put where the link has none.
    linear = Linear(k=Uniform(18, 22), c=0.3)
    bouc_wen = BoucWen(k=Uniform(18, 22), c=0.3, alpha=0.1, beta=Uniform(1.8, 2.2), gamma=1.0, n=1.5)
    model = ShearBuilding(masses=[1.0, 1.0], storey=linear if form.name == "hysteresis" else bouc_wen)
    base = set(model.space.names)
    model = model.with_effect(form, None if form.level in WHOLE_BUILDING else [1])
    grid = guide_of(type(form)).starts(form, SCALES)
    draw = np.array(
        [p.prior.mean if p.name in base else grid[p.symbol][len(grid[p.symbol]) // 3] for p in model.space.parameters]
    )
    record = record_of(model)
    problem = forward_problem(model, record, Lanes(substeps=256))
    x = pt.vector("x")
    got = pytensor.function([x], pytensor.grad(pt.sum(SquaredResiduals(problem)(x)), x))(draw)
    response, slopes = Reference().sensitivities(model, draw[None], record)
    residual = problem.measured - response.values[0]
    expected = np.einsum("pct,ct->p", slopes[0], -2.0 * residual)
    scale = np.sqrt(np.einsum("pct,ct->p", slopes[0] ** 2, residual**2))
    error = np.abs(got - expected) / np.maximum(np.abs(expected), scale)
    assert np.all(error < 1e-3), dict(zip(model.space.names, error, strict=True))


def test_verify_grad_on_a_smooth_case() -> None:
    """Beta and gamma next to nothing: the linear oscillator, whose response is analytic in its parameters."""
    model = small_model(
        c=Uniform(0.01, 1), alpha=Uniform(0.01, 0.3), beta=1e-9, gamma=1e-9, n=1.0, delta_nu=0.0, delta_eta=0.0
    )
    record = small_record().until(2.0)
    problem = forward_problem(model, record, Lanes(substeps=1))
    values = [np.array([40.0, 0.2, 0.1])]
    for operator in (SquaredResiduals(problem), ChannelResponse(problem)):
        verify_grad(operator, values, rng=np.random.default_rng(3), rel_tol=1e-4, abs_tol=1e-4)


def test_a_vectorised_graph_is_one_call_of_the_engine() -> None:
    engine = Counted()
    problem = forward_problem(small_model(), small_record(), engine)
    x, batch, cube = pt.vector("x"), pt.matrix("batch"), pt.tensor3("cube")
    squares = pt.sum(SquaredResiduals(problem)(x))
    gradient = pytensor.grad(squares, x)
    draws = around_truth(20)
    one = pytensor.function([x], [squares, gradient])
    many = pytensor.function([batch], vectorize_graph([squares, gradient], {x: batch}))
    engine.calls.clear()
    values, slopes = many(draws)
    assert engine.calls == [20, 20]
    np.testing.assert_allclose(values, [one(draw)[0] for draw in draws], rtol=1e-12)
    np.testing.assert_allclose(slopes, [one(draw)[1] for draw in draws], rtol=1e-10)
    (again,) = vectorize_graph([squares], {x: cube})
    engine.calls.clear()
    np.testing.assert_allclose(pytensor.function([cube], again)(draws.reshape(4, 5, 3)).ravel(), values, rtol=1e-12)
    assert engine.calls == [20]


def test_a_cotangent_that_has_no_batch_is_shared() -> None:
    problem = forward_problem(small_model(), small_record(), ENGINE)
    x, batch = pt.vector("x"), pt.matrix("batch")
    weights = np.random.default_rng(4).standard_normal(problem.measured.shape)
    pulled = pytensor.grad(pt.sum(ChannelResponse(problem)(x) * weights), x)
    draws = around_truth(3)
    many = pytensor.function([batch], vectorize_graph(pulled, {x: batch}))(draws)
    np.testing.assert_allclose(many, [pytensor.function([x], pulled)(draw) for draw in draws], rtol=1e-10)


def test_failed_solves_are_infinite_count_and_pull_back_zero() -> None:
    problem = forward_problem(small_model(), small_record(seed=2), ENGINE)
    x = pt.matrix("x")
    squares = SquaredResiduals(problem)(x)
    function = pytensor.function([x], [squares, pytensor.grad(-pt.sum(squares), x)])
    draws = around_truth(3)
    draws[1, 0] = np.nan
    draws[2, 1] = -1e9  # beta so negative that z runs away
    before = problem.failures.total
    squares_got, slopes = function(draws)
    assert np.isfinite(squares_got[:, 0]).tolist() == [True, False, False]
    assert np.all(np.isposinf(squares_got[1:]))
    assert np.all(slopes[1:] == 0.0)
    assert np.any(slopes[0] != 0.0)
    assert problem.failures.total - before == 4


def test_the_admissible_region_is_the_models() -> None:
    model = small_model(gamma=Uniform(-80, 10))
    problem = forward_problem(model, small_record(), ENGINE)
    x = pt.matrix("x")
    draws = model.space.from_unit(np.random.default_rng(5).random((200, 4)))
    got = pytensor.function([x], LogAdmissible(problem)(x))(draws)
    assert np.array_equal(got == 0.0, model.space.admissible(draws))
    assert 0 < np.count_nonzero(got == 0.0) < 200


def test_equal_problems_are_one_and_others_differ() -> None:
    model, record = small_model(), small_record()
    problem = forward_problem(model, record, ENGINE)
    assert forward_problem(small_model(), small_record(), ENGINE) is problem
    others = [
        forward_problem(small_model(gamma=14.0), record, ENGINE),
        forward_problem(model, small_record(seed=2), ENGINE),
        forward_problem(model, record, Lanes(substeps=3)),
        forward_problem(model, record, Cvodes()),
    ]
    assert len({problem.key, *(other.key for other in others)}) == 5


POINT = np.array(list(TRUTH.values()))


def test_a_problem_is_forgotten_with_its_last_graph() -> None:
    """The registry keeps none alive, and what a graph asks for stays."""
    problem = forward_problem(small_model(), small_record(seed=77), ENGINE)
    graph = SquaredResiduals(problem)(pt.constant(POINT))
    del problem
    gc.collect()
    assert np.all(np.isfinite(graph.eval()))
    unused = forward_problem(small_model(), small_record(seed=79), ENGINE)
    forgotten, operator = weakref.ref(unused), LogAdmissible(unused)
    del unused
    gc.collect()
    assert forgotten() is operator.problem
    del operator
    gc.collect()
    assert forgotten() is None


def test_graphs_of_an_earlier_run_go_on_when_a_later_one_has_gone(tmp_path: Path) -> None:
    """Each run has a journal of its own, and answers alike."""
    model, record, x = small_model(), small_record(seed=78), pt.vector("x")
    with kept(ENGINE, tmp_path / "first") as engine:
        earlier = pytensor.function([x], SquaredResiduals(forward_problem(model, record, engine))(x))
        expected = earlier(POINT)
    with kept(ENGINE, tmp_path / "second") as engine:
        later = forward_problem(model, record, engine)
        assert later.engine == later.solver == engine
        del later
        gc.collect()
        np.testing.assert_array_equal(earlier(POINT), expected)


SECOND_PROCESS = """
import sys
import numpy as np, pytensor, pytensor.tensor as pt
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.pymc.forward import forward_problem
from bwbn_bayes.inference.pymc.operators import SquaredResiduals
from pymc_cases import small_model, small_record

engine, record = Lanes(substeps=1, n_threads=2), small_record()
draws = np.tile([[40.0, 30.0, 0.4]], (64, 1)) * np.linspace(0.9, 1.1, 64)[:, None]
for gamma in map(float, sys.argv[1:]):
    model = small_model(gamma=gamma)
    engine.misfit(model, draws, record)
    x = pt.matrix("x")
    function = pytensor.function([x], SquaredResiduals(forward_problem(model, record, engine))(x))
    print(repr(float(function(draws).sum())), repr(float(engine.misfit(model, draws, record).sum())))
"""


def test_a_second_process_neither_crashes_nor_remembers(tmp_path: Path) -> None:
    """Compiled graphs used to outlive a change of the solver, and threaded kernels inside them to crash.

    The first process fills PyTensor's cache. The second finds it full and solves 64 draws on two threads, then another
    model through the same graph: each must give its own engine's sum.
    """
    environment = {
        **os.environ,
        "PYTENSOR_FLAGS": f"base_compiledir={tmp_path}",
        "OMP_NUM_THREADS": "1",
        "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[1]), str(Path(__file__).parents[3])]),
    }
    sums = []
    for arguments in (["15.0"], ["15.0", "5.0"]):
        command = [sys.executable, "-c", SECOND_PROCESS, *arguments]
        run = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        assert run.returncode == 0, run.stderr[-2000:]
        for line in run.stdout.splitlines():
            compiled, direct = map(float, line.split())
            assert compiled == pytest.approx(direct, rel=1e-12)
            sums.append(compiled)
        assert any(path.suffix in {".nbi", ".nbc"} for path in tmp_path.rglob("*")), "nothing was cached"
    assert sums[0] == sums[1] != sums[2]
