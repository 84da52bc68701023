"""Decide which effect is missing, or that none can be named.

Half the prior probability says that nothing is missing; the rest is split over the effects, then over each one's forms
and places. An effect is named where its posterior log odds, against the present model and against every effect outside
its class, exceed 8 beyond their error, and still do under priors ten times wider and narrower. Effects that the record
cannot tell apart form one class.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from bwbn_bayes.discovery.candidates import Hypothesis
from bwbn_bayes.discovery.evidence import PRIOR_WIDTHS, Evidence
from bwbn_bayes.discovery.score import Score

THRESHOLD = 8.0
"""Log odds that a name must exceed beyond their error. [nat]"""
_SIMPLER = 3.0
"""Within this, the hypothesis with fewer parameters leads. [nat]"""
_DOUBT = 6.0
"""Laplace's error could be as large as this. [nat]"""
_LEAST_SCORE, _BEYOND_SCORE = 6.0, 2.0
"""Least score worth a fit; what a fit may gain beyond it where the residual is quiet. [nat]"""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A weighed hypothesis.

    Attributes
    ----------
    hypothesis : Hypothesis
    evidence : Evidence
    log_prior_odds : float
        Against the present model.
    log_bayes_factor, log_bayes_factor_se : float
        Against the present model, each under its better account of the noise; standard error of both together.
    """

    hypothesis: Hypothesis
    evidence: Evidence
    log_prior_odds: float
    log_bayes_factor: float
    log_bayes_factor_se: float

    @property
    def log_odds(self) -> float:
        """Posterior log odds against the present model."""
        return self.log_bayes_factor + self.log_prior_odds

    @property
    def place(self) -> tuple[int, ...]:
        """Storeys or floors, empty for the whole building."""
        return self.hypothesis.storeys


@dataclass(frozen=True, kw_only=True)
class Decision:
    """What one round of weighing says.

    Attributes
    ----------
    candidates : tuple of Candidate
        Best first.
    present : Evidence
        Of the present model.
    """

    candidates: tuple[Candidate, ...]
    present: Evidence

    @cached_property
    def by_name(self) -> Mapping[str, float]:
        """Posterior log odds of each effect against the present model, over all its forms and places, best first."""
        return _by_name(self.candidates, None)

    @cached_property
    def leader(self) -> Candidate | None:
        """The hypothesis that leads; among those within 3 nats, the one with fewest parameters at fewest places."""
        if not self.candidates:
            return None
        top = self.candidates[0].log_odds
        close = [c for c in self.candidates if c.log_odds > top - _SIMPLER]
        return min(close, key=lambda c: (c.hypothesis.n_brought, len(c.place), -c.log_odds))

    @cached_property
    def equivalent(self) -> tuple[str, ...]:
        """Other effects that the record cannot tell from the leader."""
        if self.leader is None:
            return ()
        own = self.by_name[self.leader.hypothesis.name]
        error = self.leader.log_bayes_factor_se
        return tuple(
            name
            for name, odds in self.by_name.items()
            if name != self.leader.hypothesis.name and odds > own - THRESHOLD - error
        )

    @cached_property
    def equivalent_places(self) -> tuple[tuple[int, ...], ...]:
        """Other places of the leading effect that the record cannot tell from the leader's."""
        leader = self.leader
        if leader is None:
            return ()
        same = [c for c in self.candidates if c.hypothesis.name == leader.hypothesis.name and c.place != leader.place]
        limit = leader.log_odds - THRESHOLD - leader.log_bayes_factor_se
        return tuple(dict.fromkeys(c.place for c in same if c.log_odds > limit))

    @cached_property
    def under_other_priors(self) -> Mapping[str, Mapping[str, float]]:
        """Log odds of each effect under each width of the priors."""
        return {label: _by_name(self.candidates, label) for label in PRIOR_WIDTHS}

    @property
    def passes(self) -> bool:
        """Whether the leader is to be added: against the present model, beyond error, under every width of prior."""
        return self.leader is not None and not self.objection

    @cached_property
    def objection(self) -> str:
        """Why the leader is not to be added, in words; empty where it is."""
        if self.leader is None:
            return "no catalogued effect can be added to this model"
        name, error = self.leader.hypothesis.name, self.leader.log_bayes_factor_se
        members = {name, *self.equivalent}
        for label, odds in {"": self.by_name, **self.under_other_priors}.items():
            under = f" under priors {label}" if label else ""
            ahead = max(odds, key=lambda one: odds[one])
            own = odds[name]
            if own < THRESHOLD + error:
                return f"log odds of {own:.1f}{under} do not exceed {THRESHOLD:.0f} by their error of {error:.1f}"
            if ahead not in members:
                return f"{ahead} is ahead{under}"
        return ""

    @property
    def doubtful(self) -> tuple[Candidate, ...]:
        """Of the best two, those with Laplace's evidence alone where its error could turn the decision."""
        first, second = (*self.candidates[:2], None, None)[:2]
        if first is None or first.log_odds < THRESHOLD - _DOUBT:
            return ()
        contested = second is not None and abs(first.log_odds - second.log_odds - THRESHOLD) < _DOUBT
        if not contested and first.log_odds > THRESHOLD + _DOUBT:
            return ()
        return tuple(one for one in (first, second if contested else None) if one and one.evidence.method == "Laplace")

    @property
    def sentence(self) -> str:
        """The decision in words."""
        if self.leader is None:
            return "No catalogued effect can be added to this model."
        name, odds = self.leader.hypothesis.label, self.leader.log_odds
        if not self.passes:
            return f"Nothing is named: the best is {name}, but {self.objection}."
        if self.equivalent:
            return f"{name} leads by log odds {odds:.1f}; the record cannot tell it from {', '.join(self.equivalent)}."
        return f"{name} is named: log odds {odds:.1f} against the present model."


def decide(
    present: Evidence, weighed: Sequence[tuple[Hypothesis, Evidence]], considered: Sequence[Hypothesis]
) -> Decision:
    """Turn evidences into posterior odds.

    Parameters
    ----------
    present : Evidence
        Of the present model.
    weighed : sequence of (Hypothesis, Evidence)
        Hypotheses that were fitted.
    considered : sequence of Hypothesis
        All that share the prior, fitted or not.
    """
    prior = log_prior_odds(considered)
    candidates = [
        Candidate(
            hypothesis=hypothesis,
            evidence=evidence,
            log_prior_odds=prior[hypothesis.name],
            log_bayes_factor=evidence.total - present.total,
            log_bayes_factor_se=float(np.hypot(evidence.log_evidence_se, present.log_evidence_se)),
        )
        for hypothesis, evidence in weighed
    ]
    return Decision(candidates=tuple(sorted(candidates, key=lambda c: -c.log_odds)), present=present)


def worth_fitting(scored: Sequence[tuple[Hypothesis, Score]], *, quiet: bool) -> tuple[Hypothesis, ...]:
    """Hypotheses that could be named, best score first.

    A score bounds the log Bayes factor to first order: where the residual is quiet, and the order holds, one that falls
    short of the threshold by more than two nats once the prior odds are counted is left out. Elsewhere six nats are
    asked of the score.

    Parameters
    ----------
    scored : sequence of (Hypothesis, Score)
        All that share the prior.
    quiet : bool
        Whether the present model leaves nothing of note.
    """
    prior = log_prior_odds([hypothesis for hypothesis, _ in scored])
    least = {name: THRESHOLD - odds - _BEYOND_SCORE if quiet else _LEAST_SCORE for name, odds in prior.items()}
    ranked = sorted(scored, key=lambda pair: -pair[1].nats)
    return tuple(hypothesis for hypothesis, score in ranked if score.nats > least[hypothesis.name])


def log_prior_odds(considered: Sequence[Hypothesis]) -> dict[str, float]:
    """Prior log odds against the present model of one hypothesis of each effect, by the effect's name.

    Parameters
    ----------
    considered : sequence of Hypothesis
        All that share the prior.
    """
    variants = Counter(hypothesis.name for hypothesis in considered)
    return {name: -float(np.log(len(variants)) + np.log(count)) for name, count in variants.items()}


def _by_name(candidates: Sequence[Candidate], width: str | None) -> dict[str, float]:
    odds: dict[str, list[float]] = {}
    for candidate in candidates:
        shift = candidate.evidence.prior_shifts[width] if width else 0.0
        odds.setdefault(candidate.hypothesis.name, []).append(candidate.log_odds + shift)
    total = {name: float(logsumexp(values)) for name, values in odds.items()}
    return dict(sorted(total.items(), key=lambda item: -item[1]))
