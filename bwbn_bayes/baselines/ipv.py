"""Intelligent parameter varying: a radial basis network in the place of each storey's restoring force.

It gives forces, not parameters. The *printed* variant learns the force from the floor's relative acceleration, the
ground's acceleration and the force above (eqs. 24 to 26). By eqs. 21 to 23 the force it is trained on is a sum of these
very inputs: the network is an identity map of measured accelerations, carries their noise, and cannot predict anything
that was not measured. The *drift* variant learns the measured storey force from drift and drift rate, and can stand in
the equation of motion to predict under another excitation; it has no memory, so that it averages hysteresis loops.

References
----------
.. [1] Y. Zhao et al. 2019, doi:10.3389/fbuil.2018.00080, eqs. 11 to 26.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bwbn_bayes.baselines.network import Network, train
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record

Variant = Literal["printed", "drift"]

HIGH_PASS_HZ = 0.05
"""Where drifts are not measured they are integrated from accelerations, without what is slower than this."""
_LARGEST = 1e6


@dataclass(frozen=True, kw_only=True)
class ForceFit:
    """Forces a network per storey learned from one record.

    Attributes
    ----------
    variant : {"printed", "drift"}
    networks : tuple of Network
        From the lowest storey up.
    forces : (n_storeys, n_times) array
        What the networks return on the record: storey forces, viscous force included. [N]
    measured_forces : (n_storeys, n_times) array
        Sums of measured accelerations times masses above each storey. [N]
    """

    variant: Variant
    networks: tuple[Network, ...]
    forces: Floats
    measured_forces: Floats

    @property
    def departure(self) -> Floats:
        """Rms of learned minus measured force over the rms of the measured, ``(n_storeys,)``."""
        difference = np.square(self.forces - self.measured_forces)
        return np.asarray(np.sqrt(np.mean(difference, axis=1) / np.mean(np.square(self.measured_forces), axis=1)))


def fit_forces(
    record: Record,
    masses: Sequence[float] | Floats,
    rng: np.random.Generator,
    *,
    variant: Variant = "printed",
) -> ForceFit:
    """Learn every storey's force from the record alone, storey by storey from the top.

    Parameters
    ----------
    record : Record
        With the acceleration of every floor; the drift variant also reads ``drift_i`` or ``displacement_i`` where all
        storeys have them, and integrates accelerations where not.
    masses : (n_storeys,) array
        Floor masses, lowest first. [kg]
    rng : numpy.random.Generator
        Starts the k-means.
    variant : {"printed", "drift"}
        Inputs of the networks.

    Returns
    -------
    ForceFit

    Raises
    ------
    UserError
        If a floor has no acceleration channel.
    """
    mass = np.asarray(masses, dtype=np.float64)
    measured = record.storey_forces(mass)
    if variant == "drift":
        drift, rate = kinematics(record, len(mass))
        pairs = [np.column_stack(pair) for pair in zip(drift, rate, strict=True)]
        networks = [train(inputs, force, rng) for inputs, force in zip(pairs, measured, strict=True)]
        forces = np.stack([network(inputs) for network, inputs in zip(networks, pairs, strict=True)])
        return ForceFit(variant=variant, networks=tuple(networks), forces=forces, measured_forces=measured)
    ground, networks = record.excitation, []
    learned: list[Floats] = []
    for floor in range(len(mass), 0, -1):
        total = record.channels[f"acceleration_{floor}"]
        above = learned[-1:]
        inputs = np.column_stack([total - ground, ground, *above])
        # Eqs. 21 to 23: the force of a storey is the force above less the inertia of the floor between.
        target = sum(above, start=np.zeros_like(total)) - mass[floor - 1] * total
        networks.append(train(inputs, target, rng))
        learned.append(networks[-1](inputs))
    return ForceFit(
        variant=variant, networks=tuple(networks[::-1]), forces=np.stack(learned[::-1]), measured_forces=measured
    )


def force_noise_sd(noise_sd: Mapping[str, float], masses: Sequence[float] | Floats) -> Floats:
    """Noise of storey forces that are sums of measured accelerations, ``sqrt(sum_{j>=i} m_j^2 sd_j^2)``.

    Parameters
    ----------
    noise_sd : mapping of str to float
        Noise standard deviation of each ``acceleration_i``, independent between floors. [m/s^2]
    masses : (n_storeys,) array
        Floor masses, lowest first. [kg]

    Returns
    -------
    (n_storeys,) array
        [N]
    """
    sd = np.array([noise_sd[f"acceleration_{floor}"] for floor in range(1, len(masses) + 1)])
    return np.asarray(np.sqrt(np.cumsum(np.square(np.asarray(masses) * sd)[::-1])[::-1]))


def kinematics(record: Record, n_storeys: int, high_pass_hz: float = HIGH_PASS_HZ) -> tuple[Floats, Floats]:
    """Drifts [m] and drift rates [m/s] of a record, each ``(n_storeys, n_times)``.

    Drifts are the measured ones where every storey has them. Rates, and drifts where they are not measured, are
    integrals of the differences of neighbouring accelerations, high-passed without phase shift: what is slower than
    ``high_pass_hz`` (a residual drift above all) is lost.
    """
    storeys = range(1, n_storeys + 1)
    totals = [record.excitation, *(record.channels[f"acceleration_{floor}"] for floor in storeys)]
    relative = np.diff(np.stack(totals), axis=0)
    rate = _integrated(relative, record.time_step, high_pass_hz, order=1)
    if all(f"drift_{i}" in record.channels for i in storeys):
        return np.stack([record.channels[f"drift_{i}"] for i in storeys]), rate
    if all(f"displacement_{i}" in record.channels for i in storeys):
        floors = np.stack([np.zeros(record.n_times), *(record.channels[f"displacement_{i}"] for i in storeys)])
        return np.diff(floors, axis=0), rate
    return _integrated(relative, record.time_step, high_pass_hz, order=2), rate


def _integrated(signals: Floats, time_step: float, high_pass_hz: float, order: int) -> Floats:
    """Integrals of ``(n, n_times)`` signals, high-passed by ``r^4 / (1 + r^4)``, r the frequency over the corner."""
    n = signals.shape[1]
    spectrum = np.fft.rfft(signals, 2 * n, axis=1)
    frequency = np.fft.rfftfreq(2 * n, time_step)
    ratio = (frequency / high_pass_hz) ** 4
    gain = np.zeros(len(frequency), dtype=np.complex128)
    gain[1:] = (ratio[1:] / (1.0 + ratio[1:])) / (2j * np.pi * frequency[1:]) ** order
    return np.asarray(np.fft.irfft(spectrum * gain, 2 * n, axis=1)[:, :n])


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """Response ``(n_storeys, n_times)`` that networks predict: total accelerations, drifts and storey forces."""

    acceleration: Floats
    drift: Floats
    force: Floats


def predict(fit: ForceFit, masses: Sequence[float] | Floats, excitation: Record) -> Prediction:
    """Put the drift variant's networks into the equation of motion of a building under another excitation.

    ``m_i (x_i'' + a_g) = -F_i + F_{i+1}``, F from drift and drift rate; at rest in the beginning; Runge-Kutta of order
    4, one step a sample, the ground acceleration linear between samples.

    Parameters
    ----------
    fit : ForceFit
        Of the drift variant.
    masses : (n_storeys,) array
        Floor masses, lowest first. [kg]
    excitation : Record
        Ground motion; its channels are ignored.

    Returns
    -------
    Prediction
        NaN from where the solution left all bounds.

    Raises
    ------
    UserError
        If the fit is of the printed variant: its inputs are the accelerations that would have to be predicted.
    """
    if fit.variant != "drift":
        raise UserError(
            "IPV with the printed inputs cannot predict under another excitation: its inputs are the accelerations "
            "that would have to be predicted; use variant 'drift'"
        )
    n, mass = len(fit.networks), np.asarray(masses, dtype=np.float64)

    def force_of(state: Floats) -> Floats:
        pairs = state.reshape(2, n).T
        return np.array([network(pairs[i : i + 1])[0] for i, network in enumerate(fit.networks)])

    def slope(state: Floats, ground: float) -> Floats:
        force = force_of(state)
        total = (np.append(force[1:], 0.0) - force) / mass
        return np.concatenate([state[n:], np.diff(total, prepend=ground)])

    ground, step = excitation.excitation, excitation.time_step
    states = np.full((excitation.n_times, 2 * n), np.nan)
    state = states[0] = np.zeros(2 * n)
    for i in range(1, excitation.n_times):
        middle = 0.5 * (ground[i - 1] + ground[i])
        k1 = slope(state, ground[i - 1])
        k2 = slope(state + 0.5 * step * k1, middle)
        k3 = slope(state + 0.5 * step * k2, middle)
        state = state + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + slope(state + step * k3, ground[i]))
        if not np.max(np.abs(state)) < _LARGEST:
            break
        states[i] = state
    drift, rate = states[:, :n].T, states[:, n:].T
    force = np.stack([network(np.column_stack(pair)) for network, *pair in zip(fit.networks, drift, rate, strict=True)])
    total = np.diff(force, axis=0, append=np.zeros((1, len(ground)))) / mass[:, None]
    return Prediction(acceleration=total, drift=drift, force=force)
