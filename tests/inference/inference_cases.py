"""The one-storey building that the tests of inference share, with records made by the reference engine."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy import integrate

from bwbn_bayes import Record, ShearBuilding, SlipLock, Uniform, simulate
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import Noise, Posterior, default_noise
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.parameters import Floats, Value
from bwbn_bayes.structures.model_file import ModelFile, load_model_file

MODELS = Path(__file__).parents[2] / "models"
SDOF: ModelFile = load_model_file(MODELS / "sdof.py")
ENGINE = Lanes(substeps=1, resolution=0.25)
A_RANGE = (0.7, 1.4)
"""Prior of A where it is free: so narrow that along the redundant direction no other bound binds."""

INSIDE = (np.array([0.3, 0.6, 0.5]), np.array([0.01, 0.05, 0.002]))
AT_BOUND = (np.array([0.5, 0.0, 1.02]), np.array([0.01, 0.05, 0.02]))
"""Centre and standard deviations of Gaussians in the unit cube, one of them centred beyond it."""

_SLIP: Mapping[str, Value] = {"delta_s": Uniform(0.001, 0.03), "sigma": Uniform(0.001, 0.02)}


def sdof_model() -> ShearBuilding:
    """``models/sdof.py``: eight parameters."""
    assert not SDOF.model.is_driven
    return SDOF.model


def with_free_a(model: ShearBuilding) -> ShearBuilding:
    """The same building with A identified."""
    return model.with_values({"A": Uniform(*A_RANGE)})


def with_slip(model: ShearBuilding) -> ShearBuilding:
    """The same building with a slip-lock element."""
    return model.with_effect(SlipLock(**_SLIP))


@cache
def recorded(seed: int, *, slip: bool = False, snr_db: float = 30.0, sigma: float = 0.004) -> Record:
    """25 s of El Centro by the reference engine, without slip or with slip of a width."""
    assert SDOF.excitation is not None
    model = with_slip(sdof_model()) if slip else sdof_model()
    truth = {**SDOF.truth, **({"delta_s": 0.01, "sigma": sigma} if slip else {})}
    return simulate(model, SDOF.excitation, truth, snr_db=snr_db, seed=seed)


def posterior_of(model: ShearBuilding, record: Record, noise: Noise | None = None) -> Posterior:
    """The posterior on the lane engine."""
    return Posterior(model=model, record=record, engine=ENGINE, noise=noise or default_noise(record))


def true_point(model: ShearBuilding, record: Record) -> Floats:
    """The truth of a record as a point of the unit cube; A is 1 there."""
    values = {"A": 1.0, **record.truth}
    return model.space.to_unit(np.array([[values[name] for name in model.space.names]]))[0]


def climbed(posterior: Posterior, start: Floats, n_steps: int = 12) -> Mode:
    """The optimum next to a start by Gauss-Newton steps with the prior's precision as a damping.

    Independent of the package's own search, and exact to rounding: each step divides the distance by about the
    signal-to-noise ratio.
    """
    point = start[None]
    for _ in range(n_steps):
        local = posterior.linearise(point)
        damped = local.information[0] + 12.0 * np.eye(len(start))
        point = np.clip(point + np.linalg.solve(damped, local.gradient[0]), 1e-6, 1.0 - 1e-6)
    local = posterior.linearise(point)
    return Mode(
        point=point[0],
        log_likelihood=float(local.log_likelihood[0]),
        gradient=local.gradient[0],
        information=local.information[0],
    )


MOVED = ("k", "alpha", "beta", "gamma")


def carried(values: Floats, names: tuple[str, ...], scale: float) -> Floats:
    """Parameters ``(n, d)`` carried along the orbit by ``scale``; A, where it is identified, is multiplied by it."""
    column = {name: i for i, name in enumerate(names)}
    result = values.copy()
    k, alpha, n = (values[:, column[name]] for name in ("k", "alpha", "n"))
    result[:, column["k"]] = alpha * k + (1.0 - alpha) * k / scale
    result[:, column["alpha"]] = alpha * k / result[:, column["k"]]
    for name in ("beta", "gamma"):
        result[:, column[name]] = scale ** (1.0 - n) * values[:, column[name]]
    if "A" in column:
        result[:, column["A"]] *= scale
    return result


def jacobian_determinant(values: Floats, names: tuple[str, ...], scale: float) -> Floats:
    """Of the orbit map at A = 1 in the parameters that it moves, by central differences, ``(n,)``."""
    moved = [names.index(name) for name in MOVED]
    matrix = np.empty((len(values), len(moved), len(moved)))
    for j, i in enumerate(moved):
        step = np.zeros(values.shape[1])
        step[i] = 1e-6 * np.mean(np.abs(values[:, i]))
        ahead, behind = (carried(values + side * step, names, scale) for side in (1.0, -1.0))
        matrix[:, :, j] = (ahead - behind)[:, moved] / (2.0 * step[i])
    return np.abs(np.linalg.det(matrix))


def require_posterior_of_a(a: Floats, weights: Floats, size: float, marginal: tuple[Floats, Floats]) -> None:
    """Mean, sd and five cells of weighted draws worth ``size`` within 4 standard errors of an exact density."""
    grid, density = marginal
    mean = integrate.simpson(grid * density, grid)
    sd = np.sqrt(integrate.simpson((grid - mean) ** 2 * density, grid))
    assert abs(weights @ a - mean) < 4.0 * sd / np.sqrt(size)
    cells = np.linspace(*A_RANGE, 6)
    below = integrate.cumulative_simpson(density, x=grid, initial=0.0)
    expected = np.diff(np.interp(cells, grid, below))
    seen = np.array([weights @ ((a >= low) & (a < high)) for low, high in pairwise(cells)])
    assert np.all(np.abs(seen - expected) < 4.0 * np.sqrt(expected * (1.0 - expected) / size))


def gaussian_mode(centre: Floats, sd: Floats) -> Mode:
    """The highest point inside the cube of a Gaussian whose centre may lie outside."""
    point = np.clip(centre, 0.0, 1.0)
    return Mode(
        point=point,
        log_likelihood=float(np.sum(-0.5 * ((point - centre) / sd) ** 2 - np.log(sd * np.sqrt(2.0 * np.pi)))),
        gradient=(centre - point) / sd**2,
        information=np.diag(sd**-2.0),
    )
