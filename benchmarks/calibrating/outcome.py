"""What an identification said of a truth: ranks, coverage, which method ran, how it judged itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr

from benchmarks.calibrating.records import Replicate
from bwbn_bayes import Record, Result
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.structures.structure import Structure

LOG_LIKELIHOOD = "log likelihood"
"""A quantity to rank beside the parameters: a sampler that returns the prior ranks those alone rightly."""
_FINE = Lanes(substeps=8, resolution=0.03)
_N_RANKED = 100


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """One replicate.

    Attributes
    ----------
    method : str
        That ran in the end; ``none`` where no posterior came of it, and no quantity has a rank.
    ranks : mapping of str to float
        Share of posterior draws below the truth, by quantity.
    z : mapping of str to float
        Posterior mean less truth, in posterior standard deviations.
    covered : mapping of str to bool
        Whether the truth lies in the 90 % interval.
    checks : mapping of str to tuple
        Value and whether it passed, by the name of the check.
    grade : str
        What the result says of the model.
    effective : float
        Draws the posterior is worth.
    log_evidence, log_evidence_se : float
        [nat]
    elapsed_s : float
    processor_s : float
        Of all threads, which others on the machine do not lengthen.
    """

    method: str
    ranks: Mapping[str, float]
    z: Mapping[str, float]
    covered: Mapping[str, bool]
    checks: Mapping[str, tuple[float, bool]]
    grade: str
    effective: float
    log_evidence: float
    log_evidence_se: float
    elapsed_s: float
    processor_s: float


def judged(result: Result, made: Replicate, seed: int, processor_s: float) -> Outcome:
    """Compare a result with the truth behind its record; parameters that the truth lacks are left out."""
    model, record, truth = made.model, made.record, made.truth
    facts, draws = result.facts, result.tree["posterior"].dataset
    rng = np.random.default_rng(seed)
    known = {p.name: p for p in facts.parameters if p.name in truth}
    columns = {name: draws_of(draws, name) for name in known}
    ranks = {name: float(np.mean(columns[name] < truth[name])) for name in known}
    if set(truth) == set(model.space.names) == set(known):
        ranks[LOG_LIKELIHOOD] = _likelihood_rank(model, record, truth, columns, rng)
    return Outcome(
        method=facts.method,
        ranks=ranks,
        z={name: (p.mean - truth[name]) / p.sd for name, p in known.items() if p.sd > 0.0},
        covered={name: p.hdi90[0] <= truth[name] <= p.hdi90[1] for name, p in known.items()},
        checks={check.name: (check.value, check.passed) for check in facts.checks},
        grade=facts.grade,
        effective=facts.effective_sample_size,
        log_evidence=facts.log_evidence,
        log_evidence_se=facts.log_evidence_se,
        elapsed_s=facts.elapsed_s,
        processor_s=processor_s,
    )


def not_identified(processor_s: float) -> Outcome:
    """A truth of which ``identify`` gave no posterior."""
    unknown = float("nan")
    return Outcome(
        method="none",
        ranks={},
        z={},
        covered={},
        checks={},
        grade="not identified",
        effective=0.0,
        log_evidence=unknown,
        log_evidence_se=unknown,
        elapsed_s=unknown,
        processor_s=processor_s,
    )


def draws_of(draws: xr.Dataset, name: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Draws ``(n,)`` of a parameter by its label, ``k[2]`` of ``k (chain, draw, storey)`` or ``c[1,2]`` of its own."""
    if name in draws:
        array = draws[name]
    else:
        symbol, _, place = name.partition("[")
        array = draws[symbol]
        array = array.sel({array.dims[-1]: int(place.rstrip("]"))})
    return np.asarray(array.values.ravel(), dtype=np.float64)


def _likelihood_rank(
    model: Structure,
    record: Record,
    truth: Mapping[str, float],
    columns: Mapping[str, np.ndarray[tuple[int, ...], np.dtype[np.float64]]],
    rng: np.random.Generator,
) -> float:
    """Share of draws that are less likely than the truth, all solved finely."""
    posterior = Posterior(model=model, record=record, engine=_FINE, noise=default_noise(record))
    table = np.stack([columns[name] for name in model.space.names], axis=1)
    chosen = table[rng.choice(len(table), min(_N_RANKED, len(table)), replace=False)]
    values = np.concatenate([[[truth[name] for name in model.space.names]], chosen])
    found = posterior.log_likelihood(posterior.space.to_unit(values))
    return float(np.mean(found[1:] < found[0]))
