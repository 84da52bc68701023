"""A discovery from end to end: fit, look where it disagrees, search, weigh, and say what was found.

Search and probabilities see the training record alone; what is held out is predicted at the end, before and after, and
chooses nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Thread
from typing import Literal

import numpy as np
from threadpoolctl import threadpool_limits

from bwbn_bayes.discovery.binding import Binding
from bwbn_bayes.discovery.candidates import Hypothesis, hypotheses, moment_of_share, sharing_laws, symbols_of
from bwbn_bayes.discovery.conclusion import conclude
from bwbn_bayes.discovery.evidence import laplace
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.held_out import set_apart
from bwbn_bayes.discovery.outcome import Discovery
from bwbn_bayes.discovery.pool import Pool
from bwbn_bayes.discovery.run import DiscoverySettings, Listener, Run
from bwbn_bayes.discovery.scheme import scheme_for_right_model
from bwbn_bayes.discovery.search import search
from bwbn_bayes.discovery.suitable import require_suitable
from bwbn_bayes.elements.scales import NOMINAL
from bwbn_bayes.engines.executors import opened
from bwbn_bayes.engines.journal import Journal, forget, question_of, search_in_words
from bwbn_bayes.engines.precompile import precompile
from bwbn_bayes.errors import UserError, require_kind
from bwbn_bayes.inference.accuracy import LADDER, coarsest_stable, in_doubles
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import N_CANDIDATES, Mode, distinct, find_modes, polish, settled
from bwbn_bayes.inference.unnamed.further_link import spans
from bwbn_bayes.inference.unnamed.pulses import with_pulse
from bwbn_bayes.inference.unnamed.storey import places_of
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.band import noise_band
from bwbn_bayes.records.noise import LEAST_NOISE, with_least_noise
from bwbn_bayes.records.record import MIN_TIMES, Record, require_record
from bwbn_bayes.structures.structure import Structure, require_structure

MOST_POINTS = 3000
"""Points of one cyclic test that are fitted: some hundred in each of thirty cycles."""
_ROUNDING = 0.1
"""Of log likelihoods by single precision, at most. [nat]"""
_LAWS_AHEAD = 2
"""Laws of the first round that another process compiles, the last ones; the others are needed too soon."""


def discover(
    model: Structure,
    record: Record,
    *,
    held_out: Record | Literal["end", "repeats"] | None = None,
    settings: DiscoverySettings | None = None,
    name: str = "model",
    assumptions: Sequence[str] = (),
    listener: Listener | None = None,
) -> Discovery:
    """Find what a model lacks to explain a record.

    Parameters
    ----------
    model : Structure
        With priors on the parameters to identify.
    record : Record
        Fit and selection see this one alone, or several of the structure
        (:func:`~bwbn_bayes.records.joined.join_records`), which they see together.
    held_out : Record, "end" or "repeats", optional
        Predicted once, at the end, by the model as given and as improved: another measurement; the end of this one,
        of which fit and selection then see what comes before
        (:func:`~bwbn_bayes.discovery.held_out.parting_time`), or the last of several; or the half cycles of a
        cyclic test that repeat an amplitude (:func:`~bwbn_bayes.discovery.held_out.repeat_cycles`).
    settings : DiscoverySettings, optional
    name : str
        The model's name in reports.
    assumptions : sequence of str
        What the model takes for granted, for reports and the improved model.
    listener : callable, optional
        Told what is being done and what was found, with how far it is and, after each step, all that is known by then.

    Returns
    -------
    Discovery

    Raises
    ------
    UserError
        If an argument is of another kind, the model identifies nothing, the record measures nothing, they do not belong
        together, the record has no end or no repeat cycles to hold out, or no scheduler answers.
    """
    require_structure(model)
    require_record(record)
    settings = DiscoverySettings() if settings is None else settings
    require_kind("settings", settings, DiscoverySettings, "give DiscoverySettings(...), or leave them out")
    require_suitable(model, record, held_out if isinstance(held_out, Record) else None, name)
    run = Run(settings, np.random.default_rng(settings.seed), listener, name, data=record.content_hash)
    # Repeat cycles lie among what is fitted: both are samples of one record, thinned once.
    record, apart = set_apart(model, _thinned(record, run) if held_out == "repeats" else record, held_out)
    if apart is not None:
        run.say(f"keeping apart the {apart.label}")
    _tell_limits(model, record, run)
    record = _with_noise(record if held_out == "repeats" else _thinned(record, run), run)
    with (
        # Hypotheses are what runs beside each other; and sums come out alike on however many cores.
        threadpool_limits(limits=1, user_api="blas"),
        opened(settings.workers, settings.scheduler) as run.executor,
        nullcontext() if settings.checkpoint is None else _journal(settings.checkpoint, settings) as journal,
    ):
        if journal is not None:
            _go_on(journal, model, record, run)
        pool = _searched(_given(model, record, journal, run), run)
        return conclude(pool, apart, name, assumptions)


def _journal(checkpoint: Path, settings: DiscoverySettings) -> AbstractContextManager[Journal]:
    """The checkpoint's: what an earlier search left is lost only now, when everything that is given can take part."""
    if not settings.resume:
        forget(checkpoint)
    return Journal.opened(checkpoint)


def _go_on(journal: Journal, model: Structure, record: Record, run: Run) -> None:
    """Say whether what a journal holds serves this search, and mark with it what is kept from now on.

    Raises
    ------
    UserError
        If it is the search of another record, whose fits would be deleted when this one is done.
    """
    data = question_of("data of a search", run.data)
    search = question_of("search", search_in_words(model, record, run.settings.seed))
    if not journal.is_empty and not journal.holds(data):
        raise UserError(
            f"checkpoint {journal.path}: it holds the unfinished search of another record, or of an older version: "
            "give another --out, or leave out --resume to delete it and begin anew"
        )
    if journal.n_lost:
        run.say(f"checkpoint {journal.path}: its last {journal.n_lost:,} bytes are damaged or cut off and left out")
    if journal.holds(search):
        run.say(f"going on from what is kept in {journal.path}")
    elif not journal.is_empty:
        run.say(f"{journal.path} holds a search of this record with another model, seed or version: beginning anew")
    elif run.settings.resume:
        run.say(f"nothing is kept in {journal.path}: beginning anew")
    journal.mark(data, search)


@dataclass(frozen=True, kw_only=True)
class _Given:
    """The model as given, and with loops that may harden where it presses on the condition that they must not.

    Attributes
    ----------
    as_it_is : Explanation
        Fitted, under wider priors where its own bind.
    hardening : Explanation, optional
    binding : Binding
        Its priors that bind.
    """

    as_it_is: Explanation
    hardening: Explanation | None
    binding: Binding


def _searched(given: _Given, run: Run) -> Pool:
    """What a model lacks: beside loops that cannot harden, and beside such as can where those leave more than noise.

    What the model lacks may be why it presses on the condition, as a pinch; and effects that need the bound of a loop
    which does not harden take no part beside one that may. Where such a loop by itself leaves noise it is the answer.
    """
    run.binding = given.binding.sentences()
    if given.hardening is None:
        return search(given.as_it_is, run)
    pools = []
    if not given.hardening.is_noise:
        pools.append(search(given.as_it_is, run))
        if run.stopped or pools[0].laws.best.is_noise:
            return pools[0]
        run = run.anew()
    run.say("letting loops harden, as the model as given keeps them from doing")
    run.binding = given.binding.sentences(hardens=True)
    pools.append(search(given.hardening, run))
    best = max(pools, key=lambda pool: pool.compared.log_joint[0])
    best.run.stopped, best.run.cut_short = run.stopped, run.cut_short
    return best


def _given(model: Structure, record: Record, journal: Journal | None, run: Run) -> _Given:
    """The model as given, fitted, under wider priors where its own bind; laws are compiled meanwhile."""
    compiling = _compile_ahead(model, record, run)
    posterior, modes = _fit_given(model, record, journal, run)
    binding = Binding(given=posterior, best=modes[0])
    wider, freed = binding.widened, binding.hardening
    hardening = None if freed is None else _explained(*_refitted(posterior, modes, freed, run))
    if wider is not None:
        run.say("a prior of the model binds: fitting with a wider one")
        posterior, modes = _refitted(posterior, modes, wider, run)
    given = _explained(posterior, modes)
    for spot in given.disagreement.spots[:2]:
        run.say(spot.sentence)
    if compiling is not None:
        run.say("waiting for the law of all effects to be compiled, once for all specimens")
        compiling.join()
    return _Given(as_it_is=given, hardening=hardening, binding=binding)


def _tell_limits(model: Structure, record: Record, run: Run) -> None:
    """What is not asked of several records."""
    if len(record.runs) > 1:
        run.note("Nothing that happens at an instant was tried: in virgin records it would happen in each of them.")
    if model.is_driven and len(record.parts) > 1:
        run.note("No force of no known law is told: of a specimen it is known of one test alone.")


def _thinned(record: Record, run: Run) -> Record:
    """A cyclic test's record with fewer points, where they lie far closer together than anything that a loop does."""
    step = int(np.ceil(max(part.n_times for part in record.parts) / MOST_POINTS))
    if record.excitation_kind != "displacement" or step == 1:
        return record
    turns = "" if record.has_time else ", and those where it turns"
    run.note(
        f"Of the {record.n_times:,} points one in {step} was fitted{turns}: no feature of a loop is as short as that."
    )
    return record.every(step)


def _with_noise(record: Record, run: Run) -> Record:
    """The record with the least noise that can be weighed, and what must be said of its noise."""
    as_given, record = record, with_least_noise(record, run.rng)
    if record is not as_given:
        run.note(
            f"The record has no noise to speak of: white noise of {100.0 * LEAST_NOISE:g} % of the rms was added, "
            "since the error of solving and rounding would be taken for a missing effect."
        )
    for number, part in enumerate(record.parts):
        band = noise_band(part) if part.channels else None
        if band is not None:
            run.note(
                f"The noise{record.of_part(number)} ends at {0.5 * band.share / part.time_step:.3g} Hz, as behind a "
                f"filter: {band.correlation_samples:.2g} samples count as one."
            )
    return record


def _fit_given(
    model: Structure, record: Record, journal: Journal | None, run: Run
) -> tuple[Posterior, tuple[Mode, ...]]:
    """Fit the model as given, from all over its priors, by a scheme that is fine enough for the record."""
    engine = replace(LADDER[0], n_threads=run.settings.n_workers, single=True)
    posterior = Posterior(model=model, record=record, engine=engine, noise=default_noise(record), journal=journal)
    posterior = coarsest_stable(posterior)
    run.say("fitting the model as given")
    modes = find_modes(posterior, run.rng)
    view = posterior
    if _feels_rounding(view, _points(modes)):
        run.say("rounding to single precision would be felt: solving in double precision")
        view = in_doubles(view)
    if not model.is_driven:
        scheme = scheme_for_right_model(view, modes[0].point)
        if scheme != view.engine:
            run.say(f"samples lie far apart for what moves between them: solving by {scheme.scheme}")
            view = view.with_engine(scheme)
    if view is posterior:
        return posterior, modes
    return view, distinct(*polish(view, _points(modes), n_iterations=20))


def _feels_rounding(posterior: Posterior, points: Floats) -> bool:
    """Whether numbers of 32 bits move the log likelihood at some points ``(n, n_dim)`` by a tenth of a nat."""
    exact = in_doubles(posterior).log_likelihood(points)
    return not np.allclose(posterior.log_likelihood(points), exact, rtol=0.0, atol=_ROUNDING)


def _refitted(
    posterior: Posterior, modes: tuple[Mode, ...], wider: Structure, run: Run
) -> tuple[Posterior, tuple[Mode, ...]]:
    """The fit under wider priors, from the optima under narrower ones and the clouds around them."""
    under = posterior.with_model(wider)
    points = under.space.to_unit(posterior.space.from_unit(_points(modes)))
    return under, settled(under, distinct(*polish(under, points, n_iterations=20)), run.rng)


def _explained(posterior: Posterior, modes: tuple[Mode, ...]) -> Explanation:
    """The model as given, with starts from its fit to the record's beginning, where damage has yet to come."""
    record = posterior.record
    early = moment_of_share(record, 0.35)
    first = int(np.arange(record.n_times)[record.kept][0])
    beginning = posterior.until(max(early, 0.2 * record.duration, float(record.times[first + MIN_TIMES])))
    points, local = polish(beginning, _points(modes), n_iterations=20)
    return Explanation(
        added=(),
        posterior=posterior,
        modes=modes,
        evidence=laplace(posterior, modes),
        n_places=_n_places(posterior.model, record),
        starts=np.array([mode.point for mode in distinct(points, local)[:2]]),
    )


def _n_places(model: Structure, record: Record) -> int:
    """At which something without a name is looked for: storeys and all of them, nodes, and of one record channels."""
    has_sensors = not model.is_driven and len(record.parts) == 1
    return len(places_of(model.n_links)) + len(spans(model)) + (len(record.channels) if has_sensors else 0)


def _points(modes: Sequence[Mode]) -> Floats:
    """The best of them, ``(n, n_dim)``."""
    return np.array([mode.point for mode in modes[:N_CANDIDATES]])


def _compile_ahead(model: Structure, record: Record, run: Run) -> Thread | None:
    """Compile laws beside the first fits; the thread that waits for a specimen's, which has but one.

    Of a building they are the last laws of the first round, that of all effects, by which later ones are scored, and
    that by which the model as given answers to pulses. Laws do not depend on the sizes that effects are expected to
    have, so that any sizes do; where a user's effect has no prior at these, nothing is compiled ahead.
    """
    sizes = replace(NOMINAL, onset=0.1 * record.duration, duration=record.duration, time_step=record.time_step)
    try:
        considered = hypotheses(
            model,
            (sizes,) * model.n_links,
            measured=tuple(record.channels),
            has_time=record.has_time,
            in_one_go=len(record.runs) == 1,
            effects=run.settings.effects,
        )
    except UserError:
        return None
    of_all = [h for h in sharing_laws(considered, np.inf) if h.carried][-1:]
    if model.excitation_kind == "displacement":
        precompile({one.model.law: False for one in of_all}, driven=True)
        return precompile({one.model.law: True for one in of_all}, driven=True, single=True)
    common = [*(one.model.law for one in of_all), with_pulse(model, 1, 1.0).law]
    # One hypothesis of each law: to build the models of all takes as long as to fit the model as given.
    of_each: dict[frozenset[tuple[str, ...]], Hypothesis] = {}
    for one in considered:
        if one.carried:
            of_each.setdefault(frozenset((one.symbols, *map(symbols_of, one.carried))), one)
    later = list(dict.fromkeys(one.model.law for one in of_each.values()))[1:]
    precompile(dict.fromkeys(later[: -1 - _LAWS_AHEAD : -1], True), driven=False, single=True)
    precompile(dict.fromkeys(common, False), driven=False)
    return None
