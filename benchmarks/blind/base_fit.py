"""How much a record says against the plain model: the base structure's own best fit by the independent simulator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from benchmarks.blind.simulator import STEPS_PER_SAMPLE, Building, Floats, respond

FIT_STEPS = 4
"""Steps per sample in the fit; measured on a base structure, 1e-6 (NRMSE), far below the noise at 40 dB (1e-2)."""


def box(n_storeys: int) -> tuple[Floats, Floats]:
    """Ends of the base numbers as in models/plain_three_storey.py: k and c of every storey, alpha, beta, gamma, n."""
    lower = np.array([5.0] * n_storeys + [0.0] * n_storeys + [0.001, 0.1, -4.0, 1.0])
    upper = np.array([60.0] * n_storeys + [0.5] * n_storeys + [0.3, 8.0, 8.0, 4.0])
    return lower, upper


def with_base_numbers(building: Building, numbers: Floats, kept: Callable[[int, str], bool] | None = None) -> Building:
    """The building with other base numbers; ``kept(storey, name)`` tells which an effect has set, to be left alone."""
    alpha, beta, gamma, n = numbers[-4:].tolist()
    n_storeys, storeys = len(building.storeys), []
    for i, p in enumerate(building.storeys):
        values = {"k": numbers[i], "c": numbers[n_storeys + i], "alpha": alpha, "beta": beta, "gamma": gamma, "n": n}
        free = {name: float(v) for name, v in values.items() if kept is None or not kept(i + 1, name)}
        storeys.append(replace(p, **free))
    return replace(building, storeys=tuple(storeys))


def nats_against(
    building: Building,
    numbers: Floats,
    measured: Floats,
    noise: Floats,
    ground: Floats,
    time_step: float,
    *,
    rng: np.random.Generator,
    n_starts: int = 3,
    kept: Callable[[int, str], bool] | None = None,
) -> float:
    """Log likelihood that the best fit of a building's base numbers leaves behind the truth.

    Least squares with finite differences, from the true numbers and from starts around them, within the box.

    Parameters
    ----------
    building : Building
        Without the effect in question; its other effects stay fixed.
    numbers : (n_numbers,) array
        True base numbers, in the order of the box: the first start.
    measured, noise : (n_storeys, n_times) array
        The record, and the noise that was added to it. [m/s^2]
    ground : (n_times,) array
        Ground acceleration. [m/s^2]
    time_step : float
        Time between samples. [s]
    rng : numpy.random.Generator
        Draws the starts.
    n_starts : int
        Number of starts, the true numbers included.
    kept : callable, optional
        See :func:`with_base_numbers`.

    Returns
    -------
    float
        ``(sum of squares of the fit - of the noise) / (2 sd^2)``, summed over the channels. [nat]
    """
    sd = np.sqrt(np.mean(np.square(noise), axis=1, keepdims=True))
    # What coarse steps get wrong at the true numbers is added back: an effect that stays may be sharp.
    fine, coarse = (respond(building, ground, time_step, steps).measured for steps in (STEPS_PER_SAMPLE, FIT_STEPS))
    target = measured - np.nan_to_num(fine - coarse)
    lower, upper = box(len(building.storeys))

    def residual(unit: NDArray[Any]) -> Floats:
        numbered = with_base_numbers(building, lower + unit * (upper - lower), kept)
        motion = respond(numbered, ground, time_step, FIT_STEPS)
        return np.clip(np.nan_to_num((target - motion.measured) / sd, nan=1e4), -1e4, 1e4).ravel()

    true = np.clip((numbers - lower) / (upper - lower), 0.01, 0.99)
    starts = [true] + [np.clip(true + 0.1 * rng.standard_normal(len(true)), 0.01, 0.99) for _ in range(n_starts - 1)]
    step = np.full(len(true), 1e-5)
    fits = [least_squares(residual, s, bounds=(0, 1), max_nfev=25, ftol=1e-5, diff_step=step) for s in starts]
    return float(min(float(fit.cost) for fit in fits) - 0.5 * np.sum(np.square(noise / sd)))
