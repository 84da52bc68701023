"""PyMC's samplers as roads of :func:`~bwbn_bayes.inference.identify.identify`: a posterior in, unit-cube draws out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
import xarray as xr

from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.pymc.coordinates import NormalCoordinates
from bwbn_bayes.inference.pymc.model import named_parameters, to_pymc
from bwbn_bayes.inference.pymc.nuts import Sampler, convergence, sample_nuts
from bwbn_bayes.inference.pymc.smc import KernelName, SmcRun, sample_smc
from bwbn_bayes.inference.summary import Draws
from bwbn_bayes.parameters import Floats, ParameterSpace
from bwbn_bayes.results import Check, StageFacts

N_CHAINS = 2
R_HAT_LIMIT = 1.01
DIVERGENT_LIMIT = 0.01
"""Share of divergent trajectories above which NUTS is called unfit."""
SPREAD_LIMIT = 1.0
"""Largest difference between the log evidences of two chains. [nat]"""
_TUNE = 100
"""Draws in which the length of a step is found; all else is known from the fit."""

Say = Callable[[str, StageFacts | None], None]


class Road(NamedTuple):
    """What a sampler brings home: draws, log evidences with errors by road, checks of itself."""

    draws: Draws
    evidences: dict[str, tuple[float, float]]
    checks: tuple[Check, ...]


def sample_road(
    posterior: Posterior,
    modes: Sequence[Mode],
    *,
    method: Literal["smc", "nuts"],
    plain: bool,
    sampler: Sampler,
    particles: int,
    seed: int,
    say: Say,
) -> Road:
    """Sample a posterior with PyMC.

    Parameters
    ----------
    posterior : Posterior
        At its final scheme.
    modes : sequence of Mode
        Best first; NUTS moves in coordinates about it, SMC starts from the prior.
    method : {"smc", "nuts"}
        Which sampler.
    plain : bool
        SMC with PyMC's own kernel instead of the batched one.
    sampler : {"pymc", "nutpie"}
        Whose NUTS.
    particles : int
        Draws wanted, over all chains.
    seed : int
        The run is a function of it.
    say : callable
        Told what is being done.
    """
    draws = max(particles // N_CHAINS, 8 * (posterior.n_dim + 1))
    if method == "smc":
        return _by_smc(posterior, draws, plain, seed, say)
    say(f"sampling by NUTS of {sampler}", None)
    coordinates = NormalCoordinates.at(posterior, modes[0].point)
    run = sample_nuts(coordinates, sampler=sampler, draws=draws, tune=_TUNE, chains=N_CHAINS, seed=seed)
    posterior.solves.add(run.n_solves)
    points = coordinates.points(run.coordinates.reshape(-1, posterior.n_dim))
    r_hat, effective = convergence(points.reshape(run.coordinates.shape), posterior.space.names)
    checks = _nuts_checks(run.n_divergences, len(points), r_hat)
    return Road(_draws(posterior, points, effective), {}, checks)


def _by_smc(posterior: Posterior, draws: int, plain: bool, seed: int, say: Say) -> Road:
    twin = to_pymc(posterior.model, posterior.record, noise=posterior.noise, engine=posterior.engine)
    kernel: KernelName = "imh" if plain else "batched"
    say(f"sampling by PyMC's sequential Monte Carlo, kernel {kernel}", None)
    run = sample_smc(twin, draws=draws, chains=N_CHAINS, seed=seed, kernel=kernel, listener=_stage_listener(say))
    posterior.solves.add(run.n_solves)
    points = posterior.space.to_unit(values_of(run.tree, posterior.space))
    return Road(_draws(posterior, points, run.effective_sample_size), _evidences(run), (_spread_check(run),))


def values_of(tree: xr.DataTree, space: ParameterSpace) -> Floats:
    """Identified parameters ``(n_draws, n_dim)`` in their own units, chains one after another."""
    stacked = tree["posterior"].dataset.stack(sample=("chain", "draw")).transpose("sample", ...)
    values = np.empty((stacked.sizes["sample"], space.n_dim))
    n_noise = 0
    for group in named_parameters(space.parameters):
        if group.name.startswith("noise_sd["):
            values[:, group.members[0]] = stacked["noise_sd"].values[:, n_noise]
            n_noise += 1
        else:
            columns = np.asarray(stacked[group.name].values)
            values[:, group.members] = columns if group.storeys else columns[:, None]
    return values


def _draws(posterior: Posterior, points: Floats, effective: float) -> Draws:
    return Draws(
        points=points,
        log_likelihood=posterior.log_likelihood(points),
        weighted_points=points,
        weights=np.full(len(points), 1.0 / len(points)),
        effective_sample_size=effective,
    )


def _stage_listener(say: Say) -> Callable[[Mapping[str, float]], None]:
    chain, past = 0, 1.0

    def tell(facts: Mapping[str, float]) -> None:
        nonlocal chain, past
        chain += facts["beta"] < past or past == 1.0
        past = facts["beta"]
        label = f"PyMC SMC, chain {chain}"
        say(
            f"{label}, tempering parameter {past:.3g}",
            StageFacts(
                stage=0,
                tempering_parameter=past,
                acceptance=facts["accept_rate"],
                effective_sample_size=facts["effective_sample_size"],
                n_solves=int(facts["n_solves"]),
                log_evidence=facts["log_marginal_likelihood"],
                elapsed_s=0.0,
                label=label,
            ),
        )

    return tell


def _evidences(run: SmcRun) -> dict[str, tuple[float, float]]:
    chains = {f"smc (chain {i})": (float(value), float("nan")) for i, value in enumerate(run.log_evidences, start=1)}
    return {"smc": (run.log_evidence, run.log_evidence_se), **chains}


def _spread_check(run: SmcRun) -> Check:
    spread = float(np.ptp(run.log_evidences))
    return Check(
        name="chains agree",
        value=spread,
        limit=SPREAD_LIMIT,
        passed=spread < SPREAD_LIMIT,
        sentence=(
            f"The log evidences of {len(run.log_evidences)} chains lie within {spread:.2f} nats; tempering from the "
            "prior is known to fall short on long records, all chains alike."
        ),
    )


def _nuts_checks(n_divergences: int, n_draws: int, r_hat: float) -> tuple[Check, ...]:
    share = n_divergences / n_draws
    unfit = (
        "" if share <= DIVERGENT_LIMIT else ": the likelihood is not smooth enough for NUTS, take importance or tmcmc"
    )
    return (
        Check(
            name="divergences",
            value=share,
            limit=DIVERGENT_LIMIT,
            passed=share <= DIVERGENT_LIMIT,
            sentence=f"{n_divergences} of {n_draws} trajectories diverged{unfit}.",
        ),
        Check(
            name="R-hat",
            value=r_hat,
            limit=R_HAT_LIMIT,
            passed=r_hat < R_HAT_LIMIT,
            sentence=f"The largest R-hat is {r_hat:.3f}.",
        ),
    )
