"""Every explanation that a search has fitted, each weighed under the accounts of its errors that could matter."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from bwbn_bayes.discovery.evidence import (
    Evidence,
    autoregressive,
    autoregressive_bound,
    autoregressive_outlook,
    beside_force,
    law_alone,
    sampled,
)
from bwbn_bayes.discovery.explanation import SPECIMEN, Explanation, Key, Place
from bwbn_bayes.discovery.probability import Beliefs, beliefs
from bwbn_bayes.discovery.race import FAR
from bwbn_bayes.discovery.run import Run
from bwbn_bayes.discovery.scheme import finely_solved
from bwbn_bayes.inference.correlation import SharedFunctions
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import N_CANDIDATES, Mode, find_modes, settled
from bwbn_bayes.inference.residuals import has_past
from bwbn_bayes.inference.unnamed import UNNAMED_SCALE
from bwbn_bayes.inference.unnamed.specimen import fitted_basis

_MOST_COLOURED, _COLOURED_REACH = 4, 400.0
"""Explanations that are refitted under autoregressive errors in each round, and how far below the best: a law has been
seen 379 nats below the one that it contains where its optimum was that of white errors. [nat]"""
_MOST_FINE = 4
"""Explanations whose scheme is judged at a time, the best ones, no further below the best of all than that."""
_MOST_ALONE = 8
"""Explanations of a specimen, the best ones, whose laws are fitted at the end without the unnamed force, too."""
_N_SETTLED, _N_STARTS = 8, 512
"""Optima beside the force, and draws of its priors, from which the law that is delivered is fitted without it."""
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
    """Without an unnamed force; of a specimen's the leading ones."""
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
    _force: tuple[SharedFunctions, float] | None = None
    """Functions of a specimen's unnamed force, and the standard deviation of its scale's prior [N]."""
    _fine: set[Key] = field(default_factory=set)
    _coloured: set[Key] = field(default_factory=set)
    _bounds: dict[Key, float] = field(default_factory=dict)
    """Log evidence of each under autoregressive errors, at least."""
    _alone: set[Key] = field(default_factory=set)

    def begin(self, given: Explanation) -> Explanation:
        """Take in the model as given; hand back what a search builds upon: a specimen's has an unnamed force beside it.

        A law that is fitted by itself is bent by all that it lacks, and what it leaves then says little of what that
        is: laws of a specimen are searched by the likelihood that decides between them.
        """
        self.plain[frozenset()] = given
        record = given.posterior.record
        is_specimen = record.excitation_kind == "displacement" and len(record.parts) == 1 and "force" in record.channels
        if is_specimen:
            largest = UNNAMED_SCALE * float(np.max(np.abs(record.channels["force"][record.kept])))
            shared = SharedFunctions.of(fitted_basis(record))
            self._alone = {frozenset()}
            self._force = shared, largest
            given = _with_force(given, _beside(self._force, given))
        self.add([given])
        return given

    @property
    def has_force(self) -> bool:
        """Whether laws are searched beside an unnamed force, as a specimen's are."""
        return self._force is not None

    @property
    def searched(self) -> dict[Key, Explanation]:
        """What the search builds upon, by its effects."""
        if not self.has_force:
            return self.plain
        return {key: one for (key, _), one in self.unnamed.items()}

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
        if one.unnamed is not None:
            self.unnamed[key, one.unnamed] = one
            if key:
                self._alone.discard(key)
            return
        self._take_plain(one)
        self.asked -= {pair for pair in self.asked if pair[0] == key}
        for place in [place for place in self.unnamed if place[0] == key]:
            del self.unnamed[place]

    def _take_plain(self, one: Explanation) -> None:
        """In the place of one of the same effects without anything unnamed, whose accounts of the errors go with it."""
        key = one.effects_key
        self.plain[key] = one
        self._coloured.discard(key)
        self._bounds.pop(key, None)

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
    def alone(self) -> list[Explanation]:
        """Explanations without anything unnamed, the most probable first."""
        return list(self._beliefs(tuple(self.plain.values())).explanations)

    @property
    def laws(self) -> Beliefs:
        """The posterior over what the search builds upon: a building's laws alone, a specimen's beside a force."""
        return self._beliefs(tuple(self.searched.values()))

    def _beliefs(self, explanations: Sequence[Explanation], *, laws_err: bool = False) -> Beliefs:
        variants = self.run.variants
        return beliefs(explanations, len(variants) or 1, variants, laws_err=laws_err)

    def ranked(self) -> list[Explanation]:
        """One of each set of effects, as it is searched, the most probable sets first."""
        seen, searched = dict.fromkeys(one.effects_key for one in self.compared.explanations), self.searched
        return [searched[key] for key in seen if key in searched]

    def weigh(self, *, last: bool = False) -> None:
        """Solve every explanation that could matter finely enough, and give it its own account of the errors.

        What a specimen's answer predicts by, its law without the unnamed force, is wanted of the best in each round, of
        the leading ones in the last. Laplace's evidence is good enough to search by: sampled ones are wanted in the
        last, too.
        """
        self._solve_finely()
        if self.has_force:
            self.leave_alone(_MOST_ALONE if last else 1)
        if has_past(next(iter(self.plain.values())).posterior.record):
            self._colour()
        if last:
            self._sample()

    def _solve_finely(self) -> None:
        """Judge the schemes by which the best were solved, and where one of these was too coarse, of the next."""
        while True:
            searched = self.searched
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

        Of a specimen's laws those alone that leave noise: what is more than noise is the force's, whose scale has a
        prior; such errors would be a second force of no known law, as large as they like.
        """
        fresh = [key for key in self.plain if key not in self._coloured]
        waiting = [key for key in fresh if not self.has_force or self.plain[key].is_noise]
        for key in waiting:
            if key not in self._bounds:
                self._bounds[key] = self.plain[key].evidence.log_evidence + autoregressive_bound(*_at(self.plain[key]))
        bounds = {key: self._bounds[key] for key in waiting}
        known = {key: one.evidence.log_evidence for key, one in self.plain.items()}
        best = max([*bounds.values(), *known.values()])
        ranked = sorted(waiting, key=lambda key: -bounds[key])[:_MOST_COLOURED]
        self._coloured.update(ranked)
        promising = [k for k in ranked if bounds[k] > known[k] and bounds[k] > best - _COLOURED_REACH]
        if self.plain[max(known, key=lambda key: known[key])].is_noise:
            promising = [k for k in promising if known[k] + autoregressive_outlook(*_at(self.plain[k])) > best - FAR]
        for key in promising:
            self.run.say(f"weighing {self.plain[key].label} under autoregressive errors")
        found = self.run.beside(_coloured, [self.plain[key] for key in promising])
        for key, evidence in zip(promising, found, strict=True):
            if evidence.log_evidence > self.plain[key].evidence.log_evidence:
                self.plain[key] = replace(self.plain[key], evidence=evidence)

    def leave_alone(self, n: int = _MOST_ALONE, *, also: Iterable[Explanation] = ()) -> None:
        """Fit the best laws of a specimen, and some others, without the unnamed force, too."""
        ranked = sorted(self.searched.items(), key=lambda pair: -self.first[pair[0]])[:n]
        wanted = [
            one for key, one in {**dict(ranked), **{o.effects_key: o for o in also}}.items() if key not in self._alone
        ]
        found = zip(wanted, self.run.beside(_alone, wanted), strict=True)
        self.add_alone(
            replace(one, posterior=own.posterior, modes=own.modes, evidence=own, unnamed=None) for one, own in found
        )

    def add_alone(self, found: Iterable[Explanation]) -> None:
        """Take what was fitted without the unnamed force of a specimen; of two of the same effects the better stays."""
        for one in found:
            key = one.effects_key
            known = self.plain.get(key)
            if known is None or one.evidence.log_evidence > known.evidence.log_evidence:
                self._take_plain(one)
                self._alone.add(key)

    def let_compete(self, laws: Sequence[Explanation]) -> None:
        """Fit laws of a specimen beside the unnamed force, from where they are best by themselves."""
        assert self._force is not None
        found = zip(laws, self.run.beside(partial(_beside, self._force), laws), strict=True)
        self.add(_with_force(one, own) for one, own in found)

    def delivered(self, believed: Beliefs) -> Explanation:
        """The explanation to predict by, settled."""
        return self._settled(believed.predictive.effects_key)

    def _settled(self, key: Key) -> Explanation:
        """An explanation without an unnamed force, to predict by; a specimen's after a search all over its priors.

        It was found beside the force, from where the best fit without it may lie far, and laws that are built by
        themselves are solved as coarsely as those beside it: a fit may make use of the step. Of its optima that is
        taken which fits the first half of the record and predicts what comes after best, where more than noise is left:
        one that was likelier by 85 nats left 184 % of the end of a measured test, and this one 17 %.
        """
        one = self.plain[key]
        if self.has_force and key:
            one = finely_solved(one)
            anew = find_modes(one.posterior, self.run.rng, n_starts=_N_STARTS, reach=FAR)
            found = (*one.modes[:_N_SETTLED], *anew)
            modes = settled(one.posterior, found[:N_CANDIDATES], self.run.rng, reach=np.inf)
            if not one.is_noise:
                optima = [one.with_modes(modes[number:]) for number in range(len(modes))]
                one = optima[int(np.argmax(self.run.beside(_score_ahead, optima)))]
            elif modes[0].log_likelihood > one.modes[0].log_likelihood:
                one = replace(one, modes=modes)
            self.plain[key] = one
        return one

    def _sample(self) -> None:
        """Sample the evidence of the best, where Laplace's approximation gave it, until the best are sampled."""
        done: set[tuple[Key, Place | None]] = set()
        while waiting := [one for one in self._waiting if (one.effects_key, one.unnamed) not in done]:
            # Once is enough: where not enough draws are to be had, Laplace's value stands.
            done.update((one.effects_key, one.unnamed) for one in waiting)
            for one in waiting:
                evidence = sampled(one.evidence, self.run.rng, _N_SAMPLED)
                if one.unnamed is None:
                    self.plain[one.effects_key] = replace(one, evidence=evidence)
                else:
                    self.unnamed[one.effects_key, one.unnamed] = replace(one, evidence=evidence)

    @property
    def _waiting(self) -> list[Explanation]:
        """Of the best explanations those whose evidence is to be sampled; of a building's force it is no expansion."""
        believed = self.beliefs
        near = believed.log_joint[:_MOST_SAMPLED] >= believed.log_joint[0] - _SAMPLED_REACH
        return [
            one
            for one, is_near in zip(believed.explanations, near, strict=False)
            if is_near and one.evidence.method == "Laplace"
            if one.unnamed is None or self.has_force
        ]


def _at(one: Explanation) -> tuple[Posterior, tuple[Mode, ...]]:
    return one.posterior, one.modes


def _coloured(one: Explanation) -> Evidence:
    return autoregressive(*_at(one))


def _score_ahead(one: Explanation) -> float:
    return one.cross_validation.log_score


def _alone(one: Explanation) -> Evidence:
    return law_alone(*_at(one))


def _beside(force: tuple[SharedFunctions, float], one: Explanation) -> Evidence:
    return beside_force(*_at(one), *force)


def _with_force(one: Explanation, own: Evidence) -> Explanation:
    return replace(one, posterior=own.posterior, modes=own.modes, evidence=own, unnamed=SPECIMEN)
