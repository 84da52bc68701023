"""The No-U-Turn sampler on a structure, started from the Laplace fit.

Exact tangents make the gradient; the posterior of a long record is narrow and tilted, so the metric comes from the fit
rather than from adaptation. The log likelihood has kinks where a drift rate changes sign or a slip begins: where they
matter the sampler diverges, and the result says so.

References
----------
.. [1] M. D. Hoffman and A. Gelman, "The No-U-Turn Sampler", J. Machine Learning Research 15, 2014.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import arviz_stats
import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import xarray as xr
from pymc.step_methods.hmc.quadpotential import QuadPotentialFull
from pytensor.graph.replace import vectorize_graph

from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.pymc.model import named_parameters
from bwbn_bayes.inference.pymc.smc import quiet
from bwbn_bayes.inference.truncated import TruncatedStudent
from bwbn_bayes.parameters import Floats, ParameterSpace

Sampler = Literal["pymc", "nutpie"]
_N_LAPLACE = 4000


@dataclass(frozen=True, kw_only=True)
class LaplaceStart:
    """Where the chains start and how the posterior is shaped, in PyMC's unconstrained coordinates.

    Attributes
    ----------
    points : tuple of mappings
        One start for each chain, variables in their own units.
    covariance : (n_dim, n_dim) array
    """

    points: tuple[Mapping[str, Floats], ...]
    covariance: Floats


@dataclass(frozen=True, kw_only=True)
class NutsRun:
    """Draws of NUTS and what they say of themselves.

    Attributes
    ----------
    tree : DataTree
        Posterior and sample statistics.
    n_divergences : int
        Trajectories whose energy error exploded.
    worst_r_hat, least_ess : float
        Over all parameters; rank-normalised, bulk.
    n_solves : int
        Gradient evaluations after warm-up (two solves each: value and slopes).
    """

    tree: xr.DataTree
    n_divergences: int
    worst_r_hat: float
    least_ess: float
    n_solves: int


def laplace_start(
    twin: pm.Model, space: ParameterSpace, mode: Mode, chains: int, rng: np.random.Generator
) -> LaplaceStart:
    """Starts and metric from a mode of the posterior on the unit cube.

    The Laplace approximation, truncated to the cube, is sampled and carried through the transforms of the PyMC model;
    its moments there are the metric, whatever the priors.

    Parameters
    ----------
    twin : pymc.Model
        Made by :func:`~bwbn_bayes.inference.pymc.model.to_pymc` from one record.
    space : ParameterSpace
        Of the posterior that the mode belongs to, noise parameters included.
    mode : Mode
        Its best mode.
    chains : int
        Starts wanted.
    rng : numpy.random.Generator
        Random stream.
    """
    laplace = TruncatedStudent.at(mode.point, mode.gradient, mode.information)
    points = np.clip(laplace.sample(rng, _N_LAPLACE), 1e-6, 1.0 - 1e-6)
    points = points[space.admissible(space.from_unit(points))]
    values = by_variable(twin, space, space.from_unit(points))
    unconstrained = np.concatenate([column.reshape(len(points), -1) for column in _unconstrained(twin, values)], axis=1)
    starts = tuple({name: column[i] for name, column in values.items()} for i in range(chains))
    covariance = np.atleast_2d(np.cov(unconstrained.T))
    return LaplaceStart(points=starts, covariance=covariance)


def by_variable(twin: pm.Model, space: ParameterSpace, values: Floats) -> dict[str, Floats]:
    """Values ``(n, n_dim)`` of the identified parameters as arrays by free variable, ``(n, ...)`` each."""
    free = {rv.name for rv in twin.free_RVs}
    result: dict[str, Floats] = {}
    for group in named_parameters(space.parameters):
        columns = values[:, group.members]
        if group.name in free:
            result[group.name] = columns if group.storeys else columns[:, 0]
        elif not group.name.startswith("noise_sd["):
            result |= {f"{group.name}_{i + 1}": columns[:, i] for i in range(columns.shape[1])}
    noise = values[:, [i for i, name in enumerate(space.names) if name.startswith("noise_sd[")]]
    if "noise_sd" in free:
        result["noise_sd"] = noise
    else:  # priors of several kinds are variables of their own
        result |= {f"noise_sd_{i + 1}": column for i, column in enumerate(noise.T)}
    return result


def _unconstrained(twin: pm.Model, values: Mapping[str, Floats]) -> list[Floats]:
    """The values in the coordinates that PyMC samples, in the order of its value variables."""
    result = []
    for rv in twin.free_RVs:
        transform = twin.rvs_to_transforms[rv]
        column = np.asarray(values[rv.name])
        if transform is not None:
            x = rv.type()
            batch = pt.tensor(dtype=rv.dtype, shape=(None, *rv.type.shape))
            forward = vectorize_graph(transform.forward(x, *rv.owner.inputs), {x: batch})
            column = pytensor.function([batch], forward, on_unused_input="ignore")(column)
        result.append(np.asarray(column))
    return result


def sample_nuts(
    twin: pm.Model,
    start: LaplaceStart,
    *,
    sampler: Sampler = "pymc",
    draws: int = 1000,
    tune: int = 500,
    chains: int = 2,
    seed: int,
) -> NutsRun:
    """Sample with PyMC's own NUTS under the Laplace metric, or with nutpie, which adapts a metric of its own.

    Chains of PyMC run one after another in this process, each from a start of its own; those of nutpie on threads, all
    from the first start. Nothing is forked.

    Parameters
    ----------
    twin : pymc.Model
        Made by :func:`~bwbn_bayes.inference.pymc.model.to_pymc`.
    start : LaplaceStart
        Starts and metric.
    sampler : {"pymc", "nutpie"}
        Whose implementation.
    draws, tune, chains : int
        Draws kept and warm-up draws of each chain, number of chains.
    seed : int
        The run is a function of it.
    """
    if sampler == "nutpie":
        tree = _nutpie(twin, start, draws, tune, chains, seed)
    else:
        tree = _pymc(twin, start, draws, tune, chains, seed)
    return _facts(tree)


def _pymc(
    twin: pm.Model,
    start: LaplaceStart,
    draws: int,
    tune: int,
    chains: int,
    seed: int,
) -> xr.DataTree:
    with twin, quiet():
        step = pm.NUTS(potential=QuadPotentialFull(start.covariance), target_accept=0.9)
        tree: xr.DataTree = pm.sample(
            draws=draws,
            tune=tune,
            chains=chains,
            cores=1,
            step=step,
            initvals=list(start.points[:chains]),
            random_seed=seed,
            progressbar=False,
            compute_convergence_checks=False,
            nuts_sampler="pymc",
        )
    return tree


def _nutpie(twin: pm.Model, start: LaplaceStart, draws: int, tune: int, chains: int, seed: int) -> xr.DataTree:
    # Imported here: it is an extra of its own, with 170 MB of pyarrow.
    import nutpie

    compiled = nutpie.compile_pymc_model(twin, initial_points=dict(start.points[0]), jitter_rvs=set())
    tree: xr.DataTree = nutpie.sample(
        compiled,
        draws=draws,
        tune=tune,
        chains=chains,
        cores=chains,
        seed=seed,
        adaptation="low_rank",
        progress_bar=False,
        save_warmup=False,
    )
    return tree


def _facts(tree: xr.DataTree) -> NutsRun:
    posterior, statistics = tree["posterior"].dataset, tree["sample_stats"].dataset
    r_hat, ess = arviz_stats.rhat(posterior), arviz_stats.ess(posterior)
    return NutsRun(
        tree=tree,
        n_divergences=int(statistics["diverging"].sum()),
        worst_r_hat=max(float(value.max()) for value in r_hat.data_vars.values()),
        least_ess=min(float(value.min()) for value in ess.data_vars.values()),
        n_solves=int(statistics["n_steps"].sum()),
    )
