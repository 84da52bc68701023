"""A structure and its records as an ordinary ``pm.Model``.

Variables carry the names of the literature, with a storey dimension where each storey has its own. The likelihood is
the package's own: noise scales integrated out (the default), known or sampled. What the integration leaves out, noise
scales and predictions with noise, is drawn back by :func:`complete`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import xarray as xr
from pytensor.compile.sharedvalue import SharedVariable
from pytensor.graph.replace import vectorize_graph

from bwbn_bayes.engines.available import engine as engine_by_name
from bwbn_bayes.engines.base import Engine, require_parameters, require_usable
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.accuracy import Discretisation
from bwbn_bayes.inference.arrays import units_of
from bwbn_bayes.inference.likelihood import (
    IntegratedNoise,
    KnownNoise,
    Noise,
    SampledNoise,
    default_noise,
    require_noise,
)
from bwbn_bayes.inference.pymc.densities import (
    OfSamples,
    log_volumes,
    noise_log_likelihood,
    sample_log_densities,
    turned,
)
from bwbn_bayes.inference.pymc.forward import ForwardProblem, forward_problem
from bwbn_bayes.inference.pymc.operators import ChannelResponse, LogAdmissible, SquaredResiduals, spread
from bwbn_bayes.inference.pymc.priors import prior_twin
from bwbn_bayes.inference.pymc.scheme import beside_model, fine_enough, require_fine_enough
from bwbn_bayes.inference.unnamed.beside import require_room_for_force
from bwbn_bayes.parameters import Floats, FreeParameter
from bwbn_bayes.records.blocks import counts, over_time
from bwbn_bayes.records.record import Record, require_whole
from bwbn_bayes.structures.structure import Structure

_LOG_2PI = float(np.log(2.0 * np.pi))


@dataclass(frozen=True, kw_only=True)
class Observation:
    """One record inside a PyMC model.

    Attributes
    ----------
    problem : ForwardProblem
        Model, record and engine.
    noise : Noise
        How the noise scale enters.
    values : TensorVariable
        Identified parameters ``(n_parameters,)``.
    noise_sd : TensorVariable or None
        Sampled noise scales ``(n_blocks,)``.
    dims : tuple of str
        Dimensions of the measured matrix: channel and time.
    data : SharedVariable
        The measured matrix, which ``pm.set_data`` may replace.
    discretisation : Discretisation or None
        What the scheme does to the posterior; unknown where the caller chose it.
    """

    problem: ForwardProblem
    noise: Noise
    values: pt.TensorVariable
    noise_sd: pt.TensorVariable | None
    dims: tuple[str, str]
    data: SharedVariable
    discretisation: Discretisation | None = None


@dataclass(frozen=True, kw_only=True)
class NamedParameters:
    """One variable of the PyMC model and the identified parameters behind it.

    Attributes
    ----------
    name : str
        Name of the variable.
    members : tuple of int
        Positions among the identified parameters.
    storeys : tuple of int
        Storeys of a vector's elements; empty for a number.
    """

    name: str
    members: tuple[int, ...]
    storeys: tuple[int, ...] = ()


def named_parameters(parameters: Sequence[FreeParameter]) -> tuple[NamedParameters, ...]:
    """Group identified parameters into variables: one for each symbol, a vector where each storey has its own."""
    groups = []
    for symbol in dict.fromkeys(p.symbol for p in parameters):
        members = tuple(i for i, p in enumerate(parameters) if p.symbol == symbol)
        if parameters[members[0]].name != symbol and all(len(parameters[i].storeys) == 1 for i in members):
            storeys = tuple(parameters[i].storeys[0] for i in members)
            groups.append(NamedParameters(name=symbol, members=members, storeys=storeys))
        else:
            groups += [NamedParameters(name=parameters[i].name, members=(i,)) for i in members]
    return tuple(groups)


def to_pymc(
    model: Structure,
    records: Record | Sequence[Record],
    *,
    noise: Noise | Sequence[Noise] | None = None,
    engine: str | Engine = "lanes",
    name: str = "",
    parameters: Mapping[str, pt.TensorVariable] | None = None,
    unnamed_force: bool = False,
) -> pm.Model:
    """Build a PyMC model of a structure given one or several records.

    Inside another model's context it becomes a part of that model, its names prefixed by ``name``.

    Parameters
    ----------
    model : Structure
        With priors on the parameters to identify.
    records : Record or sequence of Record
        Of the same structure; several share its parameters, and find it virgin each time. Those that it comes to one
        after the other are one (:func:`~bwbn_bayes.records.joined.join_records`).
    noise : Noise or sequence of Noise, optional
        For each record; by default the scales are integrated out under priors from that record.
    engine : str or Engine
        What solves. Of ``"lanes"`` the scheme is the one that ``identify`` would take, fine enough for every record; to
        tell costs a search for each record's fit. An engine object is taken as it is; :func:`complete` checks it.
    name : str
        Prefix of all names; needed where two structures share one PyMC model.
    parameters : mapping, optional
        Variables of the caller's own in place of a prior, by name (``"delta_eta"``; a vector over the storeys where
        each has its own). The density over the admissible region is then not normalised: evidences keep a constant.
    unnamed_force : bool
        Whether a force of no known law stands beside the model, integrated out, as :func:`bwbn_bayes.identify` has it:
        of a building the response is then linear about the joint optimum of parameters and force, which is searched.

    Returns
    -------
    pymc.Model
        Free variables are the identified parameters in their own units; ``measured`` (``measured_1`` and so on for
        several records) is observed, with dimensions channel and time. ``pm.set_data`` replaces ``measured_data``, the
        measured channels; noise priors and scheme stay those of the records.

    Raises
    ------
    UserError
        If a record does not belong to the model, a name is unknown, or a prior or noise has no twin in PyMC.

    Notes
    -----
    With integrated noise, ``pm.sample_posterior_predictive`` draws noise scales from their prior, not from what the
    record says of them: use :func:`complete`. ``pm.compute_log_likelihood`` has a value for each sample, whose sum
    is the log likelihood (:func:`~bwbn_bayes.inference.pymc.densities.sample_log_densities`).
    """
    several = [records] if isinstance(records, Record) else list(records)
    noises = _noises(noise, several)
    solver = engine_by_name(engine) if isinstance(engine, str) else engine
    require_parameters(model, name or "model")
    for record, own in zip(several, noises, strict=True):
        require_usable(model, record)
        for part in record.parts:
            require_whole(part)
        if unnamed_force:
            require_room_for_force(record, own)
        require_noise(own, record)
    solver, discretisations = fine_enough(model, several, noises, solver, fixed=not isinstance(engine, str))
    solvers: list[Engine] = [solver] * len(several)
    if unnamed_force:
        pairs = [beside_model(model, *pair, solver) for pair in zip(several, noises, strict=True)]
        solvers, noises = [engine for engine, _ in pairs], [noise for _, noise in pairs]
    problems = [
        forward_problem(model, record, own, noise.correlation)
        for record, own, noise in zip(several, solvers, noises, strict=True)
    ]
    given = dict(parameters or {})
    prefix = f"{name}_" if name else ""
    with pm.Model(name=name) as twin:
        values = _parameters(model, given, prefix)
        if model.space.constraints:
            mass = 0.0 if given else model.space.log_admissible_mass
            pm.Potential("admissible", LogAdmissible(problems[0])(values) - mass)
        for number, parts in enumerate(zip(problems, noises, discretisations, strict=True), start=1):
            _observe(values, *parts, f"_{number}" if len(several) > 1 else "", prefix)
    return twin


def _noises(noise: Noise | Sequence[Noise] | None, records: Sequence[Record]) -> list[Noise]:
    if not records:
        raise UserError("to_pymc was given no record: give at least one")
    if noise is None:
        return [default_noise(record) for record in records]
    noises = list(noise) if isinstance(noise, Sequence) else [noise]
    if len(noises) != len(records):
        raise UserError(f"{len(noises)} noise models for {len(records)} records: give one for each")
    return noises


def _parameters(model: Structure, given: dict[str, pt.TensorVariable], prefix: str) -> pt.TensorVariable:
    """Add the variables; return the identified parameters as one vector."""
    space = model.space
    groups = named_parameters(space.parameters)
    unknown = sorted(set(given) - {group.name for group in groups})
    if unknown:
        names = ", ".join(group.name for group in groups)
        raise UserError(f"parameters {', '.join(unknown)}: the model identifies {names}")
    columns: dict[int, pt.TensorVariable] = {}
    for group in groups:
        dims = _storey_dimension(model, group, prefix) if group.storeys else None
        priors = [space.parameters[i].prior for i in group.members]
        own = given.get(group.name)
        variable = prior_twin(group.name, priors, dims) if own is None else pt.as_tensor_variable(own)
        if variable.type.ndim != (1 if dims else 0):
            shape = f"a vector of {len(group.members)}" if dims else "a number"
            raise UserError(f"parameter {group.name} has {variable.type.ndim} dimensions: give {shape}")
        for place, member in enumerate(group.members):
            columns[member] = variable[place] if dims else variable
    return pt.stack([columns[i] for i in range(space.n_dim)])


def _storey_dimension(model: Structure, group: NamedParameters, prefix: str) -> str:
    everywhere = group.storeys == tuple(range(1, model.n_links + 1))
    dims = f"{prefix}storey" if everywhere else f"{prefix}storey_{group.name}"
    pm.modelcontext(None).add_coord(dims, group.storeys)
    return dims


def _observe(
    values: pt.TensorVariable,
    problem: ForwardProblem,
    noise: Noise,
    discretisation: Discretisation | None,
    suffix: str,
    prefix: str,
) -> None:
    """Add one record's likelihood."""
    twin = pm.modelcontext(None)
    dims = (f"{prefix}channel{suffix}", f"{prefix}time{suffix}")
    twin.add_coord(dims[0], problem.channels)
    twin.add_coord(dims[1], problem.record.times)
    noise_sd = None
    if isinstance(noise, SampledNoise):
        is_joined = len(problem.record.parts) > 1
        level = f"{prefix}level{suffix}" if is_joined else dims[0]
        twin.add_coord(level, problem.levels)
        noise_sd = prior_twin(f"noise_sd{suffix}", [p.prior for p in noise.parameters], level)
    elif not isinstance(noise, KnownNoise | IntegratedNoise):
        raise UserError(
            f"noise of kind {type(noise).__name__} has no PyMC twin: use known, sampled or integrated noise"
        )

    def log_density(measured: pt.TensorVariable, values: pt.TensorVariable, *sd: pt.TensorVariable) -> object:
        squares, residual = SquaredResiduals(problem)(values, measured), measured - ChannelResponse(problem)(values)
        total = noise_log_likelihood(noise, squares, counts(problem.record), *sd)
        return OfSamples()(total, sample_log_densities(noise, problem.record, residual, *sd))

    def predict(values: pt.TensorVariable, *sd_and_size: pt.TensorVariable) -> pt.TensorVariable:
        *sd, _ = sd_and_size
        scale = sd[0] if sd else _prior_noise_sd(noise)
        fresh = pm.Normal.dist(np.zeros(()), 1.0, shape=problem.measured.shape)
        return ChannelResponse(problem)(values) + _with_shared(spread(scale, problem.record) * fresh, noise)

    inputs = [values] if noise_sd is None else [values, noise_sd]
    cores = ["(p)"] if noise_sd is None else ["(p)", "(b)" if len(problem.record.parts) > 1 else "(c)"]
    data = pm.Data(f"measured_data{suffix}", problem.measured, dims=dims)
    variable = pm.CustomDist(
        f"measured{suffix}",
        *inputs,
        dist=predict,
        logp=log_density,
        signature=f"{','.join(cores)}->(c,t)",
        observed=data,
        dims=dims,
        class_name="Structure",
    )
    variable.tag.observation = Observation(
        problem=problem,
        noise=noise,
        values=values,
        noise_sd=noise_sd,
        dims=dims,
        data=data,
        discretisation=discretisation,
    )


def _with_shared(white: pt.TensorVariable, noise: Noise) -> pt.TensorVariable:
    """White errors ``(n_channels, n_times)`` with what a force adds to them in its prior."""
    shared = None if noise.correlation is None else noise.correlation.shared
    if shared is None or shared.level is None:
        return white
    return turned(white, shared, np.sqrt(1.0 + shared.variance))


def _prior_noise_sd(noise: Noise) -> pt.TensorVariable:
    """Noise scales ``(n_blocks,)`` for predictions."""
    if isinstance(noise, IntegratedNoise):
        return pt.sqrt(1.0 / pm.Gamma.dist(np.asarray(noise.shape), np.asarray(noise.scale)))
    assert isinstance(noise, KnownNoise)
    return pt.as_tensor_variable(np.asarray(noise.sd))


def observations(twin: pm.Model) -> dict[str, Observation]:
    """The records inside a PyMC model, by the name of their variable."""
    return {rv.name: rv.tag.observation for rv in twin.observed_RVs if hasattr(rv.tag, "observation")}


def draws_of(twin: pm.Model, tree: xr.DataTree, wanted: pt.TensorVariable) -> Floats:
    """Values ``(n_draws, ...)`` of an expression of the free variables, chains one after another."""
    stacked = tree["posterior"].dataset.stack(sample=("chain", "draw")).transpose("sample", ...)
    inputs = {rv: pt.tensor(dtype=rv.dtype, shape=(None, *rv.type.shape)) for rv in twin.free_RVs}
    batched = vectorize_graph(wanted, inputs)
    function = pytensor.function(list(inputs.values()), batched, on_unused_input="ignore")
    arrays = [np.asarray(stacked[rv.name].values, dtype=rv.dtype) for rv in twin.free_RVs]
    return np.asarray(function(*arrays))


def complete(tree: xr.DataTree, twin: pm.Model, *, rng: np.random.Generator, most: int = 1000) -> xr.DataTree:
    """Add pointwise log likelihoods and predictions with noise to posterior draws.

    Noise scales that the likelihood integrates out are drawn back from their posterior given each draw. Samples are
    independent given draw and scales, so ``az.loo`` applies; of autoregressive errors each given those before it.

    Parameters
    ----------
    tree : DataTree
        With a posterior group, as PyMC returns it.
    twin : pymc.Model
        Made by :func:`to_pymc`.
    rng : numpy.random.Generator
        For scales and noise.
    most : int
        Draws kept, evenly spaced in each chain; every one costs a solve and a response in memory.

    Returns
    -------
    DataTree
        A copy with at most that many draws, the groups ``log_likelihood`` and ``posterior_predictive``, and units as
        attributes of parameters, noise scales and replicates.
    """
    chains, draws = (tree["posterior"].sizes[dimension] for dimension in ("chain", "draw"))
    step = max(1, int(np.ceil(chains * draws / most)))
    groups = {
        path: node.dataset.isel(draw=slice(None, None, step)) if {"chain", "draw"} <= set(node.dims) else node.dataset
        for path, node in tree.children.items()
    }
    thinned = xr.DataTree.from_dict(groups)
    pointwise, replicates = xr.Dataset(), xr.Dataset()
    for name, observation in observations(twin).items():
        drawn = draws_of(twin, thinned, _inputs_of(observation))
        density, replicate = _predictions(observation, drawn, rng)
        if observation.discretisation is None:
            require_fine_enough(observation.problem, observation.noise, drawn[np.argmax(density.sum(axis=(1, 2)))])
        dims = ("chain", "draw", *observation.dims)
        shape = (chains, -1, *density.shape[1:])
        coords = dict(
            zip(observation.dims, (list(observation.problem.channels), observation.problem.record.times), strict=True)
        )
        pointwise = pointwise.assign({name: (dims, density.reshape(shape))}).assign_coords(coords)
        units = units_of(observation.problem.record)
        replicates = replicates.assign({name: (dims, replicate.reshape(shape), units)}).assign_coords(coords)
        _state_units(thinned.children["posterior"], name, observation)
    posterior = thinned["posterior"].dataset
    kept = {dimension: posterior[dimension] for dimension in ("chain", "draw")}
    thinned["log_likelihood"] = xr.DataTree(pointwise.assign_coords(kept))
    thinned["posterior_predictive"] = xr.DataTree(replicates.assign_coords(kept))
    return thinned


def _state_units(posterior: xr.DataTree, name: str, observation: Observation) -> None:
    """Of one record's variables; a model with a name has it before each, and a caller's own variables have none."""
    head, _, last = name.rpartition("::")
    scope, suffix = f"{head}::" if head else "", last.removeprefix("measured")
    parameters = observation.problem.model.space.parameters
    units = {f"{scope}{one.name}": parameters[one.members[0]].unit for one in named_parameters(parameters)}
    units[f"{scope}noise_sd{suffix}"] = units_of(observation.problem.record)["units"]
    for own, unit in units.items():
        if own in posterior.data_vars:
            posterior[own].attrs["units"] = unit


def _inputs_of(observation: Observation) -> pt.TensorVariable:
    parts = [observation.values] if observation.noise_sd is None else [observation.values, observation.noise_sd]
    return pt.concatenate(parts)


def _predictions(observation: Observation, draws: Floats, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Pointwise log density and noisy responses, ``(n_draws, n_channels, n_times)``."""
    problem, record = observation.problem, observation.problem.record
    values, noise_values = np.split(draws, [problem.model.space.n_dim], axis=1)
    response = problem.response(values)
    measured = np.asarray(observation.data.get_value())
    n_times = counts(record)
    misfit = problem.squared_residuals(values, measured)
    sd = over_time(record, observation.noise.draw_sd(rng, misfit, n_times, noise_values))
    residual = measured - response
    correlation, volumes = problem.correlation, np.zeros(measured.shape)
    noise = sd * rng.standard_normal(response.shape)
    if correlation is not None and correlation.shared is not None:
        # Given what is expected of the force.
        shared = correlation.shared
        residual = shared.turned(residual, 1.0 / (1.0 + shared.variance))
        response = measured - residual
    elif correlation is not None:
        residual, noise = correlation.whitened(residual), correlation.coloured(noise)
        volumes = log_volumes(observation.noise, record)
    is_measured, scale = sd > 0.0, np.where(sd > 0.0, sd, 1.0)
    density = np.where(is_measured, -0.5 * np.square(residual / scale) - np.log(scale) - 0.5 * _LOG_2PI + volumes, 0.0)
    return density, response + noise
