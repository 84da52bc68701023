"""What is exported: links with a number for every parameter, masses, the excitation; of a model or of a result."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import xarray as xr

from bwbn_bayes.elements.linear import Linear
from bwbn_bayes.engines.base import Status
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.errors import UserError
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record, is_input
from bwbn_bayes.results import POINTS, ParameterFacts, Result
from bwbn_bayes.structures.parts import SPECIMEN
from bwbn_bayes.structures.structure import Structure

Point = Literal["mean", "map"]

_HISTORIES = ("drift", "drift_rate", "restoring_force")
_SENSORS = ("gain", "bias", "lag")
_SENSORS_STAY = "The sensors' gain, bias or lag belongs to the record, not to the structure, and is not exported."
_AT_FIRST = ("u_0", "v_0", "z_0")


@dataclass(frozen=True, kw_only=True)
class Link:
    """One storey, a link beside the storeys, or the specimen.

    Attributes
    ----------
    number : int
        From 1: storeys from the ground up, then the others.
    place : str
        Which it is, in words.
    joins : (int, int)
        The nodes that it stands on and ends at; 0 is the ground, or the base.
    parameters : mapping of str to float
        Every parameter of the law by symbol, in its own unit; neutral where an effect does not act.
    drift, drift_rate, force : (n_times,) array
        What it goes through under the excitation, its force with dampers and all. [m], [m/s], [N]
    """

    number: int
    place: str
    joins: tuple[int, int]
    parameters: Mapping[str, float]
    drift: Floats
    drift_rate: Floats
    force: Floats


@dataclass(frozen=True, kw_only=True)
class Exportable:
    """A structure with known parameters under its excitation.

    Attributes
    ----------
    name : str
        Of the model.
    origin : str
        Where the numbers come from, the rest of a sentence that begins with "parameters are".
    links : tuple of Link
    masses : tuple of float
        Of the floors, from the ground up; none of a specimen. [kg]
    excitation : (n_times,) array
        Ground acceleration as recorded [m/s^2], or a specimen's displacement [m], linear between samples.
    time_steps : (n_times - 1,) array or None
        Between samples, several in a sequence of records [s]; None where a specimen's record has no time.
    forces : mapping of int to (n_times,) array
        From outside, by the floor that they act on. [N]
    notes : tuple of str
        What is left out, in sentences.
    """

    name: str
    origin: str
    links: tuple[Link, ...]
    masses: tuple[float, ...]
    excitation: Floats
    time_steps: Floats | None
    forces: Mapping[int, Floats] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def is_specimen(self) -> bool:
        """Whether the displacement is given, rather than the motion of the ground."""
        return not self.masses


def of_model(model: Structure, record: Record, values: Mapping[str, float], *, name: str) -> Exportable:
    """A model at known values.

    Parameters
    ----------
    model : Structure
    record : Record
        Its excitation; what it measured is left aside.
    values : mapping of str to float
        Every identified parameter by label, in its own unit.
    name : str
        What the model is called.

    Raises
    ------
    UserError
        If a value is missing or wrong, the model cannot be solved there, or it begins anew in each of several records.
    """
    _check_one_go(len(record.runs))
    draws = model.draws(values)
    channels = [f"{kind}_{storey}" for storey in range(1, model.n_links + 1) for kind in _HISTORIES]
    response = Reference().simulate(model, draws, record, channels)
    if response.status[0] != Status.OK:
        raise UserError(f"{name} cannot be solved at the given parameters: nothing is exported")
    histories = response.values[0].reshape(model.n_links, len(_HISTORIES), -1)
    local = model.table.local(draws)[0]
    symbols = [parameter.symbol for parameter in model.law.parameters]
    return Exportable(
        name=name,
        origin="those of the model's `truth`" if values else "the known ones of the model",
        links=tuple(
            _link(
                i,
                model.link_in_words(i),
                joins,
                dict(zip(symbols, map(float, local[i - 1]), strict=False)),
                histories[i - 1],
            )
            for i, joins in enumerate(model.joints, 1)
        ),
        masses=tuple(model.masses) if not model.is_driven else (),
        excitation=np.asarray(record.excitation),
        time_steps=np.diff(record.times) if record.has_time else None,
        forces=dict(zip(record.forced_floors, record.forces.values(), strict=True)),
        notes=(_SENSORS_STAY,) if model.sensors.parameters else (),
    )


def of_result(result: Result, at: Point = "mean") -> Exportable:
    """The structure of a result at one point of its posterior.

    Parameters
    ----------
    result : Result
        Of any method that identifies parameters.
    at : {"mean", "map"}
        Posterior mean, or the draw with the highest posterior density. A point estimate has but one point.

    Raises
    ------
    UserError
        If the result lacks parameters, masses, links or the excitation, or is one of several records that each find the
        structure as built.
    """
    tree, facts = result.tree, result.facts
    for group in ("parameters_by_storey", "response", "constant_data"):
        if group not in tree.children:
            raise UserError(
                f"the result of method {facts.method} holds no {group.replace('_', ' ')}: "
                "export one of a method that identifies parameters, such as importance"
            )
    constant = tree["constant_data"].to_dataset()
    is_specimen = "displacement" in constant
    forces = {int(n.rpartition("_")[2]): np.asarray(constant[n].values) for n in map(str, constant) if is_input(n)}
    if not is_specimen and not ({"mass", "joins"} <= {*constant} and ("ground_acceleration" in constant or forces)):
        raise UserError(
            "the result does not say its masses, its links and its excitation: identify once more with this version"
        )
    _check_one_go(int(constant.attrs.get("n_runs", 1)))
    time = constant["time"]
    parameters, point = _parameters(result, at)
    drift, drift_rate, force = _mean_histories(result)
    joins = [(0, 1)] if is_specimen else [(int(low), int(high)) for low, high in constant["joins"].values]
    words = list(map(str, np.atleast_1d(constant.attrs.get("links", []))))
    words = words or [SPECIMEN if is_specimen else f"storey {i + 1}" for i in range(len(joins))]
    still = np.zeros(constant.sizes["time"])
    kind = "displacement" if is_specimen else "ground_acceleration"
    return Exportable(
        name=facts.model,
        origin=f"the {point}, identified from {facts.record}",
        links=tuple(
            _link(
                i + 1,
                words[i],
                ends,
                {symbol: float(values[i]) for symbol, values in parameters.items()},
                (drift[i], drift_rate[i], force[i]),
            )
            for i, ends in enumerate(joins)
        ),
        masses=() if is_specimen else tuple(map(float, constant["mass"].values)),
        excitation=np.asarray(constant[kind].values, dtype=np.float64) if kind in constant else still,
        time_steps=None if time.attrs.get("units") == POINTS else np.diff(np.asarray(time.values, dtype=np.float64)),
        forces=forces,
        notes=(_SENSORS_STAY,) if any(p.symbol in _SENSORS for p in facts.parameters) else (),
    )


def _check_one_go(n_runs: int) -> None:
    """A script goes once through its excitation, from rest."""
    if n_runs > 1:
        raise UserError(
            f"{n_runs} records that each find the structure as built are not exported together, since a script runs "
            "once: export the model file with --record FILE, one record at a time"
        )


def _mean_histories(result: Result) -> list[Floats]:
    """Each history's posterior mean ``(n_storeys, n_times)``, or that of a point estimate."""
    if "response_bands" in result.tree.children:
        response = result.tree["response_bands"].to_dataset().sel(statistic="mean")
    else:
        response = result.tree["response"].to_dataset().isel(draw=0)
    return [np.asarray(response[name].values, dtype=np.float64) for name in _HISTORIES]


def _link(
    number: int,
    place: str,
    joins: tuple[int, int],
    parameters: Mapping[str, float],
    histories: Sequence[Floats] | Floats,
) -> Link:
    wrong = [symbol for symbol, value in parameters.items() if not math.isfinite(value)]
    if wrong:
        raise UserError(f"{place}: {', '.join(wrong)} is not finite, which no script can hold")
    moved = [f"{symbol} = {parameters[symbol]:g}" for symbol in _AT_FIRST if parameters.get(symbol, 0.0) != 0.0]
    if moved:
        raise UserError(
            f"{place} begins with {', '.join(moved)}, but OpenSees' materials begin at rest: leave InitialState out, "
            "or give it zeros"
        )
    drift, drift_rate, force = histories
    if "alpha" not in parameters:
        parameters = {**parameters, **{one.subject.name: float(one.expression) for one in Linear.derived}}
    return Link(
        number=number,
        place=place,
        joins=joins,
        parameters={symbol: value for symbol, value in parameters.items() if symbol not in _AT_FIRST},
        drift=drift,
        drift_rate=drift_rate,
        force=force,
    )


def _parameters(result: Result, at: Point) -> tuple[dict[str, Floats], str]:
    """Parameters ``(n_storeys,)`` by symbol at the point, and what the point is called.

    Known values stand in any draw; identified ones are put in their places.
    """
    by_storey = result.tree["parameters_by_storey"].to_dataset().isel(draw=0)
    values = {str(name): np.array(array.values, dtype=np.float64) for name, array in by_storey.data_vars.items()}
    has_draws = "posterior" in result.tree.children
    best = _densest(result.tree) if has_draws and at == "map" else None
    for facts in result.facts.parameters:
        if facts.symbol in values:
            rows = _rows(facts.name, len(values[facts.symbol]))
            values[facts.symbol][rows] = facts.mean if best is None else _of_draw(best, facts)
    if not has_draws:
        return values, "point estimate"
    return values, "posterior mean" if best is None else "draw of highest posterior density"


def _rows(name: str, n_storeys: int) -> list[int]:
    """Where a parameter stands: ``k[2]`` at the second storey, ``k[1,3]`` at two, ``k`` everywhere."""
    numbered = re.fullmatch(r".*\[([0-9,]+)\]", name)
    storeys = [int(one) for one in numbered[1].split(",")] if numbered else range(1, n_storeys + 1)
    return [storey - 1 for storey in storeys]


def _densest(tree: xr.DataTree) -> xr.Dataset:
    """The draw of the posterior with the highest density."""
    density = tree["sample_stats"]["lp"].stack(every=("chain", "draw"))
    place = density["every"].values[int(np.argmax(density.values))]
    return tree["posterior"].to_dataset().sel(chain=place[0], draw=place[1])


def _of_draw(draw: xr.Dataset, facts: ParameterFacts) -> float:
    """One parameter of one draw: alone, or one of the places of its symbol."""
    if facts.name in draw:
        return float(draw[facts.name])
    array = draw[facts.symbol]
    (dimension,) = array.dims
    return float(array.sel({dimension: _rows(facts.name, 0)[0] + 1}))
