"""Noise: adding it at a stated signal-to-noise ratio, and estimating it from a measured channel without a model."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from math import comb

import numpy as np
from scipy import stats

from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Floats, is_number
from bwbn_bayes.records.band import noise_band
from bwbn_bayes.records.joined import JoinedRecord, join_records
from bwbn_bayes.records.record import MIN_SAMPLES, Record

MAX_DIFFERENCE_ORDER = 16
LEAST_NOISE = 1e-3
"""Noise below this share of a channel's rms cannot be told from the error of solving and rounding."""

MOST_DECIBELS = 300.0
"""Of a signal-to-noise ratio: beyond the fifteen digits of a double, one drowns the other whatever it is. [dB]"""

_CLIP = 2.5
_MEDIAN = float(stats.norm.ppf(0.75))
"""Median absolute value of a standard normal variable."""
_KEPT_VARIANCE = 1.0 - 2.0 * _CLIP * float(stats.norm.pdf(_CLIP)) / (2.0 * float(stats.norm.cdf(_CLIP)) - 1.0)
"""Its variance within the clips."""
_LEVEL_SIGMAS = 1.5


def add_noise(record: Record, snr_db: float | None, rng: np.random.Generator) -> Record:
    """Add white Gaussian noise to every channel at a signal-to-noise ratio in dB of mean square.

    The noise of a channel has the variance ``mean(y^2) / 10^(snr_db / 10)``; the excitation stays as it is.

    Parameters
    ----------
    record : Record
        Record with channels.
    snr_db : float or None
        Signal-to-noise ratio, the same for every channel. [dB] None or infinity leaves the record unchanged.
    rng : numpy.random.Generator
        Source of randomness; channels draw from it in order.

    Returns
    -------
    Record
        With ``noise_sd`` set; where the record names a noise level already, the two add in variance.

    Raises
    ------
    UserError
        If ``snr_db`` is not a number.
    """
    if snr_db is None or snr_db == np.inf:
        return record
    if not is_number(snr_db) or not abs(snr_db) <= MOST_DECIBELS:
        raise UserError(
            f"snr_db is {snr_db}: it must be a number of decibels within {MOST_DECIBELS:g} of zero, or None for none"
        )
    if isinstance(record, JoinedRecord):
        return record.with_each(lambda part: add_noise(part, snr_db, rng))
    noisy: dict[str, Floats] = {}
    noise_sd: dict[str, float] = {}
    for channel, values in record.channels.items():
        sd = float(np.sqrt(np.mean(np.square(values)) * 10.0 ** (-snr_db / 10.0)))
        noisy[channel] = values + sd * rng.standard_normal(len(values))
        noise_sd[channel] = float(np.hypot(sd, record.noise_sd.get(channel, 0.0)))
    earlier = record.provenance.get("noise")
    added = f"white Gaussian, {snr_db:g} dB of mean square"
    return replace(
        record,
        channels=noisy,
        noise_sd=noise_sd,
        provenance={**record.provenance, "noise": f"{earlier}; {added}" if earlier else added},
    )


def require_long_enough(record: Record) -> None:
    """Raise :class:`UserError` unless so many samples of a record count that its noise can be told."""
    if record.n_counted < MIN_SAMPLES:
        raise UserError(
            f"record {record.name!r} has {record.n_counted} samples: at least {MIN_SAMPLES} are needed to tell its "
            "noise, give a longer one"
        )


def with_least_noise(record: Record, rng: np.random.Generator) -> Record:
    """Add white noise of a thousandth of its rms to every channel whose model-free noise level is below that.

    A record without noise, from another program, would ask for a solver without error.

    Parameters
    ----------
    record : Record
        Record with channels.
    rng : numpy.random.Generator
        Source of randomness; channels that need noise draw from it in order.

    Returns
    -------
    Record
        The same record where no channel needs it.
    """
    if isinstance(record, JoinedRecord):
        quiet = [with_least_noise(part, rng) for part in record.members]
        same = all(one is part for one, part in zip(quiet, record.members, strict=True))
        return record if same else join_records(quiet, in_sequence=record.is_sequence)
    sizes = np.sqrt(np.mean(np.square(record.measured[:, record.kept]), axis=1)).tolist()
    least = {name: LEAST_NOISE * size for name, size in zip(record.channels, sizes, strict=True)}
    silent = [name for name, sd in zip(record.channels, noise_sds(record), strict=True) if sd < least[name]]
    if not silent:
        return record
    noise = {name: least[name] * rng.standard_normal(record.n_times) for name in silent}
    return replace(
        record,
        channels={name: y + noise.get(name, 0.0) for name, y in record.channels.items()},
        noise_sd={**record.noise_sd, **{n: float(np.hypot(least[n], record.noise_sd.get(n, 0.0))) for n in silent}},
        provenance={**record.provenance, "noise": f"white, {LEAST_NOISE:g} of the rms, added to {', '.join(silent)}"},
    )


@lru_cache(maxsize=16)
def noise_sds(record: Record) -> Floats:
    """Noise level of each channel ``(n_channels,)`` without a model: that of its band where a filter ends the noise.

    See :func:`~bwbn_bayes.records.band.noise_band`, and :func:`model_free_noise_sd` for white noise. What counts of a
    record of which not all does is taken in one piece: the few differences across a gap drop out like those of a kink.
    """
    band = noise_band(record)
    if band is not None:
        return band.sds
    found = np.array([model_free_noise_sd(signal) for signal in record.measured[:, record.kept]])
    found.flags.writeable = False
    return found


def model_free_noise_sd(signal: Floats) -> float:
    """Estimate the standard deviation of the white noise on a smooth signal, without a model.

    A difference of order k multiplies the variance of white noise by ``binomial(2k, k)``, about ``4^k``, and a signal
    of frequency f by ``(2 sin(pi f time_step))^(2k)``: the scaled differences fall with k until only noise is left. The
    estimate is taken at the lowest order that agrees with all higher ones within their sampling error (Lepski's rule).
    Each order's scale is that of a normal distribution clipped at 2.5 of its own standard deviations, started from the
    median absolute value, so that the few differences that span a kink or a jump drop out.

    It is an upper bound in principle: whatever the highest order (16, less for short signals) cannot tell from noise
    counts as noise. Signal above about a quarter of the sampling rate, or kinks larger than the noise closer together
    than some 15 samples, raise it. It sees the noise density near half the sampling rate: noise that an anti-aliasing
    filter has coloured is underestimated (:func:`noise_sds` looks below the filter), and the resolution of a digitiser
    below its last bit is not seen.

    Parameters
    ----------
    signal : (n_times,) array
        Uniformly sampled channel, in any unit; at least 32 points. The sampling rate does not enter.

    Returns
    -------
    float
        Noise standard deviation of one sample. [unit of the signal] Rounding error, about 1e-16 of the signal, where
        there is no noise.

    Raises
    ------
    UserError
        If there are fewer than 32 points or a value is not finite.

    References
    ----------
    .. [1] T. Gasser, L. Sroka, C. Jennen-Steinmetz, "Residual variance and residual pattern in nonlinear regression",
       Biometrika 73(3), 1986, doi:10.1093/biomet/73.3.625 (the idea, with second differences).
    .. [2] O. V. Lepski, "On a problem of adaptive estimation in Gaussian white noise", 1991, doi:10.1137/1135065.
    """
    values = np.asarray(signal, dtype=np.float64)
    if values.ndim != 1 or len(values) < MIN_SAMPLES or not np.all(np.isfinite(values)):
        raise UserError(
            f"a noise level needs at least {MIN_SAMPLES} finite values of one channel: the signal has shape "
            f"{values.shape}"
        )
    highest = min(MAX_DIFFERENCE_ORDER, len(values) // 8)
    differences = values
    scales, errors = [], []
    for order in range(1, highest + 1):
        differences = np.diff(differences)
        scales.append(_clipped_scale(differences) / np.sqrt(comb(2 * order, order)))
        errors.append(_relative_error(order, len(differences)))
    level = np.array(scales)
    ceiling = level * (1.0 + _LEVEL_SIGMAS * np.array(errors))
    lowest_ceiling_above = np.minimum.accumulate(ceiling[::-1])[::-1]
    return float(level[np.argmax(level <= lowest_ceiling_above)])


def _clipped_scale(values: Floats) -> float:
    """Standard deviation of the normal core of ``values``: a fixed point of clipping, from the median on."""
    magnitudes = np.abs(values)
    scale = float(np.median(magnitudes)) / _MEDIAN
    for _ in range(20):
        kept = magnitudes[magnitudes <= _CLIP * scale]
        if not kept.size:
            break
        scale = float(np.sqrt(np.mean(np.square(kept)) / _KEPT_VARIANCE))
    return scale


def _relative_error(order: int, n_differences: int) -> float:
    """Relative standard error of the rms of ``n_differences`` differences of white noise (they are correlated)."""
    sum_of_squared_correlations = comb(4 * order, 2 * order) / comb(2 * order, order) ** 2
    return float(np.sqrt(sum_of_squared_correlations / (2.0 * n_differences)))
