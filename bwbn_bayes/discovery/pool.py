"""Every explanation that a search has fitted, each weighed under the accounts of its errors that could matter."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from bwbn_bayes.discovery.build import built_upon
from bwbn_bayes.discovery.cross_validation import CrossValidation
from bwbn_bayes.discovery.evidence import (
    Evidence,
    autoregressive,
    autoregressive_bound,
    autoregressive_outlook,
    recounted,
    sampled,
)
from bwbn_bayes.discovery.explanation import Explanation, Key, Place
from bwbn_bayes.discovery.probability import Beliefs, beliefs
from bwbn_bayes.discovery.race import FAR
from bwbn_bayes.discovery.run import Run
from bwbn_bayes.discovery.scheme import finely_solved
from bwbn_bayes.inference.as_one import counted_as_one
from bwbn_bayes.inference.likelihood import IntegratedNoise, Noise, Posterior, default_noise
from bwbn_bayes.inference.modes import N_CANDIDATES, Mode, find_modes, settled
from bwbn_bayes.inference.residuals import has_past

_MOST_COLOURED, _COLOURED_REACH = 4, 400.0
"""Explanations that are refitted under autoregressive errors in each round, and how far below the best: a law has been
seen 379 nats below the one that it contains where its optimum was that of white errors. [nat]"""
_MOST_FINE = 4
"""Explanations whose scheme is judged at a time, the best ones, no further below the best of all than that."""
_N_TURNS = 4
"""In which laws are solved and samples counted anew, at most."""
_COUNTED_ALIKE = 0.01
"""Share by which counts of samples differ without a difference: of ten nats it is a tenth of one."""
_MOST_PREDICTED = 24
"""Laws of which it is asked how well they predict blocks of the record, the most probable ones."""
_N_SETTLED, _N_STARTS = 8, 512
"""Optima, and draws of its priors, from which a specimen's law that is delivered is fitted."""
_MOST_SAMPLED, _SAMPLED_REACH, _N_SAMPLED = 6, 10.0, 400
"""The best of them whose evidence is sampled, how far below the best, and with how many effective draws."""


@dataclass
class Pool:
    """Explanations by what they add.

    Parameters
    ----------
    run : Run
        With the hypotheses of the first round, over which the prior is split.
    """

    run: Run
    plain: dict[Key, Explanation] = field(default_factory=dict)
    """Without anything unnamed."""
    unnamed: dict[tuple[Key, Place], Explanation] = field(default_factory=dict)
    """With something unnamed, by its place."""
    expanded: set[Key] = field(default_factory=set)
    """What further effects were tried on."""
    finished: set[Key] = field(default_factory=set)
    """Of these, in whole rounds, before the time ran out."""
    asked: set[tuple[Key, str]] = field(default_factory=set)
    """Beside what something unnamed was looked for, and of which kind."""
    reshaped: set[Key] = field(default_factory=set)
    """What was tried, or could not be solved, with an effect in a free shape."""
    first: dict[Key, float] = field(default_factory=dict)
    """Log evidence of each as it was searched."""
    _fine: set[Key] = field(default_factory=set)
    _coloured: set[Key] = field(default_factory=set)
    _bounds: dict[Key, float] = field(default_factory=dict)
    """Log evidence of each under autoregressive errors, at least."""

    def add(self, found: Iterable[Explanation]) -> None:
        """Take what was searched; of two of the same effects the better fit stays."""
        for one in found:
            key = one.effects_key
            if key not in self.first or one.evidence.log_evidence > self.first[key]:
                self._fine.discard(key)
                self._take(one)

    def _take(self, one: Explanation) -> None:
        """In the place of one of the same effects, with all that was found beside that one."""
        key = one.effects_key
        self.first[key] = one.evidence.log_evidence
        self.plain[key] = one
        self._coloured.discard(key)
        self._bounds.pop(key, None)
        self.asked -= {pair for pair in self.asked if pair[0] == key}
        for place in [place for place in self.unnamed if place[0] == key]:
            del self.unnamed[place]

    def add_unnamed(self, one: Explanation) -> None:
        """Take in an explanation of a building with something unnamed.

        Of such as are of different kinds at one place the better one is shown, with the evidence of all.
        """
        assert one.unnamed is not None
        key = one.effects_key, one.unnamed
        found = self.unnamed.get(key)
        if found is not None:
            both = float(np.logaddexp(found.evidence.log_evidence, one.evidence.log_evidence))
            one = max(found, one, key=lambda own: own.evidence.log_evidence)
            one = replace(one, evidence=replace(one.evidence, log_evidence=both))
        self.unnamed[key] = one

    @property
    def beliefs(self) -> Beliefs:
        """The posterior over all of them."""
        return self._beliefs(self._every, laws_err=True)

    @property
    def compared(self) -> Beliefs:
        """All of them by what they explain, for a search."""
        return self._beliefs(self._every)

    @property
    def _every(self) -> tuple[Explanation, ...]:
        return (*self.plain.values(), *self.unnamed.values())

    @property
    def laws(self) -> Beliefs:
        """The posterior over the laws by themselves, upon which a search builds."""
        return self._beliefs(tuple(self.plain.values()))

    def _beliefs(self, explanations: Sequence[Explanation], *, laws_err: bool = False) -> Beliefs:
        variants = self.run.variants
        return beliefs(explanations, len(variants) or 1, variants, laws_err=laws_err)

    def ranked(self) -> list[Explanation]:
        """One of each set of effects, by itself, the most probable sets first."""
        seen = dict.fromkeys(one.effects_key for one in self.compared.explanations)
        return [self.plain[key] for key in seen]

    def weigh(self, *, last: bool = False) -> None:
        """Solve every explanation that could matter finely enough, and give it its own account of the errors.

        Laplace's evidence is good enough to search by: sampled ones are wanted of the best in the last round.
        """
        for _ in range(_N_TURNS):
            self._solve_finely()
            if not self.count():
                break
        if has_past(self._given.posterior.record):
            self._colour()
        if last:
            self._sample()

    @property
    def _given(self) -> Explanation:
        return self.plain[frozenset()]

    @cached_property
    def _white(self) -> IntegratedNoise:
        """Noise whose samples count one by one, but behind a filter; found of the record, which stays the same."""
        return default_noise(self._given.posterior.record)

    @property
    def closest(self) -> Explanation:
        """The law that leaves least."""
        return max(self.plain.values(), key=lambda one: one.modes[0].log_likelihood)

    def count(self) -> bool:
        """Count a specimen's samples, in all explanations alike, by what the closest law leaves; whether that was new.

        One by one where it leaves noise. By the law of the greatest evidence each would have samples count as suits it:
        of several answers that agree with themselves the one that came first would stay. So the dispersion of all
        models is taken from the largest of them elsewhere, too [1]_.

        References
        ----------
        .. [1] K. P. Burnham and D. R. Anderson, "Model Selection and Multimodel Inference", 2nd ed., 2002,
           doi:10.1007/b97636 (variance inflation of the global model; cited from memory, not consulted).
        """
        closest, noise = self.closest, self._given.posterior.noise
        if not closest.is_specimen:
            return False
        assert isinstance(noise, IntegratedNoise)
        white = self._white
        if not closest.is_noise:
            white = counted_as_one(white, closest.posterior, closest.best)
        if np.allclose(white.as_one, noise.as_one, rtol=_COUNTED_ALIKE, atol=0.0):
            return False
        every = list(self.plain.values())
        for one, own in zip(every, self.run.beside(partial(_counted, white), every), strict=True):
            self._take(replace(one, posterior=own.posterior, modes=own.modes, evidence=own))
        return True

    def _solve_finely(self) -> None:
        """Judge the schemes by which the best were solved, and where one of these was too coarse, of the next."""
        while True:
            searched = self.plain
            ranked = sorted(searched, key=lambda key: -self.first[key])
            near = [key for key in ranked if self.first[key] > self.first[ranked[0]] - _COLOURED_REACH]
            wanted = [key for key in near if key not in self._fine][:_MOST_FINE]
            found = self.run.beside(finely_solved, [searched[key] for key in wanted])
            self._fine.update(wanted)
            changed = [one for one, key in zip(found, wanted, strict=True) if one is not searched[key]]
            for one in changed:
                self.run.say(f"solving {one.label} more finely: its evidence felt the step")
                self._take(one)
            if not changed:
                return

    def _colour(self) -> None:
        """Refit under autoregressive errors what could gain by them.

        A specimen's laws where the closest leaves noise, and those that do: how far more hangs together is counted.
        """
        is_specimen = self._given.is_specimen
        if is_specimen and not self.closest.is_noise:
            return
        fresh = [key for key in self.plain if key not in self._coloured]
        waiting = [key for key in fresh if not is_specimen or self.plain[key].is_noise]
        for key in waiting:
            if key not in self._bounds:
                self._bounds[key] = self.plain[key].evidence.log_evidence + autoregressive_bound(*_at(self.plain[key]))
        bounds = {key: self._bounds[key] for key in waiting}
        known = {key: one.evidence.log_evidence for key, one in self.plain.items()}
        most = max([*bounds.values(), *known.values()])
        ranked = sorted(waiting, key=lambda key: -bounds[key])[:_MOST_COLOURED]
        self._coloured.update(ranked)
        promising = [k for k in ranked if bounds[k] > known[k] and bounds[k] > most - _COLOURED_REACH]
        if self.plain[max(known, key=lambda key: known[key])].is_noise:
            promising = [k for k in promising if known[k] + autoregressive_outlook(*_at(self.plain[k])) > most - FAR]
        for key in promising:
            self.run.say(f"weighing {self.plain[key].label} under autoregressive errors")
        found = self.run.beside(_coloured, [self.plain[key] for key in promising])
        for key, evidence in zip(promising, found, strict=True):
            if evidence.log_evidence > self.plain[key].evidence.log_evidence:
                self.plain[key] = replace(self.plain[key], evidence=evidence)

    def delivered(self, believed: Beliefs) -> Explanation:
        """The explanation to predict by, settled.

        The most probable one where it leaves noise: its evidence is the score of predicting each sample from those
        before it. Else samples hang together, and how well laws predict whole blocks of the record is asked itself: it
        is the most probable one of those that nobody is seen to predict better than.
        """
        every = [self.plain[one.effects_key] for one in believed.deliverable[:_MOST_PREDICTED]]
        best = every[0]
        if not best.is_noise:
            scored = self._scored(every)
            _, ahead = max(scored, key=_log_score)
            best = self._grown(*next((one, own) for one, own in scored if not ahead.is_better_than(own)))
        return self._settled(best)

    def _grown(self, best: Explanation, score: CrossValidation) -> Explanation:
        """A specimen's law built upon further, as long as what comes of it is seen to predict better.

        What gains too little to be believed may predict all the same. It takes no part in what is believed.
        """
        while best.is_specimen and not self.run.must_stop():
            self.run.say(f"building upon {best.label} as long as it predicts better")
            scored = self._scored(built_upon(best, self.run)[:_MOST_PREDICTED])
            further, ahead = max(scored, key=_log_score, default=(best, score))
            if not ahead.is_better_than(score):
                break
            best, score = further, ahead
        return best

    def _scored(self, every: Sequence[Explanation]) -> list[tuple[Explanation, CrossValidation]]:
        """Each with how well it predicts blocks of the record."""
        return list(zip(every, self.run.beside(_cross_validated, every), strict=True))

    def _settled(self, one: Explanation) -> Explanation:
        """An explanation without anything unnamed, to predict by; a specimen's after a search all over its priors.

        Of its optima that is taken which fits the first half of the record and predicts what comes after best, where
        more than noise is left: one that was likelier by 85 nats of samples counted one by one left 184 % of the end of
        a measured test, and this one 17 %.
        """
        if not one.is_specimen or not one.added:
            return one
        one = finely_solved(one)
        anew = find_modes(one.posterior, self.run.rng, n_starts=_N_STARTS, reach=FAR)
        found = (*one.modes[:_N_SETTLED], *anew)
        modes = settled(one.posterior, found[:N_CANDIDATES], self.run.rng, reach=np.inf)
        if not one.is_noise:
            optima = [one.with_modes(modes[number:]) for number in range(len(modes))]
            one, _ = max(self._scored(optima), key=_log_score)
        elif modes[0].log_likelihood > one.modes[0].log_likelihood:
            one = replace(one, modes=modes)
        return one

    def _sample(self) -> None:
        """Sample the evidence of the best, where Laplace's approximation gave it, until the best are sampled."""
        done: set[Key] = set()
        while waiting := [one for one in self._waiting if one.effects_key not in done]:
            # Once is enough: where not enough draws are to be had, Laplace's value stands.
            done.update(one.effects_key for one in waiting)
            for one in waiting:
                evidence = sampled(one.evidence, self.run.rng, _N_SAMPLED)
                self.plain[one.effects_key] = replace(one, evidence=evidence)

    @property
    def _waiting(self) -> list[Explanation]:
        """Of the best explanations those whose evidence is to be sampled; of a building's force it is no expansion."""
        believed = self.beliefs
        near = believed.log_joint[:_MOST_SAMPLED] >= believed.log_joint[0] - _SAMPLED_REACH
        return [
            one
            for one, is_near in zip(believed.explanations, near, strict=False)
            if is_near and one.evidence.method == "Laplace" and one.unnamed is None
        ]


def _at(one: Explanation) -> tuple[Posterior, tuple[Mode, ...]]:
    return one.posterior, one.modes


def _coloured(one: Explanation) -> Evidence:
    return autoregressive(*_at(one))


def _log_score(scored: tuple[Explanation, CrossValidation]) -> float:
    return scored[1].log_score


def _cross_validated(one: Explanation) -> CrossValidation:
    return one.cross_validation


def _counted(noise: Noise, one: Explanation) -> Evidence:
    """Its evidence under white errors whose samples count otherwise."""
    return recounted(*_at(one), noise)
