"""What sunode is handed: functions that numba compiles around those of the kernel. sunode itself need not be there."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from engine_cases import FREE, building, record_of

from bwbn_bayes.engines.scalar import ScalarProblem, scalar_problems
from bwbn_bayes.engines.sunode import _WITH_TANGENTS
from bwbn_bayes.parameters import Floats

TIME = 0.513


@pytest.fixture
def kernel_problem(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """The class, over a base class that holds nothing."""
    package, module = ModuleType("sunode"), ModuleType("sunode.problem")
    module.Problem = object  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "sunode", package)
    monkeypatch.setitem(sys.modules, "sunode.problem", module)
    monkeypatch.delitem(sys.modules, "bwbn_bayes.engines.sunode_problem", raising=False)
    yield importlib.import_module("bwbn_bayes.engines.sunode_problem").KernelProblem
    del sys.modules["bwbn_bayes.engines.sunode_problem"]


def shaken() -> tuple[ScalarProblem, Floats, Floats]:
    """Two storeys under a ground motion; the flat array of a draw; a state."""
    model = building(2, FREE)
    draw = model.space.from_unit(np.full((1, model.space.n_dim), 0.4))
    (problem,) = scalar_problems(model, draw, record_of(model), ("acceleration_1",), _WITH_TANGENTS)
    data = problem.data(0)
    problem.kernel.prepare(data)
    return problem, data, np.random.default_rng(1).uniform(0.1, 1.0, problem.n_states)


def rates_at(problem: ScalarProblem, data: Floats) -> Callable[[Floats], Floats]:
    """The kernel's rates as a function of the state."""

    def rates(y: Floats) -> Floats:
        dy = np.empty_like(y)
        assert problem.kernel.rhs(y, dy, data.copy(), TIME) == 0
        return dy

    return rates


def test_the_problem_is_the_kernels(kernel_problem: Any) -> None:
    problem, data, y = shaken()
    n, d = problem.n_states, problem.n_directions
    handed = kernel_problem(problem.kernel, n, d, len(data))
    assert (handed.n_states, handed.n_params) == (n, d)
    state, user_data = np.zeros(1, dtype=handed.state_dtype), np.zeros(1, dtype=handed.user_data_dtype)
    state["y"][0], user_data["numbers"][0] = y, data
    rates, step = rates_at(problem, data), 1e-6

    dy = np.empty(n)
    assert handed.make_rhs()(dy, TIME, state[0], user_data[0]) == 0
    np.testing.assert_array_equal(dy, rates(y))

    by_state = np.stack([(rates(y + step * e) - rates(y - step * e)) / (2 * step) for e in np.eye(n)], axis=1)
    matrix, scale = np.empty((n, n)), np.max(np.abs(by_state))
    assert handed.make_jac_dense()(matrix, TIME, state[0], dy, user_data[0]) == 0
    np.testing.assert_allclose(matrix, by_state, atol=1e-7 * scale)

    multiplier, out = np.random.default_rng(2).normal(size=n), np.empty(n)
    assert handed.make_adjoint_rhs()(out, TIME, state[0], multiplier, user_data[0]) == 0
    np.testing.assert_allclose(out, -matrix.T @ multiplier, rtol=1e-12, atol=1e-12 * scale)
    assert handed.make_adjoint_jac_dense()(matrix, TIME, state[0], multiplier, dy, user_data[0]) == 0
    np.testing.assert_allclose(matrix, -by_state.T, atol=1e-7 * scale)

    tangents, slopes = np.random.default_rng(3).normal(size=(d, n)), np.empty((d, n))
    assert handed.make_sensitivity_rhs()(slopes, TIME, state[0], tangents, user_data[0]) == 0
    by_parameter = np.stack([moved(problem, y, k) for k in range(d)])
    np.testing.assert_allclose(slopes, by_parameter + tangents @ by_state.T, atol=1e-6 * np.max(np.abs(slopes)))

    gradient = np.empty(d)
    assert handed.make_adjoint_quad_rhs()(gradient, TIME, state[0], multiplier, user_data[0]) == 0
    np.testing.assert_allclose(gradient, by_parameter @ multiplier, atol=1e-6 * np.max(np.abs(gradient)))


def moved(problem: ScalarProblem, y: Floats, parameter: int) -> Floats:
    """Derivative of the rates by a parameter, by central differences."""
    model, step, ends = problem.model, 1e-6, []
    for side in (1.0, -1.0):
        draw = model.space.from_unit(np.full((1, model.space.n_dim), 0.4))
        draw[0, parameter] += side * step
        (other,) = scalar_problems(model, draw, record_of(model), ("acceleration_1",), _WITH_TANGENTS)
        changed = other.data(0)
        other.kernel.prepare(changed)
        ends.append(rates_at(other, changed)(y))
    return (ends[0] - ends[1]) / (2.0 * step)
