"""How the errors of a record's samples hang together: by the past of each channel, and by functions that they share.

Errors are autoregressive, each channel's of each record what a filter makes of white noise; or they are ``e + Phi w``
with white ``e`` and a finite basis ``Phi`` whose weights ``w`` are independent normals (a Gaussian process: a force of
no known law). A residual is whitened by the same matrix that whitens derivatives, so that optimum, evidence, posterior
and checks see one likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov, solve_toeplitz
from scipy.signal import lfilter

from bwbn_bayes.engines.base import NormalEquations
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Block, Record

MAX_ORDER = 4
"""Of autoregressive noise."""
_NEGLIGIBLE = 1e-10
"""Share of the largest variance below which a function adds rounding alone."""
MOST_CORRELATED = 0.999
"""Autocorrelation at one sample up to which noise is noise: beyond, a filter asks of a fit its slope alone."""


class SharedFunctions(NamedTuple):
    """A basis turned so that its functions are orthonormal over the samples of all channels.

    Errors are ``L R z``: the levels of the channels, the symmetric root of ``I + Phi V Phi'``, and white noise whose
    scale in each channel is known or integrated out. Where every scale is one, errors are white noise of these levels
    beside functions with independent weights.
    """

    functions: Floats
    """``(n_channels * n_times, n_functions)``, one channel after the other."""
    variance: Floats
    """Prior variance ``(n_functions,)`` of each one's weight, in that of the white part."""
    level: Floats | None = None
    """Of each channel's white part ``(n_channels,)``; none where there is one channel. [unit of the channel]"""

    @classmethod
    def of(cls, basis: Floats, level: Floats | None = None) -> SharedFunctions:
        """Of functions ``(n_channels * n_times, n)``, each times the sd of its weight over that of the white part."""
        variance, turned = np.linalg.eigh(basis.T @ basis)
        kept = variance > _NEGLIGIBLE * variance[-1]
        return cls(basis @ (turned[:, kept] / np.sqrt(variance[kept])), variance[kept], level=level)

    def turned(self, rows: Floats, factor: Floats) -> Floats:
        """Rows ``(..., n_channels, n_times)``, over the levels multiplied by a factor ``(n_functions,)`` along each."""
        over = rows if self.level is None else rows / self.level[:, None]
        flat = over.reshape(-1, len(self.functions))  # one product of matrices, not one of a vector for every row
        with np.errstate(over="ignore", invalid="ignore"):  # a draw that runs away
            whole = (flat + ((flat @ self.functions) * (factor - 1.0)) @ self.functions.T).reshape(rows.shape)
        return np.asarray(whole if self.level is None else whole * self.level[:, None])

    @property
    def log_volumes(self) -> Floats:
        """What each sample has of minus half the log determinant of ``I + Phi V Phi'``, ``(n_channels * n_times,)``."""
        return np.asarray(-0.5 * np.square(self.functions) @ np.log1p(self.variance))

    def until(self, n_times: int) -> SharedFunctions:
        """Those of the first samples."""
        n_channels = 1 if self.level is None else len(self.level)
        basis = (self.functions * np.sqrt(self.variance)).reshape(n_channels, -1, len(self.variance))[:, :n_times]
        return self.of(basis.reshape(-1, len(self.variance)), self.level)

    def times(self, scale: float) -> SharedFunctions:
        """With weights so many times as large."""
        return self._replace(variance=scale**2 * self.variance)


@dataclass(frozen=True, kw_only=True, eq=False)
class Correlation:
    """Correlation of the errors of each channel, its white part of unit variance.

    Parameters
    ----------
    coefficients : tuple of (order,) arrays, optional
        Of the autoregression of each block, empty for white noise.
    blocks : tuple of Block, optional
        Where these hold, a channel of one record each; each a whole channel where left out.
    shared : SharedFunctions, optional
        What the errors of a record's channels share.
    log_prior : float
        What the choice of orders or of a scale costs. [nat]
    """

    coefficients: tuple[Floats, ...] = ()
    blocks: tuple[Block, ...] = ()
    shared: SharedFunctions | None = None
    log_prior: float = 0.0

    def until(self, record: Record) -> Correlation:
        """That of the first samples, which are a record's."""
        if self.shared is not None:
            return replace(self, shared=self.shared.until(record.n_times))
        blocks = record.blocks if self.blocks else ()
        return replace(self, coefficients=self.coefficients[: len(record.blocks)], blocks=blocks)

    @property
    def _places(self) -> list[tuple[int, slice | NDArray[np.int64]]]:
        """Channel and samples of each block."""
        if self.blocks:
            return [(block.channel, block.samples) for block in self.blocks]
        return [(channel, slice(None)) for channel in range(len(self.coefficients))]

    @property
    def arrays(self) -> tuple[Floats, ...]:
        """All that it is made of, in numbers."""
        shared = self.shared
        level = () if shared is None or shared.level is None else (shared.level,)
        basis = () if shared is None else (shared.functions, shared.variance, *level)
        return (np.array([self.log_prior]), *self.coefficients, *basis)

    @property
    def log_volume(self) -> float:
        """Minus half the log determinant of the correlation matrix, and the cost of its choice, in nat."""
        spread = 0.0 if self.shared is None else 0.5 * float(np.sum(np.log1p(self.shared.variance)))
        return self.log_prior - spread - sum(float(np.sum(np.log(np.diag(own)))) for own in self.beginnings)

    @cached_property
    def beginnings(self) -> tuple[Floats, ...]:
        """Lower Cholesky factor ``(order, order)`` of each block's first samples, which have no past to be told by.

        Their covariance is that of the stationary process, in the variance of what is new in each sample.
        """
        return tuple(_beginning(own) for own in self.coefficients)

    def whitened(self, rows: Floats) -> Floats:
        """Rows ``(..., n_channels, n_times)`` times the inverse root of the correlation matrix."""
        if self.shared is not None:
            return self.shared.turned(rows, 1.0 / np.sqrt(1.0 + self.shared.variance))
        result = np.zeros(rows.shape)
        for coefficients, first, (c, samples) in zip(self.coefficients, self.beginnings, self._places, strict=True):
            own = rows[..., c, samples]
            white = _filtered(coefficients, own)
            if len(first):
                white[..., : len(first)] = own[..., : len(first)] @ np.linalg.inv(first).T
            result[..., c, samples] = white
        return result

    def coloured(self, white: Floats) -> Floats:
        """Autoregressive errors ``(..., n_channels, n_times)`` that are these rows where they are whitened."""
        result = np.zeros(white.shape)
        for coefficients, first, (c, samples) in zip(self.coefficients, self.beginnings, self._places, strict=True):
            own = white[..., c, samples].copy()
            begun = own[..., : len(first)] @ first.T
            own[..., : len(first)] = _filtered(coefficients, begun)
            result[..., c, samples] = lfilter([1.0], np.append(1.0, -coefficients), own)
        return result

    def products(self, rows: Floats) -> Floats:
        """Products under the inverse correlation matrix of rows ``(n, k, n_channels, n_times)`` with each other.

        Returns
        -------
        (n, n_blocks, k, k) array
        """
        if self.shared is None:
            white = self.whitened(rows)
            by_block = [white[:, :, c, samples] for c, samples in self._places]
            return np.stack([np.matmul(own, np.swapaxes(own, 1, 2)) for own in by_block], axis=1)
        if self.shared.level is not None:
            by_channel = np.moveaxis(self.whitened(rows), 1, 2)
            return np.asarray(np.matmul(by_channel, np.swapaxes(by_channel, 2, 3)))
        # (I + Phi V Phi')^-1 = I - Phi V / (1 + V) Phi': half the work of whitening.
        known = self.shared.variance / (1.0 + self.shared.variance)
        by_channel = np.moveaxis(rows, 1, 2)
        weights = by_channel.reshape(-1, rows.shape[-1]) @ self.shared.functions
        weights = weights.reshape(*by_channel.shape[:-1], -1)
        taken = np.matmul(weights * known, np.swapaxes(weights, 2, 3))
        return np.asarray(np.matmul(by_channel, np.swapaxes(by_channel, 2, 3)) - taken)

    def squares(self, residual: Floats) -> Floats:
        """Sums ``(n, n_blocks)`` of squared whitened residuals ``(n, n_channels, n_times)``."""
        return self.products(residual[:, None])[:, :, 0, 0]

    def equations(self, rows: Floats) -> NormalEquations:
        """Of residual and derivatives ``(n, 1 + n_parameters, n_channels, n_times)``."""
        products = self.products(rows)
        return NormalEquations(
            misfit=products[:, :, 0, 0], gradient=products[:, :, 1:, 0], information=products[:, :, 1:, 1:]
        )

    def shared_part(self, residual: Floats) -> Floats:
        """What errors are expected to share, given a residual ``(n_channels, n_times)``, or that of one channel."""
        if self.shared is None:
            return np.zeros_like(residual)
        return residual - self.shared.turned(residual, 1.0 / (1.0 + self.shared.variance))


def autoregression(residual: Floats) -> tuple[Floats, float]:
    """Coefficients ``(order,)`` of the autoregression of a residual ``(n_times,)``, and its log evidence over white.

    Of order 0 to 4, by the Yule-Walker equations, the order by Schwarz's approximation.

    References
    ----------
    .. [1] G. Schwarz, "Estimating the Dimension of a Model", Annals of Statistics 6(2), 1978,
       doi:10.1214/aos/1176344136.
    """
    n = len(residual)
    covariance = np.array([residual[lag:] @ residual[: n - lag] for lag in range(MAX_ORDER + 1)]) / n
    best, most = np.empty(0), 0.0
    if covariance[0] == 0.0:
        return best, most
    covariance[1:] *= min(1.0, MOST_CORRELATED * covariance[0] / max(abs(covariance[1]), 1e-300))
    for order in range(1, MAX_ORDER + 1):
        coefficients = solve_toeplitz(covariance[:order], covariance[1 : order + 1])
        innovation = float(np.mean(np.square(_filtered(coefficients, residual))))
        gain = 0.5 * n * float(np.log(covariance[0] / max(innovation, 1e-300))) + order_cost(order, n)
        if gain > most:
            best, most = coefficients, gain
    return best, most


def order_cost(order: int, n_times: int) -> float:
    """What an order of autoregression costs by Schwarz's approximation, in nat."""
    return -0.5 * order * float(np.log(n_times))


def _filtered(coefficients: Floats, rows: Floats) -> Floats:
    """What of rows ``(..., n_times)`` their own past does not tell, as if before the first sample there was nothing."""
    if len(coefficients) == 0 or rows.size == 0:
        return rows
    return np.asarray(lfilter(np.append(1.0, -coefficients), [1.0], rows))


def _beginning(coefficients: Floats) -> Floats:
    order = len(coefficients)
    if order == 0:
        return np.empty((0, 0))
    onward = np.eye(order, k=-1)
    onward[0] = coefficients
    new = np.zeros((order, order))
    new[0, 0] = 1.0
    # The state holds the last samples first; the covariance of a stationary process is the same read backwards.
    return np.asarray(np.linalg.cholesky(solve_discrete_lyapunov(onward, new)[::-1, ::-1]))
