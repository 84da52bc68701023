"""Whether what a fit leaves behind is noise: its level against a model-free estimate, and its whiteness."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter
from scipy.stats import chi2, f, f_oneway, levene, ttest_1samp

from bwbn_bayes.inference.correlation import autoregression
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.summary import observe
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.band import noise_band
from bwbn_bayes.records.blocks import by_block, by_part, labels
from bwbn_bayes.records.noise import LEAST_NOISE, noise_sds
from bwbn_bayes.records.record import Record
from bwbn_bayes.results import Check

N_LAGS = 20
N_STRETCHES = 12
LEAST_PROBABILITY = 1e-5
LARGEST_RATIO = 1.25
QUIET_PROBABILITY, QUIET_RATIO = 5e-3, 1.15
"""Probability that noise fails any of the tests of all channels: a thousandth for each of three channels' six."""
_SHARES = (0.01, 0.03, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.97, 0.99)
"""Quantiles that part the range of a motion, finer where it is extreme: saturation or a stop shows only there."""
_MOTIONS = ("drift", "drift_rate", "hysteretic_displacement")


def whiteness_probability(residual: Floats, n_fitted: int = 0) -> float:
    """Probability of autocorrelations as large as those of ``residual (n_times,)`` if it were white noise.

    So many of its lags were fitted to it, and have no degree of freedom left.

    References
    ----------
    .. [1] G. M. Ljung and G. E. P. Box, "On a Measure of Lack of Fit in Time Series Models", Biometrika 65, 1978,
       doi:10.1093/biomet/65.2.297.
    """
    n = len(residual)
    lags = min(N_LAGS, n // 4)
    centred = residual - np.mean(residual)
    power = float(centred @ centred)
    if power == 0.0:
        return 1.0
    correlation = np.array([centred[lag:] @ centred[:-lag] for lag in range(1, lags + 1)]) / power
    statistic = n * (n + 2) * np.sum(np.square(correlation) / (n - np.arange(1, lags + 1)))
    return float(chi2.sf(statistic, max(lags - n_fitted, 1)))


class ColouredNoise(NamedTuple):
    """Autoregressive noise fitted to a residual."""

    coefficients: Floats
    """``(order,)``; none where white noise is the better account."""
    gain: float
    """Log evidence over white noise. [nat]"""

    @property
    def correlation_samples(self) -> float:
        """Samples over which magnitudes are correlated: the sum of the squared autocorrelations over all lags."""
        impulse = np.zeros(1024)
        impulse[0] = 1.0
        response = lfilter([1.0], np.concatenate([[1.0], -self.coefficients]), impulse)
        covariance = np.correlate(response, response, mode="full")
        return float(np.sum(np.square(covariance / np.max(covariance))))

    def innovations(self, residual: Floats) -> Floats:
        """What of a residual ``(n_times,)`` its past does not tell, ``(n_times - order,)``."""
        whitening = np.concatenate([[1.0], -self.coefficients])
        return np.convolve(residual, whitening, mode="valid")


def coloured_noise(residual: Floats) -> ColouredNoise:
    """Fit autoregressive noise of order 0 to 4 about its mean to a residual ``(n_times,)``."""
    return ColouredNoise(*autoregression(residual - np.mean(residual)))


def has_past(record: Record) -> bool:
    """Whether errors of a record can have a past: a filter in time means nothing without time, or across gaps."""
    return record.has_time and all(part.counted is None for part in record.parts)


def is_noise(residual: Floats, motions: Floats | Sequence[Floats] = (), *, noise: ColouredNoise | None = None) -> bool:
    """Whether a residual could be stationary noise, white or autoregressive, that knows nothing of the motion.

    Its innovations must be white (Ljung and Box) and zero in the mean (Student), and they and the residual itself
    equally strong throughout (Levene's test over twelve stretches): what a model lacks comes and goes with the motion.
    Nor may the mean of the innovations (analysis of variance) or their strength (Levene) differ between the parts of
    any motion's range.

    Parameters
    ----------
    residual : (n_times,) array
    motions : (n_motions, n_times) array, optional
        Histories that the model says took place.
    noise : ColouredNoise, optional
        What kind of noise it could be: by default the most probable autoregressive one.
    """
    noise = noise or coloured_noise(residual)
    innovations = noise.innovations(residual)
    # In this order: one that is too improbable is enough, and those of the motions cost most.
    return (
        whiteness_probability(innovations, len(noise.coefficients)) > LEAST_PROBABILITY
        and _centredness(innovations) > LEAST_PROBABILITY
        and steadiness(innovations) > LEAST_PROBABILITY
        and steadiness(residual, noise.correlation_samples) > LEAST_PROBABILITY
        and all(_unawareness(innovations, own[-len(innovations) :]) > LEAST_PROBABILITY for own in motions)
    )


def _centredness(innovations: Floats) -> float:
    """Probability of a mean as far from zero if that were the true one."""
    return float(ttest_1samp(innovations, 0.0).pvalue) if np.any(innovations) else 1.0


def _unawareness(innovations: Floats, motion: Floats) -> float:
    """Probability of parts of a motion's range as unequal, in mean or strength, if there were no connection."""
    edges = np.unique(np.quantile(motion, _SHARES))
    part = np.searchsorted(edges, motion)
    groups = [own for n in range(len(edges) + 1) if len(own := innovations[part == n]) > 1]
    if len(groups) < 2 or not np.any(innovations):
        return 1.0
    return float(min(f_oneway(*groups).pvalue, levene(*groups, center="mean").pvalue))


def steadiness(residual: Floats, correlation_samples: float = 1.0) -> float:
    """Probability of stretches as unequal in strength if the residual were equally strong throughout.

    So many successive magnitudes count as one.
    """
    statistic = float(levene(*np.array_split(residual, N_STRETCHES), center="mean").statistic)
    n_counted = len(residual) / correlation_samples
    return float(f.sf(statistic / correlation_samples, N_STRETCHES - 1, max(n_counted - N_STRETCHES, 1.0)))


def residual_of(posterior: Posterior, point: Floats) -> Floats:
    """Measured minus modelled channels ``(n_channels, n_times)`` at a point ``(n_dim,)`` of the unit cube.

    Zero where samples do not count.
    """
    record = posterior.record
    return record.where_counted(record.measured - _modelled(posterior, point))


def counted(record: Record, residual: Floats) -> Floats:
    """Residuals ``(n_channels, n_times)`` at a rate at which one record's noise is white, ``(n_channels, n_counted)``.

    Where a filter ends the noise that is twice its band (:func:`~bwbn_bayes.records.band.noise_band`), else the
    record's own; without the samples that do not count.
    """
    band = noise_band(record)
    return residual[:, record.kept] if band is None else band.thinned(residual)


def leaves_quiet(posterior: Posterior, point: Floats) -> bool:
    """Whether what a fit leaves of every channel is white, steady and no louder than its model-free noise level.

    Stricter than :func:`leaves_noise`: nothing of note is left, and first-order scores can be believed.
    """
    residual = residual_of(posterior, point)
    if max(_to_noise(posterior.record, residual)) >= QUIET_RATIO:
        return False
    return are_quiet(_rests(posterior.record, residual))


def are_quiet(rests: Sequence[Floats]) -> bool:
    """Whether residuals, each ``(n_counted,)``, are white and steady; noise is but for :data:`QUIET_PROBABILITY`.

    The more they are, the smaller their least probability is by chance. Of a few hundred samples twice as much noise
    fails: the tails of both tests are those of long records.

    References
    ----------
    .. [1] Z. Sidak, "Rectangular Confidence Regions for the Means of Multivariate Normal Distributions", 1967,
       doi:10.1080/01621459.1967.10482935.
    """
    least = -np.expm1(np.log1p(-QUIET_PROBABILITY) / (2 * max(len(rests), 1)))
    return all(min(whiteness_probability(rest), steadiness(rest)) > least for rest in rests)


def leaves_noise(posterior: Posterior, point: Floats) -> bool:
    """Whether what a fit at a point ``(n_dim,)`` of the unit cube leaves of every channel :func:`is_noise`.

    The motions it may know nothing of are the modelled channels, and drift, drift rate and hysteretic displacement of
    every storey. Where errors cannot have a past, noise is white.
    """
    record = posterior.record
    noise = None if has_past(record) else ColouredNoise(np.empty(0), 0.0)
    modelled = _modelled(posterior, point)
    values, _ = posterior.split(point[None])
    posterior.solves.add(1)
    rows = observe(posterior.engine, posterior.model, values, record)
    motions = np.concatenate([modelled, *(rows[kind][0] for kind in _MOTIONS)])
    parts = zip(by_part(record, record.measured - modelled), _motions(record, motions), strict=True)
    return all(is_noise(rest, own, noise=noise) for (part, left), own in parts for rest in counted(part, left))


def _motions(record: Record, motions: Floats) -> Iterator[Floats]:
    """Motions ``(n_motions, n_times)`` at the samples of :func:`counted`, for each record that measures anything."""
    for part, stretch in zip(record.parts, record.stretches, strict=True):
        if part.channels:
            band = noise_band(part)
            own = motions[:, stretch]
            yield own[:, part.kept] if band is None else band.at_thinned(own)


def _modelled(posterior: Posterior, point: Floats) -> Floats:
    """Channels ``(n_channels, n_times)`` at a point of the unit cube."""
    values, _ = posterior.split(point[None])
    posterior.solves.add(1)
    return np.asarray(posterior.engine.simulate(posterior.model, values, posterior.record).values[0])


def level(residual: Floats) -> float:
    """Root mean square about zero: a constant offset is no noise."""
    return float(np.sqrt(np.mean(np.square(residual))))


def noise_floors(record: Record) -> Floats:
    """Model-free noise level of each block ``(n_blocks,)``; at least a thousandth of its rms."""
    return np.maximum(*_levels(record))


def _levels(record: Record) -> tuple[Floats, Floats]:
    """Model-free noise level of each block ``(n_blocks,)``, and the least that counts."""
    parts = [part for part in record.parts if part.channels]
    least = [LEAST_NOISE * np.std(part.measured[:, part.kept], axis=1) for part in parts]
    return np.concatenate([noise_sds(part) for part in parts]), np.concatenate(least)


def _rests(record: Record, residual: Floats) -> list[Floats]:
    """Residuals ``(n_channels, n_times)`` as :func:`counted` gives them, block by block."""
    return [rest for part, own in by_part(record, residual) for rest in counted(part, own)]


def _to_noise(record: Record, residual: Floats) -> list[float]:
    """Level of each block's residual, of ``(n_channels, n_times)``, over its model-free noise level."""
    floors = noise_floors(record).tolist()
    return [level(rest) / floor for rest, floor in zip(by_block(record, residual), floors, strict=True)]


def heard_rests(posterior: Posterior, point: Floats) -> dict[str, Floats]:
    """Residuals ``(n_counted,)`` at a point ``(n_dim,)`` by block, where they exceed what a solver may leave."""
    return _heard(posterior.record, residual_of(posterior, point))


def _heard(record: Record, residual: Floats) -> dict[str, Floats]:
    rests = zip(labels(record), _rests(record, residual), by_block(record, record.measured), strict=True)
    return {name: rest for name, rest, signal in rests if level(rest) > LEAST_NOISE * np.std(signal)}


def _level_in_words(name: str, ratio: float, *, is_model_free: bool) -> str:
    """Below one it passes: a small residual is no sign against a model, but may say that the yardstick is too long."""
    if not is_model_free:
        return f"The residual of {name} is {ratio:.2f} thousandths of its rms, of which one counts as noise."
    said = f"The residual of {name} is {ratio:.2f} times its model-free noise level."
    if ratio * LARGEST_RATIO >= 1.0:
        return said
    return f"{said} That level holds motion, too: an effect below it is not heard here."


def residual_checks(posterior: Posterior, point: Floats) -> tuple[Check, ...]:
    """Noise level and whiteness of the residual at a point ``(n_dim,)`` of the unit cube, worst block of each.

    The colour of what is less than a thousandth of a channel's rms does not count: a record without noise leaves only
    the solver's error. Coloured noise fails, since neither yardstick nor likelihood knows of any but white noise; the
    sentence says whether it could be noise (:func:`is_noise`), which a small missing effect can look like.
    """
    record = posterior.record
    residual = residual_of(posterior, point)
    ratios = dict(zip(labels(record), _to_noise(record, residual), strict=True))
    heard = _heard(record, residual)
    found, least = _levels(record)
    is_model_free = dict(zip(labels(record), (found > least).tolist(), strict=True))
    white = {name: whiteness_probability(heard[name]) if name in heard else 1.0 for name in ratios}
    loudest, reddest = max(ratios, key=lambda name: ratios[name]), min(white, key=lambda name: white[name])
    is_white = white[reddest] > LEAST_PROBABILITY
    whiteness = f"White noise is as coloured as the residual of {reddest} with probability {white[reddest]:.2g}."
    if not is_white and leaves_noise(posterior, point):
        whiteness += " It may be coloured noise or a small effect that the model lacks: bwbn discover weighs both."
    return (
        Check(
            name="residual level",
            value=ratios[loudest],
            limit=LARGEST_RATIO,
            passed=ratios[loudest] < LARGEST_RATIO,
            sentence=_level_in_words(loudest, ratios[loudest], is_model_free=is_model_free[loudest]),
        ),
        Check(
            name="residual whiteness",
            value=white[reddest],
            limit=LEAST_PROBABILITY,
            passed=is_white,
            sentence=whiteness,
        ),
    )
