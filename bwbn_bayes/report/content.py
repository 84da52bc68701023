"""Gather what the page shows: histories, loops, marginals and quantities, with percentiles of the given draws.

Nothing is estimated here; every array comes from the result's tree, every number from its facts.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bwbn_bayes.inference.responses import STATISTICS, evenly
from bwbn_bayes.parameters import Floats
from bwbn_bayes.report.pieces import (
    Band,
    ChannelTrace,
    Content,
    Marginal,
    Pair,
    Period,
    Quantity,
    StoreyHistory,
    StoreyLoop,
    strongest_window,
)
from bwbn_bayes.results import POINTS, Facts, ParameterFacts, Result
from bwbn_bayes.structures.parts import SPECIMEN

Indices = NDArray[np.intp]

MAX_PANELS = 6
"""Most floors or storeys drawn in one figure; taller buildings show evenly chosen ones."""
MAX_LOOP_DRAWS = 25
MAX_LOOP_POINTS = 20_000
"""Most samples of drawn loops; of a longer record the strongest part is drawn."""
MAX_PAIRS = 4
BAND_PERCENT = (5.0, 95.0)

_QUANTITIES = {
    "acceleration": ("acceleration", "m/s^2", "Floor"),
    "relative_acceleration": ("relative acceleration", "m/s^2", "Floor"),
    "velocity": ("velocity", "m/s", "Floor"),
    "displacement": ("displacement", "m", "Floor"),
    "drift": ("drift", "m", "Storey"),
    "force": ("force", "N", "Storey"),
}


def gather(result: Result) -> Content:
    """Gather the report's content from a result.

    Parameters
    ----------
    result : Result
        Its groups are read as :mod:`bwbn_bayes.results` describes; any group may be missing.

    Returns
    -------
    Content
    """
    tree, facts = result.tree, result.facts
    marginals = _marginals(tree, facts)
    quantities = _group(tree, "quantities")
    return Content(
        facts=facts,
        traces=_traces(tree, facts),
        n_channels=_group(tree, "observed_data").sizes.get("channel", 0),
        loops=_loops(tree),
        histories=_histories(tree),
        has_time=_group(tree, "observed_data").get("time", xr.DataArray()).attrs.get("units") != POINTS,
        marginals=marginals,
        pairs=_strongest_pairs(marginals),
        places=tuple(place_in_words(tree, storey) for storey in range(1, facts.storeys + 1)),
        storey_quantities=_quantities(quantities, "storey"),
        modal_quantities=() if _is_specimen(tree) else _quantities(quantities, "mode"),
        period=None if _is_specimen(tree) else _period(quantities),
        specimen=_is_specimen(tree),
        n_chains=_group(tree, "posterior").sizes.get("chain", 1),
        has_bands="posterior" in tree.children,
    )


def shown(labels: Sequence[int], n_shown: int = MAX_PANELS) -> tuple[int, ...]:
    """All labels, or evenly chosen ones with both ends where there are too many."""
    if len(labels) <= n_shown:
        return tuple(labels)
    positions = np.linspace(0, len(labels) - 1, n_shown).round().astype(int)
    return tuple(labels[i] for i in positions)


def _group(tree: xr.DataTree, name: str) -> xr.Dataset:
    return tree[name].to_dataset() if name in tree.children else xr.Dataset()


def _labels(array: xr.DataArray, dim: str) -> list[int]:
    return [int(label) for label in array[dim].values]


def _at(array: xr.DataArray, dim: str, label: int) -> xr.DataArray:
    return array.isel({dim: _labels(array, dim).index(label)}) if dim in array.coords else array.isel({dim: label - 1})


def _band(draws: Floats) -> Band:
    """Mean and 90 % band over the first axis."""
    lower, upper = np.percentile(draws, BAND_PERCENT, axis=0)
    return Band(lower=lower, middle=np.mean(draws, axis=0), upper=upper)


def _stated(bands: xr.DataArray) -> Band:
    """The band of a history ``(statistic, time)``; one of no width where it has no statistics."""
    if "statistic" not in bands.dims:
        bands = bands.expand_dims(statistic=list(STATISTICS))
    middle, lower, upper = (np.asarray(bands.sel(statistic=one).values, dtype=np.float64) for one in STATISTICS)
    return Band(lower=lower, middle=middle, upper=upper)


def _responses(tree: xr.DataTree) -> xr.Dataset:
    """Noise-free histories as statistics, or those of a point estimate."""
    if "response_bands" in tree.children:
        return _group(tree, "response_bands")
    response = _group(tree, "response")
    return response.isel(draw=0, drop=True) if "draw" in response.dims else response


def _traces(tree: xr.DataTree, facts: Facts) -> tuple[ChannelTrace, ...]:
    observed, predicted = _group(tree, "observed_data"), _group(tree, "predictive_bands")
    if "prediction" in tree.children:  # a point estimate: one history, a band of no width
        predicted = _group(tree, "prediction")
    response = _responses(tree)
    names = [str(name) for name in observed.get("channel", xr.DataArray([])).values if name in predicted]
    chosen = [names[i - 1] for i in shown(range(1, len(names) + 1))]
    return tuple(_trace(name, observed, predicted[name], response, facts) for name in chosen)


def _trace(
    name: str, observed: xr.Dataset, predicted: xr.DataArray, response: xr.Dataset, facts: Facts
) -> ChannelTrace:
    match = re.fullmatch(r"(.+?)_(\d+)", name)
    kind, place = (match.group(1), int(match.group(2))) if match else (name, 0)
    quantity, unit, where = _QUANTITIES.get(kind, (kind.replace("_", " "), "", ""))
    noisy = _stated(predicted)
    middle = noisy.middle
    dim = {"acceleration": "floor", "drift": "storey"}.get(kind)
    if dim is not None and kind in response:
        middle = _stated(_at(response[kind], dim, place)).middle
    return ChannelTrace(
        channel=name,
        title=f"{where} {place}".strip() if match else SPECIMEN.capitalize(),
        quantity=quantity,
        unit=unit,
        time=_times(observed),
        measured=np.asarray(observed["measured"].sel(channel=name).values, dtype=np.float64),
        predicted=Band(lower=noisy.lower, middle=middle, upper=noisy.upper),
        noise_sd=facts.noise_sd.get(name, float("nan")),
        nrmse=facts.nrmse.get(name, float("nan")),
    )


def _times(histories: xr.Dataset) -> Floats:
    """Times [s] of histories, or the numbers of the points, from 1, where there is no time."""
    time = histories["time"]
    if time.attrs.get("units") == POINTS:
        return np.arange(1.0, time.size + 1.0)
    return np.asarray(time.values, dtype=np.float64)


def _loops(tree: xr.DataTree) -> tuple[StoreyLoop, ...]:
    response, whole, true = _responses(tree), _group(tree, "response"), _group(tree, "true_response")
    if "restoring_force" not in response:
        return ()
    stretch = _loop_stretch(response)
    times = _times(response)[stretch]
    response, whole, true = (some.isel(time=stretch) if some else some for some in (response, whole, true))
    if "draw" in whole.dims:
        whole = whole.isel(draw=evenly(whole.sizes["draw"], MAX_LOOP_DRAWS))
    measured = _group(tree, "constant_data").get("measured_storey_force")
    measured = None if measured is None else measured.isel(time=stretch)
    return tuple(
        StoreyLoop(
            place=place_in_words(tree, storey),
            drift=_stated(_at(response["drift"], "storey", storey)).middle,
            force=_stated(_at(response["restoring_force"], "storey", storey)).middle,
            drift_draws=_at(whole["drift"], "storey", storey).transpose("draw", "time").values,
            force_draws=_at(whole["restoring_force"], "storey", storey).transpose("draw", "time").values,
            measured_force=_history(measured, storey),
            true_drift=_history(true.get("drift"), storey),
            true_force=_history(true.get("restoring_force"), storey),
            part=None if stretch == slice(None) else (float(times[0]), float(times[-1])),
        )
        for storey in shown(_labels(response["drift"], "storey"))
    )


def _loop_stretch(response: xr.Dataset) -> slice:
    """The part of a record whose loops are drawn: all of it, or of a long one the strongest."""
    time = _times(response)
    if len(time) <= MAX_LOOP_POINTS:
        return slice(None)
    drifts = [_stated(_at(response["drift"], "storey", one)).middle for one in _labels(response["drift"], "storey")]
    start, _ = strongest_window(time, drifts, float(time[MAX_LOOP_POINTS] - time[0]))
    first = int(np.searchsorted(time, start))
    return slice(first, first + MAX_LOOP_POINTS)


def _is_specimen(tree: xr.DataTree) -> bool:
    return "displacement" in _group(tree, "constant_data")


def place_in_words(tree: xr.DataTree, storey: int) -> str:
    """``storey 2``, the nodes that a link joins which carries no floor, or the one place in a testing machine."""
    if _is_specimen(tree):
        return SPECIMEN
    links = np.atleast_1d(_group(tree, "constant_data").attrs.get("links", []))
    return str(links[storey - 1]) if len(links) else f"storey {storey}"


def _history(array: xr.DataArray | None, storey: int) -> Floats | None:
    if array is None or ("storey" in array.coords and storey not in _labels(array, "storey")):
        return None
    values = np.asarray(_at(array, "storey", storey).values, dtype=np.float64)
    return values if np.any(np.isfinite(values)) else None


def _histories(tree: xr.DataTree) -> tuple[StoreyHistory, ...]:
    response, true = _responses(tree), _group(tree, "true_response")
    if "drift" not in response or "hysteretic_energy" not in response:
        return ()
    return tuple(
        StoreyHistory(
            place=place_in_words(tree, storey),
            time=_times(response),
            drift=_stated(_at(response["drift"], "storey", storey)),
            energy=_stated(_at(response["hysteretic_energy"], "storey", storey)),
            true_drift=_history(true.get("drift"), storey),
        )
        for storey in shown(_labels(response["drift"], "storey"))
    )


def _marginals(tree: xr.DataTree, facts: Facts) -> tuple[Marginal, ...]:
    posterior, prior = _group(tree, "posterior"), _group(tree, "prior")
    known = (p for p in facts.parameters if _variable(posterior, p) is not None)
    return tuple(Marginal(parameter=p, posterior=_draws(posterior, p), prior=_draws(prior, p).ravel()) for p in known)


def _variable(dataset: xr.Dataset, parameter: ParameterFacts) -> str | None:
    """The variable that holds a parameter, alone or as one of its places."""
    names = (parameter.name, parameter.symbol, parameter.name.partition("[")[0])
    return next((name for name in names if name in dataset), None)


def _draws(dataset: xr.Dataset, parameter: ParameterFacts) -> Floats:
    """Draws ``(n_chains, n_draws)`` of one parameter; empty where the dataset lacks it."""
    name = _variable(dataset, parameter)
    if name is None:
        return np.empty((1, 0))
    array = dataset[name]
    for dim in [str(dim) for dim in array.dims if dim not in ("chain", "draw")]:
        index = parameter.name.partition("[")[2].rstrip("]")
        labels = [str(label) for label in array[dim].values]
        array = array.isel({dim: labels.index(index) if index in labels else int(index) - 1})
    return np.asarray(array.transpose("chain", "draw").values, dtype=np.float64)


def _strongest_pairs(marginals: tuple[Marginal, ...]) -> tuple[Pair, ...]:
    varying = [m for m in marginals if m.posterior.size > 2 and float(np.ptp(m.posterior)) > 0.0]
    if len(varying) < 2:
        return ()
    correlation: Floats = np.corrcoef(np.stack([m.posterior.ravel() for m in varying]))
    rows, columns = np.triu_indices(len(varying), k=1)
    order = np.argsort(-np.abs(correlation[rows, columns]))[:MAX_PAIRS]
    return tuple(
        Pair(first=varying[i], second=varying[j], correlation=float(correlation[i, j]))
        for i, j in zip(rows[order], columns[order], strict=True)
    )


DRIFT_RATIO = "peak drift ratio"

_QUANTITY_NAMES = {
    "peak_drift": ("peak drift", "m"),
    "peak_drift_ratio": (DRIFT_RATIO, "%"),
    "residual_drift": ("residual drift", "m"),
    "ductility": ("ductility", ""),
    "stiffness_lost": ("stiffness lost", "%"),
    "strength_lost": ("strength lost", "%"),
    "dissipated_energy": ("hysteretic energy dissipated", "J"),
    "modal_period": ("period", "s"),
    "modal_damping_ratio": ("damping ratio", "%"),
}


def _quantities(quantities: xr.Dataset, dim: str) -> tuple[Quantity, ...]:
    found = []
    for name, (title, unit) in _QUANTITY_NAMES.items():
        if name in quantities and dim in quantities[name].dims:
            values = quantities[name].transpose("draw", dim).values * (100.0 if unit == "%" else 1.0)
            found.append(Quantity(name=title, unit=unit, band=_band(values)))
    return tuple(found)


def _period(quantities: xr.Dataset) -> Period | None:
    if "period" not in quantities:
        return None
    time = cast("Floats", quantities["time"].values)
    return Period(time=time, band=_band(quantities["period"].transpose("draw", "time_point").values))
