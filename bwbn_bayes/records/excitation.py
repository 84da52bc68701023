"""Excitations: El Centro 1940, sines, sweeps and noise. Each is a :class:`Record` without channels.

Each moves the ground; :func:`as_force` makes it push at a floor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from bwbn_bayes.errors import UserError, whole_number
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.readers import read_record
from bwbn_bayes.records.record import Record

ElCentroVersion = Literal["rsn6_180", "chopra"]

_FOLDER = Path(__file__).with_name("ground_motions")
_FILES = {"rsn6_180": "el_centro_rsn6_180.at2", "chopra": "el_centro_chopra.csv"}

HIGH_PASS_RATIO = 0.1
"""Clough and Penzien's high-pass frequency over the ground frequency; its damping is the ground damping."""


def el_centro(
    version: ElCentroVersion = "rsn6_180",
    scale: float = 1.0,
    duration: float | None = None,
    time_step: float | None = None,
) -> Record:
    """The El Centro record of 18 May 1940, from files that come with the package (``NOTICE``).

    Parameters
    ----------
    version : {"rsn6_180", "chopra"}
        PEER NGA RSN 6, component 180 (53.71 s at 0.01 s, peak 0.281 g), or the version printed in Chopra's textbook
        (31.18 s at 0.02 s, peak 0.319 g at 2.04 s).
    scale : float
        Factor on the accelerations.
    duration : float, optional
        Keep the first part only. [s]
    time_step : float, optional
        The native time step or an integer fraction of it, by linear interpolation: the engines hold the ground
        acceleration linear between samples, so the motion stays the same. [s]

    Returns
    -------
    Record
        Ground acceleration in m/s^2 (one g is 9.80665 m/s^2), no channels.

    Raises
    ------
    UserError
        If the version is unknown, ``duration`` exceeds the record, or ``time_step`` is not an integer fraction of the
        native one (a coarser one would alias).

    References
    ----------
    .. [1] PEER NGA ground motion database, RSN 6, Imperial Valley-02, El Centro Array #9.
    .. [2] A. K. Chopra, "Dynamics of Structures", appendix 6.
    """
    if version not in _FILES:
        raise UserError(f"El Centro version {version!r} is not known: use {' or '.join(_FILES)}")
    if not (np.isfinite(scale) and scale != 0.0):
        raise UserError(f"scale is {scale}: it must be a finite number other than zero")
    native = read_record(_FOLDER / _FILES[version])
    fine = _interpolated(native, native.time_step if time_step is None else time_step)
    record = Record(
        name=f"El Centro 1940 ({version})",
        time_step=fine.time_step,
        excitation=scale * fine.excitation,
        provenance={**native.provenance, "file": _FILES[version], "scale": f"{scale:g}"},
    )
    return record if duration is None else record.until(duration)


def sine(amplitude: float, frequency_hz: float, duration: float, time_step: float) -> Record:
    """Sampled sine ground acceleration ``amplitude sin(2 pi frequency_hz t)``.

    Parameters
    ----------
    amplitude : float
        Peak acceleration. [m/s^2]
    frequency_hz : float
        Frequency, below half the sampling rate. [Hz]
    duration : float
        Time of the last sample. [s]
    time_step : float
        Time between samples. [s]

    Raises
    ------
    UserError
        If a number is not positive, the sampling is too coarse, or there are fewer than 8 points.
    """
    times = _times(duration, time_step)
    _require_positive("amplitude", amplitude, "m/s^2")
    if not 0.0 < frequency_hz < 0.5 / time_step:
        raise UserError(
            f"frequency_hz is {frequency_hz:g}: it must lie between 0 and half the sampling rate, {0.5 / time_step:g} "
            "Hz"
        )
    return Record(
        name=f"sine {frequency_hz:g} Hz",
        time_step=time_step,
        excitation=amplitude * np.sin(2.0 * np.pi * frequency_hz * times),
        provenance={"excitation": f"sine, amplitude {amplitude:g} m/s^2, frequency {frequency_hz:g} Hz"},
    )


def multisine(
    rng: np.random.Generator,
    band_hz: tuple[float, float],
    n_per_period: int,
    time_step: float,
    *,
    rms: float,
    n_periods: int = 1,
) -> Record:
    """Sines of equal amplitude and random phase at every whole number of cycles per period within a band.

    Parameters
    ----------
    rng : numpy.random.Generator
        For the phases.
    band_hz : (float, float)
        Lowest and highest frequency, below half the sampling rate. [Hz]
    n_per_period : int
        Samples of a period.
    time_step : float
        Time between samples. [s]
    rms : float
        Of the whole. [m/s^2]
    n_periods : int
        How often the period is run through.

    Raises
    ------
    UserError
        If a number is not positive, the band reaches half the sampling rate, or no line lies in it.

    References
    ----------
    .. [1] R. Pintelon and J. Schoukens, "System Identification: A Frequency Domain Approach", 2012, section 2.3.
    """
    _require_positive("time_step", time_step, "s")
    _require_positive("rms", rms, "m/s^2")
    n_per_period, n_periods = whole_number("n_per_period", n_per_period, 1), whole_number("n_periods", n_periods, 1)
    _require_below_half(band_hz, time_step)
    low, high = band_hz
    lines = np.arange(1, (n_per_period + 1) // 2)
    frequency = lines / (n_per_period * time_step)
    lines = lines[(frequency >= low) & (frequency <= high)]
    if not lines.size:
        raise UserError(
            f"multisine: no line of a period of {n_per_period} samples lies between {low:g} and {high:g} Hz: give a "
            "longer period or a wider band"
        )
    spectrum = np.zeros(n_per_period // 2 + 1, dtype=np.complex128)
    spectrum[lines] = np.exp(2j * np.pi * rng.random(lines.size))
    period = np.fft.irfft(spectrum, n_per_period)
    period *= rms / float(np.sqrt(np.mean(np.square(period))))
    return Record(
        name="multisine",
        time_step=time_step,
        excitation=np.tile(period, n_periods),
        provenance={"excitation": f"random-phase multisine, {low:g} to {high:g} Hz, {n_periods} periods"},
    )


def sweep(amplitude: float, band_hz: tuple[float, float], duration: float, time_step: float) -> Record:
    """A sine whose frequency goes evenly in time from one end of a band to the other.

    Parameters
    ----------
    amplitude : float
        Peak acceleration. [m/s^2]
    band_hz : (float, float)
        First and last frequency, below half the sampling rate. [Hz]
    duration, time_step : float
        Time of the last sample and time between samples. [s]

    Raises
    ------
    UserError
        If a number is not positive, or the sampling is too coarse.
    """
    times = _times(duration, time_step)
    _require_positive("amplitude", amplitude, "m/s^2")
    first, last = band_hz
    _require_below_half(band_hz, time_step)
    turns = first * times + 0.5 * (last - first) / times[-1] * np.square(times)
    return Record(
        name=f"sweep {first:g} to {last:g} Hz",
        time_step=time_step,
        excitation=amplitude * np.sin(2.0 * np.pi * turns),
        provenance={"excitation": f"sweep, amplitude {amplitude:g}, from {first:g} to {last:g} Hz"},
    )


def as_force(record: Record, floor: int = 1) -> Record:
    """What a record's ground does in m/s^2 as a force of so many newtons on a floor; the ground stays still.

    Parameters
    ----------
    record : Record
        Without channels.
    floor : int
        The floor (from 1) that is pushed.

    Raises
    ------
    UserError
        If the record is that of a cyclic test or has channels, which were measured under another input.
    """
    if record.excitation_kind != "ground_acceleration" or record.channels:
        raise UserError(f"record {record.name!r} is not a bare ground motion: only such a one can become a force")
    return replace(
        record,
        excitation=np.zeros(record.n_times),
        forces={**record.forces, f"applied_force_{floor}": record.excitation},
    )


@dataclass(frozen=True, kw_only=True)
class Envelope:
    """Amplitude over the course of a motion: quadratic rise, constant strong phase, exponential decay.

    Parameters
    ----------
    rise_until : float
        End of the rise as a fraction of the duration.
    strong_until : float
        End of the strong phase as a fraction of the duration.
    end_level : float
        Amplitude at the end, the strong phase being 1.

    References
    ----------
    .. [1] P. C. Jennings, G. W. Housner, N. C. Tsai, "Simulated Earthquake Motions", Caltech EERL, 1968 (the form;
       the default fractions are ours).
    """

    rise_until: float = 0.1
    strong_until: float = 0.5
    end_level: float = 0.05

    def __post_init__(self) -> None:
        if not (0.0 <= self.rise_until <= self.strong_until <= 1.0 and 0.0 < self.end_level <= 1.0):
            raise UserError(f"{self}: it needs 0 <= rise_until <= strong_until <= 1 and 0 < end_level <= 1")

    def amplitude(self, fraction: Floats) -> Floats:
        """Amplitude ``(n_times,)`` at fractions ``(n_times,)`` of the duration."""
        rise = np.square(fraction / self.rise_until) if self.rise_until > 0.0 else np.ones_like(fraction)
        tail = (1.0 - self.strong_until) or 1.0
        decay = self.end_level ** (np.maximum(fraction - self.strong_until, 0.0) / tail)
        return np.where(fraction < self.rise_until, rise, decay)


def ground_motion_density(
    frequency_hz: Floats, ground_frequency_hz: float = 2.5, ground_damping: float = 0.6, *, high_pass: bool = True
) -> Floats:
    """Power spectral density of Kanai-Tajimi ground acceleration relative to that of the bedrock's white noise.

    ``S/S_0 = (w_g^4 + (2 zeta_g w_g w)^2) / ((w_g^2 - w^2)^2 + (2 zeta_g w_g w)^2)``; with Clough and Penzien's
    high pass times ``w^4 / ((w_f^2 - w^2)^2 + (2 zeta_f w_f w)^2)``, ``w_f = 0.1 w_g``, ``zeta_f = zeta_g``. Without
    the high pass the displacement of the ground has infinite variance.

    Parameters
    ----------
    frequency_hz : (n_frequencies,) array
        Frequencies. [Hz]
    ground_frequency_hz : float
        Frequency of the soil layer. [Hz]
    ground_damping : float
        Damping ratio of the soil layer.
    high_pass : bool
        Whether to include the high pass.

    Returns
    -------
    (n_frequencies,) array
        Dimensionless ratio of densities.

    References
    ----------
    .. [1] H. Tajimi, "A statistical method of determining the maximum response of a building structure during an
       earthquake", 2nd WCEE, 1960.
    .. [2] R. W. Clough, J. Penzien, "Dynamics of Structures", 1975 (the high pass; the ratio 0.1 with equal damping
       is a common choice that was not checked against a printed source).
    """
    ratio = np.square(np.asarray(frequency_hz, dtype=np.float64) / ground_frequency_hz)
    damped = 4.0 * ground_damping**2 * ratio
    density = (1.0 + damped) / (np.square(1.0 - ratio) + damped)
    if not high_pass:
        return density
    low = HIGH_PASS_RATIO**2
    return density * np.square(ratio) / (np.square(low - ratio) + 4.0 * ground_damping**2 * low * ratio)


def filtered_noise(
    rng: np.random.Generator,
    duration: float,
    time_step: float,
    *,
    rms: float | None = None,
    peak: float | None = None,
    ground_frequency_hz: float = 2.5,
    ground_damping: float = 0.6,
    envelope: Envelope | None = None,
) -> Record:
    """Gaussian ground motion with the Kanai-Tajimi, Clough-Penzien spectrum, by spectral representation.

    Independent complex Gaussian amplitudes on a frequency grid of twice the duration; the first half is kept, so the
    motion is not periodic. Density above half the sampling rate is left out, not folded back.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of randomness.
    duration, time_step : float
        Time of the last sample and time between samples. [s]
    rms : float, optional
        Standard deviation of the stationary process (before the envelope). [m/s^2]
    peak : float, optional
        Largest absolute acceleration of this sample. Give either this or ``rms``. [m/s^2]
    ground_frequency_hz, ground_damping : float
        Frequency [Hz] and damping ratio of the soil layer; the defaults stand for firm ground.
    envelope : Envelope, optional
        Amplitude over time; stationary where left out.

    Raises
    ------
    UserError
        If not exactly one of ``rms`` and ``peak`` is given, or a number is out of range.

    References
    ----------
    .. [1] M. Shinozuka, G. Deodatis, "Simulation of Stochastic Processes by Spectral Representation", Applied
       Mechanics Reviews 44(4), 1991, doi:10.1115/1.3119501.
    """
    if (rms is None) == (peak is None):
        raise UserError("filtered_noise needs either rms or peak: give exactly one of them")
    if rms is not None:
        _require_positive("rms", rms, "m/s^2")
    if peak is not None:
        _require_positive("peak", peak, "m/s^2")
    _require_positive("ground_frequency_hz", ground_frequency_hz, "Hz")
    _require_positive("ground_damping", ground_damping, "of critical")
    times = _times(duration, time_step)
    n_grid = 2 * len(times)
    frequency = np.fft.rfftfreq(n_grid, time_step)[1:-1]
    density = ground_motion_density(frequency, ground_frequency_hz, ground_damping)
    amplitude = np.sqrt(density / np.sum(density))
    spectrum = np.zeros(n_grid // 2 + 1, dtype=np.complex128)
    normals = rng.standard_normal((2, len(frequency)))
    spectrum[1:-1] = amplitude * (normals[0] + 1j * normals[1]) * (0.5 * n_grid)
    motion = np.fft.irfft(spectrum, n_grid)[: len(times)]
    if envelope is not None:
        motion = motion * envelope.amplitude(times / times[-1])
    if rms is not None:
        motion = motion * rms
    if peak is not None:
        motion = motion * (peak / float(np.max(np.abs(motion))))
    soil = f"ground frequency {ground_frequency_hz:g} Hz, damping {ground_damping:g}"
    return Record(
        name="filtered noise",
        time_step=time_step,
        excitation=motion,
        provenance={"excitation": f"Kanai-Tajimi filtered noise with Clough-Penzien high pass, {soil}"},
    )


def _interpolated(record: Record, time_step: float) -> Record:
    parts = round(record.time_step / time_step) if time_step > 0.0 else 0
    if parts < 1 or abs(parts * time_step - record.time_step) > 1e-9 * record.time_step:
        raise UserError(
            f"time_step is {time_step:g} s: it must be {record.time_step:g} s, the record's own, or an integer "
            "fraction of it"
        )
    if parts == 1:
        return record
    index = np.arange((record.n_times - 1) * parts + 1) / parts
    values = np.interp(index, np.arange(record.n_times), record.excitation)
    return Record(name=record.name, time_step=time_step, excitation=values, provenance=record.provenance)


def _times(duration: float, time_step: float) -> Floats:
    _require_positive("duration", duration, "s")
    _require_positive("time_step", time_step, "s")
    return time_step * np.arange(int(duration / time_step + 1e-6) + 1, dtype=np.float64)


def _require_below_half(band_hz: tuple[float, float], time_step: float) -> None:
    if not 0.0 < min(band_hz) <= max(band_hz) < 0.5 / time_step:
        raise UserError(
            f"band_hz is {band_hz}: both ends must lie between 0 and half the sampling rate, {0.5 / time_step:g} Hz"
        )


def _require_positive(name: str, value: float, unit: str) -> None:
    if not (np.isfinite(value) and value > 0.0):
        raise UserError(f"{name} is {value} {unit}: it must be a positive number")
