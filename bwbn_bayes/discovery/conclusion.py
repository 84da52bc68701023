"""What a finished search comes to: the verdict, what is left, what could have been seen, the final posterior."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.discovery.held_out import HeldOut, floor_of, predict
from bwbn_bayes.discovery.name import THRESHOLD, Candidate, log_prior_odds
from bwbn_bayes.discovery.outcome import Added, DetectionLimit, Discovery, Gap, Step, Verdict
from bwbn_bayes.discovery.run import Present, Run, hypotheses_of, score_all
from bwbn_bayes.discovery.unexplained import unexplained
from bwbn_bayes.discovery.where import Disagreement
from bwbn_bayes.inference.identify import identify_from
from bwbn_bayes.inference.residuals import LARGEST_RATIO
from bwbn_bayes.inference.settings import Settings
from bwbn_bayes.inference.summary import observe
from bwbn_bayes.parameters import Floats
from bwbn_bayes.records.record import Record
from bwbn_bayes.results import Facts

FOUND_SHARE, PARTLY_SHARE = 0.1, 0.25
"""Unexplained share up to which effects count as found, and one alone as contributing."""
FOUND_LEVEL, NEAR_LEVEL = LARGEST_RATIO, 1.5
"""Residual to noise up to which effects that leave no noise count as found, and one alone as contributing whatever came
after it: most of a large gap can be gone and yet what is left be several times the noise, which a law of the same kind
leaves that is not the right one."""
SHAPE_SHARE = 0.04
"""Share left, of the record that was fitted and of a held-out one, up to which one alone counts as contributing
whatever came after it, even at many times a small noise: so little is left by the right law in another shape."""
_FEWEST_DRAWS = 100
"""Independent draws that a stated posterior error takes."""
MOST_AT_ONCE = 2
"""With more, they are as likely to imitate together one that the catalogue lacks: they count as contributing."""


Foresight = Callable[[Present], Gap | None]
"""The gap on held-out data before and after as a function of the model after; None where nothing is held out."""


class Grown(NamedTuple):
    """A model as it grew."""

    present: Present
    added: tuple[Added, ...]
    first: Present | None
    """With the first effect alone."""
    ended: bool
    """Whether nothing is left that could be added."""


def conclude(
    given: Present,
    grown: Grown,
    held_out: HeldOut | None,
    name: str,
    assumptions: Sequence[str],
    run: Run,
) -> Discovery:
    """Turn a finished search into what it found.

    Parameters
    ----------
    given : Present
        The model as given.
    grown : Grown
        What became of it.
    held_out : HeldOut or None
        Predicted here, and nowhere before.
    name : str
        The model's name in reports.
    assumptions : sequence of str
        What the model as given takes for granted.
    run : Run
    """
    foreseen = _foresight(given, held_out, run)
    verdict, present, added = _what_stays(given, grown, foreseen)
    if withdrawn := grown.added[len(added) :]:
        why = _why_withdrawn(unexplained_share(given, grown.present), grown.added, foreseen(grown.present))
        for one in withdrawn:
            run.withdraw(why, one.decision)
    share = 0.0 if verdict == "no_missing_effect" else unexplained_share(given, present)
    before, after, model = given.disagreement, present.disagreement, given.posterior.model
    rest = None
    if verdict in ("unexplained", "partly_explained"):
        run.say("learning the missing storey force")
        rest = unexplained(present.posterior, present.best, _weighed_against(present, run.steps), run.rng)
    run.say("looking for the smallest effects that this record could have shown")
    limits = _limits(present, run)
    posterior, record = present.posterior, present.posterior.record
    gap = replace(_gap(given, present, record, 0, run), held_out=foreseen(present))
    elapsed = run.elapsed
    run.say("sampling the posterior of the final model")
    result = identify_from(
        posterior,
        np.array([mode.point for mode in present.modes[:8]]),
        settings=Settings(seed=run.settings.seed, particles=run.settings.particles, fallback=False),
        name=name,
        assumptions=assumptions,
        listener=lambda text, _: run.say(text),
    )
    moments = {p.name: (p.mean, p.sd) for p in result.facts.parameters}
    added = tuple(
        replace(one, moments={label: moments[label] for label in one.candidate.hypothesis.brought}) for one in added
    )
    return Discovery(
        verdict=verdict,
        sentences=(*_sentences(verdict, added, share, before, after, gap), *run.notes, *badly_sampled(result.facts)),
        unexplained_share=share,
        unexplained=rest,
        added=added,
        steps=tuple(run.steps),
        limits=limits,
        gap=gap,
        before=before,
        after=after,
        histories={"before": _histories(given), "after": _histories(present)},
        model=model,
        improved=model if present is given else replace(posterior.model, carried=model.carried),
        record=record,
        held_out=held_out,
        result=result,
        name=name,
        assumptions=tuple(assumptions),
        seed=run.settings.seed,
        elapsed_s=elapsed,
    )


def badly_sampled(facts: Facts) -> tuple[str, ...]:
    """A sentence where posterior errors rest on hardly a draw; none where importance sampling served, or TMCMC ran."""
    worth = min((check.value for check in facts.checks if check.name == "effective draws"), default=np.inf)
    heavy = any(check.name == "Pareto k" and not check.passed for check in facts.checks)
    if facts.method != "importance" or not (heavy or worth < _FEWEST_DRAWS):
        return ()
    sentence = (
        f"The posterior of the final model could not be sampled well: its draws are worth {worth:.0f} independent "
        "ones, and the errors stated for its parameters are rough. `bwbn identify improved_model.py` falls back on "
        "transitional MCMC."
    )
    return (sentence,)


def _gap(given: Present, present: Present, record: Record, first: int, run: Run) -> Gap:
    """Before and after on a record, from its sample ``first`` on."""
    before = predict(given.posterior, given.best, record, run.rng, first=first)
    after = before if present is given else predict(present.posterior, present.best, record, run.rng, first=first)
    return Gap(noise_floor=floor_of(record, first=first), before=before, after=after)


def _foresight(given: Present, held_out: HeldOut | None, run: Run) -> Foresight:
    """The gap on held-out data, of which each model is asked once."""
    if held_out is None:
        return lambda _: None
    record, first = held_out.record, held_out.first
    known = {id(given): _gap(given, given, record, first, run)}

    def foreseen(present: Present) -> Gap:
        if id(present) not in known:
            after = predict(present.posterior, present.best, record, run.rng, first=first)
            known[id(present)] = replace(known[id(given)], after=after)
        return known[id(present)]

    return foreseen


def _weighed_against(present: Present, steps: Sequence[Step]) -> tuple[Candidate, ...]:
    """Candidates of the last round that weighed them against this model; none if no round did."""
    own = [step.decision for step in steps if step.decision is not None and step.model == present.posterior.model]
    return own[-1].candidates if own else ()


def unexplained_share(given: Present, present: Present) -> float:
    """What is left of the residual energy beyond the noise."""
    excess = [
        float(np.sum(np.maximum(np.square(one.disagreement.residual_to_noise) - 1.0, 0.0))) for one in (given, present)
    ]
    return min(excess[1] / excess[0], 1.0) if excess[0] > 0.0 else 0.0


def what_stayed(share: float) -> str:
    """Why an effect is withdrawn that leaves so much."""
    return f"{100 * share:.0f} % of the disagreement stayed"


def _missed_by(ahead: Gap | None) -> float:
    """Error on held-out data over their noise; zero where it is that of the noise, or there are no such data."""
    return 0.0 if ahead is None or ahead.is_closed else ahead.left


def _level(left: Disagreement) -> float:
    """Residual to noise of the channel that is missed most."""
    return float(np.max(left.residual_to_noise))


def _left_ahead(ahead: Gap) -> float:
    """What is left of the error on held-out data beyond the noise, in energy; infinite where they are not solved."""
    before, after = (np.square(one.nrmse) - np.square(ahead.noise_floor) for one in (ahead.before, ahead.after))
    if not np.isfinite(after):
        return np.inf
    return float(after / before) if before > 0.0 else np.inf


def _foresees_little(ahead: Gap | None, n_added: int) -> bool:
    """Whether held-out data are missed: by no less than without the one effect, or by more than a share of several.

    Several that imitate a record still foresee other data a little better than a model that is far off.
    """
    if ahead is None or ahead.is_closed:
        return False
    return not _left_ahead(ahead) < (1.0 if n_added == 1 else PARTLY_SHARE)


def _is_near(given: Present, present: Present, level: float) -> bool:
    """Whether little is left of the disagreement, and no more than so many times the noise."""
    return unexplained_share(given, present) <= FOUND_SHARE and _level(present.disagreement) <= level


def _comes_near(given: Present, first: Present, ahead: Gap | None) -> bool:
    """Whether a model with one effect leaves little: hardly more than the noise, or hardly anything of the gap."""
    if _foresees_little(ahead, 1):
        return False
    left_ahead = 0.0 if ahead is None or ahead.is_closed else _left_ahead(ahead)
    return _is_near(given, first, NEAR_LEVEL) or max(unexplained_share(given, first), left_ahead) <= SHAPE_SHARE


def _imitated(added: Sequence[Added]) -> str:
    """The effect of which two forms act at one place, if one does: neither is then the right one.

    Two effects alone may be two forms where these do not exclude each other, such as gaps to either side. Changes of
    two parameters of one storey are no forms of each other.
    """
    hypotheses = [one.candidate.hypothesis for one in added]
    acts = [(h.name, h.storeys, getattr(h.effect, "parameter", "")) for h in hypotheses]
    return next(
        (
            h.name
            for n, (h, act) in enumerate(zip(hypotheses, acts, strict=True))
            if act in acts[:n] and (h.effect.one_law or len(added) > MOST_AT_ONCE)
        ),
        "",
    )


def _doubt(added: Sequence[Added]) -> str:
    """Why one of the effects is hardly what its name says, if one is."""
    return next((one.doubt for one in added if one.doubt), "")


def _why_withdrawn(share: float, added: Sequence[Added], ahead: Gap | None) -> str:
    if name := _imitated(added):
        return f"two forms of {name} at one place can only imitate another effect"
    if ahead is not None and _foresees_little(ahead, len(added)):
        than = "no less than without"
        if (left := _left_ahead(ahead)) < 1.0:
            than = f"{100 * left:.0f} % of the disagreement there stayed"
        return f"the held-out record is missed by {_missed_by(ahead):.1f} times its noise, {than}"
    if doubt := _doubt(added):
        return doubt
    if share <= FOUND_SHARE and (missed := _missed_by(ahead)):
        return f"so many effects, and they miss the held-out record by {missed:.1f} times its noise"
    return what_stayed(share)


def is_explained(given: Present, present: Present, added: tuple[Added, ...]) -> bool:
    """Whether nothing of note stays unexplained of the record that was fitted."""
    return _verdict(given, present, added, None) in ("effects_found", "no_missing_effect")


def _what_stays(given: Present, grown: Grown, foreseen: Foresight) -> tuple[Verdict, Present, tuple[Added, ...]]:
    """The verdict, with what stays added where all of it together is withdrawn: the first effect, or nothing.

    The first alone stays where it comes near: what followed imitates the rest of its own law.
    """
    verdict = _verdict(given, grown.present, grown.added, foreseen(grown.present))
    if verdict != "unexplained" or not grown.added:
        return verdict, grown.present, grown.added
    first = grown.first if len(grown.added) > 1 and not _doubt(grown.added[:1]) else None
    if first is not None and _comes_near(given, first, foreseen(first)):
        return "partly_explained", first, grown.added[:1]
    return verdict, given, ()


def _verdict(given: Present, present: Present, added: tuple[Added, ...], ahead: Gap | None) -> Verdict:
    """The verdict, with the gap on held-out data if there are any: what imitates the record does not foresee others."""
    noise, share = present.is_noise, unexplained_share(given, present)
    if not added:
        return "no_missing_effect" if noise else "unexplained"
    if _foresees_little(ahead, len(added)) or _imitated(added):
        return "unexplained"
    # Steady noise can hide that much is left of a small disagreement; only where nothing of note is left is it found.
    explains = _is_near(given, present, FOUND_LEVEL) or present.is_quiet or (noise and share <= PARTLY_SHARE)
    if len(added) <= MOST_AT_ONCE and explains and not _missed_by(ahead):
        return "effects_found"
    if _doubt(added) or (len(added) > MOST_AT_ONCE and _missed_by(ahead)):
        return "unexplained"
    # Several that leave so much together only imitate what the catalogue lacks.
    most = PARTLY_SHARE if len(added) == 1 else FOUND_SHARE
    return "partly_explained" if noise or share <= most else "unexplained"


def _limits(present: Present, run: Run) -> tuple[DetectionLimit, ...]:
    model, scored = run.scored
    if model is not present.posterior.model:
        scored = score_all(present, hypotheses_of(present, run, np.inf), run)
    prior = log_prior_odds([hypothesis for hypothesis, _ in scored])
    return tuple(
        DetectionLimit(
            label=hypothesis.label,
            name=hypothesis.name,
            storeys=hypothesis.storeys,
            parameter=one.amplitude,
            unit=one.unit,
            smallest=one.named_from(THRESHOLD - prior[hypothesis.name], _expected(hypothesis, one.amplitude)),
            expected=_expected(hypothesis, one.amplitude),
        )
        for hypothesis, one in scored
        if len(hypothesis.storeys) <= 1
    )


def _expected(hypothesis: Hypothesis, amplitude: str) -> float:
    return next(p.prior.sd for p in hypothesis.model.space.parameters if p.name == amplitude)


def _histories(present: Present) -> dict[str, Floats]:
    values, _ = present.posterior.split(present.best[None])
    rows = observe(present.posterior.engine, present.posterior.model, values, present.posterior.record)
    return {kind: history[0] for kind, history in rows.items()}


def _sentences(
    verdict: Verdict, added: tuple[Added, ...], share: float, before: Disagreement, after: Disagreement, gap: Gap
) -> tuple[str, ...]:
    level = _level(after)
    labels = ", then ".join(map(_named, added))
    meaning = f": {added[0].candidate.hypothesis.effect.summary}" if len(added) == 1 else ""
    shrunk = (
        f"The error of fit falls from {100 * gap.before.nrmse:.1f} % to {100 * gap.after.nrmse:.1f} % of the signal; "
        f"the noise is {100 * gap.noise_floor:.1f} %."
    )
    contributes = f"{'contributes' if len(added) == 1 else 'contribute'}, but "
    if len(added) > MOST_AT_ONCE:
        contributes = (
            f"together explain all but {100 * share:.0f} % of the disagreement, but so many may imitate an effect that "
            "the catalogue does not hold"
        )
    elif level <= FOUND_LEVEL and (missed := _missed_by(gap.held_out)):
        contributes += f"the held-out record is missed by {missed:.1f} times its noise"
    else:
        stays = f"{100 * share:.0f} %" if share >= 0.005 else "less than 1 %"
        contributes += f"{stays} of the disagreement stays unexplained, {level:.1f} times the noise"
    first = {
        "effects_found": f"The model lacks {labels}{meaning}.",
        "partly_explained": f"{labels} {contributes}.",
        "no_missing_effect": "The model as given explains the record: what it leaves is noise.",
        "unexplained": "Model and record disagree, and no catalogued effect explains it.",
    }[verdict]
    if verdict == "no_missing_effect":
        return (first,)
    places = {f"acceleration_{storey}" for one in added for storey in one.candidate.hypothesis.storeys}
    own = [spot for spot in before.spots if spot.channel in places]
    spots = tuple(f"Where it showed: {spot.sentence}." for spot in (*own, *before.spots)[:1])
    return (first, shrunk, *spots) if added else (first, *spots)


def _named(added: Added) -> str:
    """The effect and its place, with what the record cannot tell it from."""
    label = added.candidate.hypothesis.label
    return f"{label} (or {' or '.join(added.alternatives)}: the record cannot tell)" if added.alternatives else label
