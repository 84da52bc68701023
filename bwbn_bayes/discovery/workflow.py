"""The loop: fit, look where it disagrees, weigh every effect, add the one that is named, until nothing is left to name.

Selection sees the training record alone; what is held out is predicted at the end, before and after, for the verdict.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from bwbn_bayes.discovery.candidates import MOST_CARRIED, Hypothesis, hypotheses, sharing_laws
from bwbn_bayes.discovery.conclusion import (
    MOST_AT_ONCE,
    Grown,
    conclude,
    is_explained,
    unexplained_share,
    what_stayed,
)
from bwbn_bayes.discovery.evidence import bridged_evidence, laplace_evidence, present_evidence, sampled_evidence
from bwbn_bayes.discovery.held_out import set_apart
from bwbn_bayes.discovery.name import THRESHOLD, Decision, decide, worth_fitting
from bwbn_bayes.discovery.outcome import Added, Discovery, Step
from bwbn_bayes.discovery.race import Fit, race
from bwbn_bayes.discovery.run import (
    DiscoverySettings,
    Listener,
    Present,
    Run,
    hypotheses_of,
    on_one_thread,
    on_threads,
    score_all,
)
from bwbn_bayes.discovery.second_look import rescanned, searched, widened
from bwbn_bayes.discovery.separation import separating_experiment
from bwbn_bayes.discovery.suitable import require_suitable
from bwbn_bayes.elements.scales import NOMINAL
from bwbn_bayes.engines.precompile import precompile
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.accuracy import LADDER
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import N_CANDIDATES, distinct, find_modes, polish, settled
from bwbn_bayes.inference.residuals import leaves_noise
from bwbn_bayes.records.band import noise_band
from bwbn_bayes.records.noise import LEAST_NOISE, with_least_noise
from bwbn_bayes.records.record import MIN_TIMES, Record
from bwbn_bayes.structures.structure import Structure

_LAWS_AHEAD = 2
"""Laws of the first round that another process compiles, the last ones; the others are needed too soon."""
MOST_LATER = 24
"""Hypotheses with the largest scores that are fitted in a later round."""
CONTENDER = 40.0
"""Hypotheses this close to the best by Laplace are sampled. [nat]"""
MOST_SAMPLED = 12
"""The best of them, so many at most."""
MOST_LEFT = 0.85
"""An effect that leaves a larger share of the disagreement, and no noise, is beside the point: it is not added."""


def discover(
    model: Structure,
    record: Record,
    *,
    held_out: Record | Literal["end"] | None = None,
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
        Fit and selection see this one alone.
    held_out : Record or "end", optional
        Predicted once, at the end, by the model as given and as improved: another measurement, or the end of this one,
        of which fit and selection then see what comes before
        (:func:`~bwbn_bayes.discovery.held_out.parting_time`).
    settings : DiscoverySettings, optional
    name : str
        The model's name in reports.
    assumptions : sequence of str
        What the model takes for granted, for reports and the improved model.
    listener : callable, optional
        Told what is being done and what was found.

    Returns
    -------
    Discovery

    Raises
    ------
    UserError
        If the model identifies nothing, the record measures nothing, they do not belong together, or the record has
        no end to hold out.
    """
    require_suitable(model, record, held_out if isinstance(held_out, Record) else None, name)
    record, apart = set_apart(model, record, held_out)
    settings = settings or DiscoverySettings()
    run = Run(settings, np.random.default_rng(settings.seed), listener)
    if apart is not None:
        run.say(f"keeping apart the {apart.label}")
    as_given, record = record, with_least_noise(record, run.rng)
    if record is not as_given:
        run.note(
            f"The record has no noise to speak of: white noise of {100.0 * LEAST_NOISE:g} % of the rms was added, "
            "since the error of solving and rounding would be taken for a missing effect."
        )
    band = noise_band(record)
    if band is not None:
        run.note(
            f"The noise ends at {0.5 * band.share / record.time_step:.3g} Hz, as behind a filter: "
            f"{band.correlation_samples:.2g} samples count as one."
        )
    _compile_ahead(model, record, run)
    given = _fit_given(model, record, run)
    for spot in given.disagreement.spots[:2]:
        run.say(spot.sentence)
    run.considered = hypotheses_of(given, run, MOST_CARRIED)
    grown = _grow(Grown(given, (), None, False), run, most=MOST_AT_ONCE)
    grown, run = _look_again(given, grown, run)
    grown = _prune(_grow(grown, run, most=run.settings.most_effects), run)
    return conclude(given, grown, apart, name, assumptions, run)


def _fit_given(model: Structure, record: Record, run: Run) -> Present:
    """Fit the model as given: to the whole record, and to its beginning, where damage has yet to come."""
    engine = replace(LADDER[0], n_threads=run.settings.n_workers)
    posterior = Posterior(model=model, record=record, engine=engine, noise=default_noise(record))
    run.say("fitting the model as given")
    modes = find_modes(posterior, run.rng)
    energy = np.cumsum(np.square(record.excitation))
    early = float(np.searchsorted(energy, 0.35 * energy[-1])) * record.time_step
    beginning = posterior.until(max(early, 0.2 * record.duration, MIN_TIMES * record.time_step))
    points, local = polish(beginning, np.array([mode.point for mode in modes[:16]]), n_iterations=20)
    young = distinct(points, local)
    starts = np.array([mode.point for mode in (*modes[:2], *young[:2])])
    return Present(posterior=posterior, modes=modes, starts=starts)


def _compile_ahead(model: Structure, record: Record, run: Run) -> None:
    """Compile, beside the first fits, the last laws of the first round and the one under which later ones are scored.

    Laws do not depend on the sizes that effects are expected to have, so that any sizes do; where a user's effect has
    no prior at these, nothing is compiled ahead.
    """
    sizes = replace(NOMINAL, onset=0.1 * record.duration, duration=record.duration, time_step=record.time_step)
    try:
        considered = hypotheses(
            model, (sizes,) * model.n_storeys, measured=tuple(record.channels), effects=run.settings.effects
        )
    except UserError:
        return
    later = list(dict.fromkeys(h.model.law for h in considered if h.carried))[1:]
    laws = dict.fromkeys(later[: -1 - _LAWS_AHEAD : -1], True)
    for hypothesis in [h for h in sharing_laws(considered, np.inf) if h.carried][-1:]:
        laws.setdefault(hypothesis.model.law, False)
    precompile(laws, driven=model.excitation_kind == "displacement")


def _grow(so_far: Grown, run: Run, *, most: int, fits: tuple[Fit, ...] | None = None) -> Grown:
    """Add effects one by one until none passes or there are so many; the fits of the next round may be known."""
    present, added, first, ended = so_far
    if ended:
        return so_far
    while len(added) < min(most, run.settings.most_effects):
        if fits is None:
            fits = _fit_hypotheses(present, run)
        if not run.steps:
            run.first_fits, run.first_considered = fits, run.considered
        decision = _weigh(present, fits, run) if fits else None
        chosen = decision.leader if decision is not None and decision.passes else None
        sentence = decision.sentence if decision is not None else "No effect could gain enough to be named."
        run.steps.append(
            Step(
                number=len(run.steps) + 1,
                model=present.posterior.model,
                disagreement=present.disagreement,
                decision=decision,
                sentence=sentence,
                elapsed_s=run.elapsed,
            )
        )
        run.say(sentence)
        if chosen is None or decision is None:
            return Grown(present, added, first, True)
        fit = next(fit for fit in fits if fit.hypothesis is chosen.hypothesis)
        posterior = present.posterior.with_model(chosen.hypothesis.model)
        modes = settled(posterior, fit.modes[:N_CANDIDATES], run.rng)
        improved = Present(posterior=posterior, modes=modes, starts=np.array([mode.point for mode in modes[:3]]))
        left = unexplained_share(present, improved)
        if left > MOST_LEFT and not improved.is_noise:
            run.withdraw(what_stayed(left), decision)
            run.say(run.steps[-1].sentence)
            return Grown(present, added, first, True)
        separation = _separation(fit, fits, decision)
        added = (*added, Added(candidate=chosen, decision=decision, moments={}, separation=separation))
        present, fits = improved, None
        first = first or present
    return Grown(present, added, first, False)


def _look_again(given: Present, grown: Grown, run: Run) -> tuple[Grown, Run]:
    """Where much stays unexplained, fit the leading hypotheses of the first round from all over their priors.

    Starts near the fits of a model that lacks an effect can all be far from the truth.
    """
    if is_explained(given, grown.present, grown.added) or not run.first_fits:
        return grown, run
    run.say("much stays unexplained: fitting the leading hypotheses from all over their priors")
    fits = searched(run.first_fits, run.rng, n_threads=run.settings.n_workers)
    if fits[0].log_likelihood < run.first_fits[0].log_likelihood + THRESHOLD:
        return grown, run
    again = replace(run, steps=[], considered=run.first_considered)
    other = _grow(Grown(given, (), None, False), again, most=MOST_AT_ONCE, fits=fits)
    if unexplained_share(given, other.present) < unexplained_share(given, grown.present):
        return other, again
    return grown, run


def _separation(fit: Fit, fits: Sequence[Fit], decision: Decision) -> tuple[str, ...]:
    """For each effect that the record cannot tell from the one added, the experiment that would."""
    others = [next(other for other in fits if other.hypothesis.name == name) for name in decision.equivalent]
    return tuple(separating_experiment(fit, other, fit.hypothesis.scales.period) for other in others)


def _fit_hypotheses(present: Present, run: Run) -> tuple[Fit, ...]:
    """Fit every effect at every place that could improve the present model, best first; none where none could."""
    posterior = present.posterior
    first = not run.steps
    if not first:  # Later models differ from run to run: one law for all of them, compiled once, scores them.
        run.considered = hypotheses_of(present, run, np.inf)
    every = run.considered
    if present.is_quiet or not first:
        run.say(f"scoring {len(every)} hypotheses")
        run.scored = (posterior.model, score_all(present, every, run))
        every = worth_fitting(run.scored[1], quiet=present.is_quiet)[: len(every) if first else MOST_LATER]
    if not every:
        return ()
    if not first:
        every = _under_smaller_laws(present, every)
    run.say(f"fitting {len(every)} hypotheses")
    fits = race(
        on_one_thread(posterior), every, present.starts, n_workers=run.settings.n_workers, guess=first, progress=run.say
    )
    fits = _solvable(fits, run)
    if not fits:
        return ()
    fits = widened(fits, n_threads=run.settings.n_workers)
    if _leaves_noise(fits[0]):
        return fits
    run.say("looking closer at the leading hypotheses")
    return rescanned(fits, n_threads=run.settings.n_workers)


def _solvable(fits: tuple[Fit, ...], run: Run) -> tuple[Fit, ...]:
    """Those that could be solved from some start; the others are told once."""
    lost = [fit.hypothesis.label for fit in fits if not np.isfinite(fit.log_likelihood)]
    if lost:
        sentence = f"Could not be solved for this record and was left out: {', '.join(lost)}."
        if sentence not in run.notes:
            run.note(sentence)
    return tuple(fit for fit in fits if np.isfinite(fit.log_likelihood))


def _under_smaller_laws(present: Present, every: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
    """The same hypotheses in groups of few effects: derivatives take a tenth of the time, which pays for compiling."""
    grouped = sharing_laws(every, MOST_CARRIED)
    laws = tuple(dict.fromkeys(hypothesis.model.law for hypothesis in grouped))
    precompile(
        dict.fromkeys(laws[len(laws) // 2 :], True), driven=present.posterior.model.excitation_kind == "displacement"
    )
    return grouped


def _weigh(present: Present, fits: Sequence[Fit], run: Run) -> Decision:
    """Laplace for every fit; sampling for the present model and for those close to the best.

    Transitional MCMC weighs what those leave in doubt, but not among hypotheses of which the best leaves more than
    noise: then it is not they that the decision turns on.
    """
    run.say("weighing the hypotheses")
    evidences = [laplace_evidence(fit) for fit in fits]
    order = sorted(range(len(fits)), key=lambda i: -evidences[i].total)
    own = present_evidence(present.posterior, present.modes, run.rng, 1000)
    for i in order[:MOST_SAMPLED]:
        if evidences[i].total > evidences[order[0]].total - CONTENDER:
            evidences[i] = sampled_evidence(_threaded(fits[i], run), evidences[i], run.rng, 600)
    weighed = dict(zip([fit.hypothesis for fit in fits], evidences, strict=True))
    decision = decide(own, tuple(weighed.items()), run.considered)
    doubtful = decision.doubtful
    if not doubtful or not _leaves_noise(fits[order[0]]):
        return decision
    for candidate in doubtful:
        run.say(f"sampling {candidate.hypothesis.label} by transitional MCMC")
        fit = next(fit for fit in fits if fit.hypothesis is candidate.hypothesis)
        weighed[fit.hypothesis] = bridged_evidence(_threaded(fit, run), candidate.evidence, run.rng, 200)
    return decide(own, tuple(weighed.items()), run.considered)


def _leaves_noise(fit: Fit) -> bool:
    return leaves_noise(fit.posterior, fit.best(1)[0])


def _threaded(fit: Fit, run: Run) -> Fit:
    """The fit with every thread for its own solves."""
    return replace(fit, posterior=on_threads(fit.posterior, run.settings.n_workers))


def _prune(grown: Grown, run: Run) -> Grown:
    """Drop an effect that a later one has made superfluous; the last, if its fit only led out of a local minimum."""
    present, added = grown.present, grown.added
    if len(added) < 2:
        return grown
    run.say("checking whether each effect is still needed")
    own = present_evidence(present.posterior, present.modes, run.rng, 1000)
    for superfluous in added:
        kept = tuple(one for one in added if one is not superfluous)
        model = run.steps[0].model
        for one in kept:
            hypothesis = one.candidate.hypothesis
            model = model.with_effect(hypothesis.effect, hypothesis.storeys or None)
        posterior = present.posterior.with_model(model)
        names = present.posterior.space.names
        columns = [names.index(name) for name in model.space.names]
        points, local = polish(posterior, np.array([m.point[columns] for m in present.modes[:16]]), n_iterations=30)
        modes = distinct(points, local)
        if not modes:  # without it, nothing can be solved where the record leads
            continue
        without = present_evidence(posterior, modes, run.rng, 1000)
        if own.total - without.total < THRESHOLD:
            later = superfluous is not added[-1]
            why = "a later effect makes it superfluous" if later else "the fit that it led to is as good without it"
            run.withdraw(why, superfluous.decision)
            run.say(f"{superfluous.candidate.hypothesis.label} is no longer needed")
            smaller = Present(posterior=posterior, modes=modes, starts=points[:3])
            first = None if superfluous is added[0] else smaller if len(kept) == 1 else grown.first
            return _prune(grown._replace(present=smaller, added=kept, first=first), run)
    return grown
