"""The Gaussian likelihood of a record and the posterior every sampler sees.

Samplers work on the unit cube, where the prior is uniform over the admissible region. The noise scale of each channel
is known, sampled (a further coordinate), or integrated out under a proper inverse-gamma prior (the default).
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from bwbn_bayes.engines.base import Engine
from bwbn_bayes.engines.journal import Journal, about, question_of
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.correlation import Correlation
from bwbn_bayes.inference.least_squares import normal_equations, squared_residuals
from bwbn_bayes.parameters import Booleans, Floats, FreeParameter, ParameterSpace, Prior
from bwbn_bayes.records.band import noise_band
from bwbn_bayes.records.blocks import counts, labels
from bwbn_bayes.records.noise import noise_sds
from bwbn_bayes.records.record import Record, require_single
from bwbn_bayes.structures.structure import Structure

_LOG_2PI = float(np.log(2.0 * np.pi))
_LEAST_LEVEL = 1e-5
"""Of a channel's rms, below which noise is the solver's own error."""


class Noise(Protocol):
    """How the noise scale of each block enters the likelihood: a channel of one record.

    Squared residuals are those of whitened residuals where the samples' errors are correlated; ``n_times`` is the
    number of samples behind each, ``(n_blocks,)`` or one number for all.
    """

    @property
    def n_blocks(self) -> int:
        """Number of noise scales."""
        ...

    @property
    def correlation(self) -> Correlation | None:
        """Of the samples' errors; None where they are independent."""
        ...

    @property
    def parameters(self) -> tuple[FreeParameter, ...]:
        """Noise parameters that are sampled beside the model's own."""
        ...

    def log_likelihood(self, misfit: Floats, n_times: float | Floats, values: Floats) -> Floats:
        """Log likelihood ``(n_draws,)`` from squared residuals ``(n_draws, n_blocks)`` and sampled noise values."""
        ...

    def precision(self, misfit: Floats, n_times: float | Floats, values: Floats) -> Floats:
        """Minus twice the slope of the log likelihood in the squared residuals, ``(n_draws, n_blocks)``."""
        ...

    def most(self, promised: Floats, n_times: float | Floats) -> Floats:
        """What the log likelihood gains at most ``(n_draws,)`` where its expansion in the parameters promises this."""
        ...

    def draw_sd(self, rng: np.random.Generator, misfit: Floats, n_times: float | Floats, values: Floats) -> Floats:
        """Noise standard deviations ``(n_draws, n_blocks)`` from their posterior given each draw."""
        ...

    def describe(self) -> str:
        """One sentence for the report."""
        ...

    def until(self, record: Record) -> Noise:
        """That of the first samples, which are a record's."""
        ...


@dataclass(frozen=True, kw_only=True)
class KnownNoise:
    """Noise standard deviations ``(n_blocks,)`` known beforehand."""

    sd: tuple[float, ...]
    correlation: ClassVar[Correlation | None] = None

    @property
    def n_blocks(self) -> int:
        return len(self.sd)

    @property
    def parameters(self) -> tuple[FreeParameter, ...]:
        return ()

    def log_likelihood(self, misfit: Floats, n_times: float | Floats, values: Floats) -> Floats:
        variance = np.square(self.sd)
        return -0.5 * np.sum(misfit / variance + n_times * (np.log(variance) + _LOG_2PI), axis=1)

    def precision(self, misfit: Floats, n_times: float | Floats, values: Floats) -> Floats:
        return np.broadcast_to(1.0 / np.square(self.sd), misfit.shape)

    def most(self, promised: Floats, n_times: float | Floats) -> Floats:
        return promised

    def draw_sd(self, rng: np.random.Generator, misfit: Floats, n_times: float | Floats, values: Floats) -> Floats:
        return np.broadcast_to(np.asarray(self.sd), misfit.shape)

    def until(self, record: Record) -> KnownNoise:
        return self

    def describe(self) -> str:
        return f"Noise standard deviations are known: {', '.join(f'{sd:.3g}' for sd in self.sd)}."


@dataclass(frozen=True, kw_only=True)
class IntegratedNoise:
    """Noise variances integrated out under independent inverse-gamma priors.

    Parameters
    ----------
    shape : float
        Shape of the inverse-gamma prior of each channel's variance.
    scale : tuple of float
        Its scale, one per block, in squared units of the channel.
    correlation_samples : float or tuple of float
        Samples that count as one, of all blocks or of each. Behind a filter that ends the noise at a share of half the
        sampling rate it is one over that share: to a motion within the band the likelihood is then that of the noise as
        it is. Where a law leaves more than noise it is what :func:`~bwbn_bayes.inference.as_one.samples_as_one` finds.
    correlation : Correlation, optional
        Of the samples' errors, autoregressive or with a force of no known law among them.
    """

    shape: float
    scale: tuple[float, ...]
    correlation_samples: float | tuple[float, ...] = 1.0
    correlation: Correlation | None = field(default=None, repr=False)

    @property
    def n_blocks(self) -> int:
        return len(self.scale)

    @property
    def as_one(self) -> Floats:
        """Samples that count as one, one number or ``(n_blocks,)``."""
        return np.asarray(self.correlation_samples, dtype=np.float64)

    @property
    def parameters(self) -> tuple[FreeParameter, ...]:
        return ()

    def log_likelihood(self, misfit: Floats, n_times: float | Floats, values: Floats) -> Floats:
        scale, counted = np.asarray(self.scale), n_times / self.as_one
        end = self.shape + 0.5 * counted
        constant = self.shape * np.log(scale) - gammaln(self.shape) + gammaln(end) - 0.5 * counted * _LOG_2PI
        volume = 0.0 if self.correlation is None else self.correlation.log_volume
        return np.sum(constant - end * np.log(scale + 0.5 * misfit / self.as_one), axis=1) + volume

    def precision(self, misfit: Floats, n_times: float | Floats, values: Floats) -> Floats:
        as_one = self.as_one
        rate = 2.0 * as_one * np.asarray(self.scale) + misfit
        return np.asarray((2.0 * as_one * self.shape + n_times) / rate / as_one)

    def most(self, promised: Floats, n_times: float | Floats) -> Floats:
        """What is left is measured by a level that it makes smaller: most of all where the shortest blocks gain."""
        counted = np.broadcast_to(self.shape + 0.5 * n_times / self.as_one, (self.n_blocks,))
        gained, left = np.zeros(np.shape(promised)), np.asarray(promised)
        for own in np.sort(counted):
            share = np.minimum(left / own, 1.0 - _LEAST_LEVEL**2)
            gained, left = gained - own * np.log1p(-share), left - own * share
        return np.asarray(gained + left)

    def draw_sd(self, rng: np.random.Generator, misfit: Floats, n_times: float | Floats, values: Floats) -> Floats:
        rate = np.asarray(self.scale) + 0.5 * misfit / self.as_one
        shape = np.broadcast_to(self.shape + 0.5 * n_times / self.as_one, misfit.shape)
        return np.asarray(np.sqrt(rate / rng.gamma(shape)))

    def until(self, record: Record) -> IntegratedNoise:
        return self if self.correlation is None else replace(self, correlation=self.correlation.until(record))

    def describe(self) -> str:
        scales = ", ".join(f"{scale:.3g}" for scale in self.scale)
        prior = f"inverse-gamma priors of shape {self.shape:g} and scales {scales}"
        counts = " and ".join(f"{one:.3g}" for one in np.unique(self.as_one))
        together = f" Errors hang together: {counts} samples count as one."
        return f"Noise variances are integrated out under {prior}.{together if np.any(self.as_one > 1.0) else ''}"


@dataclass(frozen=True, kw_only=True)
class SampledNoise:
    """Noise standard deviations sampled beside the model's parameters, one prior per block; ``channels`` names them."""

    channels: tuple[str, ...]
    priors: tuple[Prior, ...]
    correlation: ClassVar[Correlation | None] = None

    @property
    def n_blocks(self) -> int:
        return len(self.priors)

    @property
    def parameters(self) -> tuple[FreeParameter, ...]:
        return tuple(
            FreeParameter(name=f"noise_sd[{c}]", symbol=f"noise_sd[{c}]", unit="SI", prior=p.truncated(0.0, np.inf))
            for c, p in zip(self.channels, self.priors, strict=True)
        )

    def log_likelihood(self, misfit: Floats, n_times: float | Floats, values: Floats) -> Floats:
        variance = np.square(values)
        return -0.5 * np.sum(misfit / variance + n_times * (np.log(variance) + _LOG_2PI), axis=1)

    def precision(self, misfit: Floats, n_times: float | Floats, values: Floats) -> Floats:
        return 1.0 / np.square(values)

    def most(self, promised: Floats, n_times: float | Floats) -> Floats:
        return promised

    def draw_sd(self, rng: np.random.Generator, misfit: Floats, n_times: float | Floats, values: Floats) -> Floats:
        return values

    def until(self, record: Record) -> SampledNoise:
        return self

    def describe(self) -> str:
        return f"Noise standard deviations are sampled, priors {', '.join(map(str, self.priors))}."


def require_noise(noise: Noise, record: Record) -> None:
    """Raise :class:`UserError` unless a noise model has one positive scale for each block, in the record's order."""
    channels = labels(record)
    if isinstance(noise, SampledNoise):
        if noise.channels != channels or len(noise.priors) != len(channels):
            raise UserError(
                f"SampledNoise: one prior for each of {', '.join(channels)}, in this order, is needed; channels are "
                f"{', '.join(noise.channels) or 'none'} with {len(noise.priors)} priors"
            )
        return
    scales = noise.sd if isinstance(noise, KnownNoise) else noise.scale if isinstance(noise, IntegratedNoise) else None
    if scales is None:
        return
    kind = type(noise).__name__
    if len(scales) != len(channels):
        raise UserError(f"{kind}: {len(scales)} scales for {len(channels)} channels: give one for each")
    if not all(0.0 < scale < np.inf for scale in scales) or (isinstance(noise, IntegratedNoise) and noise.shape <= 0.0):
        raise UserError(f"{kind}: every scale must be a positive number, not {', '.join(map(str, scales))}")
    if isinstance(noise, IntegratedNoise):
        as_one = noise.as_one
        if as_one.shape not in ((), (len(channels),)) or not np.all((as_one >= 1.0) & (as_one < np.inf)):
            raise UserError(
                f"{kind}: correlation_samples is {noise.correlation_samples}: it must be a number from 1 up, "
                "or one for each channel"
            )
        if noise.correlation is not None and noise.correlation.shared is not None:
            require_single(record, "errors that share functions are known of one:")


def default_noise(record: Record) -> IntegratedNoise:
    """Inverse-gamma priors of shape 1 about the model-free noise level of each channel of each record.

    The level (:func:`~bwbn_bayes.records.noise.noise_sds`) counts as two samples: a model that leaves ten times as much
    pays for it by its misfit, not by the prior. It is at least 1e-5 of the channel's rms, which no solver is beyond.
    Where a filter ends the noise (:func:`~bwbn_bayes.records.band.noise_band`), several samples count as one.
    All this depends on the training record alone, so that it is the same in every compared model.
    """
    scales: list[float] = []
    as_one: list[float] = []
    for part in record.parts:
        if part.channels:
            scales += _noise_variances(part)
            band = noise_band(part)
            as_one += [1.0 if band is None else band.correlation_samples] * len(part.channels)
    alike = len(set(as_one)) == 1
    return IntegratedNoise(shape=1.0, scale=tuple(scales), correlation_samples=as_one[0] if alike else tuple(as_one))


def _noise_variances(record: Record) -> list[float]:
    variances = []
    for (name, signal), level in zip(record.channels.items(), noise_sds(record).tolist(), strict=True):
        rms = float(np.sqrt(np.mean(np.square(signal[record.kept]))))
        if rms == 0.0:
            raise UserError(f"channel {name} of record {record.name!r} is zero throughout: drop it or mend the record")
        variances.append(max(level, _LEAST_LEVEL * rms) ** 2)
    return variances


@dataclass
class SolveCount:
    """Counts solves of one run; shared by every view of a posterior, in every thread."""

    total: int = 0

    def add(self, n: int) -> None:
        """Count ``n`` more."""
        with _COUNTING:
            self.total += n


_COUNTING = threading.Lock()
"""One for all counts: a lock of each one's own could not be sent to another process."""


@dataclass(frozen=True, kw_only=True)
class Linearisation:
    """Log likelihood, its gradient and Gauss-Newton information in unit coordinates.

    Shapes ``(n_draws,)``, ``(n_draws, n_dim)`` and ``(n_draws, n_dim, n_dim)``.
    """

    log_likelihood: Floats
    gradient: Floats
    information: Floats

    def __getitem__(self, index: NDArray[np.int64]) -> Linearisation:
        """The same at some of the points."""
        return Linearisation(
            log_likelihood=self.log_likelihood[index],
            gradient=self.gradient[index],
            information=self.information[index],
        )

    @classmethod
    def joined(cls, parts: Sequence[Linearisation]) -> Linearisation:
        """Those at several sets of points as one."""
        return cls(**{one.name: np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(cls)})

    def with_rows(self, index: NDArray[np.int64], other: Linearisation) -> Linearisation:
        """The same with another's at some of the points."""
        result = replace(self, **{one.name: getattr(self, one.name).copy() for one in fields(self)})
        for one in fields(self):
            getattr(result, one.name)[index] = getattr(other, one.name)
        return result


@dataclass(frozen=True, kw_only=True)
class Posterior:
    """The posterior of a model given a record, on the unit cube (a target of TMCMC).

    With a journal, what it is asked is kept there: misfits here, fits by :mod:`~bwbn_bayes.inference.kept`.
    """

    model: Structure
    record: Record
    engine: Engine
    noise: Noise
    solves: SolveCount = field(default_factory=SolveCount)
    journal: Journal | None = field(default=None, repr=False)

    def __getstate__(self) -> dict[str, object]:
        """Its fields, for other processes: compiled conditions of the space take longer to send than to make."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    @cached_property
    def space(self) -> ParameterSpace:
        """The model's identified parameters, then the noise's."""
        own = self.model.space
        if not self.noise.parameters:
            return own
        return replace(own, parameters=own.parameters + self.noise.parameters)

    @property
    def n_dim(self) -> int:
        """Number of coordinates."""
        return self.model.space.n_dim + len(self.noise.parameters)

    def until(self, time: float) -> Posterior:
        """The posterior given the record's first seconds only."""
        record = self.record.until(time)
        return replace(self, record=record, noise=self.noise.until(record))

    def with_noise(self, noise: Noise) -> Posterior:
        """The same posterior under another noise model."""
        return replace(self, noise=noise)

    def with_model(self, model: Structure) -> Posterior:
        """The posterior of another model given the same record, noise priors and engine."""
        return replace(self, model=model)

    def with_engine(self, engine: Engine) -> Posterior:
        """The same posterior solved by another engine or scheme."""
        return replace(self, engine=engine)

    def log_prior(self, points: Floats) -> Floats:
        """Log prior density ``(n_draws,)`` on the unit cube."""
        return self.space.log_prior_unit(points)

    def sample_prior(self, rng: np.random.Generator, n: int) -> Floats:
        """Draws ``(n, n_dim)`` from the prior."""
        return self.space.sample_unit(rng, n)

    def split(self, points: Floats) -> tuple[Floats, Floats]:
        """Model parameters and noise parameters in their own units."""
        values = self.space.from_unit(points)
        return values[:, : self.model.space.n_dim], values[:, self.model.space.n_dim :]

    def misfit(self, points: Floats) -> Floats:
        """Squared residuals, whitened, ``(n_draws, n_blocks)``; infinite where the solve failed."""
        self.solves.add(len(points))
        if self.journal is None:
            return self._misfit(points)
        question = question_of("misfit", self.about, points)
        (found,) = self.journal.kept("misfit", question, len(points), lambda some: (self._misfit(points[some]),))
        return found

    @property
    def standard(self) -> NDArray[np.int64]:
        """Coordinates whose priors are normal, so that evidence is told in their standard normals: none."""
        return np.empty(0, dtype=np.int64)

    @property
    def about(self) -> str:
        """Hash of all that shapes what it answers, but for the points."""
        correlation = self.noise.correlation
        arrays = () if correlation is None else correlation.arrays
        return question_of(repr(self.noise), about(self.engine, self.model, self.record), *arrays).hex()

    def _misfit(self, points: Floats) -> Floats:
        values = self.split(points)[0]
        return squared_residuals(self.engine, self.model, values, self.record, self.noise.correlation)

    def _of_all_blocks(self, of_blocks: Floats) -> Floats:
        """Sums ``(..., n_blocks)`` with zeros for the records that the first seconds do not reach."""
        beyond = self.noise.n_blocks - of_blocks.shape[-1]
        return of_blocks if beyond == 0 else np.pad(of_blocks, [(0, 0)] * (of_blocks.ndim - 1) + [(0, beyond)])

    @cached_property
    def _n_times(self) -> Floats:
        """Samples of each block that count."""
        return self._of_all_blocks(counts(self.record))

    def log_likelihood(self, points: Floats) -> Floats:
        """Log likelihood ``(n_draws,)``; minus infinity where the solve failed."""
        return self.log_likelihood_of(self.misfit(points), points)

    def log_likelihood_of(self, misfit: Floats, points: Floats) -> Floats:
        """Log likelihood ``(n_draws,)`` from squared residuals already computed."""
        ok = np.all(np.isfinite(misfit), axis=1)
        result = np.full(len(points), -np.inf)
        noise_values = self.split(points[ok])[1]
        result[ok] = self.noise.log_likelihood(self._of_all_blocks(misfit[ok]), self._n_times, noise_values)
        return result

    def gradient_of(self, misfit: Floats, slopes: Floats, points: Floats) -> Floats:
        """Gradient ``(n_draws, n_dim)`` of the log likelihood in unit coordinates from squared residuals.

        Parameters
        ----------
        misfit : (n_draws, n_blocks) array
        slopes : (n_draws, n_blocks, n_parameters) array
            Their derivatives, in the parameters' own units.
        points : (n_draws, n_dim) array
            Where they belong to.
        """
        values, noise_values = self.split(points)
        own = -0.5 * np.einsum("nc,ncp->np", self._precision(misfit, noise_values), slopes)
        return self._with_noise_slopes(own, misfit, values, noise_values)

    def _with_noise_slopes(self, own: Floats, misfit: Floats, values: Floats, noise_values: Floats) -> Floats:
        """The gradient in unit coordinates, from that by the model's parameters ``(n_draws, n)`` in their own units."""
        d = self.model.space.n_dim
        gradient = np.zeros((len(own), self.n_dim))
        gradient[:, :d] = own
        every, n_times = self._of_all_blocks(misfit), self._n_times
        for c in range(self.n_dim - d):
            sd = noise_values[:, c]
            gradient[:, d + c] = every[:, c] / sd**3 - n_times[c] / sd
        return np.asarray(gradient * self.space.unit_scale(np.hstack([values, noise_values])))

    def _precision(self, misfit: Floats, noise_values: Floats) -> Floats:
        """Of the blocks that are there, ``(n_draws, n_blocks)``."""
        found = self.noise.precision(self._of_all_blocks(misfit), self._n_times, noise_values)
        return np.asarray(found)[:, : misfit.shape[1]]

    def precision(self, points: Floats) -> Floats:
        """Of the noise that is left, ``(n_draws, n_blocks)``: minus twice the likelihood's slope in the squares."""
        return self._precision(self.misfit(points), self.split(points)[1])

    def most(self, promised: Floats) -> Floats:
        """What the log likelihood gains at most, ``(n_draws,)``, where its expansion promises this."""
        return self.noise.most(promised, self._n_times)

    def linearise(self, points: Floats, free: Booleans | None = None) -> Linearisation:
        """Gauss-Newton expansion at each point; a failed solve has zero gradient and information.

        So have coordinates that are not ``free``, ``(n_draws, n_dim)``; their derivatives are not computed.
        """
        self.solves.add(len(points))
        values, noise_values = self.split(points)
        d = self.model.space.n_dim
        own = None if free is None else free[:, :d]
        equations = normal_equations(self.engine, self.model, values, self.record, self.noise.correlation, own)
        ok = np.all(np.isfinite(equations.misfit), axis=1)
        misfit = np.where(ok[:, None], equations.misfit, 1.0)
        weight, n_times = self._precision(misfit, noise_values) * ok[:, None], self._n_times
        scale = self.space.unit_scale(np.hstack([values, noise_values]))
        scale = scale if free is None else np.where(free, scale, 0.0)
        information = np.zeros((len(points), self.n_dim, self.n_dim))
        own_gradient, information[:, :d, :d] = equations.weighted(weight)
        gradient = self._with_noise_slopes(own_gradient, misfit, values, noise_values) * ok[:, None]
        for c in range(self.n_dim - d):
            information[:, d + c, d + c] = ok * 2.0 * n_times[c] / noise_values[:, c] ** 2
        return Linearisation(
            log_likelihood=np.where(ok, self.log_likelihood_of(misfit, points), -np.inf),
            gradient=gradient if free is None else np.where(free, gradient, 0.0),
            information=information * scale[:, :, None] * scale[:, None, :],
        )
