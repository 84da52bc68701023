"""What an engineer asks next: peaks, losses, energies and periods from response histories, draw by draw.

Every function is pure and works on any leading dimensions; draws stay separate, so that bands come from percentiles.
What is lost of strength and stiffness follows from the law's own ``nu`` and ``eta``, whatever effects they are made of.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import sympy as sp
import xarray as xr
from numpy.typing import NDArray

from bwbn_bayes.elements.law import DRIFT, DRIFT_RATE, ENERGY, TIME, StoreyLaw, step
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.structure import Structure

Landmark = tuple[tuple[str, ...], Floats | NDArray[np.float32]]
"""A variable of a Dataset: dimensions and values."""

RESIDUAL_SHARE = 0.05
"""Share of the record, at its end, over which the residual drift is averaged."""
N_TIME_POINTS = 48
"""Number of times at which the period is reported."""
_UNITS = {
    "peak_drift": "m",
    "residual_drift": "m",
    "ductility": "",
    "stiffness_lost": "",
    "strength_lost": "",
    "dissipated_energy": "J",
    "peak_drift_ratio": "",
    "modal_period": "s",
    "modal_damping_ratio": "",
    "period": "s",
}


def storey_parameters(model: Structure, values: Floats) -> xr.Dataset:
    """Every parameter of the storey law, by symbol ``(draw, storey)``, from identified ones ``(n_draws, n_dim)``."""
    local = model.table.local(values)
    return xr.Dataset(
        {p.symbol: (("draw", "storey"), local[:, :, i], {"units": p.unit}) for i, p in enumerate(model.law.parameters)},
        coords={"storey": list(range(1, model.n_links + 1))},
    )


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


def tangent_stiffness(parameters: xr.Dataset, eta: xr.DataArray) -> xr.DataArray:
    """Initial tangent ``alpha k + (1 - alpha) k A / eta - k_geo`` of each storey, degraded as it is at a time, in N/m.

    It is the slope at z = 0 without slip or pinching: what a small vibration around rest sees.

    Parameters
    ----------
    parameters : Dataset (draw, storey, ...)
        ``k`` [N/m], ``alpha``, and where they are not neutral ``A`` and ``k_geo`` [N/m], at the times of ``eta``.
    eta : DataArray (draw, storey, ...)
        What the stiffness is divided by.

    Returns
    -------
    DataArray (draw, storey, ...)
    """
    k, alpha = parameters["k"], parameters["alpha"]
    own = alpha * k + (1.0 - alpha) * k * _initial_rate(parameters) / eta
    return own - parameters["k_geo"] if "k_geo" in parameters else own


Joints = Sequence[tuple[int, int]]
"""The nodes that each link joins; 0 is the ground."""


def link_matrix(coefficients: Floats, joints: Joints | None = None) -> Floats:
    """Matrix of a structure from its links' coefficients: stiffness from k, damping from c.

    Parameters
    ----------
    coefficients : (..., n_links) array
        One coefficient for each link. [N/m] or [N s/m]
    joints : sequence of (int, int), optional
        The nodes that each link joins; those of a chain of storeys from the ground up where left out.

    Returns
    -------
    (..., n_floors, n_floors) array
        Symmetric, in the unit of the coefficients.
    """
    drifts = _drifts(_joined(joints, coefficients.shape[-1]))
    return np.asarray(np.einsum("si,...s,sj->...ij", drifts, coefficients, drifts))


def bending_matrix(k_bend: Floats, joints: Joints) -> Floats:
    """Stiffness matrix of what resists a difference of drift wherever one storey runs on into the next.

    Parameters
    ----------
    k_bend : (...) array
        Stiffness against that difference. [N/m]
    joints : sequence of (int, int)
        The nodes that each link joins; the first of them carry the nodes in order.

    Returns
    -------
    (..., n_floors, n_floors) array
        Symmetric. [N/m]
    """
    drifts = _drifts(joints)
    n_floors = drifts.shape[1]
    upper = [i for i, (stands_on, _) in enumerate(joints[:n_floors]) if stands_on]
    lower = [joints[i][0] - 1 for i in upper]
    change = drifts[upper] - drifts[lower]
    return np.asarray(np.einsum("...,si,sj->...ij", k_bend, change, change))


def _joined(joints: Joints | None, n_links: int) -> Joints:
    """The nodes that links join: where none are given, those of storeys from the ground up."""
    return [(i, i + 1) for i in range(n_links)] if joints is None else joints


def _drifts(joints: Joints) -> Floats:
    """Rows ``(n_links, n_floors)`` that make drifts of the links from displacements of the floors."""
    ends = np.array(joints)
    nodes = np.arange(1, np.max(ends) + 1)
    return np.asarray((ends[:, 1:] == nodes).astype(np.float64) - (ends[:, :1] == nodes))


def modes(
    stiffness: Floats, damping: Floats, masses: Floats, joints: Joints | None = None, k_bend: Floats | None = None
) -> tuple[Floats, Floats]:
    """Undamped periods and modal damping ratios, longest period first.

    Parameters
    ----------
    stiffness : (..., n_links) array
        Stiffnesses of the links. [N/m]
    damping : (..., n_links) array
        Damping coefficients of the links. [N s/m]
    masses : (..., n_floors) array
        Floor masses. [kg]
    joints : sequence of (int, int), optional
        As for :func:`link_matrix`.
    k_bend : (...) array, optional
        As for :func:`bending_matrix`; zero where left out.

    Returns
    -------
    periods : (..., n_floors) array
        ``2 pi / omega_j`` of ``K phi = omega^2 M phi``. [s]
    damping_ratios : (..., n_floors) array
        ``phi_j^T C phi_j / (2 omega_j)`` with ``phi_j^T M phi_j = 1``; the coupling of modes by C is left out.

    References
    ----------
    .. [1] A. K. Chopra, "Dynamics of Structures", 4th ed., 2012, sections 10.2 and 10.10.
    """
    root = np.sqrt(masses)
    joints = _joined(joints, stiffness.shape[-1])
    whole = link_matrix(stiffness, joints)
    if k_bend is not None:
        whole = whole + bending_matrix(k_bend, joints)
    squares, vectors = np.linalg.eigh(whole / (root[..., :, None] * root[..., None, :]))
    omega = np.sqrt(np.where(squares > 0.0, squares, np.nan))  # a mode without stiffness has no period
    shapes = vectors / root[..., :, None]
    modal_damping = np.einsum("...im,...ij,...jm->...m", shapes, link_matrix(damping, joints), shapes)
    return 2.0 * np.pi / omega, modal_damping / (2.0 * omega)


def landmarks(
    kind: str,
    history: Floats | NDArray[np.float32],
    times: Floats,
    law: StoreyLaw,
    parameters: xr.Dataset,
    begins: Sequence[int] = (0,),
) -> dict[str, Landmark]:
    """What :func:`engineering_quantities` reads from one kind of history, so that the history need not be kept.

    Parameters
    ----------
    kind : str
        ``drift`` [m], ``hysteretic_displacement`` [m] or ``hysteretic_energy`` [J]; of others nothing is read.
    history : (n_draws, n_storeys, n_times) array
    times : (n_times,) array
        [s]
    law : StoreyLaw
    parameters : Dataset (draw, storey)
        Storey parameters by symbol, of the same draws and storeys.
    begins : sequence of int
        Samples at which nothing has been worn: the first, and that of each further record that finds it new.

    Returns
    -------
    dict
        Variables of a Dataset by name: their dimensions and values.
    """
    storeys = ("draw", "storey")
    points = time_points(len(times))
    if kind == "drift":
        n_tail = max(1, round(RESIDUAL_SHARE * len(times)))
        worn = _worn(history, law, parameters, begins)
        return {
            "peak_drift": (storeys, np.max(np.abs(history), axis=2)),
            "residual_drift": (storeys, np.asarray(np.mean(history[..., -n_tail:], axis=2), dtype=history.dtype)),
            **{name: ((*storeys, "time_point"), values[..., points]) for name, values in worn.items()},
        }
    if kind == "hysteretic_energy":
        return {kind: ((*storeys, "time_point"), history[..., points])}
    return {kind: (storeys, history[..., -1])} if kind == "hysteretic_displacement" else {}


def _worn(
    history: Floats | NDArray[np.float32], law: StoreyLaw, parameters: xr.Dataset, begins: Sequence[int]
) -> dict[str, Floats]:
    """States ``(n_draws, n_storeys, n_times)`` by name that ``nu`` and ``eta`` depend on, where the drift makes them.

    Such a state grows in proportion to the drift rate, so that it goes by strides, however fast they are made.
    """
    arguments = (DRIFT, DRIFT_RATE, *law.symbols)
    asked = {own for factor in ("nu", "eta") for own in _expression(law, factor).free_symbols}
    rates = {state: rate for state, rate in zip(law.states, law.rates, strict=True) if state in asked}
    rates = {state: rate for state, rate in rates.items() if rate.free_symbols <= set(arguments)}
    if not rates:
        return {}
    drift = np.asarray(history, dtype=np.float64)
    own = [parameters[one.name].transpose("draw", "storey").values[..., None] for one in law.symbols]
    stride, middle = np.diff(drift), 0.5 * (drift[..., 1:] + drift[..., :-1])
    for sample in begins[1:]:
        stride[..., sample - 1] = 0.0
    result = {}
    for state, rate in rates.items():
        done = np.zeros_like(drift)
        evaluate = sp.lambdify(arguments, rate, "numpy", dummify=True)
        np.cumsum(evaluate(middle, stride, *own), axis=2, out=done[..., 1:])
        for sample in begins[1:]:
            done[..., sample:] -= done[..., sample : sample + 1]
        result[state.name] = done
    return result


def time_points(n_times: int) -> NDArray[np.int64]:
    """Samples at which the period is reported, the first and the last among them."""
    return np.unique(np.linspace(0, n_times - 1, min(N_TIME_POINTS, n_times)).round().astype(np.int64))


def landmarks_of(
    response: xr.Dataset, law: StoreyLaw, parameters: xr.Dataset, begins: Sequence[int] = (0,)
) -> xr.Dataset:
    """The landmarks of whole histories ``(draw, storey, time)``; the rest as for :func:`landmarks`."""
    times = np.asarray(response["time"].values)
    variables: dict[str, Landmark] = {}
    for kind in ("drift", "hysteretic_displacement", "hysteretic_energy"):
        history = response[kind].transpose("draw", "storey", "time").values
        variables |= landmarks(kind, history, times, law, parameters, begins)
    coords = {name: response[name] for name in ("draw", "storey") if name in response.coords}
    return xr.Dataset(variables, coords={**coords, "time_point": times[time_points(len(times))]})


def engineering_quantities(
    landmarks: xr.Dataset,
    storey_parameters: xr.Dataset,
    masses: Sequence[float] | Floats,
    law: StoreyLaw,
    heights: Sequence[float] | None = None,
    joints: Joints | None = None,
) -> xr.Dataset:
    """What an engineer asks next, for every draw.

    Parameters
    ----------
    landmarks : Dataset
        ``peak_drift, residual_drift`` [m] and ``hysteretic_displacement`` [m] at the end, each (draw, storey), and
        ``hysteretic_energy`` [J] and further states by which the law wears, (draw, storey, time_point), with the
        coordinate ``time_point`` [s]: what :func:`landmarks_of` reads from histories.
    storey_parameters : Dataset (draw, storey)
        Every parameter of the storey law by symbol.
    masses : (n_floors,) array
        Floor masses. [kg] An identified error of a mass, and damping in proportion to the masses, are taken from
        ``storey_parameters``; periods are those on a rigid base and without appendages, with geometric stiffness and
        bending between storeys.
    law : StoreyLaw
        Whose parameters they are.
    heights : (n_storeys,) array, optional
        Storey heights. [m]
    joints : sequence of (int, int), optional
        As for :func:`link_matrix`.

    Returns
    -------
    Dataset
        ``peak_drift``, ``residual_drift`` (signed mean of the last 5 % of the record) [m], ``ductility`` (peak over
        :func:`yield_drift` at the start), ``stiffness_lost`` (``1 - 1/eta`` at the end), ``strength_lost``
        (``1 - z_u(nu)/z_u(1) = 1 - nu^(-1/n)`` at the end), ``dissipated_energy`` [J], and with heights
        ``peak_drift_ratio`` (peak over storey height), each (draw, storey);
        ``modal_period`` [s] and ``modal_damping_ratio`` at the start, each (draw, mode);
        ``period`` [s], the first period against time, (draw, time_point) with the coordinate ``time``. Units are
        attributes. A loss that a user's effect makes depend on anything but work, drift and parameters is not a
        number, and has no ``period``.
    """
    at_the_end = landmarks.isel(time_point=-1, drop=True)
    at_start = parameters_at(law, storey_parameters, 0.0)
    at_end = parameters_at(law, storey_parameters, float(landmarks["time_point"][-1]))
    nu, eta = (_factor(law, name, at_end, at_the_end) for name in ("nu", "eta"))
    dataset = xr.Dataset(
        {
            "peak_drift": landmarks["peak_drift"],
            "residual_drift": landmarks["residual_drift"],
            "ductility": landmarks["peak_drift"] / yield_drift(at_start),
            "stiffness_lost": 1.0 - 1.0 / eta,
            "strength_lost": 1.0 - nu ** (-1.0 / at_end["n"]),
            "dissipated_energy": dissipated_energy(at_the_end, at_end, eta),
        }
    ).drop_vars("time_point", errors="ignore")
    if heights is not None:
        none = np.full(dataset.sizes["storey"] - len(heights), np.nan)  # of links that are no storeys
        tall = xr.DataArray(np.concatenate([np.asarray(heights, dtype=np.float64), none]), dims="storey")
        dataset = dataset.assign(peak_drift_ratio=dataset["peak_drift"] / tall)
    dataset = dataset.merge(
        _modal_quantities(landmarks, storey_parameters, np.asarray(masses, dtype=np.float64), law, joints)
    )
    for name, values in dataset.items():
        values.attrs = {"units": _UNITS[str(name)]}
    return dataset


def _expression(law: StoreyLaw, factor: str) -> sp.Expr:
    """``nu`` or ``eta`` of a law: 1 where nothing is lost."""
    return next((one.expression for one in law.definitions if one.subject == step(factor)), sp.S.One)


def _factor(law: StoreyLaw, factor: str, parameters: xr.Dataset, worn: xr.Dataset) -> xr.DataArray:
    """``nu`` or ``eta`` with what has been worn by a time; parameters that jump act on the past wear too."""
    expression = _expression(law, factor)
    own = {one: parameters[one.name] for one in law.symbols}
    own |= {state: worn[state.name] for state in law.states if state.name in worn}
    own[ENERGY] = worn["hysteretic_energy"]
    none: xr.DataArray = xr.zeros_like(parameters["k"] * own[ENERGY])
    if not expression.free_symbols <= set(own):
        return xr.full_like(none, np.nan)
    symbols = sorted(expression.free_symbols, key=str)
    arrays = xr.broadcast(none, *(own[one] for one in symbols))
    evaluate = sp.lambdify(symbols, expression, "numpy", dummify=True)
    result: xr.DataArray = xr.zeros_like(arrays[0]) + evaluate(*(array.values for array in arrays[1:]))
    return result


def dissipated_energy(at_end: xr.Dataset, parameters: xr.Dataset, eta: xr.DataArray) -> xr.DataArray:
    """Hysteretic energy dissipated up to an instant, in J.

    The work on the hysteretic spring less what unloading to z = 0 would return, ``(1 - alpha) k eta z^2 / (2 A)``:
    exact where beta = gamma and nothing slips, and close elsewhere, since the second term is small at rest.

    Parameters
    ----------
    at_end : Dataset (draw, storey)
        ``hysteretic_energy`` [J] and ``hysteretic_displacement`` [m].
    parameters : Dataset (draw, storey)
        Storey parameters by symbol, at that instant.
    eta : DataArray (draw, storey)
        What the stiffness is divided by then.

    Returns
    -------
    DataArray (draw, storey)
    """
    energy, z, alpha = at_end["hysteretic_energy"], at_end["hysteretic_displacement"], parameters["alpha"]
    return energy - (1.0 - alpha) * parameters["k"] * eta * z**2 / (2.0 * _initial_rate(parameters))


def _initial_rate(parameters: xr.Dataset) -> xr.DataArray:
    return parameters["A"] if "A" in parameters else xr.ones_like(parameters["k"])


def _modal_quantities(
    worn: xr.Dataset, given: xr.Dataset, masses: Floats, law: StoreyLaw, joints: Joints | None
) -> xr.Dataset:
    time = worn["time_point"]
    then = parameters_at(law, given, time)
    eta = _factor(law, "eta", then, worn)
    stiffness = tangent_stiffness(then, eta.fillna(1.0)).transpose("draw", "time_point", "storey")
    k_bend = (xr.zeros_like(stiffness) + then["k_bend"]).values[..., 0] if "k_bend" in then else None
    parameters = parameters_at(law, given, float(time[0]))
    if "e_m" in parameters:
        masses = masses * (1.0 + parameters["e_m"].transpose("draw", "storey").values[:, : len(masses)])
    else:
        masses = np.broadcast_to(masses, (stiffness.sizes["draw"], len(masses)))
    periods, _ = modes(stiffness.values, np.zeros_like(stiffness.values), masses[:, None], joints, k_bend)
    damping = parameters["c"].transpose("draw", "storey").values
    at_start = None if k_bend is None else k_bend[:, 0]
    modal_period, damping_ratio = modes(stiffness.values[:, 0], damping, masses, joints, at_start)
    if "c_m" in parameters:
        # Of c_m M each mode gains c_m / (2 omega): the same in every storey's row.
        damping_ratio = damping_ratio + parameters["c_m"].isel(storey=[0]).values * modal_period / (4.0 * np.pi)
    found = xr.Dataset(
        {
            "modal_period": (("draw", "mode"), modal_period),
            "modal_damping_ratio": (("draw", "mode"), damping_ratio),
            "period": (("draw", "time_point"), periods[..., 0]),
        },
        coords={"mode": np.arange(1, masses.shape[1] + 1), "time": ("time_point", time.values, {"units": "s"})},
    )
    return found if bool(eta.notnull().all()) else found.drop_vars("period")
