"""The loop: fit, look where it disagrees, weigh every effect, add the one that is named, until nothing is left to name.

Selection sees the training record alone; what is held out is predicted once, at the end, before and after.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from bwbn_bayes.discovery.candidates import MOST_CARRIED, Hypothesis, hypotheses, scales_of, sharing_laws
from bwbn_bayes.discovery.evidence import bridged_evidence, laplace_evidence, present_evidence, sampled_evidence
from bwbn_bayes.discovery.held_out import HeldOut, floor_of, predict, set_apart
from bwbn_bayes.discovery.name import THRESHOLD, Candidate, Decision, decide
from bwbn_bayes.discovery.outcome import Added, DetectionLimit, Discovery, Gap, Step, Verdict
from bwbn_bayes.discovery.race import Fit, race
from bwbn_bayes.discovery.score import Score, scores
from bwbn_bayes.discovery.separation import separating_experiment
from bwbn_bayes.discovery.suitable import require_suitable
from bwbn_bayes.discovery.unexplained import unexplained
from bwbn_bayes.discovery.where import Disagreement, disagreement
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.precompile import precompile
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.accuracy import LADDER
from bwbn_bayes.inference.identify import Settings, identify_from
from bwbn_bayes.inference.likelihood import Posterior, default_noise
from bwbn_bayes.inference.modes import N_CANDIDATES, Mode, distinct, find_modes, polish, settled
from bwbn_bayes.inference.residuals import is_noise, is_quiet, residual_of
from bwbn_bayes.inference.summary import observe
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.structures.structure import Structure

Listener = Callable[[str], None]

LEAST_SCORE = 6.0
"""Where the residual is noise, and in later rounds, hypotheses whose score is below this are not fitted. [nat]"""
MOST_LATER = 24
"""Hypotheses with the largest scores that are fitted in a later round."""
CONTENDER = 40.0
"""Hypotheses this close to the best by Laplace are sampled. [nat]"""
FEW = 6
"""Hypotheses of a later round that are fitted under the one law of all."""
FOUND_SHARE, PARTLY_SHARE = 0.1, 0.25
"""Unexplained share up to which effects count as found, and as contributing."""


@dataclass(frozen=True, kw_only=True)
class DiscoverySettings:
    """Options of a discovery.

    Parameters
    ----------
    seed : int
        The run is a function of it.
    most_effects : int
        Effects added at most.
    particles : int
        Effective draws of the final posterior.
    n_workers : int
        Hypotheses fitted at once.
    effects : tuple of Effect classes, optional
        Those to consider; the whole catalogue by default.
    """

    seed: int = 1
    most_effects: int = 4
    particles: int = 2000
    n_workers: int = os.cpu_count() or 1
    effects: tuple[type[Effect], ...] | None = None


@dataclass(frozen=True, kw_only=True)
class _Present:
    """The present model, fitted."""

    posterior: Posterior
    modes: tuple[Mode, ...]
    starts: Floats
    """Further points of its unit cube from which fits start."""

    @property
    def best(self) -> Floats:
        return self.modes[0].point

    @property
    def is_noise(self) -> bool:
        """Whether what it leaves could be noise."""
        return all(is_noise(rest) for rest in residual_of(self.posterior, self.best))

    @property
    def is_quiet(self) -> bool:
        """Whether nothing of note is left, so that a score tells what a hypothesis could gain."""
        signals = self.posterior.record.channels.values()
        return all(map(is_quiet, residual_of(self.posterior, self.best), signals))


@dataclass
class _Run:
    """What a run collects."""

    settings: DiscoverySettings
    rng: np.random.Generator
    listener: Listener | None
    began: float = field(default_factory=time.perf_counter)
    steps: list[Step] = field(default_factory=list)
    scored: tuple[Structure | None, tuple[tuple[Hypothesis, Score], ...]] = (None, ())
    """The model that was scored last, with its hypotheses."""

    def say(self, text: str) -> None:
        if self.listener is not None:
            self.listener(text)

    def withdraw(self, share: float) -> None:
        """Say of the steps that added an effect that it did not stay."""
        for number, step in enumerate(self.steps):
            if step.decision is not None and step.decision.passes:
                left = f"It is withdrawn: {100 * share:.0f} % of the disagreement stayed."
                self.steps[number] = replace(step, sentence=f"{step.sentence} {left}")

    @property
    def elapsed(self) -> float:
        return time.perf_counter() - self.began


def discover(
    model: Structure,
    record: Record,
    *,
    held_out: Record | Literal["end"] | None = None,
    settings: DiscoverySettings | None = None,
    name: str = "model",
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
    run = _Run(settings, np.random.default_rng(settings.seed), listener)
    if apart is not None:
        run.say(f"keeping apart the {apart.label}")
    given = _fit_given(model, record, run)
    before = disagreement(given.posterior, given.best)
    for spot in before.spots[:2]:
        run.say(spot.sentence)
    _compile_ahead(given, run)
    present, added = _grow(given, run)
    present, added = _prune(present, added, run)
    return _conclude(given, present, added, before, apart, name, run)


def _fit_given(model: Structure, record: Record, run: _Run) -> _Present:
    """Fit the model as given: to the whole record, and to its beginning, where damage has yet to come."""
    engine = replace(LADDER[0], n_threads=run.settings.n_workers)
    posterior = Posterior(model=model, record=record, engine=engine, noise=default_noise(record))
    run.say("fitting the model as given")
    modes = find_modes(posterior, run.rng)
    energy = np.cumsum(np.square(record.excitation))
    early = float(np.searchsorted(energy, 0.35 * energy[-1])) * record.time_step
    beginning = posterior.until(max(early, 0.2 * record.duration))
    points, local = polish(beginning, np.array([mode.point for mode in modes[:16]]), n_iterations=20)
    young = distinct(points, local)
    starts = np.array([mode.point for mode in (*modes[:2], *young[:2])])
    return _Present(posterior=posterior, modes=modes, starts=starts)


def _compile_ahead(given: _Present, run: _Run) -> None:
    """Compile, beside the first round, the law of the later ones and the last of the first round's own."""
    laws = []
    for most_carried in (MOST_CARRIED, np.inf):
        sharing = [h for h in _hypotheses(given, run, most_carried) if h.carried]
        laws += [hypothesis.model.law for hypothesis in sharing[-1:]]
    precompile(laws, driven=given.posterior.model.excitation_kind == "displacement")


def _grow(present: _Present, run: _Run) -> tuple[_Present, tuple[Added, ...]]:
    """Add effects one by one until none passes."""
    added: list[Added] = []
    while len(added) < run.settings.most_effects:
        fits, decision = _round(present, run)
        chosen = decision.leader if decision is not None and decision.passes else None
        sentence = decision.sentence if decision is not None else "The residual is noise, and no effect has a score."
        run.steps.append(
            Step(
                number=len(run.steps) + 1,
                model=present.posterior.model,
                disagreement=disagreement(present.posterior, present.best),
                decision=decision,
                sentence=sentence,
                elapsed_s=run.elapsed,
            )
        )
        run.say(sentence)
        if chosen is None or decision is None:
            break
        fit = next(fit for fit in fits if fit.hypothesis is chosen.hypothesis)
        added.append(
            Added(candidate=chosen, decision=decision, moments={}, separation=_separation(fit, fits, decision))
        )
        posterior = present.posterior.with_model(chosen.hypothesis.improved)
        modes = settled(posterior, fit.modes[:N_CANDIDATES], run.rng)
        present = _Present(posterior=posterior, modes=modes, starts=np.array([mode.point for mode in modes[:3]]))
    return present, tuple(added)


def _separation(fit: Fit, fits: Sequence[Fit], decision: Decision) -> tuple[str, ...]:
    """For each effect that the record cannot tell from the one added, the experiment that would."""
    others = [next(other for other in fits if other.hypothesis.name == name) for name in decision.equivalent]
    return tuple(separating_experiment(fit, other, fit.hypothesis.scales.period) for other in others)


def _round(present: _Present, run: _Run) -> tuple[tuple[Fit, ...], Decision | None]:
    """Weigh every effect at every place against the present model."""
    posterior = present.posterior
    # Later models differ from run to run: one law for all of them, compiled once, scores them.
    considered = every = _hypotheses(present, run, np.inf if run.steps else MOST_CARRIED)
    first = not run.steps
    if present.is_quiet or not first:
        run.say(f"scoring {len(every)} hypotheses")
        run.scored = (posterior.model, _scored(present, every, run))
        ranked = sorted(run.scored[1], key=lambda pair: -pair[1].nats)
        every = tuple(h for h, s in ranked if s.nats > LEAST_SCORE)[: len(every) if first else MOST_LATER]
        if not every:
            return (), None
    if not first and len(every) > FEW:
        every = _under_smaller_laws(present, every)
    run.say(f"fitting {len(every)} hypotheses")
    fits = race(
        _single(posterior), every, present.starts, n_workers=run.settings.n_workers, guess=first, progress=run.say
    )
    return fits, _weigh(present, fits, considered, run)


def _under_smaller_laws(present: _Present, every: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
    """The same hypotheses in groups of few effects: solves take a fifth of the time, which pays for compiling."""
    grouped = sharing_laws(every, MOST_CARRIED)
    laws = tuple(dict.fromkeys(hypothesis.model.law for hypothesis in grouped))
    precompile(laws[len(laws) // 2 :], driven=present.posterior.model.excitation_kind == "displacement")
    return grouped


def _single(posterior: Posterior) -> Posterior:
    """The posterior on one thread: hypotheses are what runs beside each other."""
    return _on_threads(posterior, 1)


def _scored(present: _Present, every: Sequence[Hypothesis], run: _Run) -> tuple[tuple[Hypothesis, Score], ...]:
    found = scores(_single(present.posterior), every, present.best, n_workers=run.settings.n_workers)
    return tuple(zip(every, found, strict=True))


def _hypotheses(present: _Present, run: _Run, most_carried: float) -> tuple[Hypothesis, ...]:
    return hypotheses(
        present.posterior.model,
        scales_of(present.posterior, present.best),
        measured=tuple(present.posterior.record.channels),
        effects=run.settings.effects,
        most_carried=most_carried,
    )


def _weigh(present: _Present, fits: Sequence[Fit], considered: Sequence[Hypothesis], run: _Run) -> Decision:
    """Laplace for every fit; sampling for the present model and for those close to the best."""
    run.say("weighing the hypotheses")
    evidences = [laplace_evidence(fit) for fit in fits]
    best = max(evidence.total for evidence in evidences)
    own = present_evidence(present.posterior, present.modes, run.rng, 1000)
    for i, fit in enumerate(fits):
        if evidences[i].total > best - CONTENDER:
            evidences[i] = sampled_evidence(_threaded(fit, run), evidences[i], run.rng, 600)
    weighed = dict(zip([fit.hypothesis for fit in fits], evidences, strict=True))
    decision = decide(own, tuple(weighed.items()), considered)
    for candidate in decision.doubtful:
        run.say(f"sampling {candidate.hypothesis.label} by transitional MCMC")
        fit = next(fit for fit in fits if fit.hypothesis is candidate.hypothesis)
        weighed[fit.hypothesis] = bridged_evidence(_threaded(fit, run), candidate.evidence, run.rng, 200)
    return decide(own, tuple(weighed.items()), considered)


def _threaded(fit: Fit, run: _Run) -> Fit:
    """The fit with every thread for its own solves."""
    return replace(fit, posterior=_on_threads(fit.posterior, run.settings.n_workers))


def _on_threads(posterior: Posterior, n_threads: int) -> Posterior:
    engine = posterior.engine
    if not isinstance(engine, Lanes):
        raise UserError(f"discovery runs on the lanes engine, not on {engine.name}: leave --engine out")
    return posterior.with_engine(replace(engine, n_threads=n_threads))


def _prune(present: _Present, added: tuple[Added, ...], run: _Run) -> tuple[_Present, tuple[Added, ...]]:
    """Drop an effect that a later one has made superfluous."""
    if len(added) < 2:
        return present, added
    run.say("checking whether each effect is still needed")
    own = present_evidence(present.posterior, present.modes, run.rng, 1000)
    for superfluous in added[:-1]:
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
        without = present_evidence(posterior, modes, run.rng, 1000)
        if own.total - without.total < THRESHOLD:
            run.say(f"{superfluous.candidate.hypothesis.label} is no longer needed")
            smaller = _Present(posterior=posterior, modes=modes, starts=points[:3])
            return _prune(smaller, kept, run)
    return present, added


def _conclude(
    given: _Present,
    present: _Present,
    added: tuple[Added, ...],
    before: Disagreement,
    held_out: HeldOut | None,
    name: str,
    run: _Run,
) -> Discovery:
    after = disagreement(present.posterior, present.best)
    share = _unexplained_share(before, after)
    verdict = _verdict(present, added, share)
    if verdict == "unexplained":
        run.withdraw(share)
        added, present = (), given
        after = before
    rest = None
    if verdict in ("unexplained", "partly_explained"):
        run.say("learning the missing storey force")
        rest = unexplained(present.posterior, present.best, _weighed_against(present, run.steps), run.rng)
    run.say("looking for the smallest effects that this record could have shown")
    limits = _limits(present, run)
    posterior, record = present.posterior, present.posterior.record
    gap = _gap(given, present, record, 0, run)
    if held_out is not None:
        gap = replace(gap, held_out=_gap(given, present, held_out.record, held_out.first, run))
    elapsed = run.elapsed
    run.say("sampling the posterior of the final model")
    result = identify_from(
        posterior,
        np.array([mode.point for mode in present.modes[:8]]),
        settings=Settings(seed=run.settings.seed, particles=run.settings.particles, fallback=False),
        name=name,
        listener=lambda text, _: run.say(text),
    )
    moments = {p.name: (p.mean, p.sd) for p in result.facts.parameters}
    added = tuple(
        replace(one, moments={label: moments[label] for label in one.candidate.hypothesis.brought}) for one in added
    )
    return Discovery(
        verdict=verdict,
        sentences=_sentences(verdict, added, share, before, gap),
        unexplained_share=share,
        unexplained=rest,
        added=added,
        steps=tuple(run.steps),
        limits=limits,
        gap=gap,
        before=before,
        after=after,
        histories={"before": _histories(given), "after": _histories(present)},
        model=given.posterior.model,
        improved=posterior.model,
        record=record,
        held_out=held_out,
        result=result,
        name=name,
        seed=run.settings.seed,
        elapsed_s=elapsed,
    )


def _gap(given: _Present, present: _Present, record: Record, first: int, run: _Run) -> Gap:
    """Before and after on a record, from its sample ``first`` on."""
    before, after = (predict(one.posterior, one.best, record, run.rng, first=first) for one in (given, present))
    return Gap(noise_floor=floor_of(record, first=first), before=before, after=after)


def _weighed_against(present: _Present, steps: Sequence[Step]) -> tuple[Candidate, ...]:
    """Candidates of the last round that weighed them against this model, or of the last round at all."""
    rounds = [step for step in steps if step.decision is not None]
    own = [step for step in rounds if step.model == present.posterior.model] or rounds
    return own[-1].decision.candidates if own and own[-1].decision is not None else ()


def _unexplained_share(before: Disagreement, after: Disagreement) -> float:
    """What is left of the residual energy beyond the noise."""
    excess = [float(np.sum(np.maximum(np.square(d.residual_to_noise) - 1.0, 0.0))) for d in (before, after)]
    return min(excess[1] / excess[0], 1.0) if excess[0] > 0.0 else 0.0


def _verdict(present: _Present, added: tuple[Added, ...], share: float) -> Verdict:
    noise = present.is_noise
    if not added:
        return "no_missing_effect" if noise else "unexplained"
    # Steady noise can hide that much is left of a small disagreement; only where nothing of note is left is it found.
    if share <= FOUND_SHARE or present.is_quiet or (noise and share <= PARTLY_SHARE):
        return "effects_found"
    return "partly_explained" if noise or share <= PARTLY_SHARE else "unexplained"


def _limits(present: _Present, run: _Run) -> tuple[DetectionLimit, ...]:
    model, scored = run.scored
    if model is not present.posterior.model:
        scored = _scored(present, _hypotheses(present, run, np.inf), run)
    needed = THRESHOLD + float(np.log(max(len(scored), 1)))
    return tuple(
        DetectionLimit(
            label=hypothesis.label,
            name=hypothesis.name,
            storeys=hypothesis.storeys,
            parameter=one.amplitude,
            unit=one.unit,
            smallest=one.detectable(needed),
            expected=_expected(hypothesis, one.amplitude),
        )
        for hypothesis, one in scored
    )


def _expected(hypothesis: Hypothesis, amplitude: str) -> float:
    return next(p.prior.sd for p in hypothesis.model.space.parameters if p.name == amplitude)


def _histories(present: _Present) -> dict[str, Floats]:
    values, _ = present.posterior.split(present.best[None])
    rows = observe(present.posterior.engine, present.posterior.model, values, present.posterior.record)
    return {kind: history[0] for kind, history in rows.items()}


def _sentences(
    verdict: Verdict, added: tuple[Added, ...], share: float, before: Disagreement, gap: Gap
) -> tuple[str, ...]:
    labels = ", then ".join(one.candidate.hypothesis.label for one in added)
    meaning = f": {added[0].candidate.hypothesis.effect.summary}" if len(added) == 1 else ""
    shrunk = (
        f"The error of fit falls from {100 * gap.before.nrmse:.1f} % to {100 * gap.after.nrmse:.1f} % of the signal; "
        f"the noise is {100 * gap.noise_floor:.1f} %."
    )
    first = {
        "effects_found": f"The model lacks {labels}{meaning}.",
        "partly_explained": f"{labels} contributes, but {100 * share:.0f} % of the disagreement stays unexplained.",
        "no_missing_effect": "The model as given explains the record: what it leaves is noise.",
        "unexplained": "Model and record disagree, and no catalogued effect explains it.",
    }[verdict]
    places = {f"acceleration_{storey}" for one in added for storey in one.candidate.hypothesis.storeys}
    own = [spot for spot in before.spots if spot.channel in places]
    spots = tuple(f"Where it showed: {spot.sentence}." for spot in (*own, *before.spots)[:1])
    return (first, shrunk, *spots) if added else (first, *spots)
