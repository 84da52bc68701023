"""The verdict in words: what is missing, how sure, what it competes with, and how the gap shrank."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bwbn_bayes.discovery.explanation import Explanation
from bwbn_bayes.discovery.held_out import Prediction
from bwbn_bayes.discovery.outcome import Added, Gap, SignatureFacts, UnnamedForce, UnnamedReading
from bwbn_bayes.discovery.probability import NAMED, Beliefs, Family
from bwbn_bayes.discovery.where import Disagreement
from bwbn_bayes.elements.catalogue import capital, title_of
from bwbn_bayes.inference.unnamed.further_link import Span
from bwbn_bayes.results import Facts

_STRENGTHS = ((10.0, "overwhelming"), (5.0, "strong"), (2.3, "weak"), (-np.inf, "hardly any"))
"""Words for a log Bayes factor, from so many nats on (Kass and Raftery 1995, doi:10.1080/01621459.1995.10476572)."""

_FEWEST_DRAWS = 100
"""Independent draws that a stated posterior error takes."""


def evidence_in_words(log_bayes_factor: float) -> str:
    """``overwhelming``, ``strong``, ``weak`` or ``hardly any``."""
    return next(word for least, word in _STRENGTHS if log_bayes_factor >= least)


def sentences(
    believed: Beliefs,
    families: tuple[Family, ...],
    added: tuple[Added, ...],
    unnamed: UnnamedForce | UnnamedReading | None,
    before: Disagreement,
    gap: Gap,
) -> tuple[str, ...]:
    """The verdict in words, the most important first.

    Parameters
    ----------
    believed : Beliefs
        The posterior over all explanations.
    families : tuple of Family
        Told where none of a family's effects has earned its own name.
    added : tuple of Added
        Effects of the improved model.
    unnamed : UnnamedForce, UnnamedReading or None
        Where one is likely.
    before : Disagreement
        Of the model as given.
    gap : Gap
        Before and after.
    """
    certain = [one for one in added if one.grade == "named" or (one.grade == "shape" and one.law_probability >= NAMED)]
    unsplit = [
        one
        for one in families
        if one.probability >= NAMED and not any(own.hypothesis.name in one.names for own in certain)
    ]
    first = [_first(believed, certain, unsplit, unnamed)]
    if not added and unnamed is None:
        return (*first, *_runner_up(believed), *_gap(gap, changed=False))
    # Beside a force of no known law effects that hardly differ from it have no name, and predict all the same.
    shaping = [one for one in added if one.grade == "weak"] if unnamed is not None else []
    own = [*map(_either, unsplit), *(_effect(one) for one in added if one not in shaping)]
    if unnamed is not None:
        own.append(_unnamed(unnamed, gap))
    if shaping:
        own.append(_shaping(shaping))
    places = {f"acceleration_{storey}" for one in added for storey in one.hypothesis.storeys}
    spots = [spot for spot in before.spots if spot.channel in places]
    where = [f"Where it showed: {spot.sentence}." for spot in (*spots, *before.spots)[:1]]
    return (*first, *own, *_runner_up(believed), *_gap(gap, changed=bool(added)), *where)


def not_searched(gap: Gap) -> tuple[str, ...]:
    """What is said where the time was over before any effect was tried."""
    first = (
        "The search was stopped by the time limit before any effect was tried: whether the model lacks something, and "
        "what, is not known."
    )
    return (first, *_gap(gap, changed=False))


def _unnamed(one: UnnamedForce | UnnamedReading, gap: Gap) -> str:
    """What has no name: where it is, how large, what it is a function of, and what is left beside it."""
    if isinstance(one, UnnamedForce):
        # "A link between the ground and floor 2"
        what = capital(one.place) if one.nodes else f"A force of no known law at {one.place}"
        whole, again = "force", "a force"
    else:
        what, whole, again = f"An error of no known kind in {one.channel}", "reading", "an error"
    percent = 100.0 * one.share
    share, kind = (
        f"{percent:{'.0f' if percent >= 1.0 else '.1g'}} % of the {whole}",
        f", {again} {one.function}" if one.function else "",
    )
    left = [f"{100.0 * own.nameless.nrmse:.2g} % of the {on}" for on, own in _parts(gap) if own.nameless is not None]
    beside = f" With it {' and '.join(left)} is left." if left else ""
    there, anywhere = (probability_in_words(value) for value in (one.probability, one.any_probability))
    elsewhere = "" if anywhere == there else f"; that anything has no name, {anywhere}"
    sure = f"(probability {there}{elsewhere})"
    return f"{what} takes up what the model does not: {share} {sure}{kind}.{beside}"


def _parts(gap: Gap) -> list[tuple[str, Gap]]:
    """The gap on what was fitted, and on what was held out."""
    return [("fitted record", gap), *([("held-out data", gap.held_out)] if gap.held_out is not None else [])]


def _first(
    believed: Beliefs,
    certain: Sequence[Added],
    unsplit: Sequence[Family],
    unnamed: UnnamedForce | UnnamedReading | None,
) -> str:
    sure = f"probability {probability_in_words(believed.verdicts[believed.verdict])}"
    titles = " and ".join([*(one.title for one in certain), *(one.title for one in unsplit)])
    if believed.verdict == "no_missing_effect":
        return f"The model as given explains the record: nothing is missing ({sure})."
    if believed.verdict == "effects_found":
        if not titles:
            return f"Something is missing that the catalogue can hold, but no single effect is certain ({sure})."
        alone = [one.grade for one in certain] == ["named"] and not unsplit
        meaning = f": {certain[0].hypothesis.effect.summary}" if alone else ""
        return f"The model lacks {titles}{meaning} ({sure})."
    shown = believed.first_of(believed.verdict)
    best = believed.explanations[shown]
    if believed.verdict == "partly_explained":
        what = f"The model lacks {titles}, and more" if titles else "What the model lacks is only partly known"
        is_shown = best.has_unnamed or unnamed is not None
        left = f"stays {_nameless(best)}" if is_shown else _left_by_law(believed, shown)
        return f"{what}: beside it {left} ({sure})."
    if best.has_unnamed:
        rest = f"no catalogued effect explains it better than {_nameless(best)}"
    elif unnamed is not None:
        rest = f"no catalogued effect explains it: it is {_nameless(best)}"
    else:
        rest = "neither a catalogued effect nor a smooth force of the storeys explains it"
    return f"Model and record disagree, and {rest} ({sure})."


def _left_by_law(believed: Beliefs, number: int) -> str:
    """What the laws of one of the explanations leave by themselves."""
    if believed.forgiven[number] > 0.0:
        return f"stays what its law may err by, {100.0 * believed.law_error[number]:.1g} % of what it does"
    return "stays what no smooth force explains"


def _nameless(best: Explanation) -> str:
    if isinstance(best.unnamed, Span):
        return "a link that the model lacks"
    return "an error of a sensor" if isinstance(best.unnamed, str) else "a force of no known law"


def _effect(one: Added) -> str:
    """One effect: how sure it is, what else it could be, what it does to the loop."""
    words = {"named": "", "possible": "possibly ", "weak": "perhaps ", "shape": ""}[one.grade]
    sure = evidence_in_words(one.log_bayes_factor)
    text = (
        f"{words}{one.title}: {sure} evidence "
        f"({nats_in_words(one.log_bayes_factor)}, probability {probability_in_words(one.title_probability)})"
    )
    if one.alternatives:
        text += f"; the record cannot tell it from {' or '.join(one.alternatives)}"
    if one.is_plain:
        text += f"; {_without_a_name(one)}"
    if one.borne_out < NAMED:
        shown = probability_in_words(one.borne_out)
        text += f"; more than noise is left, and something else may look like it (borne out with probability {shown})"
    if one.signature is not None and not one.signature.unmeasured:
        text += f"; {signature_in_words(one.signature)}"
    return f"{capital(text)}."


def _without_a_name(one: Added) -> str:
    """Why a law that is there goes by its plain name."""
    name, seen = title_of(one.hypothesis.name), one.signature
    if seen is not None and seen.unmeasured:
        unknown = f"its signature ({seen.measure}) could not be measured: {seen.unmeasured}"
        return f"whether it is {name} is not known, since {unknown}"
    return f"the law helps, but not by what its name, {name}, says"


def _either(family: Family) -> str:
    """That one of a family's effects is there, which none of them may claim for itself."""
    sure = evidence_in_words(family.log_bayes_factor)
    words = f"{nats_in_words(family.log_bayes_factor)}, probability {probability_in_words(family.probability)}"
    names = " and ".join(title_of(name) for name in sorted(family.names))
    title = capital(family.title)
    return f"{title}: {sure} evidence ({words}); which of {names} it is, the record does not tell."


def _shaping(weak: Sequence[Added]) -> str:
    """Effects of the improved model that make it predict better, and that no evidence names."""
    titles = [one.title for one in weak]
    what = f"{', '.join(titles[:-1])} and {titles[-1]}" if len(titles) > 1 else titles[0]
    largest = probability_in_words(max(one.title_probability for one in weak))
    none = "none of them has" if len(titles) > 1 else "it has not"
    sure = f"probability {largest}" if len(titles) == 1 else f"the likeliest with probability {largest}"
    return f"The improved model also has {what}, with which it predicts better; {none} earned a name ({sure})."


def signature_in_words(seen: SignatureFacts) -> str:
    """``pinching index 0.09 measured, 0.07 identified (0.05 to 0.09), 0.5 without it``."""
    unit = f" {seen.unit}" if seen.unit else ""
    measured = "" if seen.measured is None else f"{seen.measured:.2g}{unit} measured, "
    without = f", {seen.without:.2g}{unit} without it" if np.isfinite(seen.without) else ""
    return f"{seen.measure} {measured}{seen.mean:.2g}{unit} identified ({seen.low:.2g} to {seen.high:.2g}){without}"


def _runner_up(believed: Beliefs) -> tuple[str, ...]:
    second = runner_up(believed.explanations, believed.log_joint.tolist())
    return (
        ()
        if second is None
        else (f"The next best set of laws, {second[0].label}, is {nats_in_words(second[1])} behind.",)
    )


def runner_up(explanations: Sequence[Explanation], log_joint: Sequence[float]) -> tuple[Explanation, float] | None:
    """The best explanation with other effects or places than the first has, and how far it is behind, in nat."""
    first = explanations[0]
    for one, value in zip(explanations, log_joint, strict=True):
        if (one.placed, one.has_unnamed) != (first.placed, first.has_unnamed):
            return one, log_joint[0] - value
    return None


def nats_in_words(nats: float) -> str:
    """``812 nats``, ``3.4 nats``."""
    return f"{nats:.{0 if abs(nats) >= 10.0 else 1}f} nats"


def _gap(gap: Gap, *, changed: bool) -> tuple[str, ...]:
    told = []
    for what, one in _parts(gap):
        noise = f"noise alone leaves {100.0 * one.noise_floor:.1f} %"
        before, after = _error(one.before), _error(one.after)
        if not changed:
            told.append(f"On the {what} {before}; {noise}.")
        elif one.before.runs_away_after or one.after.runs_away_after:
            told.append(f"On the {what}, as given, {before}; improved, {after}; {noise}.")
        else:
            goes = "falls" if one.after.nrmse < one.before.nrmse else "grows"
            ends = f"from {one.before.error_in_words} to {one.after.error_in_words}"
            told.append(f"On the {what} the error {goes} {ends}; {noise}.")
    if gap.held_out is not None and gap.held_out.interval is not None:
        told.append(gap.held_out.interval.in_words)
    return tuple(told)


def _error(prediction: Prediction) -> str:
    words = prediction.error_in_words
    return words if prediction.runs_away_after else f"the error is {words}"


def probability_in_words(value: float) -> str:
    """Two digits, and no certainty."""
    if value > 0.99:
        return f"{min(value, 0.9999):.4g}" if value < 0.9995 else "above 0.999"
    return f"{value:.2g}" if value >= 0.01 else "below 0.01"


def badly_sampled(facts: Facts) -> tuple[str, ...]:
    """A sentence where posterior errors rest on hardly a draw; none where importance sampling served, or TMCMC ran."""
    worth = min((check.value for check in facts.checks if check.name == "effective draws"), default=np.inf)
    heavy = any(check.name == "Pareto k" and not check.passed for check in facts.checks)
    if facts.method != "importance" or not (heavy or worth < _FEWEST_DRAWS):
        return ()
    sentence = (
        f"The posterior of the final model could not be sampled well: its draws are worth {worth:.0f} independent "
        "ones, and the errors stated for its parameters are rough. In the report's folder, bwbn identify "
        "improved_model.py --method tmcmc samples it by transitional MCMC, into reports/improved_model_tmcmc there."
    )
    return (sentence,)
