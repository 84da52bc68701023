"""One door to every method: the two baselines here, the samplers in the room below."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from bwbn_bayes.baselines.genetic import Generation, GeneticSettings, search
from bwbn_bayes.baselines.ipv import Variant, fit_forces
from bwbn_bayes.baselines.outcome import forces_result, genetic_result
from bwbn_bayes.engines.available import engine as engine_by_name
from bwbn_bayes.engines.base import masses, require_parameters, require_usable
from bwbn_bayes.engines.journal import kept
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.accuracy import LADDER, on_rung
from bwbn_bayes.inference.history import Listener
from bwbn_bayes.inference.identify import identify as identify_by_sampling
from bwbn_bayes.inference.likelihood import Noise, Posterior, default_noise
from bwbn_bayes.inference.settings import Settings
from bwbn_bayes.inference.summary import provenance_of
from bwbn_bayes.records.record import Record, require_whole
from bwbn_bayes.results import Result, StageFacts
from bwbn_bayes.structures.structure import Structure

_SEARCH, _FINAL = LADDER[0], LADDER[5]
"""Schemes for the generations and for the response of the best individual."""


def identify(
    model: Structure,
    record: Record,
    *,
    settings: Settings | None = None,
    noise: Noise | None = None,
    genetic: GeneticSettings | None = None,
    ipv: Variant = "printed",
    name: str = "model",
    assumptions: Sequence[str] = (),
    listener: Listener | None = None,
) -> Result:
    """Identify a model from a record by any method.

    Parameters
    ----------
    model : Structure
        With priors on the parameters to identify. IPV uses its masses only.
    record : Record
        Measured channels under one excitation.
    settings : Settings, optional
        Method, engine, seed, number of draws.
    noise : Noise, optional
        How the noise scale enters a posterior; the baselines have none.
    genetic : GeneticSettings, optional
        Options of ``ga``; the paper's by default.
    ipv : {"printed", "drift"}
        Inputs of ``ipv``.
    name : str
        The model's name in reports.
    assumptions : sequence of str
        What the model takes for granted; printed in the report.
    listener : callable, optional
        Told what is being done.

    Returns
    -------
    Result
        ``ga`` gives one point, ``ipv`` forces only, the others a posterior.

    Raises
    ------
    UserError
        If nothing is to be identified, the record measures nothing, or record and model do not belong together.
    """
    settings = settings or Settings()
    if settings.method == "ga":
        return _by_search(model, record, settings, genetic or GeneticSettings(), name, assumptions, listener)
    if settings.method == "ipv":
        return _by_networks(model, record, settings, ipv, name, assumptions, listener)
    return identify_by_sampling(
        model, record, settings=settings, noise=noise, name=name, assumptions=assumptions, listener=listener
    )


def _by_search(
    model: Structure,
    record: Record,
    settings: Settings,
    genetic: GeneticSettings,
    name: str,
    assumptions: Sequence[str],
    listener: Listener | None,
) -> Result:
    require_parameters(model, name)
    require_usable(model, record)
    require_whole(record)
    began = time.perf_counter()
    stages: list[StageFacts] = []

    def tell(generation: Generation) -> None:
        stages.append(_stage(generation, genetic.generations, time.perf_counter() - began))
        if listener is not None:
            listener(f"generation {generation.number}, best objective {generation.best:.4g}", stages[-1])

    if listener is not None:
        listener("searching by a genetic algorithm", None)
    engine = engine_by_name(settings.engine)
    rng = np.random.default_rng(settings.seed)
    with kept(engine, settings.checkpoint) as keeping:
        fit = search(model, record, on_rung(keeping, _SEARCH), rng, genetic, progress=tell)
    elapsed = time.perf_counter() - began
    posterior = Posterior(model=model, record=record, engine=on_rung(engine, _FINAL), noise=default_noise(record))
    return genetic_result(
        posterior,
        fit,
        settings=genetic,
        seed=settings.seed,
        name=name,
        assumptions=assumptions,
        stages=tuple(stages),
        elapsed_s=elapsed,
    )


def _stage(generation: Generation, last: int, elapsed_s: float) -> StageFacts:
    return StageFacts(
        stage=generation.number,
        tempering_parameter=generation.number / last,
        acceptance=float("nan"),
        effective_sample_size=float("nan"),
        n_solves=generation.n_solves,
        log_evidence=float("nan"),
        elapsed_s=elapsed_s,
        label=f"objective: best {generation.best:.4g}, median {generation.median:.4g}; spread {generation.spread:.3f}",
    )


def _by_networks(
    model: Structure,
    record: Record,
    settings: Settings,
    variant: Variant,
    name: str,
    assumptions: Sequence[str],
    listener: Listener | None,
) -> Result:
    if model.is_driven:
        raise UserError("IPV needs a ShearBuilding: in a specimen the force is measured, there is none to learn")
    if not model.is_chain or record.forces:
        raise UserError(
            "IPV needs storeys alone under a moving ground: it cannot tell a brace or an applied force apart"
        )
    require_usable(model, record)
    require_whole(record)
    if listener is not None:
        listener("training a radial basis network for each storey", None)
    began = time.perf_counter()
    fit = fit_forces(record, masses(model), np.random.default_rng(settings.seed), variant=variant)
    elapsed = time.perf_counter() - began
    return forces_result(
        model,
        record,
        fit,
        seed=settings.seed,
        name=name,
        assumptions=assumptions,
        provenance=provenance_of(record, settings.seed, engine_by_name(settings.engine)),
        elapsed_s=elapsed,
    )
