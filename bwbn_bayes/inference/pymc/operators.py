"""PyTensor operators over an engine: response, squared residuals, admissible region, and their pullbacks.

Each takes one draw ``(n_parameters,)`` or a batch ``(n_draws, n_parameters)``; a batch is one call of the engine, also
when ``vectorize_graph`` asks for it. Under numba a compiled graph calls back into Python for the solve: the callback
costs microseconds, holds the interpreter's lock only outside the kernels, and keeps thread pools out of cached code.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from typing import ClassVar

import numba
import numpy as np
import pytensor.tensor as pt
from pytensor.gradient import grad_not_implemented
from pytensor.graph.basic import Apply, Variable
from pytensor.graph.fg import FunctionGraph
from pytensor.graph.op import Op
from pytensor.graph.replace import _vectorize_node
from pytensor.graph.rewriting.basic import node_rewriter
from pytensor.link.numba.dispatch.basic import get_numba_type, numba_njit, register_funcify_and_cache_key
from pytensor.tensor.rewriting.basic import register_specialize

from bwbn_bayes.inference.pymc.forward import ForwardProblem, code_digest, solved
from bwbn_bayes.records.record import Record


class Solve(Op):
    """Base of the operators: a quantity of a problem as a function of the identified parameters.

    Parameters
    ----------
    problem : ForwardProblem
        Model, record and engine.
    """

    __props__ = ("key",)
    quantity: ClassVar[str]
    n_batched: ClassVar[int] = 1
    """Inputs that have a batch dimension; one more may hold measured channels, the same for all draws."""

    def __init__(self, problem: ForwardProblem) -> None:
        self.problem = problem
        self.key = problem.key

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        """By the problem alone."""
        return type(self), (self.problem,)

    def core_shape(self) -> tuple[int, ...]:
        """Shape of the result for one draw."""
        raise NotImplementedError

    def make_node(self, values: Variable, *others: Variable) -> Apply:
        """Values of the identified parameters in their own units, and what else the quantity takes."""
        inputs = [pt.as_tensor_variable(x).astype("float64") for x in (values, *others)]
        if inputs[0].type.ndim not in (1, 2):
            raise TypeError(f"{type(self).__name__} takes a vector of parameters or a matrix of draws")
        shape = (*inputs[0].type.shape[:-1], *self.core_shape())
        return Apply(self, inputs, [pt.tensor(dtype="float64", shape=shape)])

    def perform(self, node: Apply, inputs: Sequence[np.ndarray], output_storage: list[list[object]]) -> None:
        """Solve."""
        output_storage[0][0] = solved(self.quantity, self.key, inputs[: self.n_batched], *inputs[self.n_batched :])

    def infer_shape(self, node: Apply, shapes: Sequence[tuple[Variable, ...]]) -> list[tuple[object, ...]]:
        """Batch dimensions of the values, then the result's own."""
        return [(*shapes[0][:-1], *self.core_shape())]


class _Pullback(Solve):
    """Base of the vector-Jacobian products; a failed solve pulls back zero."""

    n_batched = 2

    def core_shape(self) -> tuple[int, ...]:
        return (self.problem.model.space.n_dim,)


class ResponsePullback(_Pullback):
    """Cotangents ``(n_channels, n_times)`` times the exact derivatives of the response."""

    quantity = "response_pullback"


class ChannelResponse(Solve):
    """Measured channels ``(n_channels, n_times)`` as the model predicts them; NaN where the solve fails."""

    quantity = "response"

    def core_shape(self) -> tuple[int, ...]:
        """Channels and times."""
        return (len(self.problem.channels), self.problem.record.n_times)

    def pullback(
        self, inputs: Sequence[Variable], outputs: Sequence[Variable], cotangents: Sequence[Variable]
    ) -> list[Variable]:
        """Vector-Jacobian product from the exact tangents."""
        return [ResponsePullback(self.problem)(inputs[0], cotangents[0])]


class SquaredResiduals(Solve):
    """Sum over time of squared residuals ``(n_blocks,)``; infinite where the solve fails.

    Against the record's channels, or against those ``(n_channels, n_times)`` given beside the values.
    """

    quantity = "squared_residuals"

    def core_shape(self) -> tuple[int, ...]:
        """Channels of each record."""
        return (len(self.problem.levels),)

    def pullback(
        self, inputs: Sequence[Variable], outputs: Sequence[Variable], cotangents: Sequence[Variable]
    ) -> list[Variable]:
        """Vector-Jacobian product from exact derivatives of the sums, or by an engine's adjoint."""
        values, *measured = inputs
        of_data = [self._pulled_to(i, data, values, cotangents[0]) for i, data in enumerate(measured, start=1)]
        data = measured[0] if measured else pt.constant(self.problem.measured)
        if self.problem.has_adjoint:
            left = data - ChannelResponse(self.problem)(values)
            weighed = -2.0 * spread(cotangents[0], self.problem.record) * left
            return [ResponsePullback(self.problem)(values, weighed), *of_data]
        slopes = SquaredResidualsAndSlopes(self.problem)(values, data)[..., 1:]
        return [pt.sum(cotangents[0][..., None] * slopes, axis=-2), *of_data]

    def _pulled_to(self, position: int, data: Variable, values: Variable, cotangent: Variable) -> Variable:
        """By the measured channels, where samples' errors are independent."""
        if self.problem.correlation is not None:
            return grad_not_implemented(self, position, data, "errors hang together")
        return 2.0 * spread(cotangent, self.problem.record) * (data - ChannelResponse(self.problem)(values))


class SquaredResidualsAndSlopes(Solve):
    """Squared residuals and their derivatives by the parameters, ``(n_blocks, 1 + n_parameters)``, from one solve.

    Infinite and zero where the solve fails. It has no derivatives of its own.
    """

    quantity = "squared_residuals_and_slopes"

    def core_shape(self) -> tuple[int, ...]:
        """Channels of each record; the sum, then its derivatives."""
        return (len(self.problem.levels), 1 + self.problem.model.space.n_dim)


@register_specialize
@node_rewriter([SquaredResiduals])
def _from_one_solve(fgraph: FunctionGraph, node: Apply) -> list[Variable] | None:
    """Where a graph asks for the derivatives too, their solve gives the sums."""
    for client, _ in fgraph.clients[node.inputs[0]]:
        both = isinstance(client.op, SquaredResidualsAndSlopes) and client.op.key == node.op.key
        if both and client.inputs == node.inputs:
            result: Variable = client.outputs[0][..., 0]
            return [result]
    return None


def spread(values: Variable, record: Record) -> Variable:
    """Symbolic twin of :func:`~bwbn_bayes.records.blocks.over_time`, of ``(n_blocks,)``."""
    if len(record.parts) == 1:
        return pt.shape_padright(values)
    place = np.full((len(record.channels), record.n_times), len(record.blocks))
    for position, block in enumerate(record.blocks):
        place[block.channel, block.samples] = position
    return pt.concatenate([values, pt.zeros(1)])[place]


class LogAdmissible(Solve):
    """Zero where the joint constraints of the law hold, minus infinity elsewhere; its derivative is zero."""

    quantity = "log_admissible"

    def core_shape(self) -> tuple[int, ...]:
        """A number."""
        return ()

    def pullback(
        self, inputs: Sequence[Variable], outputs: Sequence[Variable], cotangents: Sequence[Variable]
    ) -> list[Variable]:
        """Zero."""
        return [pt.zeros_like(inputs[0])]


@_vectorize_node.register(Solve)
def _one_call(op: Solve, node: Apply, *inputs: Variable) -> Sequence[Variable]:
    """All batch dimensions in one call of the engine."""
    own, measured = inputs[: op.n_batched], inputs[op.n_batched :]
    if any(x.type.ndim != 2 for x in measured):
        raise NotImplementedError("several sets of measured channels in one batch: take one at a time")
    cores = [x.type.ndim for x in node.inputs[: op.n_batched]]
    if cores[0] == 2:
        # The node was batched already: its own draws are one more batch dimension.
        cores = [core - 1 for core in cores]
    n_batch = max(x.type.ndim - core for x, core in zip(own, cores, strict=True))
    if n_batch <= 1 and all(x.type.ndim - core == n_batch for x, core in zip(own, cores, strict=True)):
        return list(op.make_node(*inputs).outputs)
    padded = [pt.shape_padleft(x, n_batch - (x.type.ndim - core)) for x, core in zip(own, cores, strict=True)]
    batch = pt.broadcast_shape(*([x.shape[i] for i in range(n_batch)] for x in padded), arrays_are_shapes=True)
    flat = [pt.broadcast_to(x, (*batch, *x.shape[n_batch:])).reshape((-1, *x.shape[n_batch:])) for x in padded]
    (result,) = op.make_node(*flat, *measured).outputs
    return [result.reshape((*batch, *op.core_shape()), ndim=n_batch + len(op.core_shape()))]


@register_funcify_and_cache_key(Solve)
def _compiled(op: Solve, node: Apply, **_: object) -> tuple[Callable[..., np.ndarray], str]:
    """A callback by key, and a cache key that hashes the problem and the code behind it."""
    quantity, key = op.quantity, op.key
    result_type = get_numba_type(node.outputs[0].type)

    # Compiled code has no arguments of any number: one function for each.
    if len(node.inputs) == 1:

        @numba_njit
        def solve(values: np.ndarray) -> np.ndarray:
            with numba.objmode(result=result_type):
                result = solved(quantity, key, (values,))
            return result  # noqa: RET504  (what leaves the block must have a name)

    elif len(node.inputs) == 3:

        @numba_njit
        def solve(values: np.ndarray, cotangents: np.ndarray, measured: np.ndarray) -> np.ndarray:
            with numba.objmode(result=result_type):
                result = solved(quantity, key, (values, cotangents), measured)
            return result  # noqa: RET504

    elif op.n_batched == 1:

        @numba_njit
        def solve(values: np.ndarray, measured: np.ndarray) -> np.ndarray:
            with numba.objmode(result=result_type):
                result = solved(quantity, key, (values,), measured)
            return result  # noqa: RET504

    else:

        @numba_njit
        def solve(values: np.ndarray, cotangents: np.ndarray) -> np.ndarray:
            with numba.objmode(result=result_type):
                result = solved(quantity, key, (values, cotangents))
            return result  # noqa: RET504

    ranks = [x.type.ndim for x in node.inputs]
    words = (code_digest(), type(op).__qualname__, key, str(ranks))
    return solve, hashlib.sha256("\n".join(words).encode()).hexdigest()
