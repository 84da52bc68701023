"""Where a filter ends the noise of a record, and how strong the noise is below that.

An anti-aliasing filter leaves no noise near half the sampling rate: an estimate taken there is far too low, and
successive samples of the noise are correlated. Below the filter's corner the noise shows as a flat stretch of the
spectrum that is as strong in quiet times as in strong motion; what a structure does comes and goes, and falls with
frequency. Under a broad excitation that never comes and goes, motion is as steady and as flat as noise: nothing is told
there. A logger has one corner for all of its channels.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.signal import resample, spectrogram
from scipy.stats import norm

from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record

_LEAST_SEGMENT, _MOST_SEGMENT = 64, 512
_SEGMENTS = 16
"""Segments that a channel is cut into, at least, but for the overlap."""
_WIDTH, _LEAST_BINS = 0.1, 8
"""Width of the flat stretch, as a share of half the sampling rate, and in bins; an excitation so wide is broad."""
_SLOPE = 1.0
"""Change of its level from end to end that counts as flat, beyond one and a half standard errors. [dB]"""
_DROP = 10.0
"""By how much the level near half the sampling rate lies below it, at least. [dB]"""
_SAME_LEVEL = 1.5
"""Stretches so close to the highest one are of one plateau. [dB]"""
_MOST_POWER = 0.3
"""Share of a channel's power from which on the stretch is no noise."""
_ONE_CORNER = 0.2
"""Relative distance of a channel's band from the median up to which they are of one filter."""
_BELOW = 0.9
"""Of the band, where the filter does not act yet."""
_CORRELATION = 1.5
"""Neighbouring bins of a Hann window that count as one."""


class NoiseBand(NamedTuple):
    """Noise that a filter has confined to the lower part of the spectrum."""

    share: float
    """Of half the sampling rate: how far noise of the plateau's density would reach."""
    sds: Floats
    """Standard deviation of one sample of each channel, ``(n_channels,)``. [unit of the channel]"""

    @property
    def correlation_samples(self) -> float:
        """Samples that say as much about a slow motion as one would if the noise were white."""
        return 1.0 / self.share

    def thinned(self, residuals: Floats) -> Floats:
        """Residuals ``(..., n_times)`` at twice the rate of the band, where noise is white, ``(..., n_counted)``."""
        return np.asarray(resample(residuals, self._n_counted(residuals), axis=-1))

    def at_thinned(self, motions: Floats) -> Floats:
        """Histories ``(..., n_times)`` at the samples nearest to the thinned ones."""
        n = self._n_counted(motions)
        nearest = np.round(np.arange(n) * motions.shape[-1] / n).astype(np.int64)
        return np.asarray(motions[..., nearest])

    def _n_counted(self, histories: Floats) -> int:
        return round(self.share * len(histories.T))


@lru_cache(maxsize=16)
def noise_band(record: Record) -> NoiseBand | None:
    """The band of a record's noise, or None where nothing speaks for a filter.

    The highest stretch of a channel's spectrum counts that is flat, lies 10 dB above the level near half the sampling
    rate, is equally strong throughout the record and holds no more than 30 % of the power. There is a filter where at
    least one channel has such a stretch, all that do end at about one frequency, and the others fall by as much above
    it: where their motion hides the noise, its level is that of their quiet times.

    Parameters
    ----------
    record : Record
        With channels; too short to tell below some 500 samples, with gaps where not all samples count, and without
        quiet times where a broad excitation is steady, as multisines and sweeps are: none then.

    References
    ----------
    .. [1] P. D. Welch, "The use of fast Fourier transform for the estimation of power spectra", IEEE Transactions on
       Audio and Electroacoustics 15(2), 1967, doi:10.1109/TAU.1967.1161901.
    .. [2] R. Martin, "Noise power spectral density estimation based on optimal smoothing and minimum statistics", IEEE
       Transactions on Speech and Audio Processing 9(5), 2001, doi:10.1109/89.928915 (the idea, for quiet times).
    """
    n = _segment(record.n_times)
    if n == 0 or record.counted is not None:
        return None
    powers = [_power(signal, n) for signal in record.channels.values()]
    if not all(np.all(power[1:-1] > 0.0) for power in powers):
        return None
    if any(_is_broad_and_steady(_power(drive, n)) for drive in record.drivers.values()):
        return None
    bands = [_band_of(power) for power in powers]
    shares = np.array([band[0] for band in bands if band is not None])
    share = float(np.median(shares)) if len(shares) else 0.0
    if not len(shares) or np.max(np.abs(shares - share)) > _ONE_CORNER * share:
        return None
    sds = [band[1] if band else _quiet_sd(power, share) for band, power in zip(bands, powers, strict=True)]
    return NoiseBand(share=share, sds=np.array(sds)) if all(sds) else None


def _band_of(power: Floats) -> tuple[float, float] | None:
    """Share of half the sampling rate and standard deviation of a channel's noise, if it looks filtered."""
    density, n_bins = np.mean(power, axis=1), len(power) - 1
    level, width = _in_db(density), _width(n_bins)
    flat = [
        (float(_in_db(np.mean(density[first : first + width]))), first + width)
        for first in range(1, n_bins - width)
        if _is_flat(level[first : first + width], power.shape[1]) and _is_steady(power[first : first + width])
    ]
    if not flat:
        return None
    highest = max(height for height, _ in flat)
    end = max(end for height, end in flat if height > highest - _SAME_LEVEL)
    plateau = float(np.mean(density[end - width : end]))
    noise = plateau * (end - width) + float(np.sum(density[end - width :]))
    if highest - _top(density) < _DROP or noise > _MOST_POWER * float(np.sum(density)):
        return None
    return min(noise / (plateau * n_bins), 1.0), float(np.sqrt(0.5 * noise / n_bins))


def _quiet_sd(power: Floats, share: float) -> float:
    """Standard deviation of a channel's noise from its quiet times just below a corner; zero where none falls there."""
    n_bins = len(power) - 1
    width, end = _width(n_bins), round(_BELOW * share * n_bins)
    stretch = power[max(end - width, 1) : end]
    if not len(stretch) or float(_in_db(np.mean(stretch))) - _top(np.mean(power, axis=1)) < _DROP:
        return 0.0
    # The first decile of noise lies so far below its mean.
    quiet = np.quantile(np.log(np.mean(stretch, axis=0)), 0.1) + norm.ppf(0.9) * np.sqrt(_CORRELATION / len(stretch))
    return float(np.sqrt(0.5 * share * np.exp(quiet)))


def _power(signal: Floats, n_segment: int) -> Floats:
    """Power of a signal ``(n_bins, n_segments)``, by frequency and time."""
    return np.asarray(
        spectrogram(signal, nperseg=n_segment, noverlap=n_segment // 2, window="hann", detrend="linear")[2]
    )


def _width(n_bins: int) -> int:
    return max(round(_WIDTH * n_bins), _LEAST_BINS)


def _top(density: Floats) -> float:
    """Level near half the sampling rate, in decibels."""
    return float(np.mean(_in_db(density[-1 - max(len(density) // 20, 3) : -1])))


def _in_db(density: Floats | float) -> Floats:
    return np.asarray(10.0 * np.log10(np.maximum(density, 1e-300)))


def _segment(n_times: int) -> int:
    """Length of the segments: the largest power of two that leaves enough of them; zero where none does."""
    longest = n_times // (_SEGMENTS // 2)
    return min(1 << (longest.bit_length() - 1), _MOST_SEGMENT) if longest >= _LEAST_SEGMENT else 0


def _is_flat(level: Floats, n_segments: int) -> bool:
    """Whether the levels [dB] of successive bins have neither slope nor scatter beyond that of noise."""
    scatter = 10.0 / np.log(10.0) / np.sqrt(0.5 * n_segments)  # segments overlap by half
    place = np.linspace(-0.5, 0.5, len(level))
    slope = float(place @ level / (place @ place))
    error = scatter / float(np.sqrt(place @ place))
    return bool(abs(slope) < _SLOPE + 1.5 * error and np.std(level - slope * place) < 2.0 * scatter)


def _is_steady(power: Floats) -> bool:
    """Whether power ``(n_bins, n_segments)`` summed over the bins scatters from segment to segment as noise does."""
    return _scatters_as_noise(np.sum(power, axis=0), len(power))


def _is_broad_and_steady(power: Floats) -> bool:
    """Whether what drives ``(n_bins, n_segments)`` is spread over many bins and as steady as a flat stretch must be."""
    density = np.mean(power, axis=1)
    if not np.any(density):
        return False
    spread = float(np.sum(density) ** 2 / np.sum(np.square(density)))
    steady = _scatters_as_noise(np.sum(power, axis=0), min(spread, _width(len(power) - 1)))
    return steady and spread >= _LEAST_BINS


def _scatters_as_noise(power: Floats, n_bins: float) -> bool:
    """Whether the power of ``n_bins`` bins ``(n_segments,)`` scatters from segment to segment no more than noise does.

    The logarithm of such a sum scatters by one over the square root of the independent bins.
    """
    first, ninth = np.quantile(power, (0.1, 0.9))
    expected = 2.0 * norm.ppf(0.9) * np.sqrt(_CORRELATION / n_bins)
    return bool(first > 0.0 and np.log(ninth / first) < expected * (1.0 + 2.5 / np.sqrt(len(power))))
