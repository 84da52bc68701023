"""Arrays of a result, as ``results.py`` lists them: named dimensions, coordinates and units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from bwbn_bayes.engines.base import BASE_DISPLACEMENT
from bwbn_bayes.inference.accuracy import in_singles
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.responses import STATISTICS, Responses, Singles, batches, evenly
from bwbn_bayes.parameters import Floats, FreeParameter
from bwbn_bayes.records.blocks import counts, labels, measured_or_nan, over_time
from bwbn_bayes.records.record import Record, si_unit
from bwbn_bayes.results import POINTS
from bwbn_bayes.structures.quantities import engineering_quantities, storey_parameters, time_points
from bwbn_bayes.structures.structure import Structure

_LOG_2PI = float(np.log(2.0 * np.pi))
_N_PRIOR = 2000
_MOST_POINTWISE, _FEWEST_POINTWISE, _FEWEST_REPLICATES = 1000, 100, 2
_POINTWISE_NUMBERS = 2_000_000
"""Pointwise log likelihoods kept at most, for as many draws between these as that allows, and replicates: 8 MB each."""
_STATISTICS = {"statistic": list(STATISTICS)}
_UNITS = {
    "drift": "m",
    "drift_rate": "m/s",
    "restoring_force": "N",
    "hysteretic_displacement": "m",
    "hysteretic_energy": "J",
    "acceleration": "m/s^2",
    BASE_DISPLACEMENT: "m",
}


def measured_storey_force(model: Structure, record: Record, storey: int) -> Floats | None:
    """Force ``(n_times,)`` [N] of a storey by equilibrium of the floors above, whatever its law.

    None where one of these has no sensor, or the floors hang together by more than storeys.
    """
    if not model.is_chain or not {*range(storey, model.n_floors + 1)} <= {*record.floors}:
        return None
    force: Floats = record.storey_forces(model.masses, lowest_storey=storey)[0]
    return force


def noise_scales(posterior: Posterior, points: Floats, rng: np.random.Generator) -> Floats:
    """Noise standard deviations ``(n_draws, n_blocks)``, one from each draw's own posterior of them.

    Single precision, which moves a sum of squares by a millionth, is enough for that.
    """
    different, place = np.unique(points, axis=0, return_inverse=True)
    misfit = in_singles(posterior).misfit(different)[place]
    return np.array(posterior.noise.draw_sd(rng, misfit, counts(posterior.record), posterior.split(points)[1]))


def posterior_tree(
    posterior: Posterior,
    points: Floats,
    log_likelihood: Floats,
    noise_sd: Floats,
    responses: Responses,
    truth: Mapping[str, Floats] | None,
    rng: np.random.Generator,
) -> xr.DataTree:
    """All groups of a result.

    Parameters
    ----------
    posterior : Posterior
        What was sampled.
    points : (n_draws, n_dim) array
        Draws in the unit cube.
    log_likelihood : (n_draws,) array
        Of each draw.
    noise_sd : (n_draws, n_blocks) array
        Noise scales of each draw.
    responses : Responses
        Of the draws that bands, predictions and quantities are made of.
    truth : mapping, optional
        The noise-free response at the true parameters.
    rng : numpy.random.Generator
        For prior draws.
    """
    record, model, space = posterior.record, posterior.model, posterior.space
    n_own = model.space.n_dim
    values, prior = space.from_unit(points), space.from_unit(posterior.sample_prior(rng, _N_PRIOR))
    storeys = list(range(1, model.n_links + 1))
    draw = {"draw": responses.draws}
    whole = {"draw": responses.whole}
    by_storey = storey_parameters(model, responses.values).assign_coords(draw)
    density = sum((p.prior.log_density(values[:, i]) for i, p in enumerate(space.parameters)), np.zeros(len(points)))
    lp = log_likelihood + density - model.space.log_admissible_mass
    pointwise, replicates = _by_sample(posterior, points, noise_sd, rng)
    # Of no samples the posterior of the noise scales is their prior.
    nothing = np.zeros((_N_PRIOR, noise_sd.shape[1]))
    prior_sd = posterior.noise.draw_sd(rng, nothing, 0.0, prior[:, n_own:])
    groups = {
        "posterior": _draws(model, record, values[:, :n_own], noise_sd),
        "prior": _draws(model, record, prior[:, :n_own], prior_sd),
        "sample_stats": _numbered(xr.Dataset({"lp": (("chain", "draw"), lp[None])})),
        "log_likelihood": pointwise,
        "observed_data": observed_dataset(record),
        "constant_data": constant_dataset(model, record),
        "posterior_predictive": replicates,
        "predictive_bands": _predicted(record, responses.predicted_bands, ("statistic",)).assign_coords(_STATISTICS),
        "response": response_dataset(responses.histories, record, storeys).assign_coords(whole),
        "response_bands": response_dataset(responses.bands, record, storeys, over="statistic").assign_coords(
            _STATISTICS
        ),
        "parameters_by_storey": by_storey,
    }
    if not model.is_driven:
        known = xr.Dataset(responses.landmarks, coords={**draw, "storey": storeys})
        known = known.assign_coords(time_point=record.times[time_points(record.n_times)])
        groups["quantities"] = engineering_quantities(
            known, by_storey, model.masses, model.law, model.heights, model.joints
        )
    if truth is not None:
        groups["true_response"] = response_dataset(truth, record, storeys).isel(draw=0, drop=True)
    return xr.DataTree.from_dict(groups)


def _draws(model: Structure, record: Record, values: Floats, noise_sd: Floats) -> xr.Dataset:
    """Parameters ``(n, n_parameters)`` and noise scales ``(n, n_blocks)``."""
    dataset = parameter_dataset(model.space.parameters, values, model.n_links)
    dataset = dataset.assign(noise_sd=(("chain", "draw", "channel"), noise_sd[None], units_of(record)))
    return _numbered(dataset.assign_coords(channel=list(labels(record))))


def _numbered(dataset: xr.Dataset) -> xr.Dataset:
    return dataset.assign_coords(chain=[0], draw=np.arange(dataset.sizes["draw"]))


def _histories(record: Record, variables: Mapping[str, tuple[Any, Any]]) -> xr.Dataset:
    """Variables by channel over the record's time."""
    return xr.Dataset(
        {name: (*variable, {"units": si_unit(name)}) for name, variable in variables.items()},
        coords={"time": _times(record)},
    )


def units_of(record: Record) -> dict[str, str]:
    """The attribute of what holds all channels: their units, each once."""
    return {"units": ", ".join(dict.fromkeys(si_unit(name) for name in record.channels))}


def observed_dataset(record: Record) -> xr.Dataset:
    """Measured channels under the name that densities and replicates of their samples have."""
    return _measured(record, ("channel", "time"), measured_or_nan(record))


def _measured(record: Record, dims: tuple[str, ...], values: Floats | Singles) -> xr.Dataset:
    return xr.Dataset(
        {"measured": (dims, values, units_of(record))},
        coords={"channel": list(record.channels), "time": _times(record)},
    )


def _times(record: Record) -> tuple[str, Floats, dict[str, str]]:
    """The coordinate: seconds, or of a path a count of points, which has no unit."""
    return "time", record.times, {"units": "s" if record.has_time else POINTS}


def _or_nothing(record: Record, rows: Floats) -> Floats:
    """A copy of measured rows ``(..., n_times)``, not a number where samples do not count."""
    return record.where_counted(np.array(rows), otherwise=np.nan)


def _predicted(record: Record, values: Singles, dims: tuple[str, ...]) -> xr.Dataset:
    """Channels of values ``(..., n_channels, n_times)``."""
    return _histories(record, {name: ((*dims, "time"), values[..., i, :]) for i, name in enumerate(record.channels)})


def _by_sample(
    posterior: Posterior, points: Floats, noise_sd: Floats, rng: np.random.Generator
) -> tuple[xr.Dataset, xr.Dataset]:
    """Log density of every measured sample given draw and noise scales, and replicates, noise included, of those draws.

    White noise makes samples independent. Where a record is too long for all, densities are of every stretch of so many
    samples, by the time at which it begins, and replicates of a few of the draws.
    """
    record = posterior.record
    # With a force beside the model every draw is solved by itself, three times over.
    alone = posterior.noise.correlation is None
    most = _POINTWISE_NUMBERS // record.measured.size if alone else _FEWEST_POINTWISE
    chosen = evenly(len(points), min(max(most, _FEWEST_POINTWISE), _MOST_POINTWISE))
    together = max(1, -(-record.measured.size * _FEWEST_POINTWISE // _POINTWISE_NUMBERS))
    begins, times = np.arange(0, record.n_counted, together), record.times[record.kept]
    values, _ = posterior.split(points[chosen])
    posterior.solves.add(len(chosen))
    density = np.empty((len(chosen), len(record.channels), len(begins)), dtype=np.float32)
    whole = evenly(len(chosen), max(_POINTWISE_NUMBERS // record.measured.size, _FEWEST_REPLICATES))
    replicates = np.empty((len(whole), *record.measured.shape), dtype=np.float32)
    for rows in batches(len(chosen), record.measured.size):
        response = posterior.engine.simulate(posterior.model, values[rows], record).values
        for place in np.flatnonzero((whole >= rows.start) & (whole < rows.stop)):
            noise = rng.standard_normal(record.measured.shape, dtype=np.float32)
            own_sd = over_time(record, noise_sd[chosen[whole[place]]])
            replicates[place] = response[whole[place] - rows.start] + own_sd * noise
        residual = response[..., record.kept]
        residual -= record.measured[:, record.kept]
        sd = noise_sd[chosen[rows]][:, :, None]
        if len(record.parts) > 1:
            sd = over_time(record, sd[..., 0])[..., record.kept]
        # What was not measured says nothing: a density of one.
        sd = np.where(sd > 0.0, sd, np.inf)
        residual /= sd
        np.square(residual, out=residual)
        residual *= -0.5
        residual -= np.where(sd < np.inf, np.log(sd) + 0.5 * _LOG_2PI, 0.0)
        density[rows] = np.add.reduceat(residual, begins, axis=2)
        del response, residual  # before the next is made
    dims = ("chain", "draw", "channel", "time")
    pointwise = xr.Dataset(
        {"measured": (dims, density[None])},
        coords={"chain": [0], "draw": chosen, "channel": list(record.channels), "time": times[begins]},
    )
    return pointwise, _measured(record, dims, replicates[None]).assign_coords(chain=[0], draw=chosen[whole])


def response_dataset(
    rows: Mapping[str, Floats] | Mapping[str, Singles], record: Record, storeys: list[int], *, over: str = "draw"
) -> xr.Dataset:
    """Histories ``(n_draws, n_storeys, n_times)`` by kind, with the names of storeys, floors and times."""
    place = {kind: {"acceleration": "floor", BASE_DISPLACEMENT: "base"}.get(kind, "storey") for kind in rows}
    floors = list(range(1, rows["acceleration"].shape[1] + 1)) if "acceleration" in rows else storeys
    return xr.Dataset(
        {
            kind: ((over, place[kind], "time"), values.astype(np.float32, copy=False), {"units": _UNITS[kind]})
            for kind, values in rows.items()
        },
        coords={"storey": storeys, "floor": floors, "time": _times(record)},
    )


def parameter_dataset(parameters: Sequence[FreeParameter], values: Floats, n_storeys: int) -> xr.Dataset:
    """One variable per symbol; per-storey parameters get a storey dimension of their own where not all have one."""
    variables: dict[str, tuple[tuple[str, ...], Floats, dict[str, str]]] = {}
    coords: dict[str, list[int]] = {}
    for symbol in dict.fromkeys(p.symbol for p in parameters):
        members = [i for i, p in enumerate(parameters) if p.symbol == symbol]
        numbered = [parameters[i].storeys for i in members]
        unit = {"units": parameters[members[0]].unit}
        if len(members) == 1 and parameters[members[0]].name == symbol:
            variables[symbol] = (("chain", "draw"), values[None, :, members[0]], unit)
        elif all(len(storeys) == 1 for storeys in numbered):
            storeys = [storeys[0] for storeys in numbered]
            dimension = "storey" if storeys == list(range(1, n_storeys + 1)) else f"storey_{symbol}"
            coords[dimension] = storeys
            variables[symbol] = (("chain", "draw", dimension), values[None][:, :, members], unit)
        else:
            for i in members:
                variables[parameters[i].name] = (("chain", "draw"), values[None, :, i], unit)
    return xr.Dataset(variables, coords=coords)


def constant_dataset(model: Structure, record: Record) -> xr.Dataset:
    """What drives, masses and heights; where sensors allow, the measured storey forces; a specimen's own force."""
    dataset = _histories(record, {name: ("time", np.array(signal)) for name, signal in record.drivers.items()})
    floors = list(range(1, model.n_floors + 1))
    dataset.attrs["n_runs"] = len(record.runs)
    if not model.is_driven:
        own = {"mass": ("floor", list(model.masses), {"units": "kg"})}
        own |= {"height": ("storey", list(model.heights), {"units": "m"})} if model.heights is not None else {}
        joins = (("link", "end"), np.array(model.joints))
        dataset = dataset.assign(own).assign(joins=joins).assign_coords(floor=floors)
        if model.n_links > model.n_floors:
            dataset.attrs["links"] = [model.link_in_words(link) for link in range(1, model.n_links + 1)]
    if model.is_chain and floors and set(floors) <= set(record.floors):
        forces = _or_nothing(record, record.storey_forces(model.masses))
    elif "force" in record.channels:
        forces = _or_nothing(record, record.channels["force"])[None]
    else:
        return dataset
    measured = (("storey", "time"), forces, {"units": "N"})
    return dataset.assign(measured_storey_force=measured).assign_coords(storey=floors or [1])
