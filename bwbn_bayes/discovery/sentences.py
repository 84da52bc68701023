"""The verdict in words: what is missing, how sure, what it competes with, and how the gap shrank."""

from __future__ import annotations

import numpy as np

from bwbn_bayes.discovery.outcome import Added, Gap, UnnamedForce
from bwbn_bayes.discovery.probability import Beliefs
from bwbn_bayes.discovery.where import Disagreement

_STRENGTHS = ((10.0, "overwhelming"), (5.0, "strong"), (2.3, "weak"), (-np.inf, "hardly any"))
"""Words for a log Bayes factor, from so many nats on (Kass and Raftery 1995, doi:10.1080/01621459.1995.10476572)."""
RUNAWAY = 3.0
"""Error over the signal from which a prediction is said to run away instead of being numbered."""


def evidence_in_words(log_bayes_factor: float) -> str:
    """``overwhelming``, ``strong``, ``weak`` or ``hardly any``."""
    return next(word for least, word in _STRENGTHS if log_bayes_factor >= least)


def sentences(
    believed: Beliefs, added: tuple[Added, ...], unnamed: UnnamedForce | None, before: Disagreement, gap: Gap
) -> tuple[str, ...]:
    """The verdict in words, the most important first.

    Parameters
    ----------
    believed : Beliefs
        The posterior over all explanations.
    added : tuple of Added
        Effects of the improved model.
    unnamed : UnnamedForce or None
        Where one is likely.
    before : Disagreement
        Of the model as given.
    gap : Gap
        Before and after.
    """
    first = [_first(believed, added)]
    if not added and unnamed is None:
        return tuple(first)
    own = [_effect(one) for one in added]
    if unnamed is not None:
        own.append(
            f"A force of no known law at {unnamed.place} takes up what the model does not: "
            f"{100.0 * unnamed.share:.0f} % of the force (probability {_probability(unnamed.probability)})."
        )
    places = {f"acceleration_{storey}" for one in added for storey in one.hypothesis.storeys}
    spots = [spot for spot in before.spots if spot.channel in places]
    where = [f"Where it showed: {spot.sentence}." for spot in (*spots, *before.spots)[:1]]
    return (*first, *own, *_gap(gap, changed=bool(added)), *where)


def _first(believed: Beliefs, added: tuple[Added, ...]) -> str:
    sure = f"probability {_probability(believed.verdicts[believed.verdict])}"
    named = [one for one in added if one.grade == "named"]
    titles = " and ".join(one.title for one in named)
    if believed.verdict == "no_missing_effect":
        return f"The model as given explains the record: nothing is missing ({sure})."
    if believed.verdict == "effects_found":
        if not titles:
            return f"Something is missing that the catalogue can hold, but no single effect is certain ({sure})."
        meaning = f": {named[0].hypothesis.effect.summary}" if len(named) == 1 else ""
        return f"The model lacks {titles}{meaning} ({sure})."
    if believed.verdict == "partly_explained":
        what = f"The model lacks {titles}, and more" if titles else "What the model lacks is only partly known"
        return f"{what}: beside it stays a force of no known law ({sure})."
    return (
        f"Model and record disagree, and no catalogued effect explains it better than a force of no known law ({sure})."
    )


def _effect(one: Added) -> str:
    """One effect: how sure it is, what else it could be, what it does to the loop."""
    words = {"named": "", "possible": "possibly, ", "weak": "perhaps, ", "shape": ""}[one.grade]
    text = (
        f"{words}{one.title}: {evidence_in_words(one.log_bayes_factor)} evidence "
        f"(probability {_probability(one.probability)}, {one.log_bayes_factor:.0f} nats)"
    )
    if one.alternatives:
        text += f"; the record cannot tell it from {' or '.join(one.alternatives)}"
    if one.signature is not None:
        seen = one.signature
        measured = "" if seen.measured is None else f"measured {seen.measured:.2g}, "
        text += f"; {seen.measure}: {measured}identified {seen.mean:.2g}, without it {seen.without:.2g}"
    if one.grade == "shape":
        text += "; the law helps, but not by what its usual name says"
    return f"{text[:1].upper()}{text[1:]}."


def _gap(gap: Gap, *, changed: bool) -> tuple[str, ...]:
    told = []
    for what, one in (("the fitted record", gap), ("the held-out data", gap.held_out)):
        if one is None:
            continue
        before, after = (error_in_words(p.nrmse) for p in (one.before, one.after))
        falls = f"goes from {before} to {after}" if changed else f"is {before}"
        told.append(f"The error on {what} {falls}; noise alone is {100.0 * one.noise_floor:.1f} %.")
    return tuple(told)


def error_in_words(nrmse: float) -> str:
    """A percentage of the signal; in words where the prediction runs away."""
    if not nrmse < RUNAWAY:
        return "a prediction that runs away"
    return f"{100.0 * nrmse:.1f} %"


def _probability(value: float) -> str:
    """Two digits, and no certainty."""
    if value > 0.99:
        return f"{min(value, 0.9999):.4g}" if value < 0.9995 else "above 0.999"
    return f"{value:.2g}" if value >= 0.01 else "below 0.01"
