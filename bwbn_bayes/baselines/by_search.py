"""A genetic algorithm as a method: one point, no posterior."""

from __future__ import annotations

import time

import numpy as np

from bwbn_bayes.baselines.genetic import Generation, GeneticSettings, search
from bwbn_bayes.baselines.outcome import genetic_result
from bwbn_bayes.engines.available import engine as engine_by_name
from bwbn_bayes.engines.base import require_parameters, require_usable
from bwbn_bayes.engines.journal import kept
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.accuracy import LADDER, on_rung
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.method import Task
from bwbn_bayes.records.record import require_whole
from bwbn_bayes.results import Result, StageFacts

_SEARCH, _FINAL = LADDER[0], LADDER[-3]
"""Schemes for the generations and for the response of the best individual."""


class BySearch:
    """The best individual of a genetic algorithm; its options are :class:`GeneticSettings`."""

    def identify(self, task: Task) -> Result:
        """Search, and solve the best individual finely."""
        genetic = GeneticSettings() if task.options is None else task.options
        if not isinstance(genetic, GeneticSettings):
            raise UserError(f"the options of method ga are GeneticSettings, not {type(genetic).__name__}")
        model, record, settings, name, listener = task.model, task.record, task.settings, task.name, task.listener
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
            assumptions=task.assumptions,
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
