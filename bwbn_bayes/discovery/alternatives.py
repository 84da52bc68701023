"""A standing check of every identification: what of the catalogue would explain the record better.

The projected scores (:mod:`bwbn_bayes.discovery.score`) of every effect at every place say to first order what a small
amount of it would gain that the model's own parameters cannot. No effect is added; that is for ``discover``.
"""

from __future__ import annotations

import numpy as np

from bwbn_bayes.discovery.candidates import hypotheses, scales_of
from bwbn_bayes.discovery.run import on_one_thread
from bwbn_bayes.discovery.score import scores
from bwbn_bayes.discovery.workers import ONE_THREAD, Threads, Workers
from bwbn_bayes.elements.catalogue import capital
from bwbn_bayes.engines.lanes import ALONE, Lanes
from bwbn_bayes.inference.likelihood import KnownNoise, Posterior
from bwbn_bayes.inference.residuals import heard_rests
from bwbn_bayes.parameters import Floats
from bwbn_bayes.results import DOUBTS, Check

ALTERNATIVES = DOUBTS[2]
_TELLS_SIZES = frozenset({"k", "c", "alpha", "A", "beta", "gamma", "n"})
_CHANCE = 0.02
"""Of n directions of noise one scores ``log(n / 0.02)`` nats with a probability of less than half a per cent."""
_AS_WELL = 2.0
"""A second effect is named beside the first where it is worth as much, to so many nats."""


def alternatives_check(posterior: Posterior, point: Floats) -> tuple[Check, ...]:
    """What the best of the catalogue's effects would be worth at the model's best fit.

    Parameters
    ----------
    posterior : Posterior
        Of the model.
    point : (n_dim,) array
        Its optimum in the unit cube.

    Returns
    -------
    tuple of Check
        Its value is the largest score [nat]; the limit grows with the number of effects asked. None where no storey
        follows Bouc and Wen: the catalogue's sizes are told from their parameters.
    """
    record = posterior.record
    if not {p.symbol for p in posterior.model.parameters} >= _TELLS_SIZES:
        return ()
    if posterior.noise.parameters:  # sampled: at the optimum it is a known one
        noise_sd = posterior.split(point[None])[1][0].tolist()
        posterior, point = posterior.with_noise(KnownNoise(sd=tuple(noise_sd))), point[: posterior.model.space.n_dim]
    found = hypotheses(
        posterior.model,
        scales_of(posterior, point),
        measured=tuple(record.channels),
        has_time=record.has_time,
        in_one_go=len(record.runs) == 1,
        most_carried=np.inf,
    )
    limit = float(np.log(max(len(found), 1) / _CHANCE))
    heard = found if heard_rests(posterior, point) else ()
    view, workers = _asking(posterior)
    scored = scores(view, heard, point, workers=workers) if heard else ()
    ranked = sorted(zip(scored, heard, strict=True), key=lambda pair: -pair[0].nats)
    if not ranked:
        return _check(0.0, limit, "Nothing is left that an effect of the catalogue could explain.")
    best, hypothesis = ranked[0]
    if best.nats <= limit:
        return _check(best.nats, limit, f"No effect of the catalogue would gain more than {best.nats:.1f} nats.")
    amount = f"{best.amplitude} near {_near(hypothesis.neutral(best.amplitude), best.size)}"
    amount += f" {best.unit}" if best.unit else ""
    sentence = f"{capital(hypothesis.label)} ({amount}) would explain more: worth {best.nats:.0f} nats to first order."
    other = next((pair for pair in ranked[1:] if pair[1].name != hypothesis.name), None)
    if other is not None and other[0].nats > best.nats - _AS_WELL:
        sentence += f" So would {other[1].label}."
    return _check(best.nats, limit, sentence)


def _near(neutral: float, size: float) -> str:
    """The amplitude so far from neutral, with two digits of how far that is."""
    return f"{round(neutral + size, 1 - int(np.floor(np.log10(abs(size))))):g}"


def _asking(posterior: Posterior) -> tuple[Posterior, Workers]:
    """Who solves for the scores: most families fill a block of lanes, so that threads take families, not blocks."""
    engine = posterior.engine
    if not isinstance(engine, Lanes):
        return posterior, ONE_THREAD
    # An engine that spreads or keeps what it solves is asked one thing at a time.
    together = type(engine) is Lanes and not ALONE.get()
    return on_one_thread(posterior), Threads(engine.n_threads) if together else ONE_THREAD


def _check(nats: float, limit: float, sentence: str) -> tuple[Check, ...]:
    return (Check(name=ALTERNATIVES, value=nats, limit=limit, passed=nats <= limit, sentence=sentence),)
