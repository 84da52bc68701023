"""The two baselines as methods: what a search or networks find, as a result."""

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
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.settings import Settings
from bwbn_bayes.inference.summary import provenance_of
from bwbn_bayes.records.record import Record, require_whole
from bwbn_bayes.results import Result, StageFacts
from bwbn_bayes.structures.structure import Structure

_SEARCH, _FINAL = LADDER[0], LADDER[5]
"""Schemes for the generations and for the response of the best individual."""


def identify_by_search(
    model: Structure,
    record: Record,
    settings: Settings,
    genetic: GeneticSettings,
    name: str,
    assumptions: Sequence[str],
    listener: Listener | None,
) -> Result:
    """One point by a genetic algorithm; arguments as for :func:`bwbn_bayes.identification.identify`."""
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


def identify_by_networks(
    model: Structure,
    record: Record,
    settings: Settings,
    variant: Variant,
    name: str,
    assumptions: Sequence[str],
    listener: Listener | None,
) -> Result:
    """Forces by networks; arguments as for :func:`bwbn_bayes.identification.identify`."""
    if model.is_driven:
        raise UserError("IPV needs a ShearBuilding: in a specimen the force is measured, there is none to learn")
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
