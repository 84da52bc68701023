"""From evidences to answers: which explanation, which class of them, which effect and where, each with a probability.

An explanation is the model as given with some effects added and with or without something that has no name. Each has a
prior, made of the numbers below and of nothing else, and an evidence; the posterior over all of them is summed up by
class, by effect and by place. Held-out data play no part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from scipy.special import gammaln, logsumexp

from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.discovery.consistency import probability_of_being_better
from bwbn_bayes.discovery.explanation import Explanation, Place, forced_storeys
from bwbn_bayes.discovery.where import unexplained_share
from bwbn_bayes.parameters import Floats

NOTHING_MISSING = 0.5
"""Prior probability that the model as given is all there is."""
ANOTHER = 0.2
"""Prior probability, where something is missing, of each further effect, and that something without a name is part of
it (a force, a link, an error of a sensor): models that lack two things are rarer, and the catalogue holds most of what
structures and sensors do."""
LAW_ERROR = 0.01
"""By how much a law errs about an effect, over what the effect does: no structure follows a formula more closely, and
what a law errs by is no further effect."""
NAMED = 0.9
"""Probability from which an effect is named: of ten names one may be wrong."""
POSSIBLE = 0.5
"""Probability from which an effect is said to be possible: it is more likely there than not."""

_NEGLIGIBLE = 1e-3
"""Probability of an explanation below which it moves no verdict."""

Verdict = Literal["effects_found", "partly_explained", "no_missing_effect", "unexplained"]
_CLASSES: Mapping[tuple[bool, bool], Verdict] = {
    (False, False): "no_missing_effect",
    (True, False): "effects_found",
    (True, True): "partly_explained",
    (False, True): "unexplained",
}
"""By whether an effect was added, and something without a name is part of it or left by it."""


@dataclass(frozen=True, kw_only=True)
class Family:
    """Effects of which one or another is part of the model, whichever it is.

    Attributes
    ----------
    title : str
        What they are, in words.
    names : frozenset of str
        Those that explanations have.
    probability : float
        That one of them is there, and borne out.
    log_bayes_factor : float
        Of all explanations with one of them against all without any. [nat]
    """

    title: str
    names: frozenset[str]
    probability: float
    log_bayes_factor: float

    def as_json(self) -> dict[str, Any]:
        """One entry of ``families`` of ``discovery.json``."""
        return {
            "title": self.title,
            "names": sorted(self.names),
            "probability": self.probability,
            "log_bayes_factor": self.log_bayes_factor,
        }


@dataclass(frozen=True, kw_only=True)
class Beliefs:
    """The posterior over explanations.

    Attributes
    ----------
    explanations : tuple of Explanation
        Best first.
    log_prior : (n,) array
        Of each.
    law_error : (n,) array
        By how much its laws would have to err for all that others with the same effects explain beyond it, over what
        they do; zero where that is not asked, and where nobody explains more.
    forgiven : (n,) array
        Evidence that it has by such an error. [nat]
    """

    explanations: tuple[Explanation, ...]
    log_prior: Floats
    law_error: Floats
    forgiven: Floats

    @cached_property
    def probabilities(self) -> Floats:
        """Of each explanation, ``(n,)``."""
        log_joint = self.log_joint
        share: Floats = np.exp(log_joint - logsumexp(log_joint))
        return share

    @cached_property
    def log_joint(self) -> Floats:
        """Log prior and log evidence of each, ``(n,)``, in nat."""
        return np.asarray(self.log_prior + self._log_evidence)

    @property
    def _log_evidence(self) -> Floats:
        return np.asarray(_log_evidences(self.explanations) + self.forgiven)

    @property
    def best(self) -> Explanation:
        """The most probable explanation."""
        return self.explanations[0]

    @cached_property
    def verdicts(self) -> dict[Verdict, float]:
        """Probability of each of the four classes.

        The classes presume that one of them is right, which is checked: what an explanation leaves must be noise, by
        the tests of :mod:`~bwbn_bayes.inference.residuals`. Else something without a name is left, a force or not, and
        it counts among those that have it.
        """
        probabilities = self.probabilities.tolist()
        return {
            verdict: float(
                min(sum(p for p, own in zip(probabilities, self._classes, strict=True) if own == verdict), 1.0)
            )
            for verdict in _CLASSES.values()
        }

    @cached_property
    def _classes(self) -> list[Verdict]:
        """Of each explanation."""
        return [_CLASSES[bool(one.added), self._has_nameless(one, p)] for one, p in self._pairs]

    def first_of(self, verdict: Verdict) -> int:
        """Which of the explanations is the most probable one of a class."""
        return self._classes.index(verdict)

    def _has_nameless(self, one: Explanation, probability: float) -> bool:
        """Whether something without a name is part of an explanation, or left by it; the improbable are not asked."""
        return one.has_unnamed or (probability > _NEGLIGIBLE and not one.is_noise)

    @property
    def _pairs(self) -> list[tuple[Explanation, float]]:
        return list(zip(self.explanations, self.probabilities.tolist(), strict=True))

    @property
    def verdict(self) -> Verdict:
        """The most probable class."""
        return max(self.verdicts, key=lambda one: self.verdicts[one])

    @cached_property
    def names(self) -> dict[str, float]:
        """Probability that each effect is part of the model, over all forms, places and combinations, best first."""
        every = {hypothesis.name for one in self.explanations for hypothesis in one.added}
        found = {name: self.of_name(name) for name in every}
        return dict(sorted(found.items(), key=lambda item: (-item[1], item[0])))

    def of_name(self, name: str) -> float:
        """Probability that an effect is part of the model."""
        return self._sum(lambda one: name in one.names)

    @cached_property
    def unnamed(self) -> float:
        """Probability that something without a name is part of the model."""
        return self._sum(lambda one: one.has_unnamed)

    @property
    def beyond(self) -> float:
        """Probability that something without a name is part of the model, or left by it."""
        return self.verdicts["partly_explained"] + self.verdicts["unexplained"]

    def of_unnamed(self, place: Place) -> float:
        """Probability of something without a name at a place, of whatever kind and beside whatever effects."""
        # As tuples, storeys 1 and 2 are what a link between floors 1 and 2 is.
        return self._sum(lambda one: one.unnamed == place and type(one.unnamed) is type(place))

    def of_places(self, name: str) -> dict[tuple[int, ...], float]:
        """Probability that an effect is part of the model at each place, best first."""
        places = {h.storeys for one in self.explanations for h in one.added if h.name == name}
        found = {place: self._sum(lambda one, at=place: (name, at) in one.placed) for place in places}  # type: ignore[misc]
        return dict(sorted(found.items(), key=lambda item: (-item[1], item[0])))

    @cached_property
    def likely(self) -> frozenset[tuple[str, tuple[int, ...]]]:
        """Effects that are more likely there than not, each at its place.

        Of several places, none of which could be named against the most probable one, that of the fewest storeys: where
        an effect never comes into play, it is as probable as where it is not.
        """
        found = set()
        for name in (name for name, p in self.names.items() if p >= POSSIBLE):
            places = self.of_places(name)
            least = max(places.values()) * (1.0 - NAMED) / NAMED
            close = [place for place, p in places.items() if p >= least]
            found.add((name, min(close, key=lambda place: (len(place), -places[place]))))
        return frozenset(found)

    @cached_property
    def _absent(self) -> frozenset[str]:
        return frozenset(name for name, p in self.names.items() if p < 1.0 - NAMED)

    @cached_property
    def deliverable(self) -> tuple[Explanation, ...]:
        """What may be delivered, the most probable first: laws without an unnamed force, which knows nothing ahead.

        Those that have what is likely, and nothing that could be named as absent. Where the best of them leaves more
        than noise, none is right; what the force takes up is not absent then, and what is named must be there alone.
        There the evidence counts as it is: that laws may err, which the force tells, lets none of them predict better.
        """
        plain = [one for one in self.explanations if not one.has_unnamed]
        if plain[0].is_noise:
            holding = [one for one in plain if self.likely <= one.placed]
            tried = [one for one in holding if not self._absent & one.names] or holding
        else:
            named = {name for name, p in self.law_probabilities.items() if p >= NAMED}
            kin = [family.names for family in self.families if family.probability >= NAMED]
            by_evidence = [self.explanations[n] for n in np.argsort(self.forgiven - self.log_joint, kind="stable")]
            plain = [one for one in by_evidence if not one.has_unnamed]
            tried = [one for one in plain if named <= one.names and all(names & one.names for names in kin)]
        return tuple(tried or plain)

    @cached_property
    def borne_out(self) -> dict[str, float]:
        """Of each probable name whether the record agrees on its gain, and nothing else looks like it.

        None where a law leaves noise. Which law of its mechanism has the gain, evidence tells. A building's explanation
        with an unnamed force has no fit of its own: it is not asked.
        """
        if self._has_right_law:
            return {}
        return {name: self._shown(frozenset({name})) for name, p in self.names.items() if p > 1.0 - NAMED}

    @cached_property
    def families(self) -> tuple[Family, ...]:
        """Of effects that explanations have and that are of one family, the most probable family first.

        Two that explain much the same share the probability of each explanation, and neither may earn its name, where
        no explanation goes without both.
        """
        kin: dict[str, set[str]] = {}
        for hypothesis in (one for explanation in self.explanations for one in explanation.added):
            if hypothesis.guide.family:
                kin.setdefault(hypothesis.guide.family, set()).add(hypothesis.name)
        found = [self.family(title, frozenset(names)) for title, names in kin.items() if len(names) > 1]
        return tuple(sorted(found, key=lambda one: -one.probability))

    def family(self, title: str, names: frozenset[str]) -> Family:
        """Some effects as one family."""
        there = self._sum(lambda one: bool(names & one.names))
        asked = there > 1.0 - NAMED and not self._has_right_law
        return Family(
            title=title,
            names=names,
            probability=there * (self._shown(names) if asked else 1.0),
            log_bayes_factor=self.bayes_factor(names)[0],
        )

    @cached_property
    def _has_right_law(self) -> bool:
        """Whether the best law by itself leaves noise, so that the evidence says it all."""
        return next(one for one in self.explanations if not one.has_unnamed).is_noise

    @property
    def law_probabilities(self) -> dict[str, float]:
        """That the law of each name is part of the model, and borne out."""
        return {name: p * self.borne_out.get(name, 1.0) for name, p in self.names.items()}

    def _shown(self, names: frozenset[str]) -> float:
        """That the best with one of some effects explains further stretches better than the best without all of them.

        And that this is no imitation, unless a measured loop itself shows what the names say. Another law of a
        mechanism of theirs is no rival. Of a specimen the evidence says how far stretches agree: its samples count by
        what the closest law leaves of them.
        """
        if self.best.is_specimen:
            return self._no_imitation(names)
        asked = [one for one in self.explanations if one.estimate is None]
        mechanisms = {h.name: h.effect.mechanism for one in asked for h in one.added}
        own_mechanisms = {mechanisms[name] for name in names if name in mechanisms}
        alike = {other for other, mechanism in mechanisms.items() if mechanism in own_mechanisms}
        compared = [one for one in asked if names & one.names or not alike & one.names]
        own = sides(compared, lambda one: bool(names & one.names))
        agreed = probability_of_being_better(*(one.evidence for one in own)) if len(own) > 1 else 1.0
        return agreed * self._no_imitation(names)

    def _no_imitation(self, names: frozenset[str]) -> float:
        """That the best law with one of some effects is none that bends towards what has no name.

        Asked of what is missing without them and nothing in their place: the law's other effects alone. Which of two
        names it is that explains this, evidence tells.
        """
        laws = [one for one in self.explanations if not one.has_unnamed]
        law = next((one for one in laws if names & one.names), None)
        if law is None or any(law.loop_shows(name) for name in names & law.names):
            return 1.0
        without = next((one for one in laws if one.effects_key < law.effects_key and not names & one.names), None)
        return 1.0 if without is None else of_no_imitation(unexplained_share(without.disagreement, law.disagreement))

    def bayes_factor(self, names: frozenset[str]) -> tuple[float, float]:
        """Evidence of all with one of some effects over that of all without them, and the error of the best ones [nat].

        Each in the shares of its prior, so that with prior odds it makes the probability. Infinite where none goes
        without.
        """
        has = np.array([bool(names & one.names) for one in self.explanations])
        if not np.any(has) or np.all(has):
            gained = np.inf if np.any(has) else -np.inf
        else:
            own, other = (logsumexp(self.log_joint[of]) - logsumexp(self.log_prior[of]) for of in (has, ~has))
            gained = float(own - other)
        best = sides(self.explanations, lambda one: bool(names & one.names))
        return gained, float(np.hypot.reduce([one.evidence.log_evidence_se for one in best]))

    def _sum(self, wanted: Callable[[Explanation], bool]) -> float:
        own = [p for one, p in self._pairs if wanted(one)]
        return float(min(sum(own), 1.0))


def of_no_imitation(left: float) -> float:
    """Probability that an effect is there and not something without a name that looks like it.

    Where laws leave more than noise, something is there that they lack, and one of them may gain by bending towards it.
    What an effect leaves that is there is an error of its law, from :data:`LAW_ERROR` of what it does up to all of it,
    of whatever order of magnitude; an imitation explains any share alike.

    Parameters
    ----------
    left : float
        Share of the residual energy beyond noise, left by a law's other effects alone, that is left with the effect.
    """
    there = (1.0 - ANOTHER) / (max(left, LAW_ERROR**2) * np.log(LAW_ERROR**-2))
    return float(there / (there + ANOTHER))


def sides[T](explanations: Iterable[T], has: Callable[[T], bool]) -> list[T]:
    """The first that has something and the first that has not, of explanations in the order of their probability."""
    found: dict[bool, T] = {}
    for one in explanations:
        found.setdefault(has(one), one)
    return [found[own] for own in (True, False) if own in found]


def beliefs(
    explanations: Sequence[Explanation], n_effects: int, variants: Mapping[str, int], *, laws_err: bool = False
) -> Beliefs:
    """Weigh explanations against each other.

    Parameters
    ----------
    explanations : sequence of Explanation
        No two alike.
    n_effects : int
        Effects that were considered, over which a prior is split.
    variants : mapping of str to int
        Forms and places of each, over which its share is split again.
    laws_err : bool
        Whether laws may err; a search asks what explains more, whatever the reason.
    """
    prior = np.array([log_prior(one, n_effects, variants) for one in explanations])
    errors = np.zeros((2, len(explanations)))
    law_error, forgiven = law_errors(explanations) if laws_err else errors
    order = np.argsort(-(prior + _log_evidences(explanations) + forgiven), kind="stable")
    return Beliefs(
        explanations=tuple(explanations[i] for i in order),
        log_prior=prior[order],
        law_error=law_error[order],
        forgiven=forgiven[order],
    )


def law_errors(explanations: Sequence[Explanation]) -> tuple[Floats, Floats]:
    """By how much laws would have to err to do without what others add to them, and the evidence that they have so.

    What laws do is the difference of what is predicted with them and without, each at its best fit; over the noise it
    is worth Q nats. Where they err by a share r of it, they leave ``r^2 Q``: so many nats may be had by further effects
    that are not there. With r half-normal of scale s = :data:`LAW_ERROR`, an error that explains g nats costs
    ``r^2 / (2 s^2)`` of them, ``r^2 = g / Q``. It is taken to explain whatever other explanations with the same effects
    do by what acts where these act, a force of no known law among it, which is the most that it could; the noise is
    what the best of these leaves.

    Returns
    -------
    law_error, forgiven : (n,) array
        The share, and what it is worth [nat].
    """
    log_evidence = _log_evidences(explanations)
    bare = {one.unnamed: one for one in explanations if not one.added}
    law_error, forgiven = np.zeros((2, len(explanations)))
    for number, one in enumerate(explanations):
        without = bare.get(one.unnamed, bare.get(None))
        if not one.added or without is None or one.evidence.log_evidence <= without.evidence.log_evidence:
            continue
        alike = [n for n, other in enumerate(explanations) if one.placed <= other.placed and _stays_where(one, other)]
        most = max(alike, key=lambda n: log_evidence[n])
        gained = float(log_evidence[most] - log_evidence[number])
        done = explanations[most].over_noise(one.residual - without.residual) if gained > 0.0 else np.inf
        if done > 0.0:
            law_error[number] = np.sqrt(gained / done)
            forgiven[number] = max(gained - 0.5 * (law_error[number] / LAW_ERROR) ** 2, 0.0)
    return law_error, forgiven


def _stays_where(one: Explanation, other: Explanation) -> bool:
    """Whether all that another explanation adds acts where the laws of this one do, or there too.

    What a law errs by is a force there: a change of other storeys, or a sensor's error, is none of its.
    """

    def places(own: Hypothesis) -> set[tuple[str, int | None]]:
        return {(own.effect.level, place) for place in own.storeys or (None,)}

    where = set[tuple[str, int | None]]().union(*map(places, one.added))
    further = [own for own in other.added if (own.name, own.storeys) not in one.placed]
    if any(where.isdisjoint(places(own)) for own in further):
        return False
    if one.unnamed == other.unnamed:
        return True
    return one.unnamed is None and not where.isdisjoint(("link", place) for place in forced_storeys(other.unnamed))


def _log_evidences(explanations: Sequence[Explanation]) -> Floats:
    return np.array([one.evidence.log_evidence for one in explanations])


def log_prior(one: Explanation, n_effects: int, variants: Mapping[str, int]) -> float:
    """Log prior probability of an explanation: how many effects, which, where, and whether with an unnamed force."""
    n_added = len(one.added)
    if n_added == 0 and not one.has_unnamed:
        return float(np.log(NOTHING_MISSING))
    # With an unnamed force there may be no effect at all; without, there is one at least.
    count = n_added * np.log(ANOTHER) if one.has_unnamed else (n_added - 1) * np.log(ANOTHER)
    result = np.log1p(-NOTHING_MISSING) + count + np.log1p(-ANOTHER) + gammaln(n_added + 1)
    result += np.log(ANOTHER) - np.log(one.n_places) if one.has_unnamed else np.log1p(-ANOTHER)
    # What the model as given has no place for can still act on what another effect makes of it.
    return float(result - sum(np.log(n_effects * max(variants[hypothesis.name], 1)) for hypothesis in one.added))


def cost_of_another(name: str, variants: Mapping[str, int]) -> float:
    """What a further effect at one place in one form costs by its prior, in nat: what it must gain at least."""
    return float(np.log(len(variants) * max(variants[name], 1) / ANOTHER))
