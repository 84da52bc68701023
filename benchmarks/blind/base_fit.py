"""How much a record says against the plain model: the base structure's own best fit by the independent simulator."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from benchmarks.blind.simulator import STEPS_PER_SAMPLE, Building, Floats, respond
from benchmarks.blind.storey import Storey

FIT_STEPS = 4
"""Steps per sample in the fit; measured on a base structure, 1e-6 (NRMSE), far below the noise at 40 dB (1e-2)."""


@dataclass(frozen=True, kw_only=True)
class Plain:
    """A plain structure: what discovery is given as a model, and what is drawn before something is hidden in it.

    Its base numbers are k and c of every storey, then those that the storeys share.

    Attributes
    ----------
    model : str
        Its model file, of models/.
    storey : Storey
        A storey in which those numbers are still to be set.
    shared : mapping of str to (float, float)
        Lower and upper end of each shared number, as in the model file.
    """

    model: str
    storey: Storey
    shared: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def is_linear(self) -> bool:
        """Whether no storey of it yields."""
        return not self.shared

    def box(self, n_storeys: int) -> tuple[Floats, Floats]:
        """Ends of the base numbers, as in the model file."""
        own = [(5.0, 60.0)] * n_storeys + [(0.0, 0.5)] * n_storeys + list(self.shared.values())
        lower, upper = np.array(own).T
        return lower, upper

    def labelled(self, numbers: Floats) -> dict[str, float]:
        """Base numbers by label."""
        storeys = range(1, (len(numbers) - len(self.shared)) // 2 + 1)
        labels = [f"{name}[{i}]" for name in ("k", "c") for i in storeys] + list(self.shared)
        return dict(zip(labels, numbers.tolist(), strict=True))

    def with_numbers(
        self, building: Building, numbers: Floats, kept: Callable[[int, str], bool] | None = None
    ) -> Building:
        """The building with other base numbers; ``kept(storey, name)`` tells which an effect has set, to be left."""
        n_storeys, storeys = len(building.storeys), []
        shared = dict(zip(self.shared, numbers[2 * n_storeys :].tolist(), strict=True))
        for i, p in enumerate(building.storeys):
            values = {"k": numbers[i], "c": numbers[n_storeys + i], **shared}
            free = {name: float(v) for name, v in values.items() if kept is None or not kept(i + 1, name)}
            storeys.append(replace(p, **free))
        return replace(building, storeys=tuple(storeys))

    def building(self, numbers: Floats) -> Building:
        """The plain structure itself."""
        n_storeys = (len(numbers) - len(self.shared)) // 2
        return self.with_numbers(Building(storeys=(self.storey,) * n_storeys), numbers)


BOUC_WEN = Plain(
    model="plain_three_storey",
    storey=Storey(k=1.0, c=0.0, alpha=0.1, beta=1.0, gamma=0.0, n=1.0),
    shared={"alpha": (0.001, 0.3), "beta": (0.1, 8.0), "gamma": (-4.0, 8.0), "n": (1.0, 4.0)},
)
LINEAR = Plain(model="linear_three_storey", storey=Storey(k=1.0, c=0.0, alpha=1.0, beta=0.0, gamma=0.0, n=1.0))


def nats_against(
    plain: Plain,
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
    plain : Plain
        What is fitted.
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
        See :meth:`Plain.with_numbers`.

    Returns
    -------
    float
        ``(sum of squares of the fit - of the noise) / (2 sd^2)``, summed over the channels. [nat]
    """
    sd = np.sqrt(np.mean(np.square(noise), axis=1, keepdims=True))
    # What coarse steps get wrong at the true numbers is added back: an effect that stays may be sharp.
    fine, coarse = (respond(building, ground, time_step, steps).measured for steps in (STEPS_PER_SAMPLE, FIT_STEPS))
    target = measured - np.nan_to_num(fine - coarse)
    lower, upper = plain.box(len(building.storeys))

    def residual(unit: NDArray[Any]) -> Floats:
        numbered = plain.with_numbers(building, lower + unit * (upper - lower), kept)
        motion = respond(numbered, ground, time_step, FIT_STEPS)
        return np.clip(np.nan_to_num((target - motion.measured) / sd, nan=1e4), -1e4, 1e4).ravel()

    true = np.clip((numbers - lower) / (upper - lower), 0.01, 0.99)
    starts = [true] + [np.clip(true + 0.1 * rng.standard_normal(len(true)), 0.01, 0.99) for _ in range(n_starts - 1)]
    step = np.full(len(true), 1e-5)
    fits = [least_squares(residual, s, bounds=(0, 1), max_nfev=25, ftol=1e-5, diff_step=step) for s in starts]
    return float(min(float(fit.cost) for fit in fits) - 0.5 * np.sum(np.square(noise / sd)))
