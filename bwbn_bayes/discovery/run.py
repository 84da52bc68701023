"""What one search carries along: its options, its clock, the present model and its fit."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from bwbn_bayes.discovery.candidates import Hypothesis, hypotheses, scales_of
from bwbn_bayes.discovery.name import Decision
from bwbn_bayes.discovery.outcome import Step
from bwbn_bayes.discovery.race import Fit
from bwbn_bayes.discovery.score import Score, scores
from bwbn_bayes.discovery.where import Disagreement, disagreement
from bwbn_bayes.elements.law import Effect
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.inference.likelihood import Posterior
from bwbn_bayes.inference.modes import Mode
from bwbn_bayes.inference.residuals import leaves_noise, leaves_quiet
from bwbn_bayes.parameters import Floats
from bwbn_bayes.structures.structure import Structure

Listener = Callable[[str], None]


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
class Present:
    """The present model, fitted."""

    posterior: Posterior
    modes: tuple[Mode, ...]
    starts: Floats
    """Further points of its unit cube from which fits start."""

    @property
    def best(self) -> Floats:
        """Its best fit ``(n_dim,)``, in the unit cube."""
        return self.modes[0].point

    @cached_property
    def disagreement(self) -> Disagreement:
        """Where it disagrees with the record."""
        return disagreement(self.posterior, self.best)

    @cached_property
    def is_noise(self) -> bool:
        """Whether what it leaves could be noise."""
        return leaves_noise(self.posterior, self.best)

    @cached_property
    def is_quiet(self) -> bool:
        """Whether nothing of note is left, so that a score tells what a hypothesis could gain."""
        return leaves_quiet(self.posterior, self.best)


@dataclass
class Run:
    """What a run collects."""

    settings: DiscoverySettings
    rng: np.random.Generator
    listener: Listener | None
    began: float = field(default_factory=time.perf_counter)
    steps: list[Step] = field(default_factory=list)
    scored: tuple[Structure | None, tuple[tuple[Hypothesis, Score], ...]] = (None, ())
    """The model that was scored last, with its hypotheses."""
    considered: tuple[Hypothesis, ...] = ()
    """Hypotheses of the present round, fitted or not."""
    notes: list[str] = field(default_factory=list)
    """What the reader of the verdict must know besides."""
    first_fits: tuple[Fit, ...] = ()
    """What the first round came to, best first."""
    first_considered: tuple[Hypothesis, ...] = ()
    """Hypotheses of the first round."""

    def say(self, text: str) -> None:
        """Tell the listener, if there is one."""
        if self.listener is not None:
            self.listener(text)

    def note(self, text: str) -> None:
        """Keep a sentence for the verdict, and tell the listener."""
        self.notes.append(text)
        self.say(text)

    def withdraw(self, why: str, decision: Decision) -> None:
        """Say of the step with a decision that the effect it named did not stay, and why."""
        for number, step in enumerate(self.steps):
            if step.decision is decision:
                self.steps[number] = replace(step, sentence=f"{step.sentence} It is withdrawn: {why}.", withdrawn=True)

    @property
    def elapsed(self) -> float:
        """Seconds since the run began."""
        return time.perf_counter() - self.began


def on_threads(posterior: Posterior, n_threads: int) -> Posterior:
    """The posterior with so many threads for its solves."""
    engine = posterior.engine
    if not isinstance(engine, Lanes):
        raise TypeError(f"discovery solves on the lanes engine, not on {engine.name}")
    return posterior.with_engine(replace(engine, n_threads=n_threads))


def on_one_thread(posterior: Posterior) -> Posterior:
    """The posterior on one thread: hypotheses are what runs beside each other."""
    return on_threads(posterior, 1)


def hypotheses_of(present: Present, run: Run, most_carried: float) -> tuple[Hypothesis, ...]:
    """Every hypothesis about the present model."""
    return hypotheses(
        present.posterior.model,
        scales_of(present.posterior, present.best),
        measured=tuple(present.posterior.record.channels),
        effects=run.settings.effects,
        most_carried=most_carried,
    )


def score_all(present: Present, every: Sequence[Hypothesis], run: Run) -> tuple[tuple[Hypothesis, Score], ...]:
    """What every hypothesis could gain at the present fit, to first order."""
    found = scores(on_one_thread(present.posterior), every, present.best, n_workers=run.settings.n_workers)
    return tuple(zip(every, found, strict=True))
