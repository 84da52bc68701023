"""Every explanation that a search has fitted, each weighed under the accounts of its errors that could matter."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby

import numpy as np

from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.discovery.evidence import (
    Evidence,
    autoregressive,
    autoregressive_bound,
    autoregressive_outlook,
    sampled,
    with_shared,
)
from bwbn_bayes.discovery.explanation import Explanation, Key, Place, key_of
from bwbn_bayes.discovery.probability import Beliefs, beliefs
from bwbn_bayes.discovery.race import FAR
from bwbn_bayes.discovery.run import Run, beside
from bwbn_bayes.discovery.scheme import finely_solved
from bwbn_bayes.inference.correlation import SharedFunctions
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.unnamed import UNNAMED_SCALE
from bwbn_bayes.inference.unnamed.specimen import fitted_basis
from bwbn_bayes.parameters import Floats

_MOST_COLOURED, _COLOURED_REACH = 4, 400.0
"""Explanations that are refitted under autoregressive errors in each round, and how far below the best: a law has been
seen 379 nats below the one that it contains where its optimum was that of white errors. [nat]"""
_MOST_FINE = 4
"""Explanations whose scheme is judged at a time, the best ones, no further below the best of all than that."""
_MOST_SHARED = 4
"""Explanations of a specimen that get an unnamed force in each round, beside the model as given."""
_MOST_SAMPLED, _SAMPLED_REACH, _N_SAMPLED = 6, 10.0, 400
"""The best of them whose evidence is sampled, how far below the best, and with how many effective draws."""
_NEAR = 1e-3
"""Distance from neutral at which a further effect starts, in prior probability."""


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
    """Without an unnamed force."""
    unnamed: dict[tuple[Key, Place], Explanation] = field(default_factory=dict)
    """With something unnamed, by its place."""
    expanded: set[Key] = field(default_factory=set)
    """What further effects were tried on."""
    asked: set[tuple[Key, str]] = field(default_factory=set)
    """Beside what something unnamed was looked for, and of which kind."""
    reshaped: set[Key] = field(default_factory=set)
    """What was tried, or could not be solved, with an effect in a free shape."""
    white: dict[Key, float] = field(default_factory=dict)
    """Log evidence of each for white errors."""
    _fine: set[Key] = field(default_factory=set)
    _coloured: set[Key] = field(default_factory=set)
    _bounds: dict[Key, float] = field(default_factory=dict)
    """Log evidence of each under autoregressive errors, at least."""
    _sampled: set[tuple[Key, Place | None]] = field(default_factory=set)

    def add(self, found: Iterable[Explanation]) -> None:
        """Take explanations in; of two of the same effects the better fit stays."""
        for one in found:
            key = one.effects_key
            if key not in self.plain or one.evidence.log_evidence > self.white[key]:
                self._fine.discard(key)
                self._take(one)

    def _take(self, one: Explanation) -> None:
        """In the place of one of the same effects, with all that was found beside that one."""
        key = one.effects_key
        self.plain[key], self.white[key] = one, one.evidence.log_evidence
        self._coloured.discard(key)
        self._bounds.pop(key, None)
        self.asked -= {pair for pair in self.asked if pair[0] == key}
        self._sampled.discard((key, None))
        for place in [place for place in self.unnamed if place[0] == key]:
            del self.unnamed[place]
            self._sampled.discard(place)

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

    @cached_property
    def shared(self) -> SharedFunctions | None:
        """Functions of a specimen's unnamed force."""
        record = next(iter(self.plain.values())).posterior.record
        is_specimen = record.excitation_kind == "displacement" and len(record.parts) == 1 and "force" in record.channels
        return SharedFunctions.of(fitted_basis(record)) if is_specimen else None

    @property
    def beliefs(self) -> Beliefs:
        """The posterior over all of them."""
        return self._beliefs((*self.plain.values(), *self.unnamed.values()))

    @property
    def laws_alone(self) -> Beliefs:
        """The posterior over those without an unnamed force."""
        return self._beliefs(tuple(self.plain.values()))

    def _beliefs(self, explanations: Sequence[Explanation]) -> Beliefs:
        variants = self.run.variants
        return beliefs(explanations, len(variants) or 1, variants)

    def ranked(self) -> list[Explanation]:
        """One of each set of effects without an unnamed force, the most probable sets first."""
        seen = dict.fromkeys(one.effects_key for one in self.beliefs.explanations)
        return [self.plain[key] for key in seen]

    def weigh(self) -> None:
        """Solve every explanation that could matter finely enough, and give it its own account of the errors."""
        self._solve_finely()
        if self.shared is not None:
            self._share()
        if self._has_time:
            self._colour()
        self._sample()

    @property
    def _has_time(self) -> bool:
        """Whether errors can have a past: a filter in time means nothing without time, or across gaps."""
        record = next(iter(self.plain.values())).posterior.record
        return record.has_time and all(part.counted is None for part in record.parts)

    def _solve_finely(self) -> None:
        """Judge the schemes by which the best were solved, and where one of these was too coarse, of the next."""
        while True:
            ranked = sorted(self.plain, key=lambda key: -self.white[key])
            near = [key for key in ranked if self.white[key] > self.white[ranked[0]] - _COLOURED_REACH]
            wanted = [key for key in near if key not in self._fine][:_MOST_FINE]
            found = beside(finely_solved, [self.plain[key] for key in wanted], self.run.settings.n_workers)
            self._fine.update(wanted)
            changed = [one for one, key in zip(found, wanted, strict=True) if one is not self.plain[key]]
            for one in changed:
                self.run.say(f"solving {one.label} more finely: its evidence felt the step")
                self._take(one)
            if not changed:
                return

    def _colour(self) -> None:
        """Refit under autoregressive errors what could gain by them."""
        waiting = [key for key in self.plain if key not in self._coloured]
        for key in waiting:
            if key not in self._bounds:
                self._bounds[key] = self.white[key] + autoregressive_bound(*_at(self.plain[key]))
        bounds = {key: self._bounds[key] for key in waiting}
        known = {key: one.evidence.log_evidence for key, one in self.plain.items()}
        best = max([*bounds.values(), *known.values()])
        ranked = sorted(waiting, key=lambda key: -bounds[key])[:_MOST_COLOURED]
        self._coloured.update(ranked)
        promising = [k for k in ranked if bounds[k] > self.white[k] and bounds[k] > best - _COLOURED_REACH]
        if self.plain[max(known, key=lambda key: known[key])].is_noise:
            promising = [
                k for k in promising if self.white[k] + autoregressive_outlook(*_at(self.plain[k])) > best - FAR
            ]
        for key in promising:
            self.run.say(f"weighing {self.plain[key].label} under autoregressive errors")
        found = beside(lambda k: autoregressive(*_at(self.plain[k])), promising, self.run.settings.n_workers)
        for key, evidence in zip(promising, found, strict=True):
            if evidence.log_evidence > self.plain[key].evidence.log_evidence:
                self.plain[key] = replace(self.plain[key], evidence=evidence)

    def _share(self) -> None:
        """Give a specimen's explanations an unnamed force."""
        waiting = [key for key in self.plain if (key, (1,)) not in self.unnamed]
        ranked = sorted(waiting, key=lambda key: -self.white[key])
        wanted = dict.fromkeys((*(key for key in waiting if not key), *ranked[:_MOST_SHARED]))
        for _, same in groupby(sorted(wanted, key=len), key=len):  # each may start from one with an effect less
            found = [self.plain[key] for key in same]
            evidences = beside(self._with_shared, found, self.run.settings.n_workers)
            for one, evidence in zip(found, evidences, strict=True):
                self.unnamed[one.effects_key, (1,)] = replace(one, unnamed=(1,), evidence=evidence)

    def _with_shared(self, one: Explanation) -> Evidence:
        assert self.shared is not None
        largest = UNNAMED_SCALE * float(np.max(np.abs(one.posterior.record.channels["force"])))
        return with_shared(one.posterior, one.modes, self.shared, largest, self._start_without_last(one))

    def _start_without_last(self, one: Explanation) -> Floats | None:
        """Where the last effect does nothing yet, at the optimum that the others have with an unnamed force."""
        if not one.added:
            return None
        last = one.added[-1]
        before = self.unnamed.get((_without(one, last), (1,)))
        if before is None or before.posterior.space.names != last.base.space.names:
            return None
        return last.neutral_points(before.evidence.modes[0].point, last.amplitudes[0], _NEAR)[:4]

    def _sample(self) -> None:
        """Sample the evidence of the best, where Laplace's approximation gave it."""
        believed = self.beliefs
        for one, log_joint in list(zip(believed.explanations, believed.log_joint, strict=True))[:_MOST_SAMPLED]:
            if log_joint < believed.log_joint[0] - _SAMPLED_REACH or one.evidence.method != "Laplace":
                continue
            if one.unnamed is not None and self.shared is None:  # its scale is integrated out already
                continue
            # Once is enough: where the weights have no usable tail, Laplace's value stands.
            if (one.effects_key, one.unnamed) in self._sampled:
                continue
            self._sampled.add((one.effects_key, one.unnamed))
            evidence = sampled(one.evidence, self.run.rng, _N_SAMPLED)
            if one.unnamed is None:
                self.plain[one.effects_key] = replace(one, evidence=evidence)
            else:
                self.unnamed[one.effects_key, one.unnamed] = replace(one, evidence=evidence)


def _at(one: Explanation) -> tuple[Posterior, tuple[Mode, ...]]:
    return one.posterior, one.modes


def _without(one: Explanation, last: Hypothesis) -> Key:
    return one.effects_key - key_of([last])
