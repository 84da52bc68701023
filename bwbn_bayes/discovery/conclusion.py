"""What a finished search comes to: names with their signatures, the gap, detection limits, the final posterior."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.held_out import HeldOut, floor_of, predict
from bwbn_bayes.discovery.outcome import Added, DetectionLimit, Discovery, Gap, deserved_by
from bwbn_bayes.discovery.pool import Pool
from bwbn_bayes.discovery.predictive import predictive_interval
from bwbn_bayes.discovery.probability import NAMED, POSSIBLE, Beliefs, Family
from bwbn_bayes.discovery.run import Run, hypotheses_of, score_all
from bwbn_bayes.discovery.sentences import badly_sampled, not_searched, sentences
from bwbn_bayes.discovery.separation import separating_experiment
from bwbn_bayes.discovery.signatures import signature_of, spread_of
from bwbn_bayes.discovery.unnamed_facts import beside_it, unnamed_facts
from bwbn_bayes.discovery.where import unexplained_share
from bwbn_bayes.inference.accuracy import in_doubles
from bwbn_bayes.inference.identify import identify_from
from bwbn_bayes.inference.settings import Settings
from bwbn_bayes.inference.summary import observe
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.results import Result

_SHARES_PROBABILITY = 0.1
"""Probability from which another effect or place shares that of one that was added."""


def conclude(pool: Pool, held_out: HeldOut | None, name: str, assumptions: Sequence[str]) -> Discovery:
    """Turn a finished search into what it found.

    Parameters
    ----------
    pool : Pool
        Every explanation, weighed.
    held_out : HeldOut or None
        Predicted here and nowhere before: it chooses nothing.
    name : str
        The model's name in reports.
    assumptions : sequence of str
        What the model as given takes for granted.
    """
    run, believed, given = pool.run, pool.beliefs, pool.plain[frozenset()]
    present = pool.delivered(believed)
    run.say("looking for the smallest effects that this record could have shown")
    limits = _limits(present, run)
    record = present.posterior.record
    gap = _gap(given, present, record, record.kept, run)
    if held_out is not None:
        gap = replace(gap, held_out=_gap_held_out(given, present, held_out, believed, run))
    gap = beside_it(believed, held_out, gap, run.rng)
    elapsed = run.elapsed
    run.say("sampling the posterior of the final model")
    result = identify_from(
        in_doubles(present.posterior),
        np.array([mode.point for mode in present.modes[:8]]),
        settings=Settings(seed=run.settings.seed, particles=run.settings.particles, fallback=False),
        name=name,
        assumptions=assumptions,
        listener=lambda text, _: run.say(text),
    )
    borne_out = believed.borne_out
    spread = spread_of(present, run.rng)
    every = (_added(one, borne_out.get(one.name, 1.0), present, spread, believed, result, run) for one in present.added)
    added = tuple(sorted(every, key=lambda one: -one.title_probability))
    unnamed = unnamed_facts(believed, present)
    share = (
        0.0 if believed.verdict == "no_missing_effect" else unexplained_share(given.disagreement, present.disagreement)
    )
    families = _families(believed, added)
    told = sentences(believed, families, added, unnamed, given.disagreement, gap)
    found = Discovery(
        verdict=believed.verdict,
        verdict_probabilities=believed.verdicts,
        probabilities=_of_names(believed, added),
        families=families,
        sentences=(*told[:1], *run.cut_short, *told[1:], *run.binding, *run.notes, *badly_sampled(result.facts)),
        unexplained_share=share,
        unnamed=unnamed,
        binding=run.binding,
        added=added,
        steps=tuple(run.steps),
        limits=limits,
        gap=gap,
        before=given.disagreement,
        after=present.disagreement,
        histories={"before": _histories(given), "after": _histories(present)},
        model=given.model,
        cross_validated=present.cross_validation,
        improved=given.model if present is given else replace(present.model, carried=given.model.carried),
        record=record,
        held_out=held_out,
        result=result,
        name=name,
        data=run.data,
        assumptions=tuple(assumptions),
        seed=run.settings.seed,
        elapsed_s=elapsed,
        stopped=run.stopped,
    )
    return _not_searched(found, run) if run.stopped and not any(one.added for one in believed.explanations) else found


def _not_searched(found: Discovery, run: Run) -> Discovery:
    """What is left of a search in which no effect was tried: the model as given, fitted."""
    return replace(
        found,
        verdict="not_searched",
        verdict_probabilities={},
        sentences=(*not_searched(found.gap), *found.binding, *run.notes, *badly_sampled(found.result.facts)),
        unnamed=None,
        steps=(),
    )


def _added(
    hypothesis: Hypothesis,
    borne_out: float,
    present: Explanation,
    spread: Floats,
    believed: Beliefs,
    result: Result,
    run: Run,
) -> Added:
    """An effect of the improved model: how probable, what it competes with, its signature, its sizes."""
    places = believed.of_places(hypothesis.name)
    factor, error = believed.bayes_factor(frozenset({hypothesis.name}))
    others = _others(hypothesis, present, believed)
    moments = {p.name: (p.mean, p.sd) for p in result.facts.parameters}
    fits = {fit.hypothesis.name: fit for fit in reversed(run.first_fits)}
    apart = [one for one in others if one in fits and hypothesis.name in fits]
    return Added(
        hypothesis=hypothesis,
        probability=believed.of_name(hypothesis.name),
        place_probability=places.get(hypothesis.storeys, 0.0),
        log_bayes_factor=factor,
        log_bayes_factor_se=error,
        equivalent=others,
        equivalent_places=tuple(
            place for place, p in places.items() if place != hypothesis.storeys and p > _SHARES_PROBABILITY
        ),
        signature=signature_of(hypothesis, present, spread),
        borne_out=borne_out,
        moments={label: moments[label] for label in hypothesis.brought},
        separation=tuple(
            separating_experiment(fits[hypothesis.name], fits[one], hypothesis.scales.period) for one in apart
        ),
    )


def _families(believed: Beliefs, added: Sequence[Added]) -> tuple[Family, ...]:
    """Families of the effects that may have their names: a law that helps without its signature says nothing of it.

    Their title is deserved as much as it is by that one of them which deserves its own name most.
    """
    told, of_added = [], {one.hypothesis.name: one.deserved for one in added}
    for family in believed.families:
        share = {n: of_added[n] if n in of_added else _deserved_at_best(n, believed) for n in family.names}
        names = frozenset(name for name, deserved in share.items() if deserved >= POSSIBLE)
        if len(names) > 1:
            own = believed.family(family.title, names)
            told.append(replace(own, probability=own.probability * max(share[name] for name in names)))
    return tuple(told)


def _deserved_at_best(name: str, believed: Beliefs) -> float:
    """Whether an effect deserves its name at the best fit of the most probable explanation that has it."""
    best = next(one for one in believed.explanations if name in one.names)
    hypothesis = next(own for own in best.added if own.name == name)
    return deserved_by(signature_of(hypothesis, best, best.best[None][:0]))


def _of_names(believed: Beliefs, added: Sequence[Added]) -> dict[str, float]:
    """Probability of each name, best first; of what was added, that it deserves its name, too."""
    names = {**believed.law_probabilities}
    for one in sorted(added, key=lambda own: own.name_probability):
        names[one.hypothesis.name] = one.name_probability
    return dict(sorted(names.items(), key=lambda item: -item[1]))


def _others(hypothesis: Hypothesis, present: Explanation, believed: Beliefs) -> tuple[str, ...]:
    """Effects that are not part of the improved model and share the probability of one that is."""
    probable = [name for name, p in believed.names.items() if p > _SHARES_PROBABILITY and name not in present.names]
    # Only what stands where this effect does not competes with it.
    return tuple(
        name
        for name in probable
        if sum(
            p
            for one, p in zip(believed.explanations, believed.probabilities.tolist(), strict=True)
            if name in one.names and hypothesis.name not in one.names
        )
        > _SHARES_PROBABILITY
    )


def _gap(given: Explanation, present: Explanation, record: Record, counted: slice | NDArray[np.int64], run: Run) -> Gap:
    """Before and after on a record, at the samples that count."""
    before = predict(given.posterior, given.best, record, run.rng, counted=counted)
    after = before if present is given else predict(present.posterior, present.best, record, run.rng, counted=counted)
    return Gap(noise_floor=floor_of(record, counted=counted), before=before, after=after)


def _gap_held_out(given: Explanation, present: Explanation, held_out: HeldOut, believed: Beliefs, run: Run) -> Gap:
    """Before and after on what was held out; of samples among the fitted ones with predictive intervals."""
    gap = _gap(given, present, held_out.record, held_out.counted, run)
    if not held_out.repeats:
        return gap
    run.say("predicting the held-out repeat cycles with all explanations")
    return replace(gap, interval=predictive_interval(believed, held_out.record, held_out.counted, run.rng))


def _limits(present: Explanation, run: Run) -> tuple[DetectionLimit, ...]:
    one, scored = run.scored
    if one is None or not one.is_fitted_as(present):
        scored = score_all(present, hypotheses_of(present, run, np.inf), run)
    # What a name takes against a prior that gives one effect at one place its share of half.
    needed = float(np.log(NAMED / (1.0 - NAMED)) + np.log(max(len(scored), 1)))
    return tuple(
        DetectionLimit(
            label=hypothesis.label,
            name=hypothesis.name,
            storeys=hypothesis.storeys,
            parameter=one.amplitude,
            unit=one.unit,
            smallest=one.named_from(needed, _expected(hypothesis, one.amplitude)),
            expected=_expected(hypothesis, one.amplitude),
        )
        for hypothesis, one in scored
        if len(hypothesis.storeys) <= 1
    )


def _expected(hypothesis: Hypothesis, amplitude: str) -> float:
    return next(p.prior.sd for p in hypothesis.model.space.parameters if p.name == amplitude)


def _histories(present: Explanation) -> Mapping[str, Floats]:
    values, _ = present.posterior.split(present.best[None])
    rows = observe(present.posterior.engine, present.model, values, present.posterior.record)
    return {kind: history[0] for kind, history in rows.items()}
