"""The noise models' log likelihood as PyTensor expressions: of a whole record, and of its samples one by one.

Where the noise scale is known or sampled, samples are independent given it. Integrated out, it ties a block's samples
together, and ``az.loo`` is right of each one's density given all the others [1]_, whose sum is not the log likelihood.
So each sample has an equal share of its block's log likelihood, and what sets its density given the others apart from
their mean. The sum is then exact, and leave-one-out weights are those of the densities: what the shares move is the
same for all samples, and all but the same in all draws. (Each sample given those before it would add up as
well. But at rest the first is the same in every draw, which ``az.loo`` refuses.)

A sampler asks for the sum alone, which needs no response; :class:`OfSamples` says so to the compiler.

References
----------
.. [1] P.-C. Bürkner, J. Gabry and A. Vehtari, "Efficient leave-one-out cross-validation for Bayesian non-factorized
   normal and Student-t models", Computational Statistics 36, 2021, doi:10.1007/s00180-020-01045-4.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytensor.tensor as pt
from pytensor.gradient import disconnected_type
from pytensor.graph.basic import Apply, Variable
from pytensor.graph.fg import FunctionGraph
from pytensor.graph.op import Op
from pytensor.graph.replace import _vectorize_node
from pytensor.graph.rewriting.basic import node_rewriter
from pytensor.tensor.math import Sum
from pytensor.tensor.rewriting.basic import register_canonicalize, register_specialize

from bwbn_bayes.inference.correlation import Correlation, SharedFunctions
from bwbn_bayes.inference.likelihood import IntegratedNoise, KnownNoise, Noise
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.blocks import counts
from bwbn_bayes.records.record import Record

_LOG_2PI = float(np.log(2.0 * np.pi))


def noise_log_likelihood(
    noise: Noise, misfit: pt.TensorVariable, n_times: float | Floats, noise_sd: pt.TensorVariable | None = None
) -> pt.TensorVariable:
    """Symbolic twin of the noise models' log likelihood, from squared residuals ``(n_blocks,)``."""
    if isinstance(noise, IntegratedNoise):
        scale, end = np.asarray(noise.scale), noise.shape + 0.5 * n_times / noise.as_one
        constant = noise.log_likelihood(np.zeros((1, len(scale))), n_times, np.zeros((1, 0)))[0]
        return constant - pt.sum(end * pt.log1p(0.5 * misfit / (noise.as_one * scale)), axis=-1)
    variance = np.square(noise.sd) if isinstance(noise, KnownNoise) else pt.square(noise_sd)
    return -0.5 * pt.sum(misfit / variance + n_times * (pt.log(variance) + _LOG_2PI), axis=-1)


def sample_log_densities(
    noise: Noise, record: Record, residual: pt.TensorVariable, noise_sd: pt.TensorVariable | None = None
) -> pt.TensorVariable:
    """Log density ``(n_channels, n_times)`` of every sample, the sum of which is the log likelihood.

    Zero where nothing was measured, minus infinity where the residual is not a number. Where samples' errors hang
    together they are of whitened samples.

    Parameters
    ----------
    noise : Noise
        Known, sampled or integrated out.
    record : Record
        Whose blocks have a noise scale each.
    residual : (n_channels, n_times) expression
        [unit of the channel]
    noise_sd : (n_blocks,) expression, optional
        Sampled noise scales. [unit of the channel]
    """
    correlation = _settled(noise)
    shared = None if correlation is None else correlation.shared
    if shared is not None:
        residual = turned(residual, shared, 1.0 / np.sqrt(1.0 + shared.variance))
    result = pt.zeros(record.measured.shape)
    for position, (block, n_times) in enumerate(zip(record.blocks, counts(record), strict=True)):
        own = residual[block.channel, block.samples]
        if correlation is not None and correlation.coefficients:
            own = _new_in_each(own, correlation.coefficients[position], correlation.beginnings[position])
        if isinstance(noise, IntegratedNoise):
            density = _integrated(noise, position, own, n_times)
        else:
            sd = noise.sd[position] if isinstance(noise, KnownNoise) else pt.as_tensor_variable(noise_sd)[position]
            density = -0.5 * pt.square(own / sd) - pt.log(sd) - 0.5 * _LOG_2PI
        result = pt.set_subtensor(result[block.channel, block.samples], density)
    return pt.switch(pt.isnan(result), -np.inf, result) + log_volumes(noise, record)


def _settled(noise: Noise) -> Correlation | None:
    """Errors' correlation; a forward problem takes none of any scale (:func:`~.forward.forward_problem`)."""
    return noise.correlation


def _integrated(noise: IntegratedNoise, position: int, own: pt.TensorVariable, n_times: float) -> pt.TensorVariable:
    """Of a block's samples ``(n_times,)``, the noise scale integrated out."""
    as_one = float(np.broadcast_to(noise.as_one, (noise.n_blocks,))[position])
    alone = IntegratedNoise(shape=noise.shape, scale=(noise.scale[position],), correlation_samples=as_one)
    squares = pt.square(own)
    misfit = pt.sum(squares, axis=-1)
    # A Student's t of the others' degrees of freedom, but for what all samples have in common.
    end = noise.shape + 0.5 * (n_times - 1.0) / as_one
    apart = end * pt.log1p(-0.5 * squares / (as_one * noise.scale[position] + 0.5 * misfit))
    share = noise_log_likelihood(alone, misfit[None], np.array([n_times])) / n_times
    return share + apart - pt.mean(apart, axis=-1)


def _new_in_each(own: pt.TensorVariable, coefficients: Floats, beginning: Floats) -> pt.TensorVariable:
    """What an autoregression does not tell of a block's samples ``(n_times,)``, the first of which have no past."""
    order = len(coefficients)
    if order == 0:
        return own
    past = sum(a * own[order - lag : -lag] for lag, a in enumerate(coefficients, start=1))
    return pt.concatenate([pt.dot(np.linalg.inv(beginning), own[:order]), own[order:] - past])


def log_volumes(noise: Noise, record: Record) -> Floats:
    """What each sample has of the correlation's log volume ``(n_channels, n_times)``; of its choice, all the same."""
    result = np.zeros(record.measured.shape)
    correlation = _settled(noise)
    if correlation is None:
        return result
    share = correlation.log_prior / float(np.sum(counts(record)))
    for position, block in enumerate(record.blocks):
        result[block.channel, block.samples] = share
        if correlation.coefficients:
            first = np.log(np.diag(correlation.beginnings[position]))
            begin = np.arange(record.n_times)[block.samples][: len(first)]
            result[block.channel, begin] -= first
    return result if correlation.shared is None else result + correlation.shared.log_volumes.reshape(result.shape)


def turned(rows: pt.TensorVariable, shared: SharedFunctions, factor: Floats) -> pt.TensorVariable:
    """Symbolic twin of :meth:`SharedFunctions.turned`, of rows ``(n_channels, n_times)``."""
    level = np.ones((1, 1)) if shared.level is None else shared.level[:, None]
    flat = (rows / level).reshape((-1,))
    beside = pt.dot(shared.functions, pt.dot(shared.functions.T, flat) * (factor - 1.0))
    return rows + level * beside.reshape(rows.shape, ndim=2)


class OfSamples(Op):
    """Samples' log densities, of which the sum is known without them.

    A graph that sums them compiles to the sum, and gradients are taken of that: no response is solved for.
    """

    __props__ = ()
    view_map = {0: [1]}  # noqa: RUF012  (PyTensor's own attribute)

    def make_node(self, total: Variable, densities: Variable) -> Apply:
        """The sum ``(...)``, and the log densities ``(..., n_channels, n_times)``."""
        inputs = [pt.as_tensor_variable(total), pt.as_tensor_variable(densities)]
        # Of a length that is known to be one, canonicalization would take the sum before it is seen here.
        return Apply(self, inputs, [pt.tensor(dtype="float64", shape=(None,) * inputs[1].type.ndim)])

    def perform(self, node: Apply, inputs: Sequence[np.ndarray], output_storage: list[list[object]]) -> None:
        """The densities."""
        output_storage[0][0] = inputs[1]

    def infer_shape(self, node: Apply, shapes: Sequence[tuple[Variable, ...]]) -> list[tuple[Variable, ...]]:
        """That of the densities."""
        return [shapes[1]]

    def connection_pattern(self, node: Apply) -> list[list[bool]]:
        """The sum is another way to the same derivatives."""
        return [[False], [True]]

    def pullback(
        self, inputs: Sequence[Variable], outputs: Sequence[Variable], cotangents: Sequence[Variable]
    ) -> list[Variable]:
        """That of the densities, for whoever weighs them one by one."""
        return [disconnected_type(), cotangents[0]]


@_vectorize_node.register(OfSamples)
def _batched(op: OfSamples, _: Apply, total: Variable, densities: Variable) -> Sequence[Variable]:
    """Both have the batch, since both come of the same values."""
    return list(op.make_node(total, densities).outputs)


@register_canonicalize("fast_compile")
@node_rewriter([Sum])
def _known_sum(_: FunctionGraph, node: Apply) -> list[Variable] | None:
    """The sum over all samples is known; over a batch besides, it is of the known sums."""
    (summed,) = node.inputs
    if summed.owner is None or not isinstance(summed.owner.op, OfSamples):
        return None
    total, last = summed.owner.inputs[0], summed.type.ndim - 2
    axes = range(summed.type.ndim) if node.op.axis is None else node.op.axis
    if not {last, last + 1} <= {*axes} or total.type.ndim != last:
        return None
    batch = [axis for axis in axes if axis < last]
    return [pt.sum(total, axis=batch) if batch else total]


@register_specialize
@node_rewriter([OfSamples])
def _one_by_one(_: FunctionGraph, node: Apply) -> list[Variable]:
    """Where they are asked for themselves."""
    return [node.inputs[1]]
