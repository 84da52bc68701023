"""What an engineer asks next: peaks, losses, energies and periods from response histories, draw by draw.

Every function is pure and works on any leading dimensions; draws stay separate, so that bands come from percentiles.
Parameters that a model does not have (no ``delta_eta``) count as zero: nothing is lost.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import sympy as sp
import xarray as xr
from numpy.typing import NDArray

from bwbn_bayes.elements.law import TIME, StoreyLaw

Floats = NDArray[np.float64]

RESIDUAL_SHARE = 0.05
"""Share of the record, at its end, over which the residual drift is averaged."""
N_TIME_POINTS = 48
"""Number of times at which the period is reported."""


def parameters_at(law: StoreyLaw, parameters: xr.Dataset, time: xr.DataArray | float) -> xr.Dataset:
    """Storey parameters at a time: each as given, and what effects have made of it by then.

    Parameters
    ----------
    law : StoreyLaw
        Whose parameters they are; it says which of them change in time or differ at a storey.
    parameters : Dataset (draw, storey)
        Storey parameters by symbol.
    time : float or DataArray
        Time. [s]

    Returns
    -------
    Dataset
        The same variables and what the law derives from them, those that change with the dimensions of ``time`` added.
    """
    given = {one.name: parameters[one.name] for one in law.symbols}
    at = xr.broadcast(xr.DataArray(time), *given.values())
    changes = {}
    for name, change in law.changes.items():
        evaluate = sp.lambdify((TIME, *law.symbols), change, "numpy", dummify=True)
        changes[name] = xr.zeros_like(at[1]) + evaluate(*(array.values for array in at))
    own = {name: given[name] + change for name, change in changes.items() if name in given}
    derived = {name: value + changes.get(name, 0.0) for name, value in law.derived_from({**given, **own}).items()}
    changed = {**own, **derived}
    return parameters.assign({name: values.drop_vars("time", errors="ignore") for name, values in changed.items()})


def ultimate_hysteretic_displacement(parameters: xr.Dataset) -> xr.DataArray:
    """Bound ``z_u = (A / (beta + gamma))^(1/n)`` of the hysteretic displacement before degradation, in m.

    Parameters
    ----------
    parameters : Dataset (draw, storey)
        Holds ``beta``, ``gamma`` [1/m^n], ``n`` and, where it is not 1, ``A``.

    Returns
    -------
    DataArray (draw, storey)
        Infinite where ``beta + gamma`` is zero (the linear storey).
    """
    with np.errstate(divide="ignore"):
        bound: xr.DataArray = (_initial_rate(parameters) / (parameters["beta"] + parameters["gamma"])) ** (
            1.0 / parameters["n"]
        )
    return bound


def yield_drift(parameters: xr.Dataset) -> xr.DataArray:
    """Drift ``u_y = z_u / A`` at which the initial slope meets the bound of z, in m; ``u_y = z_u`` for A = 1.

    Parameters
    ----------
    parameters : Dataset (draw, storey)
        As for :func:`ultimate_hysteretic_displacement`.

    Returns
    -------
    DataArray (draw, storey)
    """
    return ultimate_hysteretic_displacement(parameters) / _initial_rate(parameters)


def tangent_stiffness(parameters: xr.Dataset, energy: xr.DataArray) -> xr.DataArray:
    """Initial tangent ``alpha k + (1 - alpha) k A / eta`` of each storey, degraded as it is at a time, in N/m.

    It is the slope at z = 0 without slip or pinching: what a small vibration around rest sees.

    Parameters
    ----------
    parameters : Dataset (draw, storey, ...)
        ``k`` [N/m], ``alpha``, and ``A``, those of ``eta`` where present, at the times of ``energy``.
    energy : DataArray (draw, storey, ...)
        Work on the hysteretic spring. [J]

    Returns
    -------
    DataArray (draw, storey, ...)
    """
    k, alpha = parameters["k"], parameters["alpha"]
    return alpha * k + (1.0 - alpha) * k * _initial_rate(parameters) / _degradation_factor("eta", parameters, energy)


def storey_matrix(coefficients: Floats) -> Floats:
    """Matrix of a shear building from its storeys' coefficients: stiffness from k, damping from c.

    Parameters
    ----------
    coefficients : (..., n_storeys) array
        One coefficient for each storey, from the ground up. [N/m] or [N s/m]

    Returns
    -------
    (..., n_storeys, n_storeys) array
        Tridiagonal and symmetric, in the unit of the coefficients.
    """
    n_storeys = coefficients.shape[-1]
    difference = np.eye(n_storeys) - np.eye(n_storeys, k=-1)
    return np.asarray(np.einsum("si,...s,sj->...ij", difference, coefficients, difference))


def modes(stiffness: Floats, damping: Floats, masses: Floats) -> tuple[Floats, Floats]:
    """Undamped periods and modal damping ratios of shear buildings, longest period first.

    Parameters
    ----------
    stiffness : (..., n_storeys) array
        Storey stiffnesses. [N/m]
    damping : (..., n_storeys) array
        Storey damping coefficients. [N s/m]
    masses : (..., n_storeys) array
        Floor masses. [kg]

    Returns
    -------
    periods : (..., n_storeys) array
        ``2 pi / omega_j`` of ``K phi = omega^2 M phi``. [s]
    damping_ratios : (..., n_storeys) array
        ``phi_j^T C phi_j / (2 omega_j)`` with ``phi_j^T M phi_j = 1``; the coupling of modes by C is left out.

    References
    ----------
    .. [1] A. K. Chopra, "Dynamics of Structures", 4th ed., 2012, sections 10.2 and 10.10.
    """
    root = np.sqrt(masses)
    squares, vectors = np.linalg.eigh(storey_matrix(stiffness) / (root[..., :, None] * root[..., None, :]))
    omega = np.sqrt(squares)
    shapes = vectors / root[..., :, None]
    modal_damping = np.einsum("...im,...ij,...jm->...m", shapes, storey_matrix(damping), shapes)
    return 2.0 * np.pi / omega, modal_damping / (2.0 * omega)


def engineering_quantities(
    response: xr.Dataset,
    storey_parameters: xr.Dataset,
    masses: Sequence[float] | Floats,
    law: StoreyLaw,
    heights: Sequence[float] | None = None,
) -> xr.Dataset:
    """What an engineer asks next, for every draw.

    Parameters
    ----------
    response : Dataset
        ``drift`` [m], ``hysteretic_displacement`` [m], ``hysteretic_energy`` [J], each (draw, storey, time), with the
        coordinate ``time`` [s].
    storey_parameters : Dataset (draw, storey)
        Every parameter of the storey law by symbol; effects that are absent cost nothing.
    masses : (n_storeys,) array
        Floor masses. [kg] An identified error of a mass, and damping in proportion to the masses, are taken from
        ``storey_parameters``; periods are those on a rigid base and without appendages.
    law : StoreyLaw
        Whose parameters they are.
    heights : (n_storeys,) array, optional
        Storey heights. [m]

    Returns
    -------
    Dataset
        ``peak_drift``, ``residual_drift`` (signed mean of the last 5 % of the record) [m], ``ductility`` (peak over
        :func:`yield_drift` at the start), ``stiffness_lost`` (``1 - 1/eta`` at the end), ``strength_lost``
        (``1 - z_u(nu)/z_u(1) = 1 - nu^(-1/n)`` at the end), ``dissipated_energy`` [J], and with heights
        ``peak_drift_ratio`` (peak over storey height), each (draw, storey);
        ``modal_period`` [s] and ``modal_damping_ratio`` at the start, each (draw, mode);
        ``period`` [s], the first period against time, (draw, time_point) with the coordinate ``time``.
    """
    order = ("draw", "storey", "time")
    drift, energy = response["drift"].transpose(*order), response["hysteretic_energy"].transpose(*order)
    peak = abs(drift).max("time")
    energy_at_end = energy.isel(time=-1, drop=True)
    n_tail = max(1, round(RESIDUAL_SHARE * drift.sizes["time"]))
    at_start = parameters_at(law, storey_parameters, 0.0)
    at_end = parameters_at(law, storey_parameters, float(response["time"][-1]))
    nu = _degradation_factor("nu", at_end, energy_at_end)
    storey_quantities = {
        "peak_drift": peak,
        "residual_drift": drift.isel(time=slice(-n_tail, None)).mean("time"),
        "ductility": peak / yield_drift(at_start),
        "stiffness_lost": 1.0 - 1.0 / _degradation_factor("eta", at_end, energy_at_end),
        "strength_lost": 1.0 - nu ** (-1.0 / at_end["n"]),
        "dissipated_energy": dissipated_energy(response.isel(time=-1), at_end),
    }
    if heights is not None:
        storey_quantities["peak_drift_ratio"] = peak / xr.DataArray(
            np.asarray(heights, dtype=np.float64), dims="storey"
        )
    dataset = xr.Dataset(
        {name: values.drop_vars("time", errors="ignore") for name, values in storey_quantities.items()}
    )
    return dataset.merge(_modal_quantities(energy, storey_parameters, np.asarray(masses, dtype=np.float64), law))


def dissipated_energy(at_end: xr.Dataset, parameters: xr.Dataset) -> xr.DataArray:
    """Hysteretic energy dissipated up to an instant, in J.

    The work on the hysteretic spring less what unloading to z = 0 would return, ``(1 - alpha) k eta z^2 / (2 A)``:
    exact where beta = gamma and nothing slips, and close elsewhere, since the second term is small at rest.

    Parameters
    ----------
    at_end : Dataset (draw, storey)
        ``hysteretic_energy`` [J] and ``hysteretic_displacement`` [m].
    parameters : Dataset (draw, storey)
        Storey parameters by symbol, at that instant.

    Returns
    -------
    DataArray (draw, storey)
    """
    energy, z, alpha = at_end["hysteretic_energy"], at_end["hysteretic_displacement"], parameters["alpha"]
    eta = _degradation_factor("eta", parameters, energy)
    return energy - (1.0 - alpha) * parameters["k"] * eta * z**2 / (2.0 * _initial_rate(parameters))


def _degradation_factor(factor: str, parameters: xr.Dataset, energy: xr.DataArray) -> xr.DataArray:
    """``eta`` or ``nu``, ``1 + delta epsilon`` and what saturates; a jump of ``delta`` acts on the past work too."""
    saturated = -np.expm1(-_or_zero(parameters, f"p_{factor}") * energy)
    linear = _or_zero(parameters, f"delta_{factor}") * energy
    return 1.0 + linear + _or_zero(parameters, f"{factor}_inf") * saturated


def _or_zero(parameters: xr.Dataset, symbol: str) -> xr.DataArray:
    return parameters[symbol] if symbol in parameters else xr.zeros_like(parameters["k"])


def _initial_rate(parameters: xr.Dataset) -> xr.DataArray:
    return parameters["A"] if "A" in parameters else xr.ones_like(parameters["k"])


def _modal_quantities(energy: xr.DataArray, given: xr.Dataset, masses: Floats, law: StoreyLaw) -> xr.Dataset:
    n_times = energy.sizes["time"]
    chosen = np.unique(np.linspace(0, n_times - 1, min(N_TIME_POINTS, n_times)).round().astype(int))
    sampled = energy.isel(time=chosen).rename(time="time_point")
    time = sampled["time_point"]
    stiffness = tangent_stiffness(parameters_at(law, given, time), sampled).transpose("draw", "time_point", "storey")
    parameters = parameters_at(law, given, float(time[0]))
    if "e_m" in parameters:
        masses = masses * (1.0 + parameters["e_m"].transpose("draw", "storey").values)
    else:
        masses = np.broadcast_to(masses, stiffness.values[:, 0].shape)
    periods, _ = modes(stiffness.values, np.zeros_like(stiffness.values), masses[:, None])
    damping = parameters["c"].transpose("draw", "storey").values
    modal_period, damping_ratio = modes(stiffness.values[:, 0], damping, masses)
    if "c_m" in parameters:
        # Of c_m M each mode gains c_m / (2 omega): the same in every storey's row.
        damping_ratio = damping_ratio + parameters["c_m"].isel(storey=[0]).values * modal_period / (4.0 * np.pi)
    return xr.Dataset(
        {
            "modal_period": (("draw", "mode"), modal_period),
            "modal_damping_ratio": (("draw", "mode"), damping_ratio),
            "period": (("draw", "time_point"), periods[..., 0]),
        },
        coords={"mode": np.arange(1, stiffness.sizes["storey"] + 1), "time": ("time_point", time.values)},
    )
